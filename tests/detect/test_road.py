import numpy as np
import pytest

from lanes.camera import CameraPose
from lanes.detect.residuals import arc_coordinates, flatten, intersect_ground, path_coordinates
from lanes.detect.road import (
    CURVATURE,
    HEADING,
    KNOTS_M,
    LEFT_SIDE,
    RATE,
    RATE_STEPS,
    RIGHT_SIDE,
    SIDES,
    STRAIGHT_FROM_M,
    VERTICAL_KNOTS_M,
    RoadPrior,
    height_and_grade,
    line_coefficients,
    line_points,
    line_y,
    line_y_gradients,
    lines_on_view,
    max_curvature,
    road_height,
)
from simulator.road.geometry import RoadGeometry, offset_point
from tests.support.painted_roads import dashcam
from tests.support.shapes import a_lane

PRIOR = RoadPrior()
HAIRPIN = a_lane(centre=0.3, width=3.4, heading=-0.1, curvature=-1 / 15)
CLOTHOID = a_lane(centre=-0.2, width=3.6, heading=0.01, curvature=1 / 600, rate=4e-5)


def test_arc_coordinates_measure_the_distance_to_a_circle():
    rng = np.random.default_rng(0)
    points = rng.uniform(0, 14, 50) + 1j * rng.uniform(-5, 5, 50)
    curvature = -1 / 20
    centre = 1j / curvature
    a, tangent = arc_coordinates(points, curvature)
    # right bend: points farther from the centre lie to the left
    np.testing.assert_allclose(a, np.abs(points - centre) - 20, atol=1e-12)
    # a perpendicular of the arc leads to the point from where the arc has turned so far
    np.testing.assert_allclose(np.abs(tangent), 1)
    np.testing.assert_allclose(centre + (20 + a) * 1j * tangent, points, atol=1e-9)


def test_arc_coordinates_of_a_straight_road():
    a, tangent = arc_coordinates(np.array([10.0 + 2.0j]), np.zeros(1))
    assert (a[0], tangent[0]) == pytest.approx((2.0, 1.0))


ENTRY = a_lane(centre=0.5, width=3.3, heading=0.15, curvature=1 / 90, rate=2e-3, rate_steps=-1e-3)
BENDING = pytest.mark.parametrize("lane", [HAIRPIN, CLOTHOID, ENTRY], ids=["hairpin", "clothoid", "entry"])


def true_road(lane):
    """The simulator's road of a lane's curvatures, which begins at the car and along the x axis."""
    stations = np.array([0.0, *KNOTS_M, 70.0])
    rates = lane[RATE] + np.array([0.0, *lane[RATE_STEPS].cumsum()])
    return RoadGeometry(stations, lane[CURVATURE] + np.array([0.0, *(rates * np.diff(stations)).cumsum()]))


def true_points(lane, along, lateral):
    """Points x + iy at arc lengths (N,) and distances (N,) to the left of the path of a lane."""
    x, y = offset_point(true_road(lane), along, lateral).T
    return (x + 1j * y) * np.exp(1j * lane[HEADING])


@BENDING
@pytest.mark.parametrize("side", [LEFT_SIDE, RIGHT_SIDE])
def test_points_of_a_line_lie_at_half_a_width(lane, side):
    along = np.linspace(0, 60, 97)
    x, y = line_points(lane, side, along).T
    np.testing.assert_allclose(x + 1j * y, true_points(lane, along, lane[0] + side * lane[1] / 2), atol=1e-5)


@BENDING
def test_points_have_their_distance_from_the_path(lane):
    rng = np.random.default_rng(1)
    along, lateral = rng.uniform(0, 40, 200), rng.uniform(-6, 6, 200)
    _, found = path_coordinates(lane[None], true_points(lane, along, lateral)[None])
    np.testing.assert_allclose(found.a[0], lateral, atol=1e-3)
    np.testing.assert_allclose(found.along_m[0], along, atol=0.01)
    direction = lane[HEADING] + true_road(lane).heading(along)
    np.testing.assert_allclose(found.direction[0], direction, atol=2e-3)
    np.testing.assert_allclose(found.tangent[0], np.exp(1j * direction), atol=2e-3)


def test_a_clothoid_bends_as_its_rate_says():
    along = np.linspace(0, 60, 601)
    x, y = line_points(CLOTHOID - a_lane(width=0.0, heading=0.01), 0.0, along).T
    slope = np.gradient(y, x)
    curvature = np.gradient(slope, x) / (1 + slope**2) ** 1.5
    np.testing.assert_allclose(curvature[5:-5], (1 / 600 + 4e-5 * along)[5:-5], rtol=0.03)


