"""Rates the mask of exercise 5.1, and finds out why it is wrong."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from course.measures import FAR_M, NEAR_M
from helpers import FourPointWarp, binary_pixels, birdseye_to_road, metres_per_pixel
from lanes.camera import Camera

# The margins of `marking_precision`, and the steps of `marking_recall`, metres.
MARGIN_M, TOLERANCE_M, STEP_M = 1.0, 0.2, 0.5
# Length of a dash, width of a line, and a width that only other shapes have, metres.
DASH_M, LINE_M, WIDE_M = 3.05, 0.13, 0.3


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
    x, y = birdseye_to_road(pixels, warp, camera).T
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
    precision = float(close[counted].mean()) if counted.any() else 0.0
    return PaintRating(precision, float(np.mean(each_recall)), each_recall, on_line, beside, not_counted, missed_px)


def explain_wrong(rating: PaintRating, warp: FourPointWarp, camera: Camera) -> str:
    """What kind of shapes the pixels beside the lines are."""
    across_m, _ = metres_per_pixel(warp, camera)
    beside = rating.beside.astype(np.uint8)
    wide = cv2.morphologyEx(beside, cv2.MORPH_OPEN, np.ones((1, round(WIDE_M / across_m)), np.uint8))
    if 2 * wide.sum() > beside.sum():
        return f"Most of the red shapes are wider than a line, which has about {_tens(LINE_M / across_m)} columns."
    return "Most of the red shapes are as narrow as a line. But are they as long as a dash?"


def explain_missing(rating: PaintRating, warp: FourPointWarp, camera: Camera) -> str:
    """Which line is missing, and why that happens."""
    across_m, along_m = metres_per_pixel(warp, camera)
    yellow, white = rating.each_recall
    if yellow < 0.8:
        columns = _tens(LINE_M / across_m)
        return f"Of the solid yellow line it finds only {yellow:.0%}. A line has about {columns} columns."
    return (
        f"Of the white dashes it finds too little ({white:.0%} of their line). Is a threshold too high? Or an opening "
        f"too long? A dash has {DASH_M / along_m:.0f} rows, but it leans, so that each of its columns is shorter."
    )


def _tens(number: float) -> int:
    return int(round(number, -1))
