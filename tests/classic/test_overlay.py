"""The overlay lies on the paint, says what is known, and invents nothing when the lane is lost."""

from __future__ import annotations

import numpy as np
import pytest

from classic.finder import LaneFinder
from classic.overlay import annotate, describe_result, diagnose, draw_search, follow_lane
from classic.recipe import get_recipe
from tests.support.painted_roads import LANE_WIDTH_M, LaneRoad, paint_lane
from tests.support.painted_roads import RECIPE_CAMERA as CAMERA

ROAD = LaneRoad(curvature_per_m=1 / 500, offset_m=0.28)


@pytest.fixture(scope="module")
def picture():
    return paint_lane(ROAD)


@pytest.fixture(scope="module")
def result(picture):
    return LaneFinder(get_recipe("hls_sobel"), CAMERA).find(picture)


def test_the_filled_lane_ends_at_the_paint_of_the_raw_picture(picture, result):
    assert result.found
    green = (annotate(picture, result, CAMERA).astype(int) - picture)[..., 1] > 10
    for x in (6.0, 10.0, 15.0):
        shifts_m = (LANE_WIDTH_M / 2, -LANE_WIDTH_M / 2)
        lines_m = [np.array([[x, *ROAD.lateral_m(shift_m, np.array([x]))]]) for shift_m in shifts_m]
        u_left, u_right = (CAMERA.road_to_pixels(point)[0] for point in lines_m)
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
    row = result.as_row()
    assert row["offset_m"] == result.offset_m == pytest.approx(0.28, abs=0.03)
    assert row["left_c0_m"] - row["right_c0_m"] == pytest.approx(LANE_WIDTH_M, abs=0.05)


def test_a_lost_lane_is_said_and_nothing_is_drawn():
    black = np.zeros((720, 1280, 3), np.uint8)
    lost = LaneFinder(get_recipe("hls_sobel"), CAMERA).find(black)
    assert describe_result(lost) == ["lane lost"]
    annotated = annotate(black, lost, CAMERA)
    assert annotated[:200].any() and not annotated[200:].any()
    assert diagnose(black, lost, CAMERA).shape == black.shape


def test_following_gives_each_frame_its_picture_and_numbers(picture):
    process = follow_lane(LaneFinder(get_recipe("hls_sobel"), CAMERA), CAMERA)
    process(picture)
    annotated, row = process(np.zeros_like(picture))
    assert row["state"] == "kept"
    assert annotated[300:].any()


@pytest.mark.slow
def test_the_search_picture_shows_windows_and_lines(result):
    drawn = draw_search(result)
    assert drawn.shape == (720, 1280, 3)
    assert len(np.unique(drawn.reshape(-1, 3), axis=0)) > 4
