"""Exercises of chapter 2, calibrate the camera."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from course.exercises.verdict import Verdict, correct, find_mistake, hint


def check_board_errors(
    errors_px: Sequence[float],
    *,
    rotations: Sequence[np.ndarray],
    translations: Sequence[np.ndarray],
    seen: Sequence[np.ndarray],
    board: np.ndarray,
    matrix: np.ndarray,
    distortion: np.ndarray,
) -> Verdict:
    """2.1: the RMS reprojection error of each board, pixels, with the results of `cv2.calibrateCamera`.

    `board` (N, 3) are the corners on the board, `seen` those in each picture.
    """
    true_px = []
    for rotation, translation, corners_px in zip(rotations, translations, seen, strict=True):
        projected, _ = cv2.projectPoints(board, rotation, translation, matrix, distortion)
        off_px = np.linalg.norm(projected.reshape(-1, 2) - corners_px.reshape(-1, 2), axis=1)
        true_px.append(float(np.sqrt((off_px**2).mean())))
    errors, true = np.asarray(errors_px, float), np.array(true_px)
    boards, corners = len(seen), len(board)
    rms_px, got_px = (float(np.sqrt(np.square(each).mean())) for each in (true, errors))
    if errors.shape != (boards,):
        return hint(f"{boards} numbers are needed, one for each board; yours has the shape {errors.shape}.")
    if np.ptp(errors) < 1e-6 * rms_px:
        return hint(
            "all boards have the same error. Each board has its own; the RMS of the calibration is over all boards."
        )
    if np.allclose(errors, true, rtol=1e-3):
        return correct(
            f"the boards have {errors.min():.2f} to {errors.max():.2f} px (median {np.median(errors):.2f} px)."
        )
    mistakes = {
        f"your errors are too small by sqrt({corners}). You divided the norm by the number of corners, as OpenCV's "
        "tutorial does; divide the sum of squares, then take the root.": true / np.sqrt(corners),
        "your errors are too small by sqrt(2). Sum the squares of du and dv, then average over the corners.": true
        / np.sqrt(2),
    }
    if mistake := find_mistake(errors, mistakes, rtol=1e-3):
        return hint(mistake)
    if got_px > 20 * rms_px:
        return hint(
            f"{got_px:.0f} px is too large. cv2.projectPoints returns ({corners}, 1, 2), the corners are "
            f"({corners}, 2); reshape before you subtract. Pass rotation and translation in this order."
        )
    worst = int(np.abs(errors - true).argmax())
    return hint(
        f"board {worst + 1} has {true[worst]:.3f} px, not {errors[worst]:.3f} px. Is the order that of image_points? "
        "RMS is the root of the mean of the squared distances."
    )


CHECKS = {"2.1": check_board_errors}
