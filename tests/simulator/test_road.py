"""Road geometry: clothoids against fine numerical integration, and road coordinates of ground points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simulator.road.geometry import RoadGeometry, VehiclePose, line_lateral, line_polynomial, offset_point
from simulator.road.road_ahead import RoadAhead

S_BEND = RoadGeometry([0.0, 75.0, 125.0, 175.0, 255.0, 330.0], [0.0, 0.0, 1 / 300, 1 / 300, -1 / 200, -1 / 200])


def test_heading_and_position_are_the_integrals_of_curvature():
    s = np.linspace(0, 330, 330_001)
    curvature = np.interp(s, S_BEND.stations_m, S_BEND.curvatures_per_m)
    step = s[1]
    heading = np.concatenate([[0], np.cumsum((curvature[1:] + curvature[:-1]) / 2 * step)])
    middle = (heading[1:] + heading[:-1]) / 2
    x = np.concatenate([[0], np.cumsum(np.cos(middle) * step)])
    y = np.concatenate([[0], np.cumsum(np.sin(middle) * step)])
    np.testing.assert_allclose(S_BEND.heading(s), heading, atol=1e-9)
    np.testing.assert_allclose(S_BEND.position(s), np.column_stack([x, y]), atol=1e-6)


def test_arc_closes_its_circle():
    circle = RoadGeometry([0.0, 1.0], [1 / 200, 1 / 200])
    np.testing.assert_allclose(circle.position(2 * np.pi * 200), [0, 0], atol=1e-9)
    np.testing.assert_allclose(circle.position(np.pi * 200), [0, 400], atol=1e-9)


def test_road_before_its_start_is_continuous():
    road = RoadGeometry([100.0, 200.0], [1 / 400, 1 / 400])
    assert road.heading(99.0) == pytest.approx(-1 / 400)
    np.testing.assert_allclose(road.position(100.0), [0, 0], atol=1e-12)


@settings(max_examples=40, deadline=None)
@given(
    curvatures=st.lists(st.floats(-1 / 150, 1 / 150), min_size=4, max_size=4),
    lateral=st.floats(-1.5, 1.5),
    heading=st.floats(-0.05, 0.05),
    seed=st.integers(0, 1000),
)
def test_ground_points_get_their_road_coordinates(curvatures, lateral, heading, seed):
    road = RoadGeometry([0.0, 50.0, 100.0, 180.0], curvatures)
    pose = VehiclePose(20.0, lateral, heading)
    rng = np.random.default_rng(seed)
    s, d = rng.uniform(0, 120, 500), rng.uniform(-15, 15, 500)
    points = pose.to_car(road, offset_point(road, pose.s_m + s, d)).astype(np.float32)
    got_s, got_d = RoadAhead(road, pose).locate(points[:, 0], points[:, 1])
    assert got_s.dtype == got_d.dtype == np.float32
    np.testing.assert_allclose(got_s, s, atol=1e-3)
    np.testing.assert_allclose(got_d, d, atol=1e-3)


@pytest.mark.parametrize("lateral_m", [1.83, -1.83])
def test_polynomial_touches_the_line_to_third_order(lateral_m):
    pose = VehiclePose(210.0, 0.4, 0.03)
    line = line_polynomial(S_BEND, pose, lateral_m)
    x = np.linspace(-3, 3, 7)
    cubic = line.c0_m + line.c1 * x + line.c2_per_m * x**2 / 2 + line.c3_per_m2 * x**3 / 6
    np.testing.assert_allclose(line_lateral(S_BEND, pose, lateral_m, x), cubic, atol=1e-5)
    # Without the cubic term the error is larger, so c3 matters.
    assert np.abs(line_lateral(S_BEND, pose, lateral_m, x) - cubic + line.c3_per_m2 * x**3 / 6).max() > 1e-4


def test_mirrored_road_swaps_left_and_right():
    mirrored = replace(S_BEND, curvatures_per_m=-S_BEND.curvatures_per_m)
    left = line_polynomial(S_BEND, VehiclePose(150.0, 0.4, 0.03), 1.83)
    right = line_polynomial(mirrored, VehiclePose(150.0, -0.4, -0.03), -1.83)
    assert (left.c0_m, left.c1, left.c2_per_m, left.c3_per_m2) == pytest.approx(
        (-right.c0_m, -right.c1, -right.c2_per_m, -right.c3_per_m2)
    )


def test_refuses_stations_that_do_not_increase():
    with pytest.raises(ValueError, match="increasing"):
        RoadGeometry([0.0, 10.0, 10.0], [0.0, 0.0, 0.1])
