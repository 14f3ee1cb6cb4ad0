"""Limits of what a camera records: size of an image, frame rate, clock.

They hold for images, video files and robot logs alike.
"""

from fractions import Fraction

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
