"""The pose of a single picture: of the poses near the estimate, that with the most probable lane."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lanes import stills as pose_search
from lanes.camera import Camera, CameraPose
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.confidence import rate_lane
from lanes.detect.lane import Lane
from lanes.detect.search import find_lane
from lanes.pose import PoseEstimate
from lanes.stills import SEARCH, search_pose
from tests.support.painted_roads import paint_motorway

POSE = CameraPose(1.7, np.radians(3.0))
CAMERA = Camera.from_fov((640, 360), 60, POSE)


def estimate_with(height_m: float, height_log_std: float, *, pitch_deg: float = 3.0) -> PoseEstimate:
    """An estimate from one picture with this height, its relative standard deviation, and this pitch."""
    return PoseEstimate(
        pose=CameraPose(height_m, np.radians(pitch_deg)),
        height_std_m=height_log_std * height_m,
        pitch_std_rad=np.radians(0.3),
        yaw_std_rad=np.radians(1.0),
        roll_std_rad=np.radians(1.0),
        frames_used=1,
        frames_total=1,
        lane_width_m=3.66,
    )


def lane_at(image: np.ndarray, pose: CameraPose) -> Lane | None:
    return find_lane(image, BirdsEyeView(CAMERA.with_pose(pose)))


def is_right(image: np.ndarray, pose: CameraPose) -> bool:
    """Whether the lane that is found with a pose lies on the painted one, within 1 % of the picture's width."""
    lane, far_m = lane_at(image, pose), np.linspace(8.0, 30.0, 10)
    true = [CAMERA.road_to_pixels(np.column_stack([far_m, np.full(10, y_m)])) for y_m in (1.83, -1.83)]
    columns = lane.pixels(CAMERA.with_pose(pose), true[0][:, 1])
    return bool(np.abs(columns - [pixels[:, 0] for pixels in true]).max() < 0.01 * CAMERA.width)


def test_the_right_lane_is_found_though_the_height_is_wrong():
    """With half the height two lanes look as wide as one."""
    image, estimate = paint_motorway(CAMERA), estimate_with(0.93, 0.5)
    assert not is_right(image, estimate.pose)
    found = search_pose(image, CAMERA, estimate)
    assert is_right(image, found.pose)
    assert abs(np.log(found.pose.height_m / POSE.height_m)) < abs(np.log(estimate.pose.height_m / POSE.height_m)) - 0.2
    assert found.height_std_m / found.pose.height_m == pytest.approx(0.5)


def test_the_poses_agree_on_a_lane_that_is_clear_and_not_on_one_among_many_lines():
    clear, estimate = paint_motorway(CAMERA, lines=(0, 1), solid=(0, 1)), estimate_with(1.7, 0.05)
    assert search_pose(clear, CAMERA, estimate).pose.same_lane_share == 1.0
    # the lines of a car park, 1.2 m apart
    many = paint_motorway(Camera.from_fov((640, 360), 60, replace(POSE, height_m=1.7 * 3)), lines=tuple(range(-6, 8)))
    doubtful = search_pose(many, CAMERA, estimate_with(1.7, 0.25)).pose
    assert doubtful.same_lane_share < 0.6
    lane = lane_at(clear, search_pose(clear, CAMERA, estimate).pose)
    assert rate_lane(lane) > rate_lane(replace(lane, same_lane_share=doubtful.same_lane_share))


def test_a_given_height_is_kept():
    found = search_pose(paint_motorway(CAMERA), CAMERA, estimate_with(1.6, 0.0))
    assert (found.pose.height_m, found.height_std_m) == (1.6, 0.0)


def test_without_a_lane_the_estimate_is_kept_and_no_pose_agrees():
    estimate = estimate_with(1.35, 0.25)
    found = search_pose(np.full((360, 640, 3), 90, np.uint8), CAMERA, estimate)
    assert found == replace(estimate, pose=replace(estimate.pose, same_lane_share=0.0))


def test_the_steps_are_symmetric_and_begin_with_the_estimate():
    assert SEARCH.steps[0] == (0.0, 0.0)
    assert {(-height, -pitch) for height, pitch in SEARCH.steps} == set(SEARCH.steps)


def test_a_lane_that_is_hardly_in_the_picture_is_the_same_as_itself(monkeypatch):
    """Fewer rows show both lines than are needed to compare two lanes: each pose stands for itself."""
    monkeypatch.setattr(pose_search, "SEARCH", replace(SEARCH, min_common_rows=SEARCH.rows + 1))
    found = search_pose(paint_motorway(CAMERA), CAMERA, estimate_with(1.7, 0.05)).pose
    assert found.same_lane_share == pytest.approx(1 / len(SEARCH.steps))
