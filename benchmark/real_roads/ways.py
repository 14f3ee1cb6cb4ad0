"""Labelled stills of real roads, found by the engine or another system of ours.

Each still alone, with the pose of its set, or tracked through its clip. Nothing is
known about the cameras, unless a lens is given.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.real_roads.scored import ScoredLane, score_lane
from benchmark.real_roads.sets import RoadSet
from benchmark.systems import DETECTOR, TRACKER, column_detector
from lanes.camera.field_of_view import find_field_of_view
from lanes.camera.model import Camera
from lanes.console import progress_line
from lanes.detect.markings import Markings
from lanes.drive import make_tracker, track_frames
from lanes.labels import EGO_SIDES, LaneColumns
from lanes.pose.estimate import (
    POSE_PICTURES,
    PoseEstimate,
    detect_in_drive,
    ensure_pose,
)
from lanes.score import score_still
from lanes.tracking.tracker import TrackerSettings
from lanes.video.images import read_image
from lanes.video.reader import inspect_video, read_frames
from lanes.video.sources import sample_images
from simulator.processes import run_all

# Ways to look at a set: each still alone; with the pose of its stills; tracked.
OWN = "own"
SET = "set"
CLIPS = "clips"
WAYS = (OWN, SET, CLIPS)
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


def labels_in_way(roads: RoadSet, way: str) -> list[LaneColumns]:
    """The labels of a set that can be looked at in one of the `WAYS`.

    None with the pose of a set of several cameras, or without a clip.
    """
    if way == CLIPS:
        of_clips = [roads.clips[clip] for clip in sorted(roads.clips)]
        return [of_clip[frame] for of_clip in of_clips for frame in sorted(of_clip)]
    if way == SET and roads.several_cameras:
        return []
    return roads.labels


def sets_in_way(sets: Sequence[RoadSet], way: str) -> list[RoadSet]:
    """The sets that can be looked at in one of the `WAYS`, with these labels only."""
    in_way = [replace(roads, labels=labels_in_way(roads, way)) for roads in sets]
    return [roads for roads in in_way if roads.labels]


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
