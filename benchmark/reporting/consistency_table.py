"""Tables of the consistency of the stated uncertainties: rows for a CSV file, and a table for the terminal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from benchmark.consistency import NUMBERS, QUANTITIES, NormalizedErrors, consistency
from benchmark.reporting.tables import format_table, read_scores
from benchmark.result import Result, by_difficulty
from benchmark.scores import Row, total_name

LEGEND = """\
z is an error divided by its stated standard deviation: a cell shows the root mean square of z (1 is wanted) and the
shares within 1 and 2 standard deviations (68/95 % are wanted). NEES is e^T P^-1 e / 4 of offset, heading, curvature and
width with their stated covariance P: its mean is 1 if P is true, larger if the errors are larger than stated.
Frames of a lane change, and those in which another lane was found, are counted, but left out."""


def consistency_rows(results: Iterable[Result]) -> list[Row]:
    """A row for each scene and system that states a covariance, then one for each difficulty and system."""
    stated = [result for result in results if result.normalized is not None]
    scenes = [_row(result.scene, [result]) for result in stated]
    return scenes + [_row(total_name(difficulty), group) for (difficulty, _), group in by_difficulty(stated).items()]


def describe_consistency(results: Iterable[Result]) -> str:
    """A column for each difficulty and system, a line for each quantity, and the legend; empty without a covariance."""
    groups = by_difficulty(result for result in results if result.normalized is not None)
    if not groups:
        return ""
    columns = [f"{difficulty} {system}" for difficulty, system in groups]
    rows = [consistency(_normalized(group)) for group in groups.values()]
    lines = {
        "frames": [f"{row['frames']:.0f}" for row in rows],
        "lane change": [f"{row['lane_change_frames']:.0f}" for row in rows],
        "other lane": [f"{row['other_lane_frames']:.0f}" for row in rows],
        "NEES mean/median": [f"{row['nees_mean']:.2f}/{row['nees_median']:.2f}" for row in rows],
    }
    for quantity in QUANTITIES:
        name = quantity.replace("lateral_", "lateral, ").replace("m", " m") if "lateral" in quantity else quantity
        lines[name] = [describe_z({key: row[f"{quantity}_{key}"] for key in Z_KEYS}) for row in rows]
    return f"{format_table(columns, lines)}\n{LEGEND}"


def consistency_table(path: str | Path) -> str:
    """The groups of a consistency.csv as a Markdown table: NEES / 4, and the rms of z with its share within 2.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If it is not a table of the benchmark.
    """
    lines = ["| scenes | system | frames | NEES / 4 | " + " | ".join(NUMBERS) + " |", "|---" * (4 + len(NUMBERS)) + "|"]
    for row in read_scores(path, required="nees_mean"):
        if row["scene"] == total_name(str(row["difficulty"])) and float(row["frames"]):
            cells = [f"{row[f'{name}_z_rms']:.2f} ({row[f'{name}_within_2']:.0%})" for name in NUMBERS]
            stated = f"{row['frames']:.0f} | {row['nees_mean']:.2f}"
            lines.append(f"| {row['scene']} | {row['system']} | {stated} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


Z_KEYS = ("z_rms", "within_1", "within_2")


def describe_z(summary: dict[str, float]) -> str:
    """A `z_summary` as "1.02 68/95": root mean square, percent within 1 and 2; a dash without any z."""
    rms, within_1, within_2 = (summary[key] for key in Z_KEYS)
    return "-" if rms != rms else f"{rms:.2f} {100 * within_1:.0f}/{100 * within_2:.0f}"


def _row(name: str, group: Sequence[Result]) -> Row:
    names = {"scene": name, "difficulty": group[0].difficulty, "system": group[0].system}
    return names | consistency(_normalized(group))


def _normalized(group: Sequence[Result]) -> list[NormalizedErrors]:
    return [result.normalized for result in group if result.normalized is not None]
