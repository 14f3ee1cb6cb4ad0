"""Exercises of chapters 1 to 4: a ruler, the calibration of a camera, its lens, and the
road from above.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import cv2
import numpy as np

from course.exercises.hints import (
    HintError,
    require,
    require_equal,
    require_shape,
    tried,
)
from course.measures import lane_widths_px
from helpers import (
    FourPointWarp,
    Lens,
    distort_points,
    metres_per_pixel,
    road_to_pixels,
    undistort_points,
)


def check_best_ruler(worst_px: float, *, rows: np.ndarray, columns: np.ndarray) -> str:
    """1.1: the largest distance of the paint from the least-squares line, pixels."""
    found = require_shape(worst_px, (), "one number is needed, the largest distance")
    require(
        found >= 0,
        f"{found:.1f} px is negative, but a distance is not. Take the absolute values "
        "before the largest one.",
    )
    line = np.polyfit(rows, columns, 1)
    misses = np.polyval(line, rows) - columns
    worst = np.abs(misses).max()
    one_side = min(misses.max(), -misses.min())
    row_line = np.polyfit(columns, rows, 1)
    swapped = np.abs(np.polyval(row_line, columns) - rows).max()

    require(
        found != round(worst), f"{found:.0f} px is rounded. Give one decimal or more."
    )
    mistakes = {
        "is a mean of the distances. Take the largest one.": np.abs(misses).mean(),
        "is the largest distance on one side only. Take the absolute values first.": (
            one_side
        ),
        "belongs to the row as a function of the column. Swap the first two arguments "
        "of np.polyfit.": swapped,
    }
    otherwise = (
        "is not it. Fit all rows of paint_rows, not only the near ones, and compare "
        "the line with paint_columns in each row."
    )
    if 0 < found < worst:
        otherwise = (
            "is less than the line of least squares is off. Its largest distance is "
            "not the smallest possible one; here take least squares all the same, as "
            "np.polyfit does."
        )
    require_equal(found, worst, mistakes, otherwise, said=f"{found:.1f} px ", atol=0.05)
    return f"even this ruler is {worst:.1f} px off."


def check_board_errors(
    errors_px: Sequence[float],
    *,
    rotations: Sequence[np.ndarray],
    translations: Sequence[np.ndarray],
    seen: Sequence[np.ndarray],
    board: np.ndarray,
    matrix: np.ndarray,
    distortion: np.ndarray,
) -> str:
    """2.1: the RMS reprojection error of each board, pixels.

    `rotations`, `translations`, `matrix` and `distortion` are results of
    `cv2.calibrateCamera`, `board` (N, 3) the corners on the board, `seen` those in each
    image.
    """
    what = f"{len(seen)} numbers are needed, one for each board"
    errors = require_shape(errors_px, (len(seen),), what)
    require(
        np.ptp(errors) > 0,
        "all boards have the same error. Each board has its own; the RMS of the "
        "calibration is over all boards.",
    )

    rms_px = []
    for rotation, translation, corners in zip(
        rotations, translations, seen, strict=True
    ):
        projected, _ = cv2.projectPoints(
            board, rotation, translation, matrix, distortion
        )
        off_px = projected.reshape(-1, 2) - np.reshape(corners, (-1, 2))
        squared = (off_px**2).sum(axis=1)
        rms_px.append(np.sqrt(squared.mean()))
    true = np.array(rms_px)

    count = len(board)
    mistakes = {
        f"your errors are too small by sqrt({count}). You divided the norm by the "
        "number of corners, as OpenCV's tutorial does; divide the sum of squares, then "
        "take the root.": true / np.sqrt(count),
        "your errors are too small by sqrt(2). Sum the squares of du and dv, then "
        "average over the corners.": true / np.sqrt(2),
    }
    require_equal(errors, true, mistakes, explain_errors(errors, true), rtol=1e-3)
    return (
        f"the boards have {errors.min():.2f} to {errors.max():.2f} px (median "
        f"{np.median(errors):.2f} px)."
    )


def explain_errors(errors: np.ndarray, true: np.ndarray) -> str:
    """What may be wrong with the errors of boards (N,), pixels."""
    if errors.mean() > 20 * true.mean():
        return (
            f"{errors.mean():.0f} px is too large. Detected and projected corners have "
            "other shapes: reshape both to (-1, 2) before you subtract. Pass rotation "
            "and translation in this order."
        )
    worst = int(np.abs(errors - true).argmax())
    return (
        f"board {worst + 1} has {true[worst]:.3f} px, not {errors[worst]:.3f} px. Is "
        "the order that of seen_corners? RMS is the root of the mean of the squared "
        "distances."
    )


# 3.1: a lens that is not that of the course; its tangential terms move a pixel by up to
# 9 px.
MATRIX = np.array([[900.0, 0, 655], [0, 880, 370], [0, 0, 1]])
DISTORTION = np.array([-0.25, 0.06, 0.004, -0.006, -0.008])
SIZE = (1280, 720)
# Wrong coefficients, as the coefficients k1, k2, p1, p2, k3 with which they would be
# right.
WRONG_DISTORTIONS = {
    "the order of the five numbers is k1, k2, p1, p2, k3.": (
        DISTORTION[[0, 1, 3, 4, 2]]
    ),
    "p1 and p2 are exchanged.": DISTORTION[[0, 1, 3, 2, 4]],
    "the tangential terms have the wrong sign: subtract them from x_d and y_d.": (
        DISTORTION * [1, 1, -1, -1, 1]
    ),
    "the tangential terms, those with p1 and p2, are missing.": (
        DISTORTION * [1, 1, 0, 0, 1]
    ),
}
# The number of pixels that the check undistorts, and how far an answer may be off.
PIXELS = 12
LENS_TOLERANCE_PX = 0.01


def check_undistort_pixel(undistort_pixel: Callable[..., Any]) -> str:
    """3.1: the undistorted pixel of a raw pixel, by fixed-point iteration."""
    principal_point = MATRIX[:2, 2]
    centre = undistorted_by(undistort_pixel, principal_point)
    require(
        np.abs(centre - principal_point).max() <= LENS_TOLERANCE_PX,
        "the principal point must stay where it is. Subtract c_x and c_y before you "
        "divide by f_x and f_y, and add them at the end.",
    )

    random = np.random.default_rng(3)
    true_px = random.uniform((150, 100), (1130, 620), (PIXELS, 2))
    raw_px = distort_points(true_px, Lens(MATRIX, DISTORTION, SIZE))
    found_px = np.array([undistorted_by(undistort_pixel, pixel) for pixel in raw_px])
    mistakes = {}
    for sentence, wrong in WRONG_DISTORTIONS.items():
        mistakes[sentence] = undistort_points(raw_px, Lens(MATRIX, wrong, SIZE))
    otherwise = explain_undistorted(found_px, raw_px, true_px)
    require_equal(found_px, true_px, mistakes, otherwise, atol=LENS_TOLERANCE_PX)
    return (
        f"{PIXELS} pixels of another lens are off by less than {LENS_TOLERANCE_PX} px."
    )


def undistorted_by(
    undistort_pixel: Callable[..., Any], pixel: np.ndarray
) -> np.ndarray:
    """The answer (2,) of the reader's function for a raw pixel of the other lens."""
    u, v = pixel.tolist()
    answer = tried(undistort_pixel(u, v, MATRIX.copy(), DISTORTION.copy()))
    found = require_shape(answer, (2,), "return two numbers, the column and the row")
    require(
        np.isfinite(found).all(),
        "the result is not a number (NaN, or infinite). Does the iteration diverge? "
        "Divide by the radial factor, keep x_d and y_d, and compute r^2 from the x and "
        "y of the last step.",
    )
    return found


