import numpy as np
import pytest
from painter import dashcam

from lanes.camera import Mount
from lanes.metric.lanemodel import (
    LEFT,
    NUMBERS,
    RIGHT,
    SIDES,
    flatten,
    line_coefficients,
    line_points,
    line_y,
    lines_on_view,
    place,
)

HAIRPIN = np.array([0.3, 3.4, -0.1, -1 / 15, 0.0, 0.0, 0.0])
CLOTHOID = np.array([-0.2, 3.6, 0.01, 1 / 600, 4e-5, 0.0, 0.0])


def test_place_measures_the_distance_to_a_circle():
    rng = np.random.default_rng(0)
    x, y = rng.uniform(0, 14, 50), rng.uniform(-5, 5, 50)
    heading, curvature = 0.2, -1 / 20
    centre = np.array([-np.sin(heading), np.cos(heading)]) / curvature
    a, turn, scale, ahead, aside = place(x, y, heading, curvature)
    # right bend: points farther from the centre lie to the left
    np.testing.assert_allclose(a, np.hypot(x - centre[0], y - centre[1]) - 20, atol=1e-12)
    np.testing.assert_allclose(scale, 1 - curvature * a)
    np.testing.assert_allclose(np.hypot(ahead, aside), np.hypot(x, y))
    # a perpendicular of the arc leads to the point from where the arc has turned so far
    normal = np.stack([-np.sin(heading + turn), np.cos(heading + turn)], axis=1)
    np.testing.assert_allclose(centre + (20 + a)[:, None] * normal, np.stack([x, y], axis=1), atol=1e-9)


def test_place_needs_no_curvature():
    a, turn, _, ahead, _ = place(np.array([10.0]), np.array([2.0]), 0.1, 0.0)
    assert a == pytest.approx(2 * np.cos(0.1) - 10 * np.sin(0.1))
    assert (turn[0], ahead[0]) == pytest.approx((0.0, 10 * np.cos(0.1) + 2 * np.sin(0.1)))


@pytest.mark.parametrize("lane", [HAIRPIN, CLOTHOID], ids=["hairpin", "clothoid"])
@pytest.mark.parametrize("side", [LEFT, RIGHT])
def test_points_of_a_line_lie_at_half_a_width(lane, side):
    along = np.linspace(0, 18, 40)
    points = line_points(lane, side, along)
    a, *_ = place(points[:, 0], points[:, 1], lane[2], lane[3])
    # measured at right angles to the arc, which the lane leaves with this slope
    aslant = np.hypot(1, lane[4] * along**2 / 2)
    np.testing.assert_allclose(a - lane[4] * along**3 / 6, lane[0] + side * aslant * lane[1] / 2, atol=1e-9)


def test_a_clothoid_bends_as_its_rate_says():
    along = np.linspace(0, 60, 601)
    x, y = line_points(CLOTHOID - [0, 0, 0.01, 0, 0, 0, 0], 0.0, along).T
    slope = np.gradient(y, x)
    curvature = np.gradient(slope, x) / (1 + slope**2) ** 1.5
    np.testing.assert_allclose(curvature[5:-5], (1 / 600 + 4e-5 * along)[5:-5], rtol=0.03)


@pytest.mark.parametrize("side", [LEFT, RIGHT])
def test_lateral_place_at_a_distance(side):
    x = np.array([0.0, 5.0, 20.0, 50.0])
    y = line_y(x, CLOTHOID, side)
    along = np.linspace(-5, 60, 4000)
    points = line_points(CLOTHOID, side, along)
    np.testing.assert_allclose(y, np.interp(x, points[:, 0], points[:, 1]), atol=1e-4)


def test_a_line_that_turns_back_has_no_place_beyond():
    radius = 15 + 0.3 + 3.4 / 2
    reach = radius - 15 * np.sin(0.1)
    y = line_y(np.array([reach - 1.0, reach + 0.5]), HAIRPIN, LEFT)
    assert np.isfinite(y[0]) and np.isnan(y[1])


@pytest.mark.parametrize("side", [LEFT, RIGHT])
def test_coefficients_are_the_derivatives_at_the_car(side):
    lane = np.array([0.4, 3.5, 0.08, 1 / 60, 2e-4, 0.0, 0.0])
    h = 0.05
    y = line_y(np.arange(-2, 3) * h, lane, side)
    c0, c1, c2, c3 = line_coefficients(lane, side)
    assert c0 == pytest.approx(y[2])
    assert c1 == pytest.approx((y[3] - y[1]) / (2 * h), rel=1e-3)
    assert c2 == pytest.approx((y[3] - 2 * y[2] + y[1]) / h**2, rel=5e-3)
    assert c3 == pytest.approx((y[4] - 2 * y[3] + 2 * y[1] - y[0]) / (2 * h**3), rel=0.12)


@pytest.mark.parametrize(("pitch", "vertical"), [(0.012, 0.0), (-0.01, 0.0), (0.0, 6e-4), (0.006, -4e-4)])
def test_pitch_and_hills_are_undone(pitch, vertical):
    # a straight line, seen by a camera that has nodded, on a road that bends upwards
    camera = dashcam(1280, yaw_rad=0.0)
    m = camera.mount
    nodded = camera.with_mount(Mount(m.height_m, m.pitch_rad + pitch, m.yaw_rad, m.roll_rad))
    x = np.array([6.0, 12.0, 25.0, 40.0])
    points = np.column_stack([x, 1.7 + 0.02 * x, vertical * x * x / 2])
    flat = camera.pixels_to_road(nodded.road_to_pixels(points))
    found_x, found_y, _ = flatten(flat[:, 0], flat[:, 1], np.zeros(4), pitch, vertical, m.height_m)
    np.testing.assert_allclose(found_x, x, rtol=0.01)
    np.testing.assert_allclose(found_y, points[:, 1], rtol=0.01)
    lane = np.array([1.7, 0.0, np.arctan(0.02), 0.0, 0.0, pitch, vertical])
    shown = lines_on_view(lane[None], flat[:, 0], m.height_m)[0, 0]
    np.testing.assert_allclose(shown, flat[:, 1], rtol=0.01)


def test_directions_turn_with_pitch():
    # directions must agree with the places of two neighbouring points
    x, y, h = np.array([15.0]), np.array([1.5]), 1e-4
    angle = 0.12
    x0, y0, found = flatten(x, y, np.array([angle]), 0.01, 5e-4, 1.3)
    x1, y1, _ = flatten(x + h, y + h * np.tan(angle), np.array([angle]), 0.01, 5e-4, 1.3)
    assert found == pytest.approx(np.arctan2(y1 - y0, x1 - x0), abs=2e-3)


def test_a_line_that_turns_back_before_the_car_has_finite_coefficients():
    """40 degrees to the left and R 8.3 m to the right: its right line never comes beside the car."""
    beside = np.array([0.0, 3.6, 0.3, -0.03, *np.zeros(NUMBERS - 4)])
    away = np.array([-3.0, 5.8, 0.7, -0.12, *np.zeros(NUMBERS - 4)])
    for side in SIDES:
        assert np.isfinite(line_coefficients(away, side)).all()
        y = line_y(np.array([0.0, 0.01]), beside, side)
        c0, c1, *_ = line_coefficients(beside, side)
        assert (c0, c1) == pytest.approx((y[0], (y[1] - y[0]) / 0.01), abs=1e-3)
    assert line_coefficients(away, -1.0)[1] > 2
