"""For any picture: no finder raises, and its results are finite and consistent."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.fit import FIT, ROAD_M
from lanes.detect.lane import Lane, telemetry_row
from lanes.detect.road import WIDTH
from lanes.detect.search import detect_still, detect_with_own_pose, find_lane
from lanes.errors import CameraError
from lanes.labels import as_detection
from lanes.tracking.tracker import LaneTracker
from tests.support.any_pictures import SIZES, camera_of, pictures
from tests.support.examples import examples
from tests.support.shapes import SEEN

FPS = 20.0
view_of = cache(lambda size: BirdsEyeView(camera_of(size)))
tracker_of = cache(lambda size: LaneTracker(camera_of(size), fps=FPS))


def size_of(image: np.ndarray) -> tuple[int, int]:
    return image.shape[1], image.shape[0]


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
    size = size_of(image)
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
    tracker = tracker_of((64, 36))
    tracker.reset()
    for image, elapsed_s in zip([image for image in images for _ in range(2)], clock, strict=False):
        assert_sound(tracker.update(image, elapsed_s=elapsed_s), (64, 36))


def test_the_smallest_size_is_the_documented_one():
    assert all(view_of(size).seen.any() for size in SIZES)
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
