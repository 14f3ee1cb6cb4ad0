"""What a classic lane finder says about one frame, and what it saw on the way."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lanes.classic.fit import LineFit
from lanes.classic.measure import RoadLine, lane_offset_m, lane_width_m, radius_m
from lanes.classic.search import Window, window_edges
from lanes.classic.warp import FourPointWarp


@dataclass(frozen=True, eq=False)
class FoundLine:
    """One line in one frame, before memory: its fit, the pixels (N, 2) under it, where they came from."""

    fit: LineFit | None
    pixels: np.ndarray
    channel: str
    windows: tuple[Window, ...] = ()


@dataclass(frozen=True, eq=False)
class Steps:
    """What happened on the way, for looking at.

    Parameters
    ----------
    undistorted : ndarray of shape (height, width, 3), uint8
    masks : dict of ndarray (height, width), uint8
        Every binary by name; of the view if the recipe warps first, else of the picture.
    warped_binary : ndarray of shape (height, width), uint8
        The binary, or both lines' binaries, that the pixels were taken from, in the view.
    left, right : FoundLine
        What this frame alone gave.
    warp : FourPointWarp
    """

    undistorted: np.ndarray
    masks: dict[str, np.ndarray]
    warped_binary: np.ndarray
    left: FoundLine
    right: FoundLine
    warp: FourPointWarp

    @cached_property
    def view(self) -> np.ndarray:
        """The undistorted picture from above, RGB."""
        return self.warp.warp(self.undistorted)

    @property
    def windows(self) -> tuple[Window, ...]:
        """The windows of both lines; none for a line that was looked for near its last place."""
        return self.left.windows + self.right.windows

    @property
    def windows_px(self) -> np.ndarray:
        """(N, 4) left, top, right, bottom edge of each window, for drawing."""
        return window_edges(self.windows)


@dataclass(frozen=True, eq=False)
class LaneResult:
    """The lane in one frame; every measure is None where the lines it needs are missing.

    Parameters
    ----------
    left, right : LineFit or None
        The lines in the view, smoothed by the memory where there is one.
    left_road, right_road : RoadLine or None
        The same on the road, metres.
    state : {"found", "kept", "lost"}
        "found": both lines measured in this frame; "kept": both known, at least one from memory only; "lost": not both.
    steps : Steps
    """

    left: LineFit | None
    right: LineFit | None
    left_road: RoadLine | None
    right_road: RoadLine | None
    state: str
    steps: Steps

    @property
    def found(self) -> bool:
        """Whether both lines were measured in this very frame."""
        return self.state == "found"

    @property
    def warp(self) -> FourPointWarp:
        """The way between undistorted picture and view."""
        return self.steps.warp

    @property
    def left_px(self) -> np.ndarray | None:
        """The left line in the undistorted picture, (N, 2) from far to near, as `draw.draw_lane` takes it."""
        return self.left and self.warp.points_to_picture(self.left.points(self.warp.size[1]))

    @property
    def right_px(self) -> np.ndarray | None:
        """The right line, see `left_px`."""
        return self.right and self.warp.points_to_picture(self.right.points(self.warp.size[1]))

    @property
    def left_radius_m(self) -> float | None:
        """Signed radius of the left line beside the car, > 0 bends left."""
        return radius_m(self.left_road.curvature_per_m()) if self.left_road else None

    @property
    def right_radius_m(self) -> float | None:
        """Signed radius of the right line beside the car, > 0 bends left."""
        return radius_m(self.right_road.curvature_per_m()) if self.right_road else None

    @property
    def curvature_per_m(self) -> float | None:
        """Mean curvature of the lines there are, 1/m, > 0 bends left."""
        lines = [line.curvature_per_m() for line in (self.left_road, self.right_road) if line]
        return sum(lines) / len(lines) if lines else None

    @property
    def offset_m(self) -> float | None:
        """How far the car stands left of the lane's centre."""
        return lane_offset_m(self.left_road, self.right_road) if self.left_road and self.right_road else None

    @property
    def lane_width_m(self) -> float | None:
        """Distance between the lines."""
        return lane_width_m(self.left_road, self.right_road) if self.left_road and self.right_road else None

    def lateral_m(self, x_m: np.ndarray) -> np.ndarray | None:
        """Lateral places (2, N) of the left and right line at distances (N,), metres; None if not both are known."""
        if self.left_road is None or self.right_road is None:
            return None
        return np.array([self.left_road.lateral_m(x_m), self.right_road.lateral_m(x_m)])

    def as_row(self) -> dict[str, str | float | None]:
        """The measures by the column names of the telemetry."""
        row = {name: getattr(self, name) for name in ("state", "offset_m", "curvature_per_m", "lane_width_m")}
        for side, line in (("left", self.left_road), ("right", self.right_road)):
            for name in ("c0_m", "c1", "c2_per_m"):
                row[f"{side}_{name}"] = line and getattr(line, name)
        return row
