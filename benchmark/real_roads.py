"""Hand-labelled stills: scores of every system, of stated uncertainty and confidence; and real roads of many cameras.

    python -m benchmark.real_roads FOLDER [--camera camera.yaml] [--half A] [--only own] [--workers 2]

scores each still alone, with the pose of its set, and tracked through its clip. The folder has `labels.jsonl`, and a
folder of stills of one camera for each set; a label may name a `clip` and a `frame` of it. Nothing is known about the
cameras. Choices are made on half A of the sets and confirmed on half B.
"""

from __future__ import annotations

import argparse
import hashlib
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.consistency import describe_z, z_summary
from benchmark.systems import DETECTOR, TRACKER, column_detector
from lanes.camera.field_of_view import find_field_of_view
from lanes.camera.model import Camera, load_camera
from lanes.console import bounded, progress_line
from lanes.describe import format_table, number_cells
from lanes.detect.lane import Lane
from lanes.detect.markings import Markings
from lanes.detect.road import lines_on_view, parameter_gradients, propagated_std
from lanes.drive import make_tracker, track_frames
from lanes.files import read_json_lines
from lanes.labels import EGO_SIDES, LaneColumns, read_labels
from lanes.pose.estimate import POSE_PICTURES, PoseEstimate, detect_in_drive, ensure_pose
from lanes.score import StillScore, lateral_errors_m, reliability, score_still, summarize
from lanes.tracking.tracker import TrackerSettings
from lanes.video.images import read_image
from lanes.video.reader import inspect_video, read_frames
from lanes.video.sources import find_sources, sample_images
from simulator.processes import run_all

# Ways to look at a set: each still alone; with the pose of its stills; tracked.
OWN, SET, CLIPS = WAYS = ("own", "set", "clips")
# Sets whose stills are of several cameras, so that they have no common pose.
SEVERAL_CAMERAS = ("bdd_stills", "evo_drops", "ets2")
# Distances at which lines are compared.
COMPARED_AT_M = np.array([8.0, 15.0, 25.0])
# Standard deviation of a labelled column: 95 % of the differences between two labellers are below 3.2 px.
LABEL_STD_PX = 1.6
# With a larger error another line was found.
OTHER_LINE_M = 1.0
LEGEND = """\
z: lateral error against the label, both projected to the flat road, divided by its standard deviation: that of the lane
at this picture row and 1.6 px of the label. Cells: root mean square (1 is wanted), percent within 1 and 2 (68/95).
Right: every labelled line is matched."""


@dataclass(frozen=True, eq=False)
class ScoredLane:
    """The score of what a system found for a label, and the lane with its errors if it is the engine.

    `lane` is None without one. `z` (2, 3) are errors of both lines at COMPARED_AT_M, in standard deviations of the
    position at a picture row (`row_std_m`), NaN where nothing is compared. `other_lines` is the number of errors above
    OTHER_LINE_M, which are left out.
    """

    score: StillScore
    lane: Lane | None = None
    z: np.ndarray = field(default_factory=lambda: np.full((2, len(COMPARED_AT_M)), np.nan))
    other_lines: int = 0


Finder = Callable[[np.ndarray, LaneColumns], ScoredLane]


def score_folder(
    labels: Sequence[LaneColumns],
    files: Sequence[Path],
    lens: Camera,
    systems: Sequence[str],
    *,
    markings: Markings | None = None,
) -> tuple[dict[str, list[ScoredLane]], PoseEstimate | None]:
    """Scores of each system on the labelled pictures of one camera, and its pose, estimated from them if it has none.

    Each picture is processed independently. The estimate is None if the camera had a pose. Errors are those of
    `ensure_pose`, and PictureError if a picture is not of the camera's size.
    """
    camera, pose = ensure_pose(lens, files, progress=progress_line("pose"), markings=markings)
    finders = {system: start_finder(system, camera, pose, markings=markings) for system in systems}
    scored: dict[str, list[ScoredLane]] = {system: [] for system in finders}
    report = progress_line("stills")
    for done, (label, file) in enumerate(zip(labels, files, strict=True), 1):
        image = camera.require_size(read_image(file), label.name)
        for system, find in finders.items():
            scored[system].append(find(image, label))
        report(done, len(labels))
    return scored, pose


