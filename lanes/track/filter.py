"""State of the extended Kalman filter, its transition from frame to frame, and the prediction.

The state has 15 numbers of the lane, as in `lanes.detect.road`, and four of the car: the curvature of the steered
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

from dataclasses import dataclass, replace
from math import exp

import numpy as np

from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.error_covariance import ResidualStatistics, split_gain
from lanes.detect.fit import FIT, LaneFit, fit_lanes, fit_near
from lanes.detect.lane import Lane, LineObservation, Observations
from lanes.detect.paint import FrameEvidence, Stripes
from lanes.detect.road import (
    ADJACENT,
    CENTRE,
    CURVATURE,
    HEADING,
    KNOTS_M,
    LEFT_SIDE,
    LIMIT,
    PARAMETERS,
    PITCH,
    PRIOR,
    PRIOR_STD,
    RATE,
    RATE_STEPS,
    RIGHT_SIDE,
    VERTICAL_CURVATURE,
    VERTICAL_KNOTS_M,
    WIDTH,
    lateral_std_m,
    max_curvature,
    score_lanes,
)
from lanes.detect.search import inner_stripe_shift, observe_lines

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
    `lanes.detect.error_covariance`.
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


# A track, what is known of the lane from frame to frame, and its update with the evidence of the next frame.
#
# Measurement update of the extended Kalman filter: each stripe measures its distance from the nearest predicted line.
# Stripes are weighted as in the fit of a single picture, with the prediction as prior, and weighted again by their
# distance from the updated lane. The weights make a gate unnecessary: the accuracy of the suite is the same with one
# (docs/ablation.md).


@dataclass(frozen=True)
class UpdateParameters:
    """Fits, and when a track is seen and certain and its lane changes; tuned on the rendered suite."""

    # On roads with larger curvature or vertical curvature than this, every frame may be fitted outwards.
    min_curvature_per_m: float = 5e-3
    min_vertical_per_m: float = 1e-3
    # Weight of stripes that a fit with inflated covariance must explain in addition, because it is less constrained.
    inflated_gain: float = 3.0
    # Standard deviation of the first path curvature, as a share of the road's curvature.
    path_share: float = 0.3
    # Smallest sum of both lines' supports of a lane that is seen.
    min_total_support: float = 0.06
    # Largest standard deviation of a line at this distance while the lane is not seen.
    max_std_m: float = 0.4
    max_std_at_m: float = 15.0
    # A smaller speed than this, with a larger heading, on a smooth road: the filter explains a wrong yaw by a car that
    # hardly moves.
    standing_mps: float = 9.0
    standing_heading_rad: float = 0.02
    # Distance of the car's centre beyond a line at which the adjacent lane becomes the ego lane; a hysteresis.
    lane_change_m: float = 0.1


UPDATE = UpdateParameters()


@dataclass(frozen=True, eq=False)
class Track:
    """The lane after a frame."""

    # It follows the centres of double lines.
    estimate: KalmanState
    # The estimate in metres; double lines are bounded by their inner stripes.
    lane: Lane
    residuals: ResidualStatistics = ResidualStatistics()

    @property
    def certain(self) -> bool:
        """Whether the lines are known well enough without detection."""
        return lateral_std_m(self.estimate.lane_covariance, UPDATE.max_std_at_m).max() <= UPDATE.max_std_m

    @property
    def seen(self) -> bool:
        """Whether the lane was seen in the frame."""
        return total_support(self.lane.observations) >= UPDATE.min_total_support


def start_track(lane: Lane, speed_mps: float | None) -> Track:
    """The track of a detected lane, for a car of given or usual speed."""
    estimate = initial_state(lane.centres, lane.assumed_covariance * FIT.variance_inflation, speed_mps)
    estimate.errors[LANE, LANE] = lane.covariance
    return Track(estimate, lane)


def update_track(
    track: Track,
    evidence: FrameEvidence,
    *,
    elapsed_s: float,
    speed_mps: float | None,
    outwards: bool,
    profiles_of: tuple[int, ...],
) -> Track:
    """The track `elapsed_s` seconds later, with the evidence of the next frame: predict, update, observe the lines.

    `speed_mps` is the car's speed, if it is given. `outwards` is passed to `update_lane`, and `profiles_of` to
    `observe_lines`.
    """
    predicted = predict(track.estimate, elapsed_s)
    if speed_mps is not None:
        predicted = with_given_speed(predicted, speed_mps)
    fit = update_lane(evidence.stripes, predicted, evidence.view, outwards=outwards)
    residuals = track.residuals.add(fit, elapsed_s=elapsed_s)
    estimate = update_state(
        predicted,
        fit.lane[0],
        fit.covariance[0],
        prior_information=fit.prior[0],
        noise_factor=residuals.effective_variance / FIT.variance_inflation,
    )
    if speed_mps is None and _seems_to_stand(estimate):
        estimate = with_unknown_yaw(estimate)
    observations = _observe(track, fit, evidence, float(estimate.mean[SPEED]) * elapsed_s, profiles_of)
    estimate, observations = to_ego_lane(estimate, observations)
    # single lines are not shifted: the filter estimates their centres better than one profile does
    model = estimate.lane + inner_stripe_shift([line.double_profile for line in observations])
    support = np.array([[line.support for line in observations]])
    score = float(score_lanes(estimate.lane[None], support)[0])
    lane = Lane(
        model=model,
        centres=estimate.lane,
        covariance=estimate.lane_errors,
        assumed_covariance=estimate.lane_covariance,
        observations=observations,
        score=score,
        explained_share=float(fit.explained_share[0]),
        camera_yaw_rad=float(estimate.mean[CAMERA_YAW]),
    )
    return Track(estimate, lane, residuals)


def _seems_to_stand(estimate: KalmanState) -> bool:
    """Whether a car on a smooth road seems to point away from it and hardly to move: the yaw of the pose is wrong."""
    points_away = abs(estimate.lane[HEADING]) > UPDATE.standing_heading_rad
    smooth = max_curvature(estimate.lane) < UPDATE.min_curvature_per_m
    return points_away and smooth and float(estimate.mean[SPEED]) < UPDATE.standing_mps


def _observe(
    track: Track, fit: LaneFit, evidence: FrameEvidence, distance_m: float, profiles_of: tuple[int, ...]
) -> Observations:
    """What both lines show in this frame; if the lane is not seen, what they showed `distance_m` before."""
    seen = observe_lines(fit, evidence, track.lane.observations, profiles_of=profiles_of)
    if total_support(seen) < UPDATE.min_total_support:
        left, right = track.lane.observations
        seen = (left.coast(distance_m, vote=0 in profiles_of), right.coast(distance_m, vote=1 in profiles_of))
    left, right = (
        replace(line, votes=line.votes.add_gaps(evidence.stripes.x_m[members]))
        for line, members in zip(seen, fit.members[0], strict=True)
    )
    return left, right


def total_support(observations: Observations) -> float:
    """Sum of both lines' supports."""
    return observations[0].support + observations[1].support


