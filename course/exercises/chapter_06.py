"""Exercises of chapter 6, find the lines."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from course.exercises.drawings import draw_caught
from course.exercises.verdict import NOT_TRIED, Checks, Verdict, correct, find_mistake, hint
from helpers import FourPointWarp, find_peaks, lane_histogram, metres_per_pixel
from lanes.camera import Camera

LaneWidth = Callable[[np.ndarray], "float | None"]
Climb = Callable[[np.ndarray, float], "np.ndarray | None"]

# Columns of the lines that exercise 6.1 draws, as shares of the width: a lane of 2.8 m, left of the centre.
DRAWN_LINES = (0.2, 0.65)
# Lines in the upper half of its rows, which are longer: they do not count.
DRAWN_ABOVE = (0.3, 0.85)
# The drawn lines: size of the view, rows of the dashes (two windows of paint, two of gap), width.
VIEW_SHAPE = (720, 1280)
DASH_ROWS = ((560, 720), (240, 400), (0, 80))
LINE_WIDTH_PX = 25
# Columns that the line of 6.2 moves from one window to the next; three windows are more than the margin of 80.
STEP_PX = 40
# Middle row of the lowest window, and the distance of a second line that must not be caught, on the side to which the
# lines lean: within a wider margin, and never within that of windows that go straight up in a gap.
FIRST_CENTRE_ROW, SECOND_LINE_PX = 680, 150
LEAST_CAUGHT = 0.98


def check_lane_width(
    lane_width: LaneWidth, *, binary: np.ndarray, warp: FourPointWarp, camera: Camera, truth: dict | None
) -> Verdict:
    """6.1: the width of the lane in metres, from the two histogram peaks of a binary of a bird's-eye view."""
    drawn = np.zeros_like(binary)
    half, columns = len(binary) // 2, binary.shape[1]
    for rows, shares in ((slice(half), DRAWN_ABOVE), (slice(half, -half // 5), DRAWN_LINES)):
        for share in shares:
            drawn[rows, round(share * columns) :][:, :LINE_WIDTH_PX] = 255
    widths_m = lane_width(binary.copy()), lane_width(drawn.copy())
    if widths_m[0] is None:
        return NOT_TRIED
    width_m, drawn_m = (np.nan if width_m is None or np.ndim(width_m) else float(width_m) for width_m in widths_m)
    if not np.isfinite([width_m, drawn_m]).all():
        return hint("return one number for each binary, the width in metres; NaN is none.")
    if abs(width_m - drawn_m) < 0.005:
        return hint(f"{width_m:.2f} m, and the same for a narrower lane. Compute it from the argument `binary`.")
    across_m = metres_per_pixel(warp, camera)[0]
    for name, mask, found_m in (("this lane", binary, width_m), ("a drawn, narrower lane", drawn, drawn_m)):
        if problem := _width_problem(found_m, lane_histogram(mask), across_m):
            return hint(f"{found_m:.2f} m for {name}. {problem}")
    truth_text = f" (truth {truth['lane_width_m']:.2f} m)" if truth else ""
    return correct(f"{width_m:.2f} m{truth_text}, and {drawn_m:.2f} m for a drawn, narrower lane.")


def _width_problem(width_m: float, histogram: np.ndarray, across_m: float) -> str | None:
    """The mistake in a width, or None. Several columns of a line can be equally high: each of them is accepted."""
    left, right = find_peaks(histogram)
    if left is None or right is None:
        return "The histogram has no peak on one side; take another picture."
    middle, columns = len(histogram) // 2, float(right - left)
    of_left = np.flatnonzero(histogram[:middle] == histogram[left])
    of_right = middle + np.flatnonzero(histogram[middle:] == histogram[right])
    of_any = [columns, *(float(choose(of_right) - choose(of_left)) for choose in (np.min, np.mean, np.max))]
    if np.abs(np.array(of_any) * across_m - width_m).min() <= 0.02:
        return None
    mistakes = {
        "This is the distance in columns. Multiply by the metres per column of chapter 4.": columns,
        "The sign is wrong: columns grow to the right, so take right minus left.": -columns * across_m,
        "You used 3.7 m / 700 columns, which belongs to another warp (chapter 4).": columns * 3.7 / 700,
    }
    if mistake := find_mistake(width_m, mistakes, rtol=0.005):
        return mistake
    return f"In its lower half of rows the peaks are {columns:.0f} columns apart; how many metres is one?"


def check_coasting(climb: Climb) -> Verdict:
    """6.2: windows that move on by their last step, tried on two slanted lines with gaps of two windows."""
    panels: dict[str, tuple[np.ndarray, ...]] = {}
    for lean in ("left", "right"):
        line, binary, start = _slanted_line(lean)
        pixels = climb(binary.copy(), float(start))
        if pixels is None:
            return NOT_TRIED
        caught = _caught(pixels, binary)
        if caught is None:
            return hint("the function returns the set pixels of the line, an array (N, 2) of (column, row).")
        share = np.count_nonzero(caught & line) / np.count_nonzero(line)
        reached = f"{share:.0%} of the pixels of a dashed line that leans {lean}"
        panel = {f"Leans {lean}: {share:.0%} caught": (line, binary > 0, caught)}
        if (caught & ~line).any() or share < LEAST_CAUGHT:
            draw_caught(panel)
            if (caught & ~line).any():
                return hint("the windows have also caught pixels of another line; keep their margin of 80 columns.")
            return hint(f"{reached}. In a gap, add the last step, with its sign, to the column.")
        panels |= panel
    draw_caught(panels)
    return correct(f"{reached}.")


def _caught(pixels: np.ndarray, binary: np.ndarray) -> np.ndarray | None:
    """A mask of pixels (N, 2), (column, row); None if one is not set, as when rows and columns are exchanged."""
    if np.ndim(pixels) != 2 or np.shape(pixels)[1] != 2:
        return None
    columns, rows = np.asarray(pixels).astype(int).T
    inside = (columns >= 0) & (columns < binary.shape[1]) & (rows >= 0) & (rows < binary.shape[0])
    if not inside.all() or not binary[rows, columns].all():
        return None
    caught = np.zeros(binary.shape, bool)
    caught[rows, columns] = True
    return caught


def _slanted_line(lean: str) -> tuple[np.ndarray, np.ndarray, int]:
    """A mask of a dashed line, a binary of it and a second line, and its column in the lowest window."""
    height, width = VIEW_SHAPE
    sign, start = (-1, 420) if lean == "left" else (1, 220)
    rows = np.arange(height)[:, None]
    from_line_px = np.arange(width) - (start + sign * STEP_PX * (FIRST_CENTRE_ROW - rows) / 80)
    dashes = np.any([(rows >= first) & (rows < end) for first, end in DASH_ROWS], axis=0)
    line = (np.abs(from_line_px) <= LINE_WIDTH_PX / 2) & dashes
    other = np.abs(from_line_px - sign * SECOND_LINE_PX) <= LINE_WIDTH_PX / 2
    return line, np.where(line | other, 255, 0).astype(np.uint8), start


CHECKS: Checks = {"6.1": check_lane_width, "6.2": check_coasting}
