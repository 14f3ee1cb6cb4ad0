"""Marking of a line: its cross-section, colour and gaps in one image, and its type over the road driven.

The view is resampled along a fitted line: one row for each row of the view, one column for each distance from the line.
The median over the rows with stripes is the cross-section of the marking, without the texture of the road.

The type is white or yellow, solid or dashed, single or double; None between the thresholds. White paint has the colour
of the road beside it, which lies in the same light, and yellow paint lacks blue. One image shows a dash or two: painted
and bare road are summed while the car drives, with less weight for what lies farther back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import TypeVar

import cv2
import numpy as np

from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.paint import PAINT, MarkingResponse

T = TypeVar("T")

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
# Strength of painted and of bare rows relative to the median of the line's stripes; shortest gap between dashes, and
# its bare share: holes from wear are mostly shorter, and in shadows and behind cars the strength is in between.
PAINTED_FROM, BARE_BELOW, MIN_DASH_GAP_M, BARE_SHARE = 0.5, 0.25, 2.0, 0.6
# The kind is stated from this length of painted and bare road on. Painted share of dashed lines at most, and of solid
# lines at least: dashes and gaps of equal length are common, and edge lines have dashes three times their gaps.
# Chosen, as KEEP and the numbers above and below, on half A of the labelled real roads.
MIN_ROAD_M, DASHED_BELOW, SOLID_FROM = 8.0, 0.85, 0.93
# Yellowness between white and yellow paint, grey levels of contrast at which half of it is stated, and votes for the
# whole range from white to yellow.
YELLOW_FROM, COLOUR_NOISE, COLOUR_VOTES = 0.5, 6.0, 3.0
# Share of its weight that an observation keeps with each further one, about 10 m later.
KEEP = 0.8


@dataclass(frozen=True)
class MarkingProfile:
    """What one image shows of a line's marking."""

    # Width of the painted band at half its height: of a double line both stripes and the gap between them.
    width_m: float
    # Centre of the band, left of the fitted line.
    centre_m: float
    # Blue that the paint lacks, relative to white paint in the same light: about 0 for white paint, 1 for yellow.
    yellowness: float
    # Height over the adjacent road, in units of that road's noise.
    contrast: float
    # Smallest height in the middle third of the band near the car, relative to the lower of both halves; 1 for one
    # stripe. Measured only for bands as wide as a double line.
    gap: float = 1.0
    # Length of the line with paint, and of its gaps.
    painted_m: float = 0.0
    bare_m: float = 0.0

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

    `line_y_m` (rows,) is the lateral position of the line on the view's grid in each row, NaN where it does not pass,
    `stripe_rows` (stripes,) the rows of its stripes. `side` is +1 for a line to the left of the lane, else -1.
    """
    rows, (light, yellow, strength) = _straighten([*response.channels, response.band_strength], view, line_y_m)
    painted = np.isin(rows, stripe_rows)
    if np.count_nonzero(painted) < MIN_ROWS:
        return None
    profiles = (_profile(channel[painted]) for channel in (light, yellow))
    profile = max(filter(None, profiles), key=attrgetter("contrast"), default=None)
    if profile is None:
        return None
    depth_m = view.row_columns[rows] * view.cell_m
    painted_m, bare_m = _painted_and_bare_m(strength[:, ROAD_SAMPLES:-ROAD_SAMPLES].max(axis=1), painted, depth_m)
    yellowness = _yellowness(light[painted], yellow[painted], profile, side)
    return replace(profile, yellowness=yellowness, painted_m=painted_m, bare_m=bare_m)


def _profile(values: np.ndarray) -> MarkingProfile | None:
    """Cross-section of the marking in one straightened channel (rows, offsets)."""
    road = ROAD_SAMPLES
    inner = _cross_section(values)
    top = inner.max()
    if top <= 0:
        return None
    step = np.abs(np.diff(values, axis=1))
    noise = (step[:, : road - 1].mean() + step[:, 1 - road :].mean()) / 2
    painted = np.flatnonzero(inner >= top / 2)
    first, last = OFFSETS_M[road:-road][painted[[0, -1]]]
    width_m, gap = float(first - last + STEP_M), 1.0
    if width_m > DOUBLE_FROM_M:
        near = _cross_section(values[-max(len(values) // 3, MIN_ROWS) :])
        band = near[painted[0] : painted[-1] + 1]
        third, half = len(band) // 3, len(band) // 2
        peak = min(band[:half].max(), band[-half:].max())
        gap = float(band[third:-third].min() / peak) if peak > 0 else 1.0
    return MarkingProfile(width_m, float(first + last) / 2, 0.0, float(top / (noise + PAINT.noise_floor)), gap)


def _cross_section(values: np.ndarray) -> np.ndarray:
    """Median over rows (rows, offsets), minus the brighter of the roads at both ends, without these ends."""
    road = ROAD_SAMPLES
    section = np.median(values, axis=0)
    return section[road:-road] - max(section[:road].mean(), section[-road:].mean())


def _yellowness(light: np.ndarray, yellow: np.ndarray, profile: MarkingProfile, side: float) -> float:
    """Yellowness of a marking in straightened lightness and yellowness (rows, offsets); see `MarkingProfile`.

    It is compared with the road towards the lane: beyond the edge of the road may be soil or grass.
    """
    on_band = np.abs(OFFSETS_M - profile.centre_m) <= profile.width_m / 2
    beside = slice(-ROAD_SAMPLES, None) if side > 0 else slice(ROAD_SAMPLES)
    (light_road, light_paint), (yellow_road, yellow_paint) = (
        (section[beside].mean(), section[on_band].mean()) for section in (np.median(v, axis=0) for v in (light, yellow))
    )
    height, yellow_height = light_paint - light_road, yellow_paint - yellow_road
    white_height = height * yellow_road / max(light_road, 1.0)
    lacking, blue = yellow_height - white_height, height - yellow_height
    return float(lacking / (abs(height - white_height) + abs(blue) + COLOUR_NOISE))


def _painted_and_bare_m(strength: np.ndarray, on_stripe: np.ndarray, depth_m: np.ndarray) -> tuple[float, float]:
    """Lengths of the paint and of the gaps along a line, by the strength, stripes and depths of its rows (rows,)."""
    usual = np.median(strength[on_stripe])
    painted, bare = strength >= PAINTED_FROM * usual, strength < BARE_BELOW * usual
    bare_m = 0.0
    # a part begins with a painted row, which the first one may lack
    for part in np.split(np.arange(len(strength)), np.flatnonzero(painted)):
        gap = part[~painted[part]]
        length_m = float(depth_m[gap].sum())
        if length_m >= MIN_DASH_GAP_M and depth_m[gap] @ bare[gap] >= BARE_SHARE * length_m:
            bare_m += length_m
    return float(depth_m @ painted), bare_m


def _straighten(
    layers: Sequence[np.ndarray], view: BirdsEyeView, line_y_m: np.ndarray
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Rows (N,) in which a line is seen, and layers of the view, resampled along it at `OFFSETS_M`: (N, offsets)."""
    most, least = view.y_m[0] - REACH_M, view.y_m[-1] + REACH_M
    rows = np.flatnonzero((line_y_m < most) & (line_y_m > least) & (view.x_m < PROFILE_FAR_M))
    if len(rows) < 2:
        return rows[:0], [np.empty((0, len(OFFSETS_M)), np.float32)] * len(layers)
    # rows cut a slanted line at an angle: distances at right angles to it are longer along the row
    slant = np.hypot(1, np.gradient(line_y_m[rows], view.x_m[rows]))
    column = ((view.y_m[0] - line_y_m[rows, None] - slant[:, None] * OFFSETS_M) / view.cell_m).astype(np.float32)
    ends = np.clip(np.round(column[:, [0, -1]]).astype(int), 0, len(view.y_m) - 1)
    seen = view.seen[rows[:, None], ends].all(axis=1)
    rows, column = rows[seen], column[seen]
    row = np.broadcast_to(np.arange(len(rows), dtype=np.float32)[:, None], column.shape).copy()
    return rows, [cv2.remap(layer[rows].astype(np.float32), column, row, cv2.INTER_LINEAR) for layer in layers]


