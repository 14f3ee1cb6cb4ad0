"""Confidence: the probability that a lane is correct.

A lane is correct if both lines lie within 0.2 m of the true ones, as the root mean
square over 5, 10, 15, 20 and 30 m ahead. Where the camera pose was estimated from the
same image, metres are uncertain; there a lane is correct if both lines are right in the
image. The probability is a logistic regression on a few features of the lane.
`tools/fit_confidence.py` fits it on labelled real roads of many cameras, and on images
without a road.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from lanes.detect.road import (
    HEADING,
    WIDTH,
    UsualWidth,
    lateral_std_m,
    max_curvature,
    max_vertical_curvature,
)

CORRECT_WITHIN_M = 0.2
CORRECT_AT_M = np.array([5.0, 10.0, 15.0, 20.0, 30.0])
# A lane with less confidence is shown as no lane.
LEAST_CONFIDENCE = 0.15
# One with less is called uncertain.
LIKELY_CONFIDENCE = 0.5
# One with this confidence counts as sure.
SURE_CONFIDENCE = 0.9
# Weights of the logistic regression, fitted by `tools.fit_confidence`: the constant,
# and those of the features.
WEIGHTS = {
    "constant": -0.74,
    "near std": -2.73,
    "clear share": 6.6,
    "odd width": -0.5,
    "other lanes": -2.44,
    "far lines": 1.13,
    "odd heading": -3.0,
    "weaker line": 1.32,
}
# Limits of features. The lines of a floor of tiles are as certain as those of a road.
MIN_NEAR_STD_M = 0.1
# A line has paint on at least a few rows; with more than those of a good dashed line it
# is no more certain.
MIN_SUPPORT = 0.03
GOOD_SUPPORT = 0.4
# Usual width of lanes.
USUAL_WIDTH_M = 3.5
# Widths of lanes; those of a lane with its own pose, whose height is uncertain, too.
ROAD_WIDTH = UsualWidth(USUAL_WIDTH_M, 0.3, max_stds=float("inf"))
OWN_POSE_WIDTH = UsualWidth(USUAL_WIDTH_M, 0.9, max_stds=float("inf"))


def lane_features(  # noqa: PLR0913 (called by name)
    model: np.ndarray,
    fit_covariance: np.ndarray,
    curvature_per_m: float,
    supports: Sequence[float],
    *,
    clear_share: float,
    single_image_pose: bool,
    same_lane_share: float,
    far_lines: int,
    camera_yaw_rad: float,
    usual_width: UsualWidth = ROAD_WIDTH,
) -> dict[str, float]:
    """The features of a lane by name, in the order of `WEIGHTS`; values beyond limits
    carry no further information.

    `supports` are those of both lines, `far_lines` the number of far lines seen; the
    rest is that of a `Lane`.
    """
    if single_image_pose:
        usual_width = OWN_POSE_WIDTH
    near_std_m = float(lateral_std_m(fit_covariance, 15.0).max())
    support = min(*supports, GOOD_SUPPORT)

    # The heading, beyond that of a car in a bend, and the yaw of the camera relative to
    # its pose are large if the yaw of the pose is wrong. In a bend the heading lags by
    # the distance from the rear axle (2 m), at most.
    in_bend = 2.0 * abs(curvature_per_m)
    heading = _excess(abs(float(model[HEADING])) - in_bend, 0.02)
    yaw = _excess(abs(camera_yaw_rad), 0.01)
    return {
        "constant": 1.0,
        # Standard deviation (metres) of the less certain line 15 m ahead, for the noise
        # that the fit assumes; that of the errors (`Lane.covariance`) separates right
        # and wrong lanes less well. The borders of a room's floor end before.
        "near std": float(np.log(max(near_std_m, MIN_NEAR_STD_M))),
        # Tiles and bricks have lines between those of the lane; so have two lanes that
        # are taken for one.
        "clear share": float(np.log(clear_share)),
        # A crack or kerb taken for a line is seldom a lane's width away from the other
        # line.
        "odd width": usual_width.squared_distance(float(model[WIDTH])),
        # Share of the camera poses tried that do not show this lane: the image allows
        # several.
        "other lanes": 1.0 - same_lane_share,
        # Far lines of adjacent lanes that are seen: at the right height of the camera
        # they are a lane's width away. They add nothing for a pose that other images
        # show, too.
        "far lines": float(far_lines) if single_image_pose else 0.0,
        "odd heading": max(heading, yaw),
        # Support of the line with less paint: most wrong lanes have one line that is
        # seen and one that is a guess.
        "weaker line": float(np.log(MIN_SUPPORT + support)),
    }


def _excess(angle_rad: float, usual_rad: float) -> float:
    """An angle beyond the usual one, relative to 0.05 rad, 0 to 2."""
    return min(max((angle_rad - usual_rad) / 0.05, 0.0), 2.0)


def log_odds_losses(features: Mapping[str, float]) -> dict[str, float]:
    """Loss of log odds by feature, relative to the best possible value.

    The largest is the weakest evidence.
    """
    best = {
        "near std": float(np.log(MIN_NEAR_STD_M)),
        "weaker line": float(np.log(MIN_SUPPORT + GOOD_SUPPORT)),
    }
    losses = {}
    for name, value in features.items():
        if name != "constant":
            losses[name] = WEIGHTS[name] * (best.get(name, 0.0) - value)
    return losses


# Variance of the errors relative to the variance that a fit or the filter assumes: a
# constant, and its growth with the largest curvature and the largest vertical curvature
# in view (1/m); tracked, and in a single image. Fit and filter assume more noise than
# most roads have, so that worn paint and hairpins do not surprise them. Fitted on
# variants 2 and 7 of the rendered suite. On labelled real images the usual error is 0.8
# standard deviations, but a few wrong lines make the RMS 2.
TRACKED_ERRORS = (0.05, 75.0, 100.0)
STILL_ERRORS = (0.5, 40.0, 0.0)


def error_variance_factor(lane: np.ndarray, *, tracked: bool) -> float:
    """Variance of the errors of a lane (15,), relative to the variance that its fit or
    the filter assumes.
    """
    errors = TRACKED_ERRORS if tracked else STILL_ERRORS
    constant, by_curvature, by_vertical = errors
    of_curvature = by_curvature * max_curvature(lane)
    return constant + of_curvature + by_vertical * max_vertical_curvature(lane)
