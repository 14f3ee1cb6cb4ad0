"""Painted stripes that cross a lane from line to line: the joints of tiles and bricks. Few roads have more than one.

The lane between its lines is divided into strips along the road. In each strip a stripe is lighter than the road before
and behind it. Arrows do not reach into all strips. A stripe is also nearly as light as the lines of the lane: the road
between two shadows or two dark joints is not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.paint import PAINT, lightness


@dataclass(frozen=True)
class TransverseParameters:
    """Where stripes are looked for, and what counts; chosen on labelled stills and drawn pictures without a road."""

    # Distance ahead up to which stripes are counted.
    far_m: float = 30.0
    # Number of strips, and their distance from both lines, so that a line's own paint lies in none.
    strips: int = 5
    margin_m: float = 0.4
    # Distances, in rows, between a stripe and the road that it is compared with.
    reaches: tuple[int, ...] = (2, 3, 4)
    # Smallest contrast of a stripe, relative to the mean step from cell to cell in the lane.
    min_contrast: float = 2.0
    # Lightness of the lines: this quantile of their cells, because broken lines have gaps. A stripe is lighter than the
    # road by at least this share of the difference between lines and road.
    line_quantile: float = 0.8
    min_share: float = 0.35


TRANSVERSE = TransverseParameters()


def count_transverse_stripes(view_image: np.ndarray, view: BirdsEyeView, lines_y_m: np.ndarray) -> int:
    """Number of light stripes across the lane.

    Parameters
    ----------
    view_image : ndarray (rows, columns, 3), uint8
        Picture of the view, from `BirdsEyeView.warp`.
    view : BirdsEyeView
    lines_y_m : ndarray (2, rows)
        Lateral positions of the left and the right line in the rows of the view; NaN where a line does not pass.
    """
    near = view.x_m < TRANSVERSE.far_m
    light, seen = lightness(view_image)[near].astype(float), view.seen[near]
    columns = _strip_columns(lines_y_m[:, near], view)
    strips = _strip_means(light, seen, columns)
    inside = seen & (np.arange(len(view.y_m)) >= columns[:, :1]) & (np.arange(len(view.y_m)) < columns[:, -1:])
    steps = inside[:, 1:] & inside[:, :-1]
    line_light = _line_lightness(light, seen, lines_y_m[:, near], view)
    if not steps.any() or line_light is None:
        return 0
    road_light = float(np.median(light[inside]))
    noise = float(np.abs(np.diff(light))[steps].mean()) + PAINT.noise_floor
    contrast = np.max([_contrast(strips, reach) for reach in TRANSVERSE.reaches], axis=0)
    contrast[~(strips.min(axis=0) - road_light >= TRANSVERSE.min_share * (line_light - road_light))] = 0
    peak = (contrast[1:-1] > contrast[:-2]) & (contrast[1:-1] >= contrast[2:])
    return int((peak & (contrast[1:-1] > TRANSVERSE.min_contrast * noise)).sum())


def _strip_columns(lines_y_m: np.ndarray, view: BirdsEyeView) -> np.ndarray:
    """First columns (rows, strips + 1) of the strips, and the end of the last one; all 0 where a line does not pass."""
    left, right = lines_y_m + np.array([[-1], [1]]) * TRANSVERSE.margin_m
    edges_m = left[:, None] + (right - left)[:, None] * np.linspace(0, 1, TRANSVERSE.strips + 1)
    columns = np.nan_to_num((view.y_m[0] - edges_m) / view.cell_m)
    return np.clip(np.rint(columns), 0, len(view.y_m)).astype(int)


def _strip_means(light: np.ndarray, seen: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Mean (strips, rows) of the cells of each strip; NaN where one is outside the picture, or where there is none."""
    sums, seen_sums = (np.pad(np.cumsum(cells, axis=1), ((0, 0), (1, 0))) for cells in (light, seen))
    total, count = (np.diff(np.take_along_axis(s, columns, axis=1), axis=1).T for s in (sums, seen_sums))
    width = np.diff(columns, axis=1).T
    return np.where((count == width) & (width > 0), total / np.maximum(width, 1), np.nan)


def _line_lightness(light: np.ndarray, seen: np.ndarray, lines_y_m: np.ndarray, view: BirdsEyeView) -> float | None:
    """Lightness of the paint of both lines (2, rows) in grey levels; None if no cell of them is in the picture."""
    column = np.rint((view.y_m[0] - lines_y_m) / view.cell_m)
    line, row = np.nonzero((column >= 0) & (column < len(view.y_m)))
    column = column[line, row].astype(int)
    cells = light[row, column][seen[row, column]]
    return float(np.quantile(cells, TRANSVERSE.line_quantile)) if len(cells) else None


def _contrast(strips: np.ndarray, reach: int) -> np.ndarray:
    """Contrast (rows,) of each row: the smallest of the strips (strips, rows); 0 where it is not known."""
    contrast = np.zeros(strips.shape[1])
    middle, behind, before = strips[:, reach:-reach], strips[:, : -2 * reach], strips[:, 2 * reach :]
    contrast[reach:-reach] = np.nan_to_num((middle - np.maximum(behind, before)).min(axis=0))
    return contrast
