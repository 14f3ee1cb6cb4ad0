"""Correct a prediction with the stripes near it: the measurement update of an extended Kalman filter.

Each stripe measures its distance from the nearer predicted line. Gating leaves out those whose innovation would be a
surprise; the others are weighed as in the fit of a single picture, with the prediction as prior, and weighed again by
their distance from the lane that comes out.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lanes.metric.evidence import Stripes
from lanes.metric.lanefit import GENTLE_PER_M, Comparison, LaneFit, compare, paint_weight, place_std, stray_m
from lanes.metric.motion import Belief, bend_of
from lanes.metric.roadview import RoadView

# A stripe is taken if its innovation squared over its variance is below this: chi-square of one degree of freedom,
# 99.7 %.
GATE = 9.0
# Stripes of one picture err together (the same paint, the same lens), so they count as so many times fewer.
TOGETHER = 4.0
# Passes of the correction: (how far it looks, how many standard deviations still pull). Where the road bends it is also
# followed outwards from the car, as in a single picture, and the lane with more paint on it is taken: a bend that
# begins ahead leaves the prediction by more than any standard deviation.
SAME = ((70.0, 1.5), (70.0, 1.0))
GROWN = ((16.0, 3.0), (22.0, 2.0), (32.0, 1.5), (70.0, 1.0))


def gate_stripes(found: Comparison, std_m: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(stripes,) bool: their distance from the predicted line is no surprise, innovation^2 < GATE (H P H^T + R).

    Parameters
    ----------
    found : Comparison
        With the predicted lane alone.
    std_m : ndarray (stripes,)
        Standard deviation of each stripe's place.
    covariance : ndarray (10, 10)
        Of the prediction.
    """
    derivative = found.derivative[0]
    known = ((covariance @ derivative) * derivative).sum(axis=0)
    return np.square(found.residual_m[0]) < GATE * (known + std_m * std_m)


def correct_lane(stripes: Stripes, belief: Belief, view: RoadView) -> LaneFit:
    """The lane after this picture's stripes were taken into account.

    Parameters
    ----------
    stripes : Stripes
        All of the picture.
    belief : Belief
        Predicted to the time of the picture.
    view : RoadView

    Returns
    -------
    LaneFit
        One lane (1, 10); its information is the inverse of the covariance after the update. Stripes that do not pass
        the gate have no weight.
    """
    same = _correct(stripes, belief, view, SAME)
    if bend_of(belief.lane) < GENTLE_PER_M:
        return same
    grown = _correct(stripes, belief, view, GROWN)
    return grown if grown.weight.sum() > same.weight.sum() else same


def _correct(stripes: Stripes, belief: Belief, view: RoadView, passes: tuple) -> LaneFit:
    """The correction in such passes."""
    paint, std, stray = paint_weight(stripes), place_std(stripes, view.focal_px), stray_m(stripes)
    found = compare(belief.lane[None], stripes, view.height_m)
    expected = gate_stripes(found, std, belief.lane_covariance) * paint
    prior, guess, moved = np.linalg.inv(belief.lane_covariance), belief.lane, found
    for far_m, scale in passes:
        agreement = moved.agreement(std * scale)[0] * expected * (stripes.x_m < far_m)
        weighted = found.derivative[0] * (agreement / (TOGETHER * ((std * scale) ** 2 + stray**2)))
        information = weighted @ found.derivative[0].T + prior
        step = -np.linalg.solve(information, weighted @ found.residual_m[0] + prior @ (guess - belief.lane))
        if passes is GROWN:
            guess = guess + step
            moved = found = compare(guess[None], stripes, view.height_m)
        else:
            # so small a step bends nothing: the stripes need not be laid beside the lane again
            moved = replace(found, residual_m=found.residual_m + step @ found.derivative[0])
    lane = guess if passes is GROWN else guess + step
    # the agreement is the one before the last step, which is small
    return LaneFit(lane[None], information[None], agreement[None], found.side)
