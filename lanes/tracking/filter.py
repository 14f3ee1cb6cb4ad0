"""Extended Kalman filter of the lane: state, prediction, measurement update.

The state has 15 numbers of the lane, as in `lanes.detect.road`, and four of the car:
the curvature of the steered path, the speed, the pitch at rest between bumps, and the
yaw of the camera relative to the direction of motion. None of the four is measured.
They are estimated from the motion of the lane. Where they have no effect on it (the
speed, straight ahead in the lane centre) they stay uncertain.

While the car moves a distance d along its own arc, the lane moves in the car's frame by

    centre + (heading - course) d + (curvature - path) d^2 / 2,   heading + (curvature -
    path) d,   curvature + rate d.

The course, seen from the camera, is camera yaw + lever path. The lever is the distance
of the camera from the point of the car that moves along the car's axis. That is the
rear axle, or, with the slip of the tyres at a higher speed, a point nearer to the
camera.

The measurement is a fit with the prediction as prior (`lanes.detect.fit`): each stripe
measures its distance from the nearest predicted line. Its weights reject outliers, so
there is no gate.

Reference: R. E. Kalman, "A new approach to linear filtering and prediction problems",
1960.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp

import numpy as np

from lanes.car import CarMotion
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.evidence import Stripes
from lanes.detect.fit import (
    Fit,
    FitSettings,
    fit_lanes,
    fit_near_prediction,
    predicted_prior,
)
from lanes.detect.road import (
    ADJACENT,
    CENTRE,
    CURVATURE,
    HEADING,
    KNOTS_M,
    MOTORWAY_CURVATURE_PER_M,
    PARAMETERS,
    PITCH,
    RATE,
    RATE_STEPS,
    VERTICAL_CURVATURE,
    VERTICAL_KNOTS_M,
    WIDTH,
    RoadPrior,
    adjacent_lane_matrix,
    max_curvature,
    max_vertical_curvature,
    propagated_std,
)

PATH, SPEED, REST_PITCH, CAMERA_YAW = range(PARAMETERS, PARAMETERS + 4)
STATES = PARAMETERS + 4
LANE = slice(0, PARAMETERS)
CAR = slice(PARAMETERS, STATES)
# The rate at the car and its steps at the knots: the curvature in x metres is the sum
# of their integrals.
RATE_CHAIN = np.array([RATE, 10, 11, 12])
KNOT_GAPS_M = np.diff(KNOTS_M, prepend=0.0)
VERTICAL_KNOT_GAPS_M = np.diff(VERTICAL_KNOTS_M)
# Above the speed of any car on a road.
MAX_SPEED_MPS = 120.0
# Seconds in which the springs return the pitch to rest.
PITCH_DECAY_S = 0.3
# Metres: transition curves end, and a predicted step is uncertain in size and position
# before it is measured.
RATE_DECAY_M = 150.0
STEP_DECAY_M = 15.0
# A standard deviation on straight roads, and its growth with the road's curvature, 1/m.
BaseShare = tuple[float, float]


@dataclass(frozen=True)
class FilterSettings:
    """Car, process noise and update.

    Process noise: standard deviations added in one second (`_per_s`) or in one metre of
    road (`_per_m`); their squares add up. Textbook values for cars; the rest was tuned
    on the rendered suite where no source is given.
    """

    # Speed where it is not given: mean, standard deviation; standard deviation of a
    # given speed (clock, speedometer).
    usual_speed_mps: tuple[float, float] = (24.0, 8.0)
    given_speed_std_mps: float = 0.5
    # Lateral acceleration that drivers accept in bends, and that tyres hold, m/s^2.
    lateral_mps2: tuple[float, float] = (3.0, 6.0)
    # Distance of a camera behind the windscreen from the rear axle, and the speed at
    # which the slip of the rear tyres turns the whole car along its path: 60 to 80 km/h
    # for most cars.
    lever_m: float = 1.6
    tangent_mps: float = 20.0
    # Standard deviation of the pose's pitch and yaw: a quarter of a degree.
    pose_std_rad: float = 0.004
    # A smaller speed (m/s) than this, with a larger heading, on a road with less
    # curvature (1/m): the filter explains a wrong yaw of the pose by a car that hardly
    # moves. The yaw is then unknown.
    standing: tuple[float, float, float] = (9.0, 0.02, 5e-3)
    # Decay length of the vertical curvature.
    vertical_decay_m: float = 20.0
    # Crosswind and banked roads; bumps; slow changes of load and of the camera's
    # mounting; pedals.
    centre_m_per_s: float = 0.015
    heading_rad_per_s: float = 0.003
    pitch_rad_per_s: float = 0.01
    rest_pitch_rad_per_s: float = 1e-3
    speed_mps_per_s: float = 1.0
    # Steering, on a straight road and its growth with the curvature.
    path_per_m_per_s: BaseShare = (1e-3, 0.3)
    camera_yaw_rad_per_s: float = 1e-4
    # Width of this lane and of the adjacent ones.
    width_m_per_m: float = 0.004
    # Curvature, and its rate: 5e-5 1/m^2 within 70 m on motorways; on mountain roads
    # more, as the square of the curvature (a transition curve is about as long as the
    # radius of its bend allows).
    curvature_per_m_per_m: float = 3e-6
    rate_per_m2_per_m: BaseShare = (6e-6, 1.0)
    # Rate steps: small on motorways, up to those of a hairpin (the maximum) where the
    # road bends more.
    rate_step_per_m2_per_m: BaseShare = (5e-5, 0.2)
    max_rate_step_per_m2_per_m: float = 4e-3
    # Vertical curvature that comes into view, and that between the knots: it also grows
    # with the largest vertical curvature of the lane; the maximum is a radius of 170 m,
    # at which cars leave the ground.
    vertical_per_m: BaseShare = (3e-4, 0.03)
    vertical_share: float = 1.0
    max_vertical_per_m: float = 6e-3


@dataclass(frozen=True, eq=False)
class State:
    """State estimate: mean (19,) and covariance (19, 19) of lane and car."""

    mean: np.ndarray
    covariance: np.ndarray

    @property
    def lane(self) -> np.ndarray:
        """(15,) parameters of the lane."""
        return self.mean[LANE]

    @property
    def lane_covariance(self) -> np.ndarray:
        """(15, 15) covariance of `lane`."""
        return self.covariance[LANE, LANE]


def initial_state(
    lane: np.ndarray,
    covariance: np.ndarray,
    speed_mps: float | None,
    settings: FilterSettings,
) -> State:
    """The state after a first detection (15,), (15, 15).

    The car follows the road, at rest on its springs. Its speed is the given or the
    usual one.
    """
    curvature = lane[CURVATURE]
    if speed_mps is None:
        usual, usual_std = settings.usual_speed_mps
        comfortable = max_speed_mps(curvature, settings.lateral_mps2[0])
        speed = min(usual, comfortable)
        speed_std = usual_std * speed / usual
    else:
        speed = speed_mps
        speed_std = settings.given_speed_std_mps
    path_base, path_share = settings.path_per_m_per_s
    path_std = np.hypot(path_base, path_share * curvature)
    pose_std = settings.pose_std_rad

    mean = np.concatenate([lane, [curvature, speed, lane[PITCH], 0.0]])
    full = np.zeros((STATES, STATES))
    full[LANE, LANE] = covariance
    car_std = [path_std, speed_std, pose_std, pose_std]
    full[CAR, CAR] = np.diag(np.square(car_std))
    return State(mean, full)


def lever(speed_mps: float, settings: FilterSettings) -> tuple[float, float]:
    """Distance of the camera from the point of the car that moves along the car's axis.

    The second result is its derivative by the speed.
    """
    share = speed_mps / settings.tangent_mps
    if share >= 1:
        return 0.0, 0.0
    lever_m = settings.lever_m * (1 - share * share)
    by_speed = -2 * settings.lever_m * share / settings.tangent_mps
    return lever_m, by_speed


def car_motion(state: State, settings: FilterSettings) -> CarMotion:
    """The car's motion, for departure warnings."""
    path, speed, _, camera_yaw = state.mean[CAR].tolist()
    lever_m, _ = lever(speed, settings)
    # turning: curvature minus path; course: heading minus camera yaw minus lever path
    differences = np.zeros((2, STATES))
    differences[0, CURVATURE] = 1
    differences[0, PATH] = -1
    differences[1, HEADING] = 1
    differences[1, CAMERA_YAW] = -1
    differences[1, PATH] = -lever_m
    turning_std, course_std = propagated_std(differences, state.covariance).tolist()
    return CarMotion(
        speed_mps=speed,
        path_per_m=path,
        course_rad=camera_yaw + lever_m * path,
        turning_std_per_m=turning_std,
        course_std_rad=course_std,
        speed_std_mps=float(np.sqrt(state.covariance[SPEED, SPEED])),
    )


