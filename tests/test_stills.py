"""Detection in single images, and the pose that an image of an unknown camera gets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lanes.camera.model import Camera, CameraPose
from lanes.detect.lane import Lane
from lanes.detect.search import (
    DETECTOR,
    StillDetection,
    detect_still,
    detect_with_own_pose,
    find_lane,
)
from lanes.errors import CameraError
from lanes.pose.estimate import estimate_pose
from simulator.rendering.render import Frame, render_frame
from simulator.scenes.suite import SUITE
from tests.support.painted_roads import dashcam, paint_motorway


@pytest.mark.parametrize(
    ("camera", "words"),
    [
        (replace(dashcam(), pose=None), "no pose"),
        (dashcam(pitch_rad=-0.9), "sees no road"),
    ],
)
def test_a_camera_without_pose_or_road_is_refused(camera, words):
    image = np.zeros((360, 640, 3), np.uint8)
    with pytest.raises(CameraError, match=words):
        find_lane(image, camera)


POSE = CameraPose(1.7, np.radians(3.0))
CAMERA = Camera.from_fov((640, 360), 60, POSE)


def own_pose(
    image: np.ndarray, height_m: float = 1.7, height_log_std: float = 0.05
) -> StillDetection:
    """What is found with the poses around an estimate of the height, and the true
    pitch.
    """
    camera = CAMERA.with_pose(replace(POSE, height_m=height_m))
    return detect_with_own_pose(image, camera, height_log_std, DETECTOR)


def is_right(found: StillDetection) -> bool:
    """Whether the lane lies on the painted one, within 1 % of the image's width."""
    far_m = np.linspace(8.0, 30.0, 10)
    left = CAMERA.road_to_pixels(np.column_stack([far_m, np.full(10, 1.83)]))
    right = CAMERA.road_to_pixels(np.column_stack([far_m, np.full(10, -1.83)]))
    columns = found.lane.columns(found.camera, left[:, 1])
    errors_px = np.abs(columns - [left[:, 0], right[:, 0]])
    return bool(errors_px.max() < 0.01 * CAMERA.width)


@pytest.fixture(scope="module")
def motorway() -> np.ndarray:
    return paint_motorway(CAMERA)


class TestHalfTheHeight:
    """With half the height two lanes look as wide as one."""

    def test_another_lane_is_found_with_that_height(self, motorway):
        camera = CAMERA.with_pose(replace(POSE, height_m=0.93))
        assert not is_right(detect_still(motorway, camera))

    def test_the_right_lane_is_found_with_heights_around_it(self, motorway):
        assert is_right(own_pose(motorway, 0.93, 0.5))

    def test_the_height_becomes_better(self, motorway):
        height_m = own_pose(motorway, 0.93, 0.5).camera.pose.height_m
        given = abs(np.log(0.93 / 1.7))
        assert abs(np.log(height_m / 1.7)) < given - 0.2


@pytest.fixture(scope="module")
def doubtful() -> Lane:
    """One of many lines that are 1.2 m apart, as on a car park."""
    high = CAMERA.with_pose(replace(POSE, height_m=1.7 * 3))
    image = paint_motorway(high, lines=range(-6, 8))
    return own_pose(image, height_log_std=0.25).lane


@pytest.fixture(scope="module")
def clear() -> Lane:
    image = paint_motorway(CAMERA, lines=(0, 1), solid=(0, 1))
    return own_pose(image).lane


class TestAgreementOfPoses:
    def test_all_poses_show_a_clear_lane(self, clear):
        assert clear.single_image_pose
        assert clear.same_lane_share == 1.0
        assert clear.camera.pose == POSE

    def test_some_poses_show_another_of_many_lines(self, doubtful):
        assert doubtful.same_lane_share <= 0.75

    def test_disagreement_lowers_the_confidence(self, clear, doubtful):
        share = doubtful.same_lane_share
        assert clear.confidence > replace(clear, same_lane_share=share).confidence


def test_without_a_lane_the_estimate_of_the_pose_is_kept():
    found = own_pose(np.full((360, 640, 3), 90, np.uint8), 1.35, 0.25)
    assert found.lane is None
    assert found.camera.pose == replace(POSE, height_m=1.35)
    assert found.evidence.view_image.any()


_FOCAL_PX = 320 / np.radians(70)
FISHEYE = Camera(
    640,
    360,
    np.array([[_FOCAL_PX, 0, 322], [0, _FOCAL_PX, 178], [0, 0, 1]]),
    np.array([0.02, -0.01, 0.003, -0.001]),
    CameraPose(1.4, *np.radians([2.0, 1.0])),
)


@pytest.fixture(scope="module")
def frames() -> list[Frame]:
    scene = SUITE["motorway"].drive()
    drive = replace(scene, camera=FISHEYE, bonnet=False)
    return [render_frame(drive, time_s) for time_s in (0.0, 1.5, 3.0)]


class TestFisheye:
    """140 degrees wide: the road near the car is seen far from the optical axis, and
    straight lines are bent.
    """

    @pytest.mark.slow
    def test_the_lane_is_found(self, frames):
        for frame in frames:
            offset_m = find_lane(frame.image, FISHEYE).offset_m
            assert offset_m == pytest.approx(frame.truth.offset_m, abs=0.05)

    @pytest.mark.slow
    def test_the_pose_is_found(self, frames):
        images = [frame.image for frame in frames]
        pose = estimate_pose(images, replace(FISHEYE, pose=None)).pose
        assert np.degrees(pose.pitch_rad) == pytest.approx(2.0, abs=0.5)
        assert np.degrees(pose.yaw_rad) == pytest.approx(1.0, abs=0.5)
