"""Source points of a recipe from the camera pose: a true rectangle on the road."""

import numpy as np
import pytest

from classic.recipe import MAX_FAR_EDGE_M, RECIPES, get_recipe, recipe_from_pose
from classic.warp import birdseye_to_road
from lanes.camera import Camera, CameraPose
from lanes.errors import CameraError
from tests.support.painted_roads import RECIPE_CAMERA as CAMERA

every_recipe = pytest.mark.parametrize("name", RECIPES)
# A phone that looks up, aside and leans; its published top rows are above the horizon.
PHONE = Camera.from_fov((640, 480), 70.0, CameraPose(1.5, np.radians(-12), np.radians(3), np.radians(-2)))


def corners_on_road(recipe, camera):
    return birdseye_to_road(recipe.destination_px, recipe.four_point_warp(), camera)


@every_recipe
@pytest.mark.parametrize("camera", [CAMERA, PHONE], ids=["course", "phone"])
def test_source_points_are_a_rectangle_on_the_road(name, camera):
    published = get_recipe(name, camera.size)
    recipe = recipe_from_pose(published, camera)
    assert (recipe.name, recipe.destination_px) == (f"{name}_pose", published.destination_px)
    x, y = corners_on_road(recipe, camera).T
    assert sorted(x) == pytest.approx([x.min()] * 2 + [x.max()] * 2, rel=1e-3)
    assert np.abs(y) == pytest.approx([y.max()] * 4, rel=1e-3)
    # The published left points stay left.
    left = np.array(published.source_px)[:, 0] < np.mean(published.source_px, axis=0)[0]
    assert ((y > 0) == left).all()


@every_recipe
def test_edges_are_where_the_published_rows_are(name):
    published = get_recipe(name)
    x, y = corners_on_road(recipe_from_pose(published, CAMERA), CAMERA).T
    rows = [max(v for _, v in published.source_px), min(v for _, v in published.source_px)]
    centre = CAMERA.distort_points([(639.5, row) for row in rows])
    assert [x.min(), x.max()] == pytest.approx(CAMERA.pixels_to_road(centre)[:, 0], rel=1e-3)
    near = np.array([point for point in published.source_px if point[1] == rows[0]])
    published_y = CAMERA.pixels_to_road(CAMERA.distort_points(near))[:, 1]
    assert np.ptp(y) == pytest.approx(np.ptp(published_y), rel=1e-3)


def test_the_far_edge_is_limited():
    x, _ = corners_on_road(recipe_from_pose(get_recipe("hls_sobel", PHONE.size), PHONE), PHONE).T
    assert x.max() == pytest.approx(MAX_FAR_EDGE_M, rel=1e-3)


def test_without_pose_or_road_there_is_no_rectangle():
    recipe = get_recipe("hls_sobel")
    with pytest.raises(CameraError, match="this camera has no pose"):
        recipe_from_pose(recipe, Camera(1280, 720, CAMERA.matrix, CAMERA.distortion))
    with pytest.raises(CameraError, match="bottom row of recipe hls_sobel's points is not on the road ahead"):
        recipe_from_pose(recipe, CAMERA.with_pose(CameraPose(1.2, pitch_rad=-0.6)))
    with pytest.raises(CameraError, match="use get_recipe"):
        recipe_from_pose(get_recipe("hls_sobel", (640, 360)), CAMERA)
