"""Whole drives: find out the camera, then read, track and write.

A drive becomes an annotated video, telemetry and a report. Stills are those of
`lanes.stills`.
"""

from __future__ import annotations

import shlex
import time
from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import closing, nullcontext, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from platform import python_version
from typing import Any, Unpack

import av
import cv2
import numpy as np

from lanes.annotation import (
    AnnotateOptions,
    Annotation,
    DriveSettings,
    require_options,
)
from lanes.camera.field_of_view import find_field_of_view
from lanes.camera.model import Camera, CameraPose, require_camera
from lanes.describe import describe_offset
from lanes.detect.lane import FROZEN, Lane
from lanes.detect.markings import Markings
from lanes.detect.search import StillDetection
from lanes.drive_camera import camera_for, field_for, pose_for
from lanes.errors import CameraError, PoseError, VideoError
from lanes.files import TelemetryWriter, require_path, translate_write_errors
from lanes.pose.change import (
    describe_other_poses,
    describe_wrong_yaw,
    find_pose_change,
    find_wrong_yaw,
)
from lanes.pose.estimate import (
    POSE_PICTURES,
    PoseEstimate,
    estimate_in_drive,
)
from lanes.ros.log_files import is_robot_log
from lanes.ros.robot_log import index_log
from lanes.show.draw import track_lane
from lanes.show.lane_messages import MESSAGES_SUFFIX, write_lane_messages
from lanes.show.report import (
    describe_confidence,
    describe_shares,
    seconds_lost,
    write_report,
)
from lanes.stills import annotate_stills, still_outputs
from lanes.telemetry import POSE_NAMES, Telemetry
from lanes.tracking.departure import describe_crossings
from lanes.tracking.tracker import LaneTracker, TrackerSettings
from lanes.video.images import opencv_threads
from lanes.video.reader import (
    MIRRORED_WORDS,
    TimedFrame,
    VideoInfo,
    describe_jumps,
    inspect_video,
    read_frames,
)
from lanes.video.sources import (
    Sources,
    find_sources,
    list_paths,
    require_distinct_outputs,
    require_topic,
    sample_images,
)
from lanes.video.writer import process_video

# Differences of poses in the telemetry that come from rounding.
_SAME_POSE = 1e-9


def annotate(
    sources: str | Path | Iterable[str | Path],
    output: str | Path,
    camera: Camera | None = None,
    **options: Unpack[AnnotateOptions],
) -> list[Annotation]:
    """Draw the lane on videos and stills, and write its telemetry.

    Returns a result for each video and for the stills.

    >>> (result,) = lanes.annotate("drive.mp4", "out/", camera)  # doctest: +SKIP
    >>> result.telemetry["offset_m"]  # doctest: +SKIP

    Parameters
    ----------
    sources : path, or iterable of paths
        Videos, stills, folders of them, and patterns such as ``drives/*.mp4``.
    output : path
        Folder for the results. They are named after the sources.
    camera : Camera, optional
        If it has no pose, the pose is estimated from each drive. It is rescaled to
        images of another size with the same aspect ratio. Without a camera the field of
        view is that of the stills' EXIF entries, or 60 degrees.
    each : bool
        Every still is of a camera of its own. By default they share one camera.
    style : str
        A name in `lanes.show.draw.STYLES`; "lane" by default.
    start_s, end_s : float
        Part of each video to annotate, in seconds since its first frame. By default the
        whole video.
    report : bool
        Write an HTML report next to each video, as is the default.
    progress : bool
        Show a progress bar, as is the default, if stderr is a terminal or a notebook.
    topic : str
        Topic of the images in robot logs; by default the only one. See
        `lanes.show.lane_messages` for their output.
    markings : callable, as for `lanes.find_lane`
    camera_offset_m : float
        Position of the camera left of the middle of the car, negative right; by default
        that of `camera`.
    car_width_m : float
        Width of the car over its tyres, for departure warnings; by default that of
        `camera`.
    height_m, lane_width_m : float
        Height of the camera, or width of the lanes, if the pose is estimated; see
        `lanes.estimate_pose`.
    speed_mps : float
        Speed of the car; estimated if not given.

    Raises
    ------
    FileNotFoundError, LaneError, OSError
        If a source cannot be used, or an output cannot be written; raised after the
        other sources were annotated.
    ValueError
        If an output would overwrite a source or another output.
    """
    require_options(options)
    topic = options.get("topic")
    found = find_sources(list_paths(sources)).warn()
    require_topic(found.videos, topic)
    field = None
    if camera is None:
        field = find_field_of_view(found.files, topic).warn()
    else:
        require_camera(camera)
    settings = DriveSettings(output=Path(output), camera=camera, field=field, **options)

    results: list[Annotation] = []
    failures: list[Exception] = []
    failed_stills: list[Exception] = []
    for outcome in annotate_sources(found, settings):
        if isinstance(outcome, Annotation):
            results.append(outcome)
            failed_stills += outcome.failures
        else:
            failures.append(outcome)
    failures += failed_stills
    if failures:
        raise type(failures[0])("\n".join(map(str, failures)))
    return results


