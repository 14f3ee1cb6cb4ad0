"""Results of the course against the truth: lateral errors of lanes, and accuracy.

Truth is a frame of truth.json (see course.dataset): points of both lines in the road
frame, metres. Stills are with truth (the embedded ones), with hand-made labels
(`labels.jsonl`), or with neither; the table of the accuracy of several methods shows
the strongest comparison that the data allow.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from benchmark.evaluation import COMMITTED, PROJECT_ROOT, score_systems
from benchmark.scores import Row
from benchmark.systems import PROJECTED_AT_M, TRACKER, OwnFinder
from course.dataset import Dataset
from helpers import (
    FourPointWarp,
    Lens,
    distort_points,
    finite_points,
    road_to_pixels,
)
from lanes.describe import format_table
from lanes.labels import EGO_SIDES, LaneColumns
from lanes.score import score_still, summarize


class HasLines(Protocol):
    """A result with two lane lines."""

    def lateral_m(self, x_m: np.ndarray) -> np.ndarray | None:
        """Lateral positions (2, N) of left and right line at distances (N,), metres.

        None without both lines.
        """


def lane_widths_px(
    warp: FourPointWarp,
    image_to_road: np.ndarray,
    lines_m: ArrayLike,
    x_m: ArrayLike,
) -> np.ndarray:
    """Width (N,) of a straight lane in columns of the bird's-eye view.

    It is negative where the view is mirrored.

    Parameters
    ----------
    image_to_road : ndarray of shape (3, 3)
        Homography of `helpers.road_homography`.
    lines_m : array_like of shape (2, 2)
        Lateral position at the car, metres, and heading, of the left and right line.
    x_m : array_like of shape (N,)
        Distances ahead, metres.
    """
    distances_m = np.asarray(x_m, float)
    columns = []
    for position_m, heading in np.asarray(lines_m, float):
        y_m = position_m + heading * distances_m
        points_m = np.column_stack([distances_m, y_m])
        pixels = road_to_pixels(points_m, image_to_road)
        view_px = warp.points_to_birdseye(pixels)
        columns.append(view_px[:, 0])
    left, right = columns
    return right - left


def describe_error(error_m: float | None) -> str:
    """An error in words: "0.12 m", "lost" if infinite, "unknown" if None (no truth)."""
    if error_m is None:
        return "unknown"
    return f"{error_m:.2f} m" if np.isfinite(error_m) else "lost"


def check(
    name: str,
    measured: float,
    truth: float | None,
    unit: str,
    *,
    within: float,
    digits: int = 2,
) -> str:
    """Compare a number with the truth, which is None if unknown, as for real images.

    Returns "offset: 0.12 m, truth 0.10 m, off by 0.02 m (allowed 0.05 m)", with
    `digits` decimals. Raises AssertionError if the difference to a known truth is
    larger than `within`, in `unit`.
    """
    number = f"{name}: {measured:.{digits}f} {unit}"
    if truth is None:
        return f"{number} (no truth known for these pictures)"
    comparison = f"{number}, truth {truth:.{digits}f} {unit}, off by"
    return require_below(comparison, abs(measured - truth), unit, within, digits)


def check_error(
    name: str, error: float | None, unit: str, *, within: float, digits: int = 1
) -> str:
    """Compare an error with the largest one allowed; it is None without truth.

    Returns "paint, median: error 0.1 px (allowed 1 px)", with `digits` decimals. Raises
    AssertionError if the error is larger than `within`.
    """
    if error is None:
        return f"{name}: error not known (no truth for these pictures)"
    return require_below(f"{name}: error", error, unit, within, digits)


def require_below(
    text: str, error: float, unit: str, within: float, digits: int
) -> str:
    """The sentence with an error and its limit; AssertionError if it is above it."""
    sentence = f"{text} {error:.{digits}f} {unit} (allowed {within:g} {unit})"
    if not error <= within:  # NaN is above it, too
        raise AssertionError(sentence)
    return sentence


# Distances at which two methods are compared with each other, metres.
COMPARED_AT_M = np.arange(5.0, 31.0, 5.0)
# Videos: the tracker has a memory; it gets more frames than a finder without one.
EVERY = 10
TRACKER_EVERY = 2

Found = Mapping[str, Sequence[HasLines | None]]
ErrorOf = Callable[[HasLines | None, dict], float]


@dataclass(frozen=True)
class TwoLines:
    """Two lines of `np.polyfit`: y = np.polyval(line, x), x forward, y left, metres."""

    left: Sequence[float]
    right: Sequence[float]

    def lateral_m(self, x_m: np.ndarray) -> np.ndarray:
        """Lateral positions (2, N) of both lines at distances (N,), metres."""
        return np.array([np.polyval(self.left, x_m), np.polyval(self.right, x_m)])


def accuracy_table(
    found: Found,
    data: Dataset,
    error_of: ErrorOf,
    lens: Lens,
    image_to_road: np.ndarray,
) -> str:
    """A table of the results of each method on each still.

    With truth a cell is the largest lateral error, or "lost". With hand-made labels it
    is the share of labelled points within TuSimple's tolerance, 20 px / cos of the
    angle of the line. With neither, one line says how far the methods differ.

    Parameters
    ----------
    found : mapping of str to sequence
        For each method its results of `data.stills`, None where it found nothing.
    error_of : callable
        The error of a result in metres, infinite if it is lost, from the result and the
        entry of the still in truth.json.
    lens, image_to_road
        They project the lines into the image, to compare them with labels.
    """
    rows = {}
    labels = data.labels()
    for number, path in enumerate(data.stills):
        results = [of_method[number] for of_method in found.values()]
        truth = data.true_lane(path)
        label = labels.get(path.name)
        if truth is not None:
            cells = [describe_error(error_of(result, truth)) for result in results]
            rows[path.stem] = cells
        elif label is not None:
            shares = [
                label_accuracy(result, label, lens, image_to_road) for result in results
            ]
            rows[path.stem] = [f"{share:.0%}" for share in shares]
    if not rows:
        return describe_differences(found)
    return format_table(list(found), rows)


def label_accuracy(
    result: HasLines | None, label: LaneColumns, lens: Lens, image_to_road: np.ndarray
) -> float:
    """Share of the labelled points that a result meets within 20 px / cos."""
    columns = np.full((2, len(label.rows)), -2.0)
    lateral_m = None if result is None else result.lateral_m(PROJECTED_AT_M)
    if lateral_m is not None:
        for side, y_m in enumerate(lateral_m):
            line_m = np.column_stack([PROJECTED_AT_M, y_m])
            columns[side] = columns_of_line(line_m, label.rows, lens, image_to_road)
    found = LaneColumns(label.name, label.rows, columns, EGO_SIDES)
    return summarize([score_still(label, found, lens.size)])["ego accuracy"]


def columns_of_line(
    line_m: np.ndarray, rows: np.ndarray, lens: Lens, image_to_road: np.ndarray
) -> np.ndarray:
    """Columns (R,) in the raw image, at its rows (R,), of a line (N, 2) on the road.

    The points of the line go from near to far. -2 where the line does not pass.
    """
    flat_px = road_to_pixels(line_m, image_to_road)
    raw_px = distort_points(flat_px, lens)
    seen_px = finite_points(raw_px)
    if not len(seen_px):
        return np.full(len(rows), -2.0)

    # a line goes up in the image with the distance, as far as it is seen
    highest = int(seen_px[:, 1].argmin())
    u, v = seen_px[: highest + 1][::-1].T
    columns = np.interp(rows, v, u, left=-2, right=-2)
    is_inside = (columns >= 0) & (columns <= lens.size[0] - 1)
    return np.where(is_inside, columns, -2.0)


def describe_differences(found: Found) -> str:
    """The median and the largest distance between any two methods on one still."""
    gaps_m = []
    for results in zip(*found.values(), strict=True):
        lines_m = []
        for result in results:
            lateral_m = None if result is None else result.lateral_m(COMPARED_AT_M)
            if lateral_m is not None:
                lines_m.append(lateral_m)
        if len(lines_m) > 1:
            gaps_m.append(np.ptp(lines_m, axis=0).max())
    if not gaps_m:
        return "no truth, no labels, and no still on which two methods found a lane"
    return (
        f"no truth and no labels: the methods differ by {np.median(gaps_m):.2f} m "
        f"(median of {len(gaps_m)} stills), at most {max(gaps_m):.2f} m, 5 to 30 m "
        "ahead"
    )


def score_finders(
    finders: Mapping[str, OwnFinder | str], *, every: int = EVERY
) -> Iterator[tuple[str, dict[str, Row]]]:
    """Score finders on the three embedded videos.

    Yields after each video its scene, and a row of the benchmark's table by name.

    Parameters
    ----------
    finders : mapping of str to (callable or str)
        A function takes a raw RGB image and the camera with its pose. It returns the
        left and the right line in metres as `np.polyfit` does (y = np.polyval(line,
        x)), or None where it finds no lane. Or a system of the benchmark by its name,
        for example "tracker".
    every : int
        Only each `every`-th frame is scored, of the tracker each second one; a finder
        with a memory needs all of them.
    """
    systems = {}
    for name, finder in finders.items():
        systems[name] = (finder, TRACKER_EVERY if finder == TRACKER else every)
    for scene, file in COMMITTED.items():
        scored = score_systems(PROJECT_ROOT / "test_videos" / file, systems)
        rows = {}
        for row in scored:
            rows[row["system"]] = row | {"scene": scene}
        yield scene, rows