@pytest.mark.parametrize("side", [LEFT_SIDE, RIGHT_SIDE])
def test_lateral_place_at_a_distance(side):
    x = np.array([0.0, 5.0, 20.0, 50.0])
    y = line_y(x, CLOTHOID, side)
    along = np.linspace(-5, 60, 4000)
    points = line_points(CLOTHOID, side, along)
    np.testing.assert_allclose(y, np.interp(x, points[:, 0], points[:, 1]), atol=1e-4)


def test_a_line_that_turns_back_has_no_place_beyond():
    radius = 15 + 0.3 + 3.4 / 2
    reach = radius - 15 * np.sin(0.1)
    y = line_y(np.array([reach - 1.0, reach + 0.5]), HAIRPIN, LEFT_SIDE)
    assert np.isfinite(y[0]) and np.isnan(y[1])


def test_a_line_that_swings_back_has_no_place_beyond():
    # the line runs across at 12 m; extrapolated, it turns and runs ahead to 28 m
    swing = a_lane(centre=0.3, width=3.4, heading=0.01, curvature=0.07, rate_steps=(1e-3, -5e-3, -5e-3))
    ahead = line_points(swing, LEFT_SIDE, np.arange(0.0, 100.0, 0.1))[:, 0]
    across = ahead[np.argmax(np.diff(ahead) < 0)]
    assert 10 < across < 14 and ahead.max() > 25
    x = np.arange(0.0, 45.0)
    y = line_y(x, swing, LEFT_SIDE)
    assert np.isfinite(y[x < across - 1]).all() and np.isnan(y[x > across]).all()


@pytest.mark.parametrize("lane", [a_lane(), CLOTHOID, HAIRPIN, ENTRY], ids=["straight", "clothoid", "hairpin", "entry"])
@pytest.mark.parametrize("side", [LEFT_SIDE, RIGHT_SIDE])
def test_gradients_are_differences_of_the_lateral_position(lane, side):
    x = np.array([0.0, 5.0, 10.0, 15.0, 20.0])
    expected = np.zeros((len(x), 15))
    for k, step in enumerate(3e-4 * PRIOR.std):
        change = np.zeros(15)
        change[k] = step
        expected[:, k] = (line_y(x, lane + change, side) - line_y(x, lane - change, side)) / (2 * step)
    gradients = line_y_gradients(x, lane, side)
    assert (np.isnan(gradients).all(axis=1) == np.isnan(line_y(x, lane, side))).all()
    scale = np.abs(expected * PRIOR.std).max(axis=1, keepdims=True)
    np.testing.assert_allclose(gradients * PRIOR.std / scale, expected * PRIOR.std / scale, atol=1e-4)


@pytest.mark.parametrize("side", [LEFT_SIDE, RIGHT_SIDE])
def test_coefficients_are_the_derivatives_at_the_car(side):
    lane = a_lane(centre=0.4, heading=0.08, curvature=1 / 60, rate=2e-4)
    h = 0.05
    y = line_y(np.arange(-2, 3) * h, lane, side)
    c0, c1, c2, c3 = line_coefficients(lane, side)
    assert c0 == pytest.approx(y[2])
    assert c1 == pytest.approx((y[3] - y[1]) / (2 * h), rel=1e-3)
    assert c2 == pytest.approx((y[3] - 2 * y[2] + y[1]) / h**2, rel=5e-3)
    assert c3 == pytest.approx((y[4] - 2 * y[3] + 2 * y[1] - y[0]) / (2 * h**3), rel=5e-3)


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


def test_directions_turn_with_pitch():
    # directions must agree with the places of two neighbouring points
    x, y, h = np.array([15.0]), np.array([1.5]), 1e-4
    angle = 0.12
    lane = a_lane(pitch=0.01, vertical=5e-4)
    x0, y0, found = flatten(x, y, np.array([angle]), intersect_ground(x, lane, 1.3), 1.3)
    x1, y1, _ = flatten(x + h, y + h * np.tan(angle), np.array([angle]), intersect_ground(x + h, lane, 1.3), 1.3)
    assert found == pytest.approx(np.arctan2(y1 - y0, x1 - x0), abs=2e-3)


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


WAVES = {
    "crest": (-4e-3, -2e-3, 1e-3, 0.0),
    "dip": (3e-3, 2e-3, -1e-3, -1e-4),
    "a crest that hides a dip": (0.0, -0.014, 0.006, 2e-3),
}


