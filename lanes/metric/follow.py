"""Correct a prediction with the stripes near it: the measurement update of an extended Kalman filter.

Each stripe measures its distance from the nearer predicted line. Gating leaves out those whose innovation would be a
surprise; the others are weighed as in the fit of a single picture, with the prediction as prior, and weighed again by
their distance from the lane that comes out.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lanes.metric.evidence import Stripes
from lanes.metric.lanefit import (
    GROW,
    OUTWARDS,
    UNEXPLAINED,
    Comparison,
    LaneFit,
    compare,
    fit_lanes,
    paint_beside,
    paint_weight,
    place_std,
    stray_m,
)
from lanes.metric.motion import Belief, bend_of, wave_of
from lanes.metric.roadview import RoadView

# A stripe is taken if its innovation squared over its variance is below this: chi-square of one degree of freedom,
# 99.7 %.
GATE = 9.0
# Stripes of one picture err together (the same paint, the same lens), so they count as so many times fewer.
TOGETHER = 4.0
# Passes of the correction: (how far it looks, how many standard deviations still pull).
SAME = ((70.0, 1.5), (70.0, 1.0))
# Where the road bends or waves, or where this much paint that lies beside the prediction is not explained by it, the
# lane is also followed outwards from the car, as in a single picture: what begins ahead leaves the prediction by more
# than any standard deviation. The lane with more paint on it is taken; one of a road that suddenly bends or waves in a
# new way must have a few stripes more, because it may do so freely.
ROUSED_PAINT = 3.0
SHARP_PER_M, WAVY_PER_M = 5e-3, 1e-3


def gate_stripes(found: Comparison, std_m: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(stripes,) bool: their distance from the predicted line is no surprise, innovation^2 < GATE (H P H^T + R).

    Parameters
    ----------
    found : Comparison
        With the predicted lane alone.
    std_m : ndarray (stripes,)
        Standard deviation of each stripe's place.
    covariance : ndarray (15, 15)
        Of the prediction.
    """
    derivative = found.derivative[0]
    known = ((covariance @ derivative) * derivative).sum(axis=0)
    return np.square(found.residual_m[0]) < GATE * (known + std_m * std_m)


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


def _grow(stripes: Stripes, belief: Belief, view: RoadView, *, schedule: tuple) -> LaneFit:
    """The lane followed outwards from the car."""
    return fit_lanes(
        belief.lane[None],
        stripes,
        view.height_m,
        view.focal_px,
        prior_mean=belief.lane,
        prior_information=np.linalg.inv(belief.lane_covariance),
        schedule=schedule,
        together=TOGETHER,
    )


def _correct(found: Comparison, stripes: Stripes, belief: Belief, paint: np.ndarray, std_m: np.ndarray) -> LaneFit:
    """The lane near the prediction, with which the stripes were compared.

    So small a step bends nothing: the stripes need not be laid beside the lane again.
    """
    expected, stray = gate_stripes(found, std_m, belief.lane_covariance) * paint, stray_m(stripes)
    prior, moved, step = np.linalg.inv(belief.lane_covariance), found, np.zeros_like(belief.lane)
    for far_m, scale in SAME:
        agreement = moved.agreement(std_m * scale)[0] * expected * (stripes.x_m < far_m)
        weighted = found.derivative[0] * (agreement / (TOGETHER * ((std_m * scale) ** 2 + stray**2)))
        information = weighted @ found.derivative[0].T + prior
        step = step - np.linalg.solve(information, weighted @ moved.residual_m[0] + prior @ step)
        moved = replace(found, residual_m=found.residual_m + step @ found.derivative[0])
    # the agreement is the one before the last step, which is small
    beside = paint_beside(found, stripes, paint)
    return LaneFit((belief.lane + step)[None], information[None], agreement[None], found.side, beside)
