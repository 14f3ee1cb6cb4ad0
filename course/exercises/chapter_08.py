"""Exercises of chapter 8, draw the lane back."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from course.exercises.verdict import Verdict, correct, hint
from lanes.camera import Camera

# 8.1: distance of the bar, and how far its ends may be off.
BAR_AT_M, TOLERANCE_PX = 7.0, 2.0


def check_bar(bar_px: np.ndarray, *, left: Sequence[float], right: Sequence[float], camera: Camera) -> Verdict:
    """8.1: raw pixels (2, 2) of the ends of a bar across the lane; lines are (c2 / 2, c1, c0) in metres."""
    if np.shape(bar_px) != (2, 2):
        return hint(f"give two points (column, row), an array of shape (2, 2); yours has shape {np.shape(bar_px)}.")
    ends_m = np.array([(BAR_AT_M, np.polyval(line, BAR_AT_M)) for line in (left, right)])
    true_px = camera.road_to_pixels(ends_m)

    def off_px(points_px: np.ndarray) -> float:
        return float(np.linalg.norm(np.asarray(bar_px, float) - points_px, axis=1).max())

    mistakes = {
        "the points are (row, column). OpenCV's order is (column, row).": true_px[:, ::-1],
        "you forgot the lens on the way back: these are undistorted pixels.": camera.undistort_points(true_px),
        "left and right are exchanged. y is positive to the left.": true_px[::-1],
        "the sign of y is wrong: it is positive to the left of the car.": camera.road_to_pixels(ends_m * [1, -1]),
    }
    if not off_px(true_px) <= TOLERANCE_PX:
        for sentence, wrong_px in mistakes.items():
            if off_px(wrong_px) <= TOLERANCE_PX:
                return hint(sentence)
        return hint(
            f"an end is {off_px(true_px):.0f} px off. The way: metres, view, undistorted image, through the lens."
        )
    return correct(f"both ends are within {max(off_px(true_px), 0.1):.1f} px.")


CHECKS = {"8.1": check_bar}