def explain_undistorted(
    found_px: np.ndarray, raw_px: np.ndarray, true_px: np.ndarray
) -> str:
    """What may be wrong with undistorted pixels (N, 2)."""
    moved = found_px - raw_px
    should_move = true_px - raw_px
    if (moved * should_move).sum() < 0:
        return (
            "the pixels move the wrong way, towards the centre. Divide by the radial "
            "factor, and keep x_d and y_d: only x, y and r change."
        )
    off_px = np.linalg.norm(found_px - true_px, axis=1).max()
    before_px = np.linalg.norm(should_move, axis=1).max()
    if off_px < before_px / 2:
        return (
            f"the worst pixel is {off_px:.2f} px off, {before_px:.0f} px before. "
            "Repeat until it no longer moves. If that does not help: subtract the "
            "tangential terms first, then divide, and take matrix and distortion from "
            "the arguments."
        )
    u, v = raw_px[0]
    column, row = found_px[0]
    true_u, true_v = true_px[0]
    return (
        f"raw pixel ({u:.1f}, {v:.1f}): yours is ({column:.1f}, {row:.1f}), true is "
        f"({true_u:.1f}, {true_v:.1f}). In each step x_d and y_d stay the same, x and "
        "y are those of the last step, and r^2 = x^2 + y^2."
    )


