"""Are the stated uncertainties and confidences true?

z = error / stated standard deviation has a root mean square of 1, and 68 and 95 % of its values lie within 1 and 2, if
the errors are normal and their covariance is as stated. NEES, the normalized estimation error squared e^T P^-1 e of the
errors e and their covariance P, also checks the correlations; divided by the number of errors its mean is 1 (Y.
Bar-Shalom et al., "Estimation with applications to tracking and navigation", 2001, section 5.4).

A confidence is the probability that both lines are within 0.2 m over 5 to 30 m (`lanes.detect.confidence`), so here
such a lane is correct.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmark.errors import CONFIDENT, NUMBERS, QUANTITIES, FrameErrors, joined
from benchmark.scores import Result, Row, by_difficulty, joined_frames, row_groups, share_interval, total_name
from benchmark.systems import TRACKER
from benchmark.tables import describe_interval, markdown_table
from lanes.describe import format_table
from lanes.detect.confidence import CORRECT_WITHIN_M, LIKELY_CONFIDENCE
from lanes.show.figures import new_figure, save_figure

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


def consistency(drives: Sequence[FrameErrors]) -> dict[str, float]:
    """Numbers of frames, mean and median NEES / 4, and `z_summary` of each quantity, over the frames of some drives."""
    some = joined(drives)
    nees = some.nees[some.normalized] if some.normalized.any() else np.array([np.nan])
    row = {
        "frames": float(some.normalized.sum()),
        "lane_change_frames": float((some.stated & some.lane_change).sum()),
        "other_lane_frames": float((some.stated & ~some.normalized & ~some.lane_change).sum()),
        "nees_mean": float(nees.mean()),
        "nees_median": float(np.median(nees)),
    }
    for quantity in QUANTITIES:
        row |= {f"{quantity}_{name}": value for name, value in z_summary(some.z_of(quantity)).items()}
    return row


def consistency_rows(results: Iterable[Result]) -> list[Row]:
    """A row for each scene and system that states a covariance, then one for each difficulty and system."""
    stated = [result for result in results if result.errors.stated.any()]
    return [
        {"scene": name, "difficulty": group[0].difficulty, "system": group[0].system}
        | consistency([one.errors for one in group])
        for name, group in row_groups(stated)
    ]


def consistency_table(rows: Iterable[Row]) -> str:
    """The groups of `consistency_rows` as a Markdown table: NEES / 4, and the rms of z with its share within 2."""
    cells = [
        [row["scene"], row["system"], f"{row['frames']:.0f}", f"{row['nees_mean']:.2f}"]
        + [f"{row[f'{name}_z_rms']:.2f} ({row[f'{name}_within_2']:.0%})" for name in NUMBERS]
        for row in rows
        if row["scene"] == total_name(str(row["difficulty"])) and float(row["frames"])
    ]
    return markdown_table(["scenes", "system", "frames", "NEES / 4", *NUMBERS], cells)


def describe_z(summary: dict[str, float]) -> str:
    """A `z_summary` as "1.02 68/95": root mean square, percent within 1 and 2; a dash without any z."""
    rms, within_1, within_2 = summary.values()
    return "-" if rms != rms else f"{rms:.2f} {100 * within_1:.0f}/{100 * within_2:.0f}"


# Steps of 0.1; the last one is halved, because most lanes are in it.
BIN_EDGES = np.array([*np.arange(0, 0.95, 0.1), 0.95, 1.0])

SUMMARY_COLUMNS = ("0.9 or more", "correct", "of correct", "0.5 to 0.9", "mean stated", "correct")
CONFIDENCE_LEGEND = """\
Lanes with a confidence of 0.9 or more: number, share of correct ones (here within 0.2 m over 5 to 30 m) with its 95 %
interval, and which share of all correct lanes they are. Lanes with 0.5 to 0.9: number, mean confidence, share of
correct ones."""


class Rate(NamedTuple):
    """Some lanes: mean confidence, share of correct ones with its 95 % interval, and number; NaN without a lane."""

    stated: float
    share: float
    low: float
    high: float
    lanes: int

    def describe(self) -> str:
        """The share and its interval, in percent."""
        return f"{self.share:.1%} {describe_interval(self.low, self.high)}" if self.lanes else "-"


@dataclass(frozen=True, eq=False)
class AvailableLanes:
    """The M lanes that a system reported in some frames: confidence (1 if none is stated), and whether it is correct.

    `clusters` (M,) are those of `benchmark.scores`: intervals take into account that the frames of a drive are
    correlated.
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
        return cls(confidence[every.available], correct[every.available], clusters[every.available])

    def rate(self, some: np.ndarray) -> Rate:
        """The rate of correct ones among some of the lanes, (M,) bool."""
        stated, share = (float(of[some].mean()) if some.any() else np.nan for of in (self.confidence, self.correct))
        return Rate(stated, share, *share_interval(self.correct[some], self.clusters[some]), int(some.sum()))

    def reliability(self) -> list[Rate]:
        """The reliability diagram: the rates in bins of confidence; bins without lanes are left out."""
        index = np.clip(np.searchsorted(BIN_EDGES, self.confidence, side="right"), 1, len(BIN_EDGES) - 1)
        return [self.rate(index == k) for k in np.unique(index)]

    def summary_cells(self) -> list[str]:
        """How often confident and likely lanes are correct, as the cells of a row below `SUMMARY_COLUMNS`."""
        confident = self.confidence >= CONFIDENT
        of_confident = self.rate(confident)
        of_likely = self.rate(~confident & (self.confidence >= LIKELY_CONFIDENCE))
        of_correct = replace(self, correct=confident).rate(self.correct)
        stated = f"{of_likely.stated:.1%}" if of_likely.lanes else "-"
        cells = f"{of_confident.lanes}", of_confident.describe(), of_correct.describe()
        return [*cells, f"{of_likely.lanes}", stated, of_likely.describe()]