def annotate_sources(
    sources: Sources, settings: DriveSettings
) -> Iterator[Annotation | OSError | ValueError]:
    """Annotate each video, then all stills.

    Yields the result of each, or the error if it cannot be annotated. Raises ValueError
    if an output would overwrite a video or another output.
    """
    require_distinct_outputs(planned_outputs(sources, settings))
    jobs = [partial(annotate_drive, video, settings) for video in sources.videos]
    if sources.stills:
        jobs.append(partial(annotate_stills, sources.stills, settings))
    for job in jobs:
        try:
            yield job()
        except (OSError, ValueError) as error:
            yield error


def track(
    path: str | Path,
    camera: Camera | None = None,
    *,
    speed_mps: float | None = None,
    start_s: float = 0.0,
    end_s: float | None = None,
    topic: str | None = None,
    progress: bool = False,
    markings: Markings | None = None,
) -> Generator[tuple[TimedFrame, Lane | None]]:
    """Track the lane through a video.

    Yields each frame with its lane, None where it is lost.

    >>> for frame, lane in lanes.track("drive.mp4"):  # doctest: +SKIP
    ...     print(frame.time_s, lane)

    Parameters
    ----------
    path : path
        The video.
    camera : Camera, optional
        With its pose, and of the size of the video. Without a camera it is estimated as
        by `annotate`.
    speed_mps : float, optional
        Speed of the car; estimated if not given.
    start_s, end_s, progress
        As for `process_video`.
    topic : str, optional
        Topic of the images in a robot log; by default the only one.
    markings : callable, optional, as for `lanes.find_lane`

    Raises
    ------
    FileNotFoundError, LaneError
        If the video cannot be read, or the camera has no pose or another size.
    """
    video = require_path(path)
    require_topic([video], topic)
    pose = None
    if camera is None:
        settings = DriveSettings(
            output=Path(),
            field=find_field_of_view([video], topic).warn(),
            start_s=start_s,
            end_s=end_s,
            topic=topic,
            markings=markings,
        )
        info, camera, pose = prepare_drive(video, settings)
    else:
        info = inspect_video(path, topic=topic, start_s=start_s)
    size = (info.width, info.height)
    if require_camera(camera).size != size:
        raise CameraError(
            f"{path}: is {size[0]}x{size[1]} pixels, unlike the camera; give "
            f"camera.scaled({size})."
        )

    tracker = make_tracker(info.fps, camera, pose, markings, speed_mps=speed_mps)
    frames = read_frames(path, info, start_s=start_s, end_s=end_s, progress=progress)
    with closing(frames):
        yield from track_frames(frames, tracker)


