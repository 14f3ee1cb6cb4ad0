"""Are the stated uncertainties true? Errors in units of their standard deviations, NEES, and tables of both.

z = error / stated standard deviation has a root mean square of 1, and 68 and 95 % of its values lie within 1 and 2, if
the errors are normal and their covariance is as stated. NEES, the normalized estimation error squared e^T P^-1 e of the
errors e and their covariance P, also checks the correlations; divided by the number of errors its mean is 1 (Y.
Bar-Shalom et al., "Estimation with applications to tracking and navigation", 2001, section 5.4).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from benchmark.errors import NUMBERS, QUANTITIES, NormalizedErrors, joined
from benchmark.scores import Result, Row, by_difficulty, total_name

LEGEND = """\
z is an error divided by its stated standard deviation: a cell shows the root mean square of z (1 is wanted) and its
share within 2 (95 % is wanted). NEES / 4 is e^T P^-1 e / 4 of these errors with their stated covariance P: its mean is
1 if P is true, larger if the errors are larger than stated. Frames of a lane change, and those in which another lane
was found, are left out; consistency.csv counts them."""


def z_summary(z: np.ndarray) -> dict[str, float]:
    """Root mean square of z, and its shares within 1 and 2; NaN without any z."""
    if not len(z):
        return dict.fromkeys(("z_rms", "within_1", "within_2"), float("nan"))
    shares = {f"within_{k}": float(np.mean(np.abs(z) <= k)) for k in (1, 2)}
    return {"z_rms": float(np.sqrt(np.mean(z**2)))} | shares


def consistency(drives: Iterable[NormalizedErrors]) -> dict[str, float]:
    """Numbers of frames, mean and median NEES / 4, and `z_summary` of each quantity, over the frames of some drives."""
    some = joined(list(drives))
    nees = some.nees[some.used] if some.used.any() else np.array([np.nan])
    row = {
        "frames": float(some.used.sum()),
        "lane_change_frames": float(some.lane_change.sum()),
        "other_lane_frames": float((~some.used & ~some.lane_change).sum()),
        "nees_mean": float(nees.mean()),
        "nees_median": float(np.median(nees)),
    }
    for quantity in QUANTITIES:
        row |= {f"{quantity}_{name}": value for name, value in z_summary(some.of(quantity)).items()}
    return row


def consistency_rows(results: Iterable[Result]) -> list[Row]:
    """A row for each scene and system that states a covariance, then one for each difficulty and system."""
    stated = [result for result in results if result.normalized is not None]
    groups = [(result.scene, [result]) for result in stated]
    groups += [(total_name(difficulty), group) for (difficulty, _), group in by_difficulty(stated).items()]
    return [
        {"scene": name, "difficulty": group[0].difficulty, "system": group[0].system}
        | consistency(one.normalized for one in group if one.normalized)
        for name, group in groups
    ]


def consistency_table(rows: Iterable[Row]) -> str:
    """The groups of `consistency_rows` as a Markdown table: NEES / 4, and the rms of z with its share within 2."""
    lines = ["| scenes | system | frames | NEES / 4 | " + " | ".join(NUMBERS) + " |", "|---" * (4 + len(NUMBERS)) + "|"]
    for row in rows:
        if row["scene"] == total_name(str(row["difficulty"])) and float(row["frames"]):
            cells = [f"{row[f'{name}_z_rms']:.2f} ({row[f'{name}_within_2']:.0%})" for name in NUMBERS]
            stated = f"{row['frames']:.0f} | {row['nees_mean']:.2f}"
            lines.append(f"| {row['scene']} | {row['system']} | {stated} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def describe_z(summary: dict[str, float]) -> str:
    """A `z_summary` as "1.02 68/95": root mean square, percent within 1 and 2; a dash without any z."""
    rms, within_1, within_2 = summary.values()
    return "-" if rms != rms else f"{rms:.2f} {100 * within_1:.0f}/{100 * within_2:.0f}"
