"""The prediction and what it learns, against roads driven exactly."""

from __future__ import annotations

import numpy as np
import pytest

from lanes.detect.road import ADJACENT, CENTRE, CURVATURE, HEADING, PITCH, RATE, RATE_STEPS, VERTICAL_CURVATURE, WIDTH
from lanes.track.filter import (
    CAMERA_YAW,
    LANE,
    PATH,
    REST_PITCH,
    SPEED,
    KalmanState,
    inflate,
    initial_state,
    lever_m,
    max_speed_mps,
    predict,
    update_state,
)
from simulator.road.geometry import RoadGeometry, VehiclePose
from simulator.road.truth import lane_truth
from tests.support.shapes import a_lane

SMALL = dict(rate=1e-5, pitch=0.005, vertical=1e-4, rate_steps=1e-5, adjacent=0.1)
COVARIANCE = np.diag(np.square(a_lane(centre=0.1, width=0.1, heading=0.01, curvature=1e-3, **SMALL)))
LANE_BEFORE = a_lane(centre=0.3, width=3.6, heading=0.02, curvature=2e-3, rate=1e-5, pitch=0.004)


def state_with(**car: float) -> KalmanState:
    estimate = initial_state(LANE_BEFORE, COVARIANCE, 20.0)
    places = {"path": PATH, "speed": SPEED, "rest": REST_PITCH, "aim": CAMERA_YAW}
    for name, value in car.items():
        estimate.mean[places[name]] = value
    return estimate


def test_straight_driving_along_a_bend():
    """A car that drives straight on: the lane turns and moves below it as geometry says."""
    road = RoadGeometry([0.0, 1000.0], [1 / 400, 1 / 400])
    before = lane_truth(road, VehiclePose(100.0, 0.2, -0.01), (1.8, -1.8), time_s=0, pitch_rad=0)
    lane = a_lane(centre=-0.2, width=3.6, heading=before.heading_rad, curvature=1 / 400)
    estimate = initial_state(lane, COVARIANCE, 20.0)
    estimate.mean[PATH] = 0.0
    after = predict(estimate, 0.1).mean
    # two metres on: its heading relative to the road changes by 2 / 400, its lateral place by the integral of it
    assert after[HEADING] == pytest.approx(before.heading_rad + 2 / 400, abs=1e-6)
    assert after[CENTRE] == pytest.approx(-0.2 + 2 * before.heading_rad + 2**2 / 400 / 2, abs=1e-6)


def test_clothoid_and_springs():
    after = predict(state_with(path=2e-3, rest=0.0), 0.04).mean
    assert after[CURVATURE] == pytest.approx(2e-3 + 1e-5 * 0.8)
    assert 0 < after[PITCH] < 0.004
    assert after[WIDTH] == 3.6
    assert after[RATE] == pytest.approx(1e-5, rel=0.01)


def test_camera_yaw_does_not_move_the_lane():
    after = predict(state_with(path=2e-3, aim=0.02), 0.1).mean
    assert after[CENTRE] == pytest.approx(0.3, abs=1e-9)


def test_uncertainty_grows_and_a_standing_car_keeps_the_road():
    estimate = state_with()
    later = predict(estimate, 0.04)
    assert np.all(np.diag(later.covariance)[:3] > np.diag(estimate.covariance)[:3])
    standing = predict(state_with(speed=0.0), 0.04)
    for parameter in (WIDTH, CURVATURE, RATE):
        assert standing.covariance[parameter, parameter] == pytest.approx(estimate.covariance[parameter, parameter])
    np.testing.assert_allclose(later.covariance, later.covariance.T, atol=1e-15)


def test_update_moves_the_car_with_the_lane():
    """If the lane has moved farther sideways than predicted, the estimated speed grows."""
    estimate = state_with(path=2e-3, speed=20.0)
    estimate.covariance[SPEED, SPEED] = 64.0
    estimate = predict(estimate, 0.5)
    lane = estimate.lane.copy()
    lane[CENTRE] += 0.05
    updated = update_state(estimate, lane, estimate.lane_covariance / 4)
    assert updated.mean[SPEED] > 20.5
    assert updated.covariance[SPEED, SPEED] < estimate.covariance[SPEED, SPEED]
    np.testing.assert_array_equal(updated.mean[LANE], lane)
    # learning nothing changes nothing
    same = update_state(estimate, estimate.lane, estimate.lane_covariance)
    np.testing.assert_allclose(same.covariance, estimate.covariance, atol=1e-12)


