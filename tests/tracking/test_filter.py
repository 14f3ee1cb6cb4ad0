"""Prediction and update of the filter, against roads driven exactly and with synthetic
stripes.
"""

from __future__ import annotations

import numpy as np
import pytest

from lanes.detect.road import (
    ADJACENT,
    CENTRE,
    CURVATURE,
    HEADING,
    PITCH,
    RATE,
    VERTICAL_CURVATURE,
    WIDTH,
    RoadPrior,
)
from lanes.tracking.filter import (
    CAMERA_YAW,
    LANE,
    PATH,
    REST_PITCH,
    SPEED,
    FilterSettings,
    State,
    car_motion,
    initial_state,
    predict,
    to_adjacent_lane,
    transition,
    update,
)
from simulator.road.geometry import RoadGeometry, VehiclePose
from simulator.road.truth import lane_truth
from tests.support.shapes import a_lane

SETTINGS = FilterSettings()
SMALL = dict(rate=1e-5, pitch=0.005, vertical=1e-4, rate_steps=1e-5, adjacent=0.1)
COVARIANCE = np.diag(
    np.square(a_lane(centre=0.1, width=0.1, heading=0.01, curvature=1e-3, **SMALL))
)
LANE_BEFORE = a_lane(
    centre=0.3, width=3.6, heading=0.02, curvature=2e-3, rate=1e-5, pitch=0.004
)


def state_with(**car: float) -> State:
    estimate = initial_state(LANE_BEFORE, COVARIANCE, 20.0, SETTINGS)
    places = {"path": PATH, "speed": SPEED, "rest": REST_PITCH, "yaw": CAMERA_YAW}
    for name, value in car.items():
        estimate.mean[places[name]] = value
    return estimate


def std_of(estimate: State) -> np.ndarray:
    return np.sqrt(np.diag(estimate.covariance))


def test_straight_driving_along_a_bend():
    """A car that drives straight on: the lane turns and moves below it as geometry
    says.
    """
    road = RoadGeometry([0.0, 1000.0], [1 / 400, 1 / 400])
    before = lane_truth(
        road, VehiclePose(100.0, 0.2, -0.01), (1.8, -1.8), time_s=0, pitch_rad=0
    )
    lane = a_lane(centre=-0.2, width=3.6, heading=before.heading_rad, curvature=1 / 400)
    estimate = initial_state(lane, COVARIANCE, 20.0, SETTINGS)
    estimate.mean[PATH] = 0.0
    after = predict(estimate, 0.1, SETTINGS).mean
    # two metres on: its heading relative to the road changes by 2 / 400, its lateral
    # place by the integral of it
    assert after[HEADING] == pytest.approx(before.heading_rad + 2 / 400, abs=1e-6)
    assert after[CENTRE] == pytest.approx(
        -0.2 + 2 * before.heading_rad + 2**2 / 400 / 2, abs=1e-6
    )


# The rear axle stays on its circle: the camera runs at lever / radius to the road. At
# motorway speed tyre slip turns the whole car along the road.
@pytest.mark.parametrize(("speed_mps", "lever_m"), [(2.0, 1.6), (25.0, 0.0)])
class TestCameraOfACarInABend:
    @pytest.fixture
    def estimate(self, speed_mps, lever_m) -> State:
        lane = a_lane(centre=0.3, width=3.6, heading=lever_m / 20, curvature=1 / 20)
        return initial_state(lane, COVARIANCE, speed_mps, SETTINGS)

    def test_keeps_its_place_in_the_lane(self, estimate):
        assert predict(estimate, 0.04, SETTINGS).mean[CENTRE] == pytest.approx(
            0.3, abs=1e-3
        )

    def test_has_its_angle_in_the_course(self, estimate, lever_m):
        """Errors of heading and path that compensate each other do not make it
        uncertain.
        """
        errors = np.zeros(len(estimate.mean))
        errors[[HEADING, PATH]] = lever_m, 1
        mean = estimate.mean.copy()
        mean[CAMERA_YAW] += 0.1
        motion = car_motion(State(mean, np.outer(errors, errors)), SETTINGS)
        assert motion.course_rad == pytest.approx(0.1 + lever_m / 20, abs=0.02)
        assert motion.course_std_rad == pytest.approx(0.0, abs=0.02)


def test_a_car_begins_at_rest_on_its_springs():
    assert state_with().mean[REST_PITCH] == LANE_BEFORE[PITCH]


def test_the_springs_return_the_pitch_to_rest():
    after = predict(state_with(rest=0.0), 0.1, SETTINGS).mean
    assert 0 < after[PITCH] < LANE_BEFORE[PITCH]


def test_the_yaw_of_the_camera_moves_no_lane():
    """The car drives along its lane, which the camera sees turned."""
    after = predict(state_with(path=2e-3, yaw=0.02), 0.1, SETTINGS).mean
    assert after[WIDTH] == 3.6
    assert after[CENTRE] == pytest.approx(0.3, abs=1e-9)


def test_the_curvature_changes_by_its_rate_times_the_distance():
    after = predict(state_with(), 0.1, SETTINGS).mean
    assert after[CURVATURE] == pytest.approx(2e-3 + 1e-5 * 2)


@pytest.mark.parametrize("side", [1, -1])
def test_a_track_begins_no_faster_than_its_bend_allows(side):
    lane = a_lane(curvature=side / 24)
    assert initial_state(lane, COVARIANCE, None, SETTINGS).mean[SPEED] <= 12.0


def test_uncertainty_grows_with_time():
    estimate = state_with()
    later = predict(estimate, 0.04, SETTINGS)
    assert (std_of(later)[:3] > std_of(estimate)[:3]).all()
    np.testing.assert_allclose(later.covariance, later.covariance.T, atol=1e-15)


