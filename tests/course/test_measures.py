"""Lateral errors, precision and recall on lanes and points made by hand."""

from __future__ import annotations

import numpy as np
import pytest

from course.measures import (
    check,
    check_error,
    describe_error,
    marking_precision,
    marking_recall,
    worst_lateral_error_m,
)
from helpers import RoadLine
from tests.support.classic_lane import lane_result

X = np.arange(0.0, 45, 5)


def truth() -> dict:
    left, right = RoadLine(1.6, 0.02, 0.001), RoadLine(-2.0, 0.02, 0.001)
    return {"x_m": X.tolist(), "left_y_m": left.lateral_m(X).tolist(), "right_y_m": right.lateral_m(X).tolist()}


def test_the_worst_lateral_error_in_words_and_metres_is_that_of_both_lines_within_the_range():
    # the right line departs to the right by 0.01 m per metre: 0.3 m at 30 m; points farther ahead do not count
    found = lane_result(RoadLine(1.65, 0.02, 0.001), RoadLine(-2.0, 0.01, 0.001))
    assert worst_lateral_error_m(found, truth()) == pytest.approx(0.3)
    assert worst_lateral_error_m(found, None) is None
    for lost in (None, lane_result(None, None, "lost")):
        assert worst_lateral_error_m(lost, truth()) == worst_lateral_error_m(lost, None) == np.inf
    assert [describe_error(e) for e in (None, np.inf, 0.123)] == ["unknown", "lost", "0.12 m"]


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
