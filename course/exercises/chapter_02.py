"""Exercises of chapter 2, calibrate the camera."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from course.exercises.verdict import Verdict, correct, hint


def check_board_errors(errors_px: Sequence[float], *, rms_px: float, boards: int, corners: int) -> Verdict:
    """2.1: the RMS reprojection error of each board, pixels.

    All boards have the same number of corners, so the RMS of the answer is that of the calibration, `rms_px`.
    """
    errors = np.asarray(errors_px, float)
    if errors.shape != (boards,):
        return hint(f"{boards} numbers are needed, one for each board; yours has the shape {errors.shape}.")
    got = float(np.sqrt((errors**2).mean()))
    if np.ptp(errors) < 1e-6 * rms_px:
        return hint(
            "all boards have the same error. Each board has its own; the RMS of the calibration is over all boards."
        )
    if abs(got / rms_px - 1) < 1e-3:
        return correct(
            f"the boards have {errors.min():.2f} to {errors.max():.2f} px (median {np.median(errors):.2f} px)."
        )
    if abs(got * np.sqrt(corners) / rms_px - 1) < 1e-3:
        return hint(
            f"your errors are too small by sqrt({corners}). You divided the norm by the number of corners, as OpenCV's "
            "tutorial does; divide the sum of squares, then take the root."
        )
    if abs(got * np.sqrt(2) / rms_px - 1) < 1e-3:
        return hint(
            "your errors are too small by sqrt(2). Sum the squares of du and dv, then average over the corners."
        )
    if got > 20 * rms_px:
        return hint(
            f"{got:.0f} px is too large. cv2.projectPoints returns ({corners}, 1, 2), the corners are ({corners}, 2); "
            "reshape before you subtract. Pass rotation and translation in this order."
        )
    return hint(
        f"together your errors give {got:.3f} px, the calibration {rms_px:.3f} px. RMS is the root of the mean of the "
        "squared distances."
    )


CHECKS = {"2.1": check_board_errors}
