"""Marking of a line: its cross-section, colour and gaps in one image, and its type over the road driven.

The view is resampled along a fitted line: one row for each row of the view, one column for each distance from the line.
The median over the rows with stripes is the cross-section of the marking, without the texture of the road.

The type is white or yellow, solid or dashed, single or double; None between the thresholds. White paint has the colour
of the road next to it, which lies in the same light, and yellow paint lacks blue. One image shows a dash or two:
painted and bare road are summed while the car drives, with less weight for road farther back.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.evidence import PAINT, MarkingResponse

# A painted stripe is 0.10 to 0.15 m wide; two of them with their gap are 0.25 m wide or more. So are white edge lines
# of some motorways, but two stripes have a gap: the largest brightness in their middle, relative to that of the
# stripes. Yellow lines of that width are double: no country paints single ones.
STRIPE_M, DOUBLE_FROM_M, GAP_BELOW = 0.12, 0.23, 0.83
# Cross-sections: distance between samples, and the largest distance from the line. Samples of the road next to the
# marking, at either end.
STEP_M, REACH_M = 0.025, 0.6
ROAD_SAMPLES = 12
# Sampled distances to the left of the line, at right angles.
OFFSETS_M = np.arange(REACH_M, -REACH_M - STEP_M / 2, -STEP_M)
# Rows up to this distance, beyond which the stripes of a double line and the ends of dashes merge in small images;
# fewest rows with stripes.
PROFILE_FAR_M, MIN_ROWS = 22.0, 4
# Strength of painted and of bare rows relative to the median of the line's stripes; in blur, wear and shadows it is in
# between. Rows count from the nearest to the farthest stripe: the bonnet or a car may hide the others.
PAINTED_FROM, BARE_BELOW = 0.5, 0.25
# Length and painted share of solid lines at least: few dashes are longer. Length and bare share of dashed lines
# at least: gaps are one to three times as long as dashes, seldom a third (edge lines in France). Chosen, as the numbers
# above and below, on half A of the labelled real roads; two short dashes and their gap take 5 m.
MIN_SOLID_M, SOLID_FROM, MIN_DASHED_M, DASHED_FROM = 8.0, 0.8, 5.0, 0.15
# Mean yellowness of white lines at most, and of yellow lines at least.
WHITE_TO, YELLOW_FROM = 0.25, 0.55
# Share of its weight that an observation keeps with each further one, about 10 m later.
KEEP = 0.8


@dataclass(frozen=True)
class MarkingProfile:
    """What one image shows of a line's marking."""

    # Width of the painted band at half its height: of a double line both stripes and the gap between them.
    width_m: float
    # Centre of the band, left of the fitted line.
    centre_m: float
    # Smallest height in the middle third of the band near the car, relative to the lower of both halves; 1 for one
    # stripe. Measured only for bands as wide as a double line.
    gap: float
    # Blue that the paint lacks, relative to white paint in the same light: about 0 for white paint, 1 for yellow.
    yellowness: float
    # Length of the line that is seen, that with paint, and that without.
    seen_m: float
    painted_m: float
    bare_m: float

    @property
    def double(self) -> bool:
        """Two stripes side by side."""
        return self.width_m > DOUBLE_FROM_M and (self.yellowness > YELLOW_FROM or self.gap < GAP_BELOW)

    def stripe_m(self, side: float) -> float:
        """Position of the stripe next to the lane, left of the fitted line; `side` is +1 for the left line, else -1."""
        return self.centre_m - side * (self.width_m - STRIPE_M) / 2 if self.double else self.centre_m


def marking_profile(
    response: MarkingResponse, view: BirdsEyeView, line_y_m: np.ndarray, stripe_rows: np.ndarray, side: float
) -> MarkingProfile | None:
    """What an image shows of the marking along a line; None without a marking.

    `line_y_m` (rows,) is the lateral position of the line on the view's grid in each row, NaN where it does not pass.
    `stripe_rows` (stripes,) are the rows of its stripes. `side` is +1 for a line to the left of the lane, else -1.
    """
    rows, column = _straight_cells(view, line_y_m, stripe_rows)
    painted = np.isin(rows, stripe_rows)
    if np.count_nonzero(painted) < MIN_ROWS:
        return None
    row = np.broadcast_to(np.arange(len(rows), dtype=np.float32)[:, None], column.shape).copy()
    light, yellow, strength = (
        cv2.remap(cells[rows].astype(np.float32), column, row, cv2.INTER_LINEAR)
        for cells in (*response.channels, response.band_strength)
    )
    light, yellow = light[painted], yellow[painted]
    # white paint shows in the first channel, yellow paint on light concrete in the second
    marking = max(light, yellow, key=lambda channel: _cross_section(channel).max())
    if _cross_section(marking).max() <= 0:
        return None
    width_m, centre_m, gap = _measure_section(marking)
    along = strength[:, ROAD_SAMPLES:-ROAD_SAMPLES].max(axis=1)
    usual = np.median(along[painted])
    # lengths are unknown if only a network sees the stripes
    depth_m = view.row_columns[rows] * view.cell_m * (usual > PAINT.min_strength)
    return MarkingProfile(
        width_m=width_m,
        centre_m=centre_m,
        gap=gap,
        yellowness=_yellowness(light, yellow, np.abs(OFFSETS_M - centre_m) <= width_m / 2, side),
        seen_m=float(depth_m.sum()),
        painted_m=float(depth_m @ (along >= PAINTED_FROM * usual)),
        bare_m=float(depth_m @ (along < BARE_BELOW * usual)),
    )


