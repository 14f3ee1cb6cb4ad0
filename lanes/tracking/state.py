"""What is believed about the lane between two frames: how it moves below the car, and how sure that stays.

Nineteen numbers: the fifteen of `lanemodel`, then four of the car: the curvature of the path that it steers, its
speed, the pitch at which it rests between bumps, and its aim, the direction in which it moves as seen from a camera
that may not look quite ahead. While the car moves a distance d along its own arc, the lane moves in the car's frame by

    centre + (heading - aim - lever path) d + (curvature - path) d^2 / 2,   heading + (curvature - path) d,
    curvature + rate d.

The lever is the camera's distance from the rear axle. Only that axle moves where the car points; what lies ahead of it
also swings with the turning car, towards the inside of the bend. Tyres that slip make up for it as the speed grows.

None of the four is measured. They become known from how the lane moves, and where they cannot be (straight on in the
middle of the lane the speed shows in nothing) they stay as uncertain as they were. This is the prediction of an
extended Kalman filter (R. E. Kalman, 1960); `lanes.tracking.update` is its update.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp

import numpy as np

from lanes.tracking.model import (
    ADJACENT,
    CENTRE,
    CURVATURE,
    GENTLE_PER_M,
    HEADING,
    KNOTS_M,
    LIMIT,
    PARAMETERS,
    PITCH,
    PRIOR_STD,
    RATE,
    RATE_STEPS,
    SIDES,
    VERTICAL_CURVATURE,
    VERTICAL_KNOTS_M,
    WIDTH,
    lateral_gradient,
)

PATH, SPEED, REST_PITCH, CAMERA_YAW = range(PARAMETERS, PARAMETERS + 4)
STATES = PARAMETERS + 4
RATE_CHAIN = np.array([RATE, *range(PARAMETERS)[RATE_STEPS]])
KNOT_GAPS_M = np.diff(KNOTS_M, prepend=0.0)
RISE_GAPS_M = np.diff(VERTICAL_KNOTS_M)
LANE, CAR = slice(0, PARAMETERS), slice(PARAMETERS, STATES)
# How far before the rear axle a camera behind the windscreen of a car sits, metres.
LEVER_M = 1.6
# At the tangent speed, 60 to 80 km/h for most cars, rear tyres slip so far outwards that a car points along its way.
TANGENT_MPS = 20.0
# Unless told, the car does what cars on roads do; told, the speed is still a clock's and a speedometer's.
USUAL_SPEED_MPS, USUAL_SPEED_STD_MPS, GIVEN_SPEED_STD_MPS = 24.0, 8.0, 0.5
FASTEST_MPS = 70.0
# Drivers take bends so fast that they are pushed sideways by about this much (m/s^2), and tyres hold little more.
USUAL_PUSH, GREATEST_PUSH = 3.0, 6.0
# Springs bring the pitch back to rest within such a time; the camera pose says where that is, and how the camera looks
# aside, to a quarter of a degree.
SPRING_S, REST_STD_RAD, AIM_STD_RAD = 0.3, 0.004, 0.004
# What the motion does not foretell adds to the standard deviations, in one second: sideways from wind and tilt; heading
# and pitch from bumps; the steering wheel, on a straight road and as a share of the bend; pedals.
CENTRE_PER_S, HEADING_PER_S, PITCH_PER_S, REST_PER_S, AIM_PER_S = 0.015, 0.003, 0.01, 1e-3, 1e-4
PATH_PER_S, PATH_SHARE_PER_S, SPEED_PER_S = 1e-3, 0.3, 1.0
# Tyres slip in bends, more or less: so many radians for each 1/m of bend, and within a metre so many metres.
AIM_SHARE_PER_S, CENTRE_SHARE_PER_M = 0.15, 0.3
# And in one metre of road. Curvature changes at a rate that itself changes: on motorways by 5e-5 1/m^2 within 70 m, on
# mountain roads by more, as the square of the bends that they have (a transition takes about as long as its bend's
# radius allows for).
WIDTH_PER_M, CURVATURE_PER_M = 0.004, 3e-6
RATE_PER_M, RATE_SHARE = 6e-6, 1.0
# Kinks of the same: little on motorways, and up to those of a hairpin where the road bends more than motorways do.
KINK_PER_M, KINK_SHARE, KINK_MOST_PER_M = 5e-5, 0.2, 4e-3
# The road's curvature upwards is new behind the last knot: little on motorways, a little more where the road bends, as
# large as it is now where it waves, and never more than that of a radius of 170 m, at which cars leave the ground. It
# forgets itself in such a distance. At the other knots it is known from before, but for being spread between them.
WAVE_STD_PER_M, WAVE_BEND_SHARE, WAVE_OWN_SHARE, WAVE_MOST_PER_M = 3e-4, 0.03, 1.0, 6e-3
WAVE_M, WAVE_SHARES = 20.0, np.array([0.3, 0.3, 0.5, 1.0])
# What a road may do all at once, and nothing has foretold.
ROUSED_WAVE_PER_M, ROUSED_KINK_PER_M2, ROUSED_PITCH_RAD = 6e-3, 3e-3, 0.015
# A bend that is coming up within such a distance counts like one.
BEND_AHEAD_M = 25.0
# A transition curve ends after some such distance, and its change of curvature with it.
TRANSITION_M = 150.0
# A kink that is foreseen fades sooner: that it is a kink, and where, is not known before it is seen.
KINK_M = 15.0


@dataclass(frozen=True, eq=False)
class KalmanState:
    """Mean (19,) and covariance (19, 19) of lane and car."""

    mean: np.ndarray
    covariance: np.ndarray

    @property
    def lane(self) -> np.ndarray:
        """(15,) parameters of the lane."""
        return self.mean[LANE]

    @property
    def lane_covariance(self) -> np.ndarray:
        """(15, 15)."""
        return self.covariance[LANE, LANE]

    @property
    def course_rad(self) -> float:
        """Direction in which the camera moves, seen from it: its aim, and aside where it swings with a turning car."""
        path, speed, aim = self.mean[[PATH, SPEED, CAMERA_YAW]].tolist()
        return aim + lever_m(speed) * path

    @property
    def turning_std_per_m(self) -> float:
        """Standard deviation of the difference between the lane's curvature and the path's."""
        return self._std({CURVATURE: 1.0, PATH: -1.0})

    @property
    def course_std_rad(self) -> float:
        """Standard deviation of the difference between the lane's heading and the course."""
        return self._std({HEADING: 1.0, CAMERA_YAW: -1.0, PATH: -lever_m(float(self.mean[SPEED]))})

    def _std(self, weights: dict[int, float]) -> float:
        """Standard deviation of a sum of some of the numbers, times their weights."""
        places, factors = list(weights), np.array(list(weights.values()))
        return float(np.sqrt(factors @ self.covariance[np.ix_(places, places)] @ factors))

    def predict(self, elapsed_s: float, *, steady_speed: bool = False) -> KalmanState:
        """The belief `elapsed_s` seconds later, before the next picture is looked at."""
        # Python's numbers one by one: for so few of them numpy's overhead is most of the time
        _, _, heading, curvature, rate, pitch, *_ = self.mean.tolist()
        path, speed, rest, aim = self.mean[CAR].tolist()
        d, turn = speed * elapsed_s, curvature - path
        lever = lever_m(speed)
        slant = heading - aim - lever * path
        mean, jacobian = self.mean.copy(), np.eye(STATES)
        swing = exp(-elapsed_s / SPRING_S)
        kept, nearer = _move_rate_steps(d)
        waves = _move_vertical(d)
        mean[CENTRE] += slant * d + turn * d * d / 2
        mean[HEADING] += turn * d
        mean[CURVATURE] += rate * d
        mean[RATE_CHAIN] *= kept
        mean[RATE_CHAIN[:-1]] += nearer * self.mean[RATE_STEPS]
        mean[PITCH] = swing * pitch + (1 - swing) * rest
        mean[VERTICAL_CURVATURE] = waves @ mean[VERTICAL_CURVATURE]
        jacobian[CENTRE, HEADING], jacobian[CENTRE, CAMERA_YAW] = d, -d
        jacobian[CENTRE, CURVATURE], jacobian[CENTRE, PATH] = d * d / 2, -d * d / 2 - lever * d
        jacobian[HEADING, CURVATURE], jacobian[HEADING, PATH] = d, -d
        jacobian[CURVATURE, RATE] = d
        jacobian[RATE_CHAIN, RATE_CHAIN], jacobian[RATE_CHAIN[:-1], RATE_CHAIN[1:]] = kept, nearer
        jacobian[CENTRE, SPEED] = (slant + turn * d) * elapsed_s
        jacobian[HEADING, SPEED], jacobian[CURVATURE, SPEED] = turn * elapsed_s, rate * elapsed_s
        jacobian[PITCH, PITCH], jacobian[PITCH, REST_PITCH] = swing, 1 - swing
        jacobian[VERTICAL_CURVATURE, VERTICAL_CURVATURE] = waves
        mean[LANE] = np.minimum(np.maximum(mean[LANE], -LIMIT), LIMIT)
        covariance = jacobian @ self.covariance @ jacobian.T
        covariance.flat[:: STATES + 1] += _noise(self.lane, d, elapsed_s, steady_speed)
        return KalmanState(mean, covariance)

    def updated(self, lane: np.ndarray, covariance: np.ndarray) -> KalmanState:
        """The belief after the lane's fifteen numbers turned out as `lane` (15,) with `covariance` (15, 15).

        What the lane tells of the car follows by regression: G = P_cl P_ll^-1 is how the car's numbers move with the
        lane's.
        """
        root = np.linalg.cholesky(self.covariance)
        gain = np.linalg.solve(root[LANE, LANE].T, root[CAR, LANE].T).T
        mean = np.concatenate([lane, self.mean[CAR] + gain @ (lane - self.lane)])
        mean[SPEED] = min(max(mean[SPEED], 0.0), fastest_mps(lane[CURVATURE], GREATEST_PUSH))
        # sums of squares, where differences of what is nearly the same would leave less than nothing
        moved = np.vstack([np.eye(PARAMETERS), gain])
        whole = moved @ ((covariance + covariance.T) / 2) @ moved.T
        whole[CAR, CAR] += root[CAR, CAR] @ root[CAR, CAR].T
        return KalmanState(mean, whole)

    def inflated(self) -> KalmanState:
        """The same belief, prepared for bends, crests, dips and a camera that moves, which nothing has foretold."""
        covariance = self.covariance.copy()
        diagonal = covariance.reshape(-1)[:: STATES + 1]
        diagonal[VERTICAL_CURVATURE] += ROUSED_WAVE_PER_M**2
        diagonal[RATE_STEPS] += ROUSED_KINK_PER_M2**2
        diagonal[PITCH] += ROUSED_PITCH_RAD**2
        return KalmanState(self.mean, covariance)

    def beside(self, side: float) -> KalmanState:
        """The same belief about the neighbouring lane to the left (+1) or right (-1), which shares a line with this."""
        there, back = (ADJACENT.start, ADJACENT.start + 1) if side > 0 else (ADJACENT.start + 1, ADJACENT.start)
        jacobian = np.eye(STATES)
        jacobian[CENTRE, WIDTH], jacobian[CENTRE, there] = side, side / 2
        jacobian[WIDTH, there] = 1
        jacobian[[there, back]] = 0
        jacobian[back, there] = -1
        covariance = jacobian @ self.covariance @ jacobian.T
        covariance[there, there] = PRIOR_STD[there] ** 2
        return KalmanState(jacobian @ self.mean, covariance)

    def lateral_std_m(self, x_m: float) -> float:
        """Standard deviation of the worse line's lateral place `x_m` ahead."""
        gradients = [lateral_gradient(x_m, side) for side in SIDES]
        return float(np.sqrt(max(g @ self.lane_covariance @ g for g in gradients)))


