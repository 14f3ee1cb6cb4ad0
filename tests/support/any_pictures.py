"""Random pictures of any size and unusual content, for tests of properties that hold for all pictures."""

from __future__ import annotations

from functools import cache

import numpy as np
from hypothesis import strategies as st

from lanes.camera import Camera
from lanes.errors import CameraError
from tests.support.painted_drive import CAMERA

# From the smallest picture that shows road between 5 and 70 m ahead, through odd sizes, to 1280 columns.
SIZES = (
    *((3, 2), (5, 3), (16, 9), (7, 40), (33, 19), (64, 36), (64, 64), (101, 57)),
    *((160, 90), (201, 40), (90, 160), (163, 91), (320, 180), (640, 360), (1280, 720)),
)


@cache
def camera_of(size: tuple[int, int]) -> Camera:
    """The tests' dashcam, scaled; for another aspect ratio a lens with the same field of view and no distortion."""
    try:
        return CAMERA.scaled(size)
    except CameraError:
        return Camera.from_fov(size, CAMERA.hfov_deg, CAMERA.pose)


# Share of the first colour, of columns u, rows v, a period and a phase in pixels.
PATTERNS = (
    lambda u, v, period, phase: (u + phase) // period % 2,
    lambda u, v, period, phase: (v + phase) // period % 2,
    lambda u, v, period, phase: (u // period + (v + phase) // period) % 2,
    # stripes that meet at a point near the horizon, as lane lines do
    lambda u, v, period, phase: (
        np.sin(np.arctan2(u - u.shape[1] / 2 + phase, v - 0.49 * u.shape[0] + 0.1) * 200 / period) > 0.7
    ),
    lambda u, v, period, phase: u / u.shape[1],
    lambda u, v, period, phase: v / u.shape[0],
    lambda u, v, period, phase: np.zeros(u.shape),
)
GREY_LEVELS = st.integers(0, 255)
COLOURS = st.sampled_from([(0, 0, 0), (255, 255, 255), (255, 255, 0), (0, 0, 255)]) | st.tuples(*[GREY_LEVELS] * 3)


@st.composite
def pictures(draw: st.DrawFn, sizes: tuple = SIZES) -> np.ndarray:
    """A picture (height, width, 3) uint8: a pattern in two colours, with noise and dead pixels."""
    width, height = draw(st.sampled_from(sizes))
    v, u = np.mgrid[:height, :width]
    share = draw(st.sampled_from(PATTERNS))(u, v, draw(st.integers(1, 60)), draw(st.integers(0, 60)))[..., None]
    image = np.float32(share) * draw(COLOURS) + np.float32(1 - share) * draw(COLOURS)
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    noise = draw(st.sampled_from([0.0, 2.0, 30.0, 1000.0]))
    if noise:
        image = image + rng.normal(0, noise, image.shape)
    image[rng.random((height, width)) < draw(st.sampled_from([0.0, 0.0, 0.01, 0.5]))] = draw(COLOURS)
    return np.clip(image, 0, 255).astype(np.uint8)
