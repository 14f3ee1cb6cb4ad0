"""Rates the mask of exercise 5.1, and finds out why it is wrong."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from course.measures import STEPS_M, compare_markings
from helpers import FourPointWarp, binary_pixels, birdseye_to_road, metres_per_pixel
from lanes.camera import Camera

# Length of a dash, width of a line, and a width that only other shapes have, metres.
DASH_M, LINE_M, WIDE_M = 3.05, 0.13, 0.3


@dataclass(frozen=True, eq=False)
class PaintRating:
    """Precision, recall, recall of each line, masks (height, width) of the set pixels, missed pieces (2, 2) of lines.

    The masks are disjoint: pixels on a line, beside it, and those that do not count for the precision.
    """

    precision: float
    recall: float
    each_recall: np.ndarray
    on_line: np.ndarray
    beside: np.ndarray
    not_counted: np.ndarray
    missed_px: list[np.ndarray]

    def __str__(self) -> str:
        return f"precision {self.precision:.0%}, recall {self.recall:.0%}"


def rate_paint(mask: np.ndarray, warp: FourPointWarp, camera: Camera, truth: dict) -> PaintRating:
    """The rating of a mask (height, width), uint8 or bool, of a bird's-eye view."""
    pixels = binary_pixels((mask > 0).astype(np.uint8))
    counted, on_lines, covered = compare_markings(birdseye_to_road(pixels, warp, camera), truth)
    close: np.ndarray = np.logical_or(*on_lines)
    masks = np.zeros((3, *mask.shape), bool)
    for drawn, chosen in zip(masks, (counted & close, counted & ~close, ~counted), strict=True):
        drawn[pixels[chosen, 1], pixels[chosen, 0]] = True
    missed_px = []
    for key, steps in zip(("left_y_m", "right_y_m"), covered, strict=True):
        line_m = np.column_stack([STEPS_M, np.interp(STEPS_M, truth["x_m"], truth[key])])
        line_px = warp.points_to_birdseye(camera.undistort_points(camera.road_to_pixels(line_m)))
        missed_px += [line_px[k : k + 2] for k in np.flatnonzero(~steps)]
    precision = float(close[counted].mean()) if counted.any() else 0.0
    on_line, beside, not_counted = masks
    each_recall = covered.mean(axis=1)
    return PaintRating(precision, each_recall.mean(), each_recall, on_line, beside, not_counted, missed_px)


def explain_wrong(rating: PaintRating, warp: FourPointWarp, camera: Camera) -> str:
    """What kind of shapes the pixels beside the lines are."""
    across_m, _ = metres_per_pixel(warp, camera)
    beside = rating.beside.astype(np.uint8)
    wide = cv2.morphologyEx(beside, cv2.MORPH_OPEN, np.ones((1, round(WIDE_M / across_m)), np.uint8))
    if 2 * wide.sum() > beside.sum():
        return (
            f"Most of the red shapes are wider than a line, which has about {round(LINE_M / across_m, -1):.0f} columns."
        )
    return "Most of the red shapes are as narrow as a line. But are they as long as a dash?"


def explain_missing(rating: PaintRating, warp: FourPointWarp, camera: Camera) -> str:
    """Which line is missing, and why that happens."""
    across_m, along_m = metres_per_pixel(warp, camera)
    yellow, white = rating.each_recall
    if yellow < 0.8:
        return f"Of the solid yellow line it finds only {yellow:.0%}. A line has about {_columns(across_m)} columns."
    return (
        f"Of the white dashes it finds too little ({white:.0%} of their line). Is a threshold too high? Or an opening "
        f"too long? A dash has {DASH_M / along_m:.0f} rows, but it leans, so that each of its columns is shorter."
    )


def _columns(across_m: float) -> int:
    """The width of a line in columns, in tens."""
    return int(round(LINE_M / across_m, -1))
