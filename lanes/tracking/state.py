"""State of the extended Kalman filter, its transition from frame to frame, and the prediction.

The state has 15 numbers of the lane, as in `lanes.tracking.model`, and four of the car: the curvature of the steered
path, the speed, the pitch at rest between bumps, and the yaw of the camera relative to the direction of motion. None of
the four is measured. They are estimated from the motion of the lane. Where they have no effect on it (the speed,
straight ahead in the lane centre) they stay uncertain.

While the car moves a distance d along its own arc, the lane moves in the car's frame by

    centre + (heading - camera yaw - lever path) d + (curvature - path) d^2 / 2,   heading + (curvature - path) d,
    curvature + rate d.

The lever is the distance of the camera from the rear axle. Only the rear axle moves in the direction of the car's
longitudinal axis; points ahead of it also swing to the inside of the bend. Tyre slip compensates for this with growing
speed.

Reference: R. E. Kalman, "A new approach to linear filtering and prediction problems", 1960.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp

import numpy as np

from lanes.tracking.model import (
    ADJACENT,
    CENTRE,
    CURVATURE,
    HEADING,
    KNOTS_M,
    LIMIT,
    PARAMETERS,
    PITCH,
    PRIOR,
    PRIOR_STD,
    RATE,
    RATE_STEPS,
    VERTICAL_CURVATURE,
    VERTICAL_KNOTS_M,
    WIDTH,
    max_curvature,
)

PATH, SPEED, REST_PITCH, CAMERA_YAW = range(PARAMETERS, PARAMETERS + 4)
STATES = PARAMETERS + 4
LANE, CAR = slice(0, PARAMETERS), slice(PARAMETERS, STATES)
# The rate at the car and its steps at the knots: the curvature in x metres is the sum of their integrals.
RATE_CHAIN = np.array([RATE, *range(PARAMETERS)[RATE_STEPS]])
KNOT_GAPS_M = np.diff(KNOTS_M, prepend=0.0)
VERTICAL_KNOT_GAPS_M = np.diff(VERTICAL_KNOTS_M)
# Decay length of the rate, because transition curves end; tuned on the rendered suite.
RATE_DECAY_M = 150.0
# Decay length of a predicted rate step: its size and position are uncertain before it is measured.
RATE_STEP_DECAY_M = 15.0


@dataclass(frozen=True)
class CarParameters:
    """Cars and their drivers; textbook values of passenger cars where no source is given."""

    # Distance of a camera behind the windscreen from the rear axle, metres.
    lever_m: float = 1.6
    # Tangent speed, 60 to 80 km/h for most cars: with the slip of the rear tyres the whole car points along its path.
    tangent_mps: float = 20.0
    # Speed where it is not given, and its standard deviation; standard deviation of a given speed (clock, speedometer).
    usual_speed_mps: float = 24.0
    usual_speed_std_mps: float = 8.0
    given_speed_std_mps: float = 0.5
    max_speed_mps: float = 70.0
    # Lateral acceleration that drivers accept in bends, and that tyres hold, m/s^2.
    usual_lateral_mps2: float = 3.0
    max_lateral_mps2: float = 6.0
    # Time constant with which the springs return the pitch to rest.
    pitch_relaxation_s: float = 0.3
    # Standard deviation of the pose's pitch and yaw: a quarter of a degree; of a yaw that is wrong: three degrees.
    rest_pitch_std_rad: float = 0.004
    camera_yaw_std_rad: float = 0.004
    wrong_yaw_std_rad: float = 0.05


CAR_PARAMETERS = CarParameters()


@dataclass(frozen=True)
class ProcessNoise:
    """Standard deviations added in one second (`_per_s`) or in one metre of road (`_per_m`); their squares add up.

    A `_share` multiplies a curvature of the road, 1/m. Tuned on the rendered suite where no source is given.
    """

    # Crosswind and banked roads; bumps; slow changes of load and of the camera's mounting.
    centre_m_per_s: float = 0.015
    heading_rad_per_s: float = 0.003
    pitch_rad_per_s: float = 0.01
    rest_pitch_rad_per_s: float = 1e-3
    camera_yaw_rad_per_s: float = 1e-4
    # Steering, on a straight road and in a bend; pedals.
    path_per_m_per_s: float = 1e-3
    path_share_per_s: float = 0.3
    speed_mps_per_s: float = 1.0
    # Varying tyre slip in bends.
    camera_yaw_share_per_s: float = 0.15
    centre_share_per_m: float = 0.3
    # Width of this lane and of the adjacent ones.
    width_m_per_m: float = 0.004
    # Curvature, and its rate: 5e-5 1/m^2 within 70 m on motorways; on mountain roads more, as the square of the
    # curvature (a transition curve is about as long as the radius of its bend allows).
    curvature_per_m_per_m: float = 3e-6
    rate_per_m2_per_m: float = 6e-6
    rate_square_share: float = 1.0
    # Rate steps: small on motorways, up to those of a hairpin where the road bends more.
    rate_step_per_m2_per_m: float = 5e-5
    rate_step_share: float = 0.2
    max_rate_step_per_m2_per_m: float = 4e-3
    # Vertical curvature that comes into view beyond the last knot: base value, growth with the curvature and with the
    # largest vertical curvature of the lane; the maximum is a radius of 170 m, at which cars leave the ground.
    vertical_per_m: float = 3e-4
    vertical_bend_share: float = 0.03
    vertical_share: float = 1.0
    max_vertical_per_m: float = 6e-3
    # Distance over which it is forgotten, and the share of the noise at each knot: at the nearer ones it is known from
    # before, and the noise accounts for the interpolation between knots.
    vertical_decay_m: float = 20.0
    vertical_knot_shares: tuple[float, ...] = (0.3, 0.3, 0.5, 1.0)
    # Extra noise for abrupt changes of vertical curvature, curvature rate and pitch, see `inflate`.
    inflated_vertical_per_m: float = 6e-3
    inflated_rate_step_per_m2: float = 3e-3
    inflated_pitch_rad: float = 0.015
    # Actual variances relative to the assumed ones above: on straight level roads, of the pitch, and of what bends and
    # hills add. Fitted on seeds 0 and 1 of the rendered suite.
    actual_share: float = 0.07
    actual_pitch_share: float = 1.0
    actual_bend_share: float = 3.0


PROCESS_NOISE = ProcessNoise()
_VERTICAL_KNOT_SHARES = np.array(PROCESS_NOISE.vertical_knot_shares)


@dataclass(frozen=True)
class CarMotion:
    """How the car moves in its lane."""

    speed_mps: float
    # Curvature of the path that the car steers, positive left.
    path_per_m: float = 0.0
    # Direction of motion of the camera, seen from it, positive left.
    course_rad: float = 0.0
    # Standard deviations of the lane's curvature minus that of the path, and of the lane's heading minus the course.
    turning_std_per_m: float = 0.0
    course_std_rad: float = 0.0


def lever_m(speed_mps: float) -> float:
    """Distance from the camera back to the point of the car that moves along the car's longitudinal axis."""
    return CAR_PARAMETERS.lever_m * max(0.0, 1 - (speed_mps / CAR_PARAMETERS.tangent_mps) ** 2)


