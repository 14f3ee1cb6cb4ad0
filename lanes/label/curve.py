"""A smooth curve through clicked points of a lane line, snapped to the paint near it, in the raw image.

On a flat road its curvature is a random walk along the road (a smoothing spline: G. Wahba, Journal of the Royal
Statistical Society B 40, 1978); the errors of points and paint say how near it comes to them.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike

from lanes.detect.paint import lightness, yellowness
from lanes.labels import NO_POINT

# In pixels of an image 720 px high: reach of the snap at 0.4 of the height and above, and at the bottom; widest paint.
SNAP_PX, WIDEST_PX = (6.0, 16.0), 37
# Standard deviations across the line of clicked points and of paint, in pixels of an image 720 px high.
POINT_PX, PAINT_PX = 2.0, 0.7
# A usual camera: focal length, and the horizon above the highest point, in image heights; its own height in metres.
FOCAL, TO_HORIZON, CAMERA_M = 1.5, 0.04, 1.4
# Standard deviations of the curvature at the car, 1/m, and of its change over a metre, 1/m^1.5. With a third of the
# latter the line of a painted hairpin of 25 m is 2.2 px off (RMS) instead of 1.6, with three times as much that of a
# bend of 200 m is 0.54 px off instead of 0.40.
CURVATURE, CURVATURE_CHANGE = 0.05, 0.001
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
    columns = _smooth(rows, u, v, np.full(len(v), POINT_PX), len(image))
    for _ in range(3):  # a curve on the paint of some rows comes near that of the next ones
        paint = find_paint(image, rows, columns)
        seen = np.isfinite(paint)
        beside = np.abs(v[:, None] - rows[seen]).min(axis=1, initial=np.inf) >= half  # points without paint
        at, errors_px = np.append(v[beside], rows[seen]), np.repeat([POINT_PX, PAINT_PX], [beside.sum(), seen.sum()])
        errors_px *= np.interp(at, rows, np.hypot(1, np.gradient(columns, rows)))  # along the row
        columns = _smooth(rows, np.append(u[beside], paint[seen]), at, errors_px, len(image))
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


def _smooth(rows: np.ndarray, u: np.ndarray, v: np.ndarray, errors_px: np.ndarray, height: int) -> np.ndarray:
    """Columns (R,) at evenly spaced `rows` (R,) of the most probable line, given points (u, v) with errors, (N,) each.

    The flat road in a row is FOCAL * CAMERA_M / depth ahead, with the row's `depth` below the horizon in image heights.
    Its curvature is thus proportional to the second derivative of the columns times the cube of `depth`.
    """
    step, depth = rows[1] - rows[0], (rows[1:-1] - rows[0]) / height + TO_HORIZON
    share = (1 - np.abs(v[:, None] - rows) / step).clip(0)  # of the rows next to each point
    second = np.diff(np.eye(len(rows)), 2, axis=0) * height / step**2
    curvature = second * depth[:, None] ** 3 / (FOCAL**2 * CAMERA_M)
    change = np.diff(curvature, axis=0) / np.sqrt(-np.diff(FOCAL * CAMERA_M / depth))[:, None]
    weights = 720 / height / errors_px
    equations = np.vstack([share * weights[:, None], change / CURVATURE_CHANGE, curvature[-1:] / CURVATURE])
    return np.linalg.lstsq(equations, np.pad(u * weights, (0, len(rows) - 2)), rcond=None)[0]
