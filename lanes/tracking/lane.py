"""Result types: the profile of a marking, one line, and the lane with its geometry, all in metres."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lanes.camera.camera import Camera
from lanes.io.describe import describe_bend, describe_heading, describe_offset, html_table
from lanes.tracking.model import SIDES, line_points, line_y, road_height

# Default arc lengths of an outline: from below the picture to the horizon.
OUTLINE_M = np.geomspace(3.0, 400.0, 120)
# A painted stripe is 0.10 to 0.15 m wide; two of them with their gap are 0.25 m wide or more.
STRIPE_M, DOUBLE_FROM_M = 0.12, 0.23


@dataclass(frozen=True)
class MarkingProfile:
    """Cross-section of a line's marking.

    Attributes
    ----------
    width_m : float
        Width of the painted band at half its height: of a double line both stripes and the gap between them.
    centre_m : float
        Centre of the band, left of the fitted line.
    yellow : bool
        Its contrast in yellowness is larger than in lightness.
    contrast : float
        Height over the adjacent road, in units of that road's noise.
    """

    width_m: float
    centre_m: float
    yellow: bool
    contrast: float

    @property
    def double(self) -> bool:
        """Two stripes side by side."""
        return self.width_m > DOUBLE_FROM_M

    def stripe_m(self, side: float) -> float:
        """Position of the stripe next to the lane, left of the fitted line; `side` is +1 for the left line, else -1."""
        return self.centre_m - side * (self.width_m - STRIPE_M) / 2 if self.double else self.centre_m


@dataclass(frozen=True, eq=False)
class LaneLine:
    """One line of the lane: y(x) = c0 + c1 x + c2 x^2 / 2 + c3 x^3 / 6 near the car, metres, x forward, y left.

    Attributes
    ----------
    c0_m, c1, c2_per_m, c3_per_m2 : float
    c0_std_m : float
        Standard deviation of `c0_m`.
    support : float
        Share of the line's visible rows, up to 50 m, that have markings on them: 0.3 is a good dashed line.
    reach_m : float
        Distance of the farthest stripe on the line.
    seen : bool
        False if the line was only inferred from the other one and the usual width of lanes.
    profile : MarkingProfile, optional
    """

    c0_m: float
    c1: float
    c2_per_m: float
    c3_per_m2: float
    c0_std_m: float
    support: float
    reach_m: float
    seen: bool
    profile: MarkingProfile | None = None

    def y(self, x_m: float | np.ndarray) -> float | np.ndarray:
        """Lateral position at distances x near the car, metres."""
        return self.c0_m + x_m * (self.c1 + x_m * (self.c2_per_m / 2 + x_m * self.c3_per_m2 / 6))

    def summary(self) -> str:
        """Lateral position at the car, and the evidence for it."""
        beside = f"{abs(self.c0_m):.2f} ± {self.c0_std_m:.2f} m {'left' if self.c0_m > 0 else 'right'}"
        if not self.seen:
            return f"{beside}, inferred from the other line"
        return f"{beside}, paint on {min(self.support, 1):.0%} of its rows, up to {self.reach_m:.0f} m"


@dataclass(frozen=True, eq=False)
class Lane:
    """The ego lane, in SI units.

    Attributes
    ----------
    offset_m, offset_std_m : float
        Position of the car left of the lane centre, and its standard deviation.
    heading_rad : float
        Direction of the road seen from the car, positive left.
    curvature_per_m, curvature_std_per_m : float
        Curvature at the car, positive for a left bend.
    curvature_rate_per_m2 : float
        Change of the curvature per metre.
    width_m, width_std_m : float
    pitch_rad : float
        Pitch of the camera in this frame minus that of its pose, positive down.
    vertical_per_m : float
        Vertical curvature of the road at the car, positive upwards.
    left, right : LaneLine
    score : float
        Sum of the square roots of the lines' supports minus the penalty of the prior.
    margin : float
        Score minus that of the next best lane.
    model : ndarray (15,)
        Parameters as in `lanes.tracking.model`, for the stripes next to the lane.
    covariance : ndarray (15, 15)
        Of the parameters.
    """

    offset_m: float
    offset_std_m: float
    heading_rad: float
    curvature_per_m: float
    curvature_std_per_m: float
    curvature_rate_per_m2: float
    width_m: float
    width_std_m: float
    pitch_rad: float
    vertical_per_m: float
    left: LaneLine
    right: LaneLine
    score: float
    margin: float
    model: np.ndarray
    covariance: np.ndarray

    @property
    def lines(self) -> tuple[LaneLine, LaneLine]:
        """The left and the right line."""
        return self.left, self.right

    def summary(self) -> dict[str, str]:
        """Offset, bend, heading, width and both lines in words, by name."""
        return {
            "offset": describe_offset(self.offset_m, self.offset_std_m),
            "bend": f"{describe_bend(self.curvature_per_m)} "
            f"({1e3 * self.curvature_per_m:.2f} ± {1e3 * self.curvature_std_per_m:.2f} per km)",
            "heading": describe_heading(self.heading_rad),
            "width": f"{self.width_m:.2f} ± {self.width_std_m:.2f} m",
            "left line": self.left.summary(),
            "right line": self.right.summary(),
        }

    def __repr__(self) -> str:
        words = self.summary()
        return f"Lane({words['offset']}, {describe_bend(self.curvature_per_m)}, {words['width']} wide)"

    def _repr_html_(self) -> str:
        return html_table("Lane", self.summary())

    def lateral_m(self, x_m: np.ndarray) -> np.ndarray:
        """Lateral positions (2, N) of the left and right line at distances (N,), metres; as `line_y`."""
        return np.array([self.line_y(x_m, side) for side in SIDES])

    def line_y(self, x_m: np.ndarray, side: float) -> np.ndarray:
        """Lateral position (N,) of the left (+1) or right (-1) line at distances (N,); NaN where it has turned back."""
        return line_y(np.asarray(x_m, float), self.model, side)

    def height_m_at(self, x_m: np.ndarray) -> np.ndarray:
        """Height (N,) of the road at distances (N,) above the plane that the car stands on, metres."""
        return road_height(self.model, x_m)

    def outlines(self, camera: Camera, *, along_m: np.ndarray = OUTLINE_M) -> tuple[np.ndarray, np.ndarray]:
        """Raw pixels (N, 2) of the left and of the right line at arc lengths `along_m`, ascending.

        Each ends where the line turns back, dips behind a crest or leaves the lens. It has at least two points or none.
        """
        points = np.empty((len(SIDES), len(along_m), 3))
        points[..., :2] = line_points(self.model, SIDES, along_m)
        points[..., 2] = self.height_m_at(points[..., 0])
        pose = replace(camera.pose, pitch_rad=camera.pose.pitch_rad + self.pitch_rad)
        pixels = camera.with_pose(pose).road_to_pixels(points.reshape(-1, 3))
        left, right = pixels.reshape(*points.shape[:2], 2)
        return _visible_part(left), _visible_part(right)

    def pixels(self, camera: Camera, rows: np.ndarray) -> np.ndarray:
        """Columns (2, rows) of the left and the right line at picture rows; -2 where they do not pass."""
        rows = np.asarray(rows, float)
        columns = np.full((2, len(rows)), -2.0)
        for k, outline in enumerate(self.outlines(camera)):
            if len(outline):
                columns[k] = np.interp(rows, outline[::-1, 1], outline[::-1, 0], left=-2, right=-2)
        return np.where((columns >= 0) & (columns <= camera.width - 1), columns, -2.0)


def _visible_part(pixels: np.ndarray) -> np.ndarray:
    """The points (N, 2) of a line, nearest first, while they rise in the picture; NaN at the beginning is left out."""
    pixels = pixels[int(np.isfinite(pixels[:, 0]).argmax()) :]
    # comparisons with NaN are False: a point outside the lens ends the line
    rises = pixels[1:, 1] < pixels[:-1, 1]
    end = len(pixels) if rises.all() else int(rises.argmin()) + 1
    return pixels[: end if end > 1 else 0]
