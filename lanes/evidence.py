"""Paint, not brightness: how much each cell of the road view looks like a painted stripe.

A stripe is brighter (or yellower) than the road on *both* its sides, and about 0.1 to 0.2 m wide, or 0.3 to 0.4 m when
two stripes run side by side. The signed band filter asks just that: centre minus the larger neighbour. An edge, be it a
shadow's, a kerb's or that of another asphalt, has one neighbour as bright as its bright side and scores nothing; a dark
tar seam scores less than nothing. What remains is measured in units of the local noise, so that neither exposure nor
shade needs a threshold of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import cv2
import numpy as np

from lanes.roadview import RoadView

# Painted widths, metres: one stripe (0.10-0.15 m in most of the world), and a double line taken as one.
SINGLE_M, DOUBLE_M = 0.15, 0.35
# Width of the road strips that the stripe is compared with, on either side, and their distance from it.
BESIDE_M, GAP_M = 0.15, 0.05
# Noise is averaged over this window along a row (metres) and over so many rows.
NOISE_WINDOW_M, NOISE_ROWS = 2.5, 5
# Rounding to whole grey levels alone makes about this much noise; less is never assumed.
NOISE_FLOOR = 1.0
# A stripe's strength above which it is worth keeping: so many times the local noise.
LEAST_STRENGTH = 2.0
STRIPES_PER_ROW = 24


@dataclass(frozen=True)
class Stripes:
    """Stripe centres found row by row; all arrays have shape (stripes,).

    Attributes
    ----------
    row : int
        Row of the view.
    x_m, y_m : float
        Where on the road, metres ahead and to the left, between the columns.
    strength : float
        Band filter response over local noise.
    double : bool
        The wide filter answered better than the narrow one.
    yellow : bool
        Yellowness answered better than lightness.
    """

    row: np.ndarray
    x_m: np.ndarray
    y_m: np.ndarray
    strength: np.ndarray
    double: np.ndarray
    yellow: np.ndarray
    angle: np.ndarray

    def __len__(self) -> int:
        return len(self.row)

    def select(self, which: np.ndarray) -> Stripes:
        """The stripes that `which` (bool or index) picks."""
        return Stripes(*(getattr(self, f.name)[which] for f in fields(self)))


def lightness(view: np.ndarray) -> np.ndarray:
    """Luma of an RGB view as float32 (rows, columns), weights of ITU-R BT.601."""
    return cv2.cvtColor(view, cv2.COLOR_RGB2GRAY).astype(np.float32)


def yellowness(view: np.ndarray) -> np.ndarray:
    """How much blue is missing: min(R, G) - B as float32 (rows, columns); yellow paint has it in sun and in shade."""
    red, green, blue = cv2.split(view)
    return cv2.min(red, green).astype(np.float32) - blue


def filter_band(channel: np.ndarray, width: int, beside: int, gap: int) -> np.ndarray:
    """Mean over a stripe of `width` cells minus the larger of the means over `beside` cells to its left and right."""
    centre = cv2.blur(channel, (width, 1), borderType=cv2.BORDER_REPLICATE)
    side = cv2.blur(channel, (beside, 1), borderType=cv2.BORDER_REPLICATE)
    reach = width // 2 + gap + beside // 2 + 1
    padded = cv2.copyMakeBorder(side, 0, 0, reach, reach, cv2.BORDER_REPLICATE)
    return centre - cv2.max(padded[:, : -2 * reach], padded[:, 2 * reach :])


def local_noise(channel: np.ndarray, window: int) -> np.ndarray:
    """Mean absolute step from column to column in a window around each cell, at least `NOISE_FLOOR`."""
    step = np.zeros_like(channel)
    step[:, 1:] = cv2.absdiff(channel[:, 1:], channel[:, :-1])
    return cv2.blur(step, (window, NOISE_ROWS)) + NOISE_FLOOR


def measure_paint(view_image: np.ndarray, view: RoadView) -> np.ndarray:
    """Evidence of the four kinds of stripe in each cell.

    Parameters
    ----------
    view_image : ndarray of shape (rows, columns, 3), uint8
        What `view.warp` returned.
    view : RoadView

    Returns
    -------
    ndarray of shape (4, rows, columns), float32
        In units of local noise: light single, light double, yellow single, yellow double; 0 where there is nothing.
    """
    cells = [max(1, round(length / view.cell_m)) for length in (SINGLE_M, DOUBLE_M, BESIDE_M, GAP_M, NOISE_WINDOW_M)]
    single, double, beside, gap, window = (n | 1 for n in cells)
    evidence = []
    for channel in (lightness(view_image), yellowness(view_image)):
        noise = local_noise(channel, window)
        for width in (single, double):
            evidence.append(filter_band(channel, width, beside, gap) / noise)
    evidence = np.maximum(np.stack(evidence), 0)
    evidence[:, ~view.seen] = 0
    return evidence


def find_stripes(evidence: np.ndarray, view: RoadView) -> Stripes:
    """Peaks of the evidence along each row, placed between the columns.

    Parameters
    ----------
    evidence : ndarray of shape (4, rows, columns), float32
        From `measure_paint`.
    view : RoadView

    Returns
    -------
    Stripes
        At most `STRIPES_PER_ROW` a row, the strongest, each at least `LEAST_STRENGTH` times the noise.
    """
    best = evidence.max(axis=0)
    highest = cv2.dilate(best, np.ones((1, 5), np.uint8))
    row, column = np.nonzero((best >= highest) & (best > LEAST_STRENGTH))
    inside = (column > 0) & (column < best.shape[1] - 1)
    row, column = row[inside], column[inside]
    row, column = _strongest_of_each_row(row, column, best)
    left, middle, right = (best[row, column + k] for k in (-1, 0, 1))
    bend = left - 2 * middle + right
    shift = np.where(bend < 0, 0.5 * (left - right) / np.minimum(bend, -1e-9), 0.0)
    kind = evidence[:, row, column].argmax(axis=0)
    y = view.y_m[0] - (column + np.clip(shift, -0.5, 0.5)) * view.cell_m
    angle = stripe_angle(best, view)[row, column]
    return Stripes(row, view.x_m[row], y, middle, kind % 2 == 1, kind >= 2, angle)


def stripe_angle(evidence: np.ndarray, view: RoadView) -> np.ndarray:
    across = cv2.Sobel(evidence, cv2.CV_32F, 1, 0, scale=1 / 8)
    along = cv2.Sobel(evidence, cv2.CV_32F, 0, 1, scale=1 / 8)
    xx, yy, xy = (cv2.boxFilter(p, -1, (7, 5)) for p in (across * across, along * along, across * along))
    # columns that a stripe moves from one row to the next lower one
    theta = 0.5 * np.arctan2(2 * xy, xx - yy)  # direction of the gradient
    move = -np.tan(theta)
    step = view.x_m[:, None] * view.growth / (1 + view.growth)
    # down one row: x falls by step, column grows by move -> y falls by move * cell
    return np.arctan2(move * view.cell_m, step)


def _strongest_of_each_row(row: np.ndarray, column: np.ndarray, best: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    order = np.lexsort((-best[row, column], row))
    row, column = row[order], column[order]
    first = np.searchsorted(row, row)
    keep = np.arange(len(row)) - first < STRIPES_PER_ROW
    return row[keep], column[keep]