def _measure_section(values: np.ndarray) -> tuple[float, float, float]:
    """Width, centre and gap of the marking in a straightened channel (rows, offsets); see `MarkingProfile`."""
    section = _cross_section(values)
    painted = np.flatnonzero(section >= section.max() / 2)
    first, last = OFFSETS_M[ROAD_SAMPLES:-ROAD_SAMPLES][painted[[0, -1]]]
    width_m, gap = float(first - last + STEP_M), 1.0
    if width_m > DOUBLE_FROM_M:
        near = _cross_section(values[-max(len(values) // 3, MIN_ROWS) :])
        band = near[painted[0] : painted[-1] + 1]
        third, half = len(band) // 3, len(band) // 2
        peak = min(band[:half].max(), band[-half:].max())
        gap = float(band[third:-third].min() / peak) if peak > 0 else 1.0
    return width_m, float(first + last) / 2, gap


def _cross_section(values: np.ndarray) -> np.ndarray:
    """Median over rows (rows, offsets), minus the brighter of the roads at both ends, without these ends."""
    road = ROAD_SAMPLES
    section = np.median(values, axis=0)
    return section[road:-road] - max(section[:road].mean(), section[-road:].mean())


def _yellowness(light: np.ndarray, yellow: np.ndarray, on_band: np.ndarray, side: float) -> float:
    """Yellowness of a band of offsets in straightened lightness and yellowness (rows, offsets); see `MarkingProfile`.

    It is compared with the road towards the lane: beyond the edge of the road may be soil or grass.
    """
    beside = slice(-ROAD_SAMPLES, None) if side > 0 else slice(ROAD_SAMPLES)
    light, yellow = np.median(light, axis=0), np.median(yellow, axis=0)
    height, yellow_height = (section[on_band].mean() - section[beside].mean() for section in (light, yellow))
    # white paint has the colour of the road
    white_height = height * yellow[beside].mean() / max(light[beside].mean(), 1.0)
    lacking, blue = yellow_height - white_height, height - yellow_height
    return float(lacking / (abs(height - white_height) + abs(blue) + PAINT.noise_floor))


def _straight_cells(view: BirdsEyeView, line_y_m: np.ndarray, stripe_rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows (N,) of the view, between the stripes, in which a line is seen, and columns (N, offsets) at `OFFSETS_M`."""
    most, least = view.y_m[0] - REACH_M, view.y_m[-1] + REACH_M
    rows = np.flatnonzero((line_y_m < most) & (line_y_m > least) & (view.x_m < PROFILE_FAR_M))
    rows = rows[(rows >= stripe_rows.min(initial=len(line_y_m))) & (rows <= stripe_rows.max(initial=0))]
    if len(rows) < MIN_ROWS:
        return rows[:0], np.empty((0, len(OFFSETS_M)), np.float32)
    # rows cut a slanted line at an angle: distances at right angles to it are longer along the row
    slant = np.hypot(1, np.gradient(line_y_m[rows], view.x_m[rows]))
    column = ((view.y_m[0] - line_y_m[rows, None] - slant[:, None] * OFFSETS_M) / view.cell_m).astype(np.float32)
    ends = np.clip(np.round(column[:, [0, -1]]).astype(int), 0, len(view.y_m) - 1)
    seen = view.seen[rows[:, None], ends].all(axis=1)
    return rows[seen], column[seen]


class TypeVotes(NamedTuple):
    """Sums over the observations so far: their number, those of a double line, and those of `MarkingProfile`."""

    observations: float
    yellowness: float
    double_stripes: float
    seen_m: float
    painted_m: float
    bare_m: float

    @property
    def colour(self) -> str | None:
        """ "white" or "yellow"; None if not seen well enough."""
        if not self.observations:
            return None
        yellowness = self.yellowness / self.observations
        return "white" if yellowness < WHITE_TO else "yellow" if yellowness > YELLOW_FROM else None

    @property
    def kind(self) -> str | None:
        """ "solid" or "dashed"; None if not seen well enough."""
        if self.painted_m >= SOLID_FROM * self.seen_m:
            return "solid" if self.seen_m >= MIN_SOLID_M else None
        return "dashed" if self.bare_m >= DASHED_FROM * self.seen_m and self.seen_m >= MIN_DASHED_M else None

    @property
    def double(self) -> bool | None:
        """Two stripes side by side; None if not seen."""
        return 2 * self.double_stripes > self.observations if self.observations else None

    def add(self, profile: MarkingProfile) -> TypeVotes:
        """Add what one image shows."""
        seen = 1, profile.yellowness, profile.double, profile.seen_m, profile.painted_m, profile.bare_m
        return TypeVotes(*(KEEP * before + now for before, now in zip(self, seen, strict=True)))


NO_VOTES = TypeVotes(*[0.0] * len(TypeVotes._fields))