def predict(
    state: State,
    elapsed_s: float,
    settings: FilterSettings,
    *,
    speed_mps: float | None = None,
) -> State:
    """The state `elapsed_s` seconds later, before the next measurement.

    The error of a speed from elsewhere (clock, speedometer) has nothing to do with the
    rest.
    """
    x, F = transition(state.mean, elapsed_s, settings)
    Q = process_noise(state, elapsed_s, settings)
    P = F @ state.covariance @ F.T
    P.flat[:: STATES + 1] += Q
    predicted = State(x, P)
    if speed_mps is None:
        return predicted
    speed_std = {SPEED: settings.given_speed_std_mps}
    return _with_independent(predicted, speed_mps, speed_std)


def transition(
    mean: np.ndarray, elapsed_s: float, settings: FilterSettings
) -> tuple[np.ndarray, np.ndarray]:
    """State transition: the mean (19,) `elapsed_s` later, and its Jacobian (19, 19)."""
    # Python floats: for single numbers numpy's overhead would dominate
    _, _, heading, curvature, rate, pitch, *_ = mean.tolist()
    path, speed, rest_pitch, camera_yaw = mean[CAR].tolist()
    d = speed * elapsed_s
    turn = curvature - path
    lever_m, lever_growth = lever(speed, settings)
    slant = heading - camera_yaw - lever_m * path
    pitch_kept = exp(-elapsed_s / PITCH_DECAY_S)
    rates_kept, rates_moved = _rate_transition(d)
    vertical = _vertical_transition(d, settings)

    after = mean.copy()
    after[CENTRE] += slant * d + turn * d * d / 2
    after[HEADING] += turn * d
    after[CURVATURE] += rate * d
    after[RATE_CHAIN] *= rates_kept
    after[RATE_CHAIN[:-1]] += rates_moved * mean[RATE_STEPS]
    after[PITCH] = pitch_kept * pitch + (1 - pitch_kept) * rest_pitch
    after[VERTICAL_CURVATURE] = vertical @ mean[VERTICAL_CURVATURE]

    F = np.eye(STATES)
    F[CENTRE, HEADING] = d
    F[CENTRE, CAMERA_YAW] = -d
    F[CENTRE, CURVATURE] = d * d / 2
    F[CENTRE, PATH] = -d * d / 2 - lever_m * d
    F[CENTRE, SPEED] = (slant + turn * d) * elapsed_s - lever_growth * path * d
    F[HEADING, CURVATURE] = d
    F[HEADING, PATH] = -d
    F[HEADING, SPEED] = turn * elapsed_s
    F[CURVATURE, RATE] = d
    F[CURVATURE, SPEED] = rate * elapsed_s
    F[RATE_CHAIN, RATE_CHAIN] = rates_kept
    F[RATE_CHAIN[:-1], RATE_CHAIN[1:]] = rates_moved
    F[PITCH, PITCH] = pitch_kept
    F[PITCH, REST_PITCH] = 1 - pitch_kept
    F[VERTICAL_CURVATURE, VERTICAL_CURVATURE] = vertical
    return after, F


