"""Exercise of chapter 3, undistort the image."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from course.exercises.verdict import NOT_TRIED, Verdict, correct, hint
from lanes.camera import Camera

# A lens that is not that of the course; its tangential terms move a pixel by up to 9 px.
MATRIX = np.array([[900.0, 0, 655], [0, 880, 370], [0, 0, 1]])
DISTORTION = np.array([-0.25, 0.06, 0.004, -0.006, -0.008])
LENS = Camera(1280, 720, MATRIX, DISTORTION)
# The number of pixels that the check undistorts, and how far an answer may be off.
PIXELS, TOLERANCE_PX = 12, 0.01
# Wrong coefficients, as the coefficients k1, k2, p1, p2, k3 with which they would be right.
MISTAKES = {
    "the order of the five numbers is k1, k2, p1, p2, k3.": DISTORTION[[0, 1, 3, 4, 2]],
    "p1 and p2 are exchanged.": DISTORTION[[0, 1, 3, 2, 4]],
    "the tangential terms have the wrong sign: subtract them from x_d and y_d.": DISTORTION * [1, 1, -1, -1, 1],
    "the tangential terms, those with p1 and p2, are missing.": DISTORTION * [1, 1, 0, 0, 1],
}


def check_undistort_pixel(undistort_pixel: Callable[..., Any]) -> Verdict:
    """3.1: the undistorted pixel of a raw pixel, by fixed-point iteration."""
    centre_px = MATRIX[:2, 2]
    centre = undistort_pixel(*centre_px, MATRIX.copy(), DISTORTION.copy())
    if centre is None:
        return NOT_TRIED
    if np.shape(centre) != (2,):
        return hint("return two numbers, the column and the row.")
    if not _off_px(np.array(centre), centre_px) <= TOLERANCE_PX:
        return hint(
            "the principal point must stay where it is. Subtract c_x and c_y before you divide by f_x and f_y, and add "
            "them at the end."
        )
    true_px = np.random.default_rng(3).uniform((150, 100), (1130, 620), (PIXELS, 2))
    raw_px = LENS.distort_points(true_px)
    found_px = np.array([undistort_pixel(*pixel, MATRIX.copy(), DISTORTION.copy()) for pixel in raw_px], float)
    if _off_px(found_px, true_px) <= TOLERANCE_PX:
        return correct(f"{PIXELS} pixels of another lens are off by less than {TOLERANCE_PX} px.")
    return hint(_explain_difference(found_px, raw_px, true_px))


def _explain_difference(found_px: np.ndarray, raw_px: np.ndarray, true_px: np.ndarray) -> str:
    """What is wrong with undistorted pixels (N, 2)."""
    for sentence, distortion in MISTAKES.items():
        wrong = Camera(*LENS.size, MATRIX, distortion)
        if _off_px(found_px, wrong.undistort_points(raw_px)) <= TOLERANCE_PX:
            return sentence
    if ((found_px - raw_px) * (true_px - raw_px)).sum() < 0:
        return (
            "the pixels move the wrong way, towards the centre. Divide by the radial factor, and keep x_d and y_d: "
            "only x, y and r change."
        )
    off_px, moved_px = _off_px(found_px, true_px), _off_px(raw_px, true_px)
    if off_px < moved_px / 2:
        return (
            f"the worst pixel is {off_px:.2f} px off, {moved_px:.0f} px before. Repeat until it no longer moves. If "
            "that does not help: subtract the tangential terms first, then divide, and take matrix and distortion from "
            "the arguments."
        )
    (u, v), (column, row), (true_u, true_v) = raw_px[0], found_px[0], true_px[0]
    return (
        f"raw pixel ({u:.1f}, {v:.1f}): yours is ({column:.1f}, {row:.1f}), true is ({true_u:.1f}, {true_v:.1f}). In "
        "each step x_d and y_d stay the same, x and y are those of the last step, and r^2 = x^2 + y^2."
    )


def _off_px(found_px: np.ndarray, true_px: np.ndarray) -> float:
    """The largest distance between two sets of pixels."""
    return float(np.linalg.norm(found_px - true_px, axis=-1).max())


CHECKS = {"3.1": check_undistort_pixel}
