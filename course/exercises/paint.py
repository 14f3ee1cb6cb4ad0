"""Rates the mask of exercise 5.1, and finds out why it is wrong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from course.measures import FAR_M, NEAR_M, marking_precision, marking_recall
from helpers import FourPointWarp, binary_pixels, birdseye_to_road, metres_per_pixel
from lanes.camera import Camera

MakeMask = Callable[[np.ndarray], "np.ndarray | None"]

# The margins of `marking_precision`, and the steps of `marking_recall`, metres.
MARGIN_M, TOLERANCE_M, STEP_M = 1.0, 0.2, 0.5
# Length of a dash, width of a line, and a width that only other shapes have, metres.
DASH_M, LINE_M, WIDE_M = 3.05, 0.13, 0.3
# Gray levels of the probe, and the columns by which its leaning dash moves in a row: those of test5 lean as much.
ROAD_LEVEL, PAINT_LEVEL, LEAN = 70, 200, 0.5


@dataclass(frozen=True, eq=False)
class PaintRating:
    """Precision, recall, recall of each line, masks (height, width) of the set pixels, missed pieces (2, 2) of lines.

    The masks are disjoint: pixels on a line, beside it, and those that do not count for the precision.
    """

    precision: float
    recall: float
    each_recall: list[float]
    on_line: np.ndarray
    beside: np.ndarray
    not_counted: np.ndarray
    missed_px: list[np.ndarray]


def rate_paint(mask: np.ndarray, warp: FourPointWarp, camera: Camera, truth: dict) -> PaintRating:
    """The rating of a mask (height, width), uint8 or bool, of a bird's-eye view."""
    pixels = binary_pixels((mask > 0).astype(np.uint8))
    points_m = birdseye_to_road(pixels, warp, camera)
    x, y = points_m.T
    left_m, right_m = (y - np.interp(x, truth["x_m"], truth[key]) for key in ("left_y_m", "right_y_m"))
    counted = (x >= NEAR_M) & (x <= FAR_M) & (left_m < MARGIN_M) & (right_m > -MARGIN_M)
    close = np.minimum(np.abs(left_m), np.abs(right_m)) <= TOLERANCE_M
    on_line, beside, not_counted = (np.zeros(mask.shape, bool) for _ in range(3))
    for drawn, chosen in ((on_line, counted & close), (beside, counted & ~close), (not_counted, ~counted)):
        drawn[pixels[chosen, 1], pixels[chosen, 0]] = True
    edges_m = np.arange(NEAR_M, FAR_M + 0.1, STEP_M)
    each_recall, missed_px = [], []
    for key, from_line_m in (("left_y_m", left_m), ("right_y_m", right_m)):
        missed = np.histogram(x[np.abs(from_line_m) <= TOLERANCE_M], edges_m)[0] == 0
        each_recall.append(1 - float(missed.mean()))
        line_m = np.column_stack([edges_m, np.interp(edges_m, truth["x_m"], truth[key])])
        line_px = warp.points_to_birdseye(camera.undistort_points(camera.road_to_pixels(line_m)))
        missed_px += [line_px[k : k + 2] for k in np.flatnonzero(missed)]
    precision, recall = marking_precision(points_m, truth) or 0.0, marking_recall(points_m, truth) or 0.0
    return PaintRating(precision, recall, each_recall, on_line, beside, not_counted, missed_px)


def explain_wrong(rating: PaintRating, warp: FourPointWarp, camera: Camera) -> str:
    """What kind of shapes the pixels beside the lines are."""
    across_m, _ = metres_per_pixel(warp, camera)
    beside = rating.beside.astype(np.uint8)
    wide = cv2.morphologyEx(beside, cv2.MORPH_OPEN, np.ones((1, round(WIDE_M / across_m)), np.uint8))
    if 2 * wide.sum() > beside.sum():
        return f"Most of the red shapes are wider than a line, which has about {_tens(LINE_M / across_m)} columns."
    return "Most of the red shapes are as narrow as a line. But are they as long as a dash?"


def explain_missing(rating: PaintRating, make_mask: MakeMask, warp: FourPointWarp, camera: Camera) -> str:
    """Why a line is missing: tried on a picture of white lines of other lengths."""
    across_m, along_m = metres_per_pixel(warp, camera)
    yellow, white = rating.each_recall
    if yellow < 0.8:
        columns = _tens(LINE_M / across_m)
        return f"Of the solid yellow line it finds only {yellow:.0%}. A line has about {columns} columns."
    long, dash, leaning = _probe(make_mask, warp, camera)
    rows = round(DASH_M / along_m)
    if not long:
        return "White paint on a gray road is not found. It is brighter, and 30 columns wide: is a kernel narrower?"
    if not dash:
        return f"The white dashes are cut away: a dash has {rows} rows, and an opening that is longer removes it."
    if not leaning:
        return (
            f"The white dashes are cut away: a dash has {rows} rows, but it leans, so that each of its columns is "
            "shorter. Use a shorter opening."
        )
    return f"Of the white dashes it finds too little ({white:.0%} of their line): is a threshold too high?"


def _tens(number: float) -> int:
    return int(round(number, -1))


def _probe(make_mask: MakeMask, warp: FourPointWarp, camera: Camera) -> list[bool]:
    """Whether a mask keeps a long white line, an upright dash, and a leaning dash on a gray road."""
    width, height = warp.size
    across_m, along_m = metres_per_pixel(warp, camera)
    rows, columns = np.indices((height, width))
    from_middle = rows - height / 2
    dash = np.abs(from_middle) <= DASH_M / along_m / 2
    half_px = LINE_M / across_m / 2
    marks = [
        np.abs(columns - 0.25 * width) <= half_px,
        (np.abs(columns - 0.5 * width) <= half_px) & dash,
        (np.abs(columns - 0.75 * width + LEAN * from_middle) <= half_px) & dash,
    ]
    picture = np.where(np.any(marks, axis=0), PAINT_LEVEL, ROAD_LEVEL).astype(np.uint8)
    mask = make_mask(np.repeat(picture[..., None], 3, axis=2))
    return [mask is not None and bool(np.mean(mask[mark] > 0) > 0.3) for mark in marks]
