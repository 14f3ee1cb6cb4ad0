"""Run one system over one drive: every frame in order, then its errors against the truth."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmark.errors import LaneTruth, frame_errors
from benchmark.estimates import Reading, Readings
from benchmark.scored_drive import NO_LANE, BenchmarkDrive, own_drive
from benchmark.scores import Result, Row, score_rows
from benchmark.systems import follow_with, require_system
from lanes.camera.camera import Camera
from lanes.camera.camera_file import load_camera
from lanes.camera.pose_from_lanes.pose_estimate import PoseError
from lanes.camera.pose_from_lanes.pose_from_files import pose_from_drive
from lanes.io.telemetry import read_telemetry
from lanes.io.video.reader import inspect_video, read_frames


@dataclass(frozen=True)
class Staged:
    """A drive with its video at hand, and the camera that the systems are given (None: no pose was to be found)."""

    drive: BenchmarkDrive
    camera: Camera | None
    pose: str


def stage(drive: BenchmarkDrive, *, estimated_pose: bool = False) -> Staged:
    """Take the true pose of a drive whose video is at hand, or estimate it from the video."""
    camera = load_camera(drive.video.with_suffix(".yaml"))
    if not estimated_pose:
        return Staged(drive, camera, "true")
    try:
        camera, _ = pose_from_drive(replace(camera, pose=None), [drive.video])
    except PoseError:
        return Staged(drive, None, "not found")
    return Staged(drive, camera, "estimated")


def follow_drive(staged: Staged, system: str, *, end_s: float | None = None) -> Readings:
    """What a system says of each frame of a drive up to `end_s`; nothing where the camera has no pose."""
    info = inspect_video(staged.drive.video)
    follow = follow_with(system, staged.camera, info.fps) if staged.camera else lambda image: Reading()
    readings, time_ms = [], []
    for image in read_frames(staged.drive.video, end_s=end_s):
        start = time.perf_counter()
        readings.append(follow(image))
        time_ms.append(1000 * (time.perf_counter() - start) if staged.camera else np.nan)
    return Readings.of(readings, time_ms)


def score_video(video: str | Path, system: str, *, end_s: float | None = None) -> Row:
    """Score a system on a video with its truth and camera beside it, here and now: a row of the benchmark's table.

    Parameters
    ----------
    video : str or Path
        With the truth (.csv) and the camera with its pose (.yaml) beside it.
    system : str
        One of `systems.SYSTEMS`.
    end_s : float, optional
        Score the frames before this moment, seconds.

    Raises
    ------
    ValueError
        If the system is unknown, or video and truth do not belong together.
    OSError
        If a file cannot be read.
    """
    require_system(system)
    staged = stage(own_drive(video))
    readings = follow_drive(staged, system, end_s=end_s)
    truth = true_lane(staged.drive).cut(slice(len(readings.offset_m)))
    errors = frame_errors(readings, truth, staged.camera)
    return score_rows([Result(staged.drive.name, staged.drive.difficulty, system, errors)])[0]


def true_lane(drive: BenchmarkDrive) -> LaneTruth:
    """The truth of a drive's frames; none in any frame where the road shows no lane."""
    path = drive.video.with_suffix(".csv")
    columns = read_telemetry(path)
    try:
        truth = LaneTruth.of(columns)
    except KeyError as error:
        raise ValueError(f"{path}: lacks the column {error}; give the truth that is written beside a video.") from error
    except ValueError as error:
        raise ValueError(f"{path}: is no truth ({error}); give the one that is written beside a video.") from error
    return replace(truth, lines_y_m=np.full_like(truth.lines_y_m, np.nan)) if drive.difficulty == NO_LANE else truth
