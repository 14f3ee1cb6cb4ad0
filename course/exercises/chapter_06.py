"""Exercises of chapter 6, find the lines."""

from __future__ import annotations

from course.exercises.verdict import Verdict, correct, hint


def check_lane_width(width_m: float, *, columns: float, metres_per_column: float, true_m: float | None) -> Verdict:
    """6.1: the width of the lane in metres, from the distance of the two peaks in columns."""
    expected_m = columns * metres_per_column
    if abs(width_m - columns) < 1:
        return hint(f"{width_m:.0f} is the distance in columns. Multiply by the metres per column of chapter 4.")
    if abs(width_m - columns * 3.7 / 700) < 0.01:
        return hint(f"{width_m:.2f} m. You used 3.7 m / 700 columns, which belongs to another warp (chapter 4).")
    if abs(width_m - expected_m) > 0.02:
        return hint(f"{width_m:.2f} m. The peaks are {columns:.0f} columns apart; how many metres is one?")
    return correct(f"{width_m:.2f} m" + (f" (truth {true_m:.2f} m)." if true_m else "."))


CHECKS = {"6.1": check_lane_width}
