"""Exercises of chapters 1 to 4: a ruler, the calibration of a camera, its lens, and the road from above."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import cv2
import numpy as np

from course.exercises.hints import HintError, require, require_equal, require_shape, tried
from course.measures import lane_widths_px
from helpers import FourPointWarp, metres_per_pixel
from lanes.camera.model import Camera


def check_best_ruler(worst_px: float, *, rows: np.ndarray, columns: np.ndarray) -> str:
    """1.1: the largest distance between the paint and the least-squares line through all of it, pixels."""
    found = require_shape(worst_px, (), "one number is needed, the largest distance")
    misses = np.polyval(np.polyfit(rows, columns, 1), rows) - columns
    swapped = np.abs(np.polyval(np.polyfit(columns, rows, 1), columns) - rows).max()
    worst = np.abs(misses).max()
    require(found != round(worst), f"{found:.0f} px is rounded. Give one decimal or more.")
    mistakes = {
        "is a mean of the distances. Take the largest one.": np.abs(misses).mean(),
        "is the largest distance on one side only. Take the absolute values first.": min(misses.max(), -misses.min()),
        "belongs to the row as a function of the column. Swap the first two arguments of np.polyfit.": swapped,
    }
    otherwise = (
        "is less than the line of least squares is off. Its largest distance is not the smallest possible one; here "
        "take least squares all the same, as np.polyfit does."
        if 0 < found < worst
        else "is not it. Fit all rows of paint_rows, not only the near ones, and compare the line with paint_columns "
        "in each row."
    )
    require_equal(abs(found), worst, mistakes, otherwise, said=f"{found:.1f} px ", atol=0.05)
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
    """2.1: the RMS reprojection error of each board, pixels, with the results of `cv2.calibrateCamera`.

    `board` (N, 3) are the corners on the board, `seen` those in each picture.
    """
    boards, corners = len(seen), len(board)
    errors = require_shape(errors_px, (boards,), f"{boards} numbers are needed, one for each board")
    same = "all boards have the same error. Each board has its own; the RMS of the calibration is over all boards."
    require(np.ptp(errors) > 0, same)
    poses = zip(rotations, translations, strict=True)
    projected = np.array([cv2.projectPoints(board, *pose, matrix, distortion)[0] for pose in poses])
    off_px = projected.reshape(boards, corners, 2) - np.reshape(seen, (boards, corners, 2))
    true = np.sqrt((off_px**2).sum(axis=2).mean(axis=1))
    mistakes = {
        f"your errors are too small by sqrt({corners}). You divided the norm by the number of corners, as OpenCV's "
        "tutorial does; divide the sum of squares, then take the root.": true / np.sqrt(corners),
        "your errors are too small by sqrt(2). Sum the squares of du and dv, then average over the corners.": true
        / np.sqrt(2),
    }
    worst = int(np.abs(errors - true).argmax())
    otherwise = (
        f"{errors.mean():.0f} px is too large. cv2.projectPoints returns ({corners}, 1, 2), the corners are "
        f"({corners}, 2); reshape before you subtract. Pass rotation and translation in this order."
        if errors.mean() > 20 * true.mean()
        else f"board {worst + 1} has {true[worst]:.3f} px, not {errors[worst]:.3f} px. Is the order that of "
        "image_points? RMS is the root of the mean of the squared distances."
    )
    require_equal(errors, true, mistakes, otherwise, rtol=1e-3)
    return f"the boards have {errors.min():.2f} to {errors.max():.2f} px (median {np.median(errors):.2f} px)."


# 3.1: a lens that is not that of the course; its tangential terms move a pixel by up to 9 px.
MATRIX = np.array([[900.0, 0, 655], [0, 880, 370], [0, 0, 1]])
DISTORTION = np.array([-0.25, 0.06, 0.004, -0.006, -0.008])
# Wrong coefficients, as the coefficients k1, k2, p1, p2, k3 with which they would be right.
WRONG_DISTORTIONS = {
    "the order of the five numbers is k1, k2, p1, p2, k3.": DISTORTION[[0, 1, 3, 4, 2]],
    "p1 and p2 are exchanged.": DISTORTION[[0, 1, 3, 2, 4]],
    "the tangential terms have the wrong sign: subtract them from x_d and y_d.": DISTORTION * [1, 1, -1, -1, 1],
    "the tangential terms, those with p1 and p2, are missing.": DISTORTION * [1, 1, 0, 0, 1],
}
# The number of pixels that the check undistorts, and how far an answer may be off.
PIXELS, LENS_TOLERANCE_PX = 12, 0.01


def check_undistort_pixel(undistort_pixel: Callable[..., Any]) -> str:
    """3.1: the undistorted pixel of a raw pixel, by fixed-point iteration."""

    def undistort(pixel: np.ndarray) -> np.ndarray:
        answer = tried(undistort_pixel(*pixel, MATRIX.copy(), DISTORTION.copy()))
        return require_shape(answer, (2,), "return two numbers, the column and the row")

    require(
        np.abs(undistort(MATRIX[:2, 2]) - MATRIX[:2, 2]).max() <= LENS_TOLERANCE_PX,
        "the principal point must stay where it is. Subtract c_x and c_y before you divide by f_x and f_y, and add "
        "them at the end.",
    )
    true_px = np.random.default_rng(3).uniform((150, 100), (1130, 620), (PIXELS, 2))
    raw_px = Camera(1280, 720, MATRIX, DISTORTION).distort_points(true_px)
    found_px = np.array([undistort(pixel) for pixel in raw_px])
    cameras = {sentence: Camera(1280, 720, MATRIX, wrong) for sentence, wrong in WRONG_DISTORTIONS.items()}
    mistakes = {sentence: camera.undistort_points(raw_px) for sentence, camera in cameras.items()}
    otherwise = _explain_undistorted(found_px, raw_px, true_px)
    require_equal(found_px, true_px, mistakes, otherwise, atol=LENS_TOLERANCE_PX)
    return f"{PIXELS} pixels of another lens are off by less than {LENS_TOLERANCE_PX} px."


def _explain_undistorted(found_px: np.ndarray, raw_px: np.ndarray, true_px: np.ndarray) -> str:
    """What may be wrong with undistorted pixels (N, 2)."""
    if ((found_px - raw_px) * (true_px - raw_px)).sum() < 0:
        return (
            "the pixels move the wrong way, towards the centre. Divide by the radial factor, and keep x_d and y_d: "
            "only x, y and r change."
        )
    off_px, moved_px = (np.linalg.norm(pixels - true_px, axis=1).max() for pixels in (found_px, raw_px))
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


# 4.1: distances at which the lane is measured, metres, and the largest error of its width.
MEASURED_AT_M, WIDTH_TOLERANCE_M = (7.0, 15.0, 30.0), 0.05
# Fewest rows of the image that the quadrangle must span: those from 7 to 30 m ahead are more than 100.
LEAST_ROWS = 100
# Two points of the road, the second one farther ahead, metres.
AHEAD_M = np.array([[10.0, 0.0], [20.0, 0.0]])


def check_four_points(
    source_px: np.ndarray, *, destination_px: np.ndarray, camera: Camera, lines_m: Sequence[Sequence[float]]
) -> str:
    """4.1: four points such that a straight lane is equally wide at all distances.

    Parameters
    ----------
    lines_m : array_like of shape (2, 2)
        Lateral position at the car, metres, and heading, of the left and the right line of the lane.
    """
    points = require_shape(source_px, (4, 2), "four points (column, row) are needed, an array (4, 2)")
    require((points[:, 1] < camera.height).all(), "a point lies below the image. Is the order (column, row)?")
    require(
        np.ptp(points[:, 1]) >= LEAST_ROWS,
        f"your quadrangle has only {np.ptp(points[:, 1]):.0f} rows of the image, so the view shows a strip of the "
        "road. Choose a far and a near edge.",
    )
    try:
        warp = FourPointWarp(points, destination_px, camera.size)
    except ValueError:
        crossing = "the edges cross. Give the points in the order of destination_px, around the quadrangle."
        raise HintError(crossing) from None
    widths = lane_widths_px(warp, camera, lines_m, MEASURED_AT_M) * metres_per_pixel(warp, camera)[0]
    near, far = warp.points_to_birdseye(camera.undistort_points(camera.road_to_pixels(AHEAD_M)))
    require(
        np.isfinite(widths).all() and (widths > 1).all() and far[1] < near[1],
        "the view is mirrored, turned or upside down. The order is that of destination_px: far left, far right, "
        "near right, near left.",
    )
    true_m = lines_m[0][0] - lines_m[1][0]
    text = ", ".join(f"{width:.2f}" for width in widths)
    otherwise = (
        f" at 7, 15 and 30 m: it becomes {'narrower' if widths[-1] < widths[0] else 'wider'} with the distance. The "
        "left and right edges of your quadrangle must be parallel on the road; the lines of the lane are."
        if np.ptp(widths) > WIDTH_TOLERANCE_M
        else f", the true one {true_m:.2f} m. Is the lower edge parallel to the axle?"
    )
    require_equal(widths, [true_m] * 3, {}, otherwise, said=f"the lane is {text} m wide", atol=WIDTH_TOLERANCE_M)
    return f"the lane is {text} m wide at 7, 15 and 30 m (true {true_m:.2f} m)."
