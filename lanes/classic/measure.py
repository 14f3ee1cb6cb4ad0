"""Measurements in metres from fitted lines: curvature, offset, lane width.

Signs: curvature > 0: the road bends left; offset > 0: car left of the lane centre.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lanes.classic.fit import LineFit


@dataclass(frozen=True)
class RoadLine:
    """A lane line on the road: y(x) = c0 + c1 x + c2 x^2 / 2, x forward and y left of the car, metres."""

    c0_m: float
    c1: float
    c2_per_m: float

    def lateral_m(self, x_m: np.ndarray | float) -> np.ndarray | float:
        """Lateral position at `x_m` metres ahead, positive left."""
        return self.c0_m + self.c1 * x_m + self.c2_per_m * np.square(x_m) / 2

    def curvature_per_m(self, x_m: float = 0.0) -> float:
        """Signed curvature y'' / (1 + y'^2)^1.5 in 1/m, by default at the car."""
        return self.c2_per_m / (1 + (self.c1 + self.c2_per_m * x_m) ** 2) ** 1.5


def road_line(fit: LineFit, to_road: Callable[[np.ndarray], np.ndarray], height: int) -> RoadLine | None:
    """The line on the road: points of the line in the bird's-eye view are mapped to the road and fitted in metres.

    A parabola in the bird's-eye view is a parabola on the road only if the scales are constant, but points can always
    be mapped.

    Parameters
    ----------
    to_road : callable
        Maps points (N, 2) of the bird's-eye view to road points (N, 2) in metres: `warp.birdseye_to_road` or
        `warp.scale_to_road`.
    height : int
        Height of the bird's-eye view in pixels; the line is sampled over all rows.

    Returns
    -------
    RoadLine or None
        None if fewer than three points are on the road (the others are above the horizon).
    """
    rows = np.linspace(0, height - 1, 60)
    points = to_road(np.column_stack([fit.columns(rows), rows]))
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < 3 or np.ptp(points[:, 0]) == 0:
        return None
    half_c2, c1, c0 = np.polyfit(points[:, 0], points[:, 1], 2)
    return RoadLine(float(c0), float(c1), float(2 * half_c2))


def lane_offset_m(left: RoadLine, right: RoadLine) -> float:
    """Offset of the car from the lane centre in metres, > 0: car left of the lane centre."""
    return -(left.c0_m + right.c0_m) / 2


def lane_width_m(left: RoadLine, right: RoadLine) -> float:
    """Distance between the two lines at the car in metres, perpendicular to the lane."""
    return (left.c0_m - right.c0_m) / float(np.hypot(1, (left.c1 + right.c1) / 2))