# 4.1: distances at which the lane is measured, metres, and the largest error of its
# width.
MEASURED_AT_M = (7.0, 15.0, 30.0)
WIDTH_TOLERANCE_M = 0.05
# Fewest rows of the image that the quadrangle must span: those from 7 to 30 m ahead are
# more than 100.
LEAST_ROWS = 100
# Two points of the road, the second one farther ahead, metres.
AHEAD_M = np.array([[10.0, 0.0], [20.0, 0.0]])


def check_four_points(
    source_px: np.ndarray,
    *,
    destination_px: np.ndarray,
    image_to_road: np.ndarray,
    lines_m: Sequence[Sequence[float]],
) -> str:
    """4.1: four points such that a straight lane is equally wide at all distances.

    Parameters
    ----------
    image_to_road : ndarray of shape (3, 3)
        Homography of `helpers.road_homography`.
    lines_m : array_like of shape (2, 2)
        Lateral position at the car, metres, and heading, of the left and right line.
    """
    what = "four points (column, row) are needed, an array (4, 2)"
    points = require_shape(source_px, (4, 2), what)
    rows = points[:, 1]
    require(
        (rows < SIZE[1]).all(),
        "a point lies below the image. Is the order (column, row)?",
    )
    require(
        np.ptp(rows) >= LEAST_ROWS,
        f"your quadrangle has only {np.ptp(rows):.0f} rows of the image, so the view "
        "shows a strip of the road. Choose a far and a near edge.",
    )
    try:
        warp = FourPointWarp(points, destination_px, SIZE)
    except ValueError:
        raise HintError(
            "the edges cross. Give the points in the order of destination_px, around "
            "the quadrangle."
        ) from None

    across_m, _ = metres_per_pixel(warp, image_to_road)
    widths_px = lane_widths_px(warp, image_to_road, lines_m, MEASURED_AT_M)
    widths = widths_px * across_m
    ahead_px = road_to_pixels(AHEAD_M, image_to_road)
    near, far = warp.points_to_birdseye(ahead_px)
    is_upright = (widths > 1).all() and far[1] < near[1]
    require(
        np.isfinite(widths).all() and is_upright,
        "the view is mirrored, turned or upside down. The order is that of "
        "destination_px: far left, far right, near right, near left.",
    )

    true_m = lines_m[0][0] - lines_m[1][0]
    text = ", ".join(f"{width:.2f}" for width in widths)
    require_equal(
        widths,
        [true_m] * 3,
        {},
        explain_widths(widths, true_m),
        said=f"the lane is {text} m wide",
        atol=WIDTH_TOLERANCE_M,
    )
    return f"the lane is {text} m wide at 7, 15 and 30 m (true {true_m:.2f} m)."


def explain_widths(widths_m: np.ndarray, true_m: float) -> str:
    """What may be wrong with the widths of a lane at growing distances."""
    if np.ptp(widths_m) <= WIDTH_TOLERANCE_M:
        return f", the true one {true_m:.2f} m. Is the lower edge parallel to the axle?"
    becomes = "narrower" if widths_m[-1] < widths_m[0] else "wider"
    return (
        f" at 7, 15 and 30 m: it becomes {becomes} with the distance. The left and "
        "right edges of your quadrangle must be parallel on the road; the lines of the "
        "lane are."
    )