def to_ego_lane(estimate: KalmanState, observations: Observations) -> tuple[KalmanState, Observations]:
    """After the car's centre has crossed a line: the adjacent lane, whose lines swap names; else unchanged."""
    lane, (left, right) = estimate.lane, observations
    if abs(lane[CENTRE]) < lane[WIDTH] / 2 + UPDATE.lane_change_m:
        return estimate, observations
    if lane[CENTRE] < 0:
        return estimate.adjacent(LEFT_SIDE), (LineObservation(), left)
    return estimate.adjacent(RIGHT_SIDE), (right, LineObservation())


def update_lane(stripes: Stripes, estimate: KalmanState, view: BirdsEyeView, *, outwards: bool = True) -> LaneFit:
    """The lane after the measurement update.

    If the fit near the prediction leaves many stripes nearby unexplained, the lane is also fitted outwards from the
    car, as in a single picture: what begins ahead (a bend, a crest) leaves the prediction by more than any standard
    deviation. The fit that explains more stripes is taken. If that is still not enough, the covariance is inflated for
    abrupt changes.

    On a smooth road that is done only if `outwards`. The fit has one lane (1, 15). Its information is the inverse of
    the updated covariance, and stripes far from the lines have little weight.
    """
    near = fit_near(stripes, estimate.lane, estimate.lane_covariance, view)
    enough = near.nearby_weight[0] - FIT.max_unexplained
    curved = max_curvature(estimate.lane) >= UPDATE.min_curvature_per_m
    smooth = not curved and max_vertical_curvature(estimate.lane) < UPDATE.min_vertical_per_m
    if (smooth and not outwards) or near.explained[0] > enough:
        return near
    attempts = (
        (estimate, FIT.extend if smooth else FIT.outwards, 0.0),
        (inflate(estimate), FIT.outwards, UPDATE.inflated_gain),
    )
    best = near
    for prior, schedule, gain in attempts:
        fit = fit_lanes(
            prior.lane[None],
            stripes,
            view,
            prior_mean=prior.lane,
            prior_information=np.linalg.inv(prior.lane_covariance),
            schedule=schedule,
            variance_inflation=FIT.variance_inflation,
        )
        if fit.explained[0] > best.explained[0] + gain:
            best = fit
        if best.explained[0] > enough:
            break
    return best


