"""The drawing lies on the markings, through the lens, and says what is known."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pytest import approx

from helpers import (
    LANE_COLOUR,
    LEFT_COLOUR,
    RANSAC_COLOUR,
    RIGHT_COLOUR,
    WINDOW_COLOUR,
    Lens,
    annotate_image,
    describe_bend,
    describe_offset,
    describe_result,
    distort_points,
    draw_lane,
    draw_lines,
    draw_pixels,
    draw_windows,
    follow_lane,
)
from tests.support.classic_lane import lens_of, start_finder
from tests.support.painted_roads import LANE_WIDTH_M, LaneRoad, paint_lane
from tests.support.painted_roads import RECIPE_CAMERA as CAMERA

parametrize = pytest.mark.parametrize

ROAD = LaneRoad(curvature_per_m=1 / 500, offset_m=0.28)
LEFT = np.array([[60.0, 20.0], [20.0, 80.0]])
RIGHT = np.array([[100.0, 20.0], [140.0, 80.0]])
# a lens that moves a point near the corner by more than ten pixels
MATRIX = np.array(
    [
        [120.0, 0, 79.5],
        [0, 120.0, 47.5],
        [0, 0, 1],
    ]
)
DISTORTION = np.array([-0.25, 0.03, 0.001, -0.001, 0.0])
LENS = Lens(MATRIX, DISTORTION, (160, 96))


@pytest.fixture(scope="module")
def image():
    return paint_lane(ROAD)


@pytest.fixture(scope="module")
def result(image):
    return start_finder("hls_sobel", CAMERA).find(image)


@pytest.fixture
def gray():
    """Read-only: a function that writes on its input raises."""
    image = np.full((96, 160, 3), 100, np.uint8)
    image.flags.writeable = False
    return image


def true_pixels(side, x_m):
    """Raw pixels (N, 2) of the centre of a line; side 1 is left, -1 right."""
    y_m = ROAD.lateral_m(side * LANE_WIDTH_M / 2, x_m)
    return CAMERA.road_to_pixels(np.column_stack([x_m, y_m]))


@parametrize(
    ("side", "colour"), [(1, LEFT_COLOUR), (-1, RIGHT_COLOUR)], ids=["left", "right"]
)
def test_the_lines_are_drawn_on_the_paint_of_the_raw_image(image, result, side, colour):
    drawn = annotate_image(image, result, lens_of(CAMERA)).astype(int)
    is_line = np.abs(drawn - colour).max(axis=2) < 40
    x_m = np.array([7.0, 10.0, 15.0])
    half_paint_px = 0.07 / x_m * 1150
    for (u, v), half_px in zip(true_pixels(side, x_m), half_paint_px, strict=True):
        columns = np.flatnonzero(is_line[round(v)])
        assert columns.mean() == approx(u, abs=half_px)


def test_the_lane_is_green_from_paint_to_paint(image, result):
    green = annotate_image(image, result, lens_of(CAMERA)).astype(int) - image
    x_m = np.array([6.0, 10.0, 15.0])
    half_paint_px = 0.1 / x_m * 1150
    rows = zip(true_pixels(1, x_m), true_pixels(-1, x_m), half_paint_px, strict=True)
    for (left, v), (right, _), half_px in rows:
        columns = np.flatnonzero(green[round(v), :, 1] > 10)
        assert columns[[0, -1]] == approx([left, right], abs=half_px + 3)


def test_the_lane_is_green_between_the_lines(image, result):
    green = annotate_image(image, result, lens_of(CAMERA)).astype(int) - image
    ahead_m = np.array([10.0])
    left = true_pixels(1, ahead_m)
    right = true_pixels(-1, ahead_m)
    u, v = np.mean([left[0], right[0]], axis=0).round().astype(int)
    assert green[v, u, 1] > 10 > green[v, 100, 1]


def test_the_words_are_those_of_the_result(result):
    bend, offset = describe_result(result)
    assert bend.startswith("bends left")
    assert offset == f"{result.offset_m:.2f} m left of centre"


@parametrize(
    ("curvature_per_m", "words"),
    [
        (1 / 640, "bends left, R 640 m"),
        (-1 / 644, "bends right, R 640 m"),
        (-1 / 44, "bends right, R 44 m"),
        (1 / 5000, "straight (R > 3 km)"),
        (0.0, "straight (R > 3 km)"),
        (None, "bend unknown"),
    ],
)
def test_a_bend_in_words(curvature_per_m, words):
    assert describe_bend(curvature_per_m) == words


@parametrize(
    ("offset_m", "words"),
    [
        (0.123, "0.12 m left of centre"),
        (-0.123, "0.12 m right of centre"),
        (0.004, "in the centre"),
        (None, "offset unknown"),
    ],
)
def test_an_offset_in_words(offset_m, words):
    assert describe_offset(offset_m) == words


def test_nothing_is_drawn_of_a_lost_lane():
    black = np.zeros((720, 1280, 3), np.uint8)
    lost = start_finder("hls_sobel", CAMERA).find(black)
    assert describe_result(lost) == ["lane lost"]
    annotated = annotate_image(black, lost, lens_of(CAMERA))
    assert annotated[:200].any()
    assert not annotated[200:].any()


def test_following_gives_each_frame_its_image_and_numbers(image):
    process = follow_lane(start_finder("hls_sobel", CAMERA))
    process(image)
    annotated, row = process(np.zeros_like(image))
    assert row["state"] == "kept"
    assert annotated[300:].any()


def draw_the_lane(image):
    return draw_lane(image, LEFT, RIGHT)


def draw_a_window(image):
    return draw_windows(image, [[10, 10, 30, 30]])


def draw_a_pixel(image):
    return draw_pixels(image, [[3, 4]], colour=LEFT_COLOUR)


def draw_a_line(image):
    return draw_lines(image, [(0, 0, 50)])


every_drawing = parametrize(
    "draw", [draw_the_lane, draw_a_window, draw_a_pixel, draw_a_line]
)


@every_drawing
def test_every_function_draws_on_a_copy(draw, gray):
    for image in (gray, gray.copy()):
        drawn = draw(image)
        assert (image == 100).all()
        assert not np.shares_memory(drawn, image)
        assert (drawn.shape, drawn.dtype) == (image.shape, np.uint8)
        assert drawn.flags.writeable
        assert (drawn != image).any()


@every_drawing
def test_every_function_refuses_floats(draw, gray):
    with pytest.raises(ValueError, match="float64"):
        draw(gray / 255)


def test_the_lines_go_through_the_lens():
    """A line that is straight after undistortion is drawn on its bent marking."""
    many = np.linspace([5.0, 8.0], [30.0, 92.0], 200)
    paint = distort_points(many, LENS)
    black = np.zeros((96, 160, 3), np.uint8)
    drawn = draw_lane(black, many[[0, -1]], None, LENS, line_width_px=3)
    rows, columns = np.nonzero(drawn[..., 0] > 120)
    v = paint[:, 1]
    inside = (v > rows.min()) & (v < rows.max())
    for u, v in paint[inside][::20]:
        on_row = columns[rows == round(v)]
        assert on_row.mean() == approx(u, abs=1.0)


def test_an_image_of_another_size_than_the_lens_is_refused():
    narrow = np.zeros((96, 150, 3), np.uint8)
    with pytest.raises(ValueError, match="150x96 pixels, but this lens is for 160x96"):
        draw_lane(narrow, LEFT, RIGHT, LENS)


def test_the_area_between_the_lines_is_filled_and_gaps_are_bridged(gray):
    gap = np.insert(LEFT, 1, [np.nan, 50], axis=0)
    filled = draw_lane(gray, gap, RIGHT, line_width_px=0)
    whole = draw_lane(gray, LEFT, RIGHT, line_width_px=0)
    assert_array_equal(filled, whole)
    green = 70 + 0.3 * np.array(LANE_COLOUR)
    assert_allclose(filled[50, 80], green, atol=1)


def test_the_left_line_is_red_and_the_right_one_blue(gray):
    drawn = draw_lane(gray, LEFT, RIGHT, line_width_px=4)
    assert_array_equal(drawn[50, 40], LEFT_COLOUR)
    assert_array_equal(drawn[50, 120], RIGHT_COLOUR)


def test_one_line_is_drawn_without_a_lane(gray):
    drawn = draw_lane(gray, None, RIGHT, line_width_px=4)
    assert_array_equal(drawn[50, 120], RIGHT_COLOUR)
    assert_array_equal(drawn[:, :90], gray[:, :90])


@parametrize(
    "nothing",
    [
        None,
        np.empty((0, 2)),
        np.full((5, 2), np.nan),
        LEFT[:1],
    ],
    ids=["none", "empty", "nan", "one point"],
)
def test_without_lines_nothing_is_drawn(nothing, gray):
    assert_array_equal(draw_lane(gray, nothing, None), gray)


def test_windows_are_where_they_are_told(gray):
    black = np.zeros((96, 160), np.uint8)
    windows = draw_windows(black, [[20, 30, 60, 50]])
    # one pixel wide and smooth, so the colour is not quite full
    assert_allclose(windows[30, 40], WINDOW_COLOUR, atol=30)
    assert_allclose(windows[40, 20], WINDOW_COLOUR, atol=30)
    assert not windows[40, 40].any()
    assert_array_equal(draw_windows(gray, np.empty((0, 4))), gray)


def test_pixels_outside_are_left_out(gray):
    told = [
        [5, 7],
        [-1, 3],
        [160, 3],
        [3, 96],
    ]
    drawn = draw_pixels(gray, told, colour=LEFT_COLOUR)
    changed = np.argwhere((drawn != gray).any(axis=2))
    assert changed.tolist() == [[7, 5]]


def test_lines_of_the_view_are_drawn_where_they_are_and_none_is_left_out():
    """Recipe C's drawing of its RANSAC lines."""
    view = np.zeros((96, 160), np.uint8)
    drawn = draw_lines(view, [(0.0, 0.5, 20.0), None], width_px=3)
    assert_array_equal(drawn[40, 40], RANSAC_COLOUR)
    assert not drawn[40, 60:].any()
