"""One fit for both lines of a lane, robust against everything else that looks like a stripe.

Iteratively reweighted least squares: each stripe pulls on the nearer line, the more the stronger it is, the nearer it
lies and the better its direction agrees. The fit begins near the car and follows the lines outwards, so that it stays
on them where they bend away. What is usual for lanes enters as a prior, so that one line, or a few dashes, suffice.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from lanes.metric.evidence import Stripes
from lanes.metric.lanemodel import (
    BESIDE,
    BEYOND,
    CENTRE,
    CURVATURE,
    HEADING,
    KINKS,
    LEFT,
    PITCH,
    RATE,
    RIGHT,
    SIDES,
    VERTICAL,
    WIDTH,
    beyond_knots,
    flatten,
    meet_ground,
    never_zero,
    place,
)

# What is known of any lane before looking, and its standard deviation, in the order of `lanemodel`: lanes are 2.5
# to 4.5 m wide, cars drive near their middle and along them, hairpins have radii down to 12 m, cars nod by a degree,
# and the lanes of one road are about as wide.
PRIOR_MEAN = np.array([0.0, 3.5, *[0.0] * 13])
PRIOR_STD = np.array([0.8, 0.5, 0.15, 0.05, 1e-4, 0.015, *[2e-4] * 4, *[1e-4] * 3, 0.15, 0.15])
LIMIT = np.array([3.0, 6.0, 0.7, 0.12, 0.01, 0.06, *[0.015] * 4, *[0.01] * 3, 0.5, 0.5])
# A bend takes at least about this far from nothing to all of it.
TRANSITION_M = 15.0
# Kinks are as large as what they end or begin, and a little more; the prior of a sharp bend is wider, so that it is
# not drawn towards the straight. Roads that bend more than motorways do also wave, a little; and where they do, as much
# everywhere.
KINK_SHARE = 1.5
CURVATURE_SHARE = 1.0
VERTICAL_SHARE, GENTLE_PER_M = 0.03, 0.002
WAVE_SHARE = 1.0

# Strength (times the noise) at which a stripe counts half, and difference in direction at which it counts a quarter.
HALF_STRENGTH = 6.0
ANGLE_STD_RAD = 0.1
# A stripe that moves aside by this many columns from row to row shows its direction only half as well, and one that
# moves twice as much hardly at all.
BLIND_COLUMNS = 8.0
# Standard deviation of a stripe's lateral place: worn paint near by, one pixel far away; and how far a road of changing
# curvature strays from the model at 40 m, growing with the cube of the distance.
PLACE_STD_M, PLACE_STD_PX = 0.04, 1.0
STRAY_M, STRAY_AT_M = 0.08, 40.0

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


@dataclass(frozen=True, eq=False)
class LaneFit:
    """Lanes fitted to the stripes of one frame; K of them, or one.

    Attributes
    ----------
    lane : ndarray (..., 15)
        The parameters, in the order of `lanes.metric.lanemodel`.
    information : ndarray (..., 15, 15)
        Inverse covariance, prior included.
    weight : ndarray (..., stripes)
        How much each stripe supports the lane, 0 to 1.
    side : ndarray (..., stripes)
        The line that the stripe is nearest to: `LEFT` or `RIGHT`, or `BEYOND` times that.
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


def paint_weight(stripes: Stripes) -> np.ndarray:
    """How likely a stripe is paint, from its strength: 0 to 1."""
    return stripes.strength**2 / (stripes.strength**2 + HALF_STRENGTH**2)


def place_std(stripes: Stripes, focal_px: float) -> np.ndarray:
    """Standard deviation of each stripe's lateral place on the road, metres."""
    return np.hypot(PLACE_STD_M, PLACE_STD_PX * stripes.x_m / focal_px)


def stray_m(stripes: Stripes) -> np.ndarray:
    """How far the road may stray from the model at each stripe, metres."""
    share = stripes.x_m / STRAY_AT_M
    return STRAY_M * (share * share * share)


def usual_std(lanes: np.ndarray, *, waves_per_m: float = 0.0) -> np.ndarray:
    """Standard deviations (K, 15) of what is known before looking: a bent road may also change its bend soon.

    `waves_per_m` is by how much more than usual the road may curve up and down.
    """
    std = np.tile(PRIOR_STD, (len(lanes), 1))
    changing = np.abs(lanes[:, CURVATURE]) / TRANSITION_M
    std[:, CURVATURE] += CURVATURE_SHARE * np.abs(lanes[:, CURVATURE])
    std[:, RATE] += changing
    std[:, KINKS] += (KINK_SHARE * (changing + np.abs(lanes[:, RATE])))[:, None]
    std[:, VERTICAL] += waves_per_m
    std[:, VERTICAL] += VERTICAL_SHARE * np.maximum(np.abs(lanes[:, CURVATURE]) - GENTLE_PER_M, 0)[:, None]
    std[:, VERTICAL] += WAVE_SHARE * np.abs(lanes[:, VERTICAL]).max(axis=1, keepdims=True)
    return std


def strangeness(lanes: np.ndarray) -> np.ndarray:
    """(K,) squared distance from what is usual, in standard deviations."""
    return np.square((lanes - PRIOR_MEAN) / usual_std(lanes)).sum(axis=1)


