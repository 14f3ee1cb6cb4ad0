"""A track, what is known of the lane from frame to frame, and its update with the evidence of the next frame.

Measurement update of the extended Kalman filter: each stripe measures its distance from the nearest predicted line.
Stripes are weighted as in the fit of a single picture, with the prediction as prior, and weighted again by their
distance from the updated lane. The weights make a gate unnecessary: the accuracy of the suite is the same with one
(docs/ablation.md).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lanes.tracking.birdseye import BirdsEyeView
from lanes.tracking.detector import inner_stripe_shift, observe_lines
from lanes.tracking.error_covariance import ResidualStatistics, split_gain
from lanes.tracking.fitting import FIT, LaneFit, fit_lanes, fit_near
from lanes.tracking.lane import Lane, LineObservation, Observations
from lanes.tracking.markings import FrameEvidence, Stripes
from lanes.tracking.model import (
    CENTRE,
    CURVATURE,
    HEADING,
    LEFT_SIDE,
    PARAMETERS,
    RIGHT_SIDE,
    WIDTH,
    lateral_std_m,
    max_curvature,
    score_lanes,
)
from lanes.tracking.state import (
    CAMERA_YAW,
    CAR,
    CAR_PARAMETERS,
    LANE,
    PATH,
    PROCESS_NOISE,
    REST_PITCH,
    SPEED,
    STATES,
    KalmanState,
    inflate,
    max_vertical_curvature,
    predict,
    with_given_speed,
    with_unknown_yaw,
)


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
