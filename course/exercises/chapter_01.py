"""Exercises of chapter 1, why a ruler is not enough."""

from __future__ import annotations

import numpy as np

from course.exercises.verdict import Verdict, correct, hint


def check_best_ruler(worst_px: float, *, rows: np.ndarray, columns: np.ndarray) -> Verdict:
    """1.1: the largest distance between the paint and the least-squares line through all of it, pixels."""
    misses = np.polyval(np.polyfit(rows, columns, 1), rows) - columns
    worst = np.abs(misses).max()
    if np.ndim(worst_px):
        return hint(f"one number is needed, the largest distance; yours has {np.size(worst_px)} values.")
    if abs(worst_px - worst) < 0.05:
        return correct(f"even this ruler is {worst:.1f} px off.")
    if worst_px == round(worst):
        return hint(f"{worst_px:.0f} px is rounded. Give one decimal or more.")
    if abs(worst_px - smallest_worst_px(rows, columns)) < 0.3:
        return hint(
            f"{worst_px:.1f} px belongs to the ruler with the smallest largest distance. A good idea; but here take "
            "least squares, as np.polyfit does."
        )
    if abs(worst_px - np.abs(misses).mean()) < 0.05 or abs(worst_px - np.sqrt((misses**2).mean())) < 0.05:
        return hint(f"{worst_px:.1f} px is a mean of the distances. Take the largest one.")
    if abs(abs(worst_px) - np.abs([misses.min(), misses.max()]).min()) < 0.05:
        return hint(f"{worst_px:.1f} px is the largest distance on one side only. Take the absolute values first.")
    if abs(worst_px - worst / np.hypot(1, np.polyfit(rows, columns, 1)[0])) < 0.05:
        return hint(f"{worst_px:.1f} px is the distance at right angles to the ruler. Measure along the row.")
    swapped = np.abs(np.polyval(np.polyfit(columns, rows, 1), columns) - rows).max()
    if abs(worst_px - swapped) < 0.05:
        return hint("you fitted the row as a function of the column. Swap the first two arguments of np.polyfit.")
    return hint(
        f"{worst_px:.1f} px is not it. Fit all rows of paint_rows, not only the near ones, and compare the line "
        "with paint_columns in each row."
    )


def smallest_worst_px(rows: np.ndarray, columns: np.ndarray) -> float:
    """The largest distance of the ruler for which it is smallest (Chebyshev), pixels, to 0.01 px."""
    slope = np.polyfit(rows, columns, 1)[0]
    low, high = slope - 1, slope + 1
    for _ in range(60):  # half the range of the residuals is a convex function of the slope
        first, second = low + (high - low) / 3, high - (high - low) / 3
        if np.ptp(columns - first * rows) < np.ptp(columns - second * rows):
            high = second
        else:
            low = first
    return float(np.ptp(columns - low * rows)) / 2


CHECKS = {"1.1": check_best_ruler}
