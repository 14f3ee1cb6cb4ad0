"""Detections of the lane's lines in pixels of the raw images, as TuSimple JSON lines.

One JSON object per image, as `lanes.labels` reads it, with TuSimple's `run_time` (milliseconds). Additional keys:
`sides`, `state`, `confidence`, `offset_m`, `curvature_per_m`, and `frame` for videos.

The first two lines are the left and the right one of the ego lane. Far lines of adjacent lanes follow only if they are
seen, because TuSimple counts a line without points as a false positive; `sides` names each line.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from lanes.camera import Camera
from lanes.detect.lane import LOST, Lane, columns_at
from lanes.drive import DriveSettings, detect_stills, make_tracker, prepare_drive, track_frames
from lanes.errors import LaneError
from lanes.images import read_image
from lanes.labels import NO_POINT
from lanes.video.process import read_frames
from lanes.video.reader import MIRRORED_WORDS, TimedFrame


def detect_in_video(video: Path, settings: DriveSettings, rows: Sequence[int] | None = None) -> Iterator[dict]:
    """Track the lane through a video; yields a detection per frame, with the columns of the lines at image `rows`.

    By default the rows are `usual_rows`. Prints the pose if it is estimated. Errors are those of `annotate`.
    """
    info, camera, pose = prepare_drive(video, settings)
    if pose:
        print(pose.describe())
    if info.mirrored:
        print(f"{video}: {MIRRORED_WORDS}")
    tracker = make_tracker(info.fps, camera, pose, settings.markings)
    part: dict[str, Any] = {"start_s": settings.start_s, "end_s": settings.end_s}
    with closing(read_frames(video, info, progress=settings.progress, **part)) as frames:
        for frame, lane in track_frames(frames, tracker):
            names = {"raw_file": f"{video}#{frame.number}", "frame": frame.number}
            yield names | as_detection(lane, tracker.camera, rows, frame.latency_ms)


def detect_in_sequence(
    stills: Sequence[Path], settings: DriveSettings, rows: Sequence[int] | None = None, *, fps: float
) -> Iterator[dict]:
    """Track the lane through stills that are consecutive frames, `fps` per second; otherwise as `detect_in_video`."""
    camera = settings.camera_for(read_image(stills[0]).shape[1::-1], stills[0])
    camera, pose = settings.ensure_pose(camera, stills)
    if pose:
        print(pose.describe())
    images = (camera.require_size(read_image(path), path) for path in stills)
    frames = (TimedFrame(number, number / fps, image, 1 / fps) for number, image in enumerate(images))
    tracker = make_tracker(fps, camera, pose, settings.markings)
    for frame, lane in track_frames(frames, tracker):
        yield {"raw_file": str(stills[frame.number])} | as_detection(lane, tracker.camera, rows, frame.latency_ms)


def detect_in_stills(
    stills: Sequence[Path], settings: DriveSettings, rows: Sequence[int] | None, failures: list[LaneError]
) -> Iterator[dict]:
    """Find the lane in each still independently, as `detect_in_video`; errors of unusable stills go to `failures`."""
    said = None
    for still in detect_stills(stills, settings, failures):
        if still.pose and still.pose.still:
            print(f"{still.path}: {still.pose.summary_line()}{settings.describe_lens(still.path)}")
        elif still.pose and still.pose is not said:
            said = still.pose
            print(said.describe())
        lane = still.detection.lane
        yield {"raw_file": str(still.path)} | as_detection(lane, still.detection.camera, rows, still.run_time_ms)


def usual_rows(height: int) -> range:
    """The lower rows of an image at which a lane is detected; of one 720 px high 420, 430, ... 700."""
    step = max(round(height / 72), 1)
    return range(42 * step, min(71 * step, height), step)


def as_detection(
    lane: Lane | None, camera: Camera, rows: Sequence[int] | np.ndarray | None, run_time_ms: float
) -> dict:
    """The detection in one image, without the file's name."""
    rows = np.asarray(usual_rows(camera.height) if rows is None else rows)
    lanes = np.full((2, len(rows)), NO_POINT) if lane is None else lane.columns(camera, rows)
    adjacent = lane.adjacent if lane else (None, None)
    far = {f"far {side}": line for side, line in zip(("left", "right"), adjacent, strict=True) if line}
    far_columns = columns_at(rows, [line.pixels(camera) for line in far.values()], camera)
    return {
        "h_samples": rows.tolist(),
        "lanes": np.round(np.vstack([lanes, far_columns]), 1).tolist(),
        "sides": ["left", "right", *far],
        "run_time": round(run_time_ms, 2),
        "state": lane.state if lane else LOST,
        "confidence": round(lane.confidence, 4) if lane else 0.0,
        "offset_m": lane and round(lane.offset_m, 4),
        "curvature_per_m": lane and round(lane.curvature_per_m, 7),
    }
