"""Marking of a line: its cross-section in one frame, and its type over time.

The view is resampled along a fitted line: one row for each row of the view, one column for each distance from the line.
The median over the rows is the cross-section of the marking, without the texture of the road.

The type is white or yellow, solid or dashed, single or double. A single picture may show a solid line in pieces
(shadows), or one dash as long as the view. Each frame therefore votes, old votes decay, and the majority decides.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from operator import attrgetter

import cv2
import numpy as np

from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.paint import MARKINGS, MarkingResponse

# A painted stripe is 0.10 to 0.15 m wide; two of them with their gap are 0.25 m wide or more. So are white edge lines
# of some motorways, but two stripes have a gap: the largest brightness in their middle, relative to that of the
# stripes. Yellow lines of that width are double: no country paints single ones.
STRIPE_M, DOUBLE_FROM_M, GAP_BELOW = 0.12, 0.23, 0.83


@dataclass(frozen=True)
class ProfileParameters:
    """Sampling of cross-sections; tuned on the labelled Udacity stills."""

    # Distance between samples, and the largest distance from the line.
    step_m: float = 0.025
    reach_m: float = 0.6
    # Samples of the road next to the marking, at either end.
    road_samples: int = 12
    # Rows are taken up to this distance: beyond it the stripes of a double line merge in the picture.
    far_m: float = 22.0
    min_rows: int = 4
    max_rows: int = 32


PROFILE = ProfileParameters()
# Sampled distances to the left of the line, at right angles.
OFFSETS_M = np.arange(PROFILE.reach_m, -PROFILE.reach_m - PROFILE.step_m / 2, -PROFILE.step_m)


@dataclass(frozen=True)
class MarkingProfile:
    """Cross-section of a line's marking."""

    # Width of the painted band at half its height: of a double line both stripes and the gap between them.
    width_m: float
    # Centre of the band, left of the fitted line.
    centre_m: float
    # Its contrast in yellowness is larger than in lightness.
    yellow: bool
    # Height over the adjacent road, in units of that road's noise.
    contrast: float
    # Smallest height in the middle third of the band near the car, relative to the lower of both halves; 1 for one
    # stripe. Measured only for white bands as wide as a double line.
    gap: float = 1.0

    @property
    def double(self) -> bool:
        """Two stripes side by side."""
        return self.width_m > DOUBLE_FROM_M and (self.yellow or self.gap < GAP_BELOW)

    def stripe_m(self, side: float) -> float:
        """Position of the stripe next to the lane, left of the fitted line; `side` is +1 for the left line, else -1."""
        return self.centre_m - side * (self.width_m - STRIPE_M) / 2 if self.double else self.centre_m


def marking_profile(response: MarkingResponse, view: BirdsEyeView, line_y_m: np.ndarray) -> MarkingProfile | None:
    """Cross-section of the marking along a line, in the channel with more contrast; None without a marking.

    `line_y_m` (rows,) is the lateral position of the line on the view's grid in each row; NaN for rows to leave out.
    """
    channels = _straighten(response.channels, view, line_y_m)
    if channels.shape[1] < PROFILE.min_rows:
        return None
    profiles = (_profile(values, yellow=yellow) for values, yellow in zip(channels, (False, True), strict=True))
    return max(filter(None, profiles), key=attrgetter("contrast"), default=None)


