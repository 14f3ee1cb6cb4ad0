"""Geometry of the lane model: lines of roads that bend, pitch and undulate."""

from __future__ import annotations

import numpy as np
import pytest

from lanes.camera import CameraPose
from lanes.detect.residuals import flatten, intersect_ground
from lanes.detect.road import (
    CURVATURE,
    HEADING,
    KNOTS_M,
    RATE,
    RATE_STEPS,
    SIDES,
    line_coefficients,
    line_points,
    line_y,
    lines_on_view,
)
from simulator.road.geometry import RoadGeometry, offset_point
from tests.support.painted_roads import dashcam
from tests.support.shapes import a_lane

HAIRPIN = a_lane(centre=0.3, width=3.4, heading=-0.1, curvature=-1 / 15)
CLOTHOID = a_lane(centre=-0.2, width=3.6, heading=0.01, curvature=1 / 600, rate=4e-5)
ENTRY = a_lane(centre=0.5, width=3.3, heading=0.15, curvature=1 / 90, rate=2e-3, rate_steps=-1e-3)


def true_road(lane: np.ndarray) -> RoadGeometry:
    """The simulator's road of a lane's curvatures, which begins at the car and along the x axis."""
    stations = np.array([0.0, *KNOTS_M, 70.0])
    rates = lane[RATE] + np.array([0.0, *lane[RATE_STEPS].cumsum()])
    return RoadGeometry(stations, lane[CURVATURE] + np.array([0.0, *(rates * np.diff(stations)).cumsum()]))


def true_points(lane: np.ndarray, along: np.ndarray, lateral: np.ndarray) -> np.ndarray:
    """Points x + iy at arc lengths (N,) and distances (N,) to the left of the path of a lane."""
    x, y = offset_point(true_road(lane), along, lateral).T
    return (x + 1j * y) * np.exp(1j * lane[HEADING])


@pytest.mark.parametrize("lane", [HAIRPIN, CLOTHOID, ENTRY], ids=["hairpin", "clothoid", "entry"])
@pytest.mark.parametrize("side", SIDES)
def test_points_of_a_line_lie_at_half_a_width(lane, side):
    along = np.linspace(0, 60, 97)
    x, y = line_points(lane, side, along).T
    np.testing.assert_allclose(x + 1j * y, true_points(lane, along, lane[0] + side * lane[1] / 2), atol=1e-5)
    at_m, ahead = np.array([0.5, 5.0, 9.0]), np.arange(len(x)) <= x.argmax()
    np.testing.assert_allclose(line_y(at_m, lane, side), np.interp(at_m, x[ahead], y[ahead]), atol=0.02)


@pytest.mark.parametrize(("pitch", "vertical"), [(0.012, 0.0), (-0.01, 0.0), (0.0, 6e-4), (0.006, -4e-4)])
def test_pitch_and_hills_are_undone(pitch, vertical):
    # a straight line, seen by a camera that has nodded, on a road that bends upwards
    camera = dashcam(1280, yaw_rad=0.0)
    m = camera.pose
    nodded = camera.with_pose(CameraPose(m.height_m, m.pitch_rad + pitch, m.yaw_rad, m.roll_rad))
    x = np.array([6.0, 12.0, 25.0, 40.0])
    points = np.column_stack([x, 1.7 + 0.02 * x, vertical * x * x / 2])
    flat = camera.pixels_to_road(nodded.road_to_pixels(points))
    lane = a_lane(centre=1.7, width=0.0, heading=np.arctan(0.02), pitch=pitch, vertical=vertical)
    ground = intersect_ground(flat[:, 0], lane, m.height_m)
    found_x, found_y, _ = flatten(flat[:, 0], flat[:, 1], np.zeros(4), ground, m.height_m)
    np.testing.assert_allclose(found_x, x, rtol=0.01)
    np.testing.assert_allclose(found_y, points[:, 1], rtol=0.01)
    shown = lines_on_view(lane[None], flat[:, 0], m.height_m)[0, 0]
    np.testing.assert_allclose(shown, flat[:, 1], rtol=0.01)


def test_a_line_that_turns_back_before_the_car_has_finite_coefficients():
    """40 degrees to the left and R 8.3 m to the right: its right line never comes beside the car."""
    beside = a_lane(width=3.6, heading=0.3, curvature=-0.03)
    away = a_lane(centre=-3.0, width=5.8, heading=0.7, curvature=-0.12)
    for side in SIDES:
        assert np.isfinite(line_coefficients(away, side)).all()
        y = line_y(np.array([0.0, 0.01]), beside, side)
        c0, c1, *_ = line_coefficients(beside, side)
        assert (c0, c1) == pytest.approx((y[0], (y[1] - y[0]) / 0.01), abs=1e-3)
    assert line_coefficients(away, -1.0)[1] > 2