def _rate_transition(distance_m: float) -> tuple[np.ndarray, np.ndarray]:
    """What stays of rate and rate steps after driving on, and what moves a knot nearer.

    The first result (4,) is the share of rate and rate steps that stays, the second
    (3,) the share of the steps that moves one knot nearer. A step comes nearer and is
    shared by the knots before and behind it; a step at the car becomes part of the
    rate.
    """
    moved = np.minimum(np.maximum(distance_m / KNOT_GAPS_M, 0), 1)
    rate_decay = exp(-distance_m / RATE_DECAY_M)
    step_decay = exp(-distance_m / STEP_DECAY_M)
    kept = np.concatenate([[rate_decay], (1 - moved) * step_decay])
    return kept, moved * rate_decay


def _vertical_transition(distance_m: float, settings: FilterSettings) -> np.ndarray:
    """(4, 4) transition of the vertical curvatures: each comes nearer, the farthest
    decays.

    The road that comes into view beyond the last knot is unknown.
    """
    moved = np.minimum(np.maximum(distance_m / VERTICAL_KNOT_GAPS_M, 0), 1)
    decay = exp(-distance_m / settings.vertical_decay_m)
    matrix = np.diag([*(1 - moved), decay])
    np.fill_diagonal(matrix[:, 1:], moved)
    return matrix


