from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from classic.fit import LineFit, fit_line
from classic.recipe import get_recipe
from classic.result import FoundLine, LaneResult, RoadLine, Steps, road_line
from classic.search import Window
from classic.warp import scale_to_road

SIZE = (1280, 720)
SCALES = (3.7 / 700, 30 / 720)
TO_ROAD = partial(scale_to_road, metres_per_px=SCALES, birdseye_size=SIZE)
LEFT, RIGHT = RoadLine(1.7, 0.0, 0.002), RoadLine(-2.0, 0.0, 0.004)
FIT = LineFit((0.0, 0.0, 300.0), 1, (0, 719))


def result(left=LEFT, right=RIGHT, state="found"):
    window = Window(220, 640, 380, 719)
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


def circle_in_view(radius_m, y0_m=0.0):
    """Pixels of a circle that touches the car's direction `y0_m` left of the car; radius > 0 bends left."""
    rows = np.arange(720)
    x = (719 - rows) * SCALES[1]
    y = y0_m + radius_m - np.sign(radius_m) * np.sqrt(radius_m**2 - x**2)
    return np.column_stack([639.5 - y / SCALES[0], rows])


@given(st.floats(200, 2500), st.sampled_from([-1, 1]), st.floats(-2, 2))
def test_a_circle_of_radius_r_measures_r(radius, side, y0):
    line = road_line(fit_line(circle_in_view(side * radius, y0)), TO_ROAD, 720)
    # A parabola through 30 m of a circle of 200 m is off by 1 %.
    assert 1 / line.curvature_per_m() == pytest.approx(side * radius, rel=0.012)
    assert line.c0_m == pytest.approx(y0, abs=0.01)


def test_a_line_is_where_its_polynomial_says():
    line = RoadLine(1.5, 0.02, -0.004)
    np.testing.assert_allclose(line.lateral_m(np.array([0.0, 10.0, 30.0])), [1.5, 1.5, 0.3])


def test_curvature_is_the_published_formula_at_the_bottom_row():
    """(1 + (2Ay + B)^2)^1.5 / |2A| of the fit in metres, as the course writes it."""
    fit = LineFit((2e-4, -0.35, 500.0), 1, (0, 719))
    a, b = 2e-4 * SCALES[0] / SCALES[1] ** 2, -0.35 * SCALES[0] / SCALES[1]
    published = (1 + (2 * a * 719 * SCALES[1] + b) ** 2) ** 1.5 / abs(2 * a)
    line = road_line(fit, TO_ROAD, 720)
    assert abs(1 / line.curvature_per_m()) == pytest.approx(published, rel=1e-9)


def test_curvature_further_ahead_follows_the_line():
    line = RoadLine(0.0, 0.0, 0.01)
    assert line.curvature_per_m(0) == pytest.approx(0.01)
    assert line.curvature_per_m(50) == pytest.approx(0.01 / 1.25**1.5)
    assert line.lateral_m(10.0) == pytest.approx(0.5)


def test_points_above_the_horizon_are_left_out():
    def half_sky(points):
        road = TO_ROAD(points)
        road[points[:, 1] < 360] = np.nan
        return road

    fit = fit_line(circle_in_view(400))
    assert road_line(fit, half_sky, 720).c2_per_m == pytest.approx(1 / 400, rel=0.02)
    assert road_line(fit, lambda points: np.full((len(points), 2), np.nan), 720) is None
    assert road_line(fit, TO_ROAD, 1) is None


def test_offset_is_positive_left_of_the_centre():
    left, right = RoadLine(1.55, 0.0, 0.0), RoadLine(-2.15, 0.0, 0.0)
    lane = result(left, right)
    assert lane.offset_m == pytest.approx(0.3)
    assert lane.lane_width_m == pytest.approx(3.7)


def test_width_is_measured_across_the_lane():
    heading = 0.1
    left, right = (RoadLine(side * 1.85 / np.cos(heading), np.tan(heading), 0.0) for side in (1, -1))
    assert result(left, right).lane_width_m == pytest.approx(3.7)
