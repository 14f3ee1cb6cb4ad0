"""Images that equal the last one: copied frames, and a camera that hangs."""

from __future__ import annotations

import numpy as np
import pytest

from lanes.detect.lane import FROZEN, TRACKING, Lane
from lanes.tracking.tracker import LaneTracker
from tests.support.painted_drive import BENDS, SMALL

# The last image before the camera hangs, and how often it is repeated.
LAST = 25
REPEATED = 75
FPS = 25.0


def test_a_frame_rate_doubled_by_copies_gives_the_lane_of_the_original():
    original = LaneTracker(SMALL, fps=25)
    copied = LaneTracker(SMALL, fps=50)
    for number in range(30):
        image = BENDS.frame(number / 25)
        lane = original.update(image)
        copied.update(image)
        of_copy = copied.update(image.copy())
        np.testing.assert_allclose(of_copy.model, lane.model, rtol=0, atol=1e-9)
        np.testing.assert_allclose(of_copy.fit_covariance, lane.fit_covariance)


@pytest.fixture(scope="module")
def hanging() -> list[Lane | None]:
    """The lane before the camera hangs, and in each repeated image."""
    tracker = LaneTracker(SMALL, fps=FPS)
    for number in range(LAST + 1):
        lane = tracker.update(BENDS.frame(number / FPS))
    image = BENDS.frame(LAST / FPS)
    return [lane, *(tracker.update(image) for _ in range(REPEATED))]


def test_a_copy_does_not_change_the_lane_for_half_a_second(hanging):
    assert all(lane is hanging[0] for lane in hanging[: round(0.5 * FPS)])


def test_a_picture_that_stands_still_is_no_measurement(hanging):
    frozen = [lane for lane in hanging if lane and lane.state == FROZEN]
    stds_m = [lane.offset_std_m for lane in (hanging[0], *frozen)]
    assert (np.diff(stds_m) > 0).all()
    assert frozen[0].confidence < 0.9
    assert not any(line.seen for line in frozen[0].lines)


def test_a_picture_that_stands_still_ends_without_a_lane(hanging):
    assert hanging[-1] is None


def test_the_lane_is_tracked_again_when_the_picture_moves():
    tracker = LaneTracker(SMALL, fps=FPS)
    for number in range(LAST):
        tracker.update(BENDS.frame(number / FPS))
    for _ in range(round(0.6 * FPS)):
        lane = tracker.update(BENDS.frame((LAST - 1) / FPS))
    assert lane.state == FROZEN
    # the camera goes on with the images of now
    for number in range(5):
        lane = tracker.update(BENDS.frame(LAST / FPS + 0.6 + number / FPS))
    assert lane.state == TRACKING


def test_images_in_the_same_array_are_no_repeated_image():
    tracker = LaneTracker(SMALL, fps=FPS)
    buffer = np.empty_like(BENDS.frame(0.0))
    for number in range(25):
        buffer[:] = BENDS.frame(number / FPS)
        lane = tracker.update(buffer)
    assert lane.state == TRACKING
    assert all(line.seen for line in lane.lines)