def track_frames(
    frames: Iterable[TimedFrame], tracker: LaneTracker
) -> Iterator[tuple[TimedFrame, Lane | None]]:
    """Each frame with its latency, and its lane.

    The tracker gets the time between frames, which varies.
    """
    for frame in frames:
        began_s = time.perf_counter()
        lane = tracker.update(frame.image, elapsed_s=frame.elapsed_s)
        latency_ms = 1e3 * (time.perf_counter() - began_s)
        yield replace(frame, latency_ms=latency_ms), lane


def prepare_drive(
    video: Path, settings: DriveSettings
) -> tuple[VideoInfo, Camera, PoseEstimate | None]:
    """Properties of a video, its camera with the pose, and the pose estimate.

    The estimate is None if the camera had a pose.
    """
    start_s = settings.start_s
    info = inspect_video(video, topic=settings.topic, start_s=start_s)
    if start_s >= info.duration_s:
        raise VideoError(
            f"{video}: lasts {info.duration_s:g} s; begin before that, not at "
            f"{start_s:g} s."
        )
    lens = camera_for(settings, (info.width, info.height), video)
    images = sample_images(
        [video],
        POSE_PICTURES,
        require=lens.require_size,
        start_s=start_s,
        end_s=settings.end_s,
        infos={video: info},
        topic=settings.topic,
    )
    try:
        camera, pose = pose_for(settings, lens, images)
    except PoseError as error:
        raise PoseError(f"{video}: {error}") from error
    return info, camera, pose


def make_tracker(
    fps: float,
    camera: Camera,
    pose: PoseEstimate | None,
    markings: Markings | None,
    settings: TrackerSettings | None = None,
    *,
    speed_mps: float | None = None,
) -> LaneTracker:
    """A tracker for a drive.

    It looks for the pose again where the lane is not likely, if the `pose` was
    estimated.
    """
    if settings is None:
        settings = TrackerSettings()
    if pose is None:
        return LaneTracker(
            camera, fps=fps, speed_mps=speed_mps, settings=settings, markings=markings
        )
    drive = pose

    def find_pose(image: np.ndarray) -> StillDetection | None:
        with suppress(CameraError):  # the pose sees no road
            of_image = estimate_in_drive(
                image, camera, drive, settings.detector, markings=markings
            )
            return of_image.still
        return None

    return LaneTracker(
        camera,
        fps=fps,
        speed_mps=speed_mps,
        find_pose=find_pose,
        settings=settings,
        markings=markings,
        confidence_shift=drive.confidence_shift,
        lane_width_m=drive.lane_width_m,
    )


