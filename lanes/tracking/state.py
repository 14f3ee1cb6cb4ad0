"""State of the extended Kalman filter, its transition from frame to frame, and the prediction.

The state has 19 numbers: the 15 of `lanes.tracking.model` and the four of `lanes.tracking.car`. While the car moves a
distance d along its own arc, the lane moves in the car's frame by

    centre + (heading - camera yaw - lever path) d + (curvature - path) d^2 / 2,   heading + (curvature - path) d,
    curvature + rate d.

The lever is the distance of the camera from the rear axle. Only the rear axle moves in the direction of the car's
longitudinal axis; points ahead of it also swing to the inside of the bend. Tyre slip compensates for this with growing
speed.

References: R. E. Kalman, "A new approach to linear filtering and prediction problems", 1960. The measurement update is
in `lanes.tracking.update`.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp

import numpy as np

from lanes.tracking.car import (
    CAMERA_YAW,
    CAR,
    CAR_PARAMETERS,
    LANE,
    PATH,
    REST_PITCH,
    SPEED,
    STATES,
    CarMotion,
    lever_m,
)
from lanes.tracking.model import (
    ADJACENT,
    CENTRE,
    CURVATURE,
    HEADING,
    KNOTS_M,
    LIMIT,
    PITCH,
    PRIOR_STD,
    RATE,
    RATE_STEPS,
    VERTICAL_CURVATURE,
    VERTICAL_KNOTS_M,
    WIDTH,
)
from lanes.tracking.process_noise import PROCESS_NOISE, RATE_CHAIN, process_noise

KNOT_GAPS_M = np.diff(KNOTS_M, prepend=0.0)
VERTICAL_KNOT_GAPS_M = np.diff(VERTICAL_KNOTS_M)
# Decay length of the rate, because transition curves end; tuned on the rendered suite.
RATE_DECAY_M = 150.0
# Decay length of a predicted rate step: its size and position are uncertain before it is measured.
RATE_STEP_DECAY_M = 15.0


@dataclass(frozen=True, eq=False)
class KalmanState:
    """Mean (19,) and covariance (19, 19) of lane and car."""

    mean: np.ndarray
    covariance: np.ndarray

    @property
    def lane(self) -> np.ndarray:
        """(15,) mean of the lane parameters."""
        return self.mean[LANE]

    @property
    def lane_covariance(self) -> np.ndarray:
        """(15, 15) covariance of the lane parameters."""
        return self.covariance[LANE, LANE]

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

    def predict(self, elapsed_s: float, *, steady_speed: bool = False) -> KalmanState:
        """The state `elapsed_s` seconds later, before the next measurement; `steady_speed`: the speed is given."""
        mean, jacobian = transition(self.mean, elapsed_s)
        covariance = jacobian @ self.covariance @ jacobian.T
        distance_m = float(self.mean[SPEED]) * elapsed_s
        noise = process_noise(self.lane, distance_m, elapsed_s, steady_speed=steady_speed)
        covariance.flat[:: STATES + 1] += noise
        return KalmanState(mean, covariance)

    def inflated(self) -> KalmanState:
        """The same mean with extra variance for abrupt changes of vertical curvature, curvature rate and pitch."""
        covariance = self.covariance.copy()
        diagonal = covariance.reshape(-1)[:: STATES + 1]
        diagonal[VERTICAL_CURVATURE] += PROCESS_NOISE.inflated_vertical_per_m**2
        diagonal[RATE_STEPS] += PROCESS_NOISE.inflated_rate_step_per_m2**2
        diagonal[PITCH] += PROCESS_NOISE.inflated_pitch_rad**2
        return KalmanState(self.mean, covariance)

    def adjacent(self, side: float) -> KalmanState:
        """State of the adjacent lane to the left (+1) or right (-1), which shares a line with this one."""
        there, back = (ADJACENT.start, ADJACENT.start + 1) if side > 0 else (ADJACENT.start + 1, ADJACENT.start)
        jacobian = np.eye(STATES)
        jacobian[CENTRE, WIDTH], jacobian[CENTRE, there] = side, side / 2
        jacobian[WIDTH, there] = 1
        jacobian[[there, back]] = 0
        jacobian[back, there] = -1
        covariance = jacobian @ self.covariance @ jacobian.T
        covariance[there, there] = PRIOR_STD[there] ** 2
        return KalmanState(jacobian @ self.mean, covariance)


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
