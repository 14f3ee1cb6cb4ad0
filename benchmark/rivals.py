"""Lane finders side by side: one scorer, the same labelled stills of real roads.

    python -m benchmark.rivals FOLDER [--network model.onnx] [--half A] [--workers 2]
        [--several-cameras NAME,...]

The folder is that of `benchmark.real_roads`. The rivals are a Hough transform, the
recipes of the course, a network by itself, our engine, and our engine with the network
as its eye. Nothing is known about the cameras; rivals that need a pose get the one that
our engine estimates from the stills of the set. Sets of --several-cameras have no
common pose and are left out. Each rival runs in a process of its own, on one thread.
"""

from __future__ import annotations

import argparse
import multiprocessing
import time
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from benchmark.real_roads import RoadSet, add_road_arguments, choose_road_sets
from benchmark.rivals_lines import PROJECT_HORIZON, hough_columns, mask_columns
from benchmark.systems import RECIPE_SYSTEMS, column_detector
from lanes.camera.field_of_view import find_field_of_view
from lanes.camera.model import Camera
from lanes.describe import format_table
from lanes.detect.markings import (
    MarkingSource,
    crop_rows,
    horizon_row,
    load_markings,
)
from lanes.labels import EGO_SIDES, NO_POINT, LaneColumns
from lanes.pose.estimate import (
    PoseEstimate,
    detect_in_drive,
    estimate_pose,
)
from lanes.score import StillScore, reliability, score_still, summarize
from lanes.video.images import opencv_threads, read_image
from simulator.processes import run_all

# From an image and rows (R,): columns (2, R) of both lines, and the stated confidence.
Find = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, float | None]]
# The finder for the images of a camera with the pose of its set.
Start = Callable[[Camera, PoseEstimate], Find]

LEGEND = """\
Points: share of the labelled points that are matched, mean of the sets; A, B: of half
A and half B of the sets. Right: stills with all labelled lines matched. 0.9: right
stills of those stated with a confidence of 0.9 or more. ms: CPU time of an image,
median, one thread, without the pose of the set. MB: peak memory of the process, with
Python and its libraries (Linux)."""


@dataclass(frozen=True, eq=False)
class PosedSet:
    """A labelled set, its camera with the pose of the set, and the estimate of it."""

    roads: RoadSet
    camera: Camera
    pose: PoseEstimate


@dataclass(frozen=True, eq=False)
class Measured:
    """The scores of a rival in each set, CPU time of each image, and peak memory.

    The memory is NaN where the system does not state it.
    """

    scores: list[list[StillScore]]
    times_ms: list[float]
    peak_mb: float


# The rivals.


def start_hough(camera: Camera, _: PoseEstimate, *, with_pose: bool) -> Find:
    """The Hough lines, with the usual horizon or that of the pose."""
    horizon = PROJECT_HORIZON
    if with_pose:
        horizon = horizon_row(camera) / camera.height

    def find(image: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, None]:
        return hough_columns(image, rows, horizon), None

    return find


def start_recipe(camera: Camera, _: PoseEstimate, *, system: str) -> Find:
    """A recipe of the course: a name of `RECIPE_SYSTEMS`."""
    columns_of = column_detector(system, camera)

    def find(image: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, None]:
        return columns_of(image, rows), None

    return find


def start_network(camera: Camera, _: PoseEstimate, *, source: MarkingSource) -> Find:
    """The lines of the mask of a network, without our engine."""
    covers = source.window_rows(camera)

    def find(image: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, None]:
        mask = source.find_mask(crop_rows(image, covers))
        return mask_columns(mask, rows, covers=covers, size=camera.size), None

    return find


def start_engine(
    camera: Camera,
    pose: PoseEstimate,
    *,
    own_pose: bool = False,
    markings: MarkingSource | None = None,
) -> Find:
    """Our engine with the pose of the set, or with one estimated from each image."""

    def find(image: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, float]:
        used = pose
        if own_pose:
            used = estimate_pose(image, camera, markings=markings)
        found, _ = detect_in_drive(image, used.camera, used, markings)
        if found.lane is None:
            return np.full((2, len(rows)), float(NO_POINT)), 0.0
        return found.lane.columns(found.camera, rows), found.lane.confidence

    return find


