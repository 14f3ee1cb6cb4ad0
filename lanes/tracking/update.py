"""Correct a prediction with the stripes near it: the measurement update of an extended Kalman filter.

Each stripe measures its distance from the nearer predicted line. Gating leaves out those whose innovation would be a
surprise; the others are weighed as in the fit of a single picture, with the prediction as prior, and weighed again by
their distance from the lane that comes out.
"""

from __future__ import annotations

import numpy as np

from lanes.tracking.birdseye import BirdsEyeView
from lanes.tracking.fitting import GROW, OUTWARDS, UNEXPLAINED, LaneFit, compare, fit_near, fit_outwards
from lanes.tracking.markings import Stripes, marking_weight, position_std
from lanes.tracking.model import CURVATURE
from lanes.tracking.state import (
    AIM_STD_RAD,
    CAMERA_YAW,
    GIVEN_SPEED_STD_MPS,
    LANE,
    PATH,
    PATH_PER_S,
    REST_PITCH,
    REST_STD_RAD,
    SPEED,
    STATES,
    USUAL_PUSH,
    USUAL_SPEED_MPS,
    USUAL_SPEED_STD_MPS,
    KalmanState,
    fastest_mps,
    largest_vertical,
    sharpest_bend,
)

# Where the road bends or waves, or where this much paint that lies beside the prediction is not explained by it, the
# lane is also followed outwards from the car, as in a single picture: what begins ahead leaves the prediction by more
# than any standard deviation. The lane with more paint on it is taken; one of a road that suddenly bends or waves in a
# new way must have a few stripes more, because it may do so freely.
INFLATED_GAIN = 3.0
SHARP_PER_M, WAVY_PER_M = 5e-3, 1e-3


def update_lane(stripes: Stripes, estimate: KalmanState, view: BirdsEyeView, *, outwards: bool = True) -> LaneFit:
    """The lane after this picture's stripes were taken into account.

    Parameters
    ----------
    stripes : Stripes
        All of the picture.
    belief : KalmanState
        Predicted to the time of the picture.
    view : BirdsEyeView
    outwards : bool
        Whether to follow the lane outwards on an even road, too, should it leave paint unexplained.

    Returns
    -------
    LaneFit
        One lane (1, 15); its information is the inverse of the covariance after the update. Near the prediction,
        stripes that do not pass the gate have no weight; followed outwards, those that lie off the lines have little.
    """
    found = compare(estimate.lane[None], stripes, view.height_m)
    paint, std = marking_weight(stripes), position_std(stripes, view.focal_px)
    same = fit_near(found, stripes, estimate, paint, std)
    to_explain = same.beside[0] - UNEXPLAINED
    even = sharpest_bend(estimate.lane) < SHARP_PER_M and largest_vertical(estimate.lane) < WAVY_PER_M
    if (even and not outwards) or same.weight.sum() > to_explain:
        return same
    grown = fit_outwards(stripes, estimate, view, schedule=GROW if even else OUTWARDS)
    best = grown if grown.weight.sum() > same.weight.sum() else same
    if best.weight.sum() > to_explain:
        return best
    inflated = fit_outwards(stripes, estimate.inflated(), view, schedule=OUTWARDS)
    return inflated if inflated.weight.sum() > best.weight.sum() + INFLATED_GAIN else best


def initial_state(lane: np.ndarray, covariance: np.ndarray, speed_mps: float | None) -> KalmanState:
    """The belief after a first picture: the car follows the road, roughly, at the given or the usual speed."""
    path_std = np.hypot(PATH_PER_S, 0.3 * lane[CURVATURE])
    speed, speed_std = speed_mps, GIVEN_SPEED_STD_MPS
    if speed_mps is None:
        speed = min(USUAL_SPEED_MPS, fastest_mps(lane[CURVATURE], USUAL_PUSH))
        speed_std = USUAL_SPEED_STD_MPS * speed / USUAL_SPEED_MPS
    whole = np.zeros((STATES, STATES))
    whole[LANE, LANE] = covariance
    car = [PATH, SPEED, REST_PITCH, CAMERA_YAW]
    whole[car, car] = np.square([path_std, speed_std, REST_STD_RAD, AIM_STD_RAD])
    return KalmanState(np.concatenate([lane, [lane[CURVATURE], speed, 0.0, 0.0]]), whole)
