"""Measurement update of the extended Kalman filter, with the stripes of one frame.

Each stripe measures its distance from the nearest predicted line. Stripes are weighted as in the fit of a single
picture, with the prediction as prior, and weighted again by their distance from the updated lane. The weights make a
gate unnecessary: the accuracy of the suite is the same with one (docs/ablation.md).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lanes.tracking.birdseye import BirdsEyeView
from lanes.tracking.car import (
    CAMERA_YAW,
    CAR,
    CAR_PARAMETERS,
    LANE,
    PATH,
    REST_PITCH,
    SPEED,
    STATES,
)
from lanes.tracking.fitting import FIT, LaneFit, fit_near, fit_outwards
from lanes.tracking.markings import Stripes
from lanes.tracking.model import CURVATURE, PARAMETERS
from lanes.tracking.process_noise import PROCESS_NOISE, max_curvature, max_vertical_curvature
from lanes.tracking.state import KalmanState


@dataclass(frozen=True)
class UpdateParameters:
    """When to fit outwards from the car instead of near the prediction; tuned on the rendered suite."""

    # On roads with larger curvature or vertical curvature than this, every frame may be fitted outwards.
    min_curvature_per_m: float = 5e-3
    min_vertical_per_m: float = 1e-3
    # Weight of stripes that a fit with inflated covariance must explain in addition, because it is less constrained.
    inflated_gain: float = 3.0
    # Standard deviation of the first path curvature, as a share of the road's curvature.
    path_share: float = 0.3


UPDATE = UpdateParameters()


def update_lane(stripes: Stripes, estimate: KalmanState, view: BirdsEyeView, *, outwards: bool = True) -> LaneFit:
    """The lane after the measurement update.

    If the fit near the prediction leaves many stripes nearby unexplained, the lane is also fitted outwards from the
    car, as in a single picture: what begins ahead (a bend, a crest) leaves the prediction by more than any standard
    deviation. The fit that explains more stripes is taken. If that is still not enough, the covariance is inflated for
    abrupt changes.

    Parameters
    ----------
    stripes : Stripes
        All stripes of the frame.
    estimate : KalmanState
        Predicted to the time of the frame.
    view : BirdsEyeView
    outwards : bool
        Whether the lane may be fitted outwards on a smooth road, too.

    Returns
    -------
    LaneFit
        One lane (1, 15); its information is the inverse of the updated covariance. Stripes far from the lines have
        little weight.
    """
    near = fit_near(stripes, estimate.lane, estimate.lane_covariance, view)
    enough = near.nearby_weight[0] - FIT.max_unexplained
    smooth = is_smooth(estimate.lane)
    if (smooth and not outwards) or near.explained[0] > enough:
        return near
    attempts = (
        (estimate, FIT.extend if smooth else FIT.outwards, 0.0),
        (estimate.inflated(), FIT.outwards, UPDATE.inflated_gain),
    )
    best = near
    for prior, schedule, gain in attempts:
        fit = fit_outwards(stripes, prior.lane, prior.lane_covariance, view, schedule=schedule)
        if fit.explained[0] > best.explained[0] + gain:
            best = fit
        if best.explained[0] > enough:
            break
    return best


def is_smooth(lane: np.ndarray) -> bool:
    """Whether the road of a lane (15,) has little curvature and vertical curvature."""
    return max_curvature(lane) < UPDATE.min_curvature_per_m and max_vertical_curvature(lane) < UPDATE.min_vertical_per_m


def update_state(estimate: KalmanState, lane: np.ndarray, covariance: np.ndarray) -> KalmanState:
    """The predicted state conditioned on the updated lane (15,) with covariance (15, 15).

    The car follows by regression on the lane, with gain G = P_cl P_ll^-1.
    """
    root = np.linalg.cholesky(estimate.covariance)
    gain = np.linalg.solve(root[LANE, LANE].T, root[CAR, LANE].T).T
    mean = np.concatenate([lane, estimate.mean[CAR] + gain @ (lane - estimate.lane)])
    mean[SPEED] = min(max(mean[SPEED], 0.0), max_speed_mps(lane[CURVATURE], CAR_PARAMETERS.max_lateral_mps2))
    # sums of squares, because differences of nearly equal matrices may lose positive definiteness
    regression = np.vstack([np.eye(PARAMETERS), gain])
    updated = regression @ ((covariance + covariance.T) / 2) @ regression.T
    updated[CAR, CAR] += root[CAR, CAR] @ root[CAR, CAR].T
    return KalmanState(mean, updated)


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
    return KalmanState(np.concatenate([lane, [lane[CURVATURE], speed, 0.0, 0.0]]), full)


def max_speed_mps(curvature_per_m: float, lateral_mps2: float) -> float:
    """Speed at which a bend causes this lateral acceleration, v^2 k; at most `CAR_PARAMETERS.max_speed_mps`."""
    min_curvature = lateral_mps2 / CAR_PARAMETERS.max_speed_mps**2
    return float(np.sqrt(lateral_mps2 / max(abs(curvature_per_m), min_curvature)))