def describe_confidence(results: Iterable[Result]) -> str:
    """A table: a line for each system that states a confidence, and difficulty; empty without such a system."""
    groups = by_difficulty(result for result in results if np.isfinite(result.errors.confidence).any())
    if not groups:
        return ""
    rows = {", ".join(names): AvailableLanes.from_results(group).summary_cells() for names, group in groups.items()}
    return f"{format_table(SUMMARY_COLUMNS, rows)}\n{CONFIDENCE_LEGEND}"


def save_reliability_figure(path: str | Path, results: Sequence[Result]) -> Path | None:
    """Draw the tracker's reliability diagram: accuracy against confidence, with the number of lanes above each point.

    None if the tracker has no lane.
    """
    of_tracker = [result for result in results if result.system == TRACKER]
    if not any(result.errors.available.any() for result in of_tracker):
        return None
    confidence, accuracy, low, high, count = np.array(AvailableLanes.from_results(of_tracker).reliability()).T
    figure, (axes,) = new_figure(1, 1, (8, 6))
    axes.plot([0, 1], [0, 1], color="0.15", linestyle="--", linewidth=1.3, zorder=3)
    error = [accuracy - low, high - accuracy]
    axes.errorbar(confidence, accuracy, error, fmt="o", color="0.2", ecolor="0.5", capsize=3)
    # above the axes and turned, because the points at the right are as close together as a line of text is high
    above = {"transform": axes.get_xaxis_transform(), "rotation": 90, "ha": "center", "va": "bottom"}
    for x, lanes in zip(confidence, count, strict=True):
        axes.text(x, 1.02, f"{lanes:.0f}", **above)
    axes.set(xlabel="confidence (numbers above: lanes)", ylabel="share of correct lanes")
    axes.set(xlim=(0, 1.02), ylim=(0, 1.02))
    scenes = len({result.scene for result in results})
    title = f"Is the tracker's confidence calibrated? ({scenes} scene{'s' * (scenes > 1)})"
    axes.set_title(title, loc="left", pad=40)
    axes.grid(alpha=0.3)
    return save_figure(figure, path)
