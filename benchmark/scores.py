"""The rows of the benchmark's table: scores of a system on a scene, computed from the
errors of its frames.

Frames of a drive resemble each other, so for intervals of their shares whole drives are
drawn with replacement (cluster bootstrap). A single drive is divided into blocks of one
second. See A. C. Davison and D. V. Hinkley, "Bootstrap methods and their application",
1997, sections 3.8 and 8.2.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmark.errors import FrameErrors, joined, recovery_lengths
from benchmark.estimates import AHEAD_M

# Distances ahead, each with its own columns in the table.
TABLE_AHEAD_M = (5.0, 15.0, 30.0)
Row = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Result:
    """The errors of one system on one scene, and the conditions of the measurement.

    `pose` is the source of the camera pose: "true" or "estimated". `workers` and
    `machine` (see `describe_machine`) are the number of processes and the machine of
    the time measurement.
    """

    scene: str
    difficulty: str
    system: str
    errors: FrameErrors
    pose: str = "true"
    workers: int = 1
    fps: float = 25.0
    machine: str = ""


RESAMPLINGS = 4000
SEED = 0
# Percentiles of a 95 % interval; 95 % of a normal distribution lie within 1.96 standard
# deviations.
PERCENTILES = (2.5, 97.5)
Z_95 = 1.96
# Length of a block of a single drive.
BLOCK_S = 1.0


def frame_clusters(frames: Sequence[int], fps: Sequence[float]) -> np.ndarray:
    """(N,) cluster of each frame of drives, joined: the number of its drive, or of its
    second in a single drive.

    `frames` and `fps` are those of each drive.
    """
    if len(frames) == 1:
        block_frames = BLOCK_S * fps[0]
        return (np.arange(frames[0]) / block_frames).astype(int)
    return np.repeat(np.arange(len(frames)), frames)


def joined_frames(group: Sequence[Result]) -> tuple[FrameErrors, np.ndarray]:
    """The errors of the N frames of some drives, joined, and their clusters (N,)."""
    errors = [result.errors for result in group]
    frames = [len(of_drive.exists) for of_drive in errors]
    fps = [result.fps for result in group]
    return joined(errors), frame_clusters(frames, fps)


def mean_interval(values: np.ndarray, clusters: np.ndarray) -> tuple[float, float]:
    """95 % interval of the mean of values (N,) in clusters (N,), which are drawn with
    replacement.

    Percentiles of the bootstrap; NaN without any value.
    """
    if not len(values):
        return np.nan, np.nan
    _, index, count = np.unique(clusters, return_inverse=True, return_counts=True)
    total = np.bincount(index, values)

    # How often each cluster is drawn in each resampling.
    rng = np.random.default_rng(SEED)
    equal = np.full(len(count), 1 / len(count))
    drawn = rng.multinomial(len(count), equal, RESAMPLINGS)
    means = (drawn @ total) / (drawn @ count)
    low, high = np.percentile(means, PERCENTILES)
    return float(low), float(high)


def share_interval(flags: np.ndarray, clusters: np.ndarray) -> tuple[float, float]:
    """95 % interval of the share of True in flags (N,) bool, in clusters (N,).

    NaN without any flag.

    It is never narrower than Wilson's interval: the bootstrap gives a width of 0 where
    all clusters have a share of 0, or all have 1.
    """
    if not len(flags):
        return np.nan, np.nan
    low, high = mean_interval(flags, clusters)
    wilson_low, wilson_high = wilson_interval(flags.sum(), np.array(len(flags)))
    return min(low, float(wilson_low)), max(high, float(wilson_high))


def wilson_interval(
    successes: np.ndarray, count: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Wilson score interval of a proportion: lower and upper limit with 95 %
    confidence.

    E. B. Wilson, "Probable inference, the law of succession, and statistical
    inference", JASA 22, 1927. It assumes independent trials. Frames of a drive are
    correlated, so the true interval is wider.
    """
    share = successes / count
    spread = Z_95**2 / count
    middle = (share + spread / 2) / (1 + spread)
    variance = share * (1 - share) + spread / 4
    half = np.sqrt(spread * variance) / (1 + spread)
    # clipped, because rounding could exclude the share itself at 0 and 1
    low = np.clip(middle - half, 0.0, share)
    high = np.clip(middle + half, share, 1.0)
    return low, high


def by_difficulty(results: Iterable[Result]) -> dict[tuple[str, str], list[Result]]:
    """The results of each difficulty and system, in the order in which these first
    occur.
    """
    groups: dict[tuple[str, str], list[Result]] = {}
    for result in results:
        key = (result.difficulty, result.system)
        groups.setdefault(key, []).append(result)
    return groups


def total_name(difficulty: str) -> str:
    """The name in the column "scene" of a row over all scenes of a difficulty."""
    return f"all {difficulty}"


def row_groups(results: Sequence[Result]) -> list[tuple[str, list[Result]]]:
    """Name and results of each row of a table: each scene and system, then each
    difficulty and system.
    """
    rows = [(result.scene, [result]) for result in results]
    for (difficulty, _), group in by_difficulty(results).items():
        rows.append((total_name(difficulty), group))
    return rows


