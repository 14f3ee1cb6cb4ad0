"""Cross-section of a line's marking: width, position, colour and contrast.

The view is resampled along a fitted line: one row for each row of the view, one column for each distance from the line.
The median over the rows is the cross-section of the marking, without the texture of the road.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from lanes.tracking.birdseye import BirdsEyeView
from lanes.tracking.lane import MarkingProfile
from lanes.tracking.markings import MARKINGS, MarkingResponse


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


def _straighten(channel: np.ndarray, view: BirdsEyeView, line_y_m: np.ndarray) -> np.ndarray:
    """(rows used, offsets) float32 of a channel (rows, columns), resampled along a line at `OFFSETS_M`.

    At most `PROFILE.max_rows` rows are used, none farther than `PROFILE.far_m`.
    """
    most, least = view.y_m[0] - PROFILE.reach_m, view.y_m[-1] + PROFILE.reach_m
    rows = np.flatnonzero((line_y_m < most) & (line_y_m > least) & (view.x_m < PROFILE.far_m))
    if len(rows) < 2:
        return np.empty((0, len(OFFSETS_M)), np.float32)
    # rows cut a slanted line at an angle: distances at right angles to it are longer along the row
    slant = np.hypot(1, np.gradient(line_y_m[rows], view.x_m[rows]))
    chosen = slice(None, None, len(rows) // PROFILE.max_rows + 1)
    rows, slant = rows[chosen], slant[chosen]
    column = (view.y_m[0] - line_y_m[rows, None] - slant[:, None] * OFFSETS_M) / view.cell_m
    row = np.broadcast_to(np.arange(len(rows), dtype=np.float32)[:, None], column.shape)
    # only the rows used are converted, not the whole channel
    return cv2.remap(channel[rows].astype(np.float32), column.astype(np.float32), row, cv2.INTER_LINEAR)


def marking_profile(response: MarkingResponse, view: BirdsEyeView, line_y_m: np.ndarray) -> MarkingProfile | None:
    """Cross-section of the marking along a line, in the channel with more contrast; None without a marking.

    `line_y_m` (rows,) is the lateral position of the line on the view's grid in each row; NaN for rows to leave out.
    """
    found = [
        (*section, yellow)
        for channel, yellow in zip(response.channels, (False, True), strict=True)
        if (section := _section(channel, view, line_y_m))
    ]
    if not found:
        return None
    contrast, width, centre, yellow = max(found)
    return MarkingProfile(width, centre, yellow, contrast)


def _section(channel: np.ndarray, view: BirdsEyeView, line_y_m: np.ndarray) -> tuple[float, float, float] | None:
    """Contrast, width and centre of the band in one channel."""
    values = _straighten(channel, view, line_y_m)
    if len(values) < PROFILE.min_rows:
        return None
    road = PROFILE.road_samples
    section = np.median(values, axis=0)
    section = section - max(section[:road].mean(), section[-road:].mean())
    inner = section[road:-road]
    top = inner.max()
    if top <= 0:
        return None
    step = np.abs(np.diff(values, axis=1))
    noise = (step[:, : road - 1].mean() + step[:, 1 - road :].mean()) / 2
    band = OFFSETS_M[road:-road][inner >= top / 2]
    width, centre = float(band[0] - band[-1] + PROFILE.step_m), float(band[0] + band[-1]) / 2
    return float(top / (noise + MARKINGS.noise_floor)), width, centre
