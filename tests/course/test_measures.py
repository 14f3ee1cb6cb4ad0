"""Lateral errors, precision and recall on lanes and points made by hand."""

from __future__ import annotations

import numpy as np
import pytest

from course.measures import (
    check,
    check_error,
    describe_error,
    lane_widths_px,
    marking_precision,
    marking_recall,
)
from helpers import (
    FourPointWarp,
    Lens,
    RoadLine,
    road_homography,
    road_to_pixels,
)

X = np.arange(0.0, 45, 5)


def truth() -> dict:
    left, right = RoadLine(1.6, 0.02, 0.001), RoadLine(-2.0, 0.02, 0.001)
    return {"x_m": X.tolist(), "left_y_m": left.lateral_m(X).tolist(), "right_y_m": right.lateral_m(X).tolist()}


def test_an_error_in_words_is_unknown_lost_or_in_metres():
    assert describe_error(None) == "unknown"
    assert describe_error(np.inf) == "lost"
    assert describe_error(0.123) == "0.12 m"


def test_a_straight_lane_has_its_width_in_columns_at_every_distance_of_a_map():
    # a camera that looks straight ahead, 1.2 m above the road
    matrix = np.array([[1000, 0, 640], [0, 1000, 360], [0, 0, 1]])
    lens = Lens(matrix, np.zeros(5), (1280, 720))
    image_to_road = road_homography(lens, height_m=1.2, pitch_rad=0.0)
    rectangle_m = [(40, 2), (40, -2), (5, -2), (5, 2)]
    source_px = road_to_pixels(rectangle_m, image_to_road)
    destination_px = [(240, 0), (1040, 0), (1040, 720), (240, 720)]
    warp = FourPointWarp(source_px, destination_px, lens.size)

    lines_m = [(1.5, 0.01), (-2.0, 0.01)]
    widths_px = lane_widths_px(warp, image_to_road, lines_m, [6, 20, 39])

    # 800 columns are 4 m
    assert widths_px == pytest.approx([700, 700, 700], abs=0.01)


def road_points(shift_m: float) -> np.ndarray:
    """Points along two stripes 0.3 m wide, `shift_m` metres left of the true lines."""
    x, across = (grid.ravel() for grid in np.meshgrid(np.arange(3.0, 40, 0.1), np.linspace(-0.15, 0.15, 7)))
    lines = [np.interp(x, X, truth()[key]) + shift_m + across for key in ("left_y_m", "right_y_m")]
    return np.vstack([np.column_stack([x, y]) for y in lines])


def test_points_on_the_lines_have_precision_1_and_those_beside_them_0():
    """Other lanes and the far road do not count."""
    elsewhere = np.array([[20.0, 8.0], [20.0, -8.0], [3.0, 0.0], [35.0, 0.0]])
    assert marking_precision(np.vstack([road_points(0.0), elsewhere]), truth()) == 1
    assert marking_precision(road_points(0.6), truth()) == 0
    assert marking_precision(road_points(0.0), None) is marking_precision(elsewhere, truth()) is None


def test_the_recall_of_a_dash_is_its_length_of_one_line():
    x = np.arange(10.0, 20.0, 0.1)
    dash = np.column_stack([x, np.interp(x, X, truth()["right_y_m"]) + 0.1])
    # 10 of the 25 m of one of two lines
    assert marking_recall(dash, truth()) == pytest.approx(0.2, abs=0.01)
    assert marking_recall(dash + [0, 0.3], truth()) == marking_recall(np.empty((0, 2)), truth()) == 0
    assert marking_recall(np.empty((0, 2)), None) is None


def test_checks_name_value_truth_and_limit_and_fail_beyond_it():
    assert check("h", 1.32, 1.3, "m", within=0.05) == "h: 1.32 m, truth 1.30 m, off by 0.02 m (allowed 0.05 m)"
    assert check("height", 1.32, None, "m", within=0.05) == "height: 1.32 m (no truth known for these pictures)"
    assert check_error("paint", 0.14, "px", within=1) == "paint: error 0.1 px (allowed 1 px)"
    assert "not known" in check_error("paint", None, "px", within=1)
    for fails in (lambda: check("h", 1.4, 1.3, "m", within=0.05), lambda: check_error("p", 1.2, "px", within=1)):
        with pytest.raises(AssertionError, match="allowed"):
            fails()
    with pytest.raises(AssertionError):
        check_error("paint", float("nan"), "px", within=1)
