"""A smooth curve through clicked points of a lane line, snapped to the paint near it, in the raw image.

It minimizes squared distances plus squared second differences (P. H. C. Eilers, Analytical Chemistry 75, 2003).
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike

from lanes.detect.paint import lightness, yellowness
from lanes.labels import NO_POINT

# In pixels of an image 720 px high: reach of the snap at 0.4 of the height and above, and at the bottom; widest paint.
SNAP_PX, WIDEST_PX = (6.0, 16.0), 37
# Weight of the squared second differences: with 1 the slopes at the ends of dashes make S-bends of 3.6 px in the gaps,
# with 3 of 3.1 px, with 10 of 2.7 px; but with 10 labels of bends change their score (test_label_in_browser.py).
STIFFNESS = 3.0
MIN_CONTRAST, MIN_RATIO = 8.0, 4.0  # of paint with both its sides: grey levels, and times the noise


def label_rows(height: int) -> np.ndarray:
    """The labelled rows (R,) int of an image, at 720 px those of TuSimple: 160, 170, ... 710."""
    return np.arange(16 * (step := max(round(height / 72), 1)), height, step)


def fit_line(image: np.ndarray, points: ArrayLike) -> np.ndarray:
    """Columns (R,) at `label_rows` of a line through `points` (N, 2), column and row, in an RGB image; -2 without."""
    labelled, (u, v) = label_rows(len(image)), np.array(points, float).reshape(-1, 2).T
    half = (labelled[1] - labelled[0]) / 2
    if len(v) < 2 or np.ptp(v) < 2 * half:  # within one row step
        return np.full(len(labelled), NO_POINT)
    rows = half * np.arange(np.floor(v.min() / half), np.ceil(v.max() / half) + 1)
    columns = _smooth(rows, u, v)
    for _ in range(3):  # a curve on the paint of some rows comes near that of the next ones
        paint = find_paint(image, rows, columns)
        seen = np.isfinite(paint)
        beside = np.abs(v[:, None] - rows[seen]).min(axis=1, initial=np.inf) >= half  # points without paint
        columns = _smooth(rows, np.append(u[beside], paint[seen]), np.append(v[beside], rows[seen]))
    at = np.interp(labelled, rows, columns, left=NO_POINT, right=NO_POINT).round(1)
    return np.where((at >= 0) & (at <= image.shape[1] - 1), at, NO_POINT)


def find_paint(image: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Columns (R,) near `columns` (R,), at `rows` (R,), of paint, brighter or yellower than both sides; NaN without."""
    scale, ratios = len(image) / 720, []
    reach_px = scale * np.interp(rows, [0.4 * len(image), len(image)], SNAP_PX)[:, None]
    reach_px *= np.hypot(1, np.gradient(columns, rows)).clip(max=3)[:, None]  # across the line, not along the row
    widths = range(3, max(round(WIDEST_PX * scale), 3) + 1, 2 * max(round(scale), 1))
    shifts, margin = np.arange(-int(reach_px.max()), int(reach_px.max()) + 1), 2 * widths[-1]
    x = (columns[:, None] + np.arange(shifts[0] - margin, shifts[-1] + margin + 1)).astype(np.float32)
    strips = cv2.remap(image, x, np.tile(rows[:, None], x.shape[1]).astype(np.float32), cv2.INTER_LINEAR)
    for profiles in (lightness(strips).astype(np.float32), yellowness(strips).astype(np.float32)):
        noise = 1 + np.median(np.abs(np.diff(profiles)), axis=1, keepdims=True)
        for width in widths:
            mean = cv2.blur(profiles, (width, 1))
            contrast = (mean - np.maximum(np.roll(mean, width, 1), np.roll(mean, -width, 1)))[:, margin:-margin]
            ratio = contrast * np.sqrt(width) / noise * (1 - 0.5 * (shifts / reach_px) ** 2)
            ratios.append(np.where((contrast < MIN_CONTRAST) | (np.abs(shifts) > reach_px), 0, ratio))
    best = np.max(ratios, axis=0)
    return np.where(best.max(axis=1) > MIN_RATIO, columns + shifts[best.argmax(axis=1)], np.nan)


def _smooth(rows: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Columns (R,) at evenly spaced `rows` (R,) of the smoothing spline through points (u, v), (N,) each."""
    share = (1 - np.abs(v[:, None] - rows) / (rows[1] - rows[0])).clip(0)  # of the rows next to each point
    bend = np.diff(np.eye(len(rows)), 2, axis=0)
    return np.linalg.solve(share.T @ share + STIFFNESS * bend.T @ bend, share.T @ u)
