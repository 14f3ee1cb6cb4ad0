"""Labelled stills of real roads: scores of systems, of uncertainty and of confidence.

    python -m benchmark.real_roads FOLDER [--camera camera.yaml] [--half A] [--only own]
        [--workers 2] [--several-cameras NAME,...]

scores each still alone, with the pose of its set, and tracked through its clip. The
folder has `labels.jsonl`, and a folder of stills of one camera for each set; a label
may name a `clip` and a `frame` of it. Nothing is known about the cameras. The stills of
a set of --several-cameras have no common pose: they are only scored alone. Choices are
made on half A of the sets and confirmed on half B.
"""

from __future__ import annotations

import argparse
import hashlib
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.consistency import describe_z, z_summary
from benchmark.systems import DETECTOR, TRACKER, column_detector
from lanes.camera.field_of_view import find_field_of_view
from lanes.camera.model import Camera, load_camera
from lanes.console import bounded, progress_line, split_names
from lanes.describe import format_table, number_cells
from lanes.detect.lane import Lane
from lanes.detect.markings import Markings
from lanes.detect.road import lines_on_view, parameter_gradients, propagated_std
from lanes.drive import make_tracker, track_frames
from lanes.files import read_json_lines
from lanes.labels import EGO_SIDES, LaneColumns, read_labels
from lanes.pose.estimate import (
    POSE_PICTURES,
    PoseEstimate,
    detect_in_drive,
    ensure_pose,
)
from lanes.score import (
    StillScore,
    lateral_errors_m,
    reliability,
    score_still,
    summarize,
)
from lanes.tracking.tracker import TrackerSettings
from lanes.video.images import read_image
from lanes.video.reader import inspect_video, read_frames
from lanes.video.sources import find_sources, sample_images
from simulator.processes import run_all

# Ways to look at a set: each still alone; with the pose of its stills; tracked.
OWN = "own"
SET = "set"
CLIPS = "clips"
WAYS = (OWN, SET, CLIPS)
# Distances at which lines are compared.
COMPARED_AT_M = np.array([8.0, 15.0, 25.0])
# Standard deviation of a labelled column: 95 % of the differences between two labellers
# are below 3.2 px.
LABEL_STD_PX = 1.6
# With a larger error another line was found.
OTHER_LINE_M = 1.0
LEGEND = """\
z: lateral error against the label, both projected to the flat road, divided by its
standard deviation: that of the lane at this picture row and 1.6 px of the label. Cells:
root mean square (1 is wanted), percent within 1 and 2 (68/95).
Right: every labelled line is matched."""
NOT_COMPARED = np.full((2, len(COMPARED_AT_M)), np.nan)


@dataclass(frozen=True, eq=False)
class ScoredLane:
    """The score of what a system found for a label, and the lane with its errors if it
    is the engine.

    `lane` is None without one. `z` (2, 3) are errors of both lines at COMPARED_AT_M, in
    standard deviations of the position at a picture row (`row_std_m`), NaN where
    nothing is compared. `other_lines` is the number of errors above OTHER_LINE_M, which
    are left out.
    """

    score: StillScore
    lane: Lane | None = None
    z: np.ndarray = field(default_factory=NOT_COMPARED.copy)
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
    """Scores of each system on the labelled pictures of one camera, and its pose,
    estimated from them if it has none.

    Each picture is processed independently. The estimate is None if the camera had a
    pose. Errors are those of `ensure_pose`, and PictureError if a picture is not of the
    camera's size.
    """
    progress = progress_line("pose")
    camera, pose = ensure_pose(lens, files, progress=progress, markings=markings)
    finders = {}
    scored: dict[str, list[ScoredLane]] = {}
    for system in systems:
        finders[system] = start_finder(system, camera, pose, markings=markings)
        scored[system] = []

    report = progress_line("stills")
    for done, (label, file) in enumerate(zip(labels, files, strict=True), 1):
        image = camera.require_size(read_image(file), label.name)
        for system, find in finders.items():
            scored[system].append(find(image, label))
        report(done, len(labels))
    return scored, pose


def start_finder(
    system: str, camera: Camera, pose: PoseEstimate | None, **how: Any
) -> Finder:
    """A function that scores a system on a picture with its label.

    `how` are options of `detect_in_drive`.
    """
    if system in (TRACKER, DETECTOR):

        def detect(image: np.ndarray, label: LaneColumns) -> ScoredLane:
            found, _ = detect_in_drive(image, camera, pose, **how)
            return score_lane(found.lane, label, found.camera)

        return detect
    columns_of = column_detector(system, camera)

    def find(image: np.ndarray, label: LaneColumns) -> ScoredLane:
        columns = np.round(columns_of(image, label.rows), 1)
        found = LaneColumns(label.name, label.rows, columns, EGO_SIDES)
        return ScoredLane(score_still(label, found, camera.size))

    return find


