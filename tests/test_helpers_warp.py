"""The view from four points, and the road: exact for points and images; its scales."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pytest import approx

from helpers import (
    RECIPES,
    FourPointWarp,
    birdseye_to_road,
    get_recipe,
    metres_per_pixel,
    pixels_to_road,
    recipe_from_pose,
    road_homography,
    road_to_pixels,
    scale_to_road,
    undistort_points,
)
from lanes.camera.model import Camera, CameraPose
from tests.support.classic_lane import image_to_road, lens_of
from tests.support.painted_roads import RECIPE_CAMERA as CAMERA

parametrize = pytest.mark.parametrize

SIZE = (1280, 720)
TRAPEZIUM = [
    (580, 460),
    (740, 460),
    (1100, 670),
    (270, 670),
]
RECTANGLE = [
    (200, 0),
    (1080, 0),
    (1080, 720),
    (200, 720),
]
WARP = FourPointWarp(TRAPEZIUM, RECTANGLE, SIZE)
LENS = lens_of(CAMERA)
TO_ROAD = image_to_road(CAMERA)
# metres
ON_ROAD = np.array(
    [
        [7.0, 1.5],
        [12.0, -2.0],
        [25.0, 0.3],
    ]
)
every_recipe = parametrize("name", RECIPES)
# A phone that looks up, aside and leans: the published top rows are above its horizon.
POSE = CameraPose(1.5, np.radians(-12), np.radians(3), np.radians(-2))
PHONE = Camera.from_fov((640, 480), 70.0, POSE)


def test_source_points_come_to_lie_on_destination_points():
    seen = WARP.points_to_birdseye(TRAPEZIUM)
    assert_allclose(seen, RECTANGLE, atol=1e-3)
    assert WARP.points_to_birdseye(np.empty((0, 2))).shape == (0, 2)


def test_points_return_where_they_were():
    random = np.random.default_rng(1)
    points = random.uniform([0, 0], [1279, 719], (200, 2))
    there_and_back = WARP.points_to_birdseye(WARP.points_to_image(points))
    assert_allclose(there_and_back, points, atol=1e-5)


@parametrize("kind", ["binary", "image"])
def test_images_and_binaries_move_as_points_do(kind):
    binary = np.zeros((720, 1280), np.uint8)
    binary[559:562, 499:502] = 255
    if kind == "binary":
        view = WARP.image_to_birdseye(binary)
        assert set(np.unique(view)) == {0, 255}
    else:
        view = WARP.image_to_birdseye(np.dstack([binary] * 3))[..., 0]
    rows, columns = np.nonzero(view > 200)
    expected = WARP.points_to_birdseye([(500, 560)])[0]
    assert_allclose([columns.mean(), rows.mean()], expected, atol=0.6)


@parametrize(
    ("wrong", "sentence"),
    [
        (np.zeros((720, 1281), np.uint8), "is 1281x720 pixels, .* is for 1280x720"),
        (np.zeros((720, 1280, 4), np.uint8), "expected an RGB image"),
        (None, "got NoneType"),
    ],
    ids=["size", "rgba", "none"],
)
def test_only_images_and_binaries_of_the_warps_size_are_taken(wrong, sentence):
    with pytest.raises(ValueError, match=sentence):
        WARP.image_to_birdseye(wrong)


@parametrize(
    "points",
    [
        TRAPEZIUM[:3],
        [
            (0, 0),
            (1, 1),
            (2, 2),
            (0, 5),
        ],
        [
            (0, 0),
            (9, 9),
            (9, 0),
            (0, 9),
        ],
        [(0, np.nan)] * 4,
    ],
    ids=["three", "in a line", "bow tie", "nan"],
)
def test_points_that_are_no_quadrangle_are_refused(points):
    with pytest.raises(ValueError, match="source_px: expected four points"):
        FourPointWarp(points, RECTANGLE, SIZE)


@parametrize("camera", [CAMERA, PHONE], ids=["course", "phone"])
def test_pixels_and_road_are_those_of_the_camera_model(camera):
    """Against lanes.Camera, which projects with rotations and not with a homography."""
    pixels = undistort_points(camera.road_to_pixels(ON_ROAD), lens_of(camera))
    homography = image_to_road(camera)
    assert_allclose(road_to_pixels(ON_ROAD, homography), pixels, atol=1e-6)
    assert_allclose(pixels_to_road(pixels, homography), ON_ROAD, atol=1e-6)


def test_the_sky_is_no_road_and_the_road_behind_is_not_seen():
    below, sky = (640, 600), (640, 200)
    road = pixels_to_road([below, sky], TO_ROAD)
    assert np.isfinite(road[0]).all()
    assert np.isnan(road[1]).all()
    seen = road_to_pixels([(10, 0), (-10, 0)], TO_ROAD)
    assert np.isfinite(seen[0]).all()
    assert np.isnan(seen[1]).all()
    third = TO_ROAD[2]
    assert third @ [640, 600, 1] > 0
    assert third @ [640, 200, 1] < 0


@parametrize("height_m", [0.0, -1.2, np.nan])
def test_a_camera_on_or_below_the_road_is_refused(height_m):
    with pytest.raises(ValueError, match="a positive height above the road"):
        road_homography(LENS, height_m=height_m, pitch_rad=0.0)


def test_view_points_lie_on_the_road_where_the_camera_put_them():
    view = WARP.points_to_birdseye(road_to_pixels(ON_ROAD, TO_ROAD))
    assert_allclose(birdseye_to_road(view, WARP, TO_ROAD), ON_ROAD, atol=1e-3)


def test_a_view_that_reaches_the_horizon_has_no_scale():
    looking_up = road_homography(LENS, height_m=1.2, pitch_rad=-0.1)
    with pytest.raises(ValueError, match="reaches the horizon .*; choose lower points"):
        metres_per_pixel(WARP, looking_up)


def test_fixed_scales_agree_with_the_road_on_a_map():
    """A view of a rectangle on the road: 8 m are 800 columns, 24 m are 719 rows."""
    corners_m = [
        (30.0, 4.0),
        (30.0, -4.0),
        (6.0, -4.0),
        (6.0, 4.0),
    ]
    view_px = [
        (239.5, 0),
        (1039.5, 0),
        (1039.5, 719),
        (239.5, 719),
    ]
    warp = FourPointWarp(road_to_pixels(corners_m, TO_ROAD), view_px, SIZE)
    scales = metres_per_pixel(warp, TO_ROAD)
    assert scales == approx((8 / 800, 24 / 719), rel=1e-4)

    points = np.array([[300.0, 100.0], [900.0, 650.0]])
    exact = birdseye_to_road(points, warp, TO_ROAD)
    scaled = scale_to_road(points, scales, SIZE)
    # the bottom row is 6 m ahead, and the centre column is the x axis of the road
    assert_allclose(scaled + [6.0, 0], exact, atol=2e-3)


@every_recipe
@parametrize("camera", [CAMERA, PHONE], ids=["course", "phone"])
def test_points_from_the_pose_are_a_rectangle_on_the_road(name, camera):
    published = get_recipe(name, camera.size)
    homography = image_to_road(camera)
    recipe = recipe_from_pose(published, homography)
    assert recipe.name == f"{name}_pose"
    assert recipe.destination_px == published.destination_px

    x, y = pixels_to_road(recipe.source_px, homography).T
    near_1, near_2, far_1, far_2 = sorted(x)
    assert (near_1, far_1) == approx((near_2, far_2), rel=1e-3)
    assert np.abs(y) == approx([y.max()] * 4, rel=1e-3)
    # the published left points stay left
    source_u = np.array(published.source_px)[:, 0]
    assert ((y > 0) == (source_u < source_u.mean())).all()
    # the far edge of the phone is limited
    assert camera is CAMERA or x.max() == approx(60.0, rel=1e-3)


@every_recipe
def test_the_edges_of_the_rectangle_are_where_the_published_rows_are(name):
    published = get_recipe(name)
    source = np.array(published.source_px)
    near_row, far_row = source[:, 1].max(), source[:, 1].min()
    centre_px = [(639.5, near_row), (639.5, far_row)]
    near_m, far_m = pixels_to_road(centre_px, TO_ROAD)[:, 0]

    recipe = recipe_from_pose(published, TO_ROAD)
    x, y = pixels_to_road(recipe.source_px, TO_ROAD).T
    assert [x.min(), x.max()] == approx([near_m, far_m], rel=1e-3)
    near_corners_m = pixels_to_road(source[source[:, 1] == near_row], TO_ROAD)
    assert np.ptp(y) == approx(np.ptp(near_corners_m[:, 1]), rel=1e-3)


def test_without_road_there_is_no_rectangle():
    recipe = get_recipe("hls_sobel")
    at_the_sky = road_homography(LENS, height_m=1.2, pitch_rad=-0.6)
    sentence = "bottom row of recipe hls_sobel's points is not on the road ahead"
    with pytest.raises(ValueError, match=sentence):
        recipe_from_pose(recipe, at_the_sky)
