"""Hand-labelled stills: scores of every system, of stated uncertainty and confidence; and real roads of many cameras.

    python -m benchmark.real_roads FOLDER [--camera camera.yaml] [--half A] [--only own] [--workers 2]

scores each still alone, with the pose of its set, and tracked through its clip. The folder has `labels.jsonl`, and a
folder of stills of one camera for each set; a label may name a `clip` and a `frame` of it. Nothing is known about the
cameras. Choices are made on half A of the sets and confirmed on half B.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from collections import Counter
from collections.abc import Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.consistency import describe_z, z_summary
from benchmark.systems import DETECTOR, TRACKER, ColumnDetector, column_detector
from lanes.camera import Camera, load_camera
from lanes.console import bounded, progress_line
from lanes.describe import format_table, number_cells
from lanes.detect.lane import Lane
from lanes.detect.markings import Markings
from lanes.detect.road import lines_on_view, parameter_gradients, propagated_std
from lanes.drive import make_tracker, track_frames
from lanes.field_of_view import find_field_of_view
from lanes.images import read_image
from lanes.labels import EGO_SIDES, LaneColumns, read_labels
from lanes.pose import POSE_PICTURES, PoseEstimate, detect_in_drive, ensure_pose
from lanes.score import StillScore, lateral_errors_m, reliability, score_still, summarize
from lanes.sources import find_sources, sample_images
from lanes.tracking.tracker import TrackerSettings
from lanes.video.reader import inspect_video, read_frames
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
    """The lane found for a label, None without one, its score, and its errors.

    `z` (2, 3) are errors of both lines at COMPARED_AT_M, in standard deviations of the position at a picture row
    (`row_std_m`), NaN where nothing is compared. `other_lines` is the number of errors above OTHER_LINE_M, which are
    left out.
    """

    score: StillScore
    lane: Lane | None
    z: np.ndarray
    other_lines: int = 0


@dataclass(frozen=True, eq=False)
class LabelledFolder:
    """Scores of each system on the labelled stills of one camera, the lanes of the engine, and the pose.

    `engine` is empty if neither tracker nor detector is scored; `estimate` is None if the camera had a pose.
    """

    scores: dict[str, list[StillScore]]
    engine: list[ScoredLane]
    estimate: PoseEstimate | None


def score_folder(
    labels: Sequence[LaneColumns],
    files: Sequence[Path],
    lens: Camera,
    systems: Sequence[str],
    *,
    markings: Markings | None = None,
) -> LabelledFolder:
    """Scores on the labelled pictures of one camera, whose pose is estimated from them if it has none.

    Each picture is processed independently. Errors are those of `ensure_pose`, and PictureError if a picture is not of
    the camera's size.
    """
    camera, estimate = ensure_pose(lens, files, progress=progress_line("pose"), markings=markings)
    others = {system: column_detector(system, camera) for system in systems if system not in (TRACKER, DETECTOR)}
    scores: dict[str, list[StillScore]] = {system: [] for system in systems}
    engine: list[ScoredLane] = []
    report = progress_line("stills")
    for done, (label, file) in enumerate(zip(labels, files, strict=True), 1):
        image = camera.require_size(read_image(file), label.name)
        if len(others) < len(systems):
            engine.append(_detect(image, label, camera, estimate, markings=markings))
        for system, some in scores.items():
            some.append(_score(label, others[system], image, camera) if system in others else engine[-1].score)
        report(done, len(labels))
    return LabelledFolder(scores, engine, estimate)


def _detect(image: np.ndarray, label: LaneColumns, camera: Camera, pose: PoseEstimate | None, **how: Any) -> ScoredLane:
    found, _ = detect_in_drive(image, camera, pose, **how)
    return score_lane(found.lane, label, found.camera)


def _score(label: LaneColumns, columns_of: ColumnDetector, image: np.ndarray, camera: Camera) -> StillScore:
    found = LaneColumns(label.name, label.rows, np.round(columns_of(image, label.rows), 1), EGO_SIDES)
    return score_still(label, found, camera.size)


def describe_labelled(folders: Sequence[LabelledFolder]) -> str:
    """A table of the scores on the stills of all cameras, a line for each system."""
    scores = {system: [one for folder in folders for one in folder.scores[system]] for system in folders[0].scores}
    return format_table(*number_cells({system: summarize(some) for system, some in scores.items()}))


def score_lane(lane: Lane | None, label: LaneColumns, camera: Camera) -> ScoredLane:
    """The score of a lane that is detected in a single picture by `camera`, whose pose it has."""
    if lane is None:
        return ScoredLane(score_still(label, None, camera.size), None, np.full((2, len(COMPARED_AT_M)), np.nan))
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
    """Labelled stills of one camera. `frames` are the clip and frame of each label, if it has one."""

    name: str
    folder: Path
    labels: tuple[LaneColumns, ...]
    frames: tuple[tuple[Path, int] | None, ...]
    lens: Camera | None = None

    @property
    def half(self) -> str:
        """A or B, by the hash of the name."""
        return "AB"[hashlib.sha256(self.name.encode()).digest()[0] % 2]


def read_road_sets(folder: Path, lens: Camera | None = None) -> list[RoadSet]:
    """The labelled sets in a folder, by name; `lens` is that of all of them, if it is calibrated.

    Stills named DRIVE_NUMBER in one folder "stills" are a set for each drive.
    """
    sets: dict[str, list[tuple[LaneColumns, tuple[Path, int] | None]]] = {}
    lines = filter(str.strip, (folder / "labels.jsonl").read_text().split("\n"))
    for label, line in zip(read_labels(folder / "labels.jsonl"), lines, strict=True):
        entry = json.loads(line)
        frame = (folder / entry["clip"], int(entry["frame"])) if "clip" in entry else None
        drive = Path(label.name).stem.split("_")[0]
        name = f"{label.folder}/{drive}_" if label.folder == "stills" else label.folder
        sets.setdefault(name, []).append((label, frame))
    labels_frames = {name: tuple(zip(*some, strict=True)) for name, some in sorted(sets.items())}
    return [RoadSet(name, folder, labels, frames, lens) for name, (labels, frames) in labels_frames.items()]


def score_set(task: tuple[RoadSet, str], settings: TrackerSettings) -> list[ScoredLane]:
    """Scores of a set's labels in one of the `WAYS`; none if the set has no common pose, or no clip."""
    roads, way = task
    if way == CLIPS:
        return _score_clips(roads, settings)
    if way == SET and roads.name in SEVERAL_CAMERAS:
        return []
    files = [roads.folder / label.name for label in roads.labels]
    sizes = [read_image(file).shape[1::-1] for file in files]
    if way == OWN:
        return [_score_stills(roads, [k], [files[k]], settings)[0] for k in range(len(files))]
    common = Counter(sizes).most_common(1)[0][0]
    name = roads.folder / roads.name
    stills = find_sources([str(name) if name.is_dir() else f"{name}*"]).stills
    used = [file for file in stills if read_image(file).shape[1::-1] == common]
    return _score_stills(roads, range(len(files)), used, settings)


