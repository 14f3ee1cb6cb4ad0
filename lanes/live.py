"""Annotation of a live camera, until Ctrl-C or until a given time."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import takewhile

from lanes.annotate import DriveResult, DriveSettings, conclude_drive
from lanes.camera import Camera
from lanes.draw import track_lane
from lanes.errors import PoseError
from lanes.files import TelemetryWriter, exclusive_writer
from lanes.images import as_rgb
from lanes.pose import PoseEstimate, estimate_pose
from lanes.track.tracker import LaneTracker
from lanes.video.live_camera import LiveCamera
from lanes.video.reader import STAMP_TOLERANCE_S, TimedFrame
from lanes.video.writer import VideoWriter

# Pictures for the estimate of an unknown camera pose, and the time between two of them. Over these ten seconds of
# motorway the heading of the car in its lane averages out.
POSE_PICTURES, POSE_INTERVAL_S = 20, 0.5


def annotate_live(index: int, settings: DriveSettings) -> DriveResult:
    """Annotate camera number `index` until Ctrl-C or `settings.end_s`; writes the same files as for a video.

    Each frame is written with the time at which it arrived. A slow machine therefore writes fewer frames, and the
    video keeps its speed.

    Raises
    ------
    VideoError
        If the camera does not exist or gives no frame.
    CameraError, PoseError, OSError
        As `annotate_drive`.
    """
    video = settings.output / f"camera{index}.mp4"
    with _until_interrupted() as stopped, LiveCamera(index) as source, exclusive_writer(video):
        frames = takewhile(lambda _: not stopped.is_set(), source.frames())
        camera, pose = _with_pose(settings.camera_for(source.size, f"camera {index}"), frames, f"camera {index}")
        began_s = time.perf_counter()
        process = track_lane(LaneTracker(camera, fps=source.fps), camera, style=settings.style)
        # The order matters: the telemetry gets its final name after the video.
        with TelemetryWriter(video.with_suffix(".csv")) as table, VideoWriter(video, fps=source.fps) as writer:
            for number, (frame, elapsed_s) in enumerate(_with_elapsed_time(frames)):
                if settings.end_s is not None and frame.time_s > settings.end_s - STAMP_TOLERANCE_S:
                    break
                frame_began_s = time.perf_counter()
                picture, row = process(frame.image, elapsed_s)
                latency_ms = round(1e3 * (time.perf_counter() - frame_began_s), 3)
                table.write({"frame": number, "time_s": round(frame.time_s, 6), **row, "latency_ms": latency_ms})
                writer.write(picture, frame.time_s)
    return conclude_drive(f"camera {index}", video, camera, pose, settings, time.perf_counter() - began_s)


def _with_pose(camera: Camera, frames: Iterator[TimedFrame], name: str) -> tuple[Camera, PoseEstimate | None]:
    if camera.pose is not None:
        return camera, None
    pictures, next_s = [], 0.0
    for frame in frames:
        if frame.time_s >= next_s:
            pictures.append(as_rgb(frame.image))
            next_s = frame.time_s + POSE_INTERVAL_S
        if len(pictures) == POSE_PICTURES:
            break
    try:
        estimate = estimate_pose(pictures, camera)
    except PoseError as error:
        raise PoseError(f"{name}: {error}") from error
    return estimate.camera, estimate


def _with_elapsed_time(frames: Iterator[TimedFrame]) -> Iterator[tuple[TimedFrame, float | None]]:
    """The frames, timed from the first one, and the seconds since the previous frame (None for the first)."""
    first_s: float | None = None
    previous_s: float | None = None
    for frame in frames:
        first_s = frame.time_s if first_s is None else first_s
        elapsed_s = None if previous_s is None else frame.time_s - previous_s
        yield TimedFrame(frame.number, frame.time_s - first_s, frame.image), elapsed_s
        previous_s = frame.time_s


@contextmanager
def _until_interrupted() -> Iterator[threading.Event]:
    """An event that Ctrl-C and SIGTERM set, so that the current frame is still finished."""
    stopped = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield stopped
        return
    before = {number: signal.signal(number, lambda *_: stopped.set()) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stopped
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
