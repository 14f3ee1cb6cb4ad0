"""The classic pipeline in tests: a camera's lens and homography, a finder, a result."""

from __future__ import annotations

import numpy as np
import pytest

from helpers import (
    FoundLine,
    LaneFinder,
    LaneResult,
    Lens,
    RoadLine,
    get_recipe,
    road_homography,
)
from lanes.camera.model import Camera
from tests.support.project import REAL_DATA

NOTHING = np.zeros((720, 1280), np.uint8)
# (metres per column, metres per row) of all three originals
USUAL_SCALES = (3.7 / 700, 30 / 720)

needs_real_data = pytest.mark.skipif(
    not (REAL_DATA / "camera_cal").is_dir(), reason="needs real images in LANES_DATA"
)


def lens_of(camera: Camera) -> Lens:
    """The lens of a camera as helpers.py has it."""
    return Lens(camera.matrix, camera.distortion, camera.size)


def image_to_road(camera: Camera) -> np.ndarray:
    """The homography (3, 3) of the pose of a camera."""
    pose = camera.require_pose()
    return road_homography(
        lens_of(camera),
        height_m=pose.height_m,
        pitch_rad=pose.pitch_rad,
        yaw_rad=pose.yaw_rad,
        roll_rad=pose.roll_rad,
    )


def start_finder(name: str, camera: Camera) -> LaneFinder:
    """The finder of a recipe for the images of a camera with a pose."""
    recipe = get_recipe(name, camera.size)
    return LaneFinder(recipe, lens_of(camera), image_to_road(camera))


def lane_result(
    left: RoadLine | None, right: RoadLine | None, state: str = "found"
) -> LaneResult:
    """The result of a frame in which these lines were measured or remembered."""
    line = FoundLine(None, np.empty((0, 2)), "combined", np.empty((0, 4)))
    return LaneResult(
        left=None,
        right=None,
        left_road=left,
        right_road=right,
        state=state,
        undistorted=np.dstack([NOTHING, NOTHING, NOTHING]),
        masks={},
        warped_binary=NOTHING,
        left_found=line,
        right_found=line,
        warp=get_recipe("hls_sobel").four_point_warp(),
    )
