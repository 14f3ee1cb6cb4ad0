"""Result of a classic lane finder for one frame: lines on the road, measurements in metres, intermediate results.

Signs: curvature > 0: the road bends left; offset > 0: car left of the lane centre.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from classic.fit import LineFit
from classic.search import Window
from classic.warp import FourPointWarp


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


@dataclass(frozen=True, eq=False)
class FoundLine:
    """One line of one frame, before the memory: fit, pixels (N, 2), name of the channel, search windows."""

    fit: LineFit | None
    pixels: np.ndarray
    channel: str
    windows: tuple[Window, ...] = ()


@dataclass(frozen=True, eq=False)
class Steps:
    """Intermediate results of one frame, for display.

    Parameters
    ----------
    masks : dict of ndarray (height, width), uint8
        All binaries by name; of the bird's-eye view if the recipe warps first, otherwise of the picture.
    warped_binary : ndarray of shape (height, width), uint8
        Binary with the pixels of both lines, in the bird's-eye view.
    left, right : FoundLine
        Lines of this frame without the memory.
    """

    undistorted: np.ndarray
    masks: dict[str, np.ndarray]
    warped_binary: np.ndarray
    left: FoundLine
    right: FoundLine
    warp: FourPointWarp

    @cached_property
    def birdseye(self) -> np.ndarray:
        """Bird's-eye view of the undistorted picture, RGB."""
        return self.warp.warp(self.undistorted)

    @property
    def windows_px(self) -> np.ndarray:
        """(N, 4) left, top, right, bottom edge of each window; none for a line searched around the previous one."""
        return np.array(self.left.windows + self.right.windows, float).reshape(-1, 4)


@dataclass(frozen=True, eq=False)
class LaneResult:
    """The lane in one frame; a measurement is None if the lines it needs are missing.

    Parameters
    ----------
    left, right : LineFit or None
        Lines in the bird's-eye view, smoothed by the memory if there is one.
    left_road, right_road : RoadLine or None
        Lines on the road, metres.
    state : {"found", "kept", "lost"}
        "found": both lines measured in this frame; "kept": at least one line from memory; "lost": a line is missing.
    """

    left: LineFit | None
    right: LineFit | None
    left_road: RoadLine | None
    right_road: RoadLine | None
    state: str
    steps: Steps

    @property
    def found(self) -> bool:
        """Whether both lines were measured in this frame."""
        return self.state == "found"

    @property
    def warp(self) -> FourPointWarp:
        """Homography between the undistorted picture and the bird's-eye view."""
        return self.steps.warp

    @property
    def left_px(self) -> np.ndarray | None:
        """The left line in the undistorted picture, (N, 2) from far to near, for `overlay.draw_lane`."""
        return None if self.left is None else self.warp.points_to_picture(self.left.points(self.warp.size[1]))

    @property
    def right_px(self) -> np.ndarray | None:
        """The right line; see `left_px`."""
        return None if self.right is None else self.warp.points_to_picture(self.right.points(self.warp.size[1]))

    @property
    def curvature_per_m(self) -> float | None:
        """Mean curvature of the available lines in 1/m, > 0 bends left."""
        lines = [line.curvature_per_m() for line in (self.left_road, self.right_road) if line]
        return sum(lines) / len(lines) if lines else None

    @property
    def offset_m(self) -> float | None:
        """Offset from the lane centre in metres, > 0: car left of the lane centre."""
        if self.left_road is None or self.right_road is None:
            return None
        return -(self.left_road.c0_m + self.right_road.c0_m) / 2

    @property
    def lane_width_m(self) -> float | None:
        """Distance between the lines at the car in metres, perpendicular to the lane."""
        if self.left_road is None or self.right_road is None:
            return None
        left, right = self.left_road, self.right_road
        return (left.c0_m - right.c0_m) / float(np.hypot(1, (left.c1 + right.c1) / 2))

    def lateral_m(self, x_m: np.ndarray) -> np.ndarray | None:
        """Lateral positions (2, N) of the left and right line at distances (N,), metres; None if a line is missing."""
        if self.left_road is None or self.right_road is None:
            return None
        return np.array([self.left_road.lateral_m(x_m), self.right_road.lateral_m(x_m)])

    def as_row(self) -> dict[str, str | float | None]:
        """Measurements by the column names of the telemetry."""
        row = {name: getattr(self, name) for name in ("state", "offset_m", "curvature_per_m", "lane_width_m")}
        for side, line in (("left", self.left_road), ("right", self.right_road)):
            for name in ("c0_m", "c1", "c2_per_m"):
                row[f"{side}_{name}"] = line and getattr(line, name)
        return row
