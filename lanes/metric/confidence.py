"""How sure a lane is: the probability that it is right, learned from drives whose truth is known.

Right means: both lines lie within 0.2 m of the true ones, as the root of the mean square over 5, 10, 15, 20 and 30 m
ahead. The probability is a logistic function of a few numbers that a lane comes with; `tests/fit_confidence.py` drives
along roads, counts and fits.
"""

from __future__ import annotations

import numpy as np

from lanes.metric.lane import Lane
from lanes.metric.lanemodel import SIDES

RIGHT_M, RIGHT_AT_M = 0.2, np.array([5.0, 10.0, 15.0, 20.0, 30.0])
# A usual lane is so wide, metres.
USUAL_WIDTH_M = 3.5
# What the probability depends on: how surely the worse line is known 20 m ahead (logarithm of its standard deviation in
# metres; the lines' supports are in it), and by how much the lane is unusually wide or narrow, metres: a crack or kerb
# taken for a line is seldom a lane's width away from the other one.
FEATURES = ("constant", "log std", "odd width")
# For a lane found in a single picture, and for one followed.
STILL_WEIGHTS = np.array([-1.75, -1.55, -5.48])
TRACK_WEIGHTS = np.array([0.19, -1.19, -6.69])


def lane_features(lane: Lane) -> np.ndarray:
    """The features (3,) of a lane."""
    return np.array([1.0, np.log(lateral_std_m(lane, 20.0)), abs(lane.width_m - USUAL_WIDTH_M)])


def lateral_std_m(lane: Lane, x_m: float) -> float:
    """Standard deviation of the worse line's lateral place `x_m` ahead."""
    gradients = [np.array([1, side / 2, x_m, x_m**2 / 2, x_m**3 / 6, 0, 0]) for side in SIDES]
    return float(np.sqrt(max(g @ lane.covariance @ g for g in gradients)))


def rate_lane(lane: Lane, *, followed: bool = False) -> float:
    """Probability, 0 to 1, that a lane found in a single picture, or one that was `followed`, is right."""
    weights = TRACK_WEIGHTS if followed else STILL_WEIGHTS
    return float(1 / (1 + np.exp(-weights @ lane_features(lane))))
