"""The accuracy of several methods on the stills of the course, in one table.

Three kinds of data are possible: stills with truth (the embedded ones), stills with hand-made labels (`labels.jsonl`),
and stills with neither. The table shows the strongest comparison that the data allow.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchmark.systems import PROJECTED_AT_M, project_lines
from course.dataset import Dataset
from course.measures import HasLines, describe_error, worst_lateral_error_m
from lanes.camera import Camera
from lanes.describe import format_table
from lanes.labels import EGO_SIDES, LaneColumns
from lanes.score import score_still, summarize

# Distances at which two methods are compared with each other, metres.
COMPARED_AT_M = np.arange(5.0, 31.0, 5.0)
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
    stills, labels = data.stills, data.labels()
    if any(data.true_lane(path) for path in stills):
        rows = {
            path.stem: [
                describe_error(worst_lateral_error_m(results[k], data.true_lane(path))) for results in found.values()
            ]
            for k, path in enumerate(stills)
        }
        return format_table(list(found), rows)
    if labels:
        rows = {
            path.stem: [f"{label_accuracy(results[k], labels[path.name], camera):.0%}" for results in found.values()]
            for k, path in enumerate(stills)
            if path.name in labels
        }
        return format_table(list(found), rows)
    return _describe_differences(found)


def label_accuracy(result: HasLines | None, label: LaneColumns, camera: Camera) -> float:
    """Share of the labelled points of both lines that a result meets within 20 px / cos, 0 without a result."""
    lines = None if result is None else result.lateral_m(PROJECTED_AT_M)
    no_lines = np.full((2, len(label.rows)), -2.0)
    columns = no_lines if lines is None else project_lines(lines, camera, label.rows)
    found = LaneColumns(label.name, label.rows, columns, EGO_SIDES)
    return summarize([score_still(label, found, camera.size)])["ego accuracy"]


def _describe_differences(found: Found) -> str:
    """The median and the largest distance between any two methods on one still."""
    gaps = []
    for results in zip(*found.values(), strict=True):
        lines = [
            line for line in (result and result.lateral_m(COMPARED_AT_M) for result in results) if line is not None
        ]
        gaps += [np.ptp(lines, axis=0).max()] if len(lines) > 1 else []
    if not gaps:
        return "no truth, no labels, and no still on which two methods found a lane"
    return (
        f"no truth and no labels: the methods differ by {np.median(gaps):.2f} m (median of {len(gaps)} stills), "
        f"at most {max(gaps):.2f} m, 5 to 30 m ahead"
    )