def fit_lanes(
    lanes: np.ndarray,
    stripes: Stripes,
    height_m: float,
    focal_px: float,
    *,
    prior_mean: np.ndarray = PRIOR_MEAN,
    prior_information: np.ndarray | None = None,
    schedule: tuple = GROW,
    waves_per_m: float = 0.0,
    together: float = 1.0,
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
        Inverse covariance of the prior; by default that of `usual_std`.
    schedule : sequence of (far_m, scale)
    waves_per_m : float
        As of `usual_std`.
    together : float
        Stripes of one picture err together, so that they count as so many times fewer.

    Returns
    -------
    LaneFit
    """
    lanes, std, paint = np.array(lanes, float), place_std(stripes, focal_px), paint_weight(stripes)
    information, stray = None, stray_m(stripes)
    for far_m, scale in schedule:
        found = compare(lanes, stripes, height_m)
        pull = paint * (stripes.x_m < far_m) / (together * ((std * scale) ** 2 + stray**2))
        weighted = found.derivative * (found.agreement(std * scale, ease=scale) * pull)[:, None]
        prior = prior_information
        if prior is None:
            prior = np.eye(len(prior_mean)) / np.square(usual_std(lanes, waves_per_m=waves_per_m))[..., None]
        information = weighted @ np.swapaxes(found.derivative, -1, -2) + prior
        gradient = weighted @ found.residual_m[..., None] + prior @ (lanes - prior_mean)[..., None]
        lanes = lanes - np.linalg.solve(information, gradient)[..., 0]
        lanes = np.clip(lanes, -LIMIT, LIMIT)
    found = compare(lanes, stripes, height_m)
    return LaneFit(lanes, information, found.agreement(std) * paint, found.side, paint_beside(found, stripes, paint))


@dataclass(frozen=True, eq=False)
class Comparison:
    """How stripes lie beside lanes (K, 15).

    Attributes
    ----------
    residual_m : ndarray (K, stripes)
        Distance to the left of the nearer line.
    side : ndarray (K, stripes)
        `LEFT` or `RIGHT`: which line that is; `BEYOND` times that for the far lines of the lanes beside.
    astray_rad : ndarray (K, stripes)
        How much farther to the left than the stripe that line points.
    astray_std_rad : ndarray (K, stripes)
        How well that is known.
    derivative : ndarray (K, 15, stripes)
        Of the residual, for each number of the lane.
    """

    residual_m: np.ndarray
    side: np.ndarray
    astray_rad: np.ndarray
    astray_std_rad: np.ndarray
    derivative: np.ndarray

    def agreement(self, std_m: np.ndarray, *, ease: float = 1.0) -> np.ndarray:
        """(K, stripes) weight 0..1 of stripes whose places are known to `std_m` (stripes,): Geman-McClure's, twice.

        Directions may differ `ease` times as much as usual.
        """
        q = (1 + (self.residual_m / std_m) ** 2) * (1 + (self.astray_rad / (ease * self.astray_std_rad)) ** 2)
        return 1 / (q * q)


def compare(lanes: np.ndarray, stripes: Stripes, height_m: float) -> Comparison:
    """Lay stripes beside lanes (K, 15)."""
    centre, width, heading, curvature, rate = (lanes[:, k, None] for k in range(PITCH))
    ground = meet_ground(stripes.x_m, lanes, height_m)
    x, y, angle = flatten(stripes.x_m, stripes.y_m, stripes.angle, ground, height_m)
    curvature = never_zero(curvature)
    a, turn, scale, ahead, aside = place(x, y, heading[..., 0], curvature[..., 0])
    along = turn / curvature
    squared, square = along * along, ahead * ahead + aside * aside
    bent = squared * along / 6
    beyond = beyond_knots(along)
    slopes = np.square(beyond) / 2
    bumps = slopes * beyond / 3
    kinks = lanes[:, KINKS, None]
    slope = rate / 2 * squared + (kinks * slopes).sum(axis=1)
    from_middle = a - rate * bent - (kinks * bumps).sum(axis=1) - centre
    aslant = np.sqrt(1 + slope * slope)
    # from halfway to the far line of the next lane on, a stripe is held against that one
    side = np.where(from_middle >= 0, LEFT, RIGHT)
    beyond = np.abs(from_middle) > aslant * width
    widths = np.where(beyond, 1.5, 0.5)
    next_lane = np.where(side > 0, lanes[:, None, BESIDE.start], lanes[:, None, BESIDE.start + 1])
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
    derivative[:, VERTICAL] = np.moveaxis(ground.rises, -1, 1) * (derivative[:, PITCH] / x)[:, None]
    derivative[:, KINKS] = -bumps
    derivative[:, BESIDE] = -outwards[:, None] * (beyond[:, None] & (side[:, None] == SIDES[:, None]))
    side[beyond] *= BEYOND
    direction = heading + turn + np.arctan(slope)
    # the tangent of the direction, without a division by the cosine of one that runs across
    columns = stripes.step * np.abs(np.sin(direction)) / np.maximum(np.cos(direction), 0.05)
    steepness = np.square(columns / BLIND_COLUMNS)
    astray_std = ANGLE_STD_RAD * (1 + steepness * steepness * steepness)
    return Comparison(residual, side, direction - angle, astray_std, derivative)


def paint_beside(found: Comparison, stripes: Stripes, paint: np.ndarray) -> np.ndarray:
    """(K,) how much paint lies beside the lines of the lanes with which stripes were compared."""
    beside = (np.abs(found.residual_m) < BESIDE_M) & (np.abs(found.astray_rad) < BESIDE_RAD)
    return (beside & (stripes.x_m < BESIDE_FAR_M)) @ paint
