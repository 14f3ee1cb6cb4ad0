"""Marking of a line: its cross-section, colour and gaps in one image, and its type over
the road driven.

The view is resampled along a fitted line: one row for each row of the view, one column
for each distance from the line. The median over the rows with stripes is the
cross-section of the marking, without the texture of the road.

The type is white or yellow, solid or dashed, single or double; None between the
thresholds. White paint has the colour of the road next to it, which lies in the same
light, and yellow paint lacks blue. One image shows a dash or two: painted and bare road
are summed while the car drives, with less weight for road farther back.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.evidence import MarkingResponse, PaintSettings

# A painted stripe is 0.10 to 0.15 m wide.
STRIPE_M = 0.12
# Two stripes with their gap are this wide or wider. So are white edge lines of some
# motorways, but two stripes have a gap: the largest brightness in their middle,
# relative to that of the stripes. Yellow lines of that width are double: no country
# paints single ones.
DOUBLE_FROM_M = 0.23
GAP_BELOW = 0.83
# Cross-sections: distance between samples, and the largest distance from the line.
STEP_M = 0.025
REACH_M = 0.6
# Samples of the road next to the marking, at either end.
ROAD_SAMPLES = 12
# Sampled distances to the left of the line, at right angles.
OFFSETS_M = np.arange(REACH_M, -REACH_M - STEP_M / 2, -STEP_M)
# Rows up to this distance, beyond which the stripes of a double line and the ends of
# dashes merge in small images; fewest rows with stripes.
PROFILE_FAR_M = 22.0
MIN_ROWS = 4
# Strength of painted and of bare rows relative to the median of the line's stripes; in
# blur, wear and shadows it is in between. Rows count from the nearest to the farthest
# stripe: the bonnet or a car may hide the others.
PAINTED_FROM = 0.5
BARE_BELOW = 0.25
# Length and painted share of solid lines at least: few dashes are longer. One dash may
# be all that is seen: paint has to be seen on most of what is in the image, too.
MIN_SOLID_M = 8.0
SOLID_FROM = 0.8
SOLID_VISIBLE_FROM = 0.5
# Length and bare share of dashed lines at least: gaps are one to three times as long as
# dashes, seldom a third (edge lines in France). Two short dashes and their gap take 5
# m. Chosen, as the numbers above and below, on half A of the labelled real roads.
MIN_DASHED_M = 5.0
DASHED_FROM = 0.15
# Yellowness of white lines at most, and of yellow lines at least.
WHITE_TO = 0.25
YELLOW_FROM = 0.55
# Blue that yellow paint lacks at least, relative to its brightness; on real roads 0.2
# to 0.5. Paint that lacks less on a bluer road, as at the end of a tunnel, may be of
# either colour; its yellowness.
YELLOW_PAINT_FROM = 0.08
EITHER = 0.4
# Share of its weight that an observation keeps with each further one, about 10 m later,
# and its vote on the colour, which changes less often.
KEEP = 0.8
KEEP_COLOUR = 0.9


@dataclass(frozen=True)
class MarkingProfile:
    """What one image shows of a line's marking."""

    # Width of the painted band at half its height: of a double line both stripes and
    # the gap between them.
    width_m: float
    # Centre of the band, left of the fitted line.
    centre_m: float
    # Smallest height in the middle third of the band near the car, relative to the
    # lower of both halves; 1 for one stripe. Measured only for bands as wide as a
    # double line.
    gap: float
    # Blue that the paint lacks, relative to white paint in the same light: about 0 for
    # white paint, 1 for yellow. None in an image without colours.
    yellowness: float | None
    # Length of the line in the image, of its part between the first and last stripe,
    # and of that with paint and without.
    visible_m: float
    seen_m: float
    painted_m: float
    bare_m: float

    @property
    def double(self) -> bool:
        """Two stripes side by side."""
        is_yellow = self.yellowness is not None and self.yellowness > YELLOW_FROM
        has_gap = self.gap < GAP_BELOW
        return self.width_m > DOUBLE_FROM_M and (is_yellow or has_gap)

    def stripe_m(self, side: float) -> float:
        """Position of the stripe next to the lane, left of the fitted line.

        `side` is +1 for the left line, -1 for the right one.
        """
        if not self.double:
            return self.centre_m
        return self.centre_m - side * (self.width_m - STRIPE_M) / 2