def update_state(
    estimate: KalmanState,
    lane: np.ndarray,
    covariance: np.ndarray,
    *,
    prior_information: np.ndarray | None = None,
    noise_factor: float = 1.0,
) -> KalmanState:
    """The predicted state conditioned on the updated lane (15,) with covariance (15, 15).

    The car follows by regression on the lane, with gain G = P_cl P_ll^-1. `prior_information` is the inverse covariance
    of the prediction in the update, if it is not that of the estimate. `noise_factor` is the variance of the
    measurements, relative to the one that the update assumes.
    """
    root = np.linalg.cholesky(estimate.covariance)
    gain = np.linalg.solve(root[LANE, LANE].T, root[CAR, LANE].T).T
    mean = np.concatenate([lane, estimate.mean[CAR] + gain @ (lane - estimate.lane)])
    mean[SPEED] = min(max(mean[SPEED], 0.0), max_speed_mps(lane[CURVATURE], CAR_PARAMETERS.max_lateral_mps2))
    # sums of squares, because differences of nearly equal matrices may lose positive definiteness
    regression = np.vstack([np.eye(PARAMETERS), gain])
    updated = regression @ ((covariance + covariance.T) / 2) @ regression.T
    updated[CAR, CAR] += root[CAR, CAR] @ root[CAR, CAR].T
    if prior_information is None:
        prior_information = np.linalg.inv(estimate.lane_covariance)
    kept_lane, measured = split_gain(covariance, prior_information)
    kept = np.eye(STATES)
    kept[:, LANE] -= regression @ (np.eye(PARAMETERS) - kept_lane)
    errors = kept @ estimate.errors @ kept.T + regression @ (noise_factor * measured) @ regression.T
    return KalmanState(mean, updated, errors)


def initial_state(lane: np.ndarray, covariance: np.ndarray, speed_mps: float | None) -> KalmanState:
    """The state after a first detection (15,), (15, 15): the car follows the road at the given or the usual speed."""
    path_std = np.hypot(PROCESS_NOISE.path_per_m_per_s, UPDATE.path_share * lane[CURVATURE])
    speed, speed_std = speed_mps, CAR_PARAMETERS.given_speed_std_mps
    if speed_mps is None:
        usual = CAR_PARAMETERS.usual_speed_mps
        speed = min(usual, max_speed_mps(lane[CURVATURE], CAR_PARAMETERS.usual_lateral_mps2))
        speed_std = CAR_PARAMETERS.usual_speed_std_mps * speed / usual
    full = np.zeros((STATES, STATES))
    full[LANE, LANE] = covariance
    car = [PATH, SPEED, REST_PITCH, CAMERA_YAW]
    stds = [path_std, speed_std, CAR_PARAMETERS.rest_pitch_std_rad, CAR_PARAMETERS.camera_yaw_std_rad]
    full[car, car] = np.square(stds)
    return KalmanState(np.concatenate([lane, [lane[CURVATURE], speed, 0.0, 0.0]]), full, full.copy())


def max_speed_mps(curvature_per_m: float, lateral_mps2: float) -> float:
    """Speed at which a bend causes this lateral acceleration, v^2 k; at most `CAR_PARAMETERS.max_speed_mps`."""
    min_curvature = lateral_mps2 / CAR_PARAMETERS.max_speed_mps**2
    return float(np.sqrt(lateral_mps2 / max(abs(curvature_per_m), min_curvature)))
