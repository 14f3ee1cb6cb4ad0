"""Confidence: the probability that a lane is correct.

A lane is correct if both lines lie within 0.2 m of the true ones, as the root mean square over 5, 10, 15, 20 and 30 m
ahead. Where the camera pose was estimated from the same picture, metres are uncertain; there a lane is correct if both
lines are right in the picture. The probability is a logistic regression on a few features of the lane.
`tools/fit_confidence.py` fits it on painted roads and on the rendered suite, whose truth is known.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lanes.detect.road import lateral_std_m, max_curvature, max_vertical_curvature

if TYPE_CHECKING:
    from lanes.detect.lane import Lane

CORRECT_WITHIN_M, CORRECT_AT_M = 0.2, np.array([5.0, 10.0, 15.0, 20.0, 30.0])
# A lane with less confidence than the first is called uncertain; one with the second counts as sure.
LIKELY_CONFIDENCE, SURE_CONFIDENCE = 0.5, 0.9
# Names of the features, in the order of `lane_features`, where each is explained.
FEATURES = (
    *("constant", "log std", "near std", "odd width", "odd offset", "shorter reach", "bend"),
    *("support", "clutter", "between", "transverse", "odd heading", "odd yaw", "other lanes"),
)


@dataclass(frozen=True)
class ConfidenceModel:
    """Logistic regression on `FEATURES`, fitted by `tools/fit_confidence.py`."""

    # For a lane detected in a single picture, for one whose camera pose comes from a single picture, too, and for a
    # tracked one.
    still_weights: tuple[float, ...] = (
        *(-3.82, -0.84, -1.85, -5.24, -1.76, 0.0, 1.66, 0.0, 2.22, 2.33, -0.94, -3.92, 0.0, 0.0),
    )
    own_pose_weights: tuple[float, ...] = (
        *(-1.53, -0.47, 0.0, -0.48, -3.81, 1.29, 0.58, 2.51, 0.11, 2.25, -1.78, -0.68, 0.0, -3.54),
    )
    track_weights: tuple[float, ...] = (
        *(-3.65, -0.55, -2.11, -6.49, -2.9, 0.0, 0.0, 0.0, 2.63, 0.0, 0.0, -2.83, -4.14, 0.0),
    )
    # Usual width of lanes.
    usual_width_m: float = 3.5


CONFIDENCE = ConfidenceModel()


def lane_features(lane: Lane) -> np.ndarray:
    """The features (14,) of a lane, in the order of `FEATURES`; values beyond the limits carry no further information.

    Those of stills only are 0 for tracked lanes. "Own pose": the camera pose was estimated from the same picture.
    """
    far_m, tracked, own_pose = float(CORRECT_AT_M[-1]), lane.tracked, lane.same_lane_share is not None
    near_std_m, std_m = (float(lateral_std_m(lane.fit_covariance, x_m).max()) for x_m in (10.0, far_m))
    reach_m = min(lane.left.reach_m, lane.right.reach_m, 40.0)
    return np.array(
        [
            1.0,
            # Standard deviation (metres) of the less certain line 30 m ahead, for the noise that the fit assumes; that
            # of the errors (`Lane.covariance`) separates right and wrong lanes less well. At least 0.05 m in a still:
            # the lines of a floor of tiles are as certain as those of a road.
            np.log(std_m if tracked else max(std_m, 0.05)),
            # The same 10 m ahead, where the second line of a lane with one line is as uncertain as 30 m ahead, and the
            # lines of a hairpin are much less so.
            0.0 if own_pose else np.log(max(near_std_m, 0.07)),
            # A crack or kerb taken for a line is seldom a lane's width away from the other line.
            (lane.width_m - CONFIDENCE.usual_width_m) ** 2,
            # Distance from the lane centre beyond the usual one (metres); large ones occur in lane changes.
            min(max(abs(lane.offset_m), 0.3), 0.8) - 0.3,
            # Distance up to which both lines are seen.
            np.log((reach_m + CORRECT_AT_M[0]) / far_m) if own_pose else 0.0,
            # In bends the standard deviation grows faster than the errors.
            0.0 if tracked else abs(lane.curvature_per_m) * far_m,
            # A pose that shows paint on both lines is better; at most the support of two solid lines.
            min(lane.left.support**0.5 + lane.right.support**0.5, 1.5) if own_pose else 0.0,
            # Share of all paint-like stripes in view that the lane and its neighbours explain: bricks and letters look
            # like paint, too. With an own pose other lines may have given the pose, so that less clutter is usual.
            np.log(min(max(lane.inlier_share, 0.02) / (0.4 if own_pose else 0.2), 1.0)),
            # Tiles and bricks have lines between those of the lane, and joints across it; few roads have a stop line.
            0.0 if tracked else np.log(lane.clear_share),
            0.0 if tracked else min(lane.transverse_stripes, 2),
            # Heading beyond that of a car in a bend: it lags by the distance from the rear axle (2 m), at most. Heading
            # and yaw, which takes a drive, are large if the yaw of the camera pose is wrong.
            _excess(abs(lane.heading_rad) - 2.0 * abs(lane.curvature_per_m), 0.02),
            0.0 if lane.camera_yaw_rad is None else _excess(abs(lane.camera_yaw_rad), 0.01),
            # Share of the camera poses tried that do not show this lane: the picture allows several.
            0.0 if lane.same_lane_share is None else 1.0 - lane.same_lane_share,
        ]
    )


def _excess(angle_rad: float, usual_rad: float) -> float:
    """An angle beyond the usual one, relative to 0.05 rad, 0 to 1."""
    return min(max((angle_rad - usual_rad) / 0.05, 0.0), 1.0)


def feature_weights(lane: Lane) -> tuple[float, ...]:
    """Weights (14,) of the features of a lane."""
    if lane.tracked:
        return CONFIDENCE.track_weights
    return CONFIDENCE.still_weights if lane.same_lane_share is None else CONFIDENCE.own_pose_weights


def log_odds(lane: Lane) -> float:
    """Logarithm of the odds that a lane is correct."""
    return float(np.dot(feature_weights(lane), lane_features(lane)))


def rate_lane(lane: Lane) -> float:
    """Probability, 0 to 1, that a lane is correct."""
    return float(1 / (1 + np.exp(-log_odds(lane))))


# Variance of the errors relative to the variance that a fit or the filter assumes: a constant, and its growth with the
# largest curvature and the largest vertical curvature in view (1/m); tracked, and in a single image. Fit and filter
# assume more noise than most roads have, so that worn paint and hairpins do not surprise them. Fitted on variants 2 and
# 7 of the rendered suite.
TRACKED_ERRORS, STILL_ERRORS = (0.05, 75.0, 100.0), (0.5, 40.0, 0.0)


def error_variance_factor(lane: np.ndarray, *, tracked: bool) -> float:
    """Variance of the errors of a lane (15,), relative to the variance that its fit or the filter assumes."""
    constant, by_curvature, by_vertical = TRACKED_ERRORS if tracked else STILL_ERRORS
    return constant + by_curvature * max_curvature(lane) + by_vertical * max_vertical_curvature(lane)