@dataclass(frozen=True)
class TypeVotes:
    """Sums over the observations so far.

    Votes are positive for yellow and double and negative for white and single; the lengths are those of the line with
    paint and of its gaps.
    """

    yellow: float = 0.0
    double_stripes: float = 0.0
    painted_m: float = 0.0
    bare_m: float = 0.0

    @property
    def colour(self) -> str | None:
        """ "white" or "yellow"; None if not seen well enough."""
        return _majority(self.yellow, "yellow", "white")

    @property
    def kind(self) -> str | None:
        """ "solid" or "dashed"; None if not seen well enough."""
        road_m = self.painted_m + self.bare_m
        if road_m < MIN_ROAD_M:
            return None
        share = self.painted_m / road_m
        return "dashed" if share < DASHED_BELOW else "solid" if share >= SOLID_FROM else None

    @property
    def double(self) -> bool | None:
        """Two stripes side by side; None if not seen well enough."""
        return _majority(self.double_stripes, True, False)

    def add(self, profile: MarkingProfile) -> TypeVotes:
        """Add what one image shows."""
        return TypeVotes(
            yellow=KEEP * self.yellow + COLOUR_VOTES * (profile.yellowness - YELLOW_FROM),
            double_stripes=KEEP * self.double_stripes + (1 if profile.double else -1),
            painted_m=KEEP * self.painted_m + profile.painted_m,
            bare_m=KEEP * self.bare_m + profile.bare_m,
        )


def _majority(votes: float, positive: T, negative: T) -> T | None:
    """The winner of the votes; None if there is less than half a vote for it."""
    return None if abs(votes) < 0.5 else positive if votes > 0 else negative
