"""Confidence: the probability that a lane is correct.

A lane is correct if both lines lie within 0.2 m of the true ones, as the root mean square over 5, 10, 15, 20 and 30 m
ahead. The probability is a logistic regression on a few features of the lane. `tools/fit_confidence.py` fits it on
painted roads and on the rendered suite, whose truth is known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lanes.tracking.lane import Lane
from lanes.tracking.model import lateral_std_m

CORRECT_WITHIN_M, CORRECT_AT_M = 0.2, np.array([5.0, 10.0, 15.0, 20.0, 30.0])
# Features of a lane:
# - log std: logarithm of the standard deviation (metres) of the less certain line 30 m ahead; it includes the supports.
# - odd width: squared deviation from the usual width (metres): a crack or kerb taken for a line is seldom a lane's
#   width away from the other line.
# - offset: distance of the car from the lane centre (metres).
# - shorter reach, longer reach: logarithms of the distances up to which the lines are seen.
# - bend: curvature times 30 m; in bends the standard deviation grows faster than the errors.
# An unusual pitch would improve the fit on rendered roads, but real roads are less even, and it makes them worse.
FEATURES = ("constant", "log std", "odd width", "offset", "shorter reach", "longer reach", "bend")


@dataclass(frozen=True)
class ConfidenceModel:
    """Logistic regression on `FEATURES`, fitted by `tools/fit_confidence.py`."""

    # For a lane detected in a single picture, and for a tracked one.
    still_weights: tuple[float, ...] = (-0.57, -1.53, -6.45, -2.71, 0.53, 1.06, 3.06)
    track_weights: tuple[float, ...] = (1.49, -0.78, -6.14, -3.06, 0.15, 1.41, 0.85)
    # Usual width of lanes.
    usual_width_m: float = 3.5
    # Larger offsets occur in lane changes and carry no further information.
    max_offset_m: float = 0.8
    # A longer reach carries little information about the lines up to 30 m ahead.
    max_reach_m: float = 40.0


CONFIDENCE = ConfidenceModel()


def lane_features(lane: Lane) -> np.ndarray:
    """The features (7,) of a lane, in the order of `FEATURES`."""
    far_m = CORRECT_AT_M[-1]
    reach = np.minimum(sorted((lane.left.reach_m, lane.right.reach_m)), CONFIDENCE.max_reach_m)
    return np.array(
        [
            1.0,
            np.log(lateral_std_m(lane.assumed_covariance, far_m).max()),
            (lane.width_m - CONFIDENCE.usual_width_m) ** 2,
            min(abs(lane.offset_m), CONFIDENCE.max_offset_m),
            *np.log((reach + CORRECT_AT_M[0]) / far_m),
            abs(lane.curvature_per_m) * far_m,
        ]
    )


def rate_lane(lane: Lane, *, tracked: bool = False) -> float:
    """Probability, 0 to 1, that a lane is correct; `tracked`, or detected in a single picture."""
    weights = CONFIDENCE.track_weights if tracked else CONFIDENCE.still_weights
    return float(1 / (1 + np.exp(-np.dot(weights, lane_features(lane)))))
