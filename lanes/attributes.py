"""What kind of line is it: white or yellow, single or double, solid or dashed? Read off the straightened stripe.

Along a fitted line the view is laid out straight: one row for each row of the view, one column for each lateral
distance from the line. Its median over the rows is the cross-section of the paint, free of the road's texture.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from lanes.evidence import lightness, yellowness
from lanes.roadview import RoadView

STEP_M, REACH_M, INNER_M = 0.025, 0.6, 0.3
# Beyond this distance a double line's stripes run together in the picture.
FAR_M = 22.0
LEAST_ROWS = 4
# A painted stripe is 0.10 to 0.15 m wide; two of them with their gap come to 0.25 m and more.
STRIPE_M, DOUBLE_FROM_M = 0.12, 0.23


@dataclass(frozen=True)
class Paint:
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


def straighten(channel: np.ndarray, view: RoadView, line_y_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lay a channel out along a line.

    Parameters
    ----------
    channel : ndarray of shape (rows, columns), float32
    view : RoadView
    line_y_m : ndarray of shape (rows,)
        The line's lateral place on the view's grid at each of its rows; NaN for rows to leave out.

    Returns
    -------
    values : ndarray of shape (rows used, offsets), float32
    offsets_m : ndarray of shape (offsets,)
        Distance to the left of the line.
    """
    offsets = np.arange(REACH_M, -REACH_M - STEP_M / 2, -STEP_M)
    rows = np.flatnonzero(np.isfinite(line_y_m) & (view.x_m < FAR_M))
    column = (view.y_m[0] - line_y_m[rows, None] - offsets) / view.cell_m
    row = np.broadcast_to(rows[:, None], column.shape)
    inside = (column.min(axis=1) >= 0) & (column.max(axis=1) <= len(view.y_m) - 1)
    if not inside.any():
        return np.empty((0, len(offsets)), np.float32), offsets
    places = column[inside].astype(np.float32), row[inside].astype(np.float32)
    return cv2.remap(channel, *places, cv2.INTER_LINEAR), offsets


def describe_paint(view_image: np.ndarray, view: RoadView, line_y_m: np.ndarray) -> Paint | None:
    """Cross-section of the paint along a line, in the channel where it stands out more; None where there is none."""
    found = [_section(channel(view_image), view, line_y_m) for channel in (lightness, yellowness)]
    sections = [
        (contrast, width, centre, kind == 1) for kind, s in enumerate(found) if s for contrast, width, centre in [s]
    ]
    if not sections:
        return None
    contrast, width, centre, yellow = max(sections)
    return Paint(width, centre, yellow, contrast)


def _section(channel: np.ndarray, view: RoadView, line_y_m: np.ndarray) -> tuple[float, float, float] | None:
    values, offsets = straighten(channel, view, line_y_m)
    if len(values) < LEAST_ROWS:
        return None
    beside, inner = np.abs(offsets) > INNER_M + 0.05, np.abs(offsets) < INNER_M
    section = np.median(values, axis=0)
    section = section - max(np.median(section[beside & (offsets > 0)]), np.median(section[beside & (offsets < 0)]))
    top = section[inner].max()
    if top <= 0:
        return None
    noise = np.abs(np.diff(values[:, beside], axis=1)).mean() + 1
    band = offsets[inner & (section >= top / 2)]
    return float(top / noise), float(band[0] - band[-1] + STEP_M), float((band[0] + band[-1]) / 2)