def _profile(values: np.ndarray, *, yellow: bool) -> MarkingProfile | None:
    """Cross-section of the marking in one straightened channel (rows, offsets)."""
    road = PROFILE.road_samples
    inner = _cross_section(values)
    top = inner.max()
    if top <= 0:
        return None
    step = np.abs(np.diff(values, axis=1))
    noise = (step[:, : road - 1].mean() + step[:, 1 - road :].mean()) / 2
    painted = np.flatnonzero(inner >= top / 2)
    first, last = OFFSETS_M[road:-road][painted[[0, -1]]]
    width_m, gap = float(first - last + PROFILE.step_m), 1.0
    if width_m > DOUBLE_FROM_M and not yellow:
        near = _cross_section(values[-max(len(values) // 3, PROFILE.min_rows) :])
        gap = _gap(near[painted[0] : painted[-1] + 1])
    return MarkingProfile(
        width_m=width_m,
        centre_m=float(first + last) / 2,
        yellow=yellow,
        contrast=float(top / (noise + MARKINGS.noise_floor)),
        gap=gap,
    )


def _cross_section(values: np.ndarray) -> np.ndarray:
    """Median over rows (rows, offsets), minus the brighter of the roads at both ends, without these ends."""
    road = PROFILE.road_samples
    section = np.median(values, axis=0)
    return section[road:-road] - max(section[:road].mean(), section[-road:].mean())


def _gap(band: np.ndarray) -> float:
    """Smallest value in the middle third of a cross-section, relative to the lower of the peaks of its halves."""
    third, half = len(band) // 3, len(band) // 2
    if not third:
        return 1.0
    peak = min(band[:half].max(), band[-half:].max())
    return float(band[third:-third].min() / peak) if peak > 0 else 1.0


def _straighten(channels: np.ndarray, view: BirdsEyeView, line_y_m: np.ndarray) -> np.ndarray:
    """(2, at most `PROFILE.max_rows`, offsets) float32: both channels, resampled along a line at `OFFSETS_M`."""
    most, least = view.y_m[0] - PROFILE.reach_m, view.y_m[-1] + PROFILE.reach_m
    rows = np.flatnonzero((line_y_m < most) & (line_y_m > least) & (view.x_m < PROFILE.far_m))
    if len(rows) < 2:
        return np.empty((len(channels), 0, len(OFFSETS_M)), np.float32)
    # rows cut a slanted line at an angle: distances at right angles to it are longer along the row
    slant = np.hypot(1, np.gradient(line_y_m[rows], view.x_m[rows]))
    chosen = slice(None, None, -(-len(rows) // PROFILE.max_rows))
    rows, slant = rows[chosen], slant[chosen]
    column = ((view.y_m[0] - line_y_m[rows, None] - slant[:, None] * OFFSETS_M) / view.cell_m).astype(np.float32)
    row = np.broadcast_to(np.arange(len(rows), dtype=np.float32)[:, None], column.shape).copy()
    # only the rows used are converted, not the whole channels
    used = channels[:, rows].astype(np.float32)
    return np.array([cv2.remap(channel, column, row, cv2.INTER_LINEAR) for channel in used])


@dataclass(frozen=True)
class MarkingTypeParameters:
    """Votes on the type of a marking; tuned on the rendered suite where no source is given."""

    # Gaps between dashes are 3 m (UK, slow roads) to 12 m (Germany); holes from wear and shadows are mostly shorter.
    min_dash_gap_m: float = 2.7
    # Beyond this distance a gap has too few rows of the view.
    far_m: float = 32.0
    min_rows: int = 6
    # Share of its weight that a vote keeps with each further vote: it is halved after 14 votes.
    decay: float = 0.95
    # Smallest sum of votes that decides.
    min_votes: float = 0.5


MARKING_TYPE = MarkingTypeParameters()


@dataclass(frozen=True)
class MarkingType:
    """Type of a marking: "yellow" or "white", "dashed" or "solid", double or not; None where not seen well enough."""

    colour: str | None = None
    pattern: str | None = None
    double: bool | None = None

    def describe(self) -> str:
        """Words: "yellow double solid"."""
        return " ".join(filter(None, [self.colour, "double" if self.double else None, self.pattern])) or "unknown"


@dataclass(frozen=True)
class MarkingVotes:
    """Sums of the votes so far, each positive for yellow, dashed, double and negative for white, solid, single."""

    yellow: float = 0.0
    dashed: float = 0.0
    double: float = 0.0

    def add_profile(self, profile: MarkingProfile | None) -> MarkingVotes:
        """Add a vote on colour and double from a cross-section, if there is one."""
        if profile is None:
            return self
        yellow, double = _add(self.yellow, profile.yellow), _add(self.double, profile.double)
        return replace(self, yellow=yellow, double=double)

    def add_gaps(self, marked_m: np.ndarray) -> MarkingVotes:
        """Add a vote on the pattern from a frame with stripes at these distances ahead (N,), sorted or not."""
        dashed = looks_dashed(marked_m)
        return self if dashed is None else replace(self, dashed=_add(self.dashed, dashed))

    @property
    def marking_type(self) -> MarkingType:
        """The majority of the votes."""
        return MarkingType(
            _decide(self.yellow, "yellow", "white"),
            _decide(self.dashed, "dashed", "solid"),
            _decide(self.double, True, False),
        )


def _add(votes: float, yes: bool) -> float:
    return MARKING_TYPE.decay * votes + (1 if yes else -1)


def looks_dashed(marked_m: np.ndarray) -> bool | None:
    """Whether stripes at these distances (N,) have gaps like a dashed line's; None if there are too few."""
    marked_m = np.sort(marked_m[marked_m < MARKING_TYPE.far_m])
    gaps = marked_m[1:] - marked_m[:-1]
    # stripes at the same distance count once
    if np.count_nonzero(gaps) < MARKING_TYPE.min_rows - 1:
        return None
    return bool(gaps.max() > MARKING_TYPE.min_dash_gap_m)


def _decide(votes: float, positive: object, negative: object):
    return None if abs(votes) < MARKING_TYPE.min_votes else positive if votes > 0 else negative