def process_noise(
    state: State, elapsed_s: float, settings: FilterSettings
) -> np.ndarray:
    """Variances (19,) that one prediction adds: the diagonal of Q."""
    curvature = max_curvature(state.lane)
    excess = max(curvature - MOTORWAY_CURVATURE_PER_M, 0.0)
    distance_m = abs(float(state.mean[SPEED]) * elapsed_s)

    # standard deviations that are added in one second
    per_s = np.zeros(STATES)
    per_s[CENTRE] = settings.centre_m_per_s
    per_s[HEADING] = settings.heading_rad_per_s
    per_s[PITCH] = settings.pitch_rad_per_s
    per_s[PATH] = _grown(settings.path_per_m_per_s, curvature)
    per_s[SPEED] = settings.speed_mps_per_s
    per_s[REST_PITCH] = settings.rest_pitch_rad_per_s
    per_s[CAMERA_YAW] = settings.camera_yaw_rad_per_s

    # and in one metre
    rate_step = _grown(settings.rate_step_per_m2_per_m, excess)
    per_m = np.zeros(STATES)
    per_m[WIDTH] = settings.width_m_per_m
    per_m[ADJACENT] = settings.width_m_per_m
    per_m[CURVATURE] = settings.curvature_per_m_per_m
    per_m[RATE] = _grown(settings.rate_per_m2_per_m, curvature**2)
    per_m[RATE_STEPS] = min(rate_step, settings.max_rate_step_per_m2_per_m)
    variance = per_s**2 * elapsed_s + per_m**2 * distance_m

    # the undulation that is forgotten
    vertical = _grown(settings.vertical_per_m, excess)
    vertical += settings.vertical_share * max_vertical_curvature(state.lane)
    vertical = min(vertical, settings.max_vertical_per_m)
    forgotten = 1 - exp(-2 * distance_m / settings.vertical_decay_m)
    variance[VERTICAL_CURVATURE] = vertical**2 * forgotten
    return variance


def _grown(base_and_share: BaseShare, by: float) -> float:
    """A standard deviation, grown with the curvature."""
    base, share = base_and_share
    return base + share * by


def without_wrong_yaw(state: State, settings: FilterSettings) -> State:
    """The state, with the usual speed and any yaw if the yaw of the pose seems wrong.

    It does if a car on a smooth road seems to stand and point away from it.
    """
    speed_mps, heading_rad, curvature_per_m = settings.standing
    is_slow = float(state.mean[SPEED]) < speed_mps
    is_turned = abs(float(state.lane[HEADING])) > heading_rad
    is_smooth = max_curvature(state.lane) < curvature_per_m
    if not (is_slow and is_turned and is_smooth):
        return state
    usual, usual_std = settings.usual_speed_mps
    stds = {SPEED: usual_std, CAMERA_YAW: 0.05}  # 3 degrees
    return _with_independent(state, usual, stds)


