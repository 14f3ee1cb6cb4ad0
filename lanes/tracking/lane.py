"""The lane in one picture: from raw pixels to metres, with an account of how sure that is.

    raw picture -> observe -> Sight -> search_lane or follow.update_lane -> LaneFit -> describe_lane -> Lane

`find_lane` runs through all of it for a picture of which nothing is known.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lanes.camera.camera import Camera
from lanes.io.describe import describe_bend, describe_heading, describe_offset, html_table
from lanes.tracking.model import (
    CENTRE,
    CURVATURE,
    HEADING,
    PITCH,
    RATE,
    SIDES,
    VERTICAL_CURVATURE,
    WIDTH,
    line_points,
    line_y,
    road_height,
)

# Where a line is drawn through, unless asked otherwise: from below the picture to the horizon.
OUTLINE_M = np.geomspace(3.0, 400.0, 120)
# A painted stripe is 0.10 to 0.15 m wide; two of them with their gap come to 0.25 m and more.
STRIPE_M, DOUBLE_FROM_M = 0.12, 0.23


@dataclass(frozen=True, eq=False)
class LaneLine:
    """One line of the lane: y(x) = c0 + c1 x + c2 x^2 / 2 + c3 x^3 / 6 near the car, metres, x forward, y left.

    Attributes
    ----------
    c0_m, c1, c2_per_m, c3_per_m2 : float
    c0_std_m : float
        Standard deviation of `c0_m`.
    support : float
        Share of the line's rows in sight, up to 50 m, that have paint on it: 0.3 is a good dashed line.
    reach_m : float
        How far the evidence goes.
    seen : bool
        False if the line was only inferred from the other one and the usual width of lanes.
    paint : Paint, optional
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

    def summary(self) -> str:
        """Where the line runs beside the car, and what it rests on."""
        beside = f"{abs(self.c0_m):.2f} ± {self.c0_std_m:.2f} m {'left' if self.c0_m > 0 else 'right'}"
        if not self.seen:
            return f"{beside}, inferred from the other line"
        return f"{beside}, paint on {min(self.support, 1):.0%} of its rows, up to {self.reach_m:.0f} m"


@dataclass(frozen=True, eq=False)
class Lane:
    """The lane that the car is in; SI units, signs as everywhere (offset > 0: car left of the middle).

    Attributes
    ----------
    offset_m, offset_std_m, heading_rad, curvature_per_m, curvature_std_per_m, curvature_rate_per_m2, width_m,
    width_std_m, pitch_rad, vertical_per_m : float
        `heading_rad` is the road's direction seen from the car, positive to the left; `pitch_rad` what the camera looks
        farther down than its pose says; `vertical_per_m` the road's curvature upwards below the car.
    left, right : LaneLine
    score, margin : float
        Sum of the square roots of the supports less what the lane is unusual; and how much better than the next lane.
    model : ndarray (15,)
        Parameters as in `lanes.tracking.fitting`, for the stripes next to the lane.
    covariance : ndarray (15, 15)
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

    @classmethod
    def from_model(
        cls,
        model: np.ndarray,
        covariance: np.ndarray,
        lines: tuple[LaneLine, LaneLine],
        *,
        score: float,
        margin: float,
    ) -> Lane:
        """The lane of a fitted model (15,) and its covariance (15, 15), with its left and right line."""
        std = np.sqrt(np.diag(covariance))
        return cls(
            offset_m=float(-model[CENTRE]),
            offset_std_m=float(std[CENTRE]),
            heading_rad=float(model[HEADING]),
            curvature_per_m=float(model[CURVATURE] / (1 - model[CURVATURE] * model[CENTRE])),
            curvature_std_per_m=float(std[CURVATURE]),
            curvature_rate_per_m2=float(model[RATE]),
            width_m=float(model[WIDTH]),
            width_std_m=float(std[WIDTH]),
            pitch_rad=float(model[PITCH]),
            vertical_per_m=float(model[VERTICAL_CURVATURE][0]),
            left=lines[0],
            right=lines[1],
            score=score,
            margin=margin,
            model=model,
            covariance=covariance,
        )

    def summary(self) -> dict[str, str]:
        """What is known of the lane, by name: offset, bend, heading, width and both lines."""
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
        """Lateral places (2, N) of the left and right line at distances (N,), metres; NaN where one has turned back."""
        return np.array([self.line_y(x_m, side) for side in SIDES])

    def line_y(self, x_m: np.ndarray, side: float) -> np.ndarray:
        """Lateral place of the left (side +1) or right (-1) line at distances (N,); NaN where it has turned back."""
        return line_y(np.asarray(x_m, float), self.model, side)

    def height_m_at(self, x_m: np.ndarray) -> np.ndarray:
        """Height (N,) of the road at distances (N,) above the plane that the car stands on, metres."""
        return road_height(self.model, x_m)

    def outline(self, camera: Camera, side: float, *, along_m: np.ndarray = OUTLINE_M) -> np.ndarray:
        """Raw pixels (N, 2) of a line where the lane has run `along_m`, ascending, up to where it is out of sight.

        That is where it turns back or dips behind a crest, or goes out of the lens.
        """
        x, y = line_points(self.model, side, along_m).T
        pose = replace(camera.pose, pitch_rad=camera.pose.pitch_rad + self.pitch_rad)
        points = np.column_stack([x, y, self.height_m_at(x)])
        pixels = camera.with_pose(pose).road_to_pixels(points)
        pixels = pixels[np.isfinite(pixels).all(axis=1)]
        back = np.flatnonzero(~(np.diff(pixels[:, 1]) < 0))
        return pixels[: back[0] + 1] if len(back) else pixels

    def pixels(self, camera: Camera, rows: np.ndarray) -> np.ndarray:
        """Columns (2, rows) of the left and the right line at picture rows; -2 where they do not pass."""
        rows = np.asarray(rows, float)
        columns = np.full((2, len(rows)), -2.0)
        for k, side in enumerate(SIDES):
            outline = self.outline(camera, side)
            if len(outline) > 1:
                columns[k] = np.interp(rows, outline[::-1, 1], outline[::-1, 0], left=-2, right=-2)
        return np.where((columns >= 0) & (columns <= camera.width - 1), columns, -2.0)


@dataclass(frozen=True)
class MarkingProfile:
    """Cross-section of a line's paint.

    Attributes
    ----------
    width_m : float
        Width of the painted band at half its height: of a double line both stripes and the gap between them.
    centre_m : float
        Where the band's middle lies, left of the fitted line.
    yellow : bool
        Its yellowness stands out more than its lightness.
    contrast : float
        Height over the road beside it, in units of that road's noise.
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
        """Where the stripe next to the lane lies, left of the fitted line; `side` is +1 for the lane's left line."""
        return self.centre_m - side * (self.width_m - STRIPE_M) / 2 if self.double else self.centre_m
