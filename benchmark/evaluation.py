"""Evaluation of one system on one drive: run it on every frame, then compare its estimates with the truth."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from benchmark.errors import LaneTruth, frame_errors
from benchmark.estimates import DriveEstimates, LaneEstimate
from benchmark.scored_drive import NO_LANE, BenchmarkDrive, drive_from_video
from benchmark.scores import Result, Row, score_rows
from benchmark.systems import OwnFinder, require_system, start_system
from lanes.camera import Camera, load_camera
from lanes.detect.markings import Markings
from lanes.files import read_telemetry
from lanes.pose import estimate_pose
from lanes.tracking.tracker import TrackerSettings
from lanes.video.reader import inspect_video, read_timed_frames


@dataclass(frozen=True)
class PreparedDrive:
    """A drive with a video, and the camera for the systems with the pose, and where this is from.

    `markings` are those of the tracker and the detector, see `lanes.find_lane`; None: our own.
    """

    drive: BenchmarkDrive
    camera: Camera
    pose: str
    markings: Markings | None = None


def prepare_drive(
    drive: BenchmarkDrive, *, estimated_pose: bool = False, markings: Markings | None = None
) -> PreparedDrive:
    """Load the camera of a drive with its true pose, or estimate the pose from the video."""
    video = drive.require_video()
    camera = load_camera(video.with_suffix(".yaml"))
    if not estimated_pose:
        return PreparedDrive(drive, camera, "true", markings)
    return PreparedDrive(drive, estimate_pose(video, camera, markings=markings).camera, "estimated", markings)


def run_system(
    prepared: PreparedDrive,
    system: str | OwnFinder,
    *,
    end_s: float | None = None,
    every: int = 1,
    settings: TrackerSettings | None = None,
) -> DriveEstimates:
    """Estimates of a system for each `every`-th frame of a drive before `end_s`.

    `settings` are those of the tracker.
    """
    return run_systems(prepared, [(system, every)], end_s=end_s, settings=settings)[0]


def run_systems(
    prepared: PreparedDrive,
    systems: Sequence[tuple[str | OwnFinder, int]],
    *,
    end_s: float | None = None,
    settings: TrackerSettings | None = None,
) -> list[DriveEstimates]:
    """`run_system` for several systems, each with its `every`; the video is decoded once."""
    video = prepared.drive.require_video()
    fps = inspect_video(video).fps
    begin = partial(start_system, settings=settings, markings=prepared.markings)
    started = [(*begin(system, prepared.camera, fps / every), every) for system, every in systems]
    estimates: list[list[LaneEstimate]] = [[] for _ in systems]
    time_ms: list[list[float]] = [[] for _ in systems]
    last_s: list[float | None] = [None for _ in systems]
    for number, frame in enumerate(read_timed_frames(video, end_s=end_s)):
        for k, (find, to_estimate, every) in enumerate(started):
            if number % every:
                continue
            before_s, last_s[k] = last_s[k], frame.time_s
            start = time.perf_counter()
            found = find(frame.image, None if before_s is None else frame.time_s - before_s)
            time_ms[k].append(1000 * (time.perf_counter() - start))
            estimates[k].append(to_estimate(found))
    return list(map(DriveEstimates.from_frames, estimates, time_ms))


def score_video(
    video: str | Path, system: str | OwnFinder, *, end_s: float | None = None, every: int = 1, name: str | None = None
) -> Row:
    """Score a system of `SYSTEMS`, or a finder of one's own, on a video: a row of the benchmark's table.

    Each `every`-th frame up to the time `end_s` counts; a system with a memory needs every frame. The truth (.csv) and
    the camera with pose (.yaml) are next to the video. `name` is the name of an own finder in the row. Raises
    ValueError if the system is unknown, or video and truth do not belong together.
    """
    label = name or (system.__name__ if callable(system) else system)
    return score_systems(video, {label: (system, every)}, end_s=end_s)[0]


def score_systems(
    video: str | Path, systems: Mapping[str, tuple[str | OwnFinder, int]], *, end_s: float | None = None
) -> list[Row]:
    """`score_video` for several systems by name, each with its `every`; the video is decoded once."""
    for system, _ in systems.values():
        if not callable(system):
            require_system(system)
    drive = drive_from_video(video)
    found = run_systems(prepare_drive(drive), list(systems.values()), end_s=end_s)
    truth, fps, rows = read_truth(drive), inspect_video(video).fps, []
    for (label, (_, every)), estimates in zip(systems.items(), found, strict=True):
        errors = frame_errors(estimates, truth.select(slice(0, len(estimates.offset_m) * every, every)))
        # each alone: only systems on the same frames can be compared
        rows += score_rows([Result(drive.name, drive.difficulty, label, errors, fps=fps / every)])
    return rows


def read_truth(drive: BenchmarkDrive) -> LaneTruth:
    """The true lane in the frames of a drive; NaN in all frames of a scene without a lane."""
    path = drive.require_video().with_suffix(".csv")
    columns = read_telemetry(path)
    try:
        truth = LaneTruth.from_columns(columns)
    except KeyError as error:
        raise ValueError(f"{path}: lacks the column {error}; use the truth that was written with the video.") from error
    except ValueError as error:
        raise ValueError(
            f"{path}: is not a truth file ({error}); use the one that was written with the video."
        ) from error
    return replace(truth, lines_y_m=np.full_like(truth.lines_y_m, np.nan)) if drive.difficulty == NO_LANE else truth