def lanes_of_engine(scored: Mapping[str, list[ScoredLane]]) -> list[ScoredLane]:
    """The lanes of tracker or detector, which are the same in single pictures.

    Empty if neither is scored.
    """
    return scored.get(TRACKER, scored.get(DETECTOR, []))


def describe_labelled(scored: Mapping[str, Sequence[ScoredLane]]) -> str:
    """A table of the scores, a line for each system."""
    rows = {}
    for system, lanes in scored.items():
        rows[system] = summarize([one.score for one in lanes])
    headings, cells = number_cells(rows)
    return format_table(headings, cells)


def score_lane(lane: Lane | None, label: LaneColumns, camera: Camera) -> ScoredLane:
    """The score of a lane that is detected in a single picture by `camera`, whose pose
    it has.
    """
    if lane is None:
        return ScoredLane(score_still(label, None, camera.size))
    columns = lane.columns(camera, label.rows)
    found = LaneColumns(label.name, label.rows, columns, EGO_SIDES, lane.confidence)
    score = score_still(label, found, camera.size)

    true = label.ego_lane(camera.size)
    error_m = lateral_errors_m(true, found, camera, COMPARED_AT_M)
    other = np.abs(error_m) > OTHER_LINE_M
    label_std_m = LABEL_STD_PX * COMPARED_AT_M / camera.matrix[0, 0]
    lane_std_m = row_std_m(lane, COMPARED_AT_M, camera.require_pose().height_m)
    z = error_m / np.hypot(lane_std_m, label_std_m)
    return ScoredLane(score, lane, np.where(other, np.nan, z), int(other.sum()))


def row_std_m(lane: Lane, x_m: np.ndarray, height_m: float) -> np.ndarray:
    """Standard deviation (2, N) of the lines' lateral positions at the picture rows of
    distances x (N,) on a flat road.

    Pitch and width of a lane are correlated: both decide where the lines are in the
    picture. Errors of the pitch, which displace the lines on the road, hardly displace
    them in the picture that they are fitted to.
    """
    on_view = partial(lines_on_view, x_m=x_m, height_m=height_m)
    gradients = parameter_gradients(on_view, lane.model)
    return propagated_std(gradients, lane.covariance)


def describe_lanes(scored: Sequence[ScoredLane]) -> str:
    """Tables of z at each distance, and of the right lanes by confidence."""
    compared = np.isfinite(all_z(scored)).sum(axis=(0, 1))
    rows = {}
    for x_m, count, cell in zip(COMPARED_AT_M, compared, _z_cells(scored), strict=True):
        rows[f"lateral, {x_m:.0f} m"] = [f"{count}", cell]
    other_lines = sum(one.other_lines for one in scored)
    headings, cells = number_cells(reliability(one.score for one in scored))
    return (
        f"{format_table(('compared', 'z'), rows)}\n"
        f"left out, error above {OTHER_LINE_M:g} m: {other_lines}\n"
        f"{format_table(headings, cells)}\n{LEGEND}"
    )


def summarize_lanes(scored: Sequence[ScoredLane]) -> str:
    """The same in one line."""
    sure = reliability(one.score for one in scored)["0.9 or more"]
    at = "/".join(f"{x:.0f}" for x in COMPARED_AT_M)
    return (
        f"z at {at} m: {', '.join(_z_cells(scored))}; 0.9 or more: {sure['right']} of "
        f"{sure['lanes']} right, {sure['of right lanes']:.0%} of the right lanes"
    )


def all_z(scored: Sequence[ScoredLane]) -> np.ndarray:
    """(N, 2, 3) z of N stills."""
    return np.array([one.z for one in scored]).reshape(-1, *NOT_COMPARED.shape)


def _z_cells(scored: Sequence[ScoredLane]) -> list[str]:
    """Summaries of z in words, for each distance."""
    cells = []
    for z in np.moveaxis(all_z(scored), 2, 0):
        summary = z_summary(z[np.isfinite(z)])
        cells.append(describe_z(summary))
    return cells


