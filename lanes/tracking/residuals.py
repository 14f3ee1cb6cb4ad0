"""Residuals: distances of the stripes from the lines of a lane, with their derivatives by the lane's parameters.

The distance of a point from the arc, at right angles, needs no function y(x). Hairpins that fold back need no special
case:

    a (1 - k a / 2) = y cos h - x sin h - k (x^2 + y^2) / 2        for heading h and curvature k,

which follows from ``|P - C| = 1/k - a`` for a circle of centre C. Concentric lines differ in `a` alone.

The stripes come from the flat grid of the view. They are first moved along their rays onto the lane's own road, which
is pitched and curved vertically.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lanes.tracking.markings import MARKINGS, Stripes
from lanes.tracking.model import (
    ADJACENT,
    CENTRE,
    CURVATURE,
    FAR_LINE,
    HEADING,
    LEFT_SIDE,
    PITCH,
    RATE,
    RATE_STEPS,
    RIGHT_SIDE,
    SIDES,
    VERTICAL_CURVATURE,
    WIDTH,
    beyond_knots,
    height_and_grade,
    never_zero,
)

# Distances of the lookup table for intersections of rays with the road, farthest first; the error is below a
# millimetre of height.
ROAD_M = np.geomspace(350.0, 2.0, 160)
# Lower bound for how fast a ray approaches the road, relative to a flat road: rays that graze a crest.
MIN_RELATIVE_FALL = 0.2
# Lower bound for (1 - k a)^2: near the centre of the arc a point has no side.
MIN_SQUARED_SCALE = 1e-2
_INVERSE_ROAD_M = 1 / ROAD_M
_ROAD_HEIGHTS = height_and_grade(ROAD_M)[0]


class Ground(NamedTuple):
    """Intersections of rays with the roads of lanes (..., 15)."""

    # (..., N) distance ahead, and how fast the ray approaches the road there, metres of height per metre ahead.
    x_m: np.ndarray
    fall: np.ndarray
    # (..., N, 4) height of the road there per unit of each vertical curvature.
    heights: np.ndarray


def intersect_ground(x_m: np.ndarray, lanes: np.ndarray, height_m: float) -> Ground:
    """Intersections of rays, given by their distances x (N,) on a flat road, with the roads of lanes (..., 15).

    The ray to the flat distance x falls by h / x per metre. With additional camera pitch it falls by h / x + pitch, and
    it meets the road of height z where z + (h / x + pitch) X = h. For a flat road 1/X is linear in 1/x, for others
    nearly so; it is interpolated in a table.
    """
    lanes = np.asarray(lanes)
    ray_fall = height_m / x_m + lanes[..., PITCH, None]
    # road that is lower in the picture than nearer road is hidden behind it
    falls = _INVERSE_ROAD_M * (height_m - lanes[..., VERTICAL_CURVATURE] @ _ROAD_HEIGHTS.T)
    falls = np.minimum.accumulate(falls[..., ::-1], axis=-1)[..., ::-1]
    inverse_x = np.empty(ray_fall.shape)
    for index in np.ndindex(ray_fall.shape[:-1]):
        inverse_x[index] = np.interp(ray_fall[index], falls[index], _INVERSE_ROAD_M)
    x = 1 / inverse_x
    heights, grades = height_and_grade(x)
    fall = ray_fall + (grades @ lanes[..., VERTICAL_CURVATURE, None])[..., 0]
    return Ground(x, np.maximum(fall, MIN_RELATIVE_FALL * height_m * inverse_x), heights)


def flatten(x_m, y_m, angle, ground: Ground, height_m: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stripes of the flat view on the ground: x, y in metres and angle in radians, (..., N) each."""
    scale = ground.x_m / x_m
    # derivative of the distance on the ground with respect to that on the flat view
    stretch = scale * height_m / (x_m * ground.fall)
    slope = (scale * np.tan(angle) + (stretch - scale) * y_m / x_m) / stretch
    return ground.x_m, y_m * scale, np.arctan(slope)