def start_finder(system: str, camera: Camera, pose: PoseEstimate | None, **how: Any) -> Finder:
    """A function that scores a system on a picture with its label; `how` are options of `detect_in_drive`."""
    if system in (TRACKER, DETECTOR):

        def detect(image: np.ndarray, label: LaneColumns) -> ScoredLane:
            found, _ = detect_in_drive(image, camera, pose, **how)
            return score_lane(found.lane, label, found.camera)

        return detect
    columns_of = column_detector(system, camera)

    def find(image: np.ndarray, label: LaneColumns) -> ScoredLane:
        found = LaneColumns(label.name, label.rows, np.round(columns_of(image, label.rows), 1), EGO_SIDES)
        return ScoredLane(score_still(label, found, camera.size))

    return find


def lanes_of_engine(scored: Mapping[str, list[ScoredLane]]) -> list[ScoredLane]:
    """The lanes of tracker or detector, which are the same in single pictures; empty if neither is scored."""
    return scored.get(TRACKER, scored.get(DETECTOR, []))


def describe_labelled(scored: Mapping[str, Sequence[ScoredLane]]) -> str:
    """A table of the scores, a line for each system."""
    return format_table(*number_cells({name: summarize([one.score for one in some]) for name, some in scored.items()}))


def score_lane(lane: Lane | None, label: LaneColumns, camera: Camera) -> ScoredLane:
    """The score of a lane that is detected in a single picture by `camera`, whose pose it has."""
    if lane is None:
        return ScoredLane(score_still(label, None, camera.size))
    found = LaneColumns(label.name, label.rows, lane.columns(camera, label.rows), EGO_SIDES, lane.confidence)
    error_m = lateral_errors_m(label.ego_lane(camera.size), found, camera, COMPARED_AT_M)
    other = np.abs(error_m) > OTHER_LINE_M
    label_std_m = LABEL_STD_PX * COMPARED_AT_M / camera.matrix[0, 0]
    row_std = row_std_m(lane, COMPARED_AT_M, camera.require_pose().height_m)
    z = np.where(other, np.nan, error_m / np.hypot(row_std, label_std_m))
    return ScoredLane(score_still(label, found, camera.size), lane, z, int(other.sum()))


def row_std_m(lane: Lane, x_m: np.ndarray, height_m: float) -> np.ndarray:
    """Standard deviation (2, N) of the lines' lateral positions at the picture rows of distances x (N,) on a flat road.

    Pitch and width of a lane are correlated: both decide where the lines are in the picture. Errors of the pitch, which
    displace the lines on the road, hardly displace them in the picture that they are fitted to.
    """
    gradients = parameter_gradients(lambda lanes: lines_on_view(lanes, x_m, height_m), lane.model)
    return propagated_std(gradients, lane.covariance)


def describe_lanes(scored: Sequence[ScoredLane]) -> str:
    """Tables of z at each distance, and of the right lanes by confidence."""
    compared, cells = np.isfinite(all_z(scored)).sum(axis=(0, 1)), _z_cells(scored)
    rows = {f"lateral, {x:.0f} m": [f"{n}", cell] for x, n, cell in zip(COMPARED_AT_M, compared, cells, strict=True)}
    return (
        f"{format_table(('compared', 'z'), rows)}\n"
        f"left out, error above {OTHER_LINE_M:g} m: {sum(one.other_lines for one in scored)}\n"
        f"{format_table(*number_cells(reliability(one.score for one in scored)))}\n{LEGEND}"
    )


def summarize_lanes(scored: Sequence[ScoredLane]) -> str:
    """The same in one line."""
    sure = reliability(one.score for one in scored)["0.9 or more"]
    at = "/".join(f"{x:.0f}" for x in COMPARED_AT_M)
    return (
        f"z at {at} m: {', '.join(_z_cells(scored))}; 0.9 or more: {sure['right']} of {sure['lanes']} right, "
        f"{sure['of right lanes']:.0%} of the right lanes"
    )