def score_rows(results: Sequence[Result]) -> list[Row]:
    """A row for each of the `row_groups`: names and conditions, the numbers of `score`,
    and a comparison.

    The latter is the 95 % interval of the accuracy, and the mark of the best systems of
    a scene or difficulty: 1 or 0 (see `among_best`), NaN without another system.
    """
    rows = []
    for name, groups in _compared_groups(results):
        marks = [np.nan]
        if len(groups) > 1:
            marks = [float(mark) for mark in among_best(groups)]
        for group, mark in zip(groups, marks, strict=True):
            row = _row(name, group)
            row["accuracy_low"], row["accuracy_high"] = accuracy_interval(group)
            row["among_best"] = mark
            rows.append(row)
    return rows


def _compared_groups(
    results: Sequence[Result],
) -> list[tuple[str, list[list[Result]]]]:
    """The name of each scene or difficulty, and the results of each system on it.

    Two videos may have the same name.
    """
    compared: dict[tuple[str, int], list[list[Result]]] = {}
    seen: Counter[tuple[str, str]] = Counter()
    for name, group in row_groups(results):
        key = (name, group[0].system)
        compared.setdefault((name, seen[key]), []).append(group)
        seen[key] += 1
    return [(name, groups) for (name, _), groups in compared.items()]


def accuracy_interval(group: Sequence[Result]) -> tuple[float, float]:
    """95 % interval of the accuracy of a system over some drives.

    NaN without a frame with a true lane.
    """
    if not any(result.errors.exists.any() for result in group):
        return np.nan, np.nan
    success, clusters = _successes(group)
    return share_interval(success, clusters)


def among_best(groups: Sequence[Sequence[Result]]) -> list[bool]:
    """Whether each system is the best one or not significantly worse, from the results
    of each on the same drives.

    It is not worse if the 95 % interval of the difference of their shares of successes,
    frame by frame, contains 0.
    """
    successes = [_successes(group)[0] for group in groups]
    _, clusters = _successes(groups[0])
    best = max(successes, key=np.sum).astype(float)
    marks = []
    for success in successes:
        low, _ = mean_interval(best - success, clusters)
        is_worse = low > 0  # not without any frame, where it is NaN
        marks.append(not is_worse)
    return marks


def _successes(group: Sequence[Result]) -> tuple[np.ndarray, np.ndarray]:
    """(N,) bool, whether a system succeeds in the frames that count, and (N,) their
    clusters.

    A success is a correct frame; if no frame has a true lane, one that is not confident
    and wrong.
    """
    every, clusters = joined_frames(group)
    if not every.exists.any():
        return ~every.confident_and_wrong, clusters
    return every.correct[every.exists], clusters[every.exists]


def _row(name: str, group: Sequence[Result]) -> Row:
    """Row of the results of one system on scenes of one difficulty."""
    return {
        "scene": name,
        "difficulty": group[0].difficulty,
        "system": group[0].system,
        "pose": " ".join(sorted({result.pose for result in group})),
        "workers": max(result.workers for result in group),
        "machine": " or ".join(sorted({result.machine for result in group})),
        **score([result.errors for result in group]),
    }


def score(drives: Sequence[FrameErrors]) -> dict[str, float]:
    """Scores over all frames of some drives; NaN without any frame to score.

    `available_share` and `accuracy` refer to the frames with a true lane,
    `confident_and_wrong_share` to all frames. `*_median` and `*_p95` are over the
    frames with an available lane. `recovery_*` are lengths of losses, 0 without a loss.
    """
    every = joined(drives)
    exists = every.exists
    row = {
        "frames": float(len(exists)),
        "lane_frames": float(exists.sum()),
        "available_share": _share(every.available[exists]),
        "accuracy": _share(every.correct[exists]),
        "confident_and_wrong_share": _share(every.confident_and_wrong),
    }

    def add_errors(name: str, unit: str, values: np.ndarray) -> None:
        row[f"{name}_median_{unit}"] = percentile(values, 50)
        row[f"{name}_p95_{unit}"] = percentile(values, 95)

    for distance_m in TABLE_AHEAD_M:
        (at,) = np.flatnonzero(distance_m == AHEAD_M)
        add_errors(f"lateral_{distance_m:.0f}m", "m", every.lateral_m[:, at])
    add_errors("lateral_5_20m", "m", every.near_rms_m)
    add_errors("offset", "m", every.offset_m)
    add_errors("heading", "rad", every.heading_rad)
    add_errors("curvature", "per_m", every.curvature_per_m)

    losses = []
    for drive in drives:
        losses += recovery_lengths(drive.correct[drive.exists])
    row["recovery_median_frames"] = percentile(np.array(losses or [0], float), 50)
    row["recovery_longest_frames"] = float(max(losses, default=0))
    row["time_median_ms"] = percentile(every.time_ms, 50)
    return row


def percentile(values: np.ndarray, percent: float) -> float:
    """The smallest value that at least `percent` of the values do not exceed, NaN left
    out; NaN without any value.
    """
    known = values[~np.isnan(values)]
    if not len(known):
        return np.nan
    return float(np.percentile(known, percent, method="inverted_cdf"))


def _share(flags: np.ndarray) -> float:
    return float(flags.mean()) if len(flags) else np.nan
