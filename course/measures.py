"""Results of the course against the truth: lateral errors of lanes, precision and recall of marking pixels, accuracy.

Truth is a frame of truth.json (see course.dataset): points of both lines in the road frame, metres. Stills are with
truth (the embedded ones), with hand-made labels (`labels.jsonl`), or with neither; the table of the accuracy of several
methods shows the strongest comparison that the data allow.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from benchmark.evaluation import COMMITTED, PROJECT_ROOT, score_systems
from benchmark.scores import Row
from benchmark.systems import PROJECTED_AT_M, TRACKER, OwnFinder, project_lines
from course.dataset import Dataset
from helpers import FourPointWarp
from lanes.camera.model import Camera
from lanes.describe import format_table
from lanes.labels import EGO_SIDES, LaneColumns
from lanes.score import score_still, summarize

# The range that a driver needs: from the bonnet to about a second ahead on a motorway.
NEAR_M, FAR_M = 5.0, 30.0
# Ends of the steps of a line that have a marking on them, or not.
STEPS_M = np.arange(NEAR_M, FAR_M + 0.1, 0.5)
# Points count up to the first distance outside the lane. A point within the second one of the centre of a line lies on
# it: half the width of a line, and the same again for blur.
MARGIN_M, TOLERANCE_M = 1.0, 0.2


class HasLines(Protocol):
    """A result with two lane lines."""

    def lateral_m(self, x_m: np.ndarray) -> np.ndarray | None:
        """Lateral positions (2, N) of the left and right line at distances (N,), metres; None without both lines."""


def worst_lateral_error_m(result: HasLines | None, truth: dict | None) -> float | None:
    """Largest lateral distance between detected and true lines, 5 to 30 m ahead, metres.

    Infinite if a line was not detected, because one line is no lane. None if both were detected but there is no truth.
    """
    x_m = np.array(truth["x_m"] if truth else [NEAR_M])
    ahead = (x_m >= NEAR_M) & (x_m <= FAR_M)
    detected = result and result.lateral_m(x_m[ahead])
    if detected is None:
        return np.inf
    if truth is None:
        return None
    true = np.array([truth["left_y_m"], truth["right_y_m"]])[:, ahead]
    return float(np.abs(detected - true).max())


def lane_widths_px(warp: FourPointWarp, camera: Camera, lines_m: ArrayLike, x_m: ArrayLike) -> np.ndarray:
    """Width (N,), in columns of the bird's-eye view, of a straight lane at distances (N,), metres.

    It is negative where the view is mirrored.

    Parameters
    ----------
    lines_m : array_like of shape (2, 2)
        Lateral position at the car, metres, and heading, of the left and the right line.
    """
    x = np.asarray(x_m, float)
    lines = (np.column_stack([x, c0 + heading * x]) for c0, heading in np.asarray(lines_m, float))
    left, right = (warp.points_to_birdseye(camera.undistort_points(camera.road_to_pixels(line))) for line in lines)
    return right[:, 0] - left[:, 0]


class ComparedMarkings(NamedTuple):
    """N points compared with S steps of the true lines of the ego lane.

    Whether a point counts for the precision (N,), and lies on the left or the right line (2, N); whether a step of
    these lines has a point on it (2, S).
    """

    counted: np.ndarray
    on_line: np.ndarray
    covered: np.ndarray


def compare_markings(points_m: np.ndarray, truth: dict) -> ComparedMarkings:
    """Compare marking points (N, 2) with the truth; see `marking_precision` and `marking_recall`."""
    x, y = np.asarray(points_m, float).reshape(-1, 2).T
    left, right = lines = np.array([np.interp(x, truth["x_m"], truth[key]) for key in ("left_y_m", "right_y_m")])
    counted = (x >= NEAR_M) & (x <= FAR_M) & (y < left + MARGIN_M) & (y > right - MARGIN_M)
    on_line: np.ndarray = np.abs(y - lines) <= TOLERANCE_M
    return ComparedMarkings(counted, on_line, np.array([np.histogram(x[on], STEPS_M)[0] > 0 for on in on_line]))


def marking_precision(points_m: np.ndarray, truth: dict | None) -> float | None:
    """Precision of marking points: the share of them that lies on a line of the ego lane, in range 0..1.

    The points (N, 2) 5 to 30 m ahead (x forward, y left, metres) count, in the ego lane and up to 1 m outside it. A
    point lies on a line if it is within 0.2 m of its centre. None without truth, which is a frame of truth.json, or
    without any point in that range.
    """
    if truth is None:
        return None
    compared = compare_markings(points_m, truth)
    on_line = compared.on_line[:, compared.counted].any(axis=0)
    return float(on_line.mean()) if on_line.size else None


def marking_recall(points_m: np.ndarray, truth: dict | None) -> float | None:
    """Recall of marking points: the share of both lines, 5 to 30 m ahead, with a point on it; None without truth.

    The lines are divided into steps of half a metre. Gaps of a dashed line count as well, so its recall cannot exceed
    the share of its dashes unless noise fills the gaps.
    """
    return None if truth is None else float(compare_markings(points_m, truth).covered.mean())


def describe_error(error_m: float | None) -> str:
    """An error in words: "0.12 m", "lost" if infinite (no lane), "unknown" if None (no truth)."""
    if error_m is None:
        return "unknown"
    return f"{error_m:.2f} m" if np.isfinite(error_m) else "lost"


def check(name: str, measured: float, truth: float | None, unit: str, *, within: float, digits: int = 2) -> str:
    """Compare a number with the truth: "offset: 0.12 m, truth 0.10 m, off by 0.02 m (allowed 0.05 m)".

    The difference may be `within` at most, in `unit`; `truth` is None if unknown, as for real pictures. `digits` are
    the decimals printed. Raises AssertionError if the difference to a known truth is larger than `within`.
    """
    if truth is None:
        return f"{name}: {measured:.{digits}f} {unit} (no truth known for these pictures)"
    error = abs(measured - truth)
    return _require_below(
        f"{name}: {measured:.{digits}f} {unit}, truth {truth:.{digits}f} {unit}, off by", error, unit, within, digits
    )


def check_error(name: str, error: float | None, unit: str, *, within: float, digits: int = 1) -> str:
    """Compare an error with the largest one allowed: "paint, median: error 0.1 px (allowed 1 px)".

    `error` is None if no truth is known, as for real pictures. `digits` are the decimals printed. Raises AssertionError
    if the error is larger than `within`.
    """
    if error is None:
        return f"{name}: error not known (no truth for these pictures)"
    return _require_below(f"{name}: error", error, unit, within, digits)


def _require_below(said: str, error: float, unit: str, within: float, digits: int) -> str:
    sentence = f"{said} {error:.{digits}f} {unit} (allowed {within:g} {unit})"
    if not error <= within:
        raise AssertionError(sentence)
    return sentence


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
    stills = zip(*found.values(), strict=True)
    lines = [[some.lateral_m(COMPARED_AT_M) for some in results if some] for results in stills]
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
