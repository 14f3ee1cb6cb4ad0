"""Exercises of chapter 6, find the lines."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from classic.search import find_peaks, lane_histogram, sliding_windows
from classic.threshold import HlsSobelThresholds
from classic.warp import FourPointWarp, metres_per_pixel
from course.exercises.verdict import NOT_TRIED, Checks, Verdict, correct, hint
from lanes.camera import Camera

# The made line of exercise 6.2: size of the view, rows of its dashes (two windows of paint, two of gap), width.
VIEW_SHAPE = (720, 1280)
DASH_ROWS = ((560, 720), (240, 400), (0, 80))
LINE_WIDTH_PX = 25
# Columns that the line moves to the side from one window to the next; three windows are more than the margin of 80.
STEP_PX = 40
# Middle row of the lowest window, and a second line that must not be caught.
FIRST_CENTRE_ROW = 680
SECOND_LINE_COLUMNS = slice(1000, 1025)
LEAST_CAUGHT = 0.98


def check_lane_width(
    width_m: float, *, above: np.ndarray, warp: FourPointWarp, camera: Camera, truth: dict | None
) -> Verdict:
    """6.1: the width of the lane in metres, from the two histogram peaks of a bird's-eye view (height, width, 3)."""
    histogram = lane_histogram(HlsSobelThresholds().masks(above)["combined"])
    left, right = find_peaks(histogram)
    if left is None or right is None:
        return hint("the histogram of this picture has no peak on one side; take another picture.")
    columns = right - left
    if abs(width_m - columns) < 1:
        return hint(f"{width_m:.0f} is the distance in columns. Multiply by the metres per column of chapter 4.")
    if abs(width_m - columns * 3.7 / 700) < 0.01:
        return hint(f"{width_m:.2f} m. You used 3.7 m / 700 columns, which belongs to another warp (chapter 4).")
    widths = [columns, *_other_widths(histogram, left, right)]
    if not np.abs(np.array(widths) * metres_per_pixel(warp, camera)[0] - width_m).min() <= 0.02:
        return hint(
            f"{width_m:.2f} m. With all three masks of hls_sobel the peaks are {columns} columns apart; "
            "how many metres is one?"
        )
    return correct(f"{width_m:.2f} m" + (f" (truth {truth['lane_width_m']:.2f} m)." if truth else "."))


def _other_widths(histogram: np.ndarray, left: int, right: int) -> list[float]:
    """Columns between the peaks if several columns of a line are equally high: the first, middle or last of them."""
    middle = len(histogram) // 2
    of_left = np.flatnonzero(histogram[:middle] == histogram[left])
    of_right = middle + np.flatnonzero(histogram[middle:] == histogram[right])
    return [float(choose(of_right) - choose(of_left)) for choose in (np.min, np.mean, np.max)]


def check_coasting(climb: Callable[[np.ndarray, float], np.ndarray | None]) -> Verdict:
    """6.2: windows that move on by their last step, tried on two slanted lines with gaps of two windows."""
    for lean in ("left", "right"):
        line, binary, start = _slanted_line(lean)
        pixels = climb(binary.copy(), float(start))
        if pixels is None:
            return NOT_TRIED
        if (
            not isinstance(pixels, np.ndarray)
            or pixels.ndim != 2
            or pixels.shape[1] != 2
            or not _all_set(pixels, binary)
        ):
            return hint("the function returns the set pixels of the line, an array (N, 2) of (column, row).")
        caught = np.zeros_like(line)
        columns, rows = pixels.astype(int).T
        caught[rows, columns] = True
        share = np.count_nonzero(caught & line) / np.count_nonzero(line)
        straight_up = len(sliding_windows(binary).left_pixels) / np.count_nonzero(line)
        if (caught & ~line).any():
            return hint("the windows have also caught pixels of another line; keep their margin of 80 columns.")
        if share < LEAST_CAUGHT:
            return hint(
                f"{share:.0%} of the pixels of a dashed line that leans {lean} (straight up: {straight_up:.0%}). "
                "In a gap, add the last step, with its sign, to the column."
            )
    return correct(f"{share:.0%} of the pixels of a slanted dashed line (straight up: {straight_up:.0%}).")


def _all_set(pixels: np.ndarray, binary: np.ndarray) -> bool:
    """Whether all pixels (N, 2), (column, row), are set in a binary; not if rows and columns are exchanged."""
    columns, rows = pixels.astype(int).T
    inside = (columns >= 0) & (columns < binary.shape[1]) & (rows >= 0) & (rows < binary.shape[0])
    return bool(inside.all() and binary[rows, columns].all())


def _slanted_line(lean: str) -> tuple[np.ndarray, np.ndarray, int]:
    """A mask of a dashed line, a binary of it and a second line, and its column in the lowest window."""
    height, width = VIEW_SHAPE
    sign, start = (-1, 420) if lean == "left" else (1, 220)
    rows = np.arange(height)[:, None]
    distance = np.abs(np.arange(width) - (start + sign * STEP_PX * (FIRST_CENTRE_ROW - rows) / 80))
    dashes = np.any([(rows >= first) & (rows < end) for first, end in DASH_ROWS], axis=0)
    line = (distance <= LINE_WIDTH_PX / 2) & dashes
    other = np.zeros_like(line)
    other[:, SECOND_LINE_COLUMNS] = True
    return line, np.where(line | other, 255, 0).astype(np.uint8), start


CHECKS: Checks = {"6.1": check_lane_width, "6.2": check_coasting}