@dataclass(frozen=True, eq=False)
class KalmanState:
    """Mean (19,) of lane and car, and two covariances (19, 19).

    `covariance` is that of the noise that the filter assumes; it sets the gain. `errors` is that of the errors, as in
    `lanes.tracking.error_covariance`.
    """

    mean: np.ndarray
    covariance: np.ndarray
    errors: np.ndarray

    @property
    def lane(self) -> np.ndarray:
        """(15,) mean of the lane parameters."""
        return self.mean[LANE]

    @property
    def lane_covariance(self) -> np.ndarray:
        """(15, 15) covariance of the lane parameters."""
        return self.covariance[LANE, LANE]

    @property
    def lane_errors(self) -> np.ndarray:
        """(15, 15) covariance of the errors of the lane parameters."""
        return self.errors[LANE, LANE]

    @property
    def motion(self) -> CarMotion:
        """Speed, path and course of the car, with standard deviations relative to the lane."""
        path, speed, camera_yaw = self.mean[[PATH, SPEED, CAMERA_YAW]].tolist()
        lever = lever_m(speed)
        return CarMotion(
            speed_mps=speed,
            path_per_m=path,
            course_rad=camera_yaw + lever * path,
            turning_std_per_m=self._std_of_sum({CURVATURE: 1.0, PATH: -1.0}),
            course_std_rad=self._std_of_sum({HEADING: 1.0, CAMERA_YAW: -1.0, PATH: -lever}),
        )

    def _std_of_sum(self, factors: dict[int, float]) -> float:
        """Standard deviation of a sum of state variables times factors."""
        indices, values = list(factors), np.array(list(factors.values()))
        return float(np.sqrt(values @ self.covariance[np.ix_(indices, indices)] @ values))

    def adjacent(self, side: float) -> KalmanState:
        """State of the adjacent lane to the left (+1) or right (-1), which shares a line with this one."""
        there, back = (ADJACENT.start, ADJACENT.start + 1) if side > 0 else (ADJACENT.start + 1, ADJACENT.start)
        jacobian = np.eye(STATES)
        jacobian[CENTRE, WIDTH], jacobian[CENTRE, there] = side, side / 2
        jacobian[WIDTH, there] = 1
        jacobian[[there, back]] = 0
        jacobian[back, there] = -1
        covariance, errors = (jacobian @ matrix @ jacobian.T for matrix in (self.covariance, self.errors))
        covariance[there, there] = errors[there, there] = PRIOR_STD[there] ** 2
        return KalmanState(jacobian @ self.mean, covariance, errors)


