"""Significance of the table: intervals of the accuracy, and the systems that are not worse than the best one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmark.bootstrap import frame_clusters, mean_interval, share_interval
from benchmark.result import Result


@dataclass(frozen=True, eq=False)
class Successes:
    """(N,) bool: the success of a system in the frames that count, and (N,) their clusters (`benchmark.bootstrap`)."""

    success: np.ndarray
    clusters: np.ndarray

    @classmethod
    def from_results(cls, group: Sequence[Result]) -> Successes:
        """A success is a correct frame; if no frame has a true lane, one that is not confident and wrong."""
        drives = [result.errors for result in group]
        clusters = frame_clusters([len(drive.exists) for drive in drives], [result.fps for result in group])
        exists, correct, wrong = (
            np.concatenate([getattr(drive, name) for drive in drives])
            for name in ("exists", "correct", "confident_and_wrong")
        )
        return cls(correct[exists], clusters[exists]) if exists.any() else cls(~wrong, clusters)


def accuracy_interval(group: Sequence[Result]) -> tuple[float, float]:
    """95 % interval of the accuracy of a system over some drives; NaN without a frame with a true lane."""
    if not any(result.errors.exists.any() for result in group):
        return float("nan"), float("nan")
    some = Successes.from_results(group)
    return share_interval(some.success, some.clusters)


def among_best(groups: Sequence[Sequence[Result]]) -> list[bool]:
    """Whether each system is the best one or not significantly worse, from the results of each on the same drives.

    It is not worse if the 95 % interval of the difference of their shares of successes, frame by frame, contains 0.
    """
    systems = [Successes.from_results(group) for group in groups]
    best = max(systems, key=lambda some: some.success.sum())
    differences = [best.success.astype(float) - some.success for some in systems]
    # without any frame nothing is worse
    return [not mean_interval(difference, best.clusters)[0] > 0 for difference in differences]