def list_rivals(network: MarkingSource | None = None) -> dict[str, Start]:
    """The start of each rival by name, those of the network only if there is one."""
    rivals: dict[str, Start] = {
        "Hough lines": partial(start_hough, with_pose=False),
        "Hough lines, horizon of the pose": partial(start_hough, with_pose=True),
    }
    for system in RECIPE_SYSTEMS:
        rivals[system] = partial(start_recipe, system=system)
    looks: dict[str, MarkingSource] = {}
    if network:
        name = Path(str(network)).name
        looks[f"{name}, whole image"] = replace(network, window=None)
        if network.window:
            looks[f"{name}, window"] = network
    for name, source in looks.items():
        rivals[name] = partial(start_network, source=source)
    rivals["ours, own pose"] = partial(start_engine, own_pose=True)
    rivals["ours, pose of the set"] = start_engine
    for name, source in looks.items():
        joined = replace(source, with_own=True)
        rivals[f"ours with {name}"] = partial(start_engine, markings=joined)
    return rivals


# Their measurement.


def pose_of_set(roads: RoadSet) -> PosedSet:
    """The pose of a set, estimated from all its stills of the most common size.

    Labels of stills of another size are left out.
    """
    sizes = {file: read_image(file).shape[1::-1] for file in roads.stills()}
    [(size, _)] = Counter(sizes.values()).most_common(1)
    files = [file for file, found in sizes.items() if found == size]
    hfov_deg = find_field_of_view(files[:1]).across(size)
    pose = estimate_pose(files, roads.lens or Camera.from_fov(size, hfov_deg))
    labels = []
    for label in roads.labels:
        if sizes[roads.folder / label.name] == size:
            labels.append(label)
    return PosedSet(replace(roads, labels=labels), pose.camera, pose)


def measure(start: Start, sets: Sequence[PosedSet]) -> Measured:
    """The scores of a rival, and what it takes; called in a process of its own."""
    scores = []
    times_ms = []
    with opencv_threads(1):
        for posed in sets:
            find = start(posed.camera, posed.pose)
            of_set = []
            for label in posed.roads.labels:
                image = read_image(posed.roads.folder / label.name)
                begin_s = time.process_time()
                columns, confidence = find(image, label.rows)
                times_ms.append(1e3 * (time.process_time() - begin_s))
                found = LaneColumns(
                    label.name, label.rows, columns, EGO_SIDES, confidence
                )
                of_set.append(score_still(label, found, posed.camera.size))
            scores.append(of_set)
    return Measured(scores, times_ms, peak_memory_mb())


def peak_memory_mb() -> float:
    """Largest resident memory of this process so far; NaN if it is not known."""
    status = Path("/proc/self/status")
    if status.is_file():
        for line in status.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024
    return float("nan")


def measure_all(
    rivals: dict[str, Start], sets: Sequence[PosedSet], *, workers: int = 1
) -> dict[str, Measured]:
    """`measure` of each rival, in a new process each, so that its memory is its own."""
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, spawn, max_tasks_per_child=1) as pool:
        results = pool.map(partial(measure, sets=sets), rivals.values())
        return dict(zip(rivals, results, strict=True))


def describe_rivals(measured: dict[str, Measured], halves: Sequence[str]) -> str:
    """The table; `halves` are those of the sets, A or B."""
    rows = {}
    for name, of_rival in measured.items():
        points = []
        every: list[StillScore] = []
        for scores in of_rival.scores:
            points.append(summarize(scores)["ego accuracy"])
            every += scores
        right = [score.right for score in every if score.right is not None]
        sure = reliability(every)["0.9 or more"]
        cells = [f"{np.mean(points):.3f}"]
        for half in ("A", "B"):
            of_half = [
                value
                for value, in_half in zip(points, halves, strict=True)
                if in_half == half
            ]
            cells.append(f"{np.mean(of_half):.3f}" if of_half else "-")
        cells.append(f"{min(points):.3f}")
        cells.append(f"{sum(right)} of {len(right)}")
        cells.append(f"{sure['right']} of {sure['lanes']}" if sure["lanes"] else "-")
        cells.append(f"{np.median(of_rival.times_ms):.0f}")
        cells.append(f"{of_rival.peak_mb:.0f}")
        rows[name] = cells
    headings = ["points", "A", "B", "worst set", "right", "0.9", "ms", "MB"]
    return f"{format_table(headings, rows)}\n{LEGEND}"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_road_arguments(parser)
    parser.add_argument(
        "--network",
        type=load_markings,
        metavar="MODEL.onnx",
        help="a rival, and an eye of ours (docs/own_network.md)",
    )


def main() -> None:
    """Measure the rivals, and print their table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add_arguments(parser)
    options = parser.parse_args()
    chosen = choose_road_sets(options)
    roads = [of_one for of_one in chosen if not of_one.several_cameras]
    sets = run_all(pose_of_set, roads, workers=options.workers)
    rivals = list_rivals(options.network)
    measured = measure_all(rivals, sets, workers=options.workers)
    print(describe_rivals(measured, [of_one.half for of_one in roads]))


if __name__ == "__main__":
    main()