def predict(state: KalmanState, elapsed_s: float) -> KalmanState:
    """The state `elapsed_s` seconds later, before the next measurement."""
    mean, jacobian = transition(state.mean, elapsed_s)
    covariance, errors = jacobian @ np.stack([state.covariance, state.errors]) @ jacobian.T
    distance_m = float(state.mean[SPEED]) * elapsed_s
    assumed, actual = process_noise(state.lane, distance_m, elapsed_s)
    covariance.flat[:: STATES + 1] += assumed
    errors.flat[:: STATES + 1] += actual
    return KalmanState(mean, covariance, errors)


def with_given_speed(state: KalmanState, speed_mps: float) -> KalmanState:
    """The state with a speed from elsewhere (clock, speedometer), whose error has nothing to do with the rest."""
    return _with_independent(state, speed_mps, {SPEED: CAR_PARAMETERS.given_speed_std_mps})


def with_unknown_yaw(state: KalmanState) -> KalmanState:
    """The state with the usual speed and any yaw of the camera, whose errors have nothing to do with the rest."""
    stds = {SPEED: CAR_PARAMETERS.usual_speed_std_mps, CAMERA_YAW: CAR_PARAMETERS.wrong_yaw_std_rad}
    return _with_independent(state, CAR_PARAMETERS.usual_speed_mps, stds)


def _with_independent(state: KalmanState, speed_mps: float, stds: dict[int, float]) -> KalmanState:
    """The state with this speed; the variables in `stds` get these standard deviations and no covariances."""
    mean, covariance, errors = state.mean.copy(), state.covariance.copy(), state.errors.copy()
    mean[SPEED] = speed_mps
    for matrix in (covariance, errors):
        for index, std in stds.items():
            matrix[index, :] = matrix[:, index] = 0.0
            matrix[index, index] = std**2
    return KalmanState(mean, covariance, errors)


def inflate(state: KalmanState) -> KalmanState:
    """The same mean with extra variance for abrupt changes of vertical curvature, curvature rate and pitch."""
    covariance = state.covariance.copy()
    diagonal = covariance.reshape(-1)[:: STATES + 1]
    diagonal[VERTICAL_CURVATURE] += PROCESS_NOISE.inflated_vertical_per_m**2
    diagonal[RATE_STEPS] += PROCESS_NOISE.inflated_rate_step_per_m2**2
    diagonal[PITCH] += PROCESS_NOISE.inflated_pitch_rad**2
    return KalmanState(state.mean, covariance, state.errors)


def transition(mean: np.ndarray, elapsed_s: float) -> tuple[np.ndarray, np.ndarray]:
    """State transition: the mean (19,) `elapsed_s` later, and its Jacobian (19, 19)."""
    # Python floats: for single numbers numpy's overhead would dominate
    _, _, heading, curvature, rate, pitch, *_ = mean.tolist()
    path, speed, rest_pitch, camera_yaw = mean[CAR].tolist()
    d, turn, lever = speed * elapsed_s, curvature - path, lever_m(speed)
    slant = heading - camera_yaw - lever * path
    pitch_kept = exp(-elapsed_s / CAR_PARAMETERS.pitch_relaxation_s)
    rates_kept, rates_moved = _rate_transition(d)
    vertical = _vertical_transition(d)

    after = mean.copy()
    after[CENTRE] += slant * d + turn * d * d / 2
    after[HEADING] += turn * d
    after[CURVATURE] += rate * d
    after[RATE_CHAIN] *= rates_kept
    after[RATE_CHAIN[:-1]] += rates_moved * mean[RATE_STEPS]
    after[PITCH] = pitch_kept * pitch + (1 - pitch_kept) * rest_pitch
    after[VERTICAL_CURVATURE] = vertical @ mean[VERTICAL_CURVATURE]
    after[LANE] = np.minimum(np.maximum(after[LANE], -LIMIT), LIMIT)

    jacobian = np.eye(STATES)
    jacobian[CENTRE, HEADING], jacobian[CENTRE, CAMERA_YAW] = d, -d
    jacobian[CENTRE, CURVATURE], jacobian[CENTRE, PATH] = d * d / 2, -d * d / 2 - lever * d
    jacobian[CENTRE, SPEED] = (slant + turn * d) * elapsed_s
    jacobian[HEADING, CURVATURE], jacobian[HEADING, PATH] = d, -d
    jacobian[HEADING, SPEED] = turn * elapsed_s
    jacobian[CURVATURE, RATE], jacobian[CURVATURE, SPEED] = d, rate * elapsed_s
    jacobian[RATE_CHAIN, RATE_CHAIN], jacobian[RATE_CHAIN[:-1], RATE_CHAIN[1:]] = rates_kept, rates_moved
    jacobian[PITCH, PITCH], jacobian[PITCH, REST_PITCH] = pitch_kept, 1 - pitch_kept
    jacobian[VERTICAL_CURVATURE, VERTICAL_CURVATURE] = vertical
    return after, jacobian


