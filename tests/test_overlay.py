"""The overlay lies on the paint, says what is known, and invents nothing when the lane is lost."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from lanes.measure import RoadLine
from lanes.recipes import LaneFinder, get_recipe

from lanes.camera import Camera, Mount
from lanes.overlay import annotate, describe_result, diagnose, draw_search, follow_lane, line_points, telemetry_row

MATRIX = np.array([[1150.0, 0, 660], [0, 1150, 380], [0, 0, 1]])
CAMERA = Camera(1280, 720, MATRIX, np.array([-0.24, -0.02, 0, 0, -0.01]), Mount(1.3, pitch_rad=-0.03, yaw_rad=0.01))
LEFT, RIGHT = RoadLine(1.55, 0.0, 0.0015), RoadLine(-2.1, 0.0, 0.0015)


def road_picture() -> np.ndarray:
    """Dark road with two painted lines of 0.2 m that bend left, the car 0.28 m left of the middle, seen through the lens."""
    image = np.full((720, 1280, 3), (70, 70, 75), np.uint8)
    x = np.linspace(4, 60, 400)
    for line, colour in ((LEFT, (230, 190, 40)), (RIGHT, (240, 240, 240))):
        edges = [np.column_stack([x, line.lateral_m(x) + side]) for side in (0.1, -0.1)]
        outline = CAMERA.road_to_pixels(np.vstack([edges[0], edges[1][::-1]]))
        cv2.fillPoly(image, [np.round(outline * 16).astype(np.int32)], colour, cv2.LINE_AA, 4)
    return image


@pytest.fixture(scope="module")
def picture():
    return road_picture()


@pytest.fixture(scope="module")
def result(picture):
    return LaneFinder(get_recipe("hls_sobel"), CAMERA).find(picture)


def test_the_filled_lane_ends_at_the_paint_of_the_raw_picture(picture, result):
    assert result.found
    green = (annotate(picture, result, CAMERA).astype(int) - picture)[..., 1] > 10
    for x in (6.0, 10.0, 15.0):
        u_left, u_right = (CAMERA.road_to_pixels(np.array([[x, line.lateral_m(x)]]))[0] for line in (LEFT, RIGHT))
        row = round(float(u_left[1]))
        columns = np.flatnonzero(green[row, :])
        half_paint_px = 0.1 / x * 1150
        assert columns[0] == pytest.approx(u_left[0], abs=half_paint_px + 3)
        assert columns[-1] == pytest.approx(u_right[0], abs=half_paint_px + 3)


def test_the_input_stays_as_it_is(picture, result):
    before = picture.copy()
    annotate(picture, result, CAMERA)
    diagnose(picture, result, CAMERA)
    assert np.array_equal(picture, before)


def test_words_and_telemetry_agree_with_the_result(result):
    assert describe_result(result)[0].startswith("bends left")
    assert "right of centre" not in describe_result(result)[1]
    row = telemetry_row(result)
    assert row["offset_m"] == result.offset_m == pytest.approx(0.275, abs=0.05)
    assert row["left_c0_m"] - row["right_c0_m"] == pytest.approx(3.65, abs=0.1)


def test_a_lost_lane_is_said_and_nothing_is_drawn():
    black = np.zeros((720, 1280, 3), np.uint8)
    lost = LaneFinder(get_recipe("hls_sobel"), CAMERA).find(black)
    assert describe_result(lost) == ["lane lost"]
    annotated = annotate(black, lost, CAMERA)
    assert annotated[:200].any() and not annotated[200:].any()
    assert telemetry_row(lost)["offset_m"] is None
    assert diagnose(black, lost, CAMERA).shape == black.shape
    assert line_points(None, 720) is None


def test_following_gives_each_frame_its_picture_and_numbers(picture):
    process = follow_lane(LaneFinder(get_recipe("hls_sobel"), CAMERA), CAMERA)
    process(picture)
    annotated, row = process(np.zeros_like(picture))
    assert row["state"] == "kept"
    assert annotated[300:].any()


def test_the_search_picture_shows_windows_and_lines(result):
    drawn = draw_search(result)
    assert drawn.shape == (720, 1280, 3)
    assert len(np.unique(drawn.reshape(-1, 3), axis=0)) > 4