def annotate_drive(video: str | Path, settings: DriveSettings) -> Annotation:
    """Annotate a video, and write its telemetry and report next to it.

    Errors are those of `annotate`. Both arguments can be sent to another process. The
    only side effect is the files written.
    """
    video = Path(video)
    target = output_path(video, settings.output)
    table_path = target.with_suffix(".csv")
    page = target.with_suffix(".html")
    info, camera, pose = prepare_drive(video, settings)
    with translate_write_errors(page):
        page.exists()  # its name is the longest: refused now, not after minutes of work

    # read, track and write
    began_s = time.perf_counter()
    tracker = make_tracker(
        info.fps, camera, pose, settings.markings, speed_mps=settings.speed_mps
    )
    writer: Any = nullcontext(TelemetryWriter(table_path))
    if info.topic:
        log = index_log(video, info.topic)
        writer = write_lane_messages(table_path, tracker, log)
    # decoder, tracker and encoder already run in a thread each
    with opencv_threads(1), writer as table:
        written = process_video(
            video,
            target,
            track_lane(tracker, style=settings.style),
            start_s=settings.start_s,
            end_s=settings.end_s,
            progress=settings.progress,
            telemetry=table,
            info=info,
        )
    elapsed_s = time.perf_counter() - began_s

    # what is doubtful
    telemetry = table.columns()
    doubts = _find_warnings(info, camera, settings, telemetry)
    other_poses = _find_other_poses(telemetry, camera.require_pose())
    if not other_poses:
        # with another pose for a part of the drive, its angles cannot be compared
        doubts += _find_moved_camera(pose, telemetry)
    if written.sound_tracks < info.sound_tracks:
        doubts.append(
            f"its sound cannot be decoded: {target} has {written.sound_tracks} of "
            f"{info.sound_tracks} sound tracks"
        )

    counted = f"{written.frames} frames{_describe_missing(written.missing)}"
    if settings.report:
        write_report(
            page,
            title=video.name,
            video=target,
            telemetry=telemetry,
            settings=_describe_run(video, camera, pose, settings) | {"frames": counted},
            warnings=[*_pose_warnings(video, pose, settings), *doubts],
            other_poses=other_poses,
            command=_explain_command(video, settings),
        )
    lines = [pose.describe(), pose.describe_accuracy()] if pose else []
    with_report = " and report" if settings.report else ""
    lines.append(
        f"{video}: {counted}, {describe_shares(telemetry)}; "
        f"lost for {seconds_lost(telemetry):.1f} s{describe_confidence(telemetry)}; "
        f"{written.frames / elapsed_s:.0f} frames/s; "
        f"wrote {target} with telemetry{with_report} next to it"
    )
    found_at_s = {telemetry["time_s"][row]: words for row, words in other_poses}
    doubts = [*describe_other_poses(found_at_s), *doubts]
    lines += [f"{video}: {words}" for words in doubts]
    return Annotation(
        outputs=tuple(drive_outputs(video, settings)),
        telemetry=telemetry,
        description="\n".join(lines),
        pose=pose,
        missing=written.missing,
    )


def _describe_missing(missing: int) -> str:
    """Words about frames that are damaged or missing; empty if none are."""
    if not missing:
        return ""
    verb = "is" if missing == 1 else "are"
    return f" ({missing} more {verb} damaged or missing in the video)"


def _find_warnings(
    info: VideoInfo, camera: Camera, settings: DriveSettings, telemetry: Telemetry
) -> list[str]:
    """What seems to be wrong with a video or its camera, a sentence each."""
    found: list[str | None] = [describe_jumps(telemetry["time_s"], info.fps)]
    if info.mirrored:
        found.append(MIRRORED_WORDS)
    found.append(info.note)
    found.append(_describe_frozen(telemetry))
    if settings.camera_offset_m is None and not camera.offset_m:
        found.append(describe_crossings(telemetry, camera.car_width_m))
    return [words for words in found if words]


def _describe_frozen(telemetry: Telemetry) -> str | None:
    """When the camera repeated an image; None if it did not."""
    is_frozen = (telemetry["state"] == FROZEN).astype(int)
    begins = np.flatnonzero(np.diff(is_frozen, prepend=0) == 1)
    if not begins.size:
        return None
    times = ", ".join(f"{telemetry['time_s'][k]:.1f} s" for k in begins[:5])
    return (
        f"the picture stands still at {times}: the camera repeats an image, and the "
        "lane is only predicted"
    )


def _find_other_poses(telemetry: Telemetry, first: CameraPose) -> list[tuple[int, str]]:
    """The rows from which on the tracker has the pose of one image, and these poses.

    It does if no lane was likely with that of the drive.
    """
    found = []
    last = np.array([getattr(first, name) for name in POSE_NAMES])
    poses = np.column_stack([telemetry[f"pose_{name}"] for name in POSE_NAMES])
    for row, pose in enumerate(poses):
        if not np.isfinite(pose[0]):
            continue
        if (np.abs(pose - last) > _SAME_POSE).any():
            found.append((row, CameraPose(*pose).describe()))
        last = pose
    return found