def test_update_equals_the_textbook_kalman_update():
    """Against the textbook's formula, with a measurement of the centre alone."""
    estimate = predict(state_with(), 0.2)
    h = np.zeros(len(estimate.mean))
    h[CENTRE] = 1
    s = h @ estimate.covariance @ h + 0.05**2
    gain = estimate.covariance @ h / s
    mean, covariance = estimate.mean + gain * 0.1, estimate.covariance - np.outer(gain, gain) * s
    updated = update_state(estimate, mean[LANE], covariance[LANE, LANE])
    np.testing.assert_allclose(updated.mean, mean, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(updated.covariance, covariance, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_adjacent_lane_shares_a_line(side):
    estimate = state_with()
    neighbour = estimate.adjacent(side)
    shared = np.zeros(len(estimate.mean))
    shared[[CENTRE, WIDTH]] = 1, side / 2
    other = shared.copy()
    other[WIDTH] = -side / 2
    assert other @ neighbour.mean == pytest.approx(shared @ estimate.mean)
    assert other @ neighbour.covariance @ other == pytest.approx(shared @ estimate.covariance @ shared)
    far = shared @ neighbour.covariance @ shared
    assert far > shared @ estimate.covariance @ shared


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_adjacent_lane_has_its_own_width_and_the_way_back_restores_the_state(side):
    estimate = state_with()
    estimate.mean[ADJACENT] = 0.3, -0.2
    there = estimate.adjacent(side)
    wider = 0.3 if side > 0 else -0.2
    assert there.mean[WIDTH] == pytest.approx(3.6 + wider)
    assert there.mean[CENTRE] == pytest.approx(0.3 + side * (3.6 + wider / 2))
    back = there.adjacent(-side)
    np.testing.assert_allclose(back.mean[[CENTRE, WIDTH]], estimate.mean[[CENTRE, WIDTH]])
    for number in (CENTRE, WIDTH):
        assert back.covariance[number, number] == pytest.approx(estimate.covariance[number, number])


def test_inflated_covariance_of_vertical_curvature_rate_steps_and_pitch():
    estimate = state_with()
    inflated = inflate(estimate)
    more = np.diag(inflated.covariance - estimate.covariance)
    free = np.isin(np.arange(len(more)), [PITCH, *range(len(more))[VERTICAL_CURVATURE], *range(len(more))[RATE_STEPS]])
    assert (more[free] > 1e-7).all() and (more[~free] == 0).all()
    np.testing.assert_array_equal(inflated.mean, estimate.mean)
    np.testing.assert_array_equal(estimate.covariance, state_with().covariance)


def test_a_rate_step_comes_nearer_and_becomes_the_rate():
    """A straight that bends from the first knot on: when the car is there, so is the bend."""
    estimate = state_with(path=0.0, aim=0.0)
    road = a_lane(width=3.6, rate_steps=(2e-3, 0, 0))
    estimate.mean[LANE] = road
    for _ in range(70):
        estimate.mean[SPEED] = 10.0
        estimate = predict(estimate, 0.01)
    # it fades as it comes; what is left of it has become the rate, or lies before the car
    rate, kink = estimate.mean[RATE], estimate.mean[RATE_STEPS][0]
    assert 0 < kink < rate < 2e-3
    assert 0 < estimate.mean[CURVATURE] < 2e-3 * 7


@pytest.mark.parametrize(("radius_m", "fastest"), [(24.0, 12.0), (1e9, 70.0)])
def test_max_speed_falls_with_curvature(radius_m, fastest):
    assert max_speed_mps(-1 / radius_m, 6.0) == pytest.approx(fastest)
    lane = a_lane(width=3.4, curvature=1 / radius_m)
    assert initial_state(lane, COVARIANCE, None).mean[SPEED] <= fastest
    assert initial_state(lane, COVARIANCE, 20.0).mean[SPEED] == 20.0


@pytest.mark.parametrize("radius_m", [-15.0, 22.0])
def test_camera_moves_along_the_lane_in_a_hairpin(radius_m):
    path, speed = 1 / radius_m, 8.0
    lane = a_lane(centre=0.1, width=3.2, heading=lever_m(speed) * path + 0.01, curvature=path)
    estimate = initial_state(lane, COVARIANCE, speed)
    estimate.mean[CAMERA_YAW] = 0.01
    assert estimate.motion.course_rad == pytest.approx(lane[HEADING])
    assert predict(estimate, 0.04).mean[CENTRE] == pytest.approx(0.1, abs=1e-9)
