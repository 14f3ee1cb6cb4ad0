"""For any picture: no finder raises, and its results are finite and consistent."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lanes.camera.model import Camera
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.fit import FIT
from lanes.detect.lane import Lane, telemetry_row
from lanes.detect.residuals import ROAD_M
from lanes.detect.road import WIDTH
from lanes.detect.search import detect_still, detect_with_own_pose, find_lane
from lanes.errors import CameraError
from lanes.labels import as_detection
from lanes.tracking.tracker import LaneTracker
from tests.support.examples import examples
from tests.support.painted_drive import CAMERA
from tests.support.shapes import SEEN

FPS = 20.0
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


def assert_positive_definite(covariance: np.ndarray) -> None:
    """Check the correlation matrix: metres and curvatures differ by powers of ten."""
    std = np.sqrt(np.diag(covariance))
    assert np.isfinite(std).all() and std.min() > 0
    assert np.linalg.eigvalsh(covariance / np.outer(std, std)).min() > 0


def assert_sound(lane: Lane | None, size: tuple[int, int]) -> None:
    """Finite numbers, a positive definite covariance, and lines inside the image."""
    row = telemetry_row(lane)
    json.dumps(row, allow_nan=False)
    if lane is None:
        assert row["state"] == "lost" and row["confidence"] == 0
        return
    camera = camera_of(size)
    assert 0 <= lane.confidence <= 1
    assert np.isfinite([value for value in row.values() if isinstance(value, float)]).all()
    for line in (lane.left, lane.right):
        assert 0 <= line.support <= 1.5 and 0 <= line.reach_m <= ROAD_M.max()
        assert np.isfinite([*line.coefficients, line.offset_std_m]).all()
    assert_positive_definite(lane.covariance)
    columns = lane.columns(camera, np.arange(camera.height))
    assert ((columns == -2) | ((columns >= 0) & (columns <= camera.width - 1))).all()
    assert "nan" not in repr(lane)


@examples(12)
@given(pictures())
def test_the_detector_accepts_any_still(image):
    size = image.shape[1::-1]
    for found in (detect_still(image, camera_of(size)), detect_with_own_pose(image, camera_of(size), 0.2)):
        assert_sound(found.lane, size)
        json.dumps(as_detection(found.lane, found.camera, np.arange(size[1]), 0.0), allow_nan=False)


@examples(15)
@given(
    st.lists(pictures(sizes=((64, 36),)), min_size=1, max_size=4),
    st.lists(st.sampled_from([0.0, 1e-3, 1 / FPS, 0.3, 1.0, 5.0, 1e9, -1.0, np.nan]), min_size=8, max_size=8),
)
def test_the_tracker_accepts_any_drive_and_any_clock(images, clock):
    """Each picture comes twice, so that some lanes are confirmed; time stops, jumps, and runs backwards."""
    tracker = LaneTracker(camera_of((64, 36)), fps=FPS)
    for image, elapsed_s in zip([image for image in images for _ in range(2)], clock, strict=False):
        assert_sound(tracker.update(image, elapsed_s=elapsed_s), (64, 36))


def test_the_smallest_size_is_the_documented_one():
    assert all(BirdsEyeView(camera_of(size)).seen.any() for size in SIZES)
    for size in [(1, 1), (2, 1), (1, 720), (3, 1)]:
        with pytest.raises(CameraError, match=r"sees no road between [\d.]+ and 70 m ahead"):
            find_lane(np.zeros((size[1], size[0], 3), np.uint8), camera_of(size))


@examples(100)
@given(st.data())
def test_every_lane_within_the_limits_has_lines(data):
    """Also a lane whose lines turn back before they are next to the car."""
    share = data.draw(st.lists(st.floats(-1, 1), min_size=len(FIT.prior.limit), max_size=len(FIT.prior.limit)))
    model, covariance = FIT.prior.limit * share, np.diag(np.square(FIT.prior.limit))
    model[WIDTH] = abs(model[WIDTH])
    assert_sound(Lane(model, model, covariance, (SEEN, SEEN), score=1.0), (640, 360))
