"""The camera angles from all edges of one picture, for streets without two lane lines."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from lanes.camera import Camera, CameraPose
from lanes.errors import PoseError
from lanes.pose import PRIOR_HEIGHT_LOG_STD, describe_accuracy, estimate_pose
from lanes.vanishing_point import find_edge_direction
from tests.support.painted_roads import paint_motorway


def paint_street(camera: Camera, *, lines: tuple[int, ...] = (), seed: int = 0) -> np.ndarray:
    """A street of houses with four storeys on both sides: strips along the road, each of a grey of its own."""
    rng = np.random.default_rng(seed)
    image = paint_motorway(camera, lines=lines, solid=lines, seed=seed)
    for y_m in (-7.0, 7.0):
        for begin_m in (70.0, 40.0, 24.0, 12.0):
            for floor in range(4):
                x_m = [begin_m, begin_m * 1.6, begin_m * 1.6, begin_m]
                z_m = [1.5 * floor, 1.5 * floor, 1.5 * floor + 1.2, 1.5 * floor + 1.2]
                corners = camera.road_to_pixels(np.column_stack([x_m, [y_m] * 4, z_m]))
                cv2.fillPoly(image, [np.round(corners).astype(np.int32)], [int(rng.integers(30, 230))] * 3)
    return image


@pytest.mark.parametrize(("pitch_deg", "yaw_deg"), [(2.5, -1.8), (-4.0, 5.0), (6.0, 0.0)])
def test_street_without_lane_lines(pitch_deg, yaw_deg):
    camera = Camera.from_fov((1280, 720), 62, CameraPose(1.5, *np.radians([pitch_deg, yaw_deg])))
    direction = find_edge_direction(paint_street(camera), camera)
    assert np.degrees(direction.pitch_rad) == pytest.approx(pitch_deg, abs=0.6)
    assert np.degrees(direction.yaw_rad) == pytest.approx(yaw_deg, abs=1.0)
    assert np.degrees(direction.pitch_std_rad) < 1.5


def test_pose_of_one_picture_says_that_it_is_from_edges_and_that_the_height_is_assumed():
    camera = Camera.from_fov((1920, 1280), 62, CameraPose(1.5, np.radians(3.0)))
    estimate = estimate_pose([paint_street(camera, lines=(0,))], camera)
    assert np.degrees(estimate.pose.pitch_rad) == pytest.approx(3.0, abs=1.0)
    assert estimate.pose.roll_rad == 0.0
    assert abs(estimate.pose.height_m - 1.5) < 2 * estimate.height_std_m
    assert estimate.height_std_m / estimate.pose.height_m == pytest.approx(PRIOR_HEIGHT_LOG_STD)
    assert "(assumed)" in estimate.describe() and "vanishing point of all its edges" in estimate.notes[0]
    assert "25% (the height is assumed)" in describe_accuracy(estimate)
    assert estimate_pose([paint_street(camera)], camera, height_m=1.6).pose.height_m == 1.6


def test_several_pictures_are_not_estimated_from_edges():
    camera = Camera.from_fov((1280, 720), 62, CameraPose(1.5))
    with pytest.raises(PoseError, match="only 0 of 2 pictures"):
        estimate_pose([paint_street(camera)] * 2, camera)


def sky() -> np.ndarray:
    return np.repeat(np.linspace(200, 100, 720).astype(np.uint8)[:, None, None], 1280, axis=1).repeat(3, axis=2)


def noise(blur_px: float) -> np.ndarray:
    image = np.random.default_rng(3).integers(0, 255, (720, 1280, 3), dtype=np.uint8)
    return cv2.GaussianBlur(image, (0, 0), blur_px)


def tiles() -> np.ndarray:
    rows, columns = np.mgrid[:720, :1280]
    return np.repeat((((rows + columns) // 80 + (rows - columns) // 80) % 2 * 150 + 50)[..., None], 3, 2).astype(
        np.uint8
    )


def shapes() -> np.ndarray:
    rng, image = np.random.default_rng(5), np.full((720, 1280, 3), 128, np.uint8)
    for corners in rng.integers(0, 1280, (60, 3, 2)):
        cv2.fillPoly(image, [corners.astype(np.int32)], rng.integers(0, 255, 3).tolist())
    return image


@pytest.mark.parametrize(
    "image", [sky(), noise(0.5), noise(6.0), tiles(), shapes(), np.zeros((720, 1280, 3), np.uint8)]
)
def test_picture_without_a_road_is_refused(image):
    with pytest.raises(PoseError, match="so no road is recognised"):
        estimate_pose([image], Camera.from_fov((1280, 720), 60))
