"""The overlay lies on the markings, through the lens, says what is known, and draws nothing when the lane is lost."""

import numpy as np
import pytest

from helpers import (
    LaneFinder,
    annotate_image,
    describe_result,
    draw_lane_between,
    draw_pixels,
    draw_windows,
    follow_lane,
    get_recipe,
)
from lanes.camera.model import Camera
from lanes.canvas import LANE_COLOUR, LEFT_COLOUR, RIGHT_COLOUR, WINDOW_COLOUR
from lanes.errors import PictureError
from tests.support.painted_roads import LANE_WIDTH_M, LaneRoad, paint_lane
from tests.support.painted_roads import RECIPE_CAMERA as CAMERA

ROAD = LaneRoad(curvature_per_m=1 / 500, offset_m=0.28)
LEFT = np.array([[60.0, 20.0], [20.0, 80.0]])
RIGHT = np.array([[100.0, 20.0], [140.0, 80.0]])
# A lens that moves a point near the corner by more than ten pixels.
LENS = Camera(
    160, 96, np.array([[120.0, 0, 79.5], [0, 120.0, 47.5], [0, 0, 1]]), np.array([-0.25, 0.03, 0.001, -0.001, 0.0])
)


@pytest.fixture(scope="module")
def image():
    return paint_lane(ROAD)


@pytest.fixture(scope="module")
def result(image):
    return LaneFinder(get_recipe("hls_sobel"), CAMERA).find(image)


@pytest.fixture
def gray():
    """Read-only: a function that writes on its input raises, one that copies does not."""
    image = np.full((96, 160, 3), 100, np.uint8)
    image.flags.writeable = False
    return image


def test_the_filled_lane_ends_at_the_paint_of_the_raw_image(image, result):
    green = (annotate_image(image, result, CAMERA).astype(int) - image)[..., 1] > 10
    x_m = np.array([6.0, 10.0, 15.0])
    left_m, right_m = (ROAD.lateral_m(side * LANE_WIDTH_M / 2, x_m) for side in (1, -1))
    left, right = (CAMERA.road_to_pixels(np.column_stack([x_m, y_m])) for y_m in (left_m, right_m))
    for x, (u_left, v), (u_right, _) in zip(x_m, left, right, strict=True):
        columns, half_paint_px = np.flatnonzero(green[round(v)]), 0.1 / x * 1150
        assert columns[[0, -1]] == pytest.approx([u_left, u_right], abs=half_paint_px + 3)


def test_the_words_are_those_of_the_result_and_nothing_is_drawn_of_a_lost_lane(result):
    bend, offset = describe_result(result)
    assert bend.startswith("bends left") and offset == f"{result.offset_m:.2f} m left of centre"
    black = np.zeros((720, 1280, 3), np.uint8)
    lost = LaneFinder(get_recipe("hls_sobel"), CAMERA).find(black)
    assert describe_result(lost) == ["lane lost"]
    annotated = annotate_image(black, lost, CAMERA)
    assert annotated[:200].any() and not annotated[200:].any()


def test_following_gives_each_frame_its_image_and_numbers(image):
    process = follow_lane(LaneFinder(get_recipe("hls_sobel"), CAMERA), CAMERA)
    process(image)
    annotated, row = process(np.zeros_like(image))
    assert row["state"] == "kept" and annotated[300:].any()


@pytest.mark.parametrize(
    "draw",
    [
        lambda picture: draw_lane_between(picture, LEFT, RIGHT),
        lambda picture: draw_windows(picture, [[10, 10, 30, 30]]),
        lambda picture: draw_pixels(picture, [[3, 4]], colour=LEFT_COLOUR),
    ],
    ids=["lane", "windows", "pixels"],
)
def test_every_function_draws_on_a_copy_and_refuses_floats(draw, gray):
    for image in (gray, gray.copy()):
        drawn = draw(image)
        assert (image == 100).all() and not np.shares_memory(drawn, image)
        assert (drawn.shape, drawn.dtype) == (image.shape, np.uint8)
        assert drawn.flags.writeable and (drawn != image).any()
    with pytest.raises(PictureError, match="float64"):
        draw(gray / 255)


def test_the_lines_go_through_the_lens_of_pictures_of_this_size():
    """A line that is straight after undistortion is drawn on the curved marking of the raw image."""
    many = np.linspace([5.0, 8.0], [30.0, 92.0], 200)
    paint = LENS.distort_points(many)
    drawn = draw_lane_between(np.zeros((96, 160, 3), np.uint8), many[[0, -1]], None, LENS, line_width_px=3)
    rows, columns = np.nonzero(drawn[..., 0] > 120)
    inside = paint[(paint[:, 1] > rows.min()) & (paint[:, 1] < rows.max())]
    for u, v in inside[::20]:
        assert columns[rows == round(v)].mean() == pytest.approx(u, abs=1.0)
    with pytest.raises(PictureError, match="150x96 pixels, but the camera was calibrated for 160x96"):
        draw_lane_between(np.zeros((96, 150, 3), np.uint8), LEFT, RIGHT, LENS)


def test_left_is_red_and_right_is_blue_and_the_area_between_is_filled(gray):
    drawn = draw_lane_between(gray, LEFT, RIGHT, line_width_px=4)
    np.testing.assert_array_equal(drawn[50, 40], LEFT_COLOUR)
    np.testing.assert_array_equal(drawn[50, 120], RIGHT_COLOUR)
    gap = np.insert(LEFT, 1, [np.nan, 50], axis=0)
    filled = draw_lane_between(gray, gap, RIGHT, line_width_px=0)
    np.testing.assert_array_equal(filled, draw_lane_between(gray, LEFT, RIGHT, line_width_px=0))
    np.testing.assert_allclose(filled[50, 80], 70 + 0.3 * np.array(LANE_COLOUR), atol=1)
    drawn = draw_lane_between(gray, None, RIGHT, line_width_px=4)
    np.testing.assert_array_equal(drawn[50, 120], RIGHT_COLOUR)
    np.testing.assert_array_equal(drawn[:, :90], gray[:, :90])
    for nothing in (None, np.empty((0, 2)), np.full((5, 2), np.nan), LEFT[:1]):
        np.testing.assert_array_equal(draw_lane_between(gray, nothing, None), gray)


def test_windows_pixels_and_fits_are_where_they_are_told(gray):
    windows = draw_windows(np.zeros((96, 160), np.uint8), [[20, 30, 60, 50]])
    # One pixel wide and smooth, so the colour is not quite full.
    np.testing.assert_allclose(windows[30, 40], WINDOW_COLOUR, atol=30)
    np.testing.assert_allclose(windows[40, 20], WINDOW_COLOUR, atol=30)
    assert not windows[40, 40].any()
    np.testing.assert_array_equal(draw_windows(gray, np.empty((0, 4))), gray)
    pixels = draw_pixels(gray, [[5, 7], [-1, 3], [160, 3], [3, 96]], colour=LEFT_COLOUR)
    assert [tuple(p) for p in np.argwhere((pixels != gray).any(axis=2))] == [(7, 5)]  # pixels outside are left out