def marking_profile(
    response: MarkingResponse,
    view: BirdsEyeView,
    line_y_m: np.ndarray,
    stripe_rows: np.ndarray,
    side: float,
    paint: PaintSettings,
    coloured: bool = True,
) -> MarkingProfile | None:
    """What an image shows of the marking along a line; None without a marking.

    `line_y_m` (rows,) is the lateral position of the line on the view's grid in each
    row, NaN where it does not pass. `stripe_rows` (stripes,) are the rows of its
    stripes. `side` is +1 for a line to the left of the lane, else -1. `coloured`:
    whether the image shows colours.
    """
    rows, column = _straight_cells(view, line_y_m)
    visible_m = float(view.row_columns[rows].sum() * view.cell_m)
    first = stripe_rows.min(initial=len(line_y_m))
    last = stripe_rows.max(initial=0)
    between = (rows >= first) & (rows <= last)
    rows = rows[between]
    column = column[between]
    painted = np.isin(rows, stripe_rows)
    if np.count_nonzero(painted) < MIN_ROWS:
        return None

    # the cross-section, in the channel that shows the paint: white paint shows in the
    # first one, yellow paint on light concrete in the second
    light = _straighten(response.channels[0], rows, column)[painted]
    yellow = _straighten(response.channels[1], rows, column)[painted]
    lightest = _cross_section(light).max()
    yellowest = _cross_section(yellow).max()
    if max(lightest, yellowest) <= 0:
        return None
    marking = light if lightest >= yellowest else yellow
    width_m, centre_m, gap = _measure_section(marking)

    # painted and bare lengths; unknown if only a network sees the stripes
    strength = _straighten(response.band_strength, rows, column)
    along = strength[:, ROAD_SAMPLES:-ROAD_SAMPLES].max(axis=1)
    usual = np.median(along[painted])
    is_known = usual > paint.min_strength
    depth_m = view.row_columns[rows] * view.cell_m * is_known
    yellowness = None
    if coloured:
        on_band = np.abs(OFFSETS_M - centre_m) <= width_m / 2
        yellowness = _yellowness(light, yellow, on_band, side, paint)
    return MarkingProfile(
        width_m=width_m,
        centre_m=centre_m,
        gap=gap,
        yellowness=yellowness,
        visible_m=visible_m,
        seen_m=float(depth_m.sum()),
        painted_m=float(depth_m @ (along >= PAINTED_FROM * usual)),
        bare_m=float(depth_m @ (along < BARE_BELOW * usual)),
    )


