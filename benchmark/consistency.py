"""Are the stated uncertainties and confidences true?

z = error / stated standard deviation has a root mean square of 1, and 68 and 95 % of
its values lie within 1 and 2, if the errors are normal and their covariance is as
stated. NEES, the normalized estimation error squared e^T P^-1 e of the errors e and
their covariance P, also checks the correlations; divided by the number of errors its
mean is 1 (Y. Bar-Shalom et al., "Estimation with applications to tracking and
navigation", 2001, section 5.4).

A confidence is the probability that both lines are within 0.2 m over 5 to 30 m
(`lanes.detect.confidence`), so here such a lane is correct.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmark.errors import CONFIDENT, NUMBERS, QUANTITIES, FrameErrors, joined
from benchmark.scores import (
    Result,
    Row,
    by_difficulty,
    joined_frames,
    row_groups,
    share_interval,
    total_name,
)
from benchmark.systems import TRACKER
from benchmark.tables import describe_interval, markdown_table
from lanes.describe import format_table
from lanes.detect.confidence import CORRECT_WITHIN_M, LIKELY_CONFIDENCE
from lanes.show.figures import new_figure, save_figure

LEGEND = """\
z is an error divided by its stated standard deviation: a cell shows the root mean
square of z (1 is wanted) and its share within 2 (95 % is wanted). NEES / 4 is
e^T P^-1 e / 4 of these errors with their stated covariance P: its mean is 1 if P is
true, larger if the errors are larger than stated. Frames of a lane change, and those in
which another lane was found, are left out; consistency.csv counts them."""


def z_summary(z: np.ndarray) -> dict[str, float]:
    """Root mean square of z, and its shares within 1 and 2; NaN without any z."""
    if not len(z):
        return dict.fromkeys(("z_rms", "within_1", "within_2"), np.nan)
    distance = np.abs(z)
    return {
        "z_rms": float(np.sqrt(np.mean(z**2))),
        "within_1": float(np.mean(distance <= 1)),
        "within_2": float(np.mean(distance <= 2)),
    }


def consistency(drives: Sequence[FrameErrors]) -> dict[str, float]:
    """Numbers of frames, mean and median NEES / 4, and `z_summary` of each quantity.

    They are over the frames of all drives.
    """
    every = joined(drives)
    counted = every.normalized
    other_lane = every.stated & ~counted & ~every.lane_change
    nees = every.nees[counted] if counted.any() else np.array([np.nan])
    row = {
        "frames": float(counted.sum()),
        "lane_change_frames": float((every.stated & every.lane_change).sum()),
        "other_lane_frames": float(other_lane.sum()),
        "nees_mean": float(nees.mean()),
        "nees_median": float(np.median(nees)),
    }
    for quantity in QUANTITIES:
        summary = z_summary(every.z_of(quantity))
        for name, value in summary.items():
            row[f"{quantity}_{name}"] = value
    return row


def consistency_rows(results: Iterable[Result]) -> list[Row]:
    """A row for each scene and system that states a covariance, then one for each
    difficulty and system.
    """
    stated = [result for result in results if result.errors.stated.any()]
    rows = []
    for name, group in row_groups(stated):
        about = {
            "scene": name,
            "difficulty": group[0].difficulty,
            "system": group[0].system,
        }
        rows.append(about | consistency([result.errors for result in group]))
    return rows


def consistency_table(rows: Iterable[Row]) -> str:
    """The groups of `consistency_rows` as a Markdown table.

    Its cells are NEES / 4, and the root mean square of z with its share within 2.
    """
    lines = []
    for row in rows:
        is_total = row["scene"] == total_name(str(row["difficulty"]))
        if not is_total or not float(row["frames"]):
            continue
        cells = [row["scene"], row["system"]]
        cells.append(f"{row['frames']:.0f}")
        cells.append(f"{row['nees_mean']:.2f}")
        for name in NUMBERS:
            within_2 = row[f"{name}_within_2"]
            cells.append(f"{row[f'{name}_z_rms']:.2f} ({within_2:.0%})")
        lines.append(cells)
    return markdown_table(["scenes", "system", "frames", "NEES / 4", *NUMBERS], lines)


def describe_z(summary: dict[str, float]) -> str:
    """A `z_summary` as "1.02 68/95": root mean square, percent within 1 and 2.

    A dash without any z.
    """
    if np.isnan(summary["z_rms"]):
        return "-"
    within_1 = 100 * summary["within_1"]
    within_2 = 100 * summary["within_2"]
    return f"{summary['z_rms']:.2f} {within_1:.0f}/{within_2:.0f}"


# Steps of 0.1; the last one is halved, because most lanes are in it.
BIN_EDGES = np.array([*np.arange(0, 0.95, 0.1), 0.95, 1.0])

SUMMARY_COLUMNS = (
    "0.9 or more",
    "correct",
    "of correct",
    "0.5 to 0.9",
    "mean stated",
    "correct",
)
CONFIDENCE_LEGEND = """\
Lanes with a confidence of 0.9 or more: number, share of correct ones (here within 0.2 m
over 5 to 30 m) with its 95 % interval, and which share of all correct lanes they are.
Lanes with 0.5 to 0.9: number, mean confidence, share of correct ones."""


class Rate(NamedTuple):
    """Some lanes: mean confidence, share of correct ones with its 95 % interval, and
    number.

    NaN without a lane.
    """

    stated: float
    share: float
    low: float
    high: float
    lanes: int

    def describe(self) -> str:
        """The share and its interval, in percent."""
        if not self.lanes:
            return "-"
        return f"{self.share:.1%} {describe_interval(self.low, self.high)}"


@dataclass(frozen=True, eq=False)
class AvailableLanes:
    """The M lanes that a system reported in some frames: confidence (1 if none is
    stated), and whether it is correct.

    `clusters` (M,) are those of `benchmark.scores`: intervals take into account that
    the frames of a drive are correlated.
    """

    confidence: np.ndarray
    correct: np.ndarray
    clusters: np.ndarray

    @classmethod
    def from_results(cls, results: Sequence[Result]) -> AvailableLanes:
        """From the results of one system on some drives."""
        every, clusters = joined_frames(results)
        correct = every.exists & (every.full_rms_m <= CORRECT_WITHIN_M)
        confidence = np.nan_to_num(every.confidence, nan=1.0)
        available = every.available
        return cls(confidence[available], correct[available], clusters[available])

    def rate(self, some: np.ndarray) -> Rate:
        """The rate of correct ones among some of the lanes, (M,) bool."""
        correct = self.correct[some]
        low, high = share_interval(correct, self.clusters[some])
        if not some.any():
            return Rate(np.nan, np.nan, low, high, 0)
        stated = float(self.confidence[some].mean())
        return Rate(stated, float(correct.mean()), low, high, len(correct))

    def reliability(self) -> list[Rate]:
        """The reliability diagram: the rates in bins of confidence.

        Bins without lanes are left out.
        """
        index = np.searchsorted(BIN_EDGES, self.confidence, side="right")
        index = np.clip(index, 1, len(BIN_EDGES) - 1)
        return [self.rate(index == bin_number) for bin_number in np.unique(index)]

    def summary_cells(self) -> list[str]:
        """How often confident and likely lanes are correct, as the cells of a row below
        `SUMMARY_COLUMNS`.
        """
        confident = self.confidence >= CONFIDENT
        likely = ~confident & (self.confidence >= LIKELY_CONFIDENCE)
        of_confident = self.rate(confident)
        of_likely = self.rate(likely)
        # The share of confident ones among the correct lanes.
        of_correct = replace(self, correct=confident).rate(self.correct)
        return [
            f"{of_confident.lanes}",
            of_confident.describe(),
            of_correct.describe(),
            f"{of_likely.lanes}",
            f"{of_likely.stated:.1%}" if of_likely.lanes else "-",
            of_likely.describe(),
        ]


def describe_confidence(results: Iterable[Result]) -> str:
    """A table: a line for each system that states a confidence, and difficulty.

    Empty without such a system.
    """
    stated = [
        result for result in results if np.isfinite(result.errors.confidence).any()
    ]
    if not stated:
        return ""
    rows = {}
    for (difficulty, system), group in by_difficulty(stated).items():
        cells = AvailableLanes.from_results(group).summary_cells()
        rows[f"{difficulty}, {system}"] = cells
    return f"{format_table(SUMMARY_COLUMNS, rows)}\n{CONFIDENCE_LEGEND}"


def save_reliability_figure(path: str | Path, results: Sequence[Result]) -> Path | None:
    """Draw the tracker's reliability diagram: accuracy against confidence, with the
    number of lanes above each point.

    None if the tracker has no lane.
    """
    of_tracker = [result for result in results if result.system == TRACKER]
    lanes = AvailableLanes.from_results(of_tracker) if of_tracker else None
    if lanes is None or not len(lanes.correct):
        return None
    confidence, accuracy, low, high, count = np.array(lanes.reliability()).T

    figure, (axes,) = new_figure(1, 1, (8, 6))
    axes.plot([0, 1], [0, 1], color="0.15", linestyle="--", linewidth=1.3, zorder=3)
    axes.errorbar(
        confidence,
        accuracy,
        [accuracy - low, high - accuracy],
        fmt="o",
        color="0.2",
        ecolor="0.5",
        capsize=3,
    )
    for x, number in zip(confidence, count, strict=True):
        # above the axes and turned, because the points at the right are as close
        # together as a line of text is high
        axes.text(
            x,
            1.02,
            f"{number:.0f}",
            transform=axes.get_xaxis_transform(),
            rotation=90,
            ha="center",
            va="bottom",
        )

    axes.set(
        xlabel="confidence (numbers above: lanes)",
        ylabel="share of correct lanes",
        xlim=(0, 1.02),
        ylim=(0, 1.02),
    )
    scenes = len({result.scene for result in results})
    plural = "s" if scenes > 1 else ""
    title = f"Is the tracker's confidence calibrated? ({scenes} scene{plural})"
    axes.set_title(title, loc="left", pad=40)
    axes.grid(alpha=0.3)
    return save_figure(figure, path)
