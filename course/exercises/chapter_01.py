"""Exercise of chapter 1, why a ruler is not enough."""

from __future__ import annotations

import numpy as np

from course.exercises.verdict import Verdict, correct, find_mistake, hint

TOLERANCE_PX = 0.05


def check_best_ruler(worst_px: float, *, rows: np.ndarray, columns: np.ndarray) -> Verdict:
    """1.1: the largest distance between the paint and the least-squares line through all of it, pixels."""
    if np.ndim(worst_px):
        return hint(f"one number is needed, the largest distance; yours has {np.size(worst_px)} values.")
    misses = np.polyval(np.polyfit(rows, columns, 1), rows) - columns
    worst = np.abs(misses).max()
    if abs(worst_px - worst) < TOLERANCE_PX:
        return correct(f"even this ruler is {worst:.1f} px off.")
    if worst_px == round(worst):
        return hint(f"{worst_px:.0f} px is rounded. Give one decimal or more.")
    mistakes = {
        "is a mean of the distances. Take the largest one.": np.abs(misses).mean(),
        "is the largest distance on one side only. Take the absolute values first.": min(misses.max(), -misses.min()),
        "belongs to the row as a function of the column. Swap the first two arguments of np.polyfit.": np.abs(
            np.polyval(np.polyfit(columns, rows, 1), columns) - rows
        ).max(),
    }
    if mistake := find_mistake(abs(worst_px), mistakes, atol=TOLERANCE_PX):
        return hint(f"{worst_px:.1f} px {mistake}")
    if 0 < worst_px < worst:
        return hint(
            f"{worst_px:.1f} px is less than the line of least squares is off. Its largest distance is not the "
            "smallest possible one; here take least squares all the same, as np.polyfit does."
        )
    return hint(
        f"{worst_px:.1f} px is not it. Fit all rows of paint_rows, not only the near ones, and compare the line "
        "with paint_columns in each row."
    )


CHECKS = {"1.1": check_best_ruler}