def all_z(scored: Sequence[ScoredLane]) -> np.ndarray:
    """(N, 2, 3) z of N stills."""
    return np.array([one.z for one in scored]).reshape(-1, 2, len(COMPARED_AT_M))


def _z_cells(scored: Sequence[ScoredLane]) -> list[str]:
    """Summaries of z in words, for each distance."""
    return [describe_z(z_summary(some[np.isfinite(some)])) for some in np.moveaxis(all_z(scored), 2, 0)]


@dataclass(frozen=True, eq=False)
class RoadSet:
    """Labelled stills of one camera, and the labels of those that are a frame of a clip, by the number of the frame."""

    name: str
    folder: Path
    lens: Camera | None = None
    labels: list[LaneColumns] = field(default_factory=list)
    clips: dict[Path, dict[int, LaneColumns]] = field(default_factory=dict)

    @property
    def half(self) -> str:
        """A or B, by the hash of the name."""
        return "AB"[hashlib.sha256(self.name.encode()).digest()[0] % 2]


def read_road_sets(folder: Path, lens: Camera | None = None) -> list[RoadSet]:
    """The labelled sets in a folder, by name; `lens` is that of all of them, if it is calibrated.

    Stills named DRIVE_NUMBER in one folder "stills" are a set for each drive.
    """
    sets: dict[str, RoadSet] = {}
    file = folder / "labels.jsonl"
    for label, (_, entry) in zip(read_labels(file), read_json_lines(file, "label"), strict=True):
        drive = Path(label.name).stem.split("_")[0]
        name = f"{label.folder}/{drive}_" if label.folder == "stills" else label.folder
        roads = sets.setdefault(name, RoadSet(name, folder, lens))
        roads.labels.append(label)
        if "clip" in entry:
            roads.clips.setdefault(folder / entry["clip"], {})[int(entry["frame"])] = label
    return [sets[name] for name in sorted(sets)]


def score_set(task: tuple[RoadSet, str], settings: TrackerSettings) -> list[ScoredLane]:
    """Scores of a set's labels in one of the `WAYS`; none if the set has no common pose, or no clip."""
    roads, way = task
    if way == CLIPS:
        return [one for clip in sorted(roads.clips) for one in _score_clip(roads, clip, settings)]
    if way == SET and roads.name in SEVERAL_CAMERAS:
        return []
    files = [roads.folder / label.name for label in roads.labels]
    if way == OWN:
        pairs = zip(roads.labels, files, strict=True)
        return [one for label, file in pairs for one in _score_stills(roads, [label], [file], settings)]
    common = Counter(map(_size, files)).most_common(1)[0][0]
    name = roads.folder / roads.name
    stills = find_sources([str(name) if name.is_dir() else f"{name}*"]).stills
    return _score_stills(roads, roads.labels, [file for file in stills if _size(file) == common], settings)


def score_sets(
    sets: Sequence[RoadSet], way: str, settings: TrackerSettings | None = None, *, workers: int = 1
) -> list[list[ScoredLane]]:
    """`score_set` of each set."""
    tasks = [(roads, way) for roads in sets]
    return run_all(partial(score_set, settings=settings or TrackerSettings()), tasks, workers=workers)


def _size(file: Path) -> tuple[int, int]:
    height, width = read_image(file).shape[:2]
    return width, height


def _camera(size: tuple[int, int], file: Path) -> Camera:
    return Camera.from_fov(size, find_field_of_view([file]).across(size))


