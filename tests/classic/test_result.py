import numpy as np
import pytest

from lanes.classic.finder import get_recipe
from lanes.classic.fit import LineFit
from lanes.classic.measure import RoadLine
from lanes.classic.result import FoundLine, LaneResult, Steps
from lanes.classic.search import Window

LEFT, RIGHT = RoadLine(1.7, 0.0, 0.002), RoadLine(-2.0, 0.0, 0.004)
FIT = LineFit((0.0, 0.0, 300.0), 1, (0, 719))


def result(left=LEFT, right=RIGHT, state="found"):
    window = Window(220, 640, 380, 719, 12)
    lines = (FoundLine(FIT, np.empty((0, 2)), "combined", (window,)), FoundLine(None, np.empty((0, 2)), "combined"))
    picture = np.random.default_rng(0).integers(0, 256, (720, 1280, 3), np.uint8)
    steps = Steps(picture, {}, np.zeros((720, 1280), np.uint8), *lines, get_recipe("hls_sobel").warp())
    return LaneResult(left and FIT, right and FIT, left, right, state, steps)


def test_measures_of_both_lines():
    lane = result()
    assert lane.curvature_per_m == pytest.approx(0.003)
    assert lane.offset_m == pytest.approx(0.15)
    assert lane.lane_width_m == pytest.approx(3.7)


def test_measures_of_one_line():
    lane = result(right=None, state="lost")
    assert lane.curvature_per_m == pytest.approx(0.002)
    assert (lane.offset_m, lane.lane_width_m) == (None, None)


def test_measures_of_no_line():
    lane = result(None, None, "lost")
    assert (lane.curvature_per_m, lane.offset_m) == (None, None)


@pytest.mark.parametrize(("state", "found"), [("found", True), ("kept", False), ("lost", False)])
def test_only_a_measured_lane_is_found(state, found):
    assert result(state=state).found is found


def test_steps_show_the_view_and_all_windows():
    steps = result().steps
    np.testing.assert_array_equal(steps.birdseye, steps.warp.warp(steps.undistorted))
    assert steps.windows_px.tolist() == [[220, 640, 380, 719]]


def test_lines_in_the_picture_run_from_far_to_near():
    lane = result(right=None)
    assert lane.right_px is None
    np.testing.assert_allclose(lane.warp.points_to_birdseye(lane.left_px), FIT.points(720), atol=1e-6)
    assert lane.left_px[0, 1] < lane.left_px[-1, 1]


def test_a_row_of_telemetry_has_units_in_its_names_and_gaps_where_nothing_was_measured():
    row = result(right=None, state="lost").as_row()
    assert row["state"] == "lost"
    assert (row["left_c0_m"], row["left_c2_per_m"]) == (1.7, 0.002)
    assert row["offset_m"] is row["right_c0_m"] is None
