"""Road geometry: clothoids against fine numerical integration, and road coordinates of ground points."""

from __future__ import annotations

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