def _straighten(cells: np.ndarray, rows: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Cells (rows, columns) of a view sampled at columns (N, offsets) of N rows."""
    place = np.arange(len(rows), dtype=np.float32)[:, None]
    row = np.broadcast_to(place, column.shape).copy()
    return cv2.remap(cells[rows].astype(np.float32), column, row, cv2.INTER_LINEAR)


def _measure_section(values: np.ndarray) -> tuple[float, float, float]:
    """Width, centre and gap of the marking in a straightened channel (rows, offsets).

    See `MarkingProfile`.
    """
    section = _cross_section(values)
    painted = np.flatnonzero(section >= section.max() / 2)
    offsets_m = OFFSETS_M[ROAD_SAMPLES:-ROAD_SAMPLES]
    first, last = offsets_m[painted[[0, -1]]]
    width_m = float(first - last + STEP_M)
    centre_m = float(first + last) / 2
    if width_m <= DOUBLE_FROM_M:
        return width_m, centre_m, 1.0

    # the gap in the near third of the rows, where it is sharpest
    near_rows = max(len(values) // 3, MIN_ROWS)
    near = _cross_section(values[-near_rows:])
    band = near[painted[0] : painted[-1] + 1]
    third = len(band) // 3
    half = len(band) // 2
    peak = min(band[:half].max(), band[-half:].max())
    gap = float(band[third:-third].min() / peak) if peak > 0 else 1.0
    return width_m, centre_m, gap


def _cross_section(values: np.ndarray) -> np.ndarray:
    """Median over rows (rows, offsets), minus the brighter of the roads at both ends.

    The result is without these ends.
    """
    road = ROAD_SAMPLES
    section = np.median(values, axis=0)
    brighter = max(section[:road].mean(), section[-road:].mean())
    return section[road:-road] - brighter


def _yellowness(
    light: np.ndarray,
    yellow: np.ndarray,
    on_band: np.ndarray,
    side: float,
    paint: PaintSettings,
) -> float:
    """Yellowness of a band of offsets; see `MarkingProfile`.

    `light` and `yellow` are straightened channels (rows, offsets). The band is compared
    with the road towards the lane: beyond the edge of the road may be soil or grass.
    """
    beside = slice(-ROAD_SAMPLES, None) if side > 0 else slice(ROAD_SAMPLES)
    light = np.median(light, axis=0)
    yellow = np.median(yellow, axis=0)
    road_light = light[beside].mean()
    road_yellow = yellow[beside].mean()
    height = light[on_band].mean() - road_light
    yellow_height = yellow[on_band].mean() - road_yellow

    # white paint has the colour of the road
    white_height = height * road_yellow / max(road_light, 1.0)
    lacking = yellow_height - white_height
    blue = height - yellow_height
    usual = abs(height - white_height) + abs(blue) + paint.noise_floor
    yellowness = float(lacking / usual)
    is_yellow = yellow[on_band].mean() > YELLOW_PAINT_FROM * light[on_band].mean()
    return yellowness if is_yellow else min(yellowness, EITHER)


def _straight_cells(
    view: BirdsEyeView, line_y_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Rows (N,) in which a line passes, and their columns (N, offsets) at `OFFSETS_M`.

    They are near rows with all offsets in the image.
    """
    most = view.y_m[0] - REACH_M
    least = view.y_m[-1] + REACH_M
    in_view = (line_y_m < most) & (line_y_m > least) & (view.x_m < PROFILE_FAR_M)
    rows = np.flatnonzero(in_view)
    if len(rows) < MIN_ROWS:
        return rows[:0], np.empty((0, len(OFFSETS_M)), np.float32)

    # rows cut a slanted line at an angle: distances at right angles to it are longer
    # along the row
    y_m = line_y_m[rows]
    slant = np.hypot(1, np.gradient(y_m, view.x_m[rows]))
    from_left_m = view.y_m[0] - y_m[:, None] - slant[:, None] * OFFSETS_M
    column = (from_left_m / view.cell_m).astype(np.float32)

    # all of it inside the image
    ends = np.round(column[:, [0, -1]]).astype(int)
    ends = np.clip(ends, 0, len(view.y_m) - 1)
    seen = view.seen[rows[:, None], ends].all(axis=1)
    return rows[seen], column[seen]


class TypeVotes(NamedTuple):
    """Sums over the observations so far: their number, those of a double line, and
    those of `MarkingProfile`; votes on the colour: all, for white, for yellow.
    """

    observations: float
    double_stripes: float
    visible_m: float
    seen_m: float
    painted_m: float
    bare_m: float
    looks: float
    white: float
    yellow: float

    @property
    def colour(self) -> str | None:
        """ "white" or "yellow", as most images show it; None if neither has most."""
        if 2 * self.white > self.looks:
            return "white"
        return "yellow" if 2 * self.yellow > self.looks else None

    @property
    def kind(self) -> str | None:
        """ "solid" or "dashed"; None if not seen well enough."""
        if self.painted_m >= SOLID_FROM * self.seen_m:
            is_long = self.seen_m >= MIN_SOLID_M
            is_most = self.painted_m >= SOLID_VISIBLE_FROM * self.visible_m
            return "solid" if is_long and is_most else None
        has_gaps = self.bare_m >= DASHED_FROM * self.seen_m
        return "dashed" if has_gaps and self.seen_m >= MIN_DASHED_M else None

    @property
    def double(self) -> bool | None:
        """Two stripes side by side; None if not seen."""
        if not self.observations:
            return None
        return 2 * self.double_stripes > self.observations

    def add(self, profile: MarkingProfile) -> TypeVotes:
        """Add what one image shows."""
        is_white = False
        is_yellow = False
        if profile.yellowness is not None:
            is_white = profile.yellowness < WHITE_TO
            is_yellow = profile.yellowness > YELLOW_FROM
        return TypeVotes(
            observations=KEEP * self.observations + 1,
            double_stripes=KEEP * self.double_stripes + profile.double,
            visible_m=KEEP * self.visible_m + profile.visible_m,
            seen_m=KEEP * self.seen_m + profile.seen_m,
            painted_m=KEEP * self.painted_m + profile.painted_m,
            bare_m=KEEP * self.bare_m + profile.bare_m,
            looks=KEEP_COLOUR * self.looks + 1,
            white=KEEP_COLOUR * self.white + is_white,
            yellow=KEEP_COLOUR * self.yellow + is_yellow,
        )


NO_VOTES = TypeVotes(*[0.0] * 9)