def score_sets(
    sets: Sequence[RoadSet], way: str, settings: TrackerSettings | None = None, *, workers: int = 1
) -> list[list[ScoredLane]]:
    """`score_set` of each set."""
    tasks = [(roads, way) for roads in sets]
    return run_all(partial(score_set, settings=settings or TrackerSettings()), tasks, workers=workers)


def _camera(size: tuple[int, int], file: Path) -> Camera:
    return Camera.from_fov(size, find_field_of_view([file]).across(size))


def _score_stills(
    roads: RoadSet, chosen: Iterable[int], files: Sequence[Path], settings: TrackerSettings
) -> list[ScoredLane]:
    """Scores of some labels; the pose is that of `files`, which have one size."""
    camera = roads.lens or _camera(read_image(files[0]).shape[1::-1], files[0])
    source = read_image(files[0]) if len(files) == 1 else files
    camera, pose = ensure_pose(camera, source, settings=settings.detector)
    scores = []
    for label in (roads.labels[k] for k in chosen):
        image = read_image(roads.folder / label.name)
        same_size = image.shape[1::-1] == camera.size
        how = {"settings": settings.detector}
        scores.append(_detect(image, label, camera, pose, **how) if same_size else score_lane(None, label, camera))
    return scores


def _score_clips(roads: RoadSet, settings: TrackerSettings) -> list[ScoredLane]:
    """Scores of the labels with a clip, which is tracked up to its last labelled frame."""
    scores, clips = [], dict[Path, dict[int, LaneColumns]]()
    for label, frame in zip(roads.labels, roads.frames, strict=True):
        if frame:
            clips.setdefault(frame[0], {})[frame[1]] = label
    for clip, labels in sorted(clips.items()):
        info = inspect_video(clip)
        camera = _camera((info.width, info.height), clip)
        camera, pose = ensure_pose(camera, sample_images([clip], POSE_PICTURES), settings=settings.detector)
        tracker = make_tracker(info.fps, camera, pose, None, settings)
        with closing(read_frames(clip, info)) as frames:
            for number, (_, lane) in enumerate(track_frames(frames, tracker)):
                if number in labels:
                    label = _at_size(roads.folder, labels[number], tracker.camera.size)
                    scores.append(score_lane(lane, label, tracker.camera))
                if number == max(labels):
                    break
    return scores


def _at_size(folder: Path, label: LaneColumns, size: tuple[int, int]) -> LaneColumns:
    """A label of a still as one of the clip's frames, which have another width if the clip's pixels are not square."""
    height, width = read_image(folder / label.name).shape[:2]
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
