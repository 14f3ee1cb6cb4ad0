"""Lateral errors, precision and recall on lanes and points made by hand."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from classic.fit import RoadLine
from classic.warp import FourPointWarp
from course.measures import (
    binary_on_road,
    describe_error,
    drive_errors_m,
    lane_widths_px,
    marking_precision,
    marking_recall,
    worst_lateral_error_m,
)
from lanes.camera import Camera, CameraPose
from tests.support.classic_lane import lane_result

X = np.arange(0.0, 45, 5)
CAMERA = Camera.from_fov((640, 360), 60, CameraPose(1.4, pitch_rad=0.03))
WARP = FourPointWarp(
    [(220, 200), (420, 200), (640, 350), (0, 350)], [(0, 0), (640, 0), (640, 360), (0, 360)], (640, 360)
)


def truth() -> dict:
    left, right = RoadLine(1.6, 0.02, 0.001), RoadLine(-2.0, 0.02, 0.001)
    return {"x_m": X.tolist(), "left_y_m": left.lateral_m(X).tolist(), "right_y_m": right.lateral_m(X).tolist()}


def test_the_worst_lateral_error_in_words_and_metres_is_that_of_both_lines_within_the_range():
    # the right line departs from the truth by 0.01 m per metre: 0.3 m at 30 m; points farther ahead do not count
    found = lane_result(RoadLine(1.65, 0.02, 0.001), RoadLine(-2.0, 0.03, 0.001))
    assert worst_lateral_error_m(found, truth()) == pytest.approx(0.3)
    assert worst_lateral_error_m(found, None) is None
    for lost in (None, lane_result(None, None, "lost")):
        assert worst_lateral_error_m(lost, truth()) == worst_lateral_error_m(lost, None) == np.inf
    assert [describe_error(e) for e in (None, np.inf, 0.123)] == ["unknown", "lost", "0.12 m"]


def test_each_frame_of_a_drive_has_its_own_worst_place():
    x, zeros = (5, 10, 15, 20, 30), np.zeros(2)
    truth = {f"left_y{at:02d}_m": np.array([2.0 + 0.001 * at**2, 2.0]) for at in x}
    truth |= {f"right_y{at:02d}_m": np.array([-2.0, -2.0]) for at in x}
    rows = {f"{side}_{name}": zeros for side in ("left", "right") for name in ("c1", "c2_per_m")}
    rows |= {"left_c0_m": np.array([2.0, np.nan]), "right_c0_m": np.array([-2.1, -2.0])}
    # a line taken for straight leaves one of curvature 0.002 by 0.9 m at 30 m
    assert drive_errors_m(rows, truth).tolist() == pytest.approx([0.9, np.inf])
    rows |= {"left_c3_per_m2": np.array([6 * 0.9 / 30**3, 0.0]), "right_c3_per_m2": zeros}
    assert drive_errors_m(rows, truth)[0] < 0.5


class TestMarkingPrecision:
    def road_points(self, shift_m: float) -> np.ndarray:
        """Points along two stripes 0.3 m wide, `shift_m` metres left of the true lines."""
        x, across = (grid.ravel() for grid in np.meshgrid(np.arange(3.0, 40, 0.1), np.linspace(-0.15, 0.15, 7)))
        lines = [np.interp(x, X, truth()[key]) + shift_m + across for key in ("left_y_m", "right_y_m")]
        return np.vstack([np.column_stack([x, y]) for y in lines])

    def test_points_on_the_lines_have_precision_1_and_those_beside_them_0(self):
        assert marking_precision(self.road_points(0.0), truth()) == 1
        assert marking_precision(self.road_points(0.6), truth()) == 0
        assert marking_precision(self.road_points(0.0), None) is None

    def test_other_lanes_and_the_far_road_do_not_count(self):
        elsewhere = [[20.0, 8.0], [20.0, -8.0], [3.0, 0.0], [35.0, 0.0]]
        assert marking_precision(np.vstack([self.road_points(0.0), elsewhere]), truth()) == 1
        assert marking_precision(np.array(elsewhere), truth()) is None

    def test_a_flooded_binary_has_the_share_of_the_lines_in_the_lane(self):
        flooded = SimpleNamespace(warped_binary=np.full((360, 640), 255, np.uint8), warp=WARP)
        # two stripes of 0.4 m in 3.6 m of lane and a metre on each side
        assert marking_precision(binary_on_road(flooded, CAMERA), truth()) == pytest.approx(0.8 / 5.6, abs=0.05)


def test_the_recall_of_a_dash_is_its_length_of_one_line():
    x = np.arange(10.0, 20.0, 0.1)
    dash = np.column_stack([x, np.interp(x, X, truth()["right_y_m"]) + 0.1])
    # 10 of the 25 m of one of two lines
    assert marking_recall(dash, truth()) == pytest.approx(0.2, abs=0.01)
    assert marking_recall(dash + [0, 0.3], truth()) == marking_recall(np.empty((0, 2)), truth()) == 0
    assert marking_recall(np.empty((0, 2)), None) is None


def test_lane_width_in_columns_is_that_of_the_drawn_lane():
    """In a rectangle on the road with 100 columns a metre, 3.6 m are 360 columns everywhere; mirrored, -360."""
    corners = [[30, 3.2], [30, -3.2], [4, -3.2], [4, 3.2]]
    source = CAMERA.road_to_pixels(corners)
    straight = [[2.0, -0.01], [-1.6, -0.01]]
    view = [(0, 0), (640, 0), (640, 360), (0, 360)]
    warp = FourPointWarp(source, view, (640, 360))
    np.testing.assert_allclose(lane_widths_px(warp, CAMERA, straight, [5, 10, 25]), 360, atol=0.1)
    mirrored = FourPointWarp(source[[1, 0, 3, 2]], view, (640, 360))
    np.testing.assert_allclose(lane_widths_px(mirrored, CAMERA, straight, [5, 25]), -360, atol=0.1)