def lever_m(speed_mps: float) -> float:
    """How far behind the camera the point of the car is that moves where the car points."""
    return LEVER_M * max(0.0, 1 - (speed_mps / TANGENT_MPS) ** 2)


def fastest_mps(curvature_per_m: float, push: float) -> float:
    """How fast a bend can be driven if that pushes by `push` (m/s^2) sideways: v^2 k = push."""
    return float(np.sqrt(push / max(abs(curvature_per_m), push / FASTEST_MPS**2)))


def _move_rate_steps(distance_m: float) -> tuple[np.ndarray, np.ndarray]:
    """What is kept of rate and kinks (4,) after the car has driven on, and what of kinks (3,) goes to the one before.

    Each kink comes nearer and is shared by the knots before and behind it; the rate is the kink at the car. All fade,
    because transitions end.
    """
    share = np.minimum(np.maximum(distance_m / KNOT_GAPS_M, 0), 1)
    fading, forgetting = np.exp(-distance_m / TRANSITION_M), np.exp(-distance_m / KINK_M)
    return np.concatenate([[fading], (1 - share) * forgetting]), share * fading


def _move_vertical(distance_m: float) -> np.ndarray:
    """(4, 4): what becomes of the road's curvature upwards when the car drives on: what is ahead comes nearer.

    What comes into view behind the last knot is not known; there the curvature fades.
    """
    share = np.minimum(np.maximum(distance_m / RISE_GAPS_M, 0), 1)
    waves = np.diag([*(1 - share), exp(-distance_m / WAVE_M)])
    np.fill_diagonal(waves[:, 1:], share)
    return waves


