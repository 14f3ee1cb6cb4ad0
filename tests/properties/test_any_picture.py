"""For any image: no finder raises, and its results are finite and consistent."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lanes.camera.model import Camera
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.fit import FitSettings
from lanes.detect.lane import Lane
from lanes.detect.residuals import ROAD_M
from lanes.detect.road import WIDTH
from lanes.detect.search import (
    DETECTOR,
    StillDetection,
    detect_still,
    detect_with_own_pose,
    find_lane,
)
from lanes.errors import CameraError
from lanes.labels import as_detection
from lanes.telemetry import telemetry_row
from lanes.tracking.tracker import LaneTracker
from tests.support.examples import examples
from tests.support.painted_drive import CAMERA
from tests.support.shapes import SEEN

FPS = 20.0
# From the smallest image that shows road between 5 and 70 m ahead, through odd sizes,
# to 1280 columns.
SIZES = [
    (3, 2),
    (5, 3),
    (16, 9),
    (7, 40),
    (33, 19),
    (64, 36),
    (64, 64),
    (101, 57),
    (160, 90),
    (201, 40),
    (90, 160),
    (163, 91),
    (320, 180),
    (640, 360),
    (1280, 720),
]


@cache
def camera_of(size: tuple[int, int]) -> Camera:
    """The tests' dashcam, scaled; for another aspect ratio a lens with the same field
    of view and no distortion.
    """
    try:
        return CAMERA.scaled(size)
    except CameraError:
        return Camera.from_fov(size, CAMERA.hfov_deg, CAMERA.pose)


# Share of the first colour, of columns u, rows v, a period and a phase in pixels.


def upright_stripes(u, v, period, phase):
    return (u + phase) // period % 2


def level_stripes(u, v, period, phase):
    return (v + phase) // period % 2


def squares(u, v, period, phase):
    return (u // period + (v + phase) // period) % 2


def converging_stripes(u, v, period, phase):
    """They meet at a point near the horizon, as lane lines do."""
    height, width = u.shape
    angle = np.arctan2(u - width / 2 + phase, v - 0.49 * height + 0.1)
    return np.sin(angle * 200 / period) > 0.7


def growing_to_the_right(u, v, period, phase):
    return u / u.shape[1]


def growing_downwards(u, v, period, phase):
    return v / u.shape[0]


def even(u, v, period, phase):
    return np.zeros(u.shape)


PATTERNS = [
    upright_stripes,
    level_stripes,
    squares,
    converging_stripes,
    growing_to_the_right,
    growing_downwards,
    even,
]
LEVEL = st.integers(0, 255)
BLACK = (0, 0, 0)
WHITE = (255, 255, 255)
YELLOW = (255, 255, 0)
BLUE = (0, 0, 255)
COLOURS = st.sampled_from([BLACK, WHITE, YELLOW, BLUE])
COLOURS |= st.tuples(LEVEL, LEVEL, LEVEL)


@st.composite
def any_image(draw: st.DrawFn, sizes: list = SIZES) -> np.ndarray:
    """An image (height, width, 3) uint8: a pattern in two colours, with noise and dead
    pixels.
    """
    width, height = draw(st.sampled_from(sizes))
    v, u = np.mgrid[:height, :width]
    pattern = draw(st.sampled_from(PATTERNS))
    period = draw(st.integers(1, 60))
    phase = draw(st.integers(0, 60))
    share = pattern(u, v, period, phase)[..., None]
    first = np.float32(share) * draw(COLOURS)
    second = np.float32(1 - share) * draw(COLOURS)
    image = first + second

    seed = draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    noise = draw(st.sampled_from([0.0, 2.0, 30.0, 1000.0]))
    if noise:
        image = image + rng.normal(0, noise, image.shape)
    dead_share = draw(st.sampled_from([0.0, 0.0, 0.01, 0.5]))
    image[rng.random((height, width)) < dead_share] = draw(COLOURS)
    return np.clip(image, 0, 255).astype(np.uint8)


def assert_positive_definite(covariance: np.ndarray) -> None:
    """Check the correlation matrix: metres and curvatures differ by powers of ten."""
    std = np.sqrt(np.diag(covariance))
    assert np.isfinite(std).all()
    assert std.min() > 0
    correlation = covariance / np.outer(std, std)
    assert np.linalg.eigvalsh(correlation).min() > 0


def assert_sound(lane: Lane | None, size: tuple[int, int]) -> None:
    """Finite numbers, a positive definite covariance, and lines inside the image."""
    row = telemetry_row(lane)
    json.dumps(row, allow_nan=False)
    if lane is None:
        assert row["state"] == "lost"
        assert row["confidence"] == 0
        return
    assert 0 <= lane.confidence <= 1
    numbers = [value for value in row.values() if isinstance(value, float)]
    assert np.isfinite(numbers).all()
    for line in lane.lines:
        assert 0 <= line.support <= 1.5
        assert 0 <= line.reach_m <= ROAD_M.max()
        assert np.isfinite([*line.coefficients, line.offset_std_m]).all()
    assert_positive_definite(lane.covariance)
    camera = camera_of(size)
    columns = lane.columns(camera, np.arange(camera.height))
    inside = (columns >= 0) & (columns <= camera.width - 1)
    assert ((columns == -2) | inside).all()
    assert "nan" not in repr(lane)


def detect_with_another_pose(image: np.ndarray, camera: Camera) -> StillDetection:
    return detect_with_own_pose(image, camera, 0.2, DETECTOR)


@pytest.mark.parametrize("detect", [detect_still, detect_with_another_pose])
@examples(12)
@given(image=any_image())
def test_the_detector_accepts_any_still(detect, image):
    size = image.shape[1::-1]

    found = detect(image, camera_of(size))

    assert_sound(found.lane, size)
    row = as_detection(found.lane, found.camera, np.arange(size[1]), 0.0)
    json.dumps(row, allow_nan=False)


CLOCK = st.sampled_from([0.0, 1e-3, 1 / FPS, 0.3, 1.0, 5.0, 1e9, -1.0, np.nan])


@examples(15)
@given(
    st.lists(any_image(sizes=[(64, 36)]), min_size=1, max_size=4),
    st.lists(CLOCK, min_size=8, max_size=8),
)
def test_the_tracker_accepts_any_drive_and_any_clock(images, clock):
    """Each image comes twice, so that some lanes are confirmed; time stops, jumps, and
    runs backwards.
    """
    tracker = LaneTracker(camera_of((64, 36)), fps=FPS)
    for number, elapsed_s in enumerate(clock[: 2 * len(images)]):
        lane = tracker.update(images[number // 2], elapsed_s=elapsed_s)
        assert_sound(lane, (64, 36))


@pytest.mark.parametrize("size", SIZES)
def test_some_road_is_seen_from_the_smallest_size_on(size):
    assert BirdsEyeView(camera_of(size)).seen.any()


@pytest.mark.parametrize("size", [(1, 1), (2, 1), (1, 720), (3, 1)])
def test_no_road_is_seen_in_smaller_images(size):
    width, height = size
    image = np.zeros((height, width, 3), np.uint8)
    with pytest.raises(
        CameraError, match=r"sees no road between [\d.]+ and 70 m ahead"
    ):
        find_lane(image, camera_of(size))


LIMIT = FitSettings().prior.limit
COUNT = len(LIMIT)


@examples(100)
@given(st.lists(st.floats(-1, 1), min_size=COUNT, max_size=COUNT))
def test_every_lane_within_the_limits_has_lines(shares):
    """Also a lane whose lines turn back before they are next to the car."""
    model = LIMIT * shares
    model[WIDTH] = abs(model[WIDTH])
    covariance = np.diag(LIMIT**2)

    lane = Lane(model, model, covariance, (SEEN, SEEN), score=1.0)

    assert_sound(lane, (640, 360))
