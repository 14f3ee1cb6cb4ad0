"""Calibration of the confidence: how often are lanes with a high confidence right?

A lane is correct here if both lines are within 0.2 m over 5 to 30 m: the confidence is the probability of that
(`lanes.detect.confidence`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from benchmark.bootstrap import frame_clusters, share_interval
from benchmark.errors import CONFIDENT, joined
from benchmark.reporting.tables import describe_interval
from benchmark.scores import Result, by_difficulty
from lanes.describe import format_table
from lanes.detect.confidence import CORRECT_WITHIN_M, LIKELY_CONFIDENCE

# Steps of 0.1; the last one is halved, because most lanes are in it.
BIN_EDGES = np.array([*np.arange(0, 0.95, 0.1), 0.95, 1.0])

SUMMARY_COLUMNS = ("0.9 or more", "correct", "of correct", "0.5 to 0.9", "mean stated", "correct")
CONFIDENCE_LEGEND = """\
Lanes with a confidence of 0.9 or more: number, share of correct ones (here within 0.2 m over 5 to 30 m) with its 95 %
interval, and which share of all correct lanes they are. Lanes with 0.5 to 0.9: number, mean confidence, share of
correct ones."""


class Reliability(NamedTuple):
    """Accuracy of the lanes in B bins of confidence; bins without lanes are left out.

    Mean confidence, share of correct lanes with its 95 % interval, and number of lanes in each bin.
    """

    confidence: np.ndarray
    accuracy: np.ndarray
    low: np.ndarray
    high: np.ndarray
    counts: np.ndarray


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

    def reliability(self) -> Reliability:
        """The reliability diagram: accuracy against confidence."""
        bins = len(BIN_EDGES) - 1
        index = np.clip(np.searchsorted(BIN_EDGES, self.confidence, side="right") - 1, 0, bins - 1)
        members = [index == k for k in range(bins) if (index == k).any()]
        rates = [_rate(self.correct[some], self.clusters[some]) for some in members]
        return Reliability(
            np.array([self.confidence[some].mean() for some in members]),
            *(np.array([getattr(rate, name) for rate in rates]) for name in ("share", "low", "high", "lanes")),
        )

    def summary_cells(self) -> list[str]:
        """How often confident and likely lanes are correct, as the cells of a row below `SUMMARY_COLUMNS`."""
        confident = self.confidence >= CONFIDENT
        likely = ~confident & (self.confidence >= LIKELY_CONFIDENCE)
        of_confident, of_likely = (_rate(self.correct[some], self.clusters[some]) for some in (confident, likely))
        of_correct = _rate(confident[self.correct], self.clusters[self.correct])
        stated = f"{self.confidence[likely].mean():.1%}" if likely.any() else "-"
        cells = f"{of_confident.lanes}", of_confident.describe(), of_correct.describe()
        return [*cells, f"{of_likely.lanes}", stated, of_likely.describe()]


class Rate(NamedTuple):
    """A share of a number of lanes, with its 95 % interval; NaN without a lane."""

    share: float
    low: float
    high: float
    lanes: int

    def describe(self) -> str:
        """The share and its interval, in percent."""
        return f"{self.share:.1%} {describe_interval(self.low, self.high)}" if self.lanes else "-"


def _rate(flags: np.ndarray, clusters: np.ndarray) -> Rate:
    return Rate(float(flags.mean()) if len(flags) else float("nan"), *share_interval(flags, clusters), len(flags))


def describe_confidence(results: Iterable[Result]) -> str:
    """A table: a line for each system that states a confidence, and difficulty; empty without such a system."""
    groups = by_difficulty(result for result in results if np.isfinite(result.errors.confidence).any())
    if not groups:
        return ""
    rows = {", ".join(names): AvailableLanes.from_results(group).summary_cells() for names, group in groups.items()}
    return f"{format_table(SUMMARY_COLUMNS, rows)}\n{CONFIDENCE_LEGEND}"
