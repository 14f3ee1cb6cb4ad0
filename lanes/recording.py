"""Limits of what a camera records (size of an image, frame rate, clock), the frame rate
by time stamps, and the bits of values.

They hold for images, video files and robot logs alike.
"""

from collections.abc import Iterable
from fractions import Fraction

import numpy as np

# Four times an 8K video's. A header can claim 4,000 million. Pillow refuses images of
# more than 179 million.
MAX_PIXELS = 128_000_000
# Frame rates that a 32-bit clock and the tracker can handle.
MIN_FPS, MAX_FPS = Fraction(1, 10), 1000
# A larger step back in time is a recorder's restarted clock, as in concatenated clips.
CLOCK_RESET_S = 0.25
# The rate varies if more than this share of the frames follow sooner than this, in
# frames of a constant rate.
MIN_STEP, MAX_SHORT_SHARE = 0.75, 0.1
# More frames of the usual rate than this are not missing in a hole: another recording
# begins behind it.
JUMP_FRAMES = 1500
# Bits of a value; more than 8 are in two bytes.
BITS = (8, 10, 12, 14, 16)


def usual_rate(steps_s: np.ndarray) -> float:
    """Frames per second between gaps, by the steps (N,) from one time stamp to the
    next; 0 without any.
    """
    known_s = steps_s[steps_s > 0]
    if not len(known_s):
        return 0.0
    step_s = known_s[known_s < 1.5 * np.median(known_s)].mean()

    # Time stamps may be rounded to a millisecond: at a constant rate the whole length
    # is more exact than the steps.
    frames = np.rint(known_s / step_s)
    counted = frames <= JUMP_FRAMES
    rate = frames[counted].sum() / known_s[counted].sum()
    is_constant = abs(rate * step_s - 1) < 0.01
    return float(rate if is_constant else 1 / step_s)


def count_bits(peaks: Iterable[int]) -> int:
    """Bits of the values of a camera, from the largest values of some of its images.

    Cameras with 12 bits store them in words of 16.
    """
    peak = max(peaks, default=0)
    return next(bits for bits in BITS if peak < 1 << bits)


def to_8_bits(image: np.ndarray, bits: int | None = None) -> np.ndarray:
    """An image of uint8 or uint16 as uint8; by default of the bits that it shows."""
    if image.dtype == np.uint8:
        return image
    bits = bits or count_bits([int(image.max(initial=0))])
    return np.minimum(image >> (bits - 8), 255).astype(np.uint8)
