"""The accuracy of several methods: on the stills of the course in one table, and on its videos.

Three kinds of stills are possible: with truth (the embedded ones), with hand-made labels (`labels.jsonl`), and with
neither. The table shows the strongest comparison that the data allow.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchmark.evaluation import COMMITTED, PROJECT_ROOT, score_systems
from benchmark.scores import Row
from benchmark.systems import PROJECTED_AT_M, TRACKER, OwnFinder, project_lines
from course.dataset import Dataset
from course.measures import HasLines, describe_error, worst_lateral_error_m
from lanes.camera import Camera
from lanes.describe import format_table
from lanes.labels import EGO_SIDES, LaneColumns
from lanes.score import score_still, summarize

# Distances at which two methods are compared with each other, metres.
COMPARED_AT_M = np.arange(5.0, 31.0, 5.0)
# Videos: the tracker has a memory; it gets more frames than a finder that sees each frame alone.
EVERY, TRACKER_EVERY = 10, 2
Found = Mapping[str, Sequence[HasLines | None]]


@dataclass(frozen=True)
class TwoLines:
    """Two lines as `np.polyfit` returns them: y = np.polyval(line, x), metres, x forward, y left."""

    left: Sequence[float]
    right: Sequence[float]

    def lateral_m(self, x_m: np.ndarray) -> np.ndarray:
        """Lateral positions (2, N) of both lines at distances (N,), metres."""
        return np.array([np.polyval(line, x_m) for line in (self.left, self.right)])


def accuracy_table(found: Found, data: Dataset, camera: Camera) -> str:
    """A table of the results of each method on each still.

    With truth a cell is the largest lateral error from 5 to 30 m ahead, or "lost". With labels it is the share of
    labelled points within TuSimple's tolerance (20 px / cos of the angle of the line). With neither, one line states
    how far the methods differ.

    Parameters
    ----------
    found : dict
        For each method its results in the order of `data.stills`; None where it found no lane.
    """
    labels, rows = data.labels(), dict[str, list[str]]()
    with_truth = any(data.true_lane(path) for path in data.stills)
    if not (with_truth or labels):
        return _describe_differences(found)
    for path, *results in zip(data.stills, *found.values(), strict=True):
        if with_truth:
            rows[path.stem] = [describe_error(worst_lateral_error_m(one, data.true_lane(path))) for one in results]
        elif path.name in labels:
            rows[path.stem] = [f"{label_accuracy(one, labels[path.name], camera):.0%}" for one in results]
    return format_table(list(found), rows)


def label_accuracy(result: HasLines | None, label: LaneColumns, camera: Camera) -> float:
    """Share of the labelled points of both lines that a result meets within 20 px / cos, 0 without a result."""
    lines = None if result is None else result.lateral_m(PROJECTED_AT_M)
    columns = project_lines((None, None) if lines is None else lines, camera, label.rows)
    found = LaneColumns(label.name, label.rows, columns, EGO_SIDES)
    return summarize([score_still(label, found, camera.size)])["ego accuracy"]


def _describe_differences(found: Found) -> str:
    """The median and the largest distance between any two methods on one still."""
    lines = [
        [some.lateral_m(COMPARED_AT_M) for some in results if some] for results in zip(*found.values(), strict=True)
    ]
    known = [[line for line in some if line is not None] for some in lines]
    gaps = [np.ptp(some, axis=0).max() for some in known if len(some) > 1]
    if not gaps:
        return "no truth, no labels, and no still on which two methods found a lane"
    return (
        f"no truth and no labels: the methods differ by {np.median(gaps):.2f} m (median of {len(gaps)} stills), "
        f"at most {max(gaps):.2f} m, 5 to 30 m ahead"
    )


def score_finders(
    finders: Mapping[str, OwnFinder | str], *, every: int = EVERY
) -> Iterator[tuple[str, dict[str, Row]]]:
    """Score finders on the three embedded videos: after each, its scene and a row of the benchmark's table by name.

    Parameters
    ----------
    finders : mapping of str to (callable or str)
        A function takes a raw RGB picture and the camera with its pose. It returns the left and the right line in
        metres as `np.polyfit` does (y = np.polyval(line, x)), or None where it finds no lane. Or a system of the
        benchmark by its name, for example "tracker".
    every : int
        Only each `every`-th frame is scored, of the tracker each second one; a finder with a memory needs all of them.
    """
    systems = {name: (find, TRACKER_EVERY if find == TRACKER else every) for name, find in finders.items()}
    for scene, file in COMMITTED.items():
        rows = score_systems(PROJECT_ROOT / "test_videos" / file, systems)
        yield scene, {row["system"]: row | {"scene": scene} for row in rows}