def _rate_transition(distance_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Share of rate and rate steps (4,) that stays after driving on, and of the steps (3,) that moves one knot nearer.

    A step comes nearer and is shared by the knots before and behind it; a step at the car becomes part of the rate.
    """
    moved = np.minimum(np.maximum(distance_m / KNOT_GAPS_M, 0), 1)
    rate_decay, step_decay = np.exp(-distance_m / RATE_DECAY_M), np.exp(-distance_m / RATE_STEP_DECAY_M)
    return np.concatenate([[rate_decay], (1 - moved) * step_decay]), moved * rate_decay


def _vertical_transition(distance_m: float) -> np.ndarray:
    """(4, 4) transition of the vertical curvatures: each comes nearer, and the farthest decays.

    The road that comes into view beyond the last knot is unknown.
    """
    moved = np.minimum(np.maximum(distance_m / VERTICAL_KNOT_GAPS_M, 0), 1)
    matrix = np.diag([*(1 - moved), exp(-distance_m / PROCESS_NOISE.vertical_decay_m)])
    np.fill_diagonal(matrix[:, 1:], moved)
    return matrix


def process_noise(lane: np.ndarray, distance_m: float, elapsed_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Variances (19,) that one prediction adds to the state of a lane (15,): the assumed and the actual ones."""
    n, curvature = PROCESS_NOISE, max_curvature(lane)
    assumed = _variances(curvature, max_vertical_curvature(lane), distance_m, elapsed_s)
    straight = _variances(min(curvature, PRIOR.motorway_curvature_per_m), 0.0, distance_m, elapsed_s)
    actual = n.actual_share * straight + n.actual_bend_share * (assumed - straight)
    actual[PITCH] = n.actual_pitch_share * assumed[PITCH]
    return assumed, actual


def _variances(curvature: float, vertical_curvature: float, distance_m: float, elapsed_s: float) -> np.ndarray:
    """(19,) variances that a road with these largest curvatures adds."""
    n = PROCESS_NOISE
    per_s, per_m = np.zeros(STATES), np.zeros(STATES)
    excess = max(curvature - PRIOR.motorway_curvature_per_m, 0.0)
    per_s[CENTRE], per_s[HEADING], per_s[PITCH] = n.centre_m_per_s, n.heading_rad_per_s, n.pitch_rad_per_s
    per_s[REST_PITCH] = n.rest_pitch_rad_per_s
    per_s[CAMERA_YAW] = n.camera_yaw_rad_per_s + n.camera_yaw_share_per_s * excess
    per_s[PATH] = n.path_per_m_per_s + n.path_share_per_s * curvature
    per_s[SPEED] = n.speed_mps_per_s
    per_m[CENTRE] = n.centre_share_per_m * excess
    per_m[WIDTH] = per_m[ADJACENT] = n.width_m_per_m
    per_m[CURVATURE] = n.curvature_per_m_per_m
    per_m[RATE] = n.rate_per_m2_per_m + n.rate_square_share * curvature**2
    per_m[RATE_STEPS] = min(n.rate_step_per_m2_per_m + n.rate_step_share * excess, n.max_rate_step_per_m2_per_m)
    variance = per_s**2 * elapsed_s + per_m**2 * abs(distance_m)
    vertical = n.vertical_per_m + n.vertical_bend_share * excess + n.vertical_share * vertical_curvature
    vertical_std = min(vertical, n.max_vertical_per_m) * _VERTICAL_KNOT_SHARES
    variance[VERTICAL_CURVATURE] = np.square(vertical_std) * (1 - exp(-2 * abs(distance_m) / n.vertical_decay_m))
    return variance


def max_vertical_curvature(lane: np.ndarray) -> float:
    """Largest vertical curvature of the road (15,) in view, 1/m."""
    return float(np.abs(lane[VERTICAL_CURVATURE]).max())
