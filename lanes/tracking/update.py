"""Correct a prediction with the stripes near it: the measurement update of an extended Kalman filter.

Each stripe measures its distance from the nearer predicted line. Gating leaves out those whose innovation would be a
surprise; the others are weighed as in the fit of a single picture, with the prediction as prior, and weighed again by
their distance from the lane that comes out.
"""

from __future__ import annotations

import numpy as np

from lanes.tracking.birdseye import RoadView
from lanes.tracking.fitting import GROW, OUTWARDS, UNEXPLAINED, LaneFit, _correct, _grow, compare
from lanes.tracking.markings import Stripes, paint_weight, place_std
from lanes.tracking.model import CURVATURE
from lanes.tracking.state import (
    AIM,
    AIM_STD_RAD,
    GIVEN_SPEED_STD_MPS,
    LANE,
    PATH,
    PATH_PER_S,
    REST,
    REST_STD_RAD,
    SPEED,
    STATES,
    USUAL_PUSH,
    USUAL_SPEED_MPS,
    USUAL_SPEED_STD_MPS,
    Belief,
    bend_of,
    fastest_mps,
    wave_of,
)

# Where the road bends or waves, or where this much paint that lies beside the prediction is not explained by it, the
# lane is also followed outwards from the car, as in a single picture: what begins ahead leaves the prediction by more
# than any standard deviation. The lane with more paint on it is taken; one of a road that suddenly bends or waves in a
# new way must have a few stripes more, because it may do so freely.
ROUSED_PAINT = 3.0
SHARP_PER_M, WAVY_PER_M = 5e-3, 1e-3


def correct_lane(stripes: Stripes, belief: Belief, view: RoadView, *, outwards: bool = True) -> LaneFit:
    """The lane after this picture's stripes were taken into account.

    Parameters
    ----------
    stripes : Stripes
        All of the picture.
    belief : Belief
        Predicted to the time of the picture.
    view : RoadView
    outwards : bool
        Whether to follow the lane outwards on an even road, too, should it leave paint unexplained.

    Returns
    -------
    LaneFit
        One lane (1, 15); its information is the inverse of the covariance after the update. Near the prediction,
        stripes that do not pass the gate have no weight; followed outwards, those that lie off the lines have little.
    """
    found = compare(belief.lane[None], stripes, view.height_m)
    paint, std = paint_weight(stripes), place_std(stripes, view.focal_px)
    same = _correct(found, stripes, belief, paint, std)
    to_explain = same.beside[0] - UNEXPLAINED
    even = bend_of(belief.lane) < SHARP_PER_M and wave_of(belief.lane) < WAVY_PER_M
    if (even and not outwards) or same.weight.sum() > to_explain:
        return same
    grown = _grow(stripes, belief, view, schedule=GROW if even else OUTWARDS)
    best = grown if grown.weight.sum() > same.weight.sum() else same
    if best.weight.sum() > to_explain:
        return best
    roused = _grow(stripes, belief.roused(), view, schedule=OUTWARDS)
    return roused if roused.weight.sum() > best.weight.sum() + ROUSED_PAINT else best


def first_belief(lane: np.ndarray, covariance: np.ndarray, speed_mps: float | None) -> Belief:
    """The belief after a first picture: the car follows the road, roughly, at the given or the usual speed."""
    path_std = np.hypot(PATH_PER_S, 0.3 * lane[CURVATURE])
    speed, speed_std = speed_mps, GIVEN_SPEED_STD_MPS
    if speed_mps is None:
        speed = min(USUAL_SPEED_MPS, fastest_mps(lane[CURVATURE], USUAL_PUSH))
        speed_std = USUAL_SPEED_STD_MPS * speed / USUAL_SPEED_MPS
    whole = np.zeros((STATES, STATES))
    whole[LANE, LANE] = covariance
    car = [PATH, SPEED, REST, AIM]
    whole[car, car] = np.square([path_std, speed_std, REST_STD_RAD, AIM_STD_RAD])
    return Belief(np.concatenate([lane, [lane[CURVATURE], speed, 0.0, 0.0]]), whole)