def arc_coordinates(x, y, heading, curvature) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Points (..., N) relative to arcs (...): (a, turn, 1 - k a, ahead, aside).

    `a` is the distance to the left of the arc, at right angles, and `turn` the direction of the arc there minus its
    initial direction. `ahead` and `aside` are the point's coordinates along and left of the initial direction.
    """
    heading, curvature = np.asarray(heading)[..., None], np.asarray(curvature)[..., None]
    sin, cos = np.sin(heading), np.cos(heading)
    ahead, aside = x * cos + y * sin, y * cos - x * sin
    twice = 2 * aside - curvature * (ahead * ahead + aside * aside)
    scale = np.sqrt(np.maximum(1 - curvature * twice, MIN_SQUARED_SCALE))
    return twice / (1 + scale), np.arctan2(curvature * ahead, 1 - curvature * aside), scale, ahead, aside


@dataclass(frozen=True, eq=False)
class StripeResiduals:
    """Residuals of stripes with respect to lanes (K, 15)."""

    # (K, stripes) distance to the left of the nearest line, and that line: `LEFT_SIDE` or `RIGHT_SIDE`, or `FAR_LINE`
    # times that for the far lines of adjacent lanes.
    residual_m: np.ndarray
    side: np.ndarray
    # (K, stripes) direction of that line minus direction of the stripe, positive left, and its standard deviation.
    angle_residual_rad: np.ndarray
    angle_std_rad: np.ndarray
    # (K, 15, stripes) derivative of `residual_m` by each parameter.
    jacobian: np.ndarray

    def weights(self, std_m: np.ndarray, *, angle_scale: float = 1.0) -> np.ndarray:
        """(K, stripes) weights 0 to 1 by residual and by angle residual, each after Geman and McClure (1987).

        `std_m` (stripes,) is the standard deviation of the residuals; that of the directions is multiplied by
        `angle_scale`.
        """
        angle_std = angle_scale * self.angle_std_rad
        q = (1 + (self.residual_m / std_m) ** 2) * (1 + (self.angle_residual_rad / angle_std) ** 2)
        return 1 / (q * q)

    def near(self, distance_m: float, angle_rad: float) -> np.ndarray:
        """(K, stripes) bool: both residuals are smaller than this."""
        return (np.abs(self.residual_m) < distance_m) & (np.abs(self.angle_residual_rad) < angle_rad)


def stripe_residuals(lanes: np.ndarray, stripes: Stripes, height_m: float) -> StripeResiduals:
    """Residuals of stripes with respect to lanes (K, 15), for a camera `height_m` above the road."""
    centre, width, heading, curvature, rate = (lanes[:, k, None] for k in range(PITCH))
    ground = intersect_ground(stripes.x_m, lanes, height_m)
    x, y, angle = flatten(stripes.x_m, stripes.y_m, stripes.angle, ground, height_m)
    curvature = never_zero(curvature)
    a, turn, scale, ahead, aside = arc_coordinates(x, y, heading[..., 0], curvature[..., 0])
    along = turn / curvature
    squared, square = along * along, ahead * ahead + aside * aside
    cubic = squared * along / 6
    beyond = beyond_knots(along)
    step_slopes = np.square(beyond) / 2
    step_offsets = step_slopes * beyond / 3
    rate_steps = lanes[:, RATE_STEPS, None]
    slope = rate / 2 * squared + (rate_steps * step_slopes).sum(axis=1)
    from_centre = a - rate * cubic - (rate_steps * step_offsets).sum(axis=1) - centre
    slant = np.sqrt(1 + slope * slope)
    # beyond the middle of an adjacent lane the nearest line is its far line
    side = np.where(from_centre >= 0, LEFT_SIDE, RIGHT_SIDE)
    far = np.abs(from_centre) > slant * width
    widths = np.where(far, 1.5, 0.5)
    extra_width = np.where(side > 0, lanes[:, None, ADJACENT.start], lanes[:, None, ADJACENT.start + 1])
    outwards = side * slant
    residual = from_centre - outwards * (widths * width + far * extra_width)
    jacobian = np.empty((*lanes.shape, len(stripes)))
    jacobian[:, CENTRE] = -1
    jacobian[:, WIDTH] = -outwards * widths
    jacobian[:, HEADING] = -ahead / scale
    jacobian[:, CURVATURE] = (a * a - square) / (2 * scale)
    jacobian[:, RATE] = -cubic
    # a stripe moves along its ray by X / fall per radian of pitch; height / X is taken as 1
    jacobian[:, PITCH] = (curvature * square - aside + slope * ahead / scale) / (scale * ground.fall)
    jacobian[:, VERTICAL_CURVATURE] = np.moveaxis(ground.heights, -1, 1) * (jacobian[:, PITCH] / x)[:, None]
    jacobian[:, RATE_STEPS] = -step_offsets
    jacobian[:, ADJACENT] = -outwards[:, None] * (far[:, None] & (side[:, None] == SIDES[:, None]))
    side[far] *= FAR_LINE
    direction = heading + turn + np.arctan(slope)
    return StripeResiduals(residual, side, direction - angle, _angle_std(direction, stripes), jacobian)


def _angle_std(direction: np.ndarray, stripes: Stripes) -> np.ndarray:
    """(K, stripes) standard deviation of the stripes' directions, larger where a line moves fast across the columns."""
    # the tangent of the direction, with a lower bound for the cosine of one that runs across
    columns = stripes.step * np.abs(np.sin(direction)) / np.maximum(np.cos(direction), 0.05)
    steepness = np.square(columns / MARKINGS.blind_columns)
    return MARKINGS.angle_std_rad * (1 + steepness * steepness * steepness)
