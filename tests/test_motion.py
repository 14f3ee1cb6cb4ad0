"""The prediction and what it learns, against roads driven exactly."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import a_lane

from lanes.tracking.model import BESIDE, CENTRE, CURVATURE, HEADING, KINKS, KNOTS_M, PITCH, RATE, VERTICAL, WIDTH
from lanes.tracking.state import AIM, LANE, PATH, REST, SPEED, Belief, bend_of, fastest_mps, lever_m
from lanes.tracking.update import first_belief
from simulator.road.geometry import Pose, RoadGeometry
from simulator.road.truth import lane_truth

SMALL = dict(rate=1e-5, pitch=0.005, vertical=1e-4, kinks=1e-5, beside=0.1)
COVARIANCE = np.diag(np.square(a_lane(centre=0.1, width=0.1, heading=0.01, curvature=1e-3, **SMALL)))
LANE_BEFORE = a_lane(centre=0.3, width=3.6, heading=0.02, curvature=2e-3, rate=1e-5, pitch=0.004)


def belief_with(**car: float) -> Belief:
    belief = first_belief(LANE_BEFORE, COVARIANCE, 20.0)
    places = {"path": PATH, "speed": SPEED, "rest": REST, "aim": AIM}
    for name, value in car.items():
        belief.mean[places[name]] = value
    return belief


def test_straight_driving_along_a_bend():
    """A car that drives straight on: the lane turns and moves below it as geometry says."""
    road = RoadGeometry([0.0, 1000.0], [1 / 400, 1 / 400])
    before = lane_truth(road, Pose(100.0, 0.2, -0.01), (1.8, -1.8), time_s=0, pitch_rad=0)
    lane = a_lane(centre=-0.2, width=3.6, heading=before.heading_rad, curvature=1 / 400)
    belief = first_belief(lane, COVARIANCE, 20.0)
    belief.mean[PATH] = 0.0
    after = belief.predict(0.1).mean
    # two metres on: its heading relative to the road changes by 2 / 400, its lateral place by the integral of it
    assert after[HEADING] == pytest.approx(before.heading_rad + 2 / 400, abs=1e-6)
    assert after[CENTRE] == pytest.approx(-0.2 + 2 * before.heading_rad + 2**2 / 400 / 2, abs=1e-6)


def test_clothoid_and_springs():
    after = belief_with(path=2e-3, rest=0.0).predict(0.04).mean
    assert after[CURVATURE] == pytest.approx(2e-3 + 1e-5 * 0.8)
    assert 0 < after[PITCH] < 0.004
    assert after[WIDTH] == 3.6
    assert after[RATE] == pytest.approx(1e-5, rel=0.01)


def test_a_camera_that_looks_aside_moves_the_lane_no_farther():
    after = belief_with(path=2e-3, aim=0.02).predict(0.1).mean
    assert after[CENTRE] == pytest.approx(0.3, abs=1e-9)


def test_uncertainty_grows_and_a_standing_car_keeps_the_road():
    belief = belief_with()
    later = belief.predict(0.04)
    assert np.all(np.diag(later.covariance)[:3] > np.diag(belief.covariance)[:3])
    standing = belief_with(speed=0.0).predict(0.04)
    for parameter in (WIDTH, CURVATURE, RATE):
        assert standing.covariance[parameter, parameter] == pytest.approx(belief.covariance[parameter, parameter])
    np.testing.assert_allclose(later.covariance, later.covariance.T, atol=1e-15)


def test_correction_moves_the_car_with_the_lane():
    """If the lane has moved farther sideways than foretold, the car is faster than believed."""
    belief = belief_with(path=2e-3, speed=20.0)
    belief.covariance[SPEED, SPEED] = 64.0
    belief = belief.predict(0.5)
    lane = belief.lane.copy()
    lane[CENTRE] += 0.05
    corrected = belief.corrected(lane, belief.lane_covariance / 4)
    assert corrected.mean[SPEED] > 20.5
    assert corrected.covariance[SPEED, SPEED] < belief.covariance[SPEED, SPEED]
    np.testing.assert_array_equal(corrected.mean[LANE], lane)
    # learning nothing changes nothing
    same = belief.corrected(belief.lane, belief.lane_covariance)
    np.testing.assert_allclose(same.covariance, belief.covariance, atol=1e-12)


def test_correction_is_the_kalman_update():
    """Against the textbook's formula, with a measurement of the centre alone."""
    belief = belief_with().predict(0.2)
    h = np.zeros(len(belief.mean))
    h[CENTRE] = 1
    s = h @ belief.covariance @ h + 0.05**2
    gain = belief.covariance @ h / s
    mean, covariance = belief.mean + gain * 0.1, belief.covariance - np.outer(gain, gain) * s
    corrected = belief.corrected(mean[LANE], covariance[LANE, LANE])
    np.testing.assert_allclose(corrected.mean, mean, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(corrected.covariance, covariance, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_neighbouring_lane_shares_a_line(side):
    belief = belief_with()
    neighbour = belief.beside(side)
    shared = np.zeros(len(belief.mean))
    shared[[CENTRE, WIDTH]] = 1, side / 2
    other = shared.copy()
    other[WIDTH] = -side / 2
    assert other @ neighbour.mean == pytest.approx(shared @ belief.mean)
    assert other @ neighbour.covariance @ other == pytest.approx(shared @ belief.covariance @ shared)
    far = shared @ neighbour.covariance @ shared
    assert far > shared @ belief.covariance @ shared


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_neighbour_is_as_much_wider_as_was_seen_and_back_again_all_is_as_before(side):
    belief = belief_with()
    belief.mean[BESIDE] = 0.3, -0.2
    there = belief.beside(side)
    wider = 0.3 if side > 0 else -0.2
    assert there.mean[WIDTH] == pytest.approx(3.6 + wider)
    assert there.mean[CENTRE] == pytest.approx(0.3 + side * (3.6 + wider / 2))
    back = there.beside(-side)
    np.testing.assert_allclose(back.mean[[CENTRE, WIDTH]], belief.mean[[CENTRE, WIDTH]])
    for number in (CENTRE, WIDTH):
        assert back.covariance[number, number] == pytest.approx(belief.covariance[number, number])


def test_a_roused_belief_expects_waves_bends_and_nods_and_else_the_same():
    belief = belief_with()
    roused = belief.roused()
    more = np.diag(roused.covariance - belief.covariance)
    free = np.isin(np.arange(len(more)), [PITCH, *range(len(more))[VERTICAL], *range(len(more))[KINKS]])
    assert (more[free] > 1e-7).all() and (more[~free] == 0).all()
    np.testing.assert_array_equal(roused.mean, belief.mean)
    np.testing.assert_array_equal(belief.covariance, belief_with().covariance)


def test_a_kink_comes_nearer_and_becomes_the_rate():
    """A straight that bends from the first knot on: when the car is there, so is the bend."""
    belief = belief_with(path=0.0, aim=0.0)
    road = a_lane(width=3.6, kinks=(2e-3, 0, 0))
    belief.mean[LANE] = road
    for _ in range(70):
        belief.mean[SPEED] = 10.0
        belief = belief.predict(0.01)
    # it fades as it comes; what is left of it has become the rate, or lies before the car
    rate, kink = belief.mean[RATE], belief.mean[KINKS][0]
    assert 0 < kink < rate < 2e-3
    assert 0 < belief.mean[CURVATURE] < 2e-3 * 7
    assert bend_of(road) == pytest.approx(2e-3 * (25 - KNOTS_M[0]))


@pytest.mark.parametrize(("radius_m", "fastest"), [(24.0, 12.0), (1e9, 70.0)])
def test_nobody_drives_a_hairpin_at_the_speed_of_a_motorway(radius_m, fastest):
    assert fastest_mps(-1 / radius_m, 6.0) == pytest.approx(fastest)
    lane = a_lane(width=3.4, curvature=1 / radius_m)
    assert first_belief(lane, COVARIANCE, None).mean[SPEED] <= fastest
    assert first_belief(lane, COVARIANCE, 20.0).mean[SPEED] == 20.0


@pytest.mark.parametrize("radius_m", [-15.0, 22.0])
def test_round_a_hairpin_the_camera_moves_along_the_lane_that_it_looks_askew_at(radius_m):
    path, speed = 1 / radius_m, 8.0
    lane = a_lane(centre=0.1, width=3.2, heading=lever_m(speed) * path + 0.01, curvature=path)
    belief = first_belief(lane, COVARIANCE, speed)
    belief.mean[AIM] = 0.01
    assert belief.course_rad == pytest.approx(lane[HEADING])
    assert belief.predict(0.04).mean[CENTRE] == pytest.approx(0.1, abs=1e-9)
