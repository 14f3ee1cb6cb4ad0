"""One drive from beginning to end: find the mount, follow the lane, write video, telemetry and report."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lanes.camera import Camera
from lanes.drives.mounts import mount_from_drive
from lanes.drives.moved import find_mount_change
from lanes.drives.settings import DriveResult, DriveSettings, StillsResult, describe_settings
from lanes.drives.sources import refuse_clashes
from lanes.drives.styles import STYLES
from lanes.images import read_image, write_image
from lanes.metric.lane import find_lane
from lanes.metric.roadview import RoadView
from lanes.metric.tracked import LOST, TrackedLane
from lanes.metric.tracker import LaneTracker
from lanes.mounting.mount import MountEstimate
from lanes.report.moments import seconds_lost, share_tracked
from lanes.report.report import write_report
from lanes.threads import one_thread
from lanes.video.annotate import annotate_video
from lanes.video.telemetry import read_telemetry, write_telemetry
from lanes.video.videofile import VideoError, VideoInfo, inspect_video

Row = dict[str, str | float | None]


@dataclass(frozen=True, eq=False)
class PreparedDrive:
    """A video with what it holds, the camera on its mount, and the estimate of that (None: the camera brought it)."""

    video: Path
    info: VideoInfo
    camera: Camera
    mount: MountEstimate | None


def annotate_drive(video: str | Path, settings: DriveSettings) -> DriveResult:
    """Annotate a video and write its telemetry and report beside it.

    Needs nothing but its two arguments, which can be sent to another process, and leaves nothing behind but the files.

    Raises
    ------
    FileNotFoundError, VideoError
        If the video cannot be used, or has nothing in the piece that is asked for.
    CameraError
        If the camera does not fit the video.
    MountError
        If the camera has no mount and the drive does not tell it.
    OSError
        If an output cannot be written.
    """
    return follow_drive(prepare_drive(video, settings), settings)


def prepare_drive(video: str | Path, settings: DriveSettings) -> PreparedDrive:
    """Look into a video, and find the camera's mount where it is not known; raises what `annotate_drive` does."""
    video = Path(video)
    info = inspect_video(video)
    if settings.start_s >= info.duration_s:
        raise VideoError(f"{video}: lasts {info.duration_s:g} s; begin before that, not at {settings.start_s:g} s.")
    camera = settings.camera_for((info.width, info.height))
    return PreparedDrive(video, info, *mount_from_drive(camera, [video]))


def follow_drive(drive: PreparedDrive, settings: DriveSettings) -> DriveResult:
    """The second part of `annotate_drive`."""
    target = output_for(drive.video, settings.output)
    began_s = time.perf_counter()
    # reader, loop and writer have a thread each
    with one_thread():
        annotate_video(
            drive.video,
            target,
            follow_and_paint(drive.camera, drive.info.fps, settings.style),
            start_s=settings.start_s,
            end_s=settings.end_s,
            progress=settings.progress,
            telemetry=target.with_suffix(".csv"),
            overlapped=settings.overlapped,
        )
    elapsed_s = time.perf_counter() - began_s
    return conclude_drive(str(drive.video), target, drive.camera, drive.mount, settings, elapsed_s)


def annotate_stills(pictures: Sequence[Path], settings: DriveSettings) -> StillsResult:
    """Find the lane in each picture on its own; the pictures keep their names, `pictures.csv` has a row for each.

    Raises
    ------
    FileNotFoundError, PictureError
        If a picture cannot be used, has another size than the first, or would be overwritten.
    CameraError, MountError, OSError
        As `annotate_drive`.
    """
    targets = [settings.output / path.name for path in pictures]
    refuse_clashes(pictures, targets)
    height, width = read_image(pictures[0]).shape[:2]
    camera, mount = mount_from_drive(settings.camera_for((width, height)), pictures)
    view, paint = RoadView(camera), STYLES[settings.style](camera)
    rows = []
    for number, (path, target) in enumerate(zip(pictures, targets, strict=True)):
        image = read_image(path)
        camera.require_size(image, path)
        found = TrackedLane.from_still(find_lane(image, view))
        rows.append({"frame": number, "picture": path.name, **found.as_row()})
        write_image(target, paint(image, found))
    telemetry = write_telemetry(settings.output / "pictures.csv", rows)
    return StillsResult(tuple(targets), telemetry, sum(row["state"] != LOST for row in rows), mount)


def follow_and_paint(camera: Camera, fps: float, style: str) -> Callable[..., tuple[np.ndarray, Row]]:
    """A function for `annotate_video`: takes the frames in order, gives each annotated and its telemetry.

    Given a frame alone it takes 1 / fps as the time since the one before; `elapsed_s` says otherwise.
    """
    tracker, paint = LaneTracker(camera, fps=fps), STYLES[style](camera)

    def process(frame: np.ndarray, elapsed_s: float | None = None) -> tuple[np.ndarray, Row]:
        tracked = tracker.update(frame, elapsed_s=elapsed_s)
        warning = tracked.warning
        departure = warning.side if warning and warning.due else None
        return paint(frame, tracked), {**tracked.as_row(), "departure": departure}

    return process


def conclude_drive(
    source: str,
    video: Path,
    camera: Camera,
    mount: MountEstimate | None,
    settings: DriveSettings,
    elapsed_s: float,
) -> DriveResult:
    """Write the report, if asked for, and sum up what the telemetry beside `video` says."""
    telemetry = video.with_suffix(".csv")
    columns = read_telemetry(telemetry)
    frames = len(columns["frame"])
    report = None
    if settings.report:
        used = describe_settings(source, camera, mount, settings)
        path = video.with_suffix(".html")
        report = write_report(path, title=Path(source).name, video=video, telemetry=columns, settings=used)
    return DriveResult(
        source,
        video,
        telemetry,
        report,
        camera,
        mount,
        frames,
        share_tracked(columns),
        seconds_lost(columns),
        frames / elapsed_s,
        find_mount_change(columns),
    )


def output_for(video: Path, folder: Path) -> Path:
    """Where the annotated video goes."""
    return folder / f"{video.stem}.mp4"
