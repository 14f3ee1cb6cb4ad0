"""How sure a lane is: the probability that it is right, learned from drives whose truth is known.

Right means: both lines lie within 0.2 m of the true ones, as the root of the mean square over 5, 10, 15, 20 and 30 m
ahead. The probability is a logistic function of a few numbers that a lane comes with; `tests/fit_confidence.py` drives
along roads, counts and fits.
"""

from __future__ import annotations

import numpy as np

from lanes.lane import Lane
from lanes.lanemodel import SIDES

RIGHT_M, RIGHT_AT_M = 0.2, np.array([5.0, 10.0, 15.0, 20.0, 30.0])
# A usual lane is so wide, metres.
USUAL_WIDTH_M = 3.5
# What a probability depends on: the roots of the lines' supports; how much better than any other lane it is; how surely
# its worse line is known 20 m ahead; how unusually wide it is. Memory adds for how long nothing was seen.
FEATURES = ("constant", "weaker line", "stronger line", "margin", "log std", "odd width", "unseen s")
STILL_WEIGHTS = np.array([0.57, -0.64, -4.29, 1.06, -1.62, -4.73])
TRACK_WEIGHTS = np.array([-0.74, -1.78, -0.58, 0.71, -1.42, -5.21, 1.94])


def lane_features(lane: Lane, *, margin: float | None = None) -> np.ndarray:
    """The features (6,) of a lane found in one picture; `margin` replaces the lane's own."""
    support = np.sqrt([lane.left.support, lane.right.support])
    margin = lane.margin if margin is None else margin
    spread = np.log(lateral_std_m(lane, 20.0))
    return np.array([1.0, support.min(), support.max(), margin, spread, abs(lane.width_m - USUAL_WIDTH_M)])


def track_features(lane: Lane, *, margin: float, unseen_s: float) -> np.ndarray:
    """The features (7,) of a lane that is followed, last seen so long ago."""
    return np.append(lane_features(lane, margin=margin), unseen_s)


def lateral_std_m(lane: Lane, x_m: float) -> float:
    """Standard deviation of the worse line's lateral place `x_m` ahead."""
    gradients = [np.array([1, side / 2, x_m, x_m**2 / 2, x_m**3 / 6, 0, 0]) for side in SIDES]
    return float(np.sqrt(max(g @ lane.covariance @ g for g in gradients)))


def chance(features: np.ndarray) -> float:
    """Probability that a lane with these features is right, 0 to 1."""
    weights = STILL_WEIGHTS if len(features) == len(STILL_WEIGHTS) else TRACK_WEIGHTS
    return float(1 / (1 + np.exp(-weights @ features)))


def rate_lane(lane: Lane) -> float:
    """Probability that a lane found in a single picture (`find_lane`) is right."""
    return chance(lane_features(lane))