@dataclass(frozen=True, eq=False)
class RoadSet:
    """Labelled stills of one camera, or of `several_cameras`.

    `clips` are the labels of those that are a frame of a clip, by the number of the
    frame.
    """

    name: str
    folder: Path
    lens: Camera | None = None
    several_cameras: bool = False
    labels: list[LaneColumns] = field(default_factory=list)
    clips: dict[Path, dict[int, LaneColumns]] = field(default_factory=dict)

    @property
    def half(self) -> str:
        """A or B, by the hash of the name."""
        digest = hashlib.sha256(self.name.encode()).digest()
        return "AB"[digest[0] % 2]

    def stills(self) -> Sequence[Path]:
        """All stills, also those without a label."""
        path = self.folder / self.name
        pattern = str(path) if path.is_dir() else f"{path}*"
        return find_sources([pattern]).stills


def read_road_sets(
    folder: Path, lens: Camera | None = None, several_cameras: Sequence[str] = ()
) -> list[RoadSet]:
    """The labelled sets in a folder, by name.

    `lens` is that of all of them, if it is calibrated; `several_cameras` are names of
    sets. Stills named DRIVE_NUMBER in one folder "stills" are a set for each drive.
    Raises ValueError if there is no set of such a name.
    """
    sets: dict[str, RoadSet] = {}
    file = folder / "labels.jsonl"
    entries = read_json_lines(file, "label")
    for label, (_, entry) in zip(read_labels(file), entries, strict=True):
        name = label.folder
        if name == "stills":
            drive, *_ = Path(label.name).stem.split("_")
            name = f"{name}/{drive}_"
        if name not in sets:
            sets[name] = RoadSet(name, folder, lens, name in several_cameras)
        roads = sets[name]
        roads.labels.append(label)
        if "clip" in entry:
            of_clip = roads.clips.setdefault(folder / entry["clip"], {})
            of_clip[int(entry["frame"])] = label

    unknown = [name for name in several_cameras if name not in sets]
    if unknown:
        raise ValueError(
            f"{file}: has no set {', '.join(unknown)}; its sets are {', '.join(sets)}."
        )
    return [sets[name] for name in sorted(sets)]


def score_set(task: tuple[RoadSet, str], settings: TrackerSettings) -> list[ScoredLane]:
    """Scores of a set's labels in one of the `WAYS`.

    Empty if the set has no common pose, or no clip.
    """
    roads, way = task
    scores = []
    if way == CLIPS:
        for clip in sorted(roads.clips):
            scores += _score_clip(roads, clip, settings)
    elif way == OWN:
        for label in roads.labels:
            file = roads.folder / label.name
            scores += _score_stills(roads, [label], [file], settings)
    elif not roads.several_cameras:
        sizes = Counter(_size(roads.folder / label.name) for label in roads.labels)
        [(common, _)] = sizes.most_common(1)
        files = [file for file in roads.stills() if _size(file) == common]
        scores = _score_stills(roads, roads.labels, files, settings)
    return scores


def score_sets(
    sets: Sequence[RoadSet],
    way: str,
    settings: TrackerSettings | None = None,
    *,
    workers: int = 1,
) -> list[list[ScoredLane]]:
    """`score_set` of each set."""
    score = partial(score_set, settings=settings or TrackerSettings())
    tasks = [(roads, way) for roads in sets]
    return run_all(score, tasks, workers=workers)


@cache
def _size(file: Path) -> tuple[int, int]:
    height, width = read_image(file).shape[:2]
    return width, height


def _camera(size: tuple[int, int], file: Path) -> Camera:
    hfov_deg = find_field_of_view([file]).across(size)
    return Camera.from_fov(size, hfov_deg)


def _score_stills(
    roads: RoadSet,
    labels: Sequence[LaneColumns],
    files: Sequence[Path],
    settings: TrackerSettings,
) -> list[ScoredLane]:
    """Scores of some labels; the pose is that of `files`, which have one size."""
    first = files[0]
    first_image = read_image(first)
    height, width = first_image.shape[:2]
    source = first_image if len(files) == 1 else files
    lens = roads.lens or _camera((width, height), first)
    camera, pose = ensure_pose(lens, source, settings=settings.detector)
    find = start_finder(DETECTOR, camera, pose, settings=settings.detector)

    scores = []
    for label in labels:
        image = read_image(roads.folder / label.name)
        if image.shape[1::-1] == camera.size:
            scored = find(image, label)
        else:
            scored = score_lane(None, label, camera)
        scores.append(scored)
    return scores


