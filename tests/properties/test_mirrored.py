"""The mirrored image of the mirrored camera gives the mirrored lane: no side is
preferred.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lanes.camera.model import Camera
from lanes.detect.lane import Lane
from lanes.tracking.tracker import LaneTracker
from tests.support.painted_drive import BENDS, SMALL

X_M = np.array([5.0, 10.0, 15.0, 20.0, 30.0])
# Rounding differences of sums in another order, after two seconds of tracking.
SAME_M = 1e-4


def mirrored(camera: Camera) -> Camera:
    """The camera mirrored about the car's centre: column u becomes width - 1 - u."""
    matrix = camera.matrix.copy()
    matrix[0, 2] = camera.width - 1 - matrix[0, 2]
    # p2 shifts columns by their square, which mirrors to the other side
    distortion = camera.distortion.copy()
    distortion[3] *= -1
    pose = camera.pose
    pose = replace(pose, yaw_rad=-pose.yaw_rad, roll_rad=-pose.roll_rad)
    return replace(camera, matrix=matrix, distortion=distortion, pose=pose)


def assert_mirrored(lane: Lane, other: Lane) -> None:
    y_m = lane.lateral_m(X_M)
    other_y_m = other.lateral_m(X_M)[::-1]
    # far to the side a line runs nearly across x: rounding moves it along itself
    far_m = np.maximum(np.abs(y_m) - 4.0, 0.0)
    assert (np.abs(other_y_m + y_m) <= SAME_M + 2e-4 * far_m).all()
    assert other.offset_m == pytest.approx(-lane.offset_m, abs=SAME_M)
    curvature_per_m = pytest.approx(-lane.curvature_per_m, abs=SAME_M / 10)
    assert other.curvature_per_m == curvature_per_m
    assert other.width_m == pytest.approx(lane.width_m, abs=SAME_M)
    assert other.offset_std_m == pytest.approx(lane.offset_std_m, rel=SAME_M)
    assert other.left.seen == lane.right.seen
    assert other.right.seen == lane.left.seen
    assert other.state == lane.state


def test_a_painted_drive_is_tracked_alike():
    """Two seconds of bends, with a solid yellow line on the left and a dashed white one
    on the right, and mirrored.
    """
    tracker = LaneTracker(SMALL, fps=12.5)
    other_tracker = LaneTracker(mirrored(SMALL), fps=12.5)
    found = 0
    for time_s in np.arange(25) / 12.5:
        image = BENDS.frame(time_s)

        lane = tracker.update(image)
        other = other_tracker.update(np.ascontiguousarray(image[:, ::-1]))

        assert (lane is None) == (other is None)
        if lane:
            assert_mirrored(lane, other)
            found += 1
    assert found >= 23
