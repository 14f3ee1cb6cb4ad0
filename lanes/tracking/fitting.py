"""One fit for both lines of a lane, robust against everything else that looks like a stripe.

Iteratively reweighted least squares: each stripe pulls on the nearer line, the more the stronger it is, the nearer it
lies and the better its direction agrees. The fit begins near the car and follows the lines outwards, so that it stays
on them where they bend away. What is usual for lanes enters as a prior, so that one line, or a few dashes, suffice.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from lanes.tracking.birdseye import BirdsEyeView
from lanes.tracking.markings import ANGLE_STD_RAD, BLIND_COLUMNS, Stripes, marking_weight, position_std
from lanes.tracking.model import (
    ADJACENT,
    CENTRE,
    CURVATURE,
    FAR_LINE,
    HEADING,
    LEFT_SIDE,
    LIMIT,
    PITCH,
    PRIOR_MEAN,
    RATE,
    RATE_STEPS,
    RIGHT_SIDE,
    SIDES,
    VERTICAL_CURVATURE,
    WIDTH,
    arc_coordinates,
    beyond_knots,
    flatten,
    intersect_ground,
    never_zero,
    prior_std,
)
from lanes.tracking.state import KalmanState

MODEL_ERROR_M, MODEL_ERROR_AT_M = 0.08, 40.0

# Steps of the fit: (how far it looks, how many standard deviations still pull).
START = ((16, 6), (20, 4), (26, 4))
GROW = ((34, 3), (44, 3), (56, 2), (70, 1.5), (70, 1))
# The same in small steps, for roads that bend or fall away so much that nothing farther out is where it is expected.
OUTWARDS = (
    *((far_m, 3.0) for far_m in (9.0, 11.0, 13.0, 16.0, 19.0, 23.0)),
    *((28.0, 2.0), (35.0, 2.0), (45.0, 2.0), (70.0, 1.0), (70.0, 1.0)),
)
# Paint lies beside a line when it is this near to it and runs so nearly along it, and not too far ahead. Where
# that many stripes of it are not explained by a lane, the road may bend or wave in a way that its fit did not reach.
BESIDE_M, BESIDE_RAD, BESIDE_FAR_M, UNEXPLAINED = 0.5, 0.3, 45.0, 8.0
# How much more than usual a road may curve up and down where that explains so many stripes more.
WAVES_PER_M, MORE_PAINT = 4e-3, 6.0

# A stripe is taken if its innovation squared over its variance is below this: chi-square of one degree of freedom,
# 99.7 %.
GATE = 9.0
# Stripes of one picture err together (the same paint, the same lens), so they count as so many times fewer.
VARIANCE_INFLATION = 4.0
# Passes of the correction: (how far it looks, how many standard deviations still pull).
NEAR_STEPS = ((70.0, 1.5), (70.0, 1.0))


@dataclass(frozen=True, eq=False)
class LaneFit:
    """Lanes fitted to the stripes of one frame; K of them, or one.

    Attributes
    ----------
    lane : ndarray (..., 15)
        The parameters, in the order of `lanes.tracking.model`.
    information : ndarray (..., 15, 15)
        Inverse covariance, prior included.
    weight : ndarray (..., stripes)
        How much each stripe supports the lane, 0 to 1.
    side : ndarray (..., stripes)
        The line that the stripe is nearest to: `LEFT_SIDE` or `RIGHT_SIDE`, or `FAR_LINE` times that.
    beside : ndarray (...)
        How much paint lies beside the lines, whether it is on them or not.
    """

    lane: np.ndarray
    information: np.ndarray
    weight: np.ndarray
    side: np.ndarray
    beside: np.ndarray

    def joined(self, other: LaneFit) -> LaneFit:
        """The lanes of both fits of the same stripes."""
        return LaneFit(*(np.concatenate([getattr(f, field.name) for f in (self, other)]) for field in fields(self)))


def model_error_m(stripes: Stripes) -> np.ndarray:
    """How far the road may stray from the model at each stripe, metres."""
    share = stripes.x_m / MODEL_ERROR_AT_M
    return MODEL_ERROR_M * (share * share * share)


def fit_lanes(
    lanes: np.ndarray,
    stripes: Stripes,
    height_m: float,
    focal_px: float,
    *,
    prior_mean: np.ndarray = PRIOR_MEAN,
    prior_information: np.ndarray | None = None,
    schedule: tuple = GROW,
    extra_vertical_per_m: float = 0.0,
    variance_inflation: float = 1.0,
) -> LaneFit:
    """Refine lanes (K, 15) by reweighted least squares, following both lines outwards.

    Each step weighs a stripe by its strength, by its distance from the nearer line (Geman-McClure) and by how well its
    direction agrees with the line's, then solves the normal equations together with the prior.

    Parameters
    ----------
    lanes : ndarray (K, 15)
        Starts.
    stripes : Stripes
    height_m, focal_px : float
        Of the camera.
    prior_mean : ndarray (15,)
    prior_information : ndarray (15, 15), optional
        Inverse covariance of the prior; by default that of `prior_std`.
    schedule : sequence of (far_m, scale)
    waves_per_m : float
        As of `prior_std`.
    together : float
        Stripes of one picture err together, so that they count as so many times fewer.

    Returns
    -------
    LaneFit
    """
    lanes, std, paint = np.array(lanes, float), position_std(stripes, focal_px), marking_weight(stripes)
    information, stray = None, model_error_m(stripes)
    for far_m, scale in schedule:
        found = compare(lanes, stripes, height_m)
        pull = paint * (stripes.x_m < far_m) / (variance_inflation * ((std * scale) ** 2 + stray**2))
        weighted = found.derivative * (found.agreement(std * scale, ease=scale) * pull)[:, None]
        prior = prior_information
        if prior is None:
            prior = (
                np.eye(len(prior_mean))
                / np.square(prior_std(lanes, extra_vertical_per_m=extra_vertical_per_m))[..., None]
            )
        information = weighted @ np.swapaxes(found.derivative, -1, -2) + prior
        gradient = weighted @ found.residual_m[..., None] + prior @ (lanes - prior_mean)[..., None]
        lanes = lanes - np.linalg.solve(information, gradient)[..., 0]
        lanes = np.clip(lanes, -LIMIT, LIMIT)
    found = compare(lanes, stripes, height_m)
    return LaneFit(lanes, information, found.agreement(std) * paint, found.side, markings_near(found, stripes, paint))


@dataclass(frozen=True, eq=False)
class Comparison:
    """How stripes lie beside lanes (K, 15).

    Attributes
    ----------
    residual_m : ndarray (K, stripes)
        Distance to the left of the nearer line.
    side : ndarray (K, stripes)
        `LEFT_SIDE` or `RIGHT_SIDE`: which line that is; `FAR_LINE` times that for the far lines of the lanes beside.
    astray_rad : ndarray (K, stripes)
        How much farther to the left than the stripe that line points.
    astray_std_rad : ndarray (K, stripes)
        How well that is known.
    derivative : ndarray (K, 15, stripes)
        Of the residual, for each number of the lane.
    """

    residual_m: np.ndarray
    side: np.ndarray
    angle_residual_rad: np.ndarray
    angle_std_rad: np.ndarray
    derivative: np.ndarray

    def agreement(self, std_m: np.ndarray, *, ease: float = 1.0) -> np.ndarray:
        """(K, stripes) weight 0..1 of stripes whose places are known to `std_m` (stripes,): Geman-McClure's, twice.

        Directions may differ `ease` times as much as usual.
        """
        q = (1 + (self.residual_m / std_m) ** 2) * (1 + (self.angle_residual_rad / (ease * self.angle_std_rad)) ** 2)
        return 1 / (q * q)


def compare(lanes: np.ndarray, stripes: Stripes, height_m: float) -> Comparison:
    """Lay stripes beside lanes (K, 15)."""
    centre, width, heading, curvature, rate = (lanes[:, k, None] for k in range(PITCH))
    ground = intersect_ground(stripes.x_m, lanes, height_m)
    x, y, angle = flatten(stripes.x_m, stripes.y_m, stripes.angle, ground, height_m)
    curvature = never_zero(curvature)
    a, turn, scale, ahead, aside = arc_coordinates(x, y, heading[..., 0], curvature[..., 0])
    along = turn / curvature
    squared, square = along * along, ahead * ahead + aside * aside
    bent = squared * along / 6
    beyond = beyond_knots(along)
    slopes = np.square(beyond) / 2
    bumps = slopes * beyond / 3
    kinks = lanes[:, RATE_STEPS, None]
    slope = rate / 2 * squared + (kinks * slopes).sum(axis=1)
    from_middle = a - rate * bent - (kinks * bumps).sum(axis=1) - centre
    aslant = np.sqrt(1 + slope * slope)
    # from halfway to the far line of the next lane on, a stripe is held against that one
    side = np.where(from_middle >= 0, LEFT_SIDE, RIGHT_SIDE)
    beyond = np.abs(from_middle) > aslant * width
    widths = np.where(beyond, 1.5, 0.5)
    next_lane = np.where(side > 0, lanes[:, None, ADJACENT.start], lanes[:, None, ADJACENT.start + 1])
    outwards = side * aslant
    residual = from_middle - outwards * (widths * width + beyond * next_lane)
    derivative = np.empty((*lanes.shape, len(stripes)))
    derivative[:, CENTRE] = -1
    derivative[:, WIDTH] = -outwards * widths
    derivative[:, HEADING] = -ahead / scale
    derivative[:, CURVATURE] = (a * a - square) / (2 * scale)
    derivative[:, RATE] = -bent
    # places move along their rays, by X / fall for each radian of pitch, and as if height / X were one
    derivative[:, PITCH] = (curvature * square - aside + slope * ahead / scale) / (scale * ground.fall)
    derivative[:, VERTICAL_CURVATURE] = np.moveaxis(ground.rises, -1, 1) * (derivative[:, PITCH] / x)[:, None]
    derivative[:, RATE_STEPS] = -bumps
    derivative[:, ADJACENT] = -outwards[:, None] * (beyond[:, None] & (side[:, None] == SIDES[:, None]))
    side[beyond] *= FAR_LINE
    direction = heading + turn + np.arctan(slope)
    # the tangent of the direction, without a division by the cosine of one that runs across
    columns = stripes.step * np.abs(np.sin(direction)) / np.maximum(np.cos(direction), 0.05)
    steepness = np.square(columns / BLIND_COLUMNS)
    astray_std = ANGLE_STD_RAD * (1 + steepness * steepness * steepness)
    return Comparison(residual, side, direction - angle, astray_std, derivative)


def markings_near(found: Comparison, stripes: Stripes, paint: np.ndarray) -> np.ndarray:
    """(K,) how much paint lies beside the lines of the lanes with which stripes were compared."""
    beside = (np.abs(found.residual_m) < BESIDE_M) & (np.abs(found.angle_residual_rad) < BESIDE_RAD)
    return (beside & (stripes.x_m < BESIDE_FAR_M)) @ paint


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


def fit_outwards(stripes: Stripes, estimate: KalmanState, view: BirdsEyeView, *, schedule: tuple) -> LaneFit:
    """The lane followed outwards from the car."""
    return fit_lanes(
        estimate.lane[None],
        stripes,
        view.height_m,
        view.focal_px,
        prior_mean=estimate.lane,
        prior_information=np.linalg.inv(estimate.lane_covariance),
        schedule=schedule,
        variance_inflation=VARIANCE_INFLATION,
    )


def fit_near(
    found: Comparison, stripes: Stripes, estimate: KalmanState, paint: np.ndarray, std_m: np.ndarray
) -> LaneFit:
    """The lane near the prediction, with which the stripes were compared.

    So small a step bends nothing: the stripes need not be laid beside the lane again.
    """
    expected, stray = gate_stripes(found, std_m, estimate.lane_covariance) * paint, model_error_m(stripes)
    prior, moved, step = np.linalg.inv(estimate.lane_covariance), found, np.zeros_like(estimate.lane)
    for far_m, scale in NEAR_STEPS:
        agreement = moved.agreement(std_m * scale)[0] * expected * (stripes.x_m < far_m)
        weighted = found.derivative[0] * (agreement / (VARIANCE_INFLATION * ((std_m * scale) ** 2 + stray**2)))
        information = weighted @ found.derivative[0].T + prior
        step = step - np.linalg.solve(information, weighted @ moved.residual_m[0] + prior @ step)
        moved = replace(found, residual_m=found.residual_m + step @ found.derivative[0])
    # the agreement is the one before the last step, which is small
    beside = markings_near(found, stripes, paint)
    return LaneFit((estimate.lane + step)[None], information[None], agreement[None], found.side, beside)
