"""What kind of line is it: white or yellow, single or double, solid or dashed? Read off the straightened stripe.

Along a fitted line the view is laid out straight: one row for each row of the view, one column for each distance
from the line. Its median over the rows is the cross-section of the paint, free of the road's texture.
"""

from __future__ import annotations

import cv2
import numpy as np

from lanes.tracking.birdseye import BirdsEyeView
from lanes.tracking.lane import MarkingProfile
from lanes.tracking.markings import NOISE_FLOOR, MarkingResponse

STEP_M, REACH_M = 0.025, 0.6
OFFSETS_M = np.arange(REACH_M, -REACH_M - STEP_M / 2, -STEP_M)
# So many of them, at either end, lie beside any paint.
BESIDE = 12
# Beyond this distance a double line's stripes run together in the picture.
VOTING_FAR_M = 22.0
LEAST_ROWS, MOST_ROWS = 4, 32


def straighten(channel: np.ndarray, view: BirdsEyeView, line_y_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lay a channel out along a line.

    Parameters
    ----------
    channel : ndarray of shape (rows, columns), float32
    view : BirdsEyeView
    line_y_m : ndarray of shape (rows,)
        The line's lateral place on the view's grid at each of its rows; NaN for rows to leave out.

    Returns
    -------
    values : ndarray of shape (rows used, offsets), float32
        At most `MOST_ROWS` rows, none farther than `VOTING_FAR_M`.
    offsets_m : ndarray of shape (offsets,)
        Distance to the left of the line, at right angles.
    """
    reach = (view.y_m[0] - REACH_M, view.y_m[-1] + REACH_M)
    rows = np.flatnonzero((line_y_m < reach[0]) & (line_y_m > reach[1]) & (view.x_m < VOTING_FAR_M))
    if len(rows) < 2:
        return np.empty((0, len(OFFSETS_M)), np.float32), OFFSETS_M
    # a row cuts a line that runs aslant aslant, too: what lies side by side is farther apart along the row
    aslant = np.hypot(1, np.gradient(line_y_m[rows], view.x_m[rows]))
    chosen = slice(None, None, len(rows) // MOST_ROWS + 1)
    rows, aslant = rows[chosen], aslant[chosen]
    column = (view.y_m[0] - line_y_m[rows, None] - aslant[:, None] * OFFSETS_M) / view.cell_m
    row = np.broadcast_to(rows[:, None], column.shape).astype(np.float32)
    return cv2.remap(channel, column.astype(np.float32), row, cv2.INTER_LINEAR), OFFSETS_M


def marking_profile(response: MarkingResponse, view: BirdsEyeView, line_y_m: np.ndarray) -> MarkingProfile | None:
    """Cross-section of the paint along a line, in the channel where it stands out more; None where there is none."""
    found = [
        (*section, yellow)
        for channel, yellow in zip(response.channels.astype(np.float32), (False, True), strict=True)
        if (section := _section(channel, view, line_y_m))
    ]
    if not found:
        return None
    contrast, width, centre, yellow = max(found)
    return MarkingProfile(width, centre, yellow, contrast)


def _section(channel: np.ndarray, view: BirdsEyeView, line_y_m: np.ndarray) -> tuple[float, float, float] | None:
    """Contrast, width and centre of the band in one channel."""
    values, offsets = straighten(channel, view, line_y_m)
    if len(values) < LEAST_ROWS:
        return None
    section = np.median(values, axis=0)
    section = section - max(section[:BESIDE].mean(), section[-BESIDE:].mean())
    inner = section[BESIDE:-BESIDE]
    top = inner.max()
    if top <= 0:
        return None
    step = np.abs(np.diff(values, axis=1))
    noise = (step[:, : BESIDE - 1].mean() + step[:, 1 - BESIDE :].mean()) / 2
    band = offsets[BESIDE:-BESIDE][inner >= top / 2]
    return float(top / (noise + NOISE_FLOOR)), float(band[0] - band[-1] + STEP_M), float(band[0] + band[-1]) / 2
