"""Correct a prediction with the stripes near it: the measurement update of an extended Kalman filter.

Each stripe measures its distance from the nearer predicted line. Gating leaves out those whose innovation would be a
surprise; the others are weighed as in the fit of a single picture, with the prediction as prior, and weighed again by
their distance from the lane that comes out.

Far stripes need care: a road that begins or ends a transition curve within the view leaves the model, all stripes
beyond that place alike. As independent measurements they would outvote the near ones and bend the lane beside the car.
An eighth number, the change of the rate of curvature, takes that up; it belongs to this picture and is not kept.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lanes.metric.evidence import Stripes
from lanes.metric.lanefit import Comparison, LaneFit, compare, paint_weight, place_std, stray_m
from lanes.metric.motion import Belief, bend_of
from lanes.metric.roadview import RoadView

# A stripe is taken if its innovation squared over its variance is below this: chi-square of one degree of freedom,
# 99.7 %.
GATE = 9.0
# Stripes of one picture err together (the same paint, the same lens), so they count as so many times fewer.
TOGETHER = 4.0
# Change of the rate of curvature, 1/m^3: a rate of 5e-5 that comes or goes within 12 m of road, and more on roads with
# tighter bends, as their square.
JOLT_STD_PER_M3, JOLT_STD_SHARE_PER_M = 4e-6, 0.05
# Standard deviations that still pull, the first time and the second.
SCALES = (1.5, 1.0)


def gate_stripes(found: Comparison, std_m: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(stripes,) bool: their distance from the predicted line is no surprise, innovation^2 < GATE (H P H^T + R).

    Parameters
    ----------
    found : Comparison
        With the predicted lane alone.
    std_m : ndarray (stripes,)
        Standard deviation of each stripe's place.
    covariance : ndarray (7, 7)
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
        One lane (1, 7); its information is the inverse of the covariance after the update. Stripes that do not pass the
        gate have no weight.
    """
    paint, std, stray = paint_weight(stripes), place_std(stripes, view.focal_px), stray_m(stripes)
    found = compare(belief.lane[None], stripes, view.height_m)
    expected = gate_stripes(found, std, belief.lane_covariance) * paint
    jacobian = np.vstack([found.derivative[0], -np.square(np.square(stripes.x_m)) / 24])
    jolt_std = JOLT_STD_PER_M3 + JOLT_STD_SHARE_PER_M * bend_of(belief.lane) ** 2
    prior = np.zeros((len(jacobian), len(jacobian)))
    prior[:-1, :-1], prior[-1, -1] = np.linalg.inv(belief.lane_covariance), jolt_std**-2
    moved = found
    for scale in SCALES:
        agreement = moved.agreement(std * scale)[0] * expected
        weighted = jacobian * (agreement / (TOGETHER * ((std * scale) ** 2 + stray**2)))
        information = weighted @ jacobian.T + prior
        step = -np.linalg.solve(information, weighted @ found.residual_m[0])
        # so small a step bends nothing: the stripes need not be laid beside the lane again
        moved = replace(found, residual_m=found.residual_m + step[:-1] @ found.derivative[0])
    # What is known of the lane while the jolt is not (the Schur complement). The agreement is the one before the last
    # step, which is small.
    across = information[:-1, -1]
    known = information[:-1, :-1] - np.outer(across, across) / information[-1, -1]
    return LaneFit(belief.lane[None] + step[:-1], known[None], agreement[None], found.side)
