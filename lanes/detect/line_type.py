"""Marking of a line: its cross-section in one frame, and its type over time.

The view is resampled along a fitted line: one row for each row of the view, one column for each distance from the line.
The median over the rows is the cross-section of the marking, without the texture of the road.

The type is white or yellow, solid or dashed, single or double. A single picture may show a solid line in pieces
(shadows), or one dash as long as the view. Each frame therefore votes, old votes decay, and the majority decides.
"""

from __future__ import annotations

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
# Rows up to this distance, beyond which the stripes of a double line merge in the image; fewest and most rows.
PROFILE_FAR_M, MIN_ROWS, MAX_ROWS = 22.0, 4, 32
# Sampled distances to the left of the line, at right angles.
OFFSETS_M = np.arange(REACH_M, -REACH_M - STEP_M / 2, -STEP_M)
# Gaps between dashes are 3 m (UK, slow roads) to 12 m (Germany); holes from wear and shadows are mostly shorter. They
# are looked for up to this distance, in at least this many rows with paint.
MIN_DASH_GAP_M, DASH_FAR_M, MIN_DASH_ROWS = 2.7, 32.0, 6
# Share of its weight that a vote keeps with each further vote: it is halved after 14 votes.
VOTE_DECAY = 0.95


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
    if channels.shape[1] < MIN_ROWS:
        return None
    profiles = (_profile(values, yellow=yellow) for values, yellow in zip(channels, (False, True), strict=True))
    return max(filter(None, profiles), key=attrgetter("contrast"), default=None)


def _profile(values: np.ndarray, *, yellow: bool) -> MarkingProfile | None:
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
    if width_m > DOUBLE_FROM_M and not yellow:
        near = _cross_section(values[-max(len(values) // 3, MIN_ROWS) :])
        band = near[painted[0] : painted[-1] + 1]
        third, half = len(band) // 3, len(band) // 2
        peak = min(band[:half].max(), band[-half:].max())
        gap = float(band[third:-third].min() / peak) if peak > 0 else 1.0
    return MarkingProfile(width_m, float(first + last) / 2, yellow, float(top / (noise + PAINT.noise_floor)), gap)


def _cross_section(values: np.ndarray) -> np.ndarray:
    """Median over rows (rows, offsets), minus the brighter of the roads at both ends, without these ends."""
    road = ROAD_SAMPLES
    section = np.median(values, axis=0)
    return section[road:-road] - max(section[:road].mean(), section[-road:].mean())


def _straighten(channels: np.ndarray, view: BirdsEyeView, line_y_m: np.ndarray) -> np.ndarray:
    """(2, at most `MAX_ROWS`, offsets) float32: both channels, resampled along a line at `OFFSETS_M`."""
    most, least = view.y_m[0] - REACH_M, view.y_m[-1] + REACH_M
    rows = np.flatnonzero((line_y_m < most) & (line_y_m > least) & (view.x_m < PROFILE_FAR_M))
    if len(rows) < 2:
        return np.empty((len(channels), 0, len(OFFSETS_M)), np.float32)
    # rows cut a slanted line at an angle: distances at right angles to it are longer along the row
    slant = np.hypot(1, np.gradient(line_y_m[rows], view.x_m[rows]))
    chosen = slice(None, None, -(-len(rows) // MAX_ROWS))
    rows, slant = rows[chosen], slant[chosen]
    column = ((view.y_m[0] - line_y_m[rows, None] - slant[:, None] * OFFSETS_M) / view.cell_m).astype(np.float32)
    row = np.broadcast_to(np.arange(len(rows), dtype=np.float32)[:, None], column.shape).copy()
    used = channels[:, rows].astype(np.float32)
    return np.array([cv2.remap(channel, column, row, cv2.INTER_LINEAR) for channel in used])


@dataclass(frozen=True)
class TypeVotes:
    """Sums of the votes so far, each positive for yellow, dashed, double and negative for white, solid, single."""

    yellow: float = 0.0
    dashed: float = 0.0
    double_stripes: float = 0.0

    @property
    def colour(self) -> str | None:
        """ "white" or "yellow"; None if not seen well enough."""
        return _majority(self.yellow, "yellow", "white")

    @property
    def kind(self) -> str | None:
        """ "solid" or "dashed"; None if not seen well enough."""
        return _majority(self.dashed, "dashed", "solid")

    @property
    def double(self) -> bool | None:
        """Two stripes side by side; None if not seen well enough."""
        return _majority(self.double_stripes, True, False)

    def add_profile(self, profile: MarkingProfile | None) -> TypeVotes:
        """Add a vote on colour and double from a cross-section, if there is one."""
        if profile is None:
            return self
        yellow, double = _add(self.yellow, profile.yellow), _add(self.double_stripes, profile.double)
        return replace(self, yellow=yellow, double_stripes=double)

    def add_gaps(self, marked_m: np.ndarray) -> TypeVotes:
        """Add a vote on the kind from a frame with stripes at these distances ahead (N,), sorted or not."""
        dashed = looks_dashed(marked_m)
        return self if dashed is None else replace(self, dashed=_add(self.dashed, dashed))


def _add(votes: float, yes: bool) -> float:
    return VOTE_DECAY * votes + (1 if yes else -1)


def _majority(votes: float, positive: T, negative: T) -> T | None:
    """The winner of the votes; None if there is less than half a vote for it."""
    return None if abs(votes) < 0.5 else positive if votes > 0 else negative


def looks_dashed(marked_m: np.ndarray) -> bool | None:
    """Whether stripes at these distances (N,) have gaps like a dashed line's; None if there are too few."""
    marked_m = np.sort(marked_m[marked_m < DASH_FAR_M])
    gaps = marked_m[1:] - marked_m[:-1]
    # stripes at the same distance count once
    if np.count_nonzero(gaps) < MIN_DASH_ROWS - 1:
        return None
    return bool(gaps.max() > MIN_DASH_GAP_M)