def _score_clip(
    roads: RoadSet, clip: Path, settings: TrackerSettings
) -> list[ScoredLane]:
    """Scores of the labels of a clip, tracked up to its last labelled frame."""
    labels = roads.clips[clip]
    info = inspect_video(clip)
    lens = _camera((info.width, info.height), clip)
    images = sample_images([clip], POSE_PICTURES)
    camera, pose = ensure_pose(lens, images, settings=settings.detector)
    tracker = make_tracker(info.fps, camera, pose, None, settings)

    scores = []
    last = max(labels)
    with closing(read_frames(clip, info)) as frames:
        for number, _ in enumerate(track_frames(frames, tracker)):
            if number in labels:
                camera = tracker.camera
                label = _at_size(roads.folder, labels[number], camera.size)
                scores.append(score_lane(tracker.tracked_lane, label, camera))
            if number == last:
                break
    return scores


def _at_size(folder: Path, label: LaneColumns, size: tuple[int, int]) -> LaneColumns:
    """A label of a still as one of the clip's frames.

    They have another width if the clip's pixels are not square.
    """
    width, height = _size(folder / label.name)
    scaled = label.columns * size[0] / width
    columns = np.where(label.columns >= 0, scaled, label.columns)
    return replace(label, columns=columns, rows=label.rows * size[1] / height)


def describe(
    sets: Sequence[RoadSet], way: str, scored: Sequence[Sequence[ScoredLane]]
) -> str:
    """A table with a row for each set, then for the sets of each half and for all."""
    rows = {}
    of_half: dict[str, list] = {f"{way} {half}": [] for half in ("A", "B", "AB")}
    for roads, lanes in zip(sets, scored, strict=True):
        if not lanes:
            continue
        scores = [one.score for one in lanes]
        rows[f"{roads.half} {roads.name}"] = _summary([scores])
        of_half[f"{way} {roads.half}"].append(scores)
        of_half[f"{way} AB"].append(scores)
    for name, some in of_half.items():
        if some:
            rows[name] = _summary(some)
    headings, cells = number_cells(rows)
    return format_table(headings, cells)


def _summary(sets: Sequence[Sequence[StillScore]]) -> dict[str, float]:
    """Mean and lowest share of right points of the sets, and the right images of all of
    them.
    """
    points = [summarize(scores)["ego accuracy"] for scores in sets]
    every = [score for scores in sets for score in scores]
    right = [score.right for score in every if score.right is not None]
    sure = reliability(every)["0.9 or more"]
    return {
        "points": float(np.mean(points)),
        "lowest": min(points),
        "images": len(right),
        "right": sum(right),
        "right share": float(np.mean(right)),
        "0.9 or more": sure["lanes"],
        "of them right": sure["right"],
        "of right lanes": sure["of right lanes"],
    }


def add_road_arguments(
    parser: argparse.ArgumentParser, *, optional: bool = False
) -> None:
    """Add the options that choose labelled sets."""
    parser.add_argument(
        "folder",
        type=Path,
        nargs="?" if optional else None,
        help="has labels.jsonl, and a folder of stills for each set",
    )
    parser.add_argument(
        "--half",
        choices=("A", "B", "AB"),
        default="AB",
        help="of the sets (default: both halves)",
    )
    add_processing_arguments(parser)


def add_processing_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options that say how labelled sets are processed."""
    parser.add_argument(
        "--several-cameras",
        type=split_names,
        default=[],
        metavar="NAME,...",
        help="sets whose stills have no common pose",
    )
    parser.add_argument(
        "--workers", type=bounded(int, 1), default=1, metavar="N", help="processes"
    )


def choose_road_sets(
    options: argparse.Namespace, lens: Camera | None = None
) -> list[RoadSet]:
    """The sets that the options of `add_road_arguments` choose."""
    sets = read_road_sets(options.folder, lens, options.several_cameras)
    return [roads for roads in sets if roads.half in options.half]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_road_arguments(parser)
    parser.add_argument(
        "--camera",
        type=load_camera,
        help="the lens of all stills (default: unknown cameras)",
    )
    parser.add_argument(
        "--only", choices=WAYS, help="one way to look at the sets (default: all)"
    )


def main() -> None:
    """Score the sets, and print a table for each way to look at them."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add_arguments(parser)
    options = parser.parse_args()
    sets = choose_road_sets(options, options.camera)
    for way in [options.only] if options.only else WAYS:
        scored = score_sets(sets, way, workers=options.workers)
        print(describe(sets, way, scored))


if __name__ == "__main__":
    main()
