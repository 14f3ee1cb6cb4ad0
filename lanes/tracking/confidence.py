"""How sure a lane is: the probability that it is right, learned from drives whose truth is known.

Right means: both lines lie within 0.2 m of the true ones, as the root of the mean square over 5, 10, 15, 20 and 30 m
ahead. The probability is a logistic function of a few numbers that a lane comes with; `tools/fit_confidence.py` drives
along roads, counts and fits.
"""

from __future__ import annotations

import numpy as np

from lanes.tracking.lane import Lane
from lanes.tracking.model import SIDES, lateral_gradient

RIGHT_M, RIGHT_AT_M = 0.2, np.array([5.0, 10.0, 15.0, 20.0, 30.0])
# A usual lane is so wide, metres; cars change lanes, so that beyond some distance from the middle more says nothing;
# and what is seen of a line beyond some distance says little of it up to 30 m ahead.
USUAL_WIDTH_M, MOST_OFFSET_M, MOST_REACH_M = 3.5, 0.8, 40.0
# What the probability depends on: how surely the worse line is known 30 m ahead (logarithm of its standard deviation in
# metres; the lines' supports are in it); by how much the lane is unusually wide or narrow (metres, squared): a crack or
# kerb taken for a line is seldom a lane's width away from the other one; how far from its middle the car is (metres);
# how far the lines are seen, the one that is seen less far first (logarithms); and the bend, in which the standard
# deviation grows faster than errors do (curvature times 30 m). An odd pitch would tell more on rendered roads, but real
# ones are less even: there it makes the confidence worse.
FEATURES = ("constant", "log std", "odd width", "offset", "shorter reach", "longer reach", "bend")
# For a lane found in a single picture, and for one followed.
STILL_WEIGHTS = np.array([-0.57, -1.53, -6.45, -2.71, 0.53, 1.06, 3.06])
TRACK_WEIGHTS = np.array([1.49, -0.78, -6.14, -3.06, 0.15, 1.41, 0.85])


def lane_features(lane: Lane) -> np.ndarray:
    """The features (7,) of a lane, in the order of `FEATURES`."""
    far_m = RIGHT_AT_M[-1]
    reach = np.minimum(sorted((lane.left.reach_m, lane.right.reach_m)), MOST_REACH_M)
    return np.array(
        [
            1.0,
            np.log(lateral_std_m(lane, far_m)),
            (lane.width_m - USUAL_WIDTH_M) ** 2,
            min(abs(lane.offset_m), MOST_OFFSET_M),
            *np.log((reach + RIGHT_AT_M[0]) / far_m),
            abs(lane.curvature_per_m) * far_m,
        ]
    )


def lateral_std_m(lane: Lane, x_m: float) -> float:
    """Standard deviation of the worse line's lateral place `x_m` ahead."""
    gradients = [lateral_gradient(x_m, side) for side in SIDES]
    return float(np.sqrt(max(g @ lane.covariance @ g for g in gradients)))


def rate_lane(lane: Lane, *, followed: bool = False) -> float:
    """Probability, 0 to 1, that a lane found in a single picture, or one that was `followed`, is right."""
    weights = TRACK_WEIGHTS if followed else STILL_WEIGHTS
    return float(1 / (1 + np.exp(-weights @ lane_features(lane))))