def seen_along_the_car(state: State) -> State:
    """The state as seen by a camera that is turned to look along the car's axis."""
    mean = state.mean.copy()
    mean[HEADING] -= mean[CAMERA_YAW]
    mean[CAMERA_YAW] = 0.0
    return State(mean, state.covariance)


def _with_independent(state: State, speed_mps: float, stds: dict[int, float]) -> State:
    """The state with this speed.

    The variables in `stds` get these standard deviations and no covariances.
    """
    mean = state.mean.copy()
    mean[SPEED] = speed_mps
    covariance = state.covariance.copy()
    for index, std in stds.items():
        covariance[index, :] = 0.0
        covariance[:, index] = 0.0
        covariance[index, index] = std**2
    return State(mean, covariance)


def measure(
    stripes: Stripes, predicted: State, view: BirdsEyeView, settings: FitSettings
) -> Fit:
    """The lane fitted to the stripes with the prediction as prior: a fit of one lane.

    The fit near the prediction is linearised there. If it leaves many stripes nearby
    unexplained, the lane is also fitted outwards from the car, as in a search: what
    begins ahead (a bend, a crest) leaves the prediction by more than any standard
    deviation.
    """
    start = predicted.lane[None]
    prior = predicted_prior(predicted.lane, predicted.lane_covariance, settings)
    near = fit_near_prediction(
        start,
        stripes,
        view,
        settings,
        schedule=settings.extend[-2:],
        prior=prior,
    )
    if not near.unexplained[0]:
        return near
    outwards = fit_lanes(
        start,
        stripes,
        view,
        settings,
        schedule=settings.outwards,
        prior=prior,
    )
    return outwards if outwards.explained[0] > near.explained[0] else near


def update(
    predicted: State,
    lane: np.ndarray,
    covariance: np.ndarray,
    settings: FilterSettings,
) -> State:
    """The predicted state conditioned on the measured lane (15,), prediction included.

    `covariance` (15, 15) is that of the measured lane. The car follows by regression on
    the lane, with gain K = P_cl P_ll^-1.
    """
    root = np.linalg.cholesky(predicted.covariance)
    K = np.linalg.solve(root[LANE, LANE].T, root[CAR, LANE].T).T
    innovation = lane - predicted.lane
    car = predicted.mean[CAR] + K @ innovation
    mean = np.concatenate([lane, car])
    fastest = max_speed_mps(lane[CURVATURE], settings.lateral_mps2[1])
    mean[SPEED] = min(max(mean[SPEED], 0.0), fastest)

    # sums of squares, because differences of nearly equal matrices may lose positive
    # definiteness
    regression = np.vstack([np.eye(PARAMETERS), K])
    symmetric = (covariance + covariance.T) / 2
    updated = regression @ symmetric @ regression.T
    updated[CAR, CAR] += root[CAR, CAR] @ root[CAR, CAR].T
    return State(mean, updated)


def to_adjacent_lane(state: State, side: float, prior: RoadPrior) -> State:
    """State of the adjacent lane to the left (+1) or right (-1), which shares a line
    with this one.
    """
    there = ADJACENT.start if side > 0 else ADJACENT.start + 1
    jacobian = np.eye(STATES)
    jacobian[LANE, LANE] = adjacent_lane_matrix(side)
    covariance = jacobian @ state.covariance @ jacobian.T
    covariance[there, there] = prior.std[there] ** 2
    return State(jacobian @ state.mean, covariance)


def max_speed_mps(curvature_per_m: float, lateral_mps2: float) -> float:
    """Speed at which a bend causes this lateral acceleration, v^2 k.

    It is at most `MAX_SPEED_MPS`.
    """
    least_curvature = lateral_mps2 / MAX_SPEED_MPS**2
    curvature = max(abs(curvature_per_m), least_curvature)
    return float(np.sqrt(lateral_mps2 / curvature))
