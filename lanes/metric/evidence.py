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

from lanes.metric.roadview import RoadView

# Painted widths, metres: one stripe (0.10-0.15 m in most of the world), and a double line taken as one.
# Then the width of the road strips that the stripe is compared with, on either side, and their distance from it, and
# the window along a row over which noise is averaged.
SIZES_M = (0.15, 0.35, 0.15, 0.05, 2.5)
NOISE_ROWS = 5
# Rounding to whole grey levels alone makes about this much noise; less is never assumed.
NOISE_FLOOR = 1.0
# A stripe's strength above which it is worth keeping: so many times the local noise.
LEAST_STRENGTH = 3.0
STRIPES_PER_ROW = 14


@dataclass(frozen=True, eq=False)
class Evidence:
    """How much each cell of a view looks like a painted stripe.

    Attributes
    ----------
    strength : ndarray of shape (rows, columns), float32
        The best filter's response in units of the local noise; 0 where there is nothing.
    channels : tuple of 2 ndarray of shape (rows, columns), float32
        Lightness and yellowness of the view, in grey levels.
    filters : tuple of 2 pairs of ndarray of shape (rows, columns), float32
        Responses of the narrow and the wide filter, in grey levels, for lightness and for yellowness.
    noise : tuple of 2 ndarray of shape (rows, columns), float32
        Local noise of lightness and of yellowness, in grey levels.
    """

    strength: np.ndarray
    channels: tuple[np.ndarray, ...]
    filters: tuple[tuple[np.ndarray, np.ndarray], ...]
    noise: tuple[np.ndarray, ...]