def sharpest_bend(lane: np.ndarray) -> float:
    """How much the road bends here or soon, 1/m: what the changes to be expected are in proportion to."""
    ahead = BEND_AHEAD_M - np.concatenate([[0.0], KNOTS_M])
    return float(max(abs(lane[CURVATURE]), abs(lane[CURVATURE] + np.maximum(ahead, 0) @ lane[RATE_CHAIN])))


def largest_vertical(lane: np.ndarray) -> float:
    """How much the road bends up or down anywhere in sight, 1/m: what waves are to be expected in proportion to."""
    return float(np.abs(lane[VERTICAL_CURVATURE]).max())


def _noise(lane: np.ndarray, distance_m: float, elapsed_s: float, steady_speed: bool) -> np.ndarray:
    """(19,) variances that one step adds."""
    per_s, per_m = np.zeros(STATES), np.zeros(STATES)
    bend = sharpest_bend(lane)
    sharp = max(bend - GENTLE_PER_M, 0.0)
    per_s[[CENTRE, HEADING, PITCH, REST_PITCH]] = CENTRE_PER_S, HEADING_PER_S, PITCH_PER_S, REST_PER_S
    per_s[CAMERA_YAW] = AIM_PER_S + AIM_SHARE_PER_S * sharp
    per_m[CENTRE] = CENTRE_SHARE_PER_M * sharp
    per_s[PATH] = PATH_PER_S + PATH_SHARE_PER_S * bend
    per_s[SPEED] = 0.0 if steady_speed else SPEED_PER_S
    per_m[WIDTH] = per_m[ADJACENT] = WIDTH_PER_M
    per_m[CURVATURE], per_m[RATE] = CURVATURE_PER_M, RATE_PER_M + RATE_SHARE * bend**2
    per_m[RATE_STEPS] = min(KINK_PER_M + KINK_SHARE * sharp, KINK_MOST_PER_M)
    variance = per_s**2 * elapsed_s + per_m**2 * abs(distance_m)
    wave = min(WAVE_STD_PER_M + WAVE_BEND_SHARE * sharp + WAVE_OWN_SHARE * largest_vertical(lane), WAVE_MOST_PER_M)
    variance[VERTICAL_CURVATURE] = np.square(wave * WAVE_SHARES) * (1 - exp(-2 * abs(distance_m) / WAVE_M))
    return variance