def test_heights_and_grades_are_integrals_of_the_curvature():
    x, numbers = np.arange(0.0, 90.0, 0.002), np.array([3e-3, -7e-3, 5e-3, -2e-3])
    # from where the view ends the road goes on as steep as it is
    curvature = np.interp(x, [*VERTICAL_KNOTS_M, STRAIGHT_FROM_M], [*numbers, 0.0])
    grade = np.concatenate([[0], np.cumsum((curvature[1:] + curvature[:-1]) / 2 * 0.002)])
    rise = np.concatenate([[0], np.cumsum((grade[1:] + grade[:-1]) / 2 * 0.002)])
    found_rises, found_grades = height_and_grade(x)
    np.testing.assert_allclose(found_rises @ numbers, rise, atol=1e-6)
    np.testing.assert_allclose(found_grades @ numbers, grade, atol=1e-8)
    np.testing.assert_allclose(road_height(a_lane(vertical=tuple(numbers)), x), rise, atol=1e-6)


def first_hit(lane, flat_x, height_m, pitch):
    """Where the rays to flat distances (N,) first touch the road, by walking along each of them; NaN if never."""
    x = np.arange(2.0, 340.0, 0.01)
    fall = height_m / flat_x[:, None] + pitch
    above = height_m - fall * x - road_height(lane, x)
    hit = above <= 0
    first = hit.argmax(axis=1)
    rows = np.arange(len(flat_x))
    before, after = above[rows, first - 1], above[rows, first]
    root = x[first] - 0.01 * after / (after - before)
    return np.where(hit.any(axis=1) & (first > 0), root, np.nan)


@pytest.mark.parametrize("pitch", [-0.01, 0.0, 0.02])
@pytest.mark.parametrize("vertical", WAVES.values(), ids=WAVES.keys())
def test_rays_meet_the_road_where_they_touch_it_first(vertical, pitch):
    lane, flat_x, height = a_lane(pitch=pitch, vertical=vertical), 5 * 1.022 ** np.arange(80), 1.3
    expected = first_hit(lane, flat_x, height, pitch)
    ground = intersect_ground(flat_x, lane, height)
    seen = np.isfinite(expected) & (expected < 100)
    assert seen.sum() > 20
    # a ray that only just passes over a crest goes far, and one a hair lower does not: one in twenty may be either
    near = np.abs(ground.x_m - expected)[seen] < 0.005 * expected[seen] + 0.01
    assert near.mean() > 0.95
    height_there = height - (height / flat_x + pitch) * ground.x_m
    off = np.abs(height_there - road_height(lane, ground.x_m))[seen]
    assert off[near].max() < 3e-3
    np.testing.assert_array_equal(ground.heights, height_and_grade(ground.x_m)[0])


def test_no_ray_meets_what_is_hidden_behind_a_crest():
    lane, height = a_lane(vertical=WAVES["a crest that hides a dip"]), 1.3
    x = np.arange(2.0, 60.0, 0.01)
    fall = (height - road_height(lane, x)) / x
    hidden = x[fall > np.minimum.accumulate(fall) + 1e-9]
    assert hidden[-1] - hidden[0] > 12
    met = intersect_ground(height / np.linspace(0.3, 0.003, 2000), lane, height).x_m
    inside = (met > hidden[0] * 1.035) & (met < hidden[-1] / 1.035)
    assert inside.mean() < 0.01
    assert (met < hidden[0]).any() and (met > hidden[-1]).any()
    y = lines_on_view(lane[None], 5 * 1.022 ** np.arange(121)[::-1], height)[0]
    # the lines end at the crest, for the view has nothing of them where it is covered
    assert np.isfinite(y).any() and np.isnan(y[:, 0]).all()


def test_rays_of_many_lanes_are_those_of_each():
    lanes = np.array([a_lane(pitch=0.01, vertical=v) for v in WAVES.values()])
    flat_x = np.linspace(6, 50, 30)
    together = intersect_ground(flat_x, lanes, 1.4)
    for k, lane in enumerate(lanes):
        alone = intersect_ground(flat_x, lane, 1.4)
        for name in ("x_m", "fall", "heights"):
            np.testing.assert_allclose(getattr(together, name)[k], getattr(alone, name), rtol=1e-12)


def test_the_largest_curvature_is_at_the_car_or_ahead():
    assert max_curvature(HAIRPIN) == pytest.approx(1 / 15)
    bend_begins = a_lane(rate_steps=(2e-3, 0, 0))
    assert max_curvature(bend_begins) == pytest.approx(2e-3 * (25 - KNOTS_M[0]))
    # a bend that begins and ends in view is sharpest in between
    bend = a_lane(rate_steps=(4e-3, -8e-3, 4e-3))
    assert max_curvature(bend) == pytest.approx(4e-3 * (KNOTS_M[1] - KNOTS_M[0]))
