"""Annotation of a whole drive: camera pose, lane tracking, annotated video, telemetry and report."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lanes.camera.camera import Camera
from lanes.camera.camera_pose import CameraError
from lanes.camera.pose_change import find_pose_change, find_wrong_yaw
from lanes.drives.overlay_styles import STYLES, track_lane
from lanes.drives.report.moments import seconds_lost, share_tracked
from lanes.drives.report.page import write_report
from lanes.drives.settings import SEVERAL_CAMERAS, DriveResult, DriveSettings, StillsResult, describe_settings
from lanes.drives.sources import require_distinct_outputs
from lanes.io.files import exclusive_writer
from lanes.io.frames import PictureError, as_rgb
from lanes.io.images import PICTURE_SUFFIXES, list_pictures, read_image, write_image
from lanes.io.telemetry import read_telemetry, write_telemetry
from lanes.io.threads import opencv_threads
from lanes.io.video.container import VideoError, open_video
from lanes.io.video.pipeline import VideoSummary, annotate_video
from lanes.io.video.reader import VideoInfo, inspect_video
from lanes.pose_from_lanes.estimator import pose_from_drive
from lanes.pose_from_lanes.pose_estimate import PoseError, PoseEstimate
from lanes.tracking.birdseye import BirdsEyeView
from lanes.tracking.detector import search_still
from lanes.tracking.tracker import LOST, LaneTracker, TrackedLane


@dataclass(frozen=True, eq=False)
class PreparedDrive:
    """A video, its properties, the camera with its pose, and the pose estimate (None if the camera had a pose)."""

    video: Path
    info: VideoInfo
    camera: Camera
    pose: PoseEstimate | None


def annotate_drive(video: str | Path, settings: DriveSettings) -> DriveResult:
    """Annotate a video and write its telemetry and report next to it.

    Both arguments can be sent to another process. The only side effect is the files written.

    Raises
    ------
    FileNotFoundError, VideoError
        If the video cannot be used, or has no frame between `settings.start_s` and `settings.end_s`.
    CameraError
        If the camera does not fit the video.
    PoseError
        If the camera has no pose and it cannot be estimated from the drive.
    OSError
        If an output cannot be written, for instance because another run is writing it.
    """
    drive = prepare_drive(video, settings)
    with exclusive_writer(output_path(drive.video, settings.output)):
        return annotate_prepared(drive, settings)


def prepare_drive(video: str | Path, settings: DriveSettings) -> PreparedDrive:
    """Inspect a video, and estimate the camera pose if the camera has none. Exceptions as for `annotate_drive`."""
    video = Path(video)
    info = inspect_video(video)
    if settings.start_s >= info.duration_s:
        raise VideoError(f"{video}: lasts {info.duration_s:g} s; begin before that, not at {settings.start_s:g} s.")
    camera = settings.camera_for((info.width, info.height), video)
    camera, pose = pose_from_drive(camera, [video], start_s=settings.start_s, end_s=settings.end_s)
    return PreparedDrive(video, info, camera, pose)


def annotate_prepared(drive: PreparedDrive, settings: DriveSettings) -> DriveResult:
    """Annotate a drive after `prepare_drive`; writes its files. Exceptions as for `annotate_drive`."""
    target = output_path(drive.video, settings.output)
    began_s = time.perf_counter()
    # Reader, tracker and writer already use one thread each.
    with opencv_threads(1):
        missing = track_video(drive, target, settings).missing
    elapsed_s = time.perf_counter() - began_s
    source = str(drive.video)
    sound = drive.info.has_audio
    return conclude_drive(source, target, drive.camera, drive.pose, settings, elapsed_s, missing=missing, sound=sound)


def track_video(drive: PreparedDrive, target: Path, settings: DriveSettings, **options: Any) -> VideoSummary:
    """Write the annotated video `target` and its telemetry, with a new tracker; `options` are for `annotate_video`."""
    process = track_lane(LaneTracker(drive.camera, fps=drive.info.fps), drive.camera, style=settings.style)
    return annotate_video(
        drive.video,
        target,
        process,
        yuv=True,
        start_s=settings.start_s,
        end_s=settings.end_s,
        progress=settings.progress,
        telemetry=target.with_suffix(".csv"),
        overlapped=settings.overlapped,
        info=drive.info,
        **options,
    )


def annotate_stills(pictures: Sequence[Path], settings: DriveSettings) -> StillsResult:
    """Find the lane in each still independently; write annotated pictures of the same names and `pictures.csv`.

    With `settings.each` every still has a camera pose of its own. Otherwise all are of one camera. A still that cannot
    be used is skipped; see `StillsResult.failures`.

    Raises
    ------
    PictureError
        If none of the stills can be used.
    ValueError
        If a still would be overwritten.
    CameraError, PoseError, OSError
        As `annotate_drive`.
    """
    require_distinct_outputs(pictures, [settings.output / path.name for path in pictures])
    groups, failures = pose_of_each(pictures, settings) if settings.each else _pose_of_all(pictures, settings)
    rows: list[dict[str, str | float | None]] = []
    written, lines, telemetry = [], [], settings.output / "pictures.csv"
    with exclusive_writer(telemetry):
        for paths, camera, pose in groups:
            view, draw = BirdsEyeView(camera), STYLES[settings.style](camera)
            for path in paths:
                image = read_image(path)
                evidence, lane = search_still(image, view)
                found = TrackedLane.from_still(lane)
                rows.append({"frame": len(rows), "picture": path.name, **found.as_row()})
                written.append(write_image(settings.output / path.name, as_rgb(draw(image, found, evidence))))
                if settings.each and pose:
                    result = f"{path}: {found.state} (confidence {found.confidence:.2f})"
                    lines.append(f"{result}; {pose.summary_line()}{settings.lens_of_still(path)}")
        write_telemetry(telemetry, rows)
    count = sum(row["state"] != LOST for row in rows)
    one_pose = None if settings.each else groups[0][2]
    return StillsResult(tuple(written), telemetry, count, one_pose, tuple(failures), tuple(lines))


# Stills of one camera, the camera with its pose, and the pose estimate (None if the camera had a pose).
StillsOfCamera = tuple[Sequence[Path], Camera, PoseEstimate | None]


def _pose_of_all(
    pictures: Sequence[Path], settings: DriveSettings
) -> tuple[list[StillsOfCamera], Sequence[ValueError]]:
    """The stills as those of one camera, and the errors of those that cannot be used."""
    size, usable, failures = _select_usable(pictures)
    try:
        return [(usable, *pose_from_drive(settings.camera_for(size, usable[0]), usable))], failures
    except PoseError as error:
        raise PoseError(f"{error}{SEVERAL_CAMERAS if len(usable) > 1 else ''}") from error


def pose_of_each(
    pictures: Sequence[Path], settings: DriveSettings
) -> tuple[list[StillsOfCamera], Sequence[ValueError]]:
    """The stills as those of one camera each, and the errors of those that cannot be used.

    Raises
    ------
    PictureError, PoseError, CameraError
        If none of the stills can be used.
    """
    groups: list[StillsOfCamera] = []
    failures: list[ValueError] = []
    for path in pictures:
        try:
            if path.suffix.lower() not in PICTURE_SUFFIXES:
                raise PictureError(f"{path}: is no still; --each is for stills of different cameras, omit it.")
            height, width = read_image(path).shape[:2]
            camera = settings.for_still(path).camera_for((width, height), path)
            groups.append(([path], *pose_from_drive(camera, [path])))
        except (PictureError, PoseError, CameraError) as error:
            failures.append(error)
    if not groups:
        raise type(failures[0])("\n".join(map(str, failures)))
    return groups, failures


def annotate_folder(folder: str | Path, output: str | Path, camera: Camera) -> StillsResult:
    """Annotate all pictures of a folder with `annotate_stills` into another folder.

    If the camera has no pose, the pose is estimated from the pictures.

    Raises
    ------
    FileNotFoundError
        If the folder does not exist or holds no picture.
    PictureError
        If some pictures could not be used. It names them, and is raised after the others were annotated.
    CameraError, PoseError, OSError, ValueError
        As `annotate_stills`.
    """
    result = annotate_stills(list_pictures(folder), DriveSettings(output=Path(output), camera=camera))
    if result.failures:
        raise PictureError("\n".join(map(str, result.failures)))
    return result


def _select_usable(pictures: Sequence[Path]) -> tuple[tuple[int, int], list[Path], list[PictureError]]:
    """The most frequent size (width, height), the pictures of that size, and one error for each other picture."""
    sizes, failures = {}, []
    for path in pictures:
        try:
            sizes[path] = read_image(path).shape[1::-1]
        except PictureError as error:
            failures.append(error)
    if not sizes:
        raise PictureError("\n".join(map(str, failures)))
    (most, _), *_ = Counter(sizes.values()).most_common(1)
    usable = [path for path, size in sizes.items() if size == most]
    failures += [
        PictureError(
            f"{path}: is {width}x{height}, the others used are {most[0]}x{most[1]}; annotate it alone, or all with "
            "--each."
        )
        for path, (width, height) in sizes.items()
        if (width, height) != most
    ]
    return most, usable, failures


def conclude_drive(
    source: str,
    video: Path,
    camera: Camera,
    pose: PoseEstimate | None,
    settings: DriveSettings,
    elapsed_s: float,
    *,
    missing: int = 0,
    sound: bool = False,
) -> DriveResult:
    """Summarise the telemetry file next to the annotated `video`, and write the report if `settings.report` is set.

    `source` is the path of the source video or the name of the live camera, `elapsed_s` the time that the annotation
    took, `missing` the number of frames missing in the source, and `sound` whether it has a sound track.
    """
    columns = read_telemetry(video.with_suffix(".csv"))
    frames = len(columns["frame"])
    with open_video(video) as written:
        lost_sound = sound and not written.streams.audio
    result = DriveResult(
        source=source,
        video=video,
        telemetry=video.with_suffix(".csv"),
        report=video.with_suffix(".html") if settings.report else None,
        camera=camera,
        pose=pose,
        frames=frames,
        tracked_share=share_tracked(columns),
        lost_s=seconds_lost(columns),
        frames_per_s=frames / elapsed_s,
        pose_change=find_pose_change(columns),
        wrong_yaw_rad=find_wrong_yaw(columns),
        missing=missing,
        lost_sound=lost_sound,
    )
    if result.report:
        used = describe_settings(result, settings)
        write_report(result.report, title=Path(source).name, video=video, telemetry=columns, settings=used)
    return result


def output_path(video: Path, folder: Path) -> Path:
    """Path of the annotated video in `folder`."""
    return folder / f"{video.stem}.mp4"
