"""Detection in single images, and the pose that an image of an unknown camera gets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lanes.camera.model import Camera, CameraPose
from lanes.detect.search import (
    StillDetection,
    detect_still,
    detect_with_own_pose,
    find_lane,
)
from lanes.errors import CameraError
from lanes.pose.estimate import estimate_pose
from simulator.rendering.render import render_frame
from simulator.scenes.suite import SUITE
from tests.support.painted_roads import dashcam, paint_motorway


def test_a_camera_without_pose_and_one_that_sees_no_road_are_refused():
    image = np.zeros((360, 640, 3), np.uint8)
    with pytest.raises(CameraError, match="no pose"):
        find_lane(image, replace(dashcam(), pose=None))
    with pytest.raises(CameraError, match="sees no road"):
        find_lane(image, dashcam(pitch_rad=-0.9))


POSE = CameraPose(1.7, np.radians(3.0))
CAMERA = Camera.from_fov((640, 360), 60, POSE)


def own_pose(
    image: np.ndarray, height_m: float = 1.7, height_log_std: float = 0.05
) -> StillDetection:
    """What is found with the poses around an estimate of the height, and the true
    pitch.
    """
    return detect_with_own_pose(
        image, CAMERA.with_pose(replace(POSE, height_m=height_m)), height_log_std
    )


def is_right(found: StillDetection) -> bool:
    """Whether the lane lies on the painted one, within 1 % of the image's width."""
    far_m = np.linspace(8.0, 30.0, 10)
    true = [
        CAMERA.road_to_pixels(np.column_stack([far_m, np.full(10, y_m)]))
        for y_m in (1.83, -1.83)
    ]
    columns = found.lane.columns(found.camera, true[0][:, 1])
    return bool(
        np.abs(columns - [pixels[:, 0] for pixels in true]).max() < 0.01 * CAMERA.width
    )


class TestOwnPose:
    """Of the heights near the estimate, that with the most probable lane."""

    def test_the_right_lane_is_found_though_the_height_is_wrong(self):
        """With half the height two lanes look as wide as one."""
        image = paint_motorway(CAMERA)
        assert not is_right(
            detect_still(image, CAMERA.with_pose(replace(POSE, height_m=0.93)))
        )
        found = own_pose(image, 0.93, 0.5)
        assert is_right(found)
        assert (
            abs(np.log(found.camera.pose.height_m / 1.7))
            < abs(np.log(0.93 / 1.7)) - 0.2
        )

    def test_the_poses_agree_on_a_lane_that_is_clear_and_not_on_one_among_many_lines(
        self,
    ):
        clear = own_pose(paint_motorway(CAMERA, lines=(0, 1), solid=(0, 1))).lane
        assert clear.same_lane_share == 1.0
        assert clear.camera.pose == POSE
        # as on a car park, 1.2 m apart
        many = paint_motorway(
            Camera.from_fov((640, 360), 60, replace(POSE, height_m=1.7 * 3)),
            lines=range(-6, 8),
        )
        doubtful = own_pose(many, height_log_std=0.25).lane
        assert doubtful.same_lane_share <= 0.75
        assert (
            clear.confidence
            > replace(clear, same_lane_share=doubtful.same_lane_share).confidence
        )

    def test_without_a_lane_the_estimate_is_kept(self):
        found = own_pose(np.full((360, 640, 3), 90, np.uint8), 1.35, 0.25)
        assert found.lane is None
        assert found.camera.pose == replace(POSE, height_m=1.35)
        assert found.evidence.view_image.any()


@pytest.mark.slow
def test_a_lane_is_found_through_a_fisheye_lens():
    """140 degrees wide: the road near the car is seen far from the optical axis, and
    straight lines are bent.
    """
    focal_px = 320 / np.radians(70)
    matrix = np.array([[focal_px, 0, 322], [0, focal_px, 178], [0, 0, 1]])
    camera = Camera(
        640,
        360,
        matrix,
        np.array([0.02, -0.01, 0.003, -0.001]),
        CameraPose(1.4, *np.radians([2.0, 1.0])),
    )
    drive = replace(SUITE["motorway"].drive(), camera=camera, bonnet=False)
    frames = [render_frame(drive, time_s) for time_s in (0.0, 1.5, 3.0)]
    for frame in frames:
        assert find_lane(frame.image, camera).offset_m == pytest.approx(
            frame.truth.offset_m, abs=0.05
        )
    pose = estimate_pose(
        [frame.image for frame in frames], replace(camera, pose=None)
    ).pose
    assert np.degrees([pose.pitch_rad, pose.yaw_rad]) == pytest.approx(
        [2.0, 1.0], abs=0.5
    )
