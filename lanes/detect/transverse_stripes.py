"""Painted stripes that cross a lane from line to line: the joints of tiles and bricks. Few roads have more than one.

The lane between its lines is divided into strips along the road. In each strip a stripe is lighter than the road before
and behind it. Arrows do not reach into all strips. A stripe is also nearly as light as the lines of the lane: the road
between two shadows or two dark joints is not.
"""

from __future__ import annotations

import numpy as np

from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.paint import PAINT, lightness

# Distance ahead up to which stripes are counted.
FAR_M = 30.0
# Number of strips, and their distance from both lines, so that a line's own paint lies in none.
STRIPS, MARGIN_M = 5, 0.4
# Smallest contrast of a stripe, relative to the mean step from cell to cell in the lane. A stripe is lighter than the
# road by at least this share of the difference between lines and road. Chosen on labelled stills and drawn pictures
# without a road.
MIN_CONTRAST, MIN_LIGHT_SHARE = 2.0, 0.35


def count_transverse_stripes(view_image: np.ndarray, view: BirdsEyeView, lines_y_m: np.ndarray) -> int:
    """Number of light stripes across the lane.

    Parameters
    ----------
    view_image : ndarray (rows, columns, 3), uint8
        Bird's-eye view, from `BirdsEyeView.warp`.
    lines_y_m : ndarray (2, rows)
        Lateral positions of the left and the right line in the rows of the view; NaN where a line does not pass.
    """
    near = view.x_m < FAR_M
    light, seen = lightness(view_image)[near].astype(float), view.seen[near]
    borders = _strip_borders(lines_y_m[:, near], view)
    column = np.arange(len(view.y_m))
    inside = seen & (column >= borders[:, :1]) & (column < borders[:, -1:])
    steps = inside[:, 1:] & inside[:, :-1]
    line_light = _line_lightness(light, seen, lines_y_m[:, near], view)
    if not steps.any() or line_light is None:
        return 0
    road_light = float(np.median(light[inside]))
    noise = float(np.abs(np.diff(light))[steps].mean()) + PAINT.noise_floor
    strips = _strip_means(light, seen, borders)
    # compared with the road two, three and four rows away, because stripes are as deep as one to three rows
    contrast = np.max([_contrast(strips, rows) for rows in (2, 3, 4)], axis=0)
    contrast[~(strips.min(axis=0) - road_light >= MIN_LIGHT_SHARE * (line_light - road_light))] = 0
    peak = (contrast[1:-1] > contrast[:-2]) & (contrast[1:-1] >= contrast[2:])
    return int((peak & (contrast[1:-1] > MIN_CONTRAST * noise)).sum())


def _strip_borders(lines_y_m: np.ndarray, view: BirdsEyeView) -> np.ndarray:
    """First columns (rows, strips + 1) of the strips, and the end of the last one; all 0 where a line does not pass."""
    left, right = lines_y_m + np.array([[-1], [1]]) * MARGIN_M
    edges_m = left[:, None] + (right - left)[:, None] * np.linspace(0, 1, STRIPS + 1)
    columns = np.nan_to_num((view.y_m[0] - edges_m) / view.cell_m)
    return np.clip(np.rint(columns), 0, len(view.y_m)).astype(int)


def _strip_means(light: np.ndarray, seen: np.ndarray, borders: np.ndarray) -> np.ndarray:
    """Mean (strips, rows) of the cells of each strip; NaN where one is outside the image, or where there is none."""
    sums, seen_sums = (np.pad(np.cumsum(cells, axis=1), ((0, 0), (1, 0))) for cells in (light, seen))
    total, count = (np.diff(np.take_along_axis(s, borders, axis=1), axis=1).T for s in (sums, seen_sums))
    width = np.diff(borders, axis=1).T
    return np.where((count == width) & (width > 0), total / np.maximum(width, 1), np.nan)


def _line_lightness(light: np.ndarray, seen: np.ndarray, lines_y_m: np.ndarray, view: BirdsEyeView) -> float | None:
    """Lightness of the paint of both lines (2, rows) in grey levels; None if no cell of them is in the image."""
    column = np.rint((view.y_m[0] - lines_y_m) / view.cell_m)
    line, row = np.nonzero((column >= 0) & (column < len(view.y_m)))
    column = column[line, row].astype(int)
    cells = light[row, column][seen[row, column]]
    # a high quantile, because broken lines have gaps
    return float(np.quantile(cells, 0.8)) if len(cells) else None


def _contrast(strips: np.ndarray, rows: int) -> np.ndarray:
    """Contrast (rows,) with the road so many rows away: the smallest of the strips (strips, rows); 0 if not known."""
    contrast = np.zeros(strips.shape[1])
    middle, behind, before = strips[:, rows:-rows], strips[:, : -2 * rows], strips[:, 2 * rows :]
    contrast[rows:-rows] = np.nan_to_num((middle - np.maximum(behind, before)).min(axis=0))
    return contrast
