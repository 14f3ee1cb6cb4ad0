"""Correct a prediction with the stripes near it: the measurement update of an extended Kalman filter.

Each stripe measures its distance from the nearer predicted line. Gating leaves out those whose innovation would be a
surprise; the others are weighed as in the fit of a single picture, with the prediction as prior, in a few iterations
(the iterated extended Kalman filter: B. M. Bell and F. W. Cathey, 1993).

Far stripes need care: a road that begins or ends a transition curve within the view leaves the model, all stripes
beyond that place alike. As independent measurements they would outvote the near ones and bend the lane beside the car.
An eighth number, the change of the rate of curvature, takes that up; it belongs to this picture and is not kept.
"""

from __future__ import annotations

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
# Standard deviations that still pull, in each iteration.
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
    mean, jolt = np.append(belief.lane, 0.0), -np.square(np.square(stripes.x_m)) / 24
    jolt_std = JOLT_STD_PER_M3 + JOLT_STD_SHARE_PER_M * bend_of(belief.lane) ** 2
    prior = np.zeros((len(mean), len(mean)))
    prior[:-1, :-1], prior[-1, -1] = np.linalg.inv(belief.lane_covariance), jolt_std**-2
    guess, expected = mean, None
    for scale in SCALES:
        found = compare(guess[None, :-1], stripes, view.height_m)
        if expected is None:
            expected = gate_stripes(found, std, belief.lane_covariance)
        agreement = found.agreement(std * scale)[0] * paint * expected
        jacobian = np.vstack([found.derivative[0], jolt])
        weighted = jacobian * (agreement / (TOGETHER * ((std * scale) ** 2 + stray**2)))
        residual = found.residual_m[0] + jolt * guess[-1]
        information = weighted @ jacobian.T + prior
        guess = guess - np.linalg.solve(information, weighted @ residual + prior @ (guess - mean))
    # What is known of the lane while the jolt is not (the Schur complement). Agreement and residuals are those before
    # the last step, which is small.
    across = information[:-1, -1]
    known = information[:-1, :-1] - np.outer(across, across) / information[-1, -1]
    return LaneFit(guess[None, :-1], known[None], agreement[None], found.side, residual[None])