def _score_stills(
    roads: RoadSet, labels: Sequence[LaneColumns], files: Sequence[Path], settings: TrackerSettings
) -> list[ScoredLane]:
    """Scores of some labels; the pose is that of `files`, which have one size."""
    source = read_image(files[0]) if len(files) == 1 else files
    camera, pose = ensure_pose(roads.lens or _camera(_size(files[0]), files[0]), source, settings=settings.detector)
    find = start_finder(DETECTOR, camera, pose, settings=settings.detector)
    scores = []
    for label in labels:
        image = read_image(roads.folder / label.name)
        same_size = image.shape[1::-1] == camera.size
        scores.append(find(image, label) if same_size else score_lane(None, label, camera))
    return scores


def _score_clip(roads: RoadSet, clip: Path, settings: TrackerSettings) -> list[ScoredLane]:
    """Scores of the labels of a clip, which is tracked up to its last labelled frame."""
    scores, labels, info = [], roads.clips[clip], inspect_video(clip)
    camera = _camera((info.width, info.height), clip)
    camera, pose = ensure_pose(camera, sample_images([clip], POSE_PICTURES), settings=settings.detector)
    tracker = make_tracker(info.fps, camera, pose, None, settings)
    with closing(read_frames(clip, info)) as frames:
        for number, _ in enumerate(track_frames(frames, tracker)):
            if number in labels:
                label = _at_size(roads.folder, labels[number], tracker.camera.size)
                scores.append(score_lane(tracker.tracked_lane, label, tracker.camera))
            if number == max(labels):
                break
    return scores


def _at_size(folder: Path, label: LaneColumns, size: tuple[int, int]) -> LaneColumns:
    """A label of a still as one of the clip's frames, which have another width if the clip's pixels are not square."""
    width, height = _size(folder / label.name)
    columns = np.where(label.columns >= 0, label.columns * size[0] / width, label.columns)
    return replace(label, columns=columns, rows=label.rows * size[1] / height)


def describe(sets: Sequence[RoadSet], way: str, scored: Sequence[Sequence[ScoredLane]]) -> str:
    """A table with a row for each set, then for the sets of each half and for all."""
    known = [(roads, [one.score for one in found]) for roads, found in zip(sets, scored, strict=True) if found]
    groups = {f"{roads.half} {roads.name}": [scores] for roads, scores in known}
    groups |= {f"{way} {half}": [scores for roads, scores in known if roads.half in half] for half in ("A", "B", "AB")}
    return format_table(*number_cells({name: _summary(some) for name, some in groups.items() if some}))


def _summary(sets: Sequence[Sequence[StillScore]]) -> dict[str, float]:
    """Mean and lowest share of right points of the sets, and the right images of all of them."""
    points = [summarize(scores)["ego accuracy"] for scores in sets]
    every = [score for scores in sets for score in scores]
    right, sure = [score.right for score in every if score.right is not None], reliability(every)["0.9 or more"]
    images = {"images": len(right), "right": sum(right), "right share": float(np.mean(right))}
    confident = {"0.9 or more": sure["lanes"], "of them right": sure["right"], "of right lanes": sure["of right lanes"]}
    return {"points": float(np.mean(points)), "lowest": min(points)} | images | confident


def add_road_arguments(parser: argparse.ArgumentParser, *, optional: bool = False) -> None:
    """Add the options that choose labelled sets."""
    folder = "has labels.jsonl, and a folder of stills for each set"
    parser.add_argument("folder", type=Path, nargs="?" if optional else None, help=folder)
    parser.add_argument("--half", choices=("A", "B", "AB"), default="AB", help="of the sets (default: both halves)")
    parser.add_argument("--workers", type=bounded(int, 1), default=1, metavar="N", help="processes")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_road_arguments(parser)
    parser.add_argument("--camera", type=load_camera, help="the lens of all stills (default: unknown cameras)")
    parser.add_argument("--only", choices=WAYS, help="one way to look at the sets (default: all)")


def main() -> None:
    """Score the sets, and print a table for each way to look at them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser)
    options = parser.parse_args()
    sets = [roads for roads in read_road_sets(options.folder, options.camera) if roads.half in options.half]
    for way in [options.only] if options.only else WAYS:
        print(describe(sets, way, score_sets(sets, way, workers=options.workers)))


if __name__ == "__main__":
    main()
