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
# A lane with less confidence is called unlikely.
LIKELY_CONFIDENCE = 0.5
# A lane with this confidence counts as sure.
SURE_CONFIDENCE = 0.9
# Features of a lane:
# - log std: logarithm of the standard deviation (metres) of the less certain line 30 m ahead, for the noise that the
#   fit assumes; that of the errors (`Lane.covariance`) separates right and wrong lanes less well. Of stills, small ones
#   are all the same: the lines of a floor of tiles are as certain as those of a road.
# - near std: the same 10 m ahead, where the second line of a lane with one line is as uncertain as 30 m ahead, and the
#   lines of a hairpin are much less so. Not of lanes whose pose is estimated from the same picture.
# - odd width: squared deviation from the usual width (metres): a crack or kerb taken for a line is seldom a lane's
#   width away from the other line.
# - odd offset: distance of the car from the lane centre (metres), where it is larger than usual.
# - shorter reach: logarithm of the distance up to which both lines are seen, if the pose is estimated from the same
#   picture.
# - bend: curvature times 30 m; in bends the standard deviation grows faster than the errors. Of stills only.
# - support: sum of the square roots of the lines' supports, if the pose is estimated from the same picture: a pose that
#   shows paint on both lines is better.
# - clutter: logarithm of the share of all paint-like stripes in view that the lane and its neighbours explain, where it
#   is smaller than usual: bricks and letters look like paint, too.
# - between: logarithm of the share of the stripes along the lane, on its lines and between them, that are on its lines;
#   of stills only. Tiles and bricks have lines between those of the lane.
# - transverse: number of painted stripes across the lane; of stills only. Tiles and bricks have joints there, few roads
#   have a stop line.
# - odd heading: heading beyond that of a car in a bend, where it is larger than usual, relative to 0.05 rad, at most 1.
#   It is large if the yaw of the camera pose is wrong.
# - odd yaw: the same of the direction of the car, seen from the camera; of tracked lanes only: it takes a drive.
# - other lanes: share of the camera poses tried that do not show this lane, if the pose is estimated from a single
#   picture; else 0. It is large if the picture allows several lanes.
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
        -3.65,
        -0.55,
        -2.11,
        -6.49,
        -2.9,
        0.0,
        0.0,
        0.0,
        2.63,
        0.0,
        0.0,
        -2.83,
        -4.14,
        0.0,
    )
    # Usual width of lanes.
    usual_width_m: float = 3.5
    # A smaller standard deviation in a still carries no further information.
    min_still_std_m: float = 0.05
    # The distance of the near standard deviation; a smaller one carries no further information.
    near_m: float = 10.0
    min_near_std_m: float = 0.07
    # Usual offset; larger ones than the maximum occur in lane changes and carry no further information.
    usual_offset_m: float = 0.3
    max_offset_m: float = 0.8
    # A longer reach carries little information about the lines up to 30 m ahead.
    max_reach_m: float = 40.0
    # A support of two solid lines; more carries no information.
    max_support: float = 1.5
    # Shares of explained stripes: usual ones are larger than this; smaller ones than the minimum are all the same. If
    # the pose comes from the same picture, other lines may have given it, so that less clutter is usual.
    usual_share: float = 0.2
    own_pose_usual_share: float = 0.4
    min_share: float = 0.02
    # More transverse stripes carry no further information.
    max_transverse: int = 2
    # Usual heading and yaw, and the excess from which on they carry no further information. In a bend the heading of
    # the camera lags by the distance from the rear axle, at most.
    usual_heading_rad: float = 0.02
    usual_yaw_rad: float = 0.01
    heading_lag_m: float = 2.0
    max_excess_rad: float = 0.05


CONFIDENCE = ConfidenceModel()


def lane_features(lane: Lane) -> np.ndarray:
    """The features (14,) of a lane, in the order of `FEATURES`."""
    c, far_m, tracked = CONFIDENCE, float(CORRECT_AT_M[-1]), lane.tracked
    near_std_m, std_m = (float(lateral_std_m(lane.fit_covariance, x_m).max()) for x_m in (c.near_m, far_m))
    reach_m = min(lane.left.reach_m, lane.right.reach_m, c.max_reach_m)
    heading_rad = abs(lane.heading_rad) - c.heading_lag_m * abs(lane.curvature_per_m)
    own_pose = lane.same_lane_share is not None
    support = min(lane.left.support**0.5 + lane.right.support**0.5, c.max_support)
    usual_share = c.own_pose_usual_share if own_pose else c.usual_share
    return np.array(
        [
            1.0,
            np.log(std_m if tracked else max(std_m, c.min_still_std_m)),
            0.0 if own_pose else np.log(max(near_std_m, c.min_near_std_m)),
            (lane.width_m - c.usual_width_m) ** 2,
            min(max(abs(lane.offset_m), c.usual_offset_m), c.max_offset_m) - c.usual_offset_m,
            np.log((reach_m + CORRECT_AT_M[0]) / far_m) if own_pose else 0.0,
            0.0 if tracked else abs(lane.curvature_per_m) * far_m,
            support if own_pose else 0.0,
            np.log(min(max(lane.inlier_share, c.min_share) / usual_share, 1.0)),
            0.0 if tracked else np.log(lane.clear_share),
            0.0 if tracked else min(lane.transverse_stripes, c.max_transverse),
            _excess(heading_rad - c.usual_heading_rad),
            0.0 if lane.camera_yaw_rad is None else _excess(abs(lane.camera_yaw_rad) - c.usual_yaw_rad),
            0.0 if lane.same_lane_share is None else 1.0 - lane.same_lane_share,
        ]
    )


def _excess(angle_rad: float) -> float:
    """An angle beyond the usual one, relative to `CONFIDENCE.max_excess_rad`, 0 to 1."""
    return min(max(angle_rad / CONFIDENCE.max_excess_rad, 0.0), 1.0)


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
TRACKED_ERRORS, STILL_ERRORS = (0.1, 150.0, 200.0), (0.5, 40.0, 0.0)


def error_variance_factor(lane: np.ndarray, *, tracked: bool) -> float:
    """Variance of the errors of a lane (15,), relative to the variance that its fit or the filter assumes."""
    constant, by_curvature, by_vertical = TRACKED_ERRORS if tracked else STILL_ERRORS
    return constant + by_curvature * max_curvature(lane) + by_vertical * max_vertical_curvature(lane)
