"""The bird's-eye view from four points: exact for points and images, its scale in metres; the points from the pose."""

import numpy as np
import pytest

from course.plots import road_axes
from helpers import (
    RECIPES,
    FourPointWarp,
    birdseye_to_road,
    get_recipe,
    metres_per_pixel,
    recipe_from_pose,
    scale_to_road,
)
from lanes.camera.model import Camera, CameraPose
from lanes.errors import CameraError, PictureError
from tests.support.painted_roads import RECIPE_CAMERA as CAMERA

SIZE = (1280, 720)
TRAPEZIUM = [(580, 460), (740, 460), (1100, 670), (270, 670)]
RECTANGLE = [(200, 0), (1080, 0), (1080, 720), (200, 720)]
WARP = FourPointWarp(TRAPEZIUM, RECTANGLE, SIZE)


def road_rectangle_warp():
    """The warp of a true rectangle on the road: an exact map with 8 m on 800 columns and 24 m on 719 rows."""
    corners = np.array([[30.0, 4.0], [30.0, -4.0], [6.0, -4.0], [6.0, 4.0]])
    picture = CAMERA.undistort_points(CAMERA.road_to_pixels(corners))
    return FourPointWarp(picture, [(239.5, 0), (1039.5, 0), (1039.5, 719), (239.5, 719)], SIZE)


def test_source_points_come_to_lie_on_destination_points_and_all_points_return_where_they_were():
    np.testing.assert_allclose(WARP.points_to_birdseye(TRAPEZIUM), RECTANGLE, atol=1e-3)
    assert WARP.points_to_birdseye(np.empty((0, 2))).shape == (0, 2)
    points = np.random.default_rng(1).uniform(0, [1279, 719], (200, 2))
    np.testing.assert_allclose(WARP.points_to_birdseye(WARP.points_to_image(points)), points, atol=1e-5)


def test_images_and_binaries_move_as_points_do():
    binary = np.zeros((720, 1280), np.uint8)
    u, v = 500, 560
    binary[v - 1 : v + 2, u - 1 : u + 2] = 255
    for view in (WARP.image_to_birdseye(binary), WARP.image_to_birdseye(np.dstack([binary] * 3))[..., 0]):
        rows, columns = np.nonzero(view > 200)
        np.testing.assert_allclose([columns.mean(), rows.mean()], WARP.points_to_birdseye([(u, v)])[0], atol=0.6)
    assert set(np.unique(WARP.image_to_birdseye(binary))) == {0, 255}


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        (np.zeros((720, 1281), np.uint8), "is 1281x720 pixels, but this warp is for 1280x720"),
        (np.zeros((720, 1280, 4), np.uint8), "expected an RGB image"),
        (None, "got NoneType"),
    ],
    ids=["size", "rgba", "none"],
)
def test_only_pictures_and_binaries_of_the_warps_size_are_taken(wrong, sentence):
    with pytest.raises(PictureError, match=sentence):
        WARP.image_to_birdseye(wrong)


@pytest.mark.parametrize(
    "points",
    [TRAPEZIUM[:3], [(0, 0), (1, 1), (2, 2), (0, 5)], [(0, 0), (9, 9), (9, 0), (0, 9)], [(0, np.nan)] * 4],
    ids=["three", "in a line", "bow tie", "nan"],
)
def test_points_that_are_no_quadrangle_are_refused(points):
    with pytest.raises(ValueError, match="source_px: expected four points"):
        FourPointWarp(points, RECTANGLE, SIZE)


def test_view_points_lie_on_the_road_where_the_camera_put_them():
    road = np.array([[7.0, 1.5], [12.0, -2.0], [25.0, 0.3]])
    view = WARP.points_to_birdseye(CAMERA.undistort_points(CAMERA.road_to_pixels(road)))
    np.testing.assert_allclose(birdseye_to_road(view, WARP, CAMERA), road, atol=1e-3)
    with pytest.raises(CameraError, match="quadrangle of the warp reaches the horizon .*; choose lower points"):
        metres_per_pixel(WARP, CAMERA.with_pose(CameraPose(1.2, pitch_rad=-0.1)))


def test_fixed_scales_agree_with_the_road_on_a_true_map():
    warp, points = road_rectangle_warp(), np.array([[300.0, 100.0], [900.0, 650.0]])
    scales = metres_per_pixel(warp, CAMERA)
    assert scales == pytest.approx((8 / 800, 24 / 719), rel=1e-4)
    exact, scaled = birdseye_to_road(points, warp, CAMERA), scale_to_road(points, scales, SIZE)
    # The bottom row is 6 m ahead, and the centre of the columns is the x axis of the road.
    np.testing.assert_allclose(scaled + [6.0, 0], exact, atol=2e-3)
    axes = road_axes(warp, CAMERA)
    np.testing.assert_allclose(axes.x_m, 30 - np.arange(720) * 24 / 719, atol=1e-3)
    np.testing.assert_allclose(axes.y_m, (639.5 - np.arange(1280)) / 100, atol=1e-3)


every_recipe = pytest.mark.parametrize("name", RECIPES)
# A phone that looks up, aside and leans; its published top rows are above the horizon.
PHONE = Camera.from_fov((640, 480), 70.0, CameraPose(1.5, np.radians(-12), np.radians(3), np.radians(-2)))


@every_recipe
@pytest.mark.parametrize("camera", [CAMERA, PHONE], ids=["course", "phone"])
def test_source_points_are_a_rectangle_on_the_road_between_the_published_rows(name, camera):
    published = get_recipe(name, camera.size)
    recipe = recipe_from_pose(published, camera)
    assert (recipe.name, recipe.destination_px) == (f"{name}_pose", published.destination_px)
    x, y = birdseye_to_road(recipe.destination_px, recipe.four_point_warp(), camera).T
    assert sorted(x) == pytest.approx([x.min()] * 2 + [x.max()] * 2, rel=1e-3)
    assert np.abs(y) == pytest.approx([y.max()] * 4, rel=1e-3)
    assert camera is CAMERA or x.max() == pytest.approx(60.0, rel=1e-3)  # the far edge is limited
    source = np.array(published.source_px)
    # The published left points stay left.
    assert ((y > 0) == (source[:, 0] < source[:, 0].mean())).all()
    if camera is CAMERA:  # the edges are where the published rows are
        centre = camera.distort_points([(639.5, source[:, 1].max()), (639.5, source[:, 1].min())])
        assert [x.min(), x.max()] == pytest.approx(camera.pixels_to_road(centre)[:, 0], rel=1e-3)
        near = camera.distort_points(source[source[:, 1] == source[:, 1].max()])
        assert np.ptp(y) == pytest.approx(np.ptp(camera.pixels_to_road(near)[:, 1]), rel=1e-3)


def test_without_pose_or_road_there_is_no_rectangle():
    recipe = get_recipe("hls_sobel")
    with pytest.raises(CameraError, match="this camera has no pose"):
        recipe_from_pose(recipe, Camera(1280, 720, CAMERA.matrix, CAMERA.distortion))
    with pytest.raises(CameraError, match="bottom row of recipe hls_sobel's points is not on the road ahead"):
        recipe_from_pose(recipe, CAMERA.with_pose(CameraPose(1.2, pitch_rad=-0.6)))
    with pytest.raises(CameraError, match="use get_recipe"):
        recipe_from_pose(get_recipe("hls_sobel", (640, 360)), CAMERA)