def _find_moved_camera(pose: PoseEstimate | None, telemetry: Telemetry) -> list[str]:
    """What seems to be wrong with the pose that a whole drive was tracked with."""
    change = find_pose_change(telemetry)
    if change:
        return [change.describe()]
    yaw_rad = find_wrong_yaw(telemetry)
    if yaw_rad is None:
        return []
    remedy = (
        "estimate the pose from this drive (`python -m lanes pose`), and annotate it "
        "again."
    )
    if pose:
        remedy = (
            "annotate a straighter part of it (--start, --end), or give a camera file "
            "with a pose (--camera)."
        )
    return [f"{describe_wrong_yaw(yaw_rad)}; {remedy}"]


def _pose_warnings(
    video: Path, pose: PoseEstimate | None, settings: DriveSettings
) -> Sequence[str]:
    """What is doubtful of the lens and of an estimated pose.

    The terminal shows it before the work.
    """
    found: list[str] = []
    if not settings.camera:
        field = field_for(settings, video)
        if field.doubtful:
            found.append(field.describe())
    if pose and pose.lane_width_m is None:
        found += pose.notes
    return found


def _explain_command(video: Path, settings: DriveSettings) -> str:
    """The command that explains a frame of this drive, up to the value of --at."""
    words = ["python -m lanes explain"]
    if settings.camera_options:
        words.append(settings.camera_options)
    elif settings.camera:
        words.append("--camera camera.yaml")
    if settings.start_s:
        words.append(f"--start {settings.start_s:g}")
    if settings.end_s is not None:
        words.append(f"--end {settings.end_s:g}")
    return " ".join([*words, shlex.quote(str(video)), "--at "])


def _describe_run(
    video: Path, camera: Camera, pose: PoseEstimate | None, settings: DriveSettings
) -> dict[str, str]:
    """The settings and versions that a drive was annotated with, for the report.

    They are texts by name.
    """
    if settings.camera is None:
        lens = field_for(settings, video).words
    elif camera.report is None:
        lens = "from the camera file"
    else:
        boards = len(camera.report.board_rms_px)
        error_px = camera.report.rms_px
        lens = f"calibrated on {boards} boards, error {error_px:.2f} px"
    end = "the end" if settings.end_s is None else f"{settings.end_s:g} s"
    pose_words = f"from the camera file: {camera.require_pose().describe()}"
    if pose:
        pose_words = pose.describe()
    return {
        "video": str(video),
        "part": f"from {settings.start_s:g} s to {end}",
        "picture": f"{camera.width}x{camera.height} pixels",
        "lens": f"{lens}; focal length {camera.matrix[0, 0]:.0f} px",
        "pose": pose_words,
        "camera": (
            f"{describe_offset(camera.offset_m)} of the car, which is "
            f"{camera.car_width_m:g} m wide"
        ),
        "style": settings.style,
        "markings": str(settings.markings or "own"),
        "versions": ", ".join(f"{name} {text}" for name, text in versions().items()),
    }


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that the results depend on."""
    return {
        "Python": python_version(),
        "OpenCV": cv2.__version__,
        "numpy": np.__version__,
        "PyAV": av.__version__,
    }


def output_path(video: Path, folder: Path) -> Path:
    """Path of the annotated video in `folder`."""
    return folder / f"{video.stem}.mp4"


def drive_outputs(video: Path, settings: DriveSettings) -> list[Path]:
    """The files that `annotate_drive` writes, the annotated video first."""
    suffixes = [".mp4", ".csv"]
    if is_robot_log(video):
        suffixes.append(MESSAGES_SUFFIX)
    if settings.report:
        suffixes.append(".html")
    target = output_path(video, settings.output)
    return [target.with_suffix(suffix) for suffix in suffixes]


def planned_outputs(
    sources: Sources, settings: DriveSettings
) -> list[tuple[Path, Path]]:
    """The files that `annotate` writes, each with the source that it is made from."""
    planned = still_outputs(sources.stills, settings)
    for video in sources.videos:
        planned += [(video, output) for output in drive_outputs(video, settings)]
    return planned
