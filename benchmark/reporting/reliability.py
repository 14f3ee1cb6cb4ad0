"""Calibration of the confidence: how often are lanes with a high confidence right? A table and a diagram.

A lane is correct here if both lines are within 0.2 m over 5 to 30 m: the confidence is the probability of that
(`lanes.detect.confidence`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmark.bootstrap import frame_clusters, share_interval
from benchmark.errors import CONFIDENT, joined
from benchmark.reporting.tables import describe_interval
from benchmark.scores import Result, by_difficulty
from benchmark.systems import TRACKER
from lanes.describe import format_table
from lanes.detect.confidence import CORRECT_WITHIN_M, LIKELY_CONFIDENCE
from lanes.figures import new_figure, save_figure

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

    `clusters` (M,) are those of `benchmark.bootstrap`: intervals take into account that the frames of a drive are
    correlated.
    """

    confidence: np.ndarray
    correct: np.ndarray
    clusters: np.ndarray

    @classmethod
    def from_results(cls, results: Iterable[Result]) -> AvailableLanes:
        """From the results of one system on some drives."""
        results = list(results)
        every = joined([result.errors for result in results])
        correct = every.exists & (every.full_rms_m <= CORRECT_WITHIN_M)
        clusters = frame_clusters([len(r.errors.available) for r in results], [r.fps for r in results])
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
    axes.errorbar(
        confidence, accuracy, [accuracy - low, high - accuracy], fmt="o", color="0.2", ecolor="0.5", capsize=3
    )
    # above the axes and turned, because the points at the right are as close together as a line of text is high
    above = {"transform": axes.get_xaxis_transform(), "rotation": 90, "ha": "center", "va": "bottom"}
    for x, lanes in zip(confidence, count, strict=True):
        axes.text(x, 1.02, f"{lanes:.0f}", **above)
    axes.set(
        xlabel="confidence (numbers above: lanes)", ylabel="share of correct lanes", xlim=(0, 1.02), ylim=(0, 1.02)
    )
    scenes = len({result.scene for result in results})
    title = f"Is the tracker's confidence calibrated? ({scenes} scene{'s' * (scenes > 1)})"
    axes.set_title(title, loc="left", pad=40)
    axes.grid(alpha=0.3)
    return save_figure(figure, path)