@pytest.mark.parametrize("number", [WIDTH, CURVATURE, RATE])
def test_a_standing_car_keeps_the_road(number):
    standing = predict(state_with(speed=0.0), 0.04, SETTINGS)
    assert std_of(standing)[number] == pytest.approx(std_of(state_with())[number])


def test_a_given_speed_is_as_uncertain_as_the_settings_say():
    settings = FilterSettings(given_speed_std_mps=3.0)
    after = predict(state_with(), 0.04, settings, speed_mps=21.0)
    assert after.mean[SPEED] == 21.0
    assert std_of(after)[SPEED] == pytest.approx(3.0)


@pytest.mark.parametrize("side", [1, -1])
def test_a_bend_of_24_m_is_driven_with_12_m_per_s_at_most(side):
    """6 m/s^2 across, which cars do not exceed, although 20 m/s was predicted."""
    predicted = state_with(speed=20.0)
    lane = predicted.lane.copy()
    lane[CURVATURE] = side / 24
    assert update(predicted, lane, COVARIANCE, SETTINGS).mean[SPEED] == pytest.approx(
        12.0
    )


def test_update_equals_the_textbook_kalman_update():
    """Against the textbook's formula, with a measurement of the centre alone."""
    estimate = predict(state_with(), 0.2, SETTINGS)
    h = np.zeros(len(estimate.mean))
    h[CENTRE] = 1
    s = h @ estimate.covariance @ h + 0.05**2
    gain = estimate.covariance @ h / s
    mean = estimate.mean + gain * 0.1
    covariance = estimate.covariance - np.outer(gain, gain) * s
    updated = update(estimate, mean[LANE], covariance[LANE, LANE], SETTINGS)
    np.testing.assert_allclose(updated.mean, mean, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(updated.covariance, covariance, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("side", [1.0, -1.0])
class TestAdjacentLane:
    """The lane to the left is 0.3 m wider, that to the right 0.2 m narrower."""

    @pytest.fixture
    def estimate(self) -> State:
        estimate = state_with()
        estimate.mean[ADJACENT] = 0.3, -0.2
        return estimate

    @pytest.fixture
    def there(self, estimate, side) -> State:
        return to_adjacent_lane(estimate, side, RoadPrior())

    def test_has_its_own_width_and_place(self, there, side):
        wider_m = 0.3 if side > 0 else -0.2
        assert there.mean[WIDTH] == pytest.approx(3.6 + wider_m)
        centre_m = 0.3 + side * (3.6 + wider_m / 2)
        assert there.mean[CENTRE] == pytest.approx(centre_m)

    def test_the_way_back_restores_centre_and_width(self, estimate, there, side):
        back = to_adjacent_lane(there, -side, RoadPrior())
        both = [CENTRE, WIDTH]
        np.testing.assert_allclose(back.mean[both], estimate.mean[both])
        np.testing.assert_allclose(std_of(back)[both], std_of(estimate)[both])

    def test_the_lane_beyond_it_is_as_unknown_as_any(self, there):
        _, std_m, _ = RoadPrior().adjacent_m
        assert std_of(there)[ADJACENT].max() == pytest.approx(std_m)


@pytest.mark.parametrize("curvature", [0.0, 1 / 40])
def test_the_noise_is_the_same_for_any_frame_rate(curvature):
    """Half a second without a measurement, in one step or in 30: noise is added per
    second and per metre.
    """
    lane = a_lane(centre=0.2, width=3.6, heading=curvature / 10, curvature=curvature)
    start = initial_state(
        lane,
        np.diag(np.square(a_lane(centre=1e-3, width=1e-3, heading=1e-5))),
        15.0,
        SETTINGS,
    )
    once = predict(start, 0.5, SETTINGS)
    often = start
    for _ in range(30):
        often = predict(often, 0.5 / 30, SETTINGS)
    numbers = [
        WIDTH,
        PATH,
        SPEED,
        REST_PITCH,
        CAMERA_YAW,
        *range(len(start.mean))[ADJACENT],
    ]
    np.testing.assert_allclose(
        np.diag(often.covariance)[numbers], np.diag(once.covariance)[numbers], rtol=0.02
    )


def test_the_jacobian_of_the_transition():
    lane = a_lane(
        centre=0.2,
        heading=0.02,
        curvature=2e-3,
        rate=1e-4,
        pitch=0.004,
        rate_steps=2e-4,
        adjacent=0.1,
    )
    lane[VERTICAL_CURVATURE] = 2e-3, -5e-3, 4e-3, -1e-3
    mean = initial_state(lane, COVARIANCE, 14.0, SETTINGS).mean
    mean[[PATH, REST_PITCH, CAMERA_YAW]] = 1e-3, 2e-3, -3e-3
    steps = np.eye(len(mean)) * 1e-6
    differences = [
        transition(mean + s, 0.2, SETTINGS)[0] - transition(mean - s, 0.2, SETTINGS)[0]
        for s in steps
    ]
    found = transition(mean, 0.2, SETTINGS)[1]
    expected = np.transpose(differences) / 2e-6
    std = np.sqrt(np.diag(initial_state(lane, COVARIANCE, 14.0, SETTINGS).covariance))
    # how the decay of rate steps and vertical curvatures depends on the speed is left
    # out: it is small beside the noise
    kept = np.ones(len(mean), bool)
    kept[SPEED] = False
    scale = std / std[:, None]
    np.testing.assert_allclose(
        (found * scale)[:, kept], (expected * scale)[:, kept], atol=1e-5
    )
    np.testing.assert_allclose(found[:4, SPEED], expected[:4, SPEED], atol=1e-6)