@dataclass(frozen=True, eq=False)
class Stripes:
    """Stripe centres found row by row; all arrays have shape (stripes,).

    Attributes
    ----------
    row : int
        Row of the view.
    x_m, y_m : float
        Where on the road, metres ahead and to the left, between the columns.
    angle : float
        Which way the stripe runs, radians, positive to the left of straight ahead.
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
    angle: np.ndarray
    strength: np.ndarray
    double: np.ndarray
    yellow: np.ndarray

    def __len__(self) -> int:
        return len(self.row)

    def select(self, which: np.ndarray) -> Stripes:
        """The stripes that `which` (bool or index) picks."""
        return Stripes(*(getattr(self, f.name)[which] for f in fields(self)))


def lightness(view_image: np.ndarray) -> np.ndarray:
    """Luma of an RGB view as float32 (rows, columns), weights of ITU-R BT.601."""
    return cv2.cvtColor(view_image, cv2.COLOR_RGB2GRAY).astype(np.float32)


def yellowness(view_image: np.ndarray) -> np.ndarray:
    """How much blue is missing: min(R, G) - B as float32 (rows, columns); yellow paint has it in sun and in shade."""
    red, green, blue = cv2.split(view_image)
    return cv2.subtract(cv2.min(red, green), blue, dtype=cv2.CV_32F)


def mean_around(values: np.ndarray, columns: int, rows: int = 1) -> np.ndarray:
    """Mean over a window around each cell; for windows this small a separable filter is faster than cv2.blur."""
    across, along = (np.full(n, 1 / n, np.float32) for n in (columns, rows))
    return cv2.sepFilter2D(values, -1, across, along, borderType=cv2.BORDER_REPLICATE)


def filter_band(channel: np.ndarray, side: np.ndarray, width: int, reach: int) -> np.ndarray:
    """Mean over a stripe of `width` cells minus the larger of `side` at `reach` cells to its left and right."""
    centre = mean_around(channel, width)
    padded = cv2.copyMakeBorder(side, 0, 0, reach, reach, cv2.BORDER_REPLICATE)
    return cv2.subtract(centre, cv2.max(padded[:, : -2 * reach], padded[:, 2 * reach :]))


def local_noise(channel: np.ndarray, window: int) -> np.ndarray:
    """Mean absolute step from column to column in a window around each cell, at least `NOISE_FLOOR`."""
    step = cv2.absdiff(channel, cv2.copyMakeBorder(channel, 0, 0, 1, 0, cv2.BORDER_REPLICATE)[:, :-1])
    return cv2.add(cv2.blur(step, (window, NOISE_ROWS)), (NOISE_FLOOR,))


def measure_paint(view_image: np.ndarray, view: RoadView) -> Evidence:
    """Look for stripes everywhere in a view.

    Parameters
    ----------
    view_image : ndarray of shape (rows, columns, 3), uint8
        What `view.warp` returned.
    view : RoadView

    Returns
    -------
    Evidence
    """
    single, double, beside, gap, window = (round(length / view.cell_m) | 1 for length in SIZES_M)
    channels = lightness(view_image), yellowness(view_image)
    filters, noises, strengths = [], [], []
    for channel in channels:
        side = mean_around(channel, beside)
        filters.append(tuple(filter_band(channel, side, n, n // 2 + gap + beside // 2 + 1) for n in (single, double)))
        noises.append(local_noise(channel, window))
        strengths.append(cv2.divide(cv2.max(*filters[-1]), noises[-1]))
    strength = cv2.max(cv2.max(*strengths), (0.0,))
    strength[view.seen_around(double // 2 + gap + beside + 1) == 0] = 0
    return Evidence(strength, channels, tuple(filters), tuple(noises))


def find_stripes(evidence: Evidence, view: RoadView) -> Stripes:
    """Peaks of the evidence along each row, placed between the columns.

    Returns
    -------
    Stripes
        At most `STRIPES_PER_ROW` a row, the strongest, each at least `LEAST_STRENGTH` times the noise.
    """
    best = evidence.strength
    peak = cv2.compare(best, cv2.dilate(best, np.ones((1, 5), np.uint8)), cv2.CMP_GE)
    row, column = np.nonzero(peak.view(bool) & (best > LEAST_STRENGTH))
    inside = (column > 0) & (column < best.shape[1] - 1)
    row, column = _strongest_of_each_row(row[inside], column[inside], best)
    left, middle, right = (best[row, column + k] for k in (-1, 0, 1))
    bend = left - 2 * middle + right
    shift = np.where(bend < 0, 0.5 * (left - right) / np.minimum(bend, -1e-9), 0.0)
    y = view.y_m[0] - (column + np.clip(shift, -0.5, 0.5)) * view.cell_m
    narrow, wide = (
        [f[kind][row, column] / n[row, column] for f, n in zip(evidence.filters, evidence.noise, strict=True)]
        for kind in (0, 1)
    )
    double = np.maximum(*wide) > np.maximum(*narrow)
    yellow = np.maximum(narrow[1], wide[1]) > np.maximum(narrow[0], wide[0])
    return Stripes(row, view.x_m[row], y, _stripe_angle(best, row, column, view), middle, double, yellow)


def _strongest_of_each_row(row: np.ndarray, column: np.ndarray, best: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    order = np.lexsort((-best[row, column], row))
    row, column = row[order], column[order]
    keep = np.arange(len(row)) - np.searchsorted(row, row) < STRIPES_PER_ROW
    return row[keep], column[keep]


def _stripe_angle(evidence: np.ndarray, row: np.ndarray, column: np.ndarray, view: RoadView) -> np.ndarray:
    """Direction of stripes on the road from the structure tensor of the evidence (Bigun and Granlund, 1987)."""
    across = cv2.Scharr(evidence, cv2.CV_32F, 1, 0)
    along = cv2.Scharr(evidence, cv2.CV_32F, 0, 1)
    xx, yy, xy = (
        mean_around(cv2.multiply(p, q), 7, 5)[row, column]
        for p, q in ((across, across), (along, along), (across, along))
    )
    normal = 0.5 * np.arctan2(2 * xy, xx - yy)
    # One row down the stripe moves this many columns to the right, while x falls by one row's depth.
    columns = -np.tan(normal)
    depth_m = view.x_m[row] * view.growth / (1 + view.growth)
    return np.arctan2(columns * view.cell_m, depth_m)
