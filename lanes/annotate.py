"""Settings for annotating drives, and the results: plain dataclasses that can be sent to another process."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from platform import python_version
from typing import Any

import av
import cv2
import numpy as np

from lanes.camera import Camera
from lanes.draw import STYLES, track_lane
from lanes.errors import CameraError, LaneError, PictureError, PoseError, VideoError
from lanes.field_of_view import FieldOfView, find_field_of_view
from lanes.files import exclusive_writer, read_telemetry, write_telemetry
from lanes.images import PICTURE_SUFFIXES, list_pictures, opencv_threads, read_image, write_image
from lanes.pose import PoseEstimate, describe_accuracy, ensure_pose
from lanes.report.moments import frame_lengths_s, seconds_lost, share_tracked
from lanes.report.page import write_report
from lanes.sources import require_distinct_outputs
from lanes.stills import StillDetection, detect_still
from lanes.track.pose_change import PoseChange, describe_wrong_yaw, find_pose_change, find_wrong_yaw
from lanes.track.tracker import LOST, LaneTracker, TrackedLane
from lanes.video.process import process_video
from lanes.video.reader import VideoInfo, inspect_video, open_video

SEVERAL_CAMERAS = " If the pictures are of several cameras, annotate them with --each."


@dataclass(frozen=True, kw_only=True)
class DriveSettings:
    """How to annotate drives.

    Parameters
    ----------
    output : Path
        Folder for the results. They are named after the drives.
    camera : Camera, optional
        A camera without a pose gets one that is estimated from the pictures of the drive. The camera is rescaled to
        drives of another size with the same aspect ratio.
    field : FieldOfView, optional
        Field of view of an uncalibrated lens, instead of `camera`.
    each : bool
        Every still is of a camera of its own.
    style : str
        One of `lanes.draw.STYLES`.
    start_s, end_s : float
        Part of each video to annotate, in seconds since its first frame; `end_s` None: up to the end.
    report : bool
        Write an HTML report next to each video.
    progress : bool
        Show a progress bar if stderr is a terminal.
    """

    output: Path
    camera: Camera | None = None
    field: FieldOfView | None = None
    each: bool = False
    style: str = "lane"
    start_s: float = 0.0
    end_s: float | None = None
    report: bool = True
    progress: bool = True

    def camera_for(self, size: tuple[int, int], name: object = "picture") -> Camera:
        """The camera for pictures of `size` (width, height); error messages begin with the `name` of the drive.

        Raises
        ------
        CameraError
            If neither a camera nor a field of view is set, or the camera has another aspect ratio.
        """
        if self.camera is not None:
            try:
                return self.camera if self.camera.size == size else self.camera.scaled(size)
            except CameraError as error:
                raise CameraError(f"{name}: {error}") from error
        if self.field is None:
            raise CameraError(f"{name}: no lens is known; give a camera or a horizontal field of view.")
        return Camera.from_fov(size, self.field.hfov_deg)

    def for_still(self, still: Path) -> DriveSettings:
        """The settings with the field of view from the EXIF entries of a still instead of an assumed one."""
        if self.field is None or not self.field.assumed:
            return self
        return replace(self, field=find_field_of_view([still]))

    def lens_of_still(self, still: Path) -> str:
        """Text such as "; field of view 62.6 deg, as a.jpg says (EXIF)"; empty if the camera is given."""
        field = self.for_still(still).field
        if self.camera is not None or field is None:
            return ""
        return f"; field of view {field.hfov_deg:.1f} deg, {'assumed' if field.assumed else field.source}"


@dataclass(frozen=True)
class DriveResult:
    """Result of annotating one drive.

    Attributes
    ----------
    source : str
        Path of the video, or name of the live camera.
    report : Path or None
        None if it was switched off.
    pose : PoseEstimate or None
        None if the camera already had a pose.
    tracked_share : float
        Share of the frames with state "tracking".
    lost_s : float
        Time with state "lost".
    frames_per_s : float
        Frames annotated per second, including reading and writing, without the camera pose estimate.
    length_s : float
        Duration of the annotated part.
    pose_change : PoseChange or None
        The moment at which the camera seems to have moved, if there is one.
    wrong_yaw_rad : float or None
        By how much the camera seems to look farther left than its pose says, if that is significant.
    missing : int
        Frames that are damaged in the video, or announced by it but absent.
    lost_sound : bool
        The video has a sound track that cannot be decoded, and the annotated video has none.
    """

    source: str
    video: Path
    telemetry: Path
    report: Path | None
    camera: Camera
    pose: PoseEstimate | None
    frames: int
    tracked_share: float
    lost_s: float
    frames_per_s: float
    length_s: float = 0.0
    pose_change: PoseChange | None = None
    wrong_yaw_rad: float | None = None
    missing: int = 0
    lost_sound: bool = False

    def describe(self) -> str:
        """A sentence about the drive, after the camera pose if it was estimated."""
        lines = [self.pose.describe(), describe_accuracy(self.pose)] if self.pose else []
        lines.append(
            f"{self.source}: {describe_frames(self.frames, self.missing)}, lane tracked in {self.tracked_share:.0%} of "
            f"them, lost for {self.lost_s:.1f} s; {self.frames_per_s:.0f} frames/s; wrote {self.video} with telemetry"
            f"{' and report' if self.report else ''} next to it"
        )
        if self.lost_sound:
            lines.append(f"{self.source}: its sound track cannot be decoded; {self.video} has no sound")
        if self.pose_change:
            lines.append(f"{self.source}: {self.pose_change.describe()}")
        elif self.wrong_yaw_rad is not None:
            lines.append(f"{self.source}: {describe_wrong_yaw(self.wrong_yaw_rad)}")
        return "\n".join(lines)


@dataclass(frozen=True)
class StillsResult:
    """Result of annotating stills.

    Attributes
    ----------
    pictures : tuple of Path
        Pictures written, in the order of the stills.
    found : int
        Number of stills in which a lane was found.
    pose : PoseEstimate or None
        None if the camera already had a pose, or every still has a camera of its own.
    failures : tuple of PictureError, PoseError or CameraError
        One error for each still that could not be used.
    each : tuple of str
        If every still has a camera of its own: result and camera pose of each.
    """

    pictures: tuple[Path, ...]
    telemetry: Path
    found: int
    pose: PoseEstimate | None
    failures: tuple[ValueError, ...] = ()
    each: tuple[str, ...] = ()

    def describe(self) -> str:
        """A sentence about the stills, after the camera pose if it was estimated."""
        pose = f"{self.pose.describe()}\n" if self.pose else "".join(f"{line}\n" for line in self.each)
        if self.pose and self.pose.frames_used < self.pose.frames_total / 2:
            pose += f"hint: few pictures show this camera pose.{SEVERAL_CAMERAS}\n"
        return (
            f"{pose}stills: {len(self.pictures)} pictures, lane found in {self.found}; wrote them and "
            f"{self.telemetry.name} to {self.telemetry.parent}"
        )


def describe_frames(frames: int, missing: int) -> str:
    """Text such as "250 frames" or "247 frames (3 more are damaged or missing in the video)"."""
    more = f" ({missing} more {'is' if missing == 1 else 'are'} damaged or missing in the video)" if missing else ""
    return f"{frames} frames{more}"


def describe_settings(result: DriveResult, settings: DriveSettings) -> dict[str, str]:
    """The settings and versions that a drive was annotated with, as texts by name, for the report."""
    camera, pose = result.camera, result.pose
    if settings.camera is None and settings.field is not None:
        lens = f"field of view {settings.field.hfov_deg:.3g}°, {settings.field.source}, not calibrated"
    elif camera.report is None:
        lens = "from the camera file"
    else:
        lens = f"calibrated on {len(camera.report.board_rms_px)} boards, error {camera.report.rms_px:.2f} px"
    texts = {
        "video": result.source,
        "piece": f"from {settings.start_s:g} s to {'the end' if settings.end_s is None else f'{settings.end_s:g} s'}",
        "picture": f"{camera.width}x{camera.height} pixels",
        "lens": f"{lens}; focal length {camera.matrix[0, 0]:.0f} px",
        "pose": pose.describe() if pose else f"from the camera file: {camera.require_pose().describe()}",
        "style": settings.style,
        "versions": ", ".join(f"{name} {version}" for name, version in versions().items()),
    }
    return texts | ({"frames": describe_frames(result.frames, result.missing)} if result.missing else {})


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that the results depend on."""
    return {"Python": python_version(), "OpenCV": cv2.__version__, "numpy": np.__version__, "PyAV": av.__version__}


# Annotation of a whole drive: camera pose, lane tracking, annotated video, telemetry and report.


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
    camera, pose = ensure_pose(camera, [video], start_s=settings.start_s, end_s=settings.end_s)
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


def track_video(drive: PreparedDrive, target: Path, settings: DriveSettings, **options: Any) -> VideoInfo:
    """Write the annotated video `target` and its telemetry, with a new tracker; `options` are for `process_video`."""
    process = track_lane(LaneTracker(drive.camera, fps=drive.info.fps), drive.camera, style=settings.style)
    return process_video(
        drive.video,
        target,
        process,
        start_s=settings.start_s,
        end_s=settings.end_s,
        progress=settings.progress,
        telemetry=target.with_suffix(".csv"),
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
    rows: list[dict[str, str | float | None]] = []
    written, lines, telemetry = [], [], settings.output / "pictures.csv"
    failures: list[LaneError] = []
    stills = detect_stills(pictures, settings, failures)
    first = next(stills)  # raises if no still can be used, before anything is written
    with exclusive_writer(telemetry):
        for still in chain([first], stills):
            path, image, detection = still.path, still.image, still.detection
            found = TrackedLane.from_still(detection.lane)
            drawn = STYLES[settings.style](detection.camera)(image, found, detection.evidence)
            rows.append({"frame": len(rows), "picture": path.name, **found.as_row()})
            written.append(write_image(settings.output / path.name, drawn))
            if settings.each and still.pose:
                result = f"{path}: {found.state} (confidence {found.confidence:.2f})"
                lines.append(f"{result}; {still.pose.summary_line()}{settings.lens_of_still(path)}")
        write_telemetry(telemetry, rows)
    count = sum(row["state"] != LOST for row in rows)
    one_pose = None if settings.each else first.pose
    return StillsResult(tuple(written), telemetry, count, one_pose, tuple(failures), tuple(lines))


@dataclass(frozen=True, eq=False)
class DetectedStill:
    """A still, what was found in it, in which time, and its pose estimate (None if the camera had a pose)."""

    path: Path
    image: np.ndarray
    detection: StillDetection
    pose: PoseEstimate | None
    run_time_s: float


def detect_stills(
    pictures: Sequence[Path], settings: DriveSettings, failures: list[LaneError]
) -> Iterator[DetectedStill]:
    """What is found in each still, one after the other; errors of stills that cannot be used go to `failures`.

    Raises
    ------
    PictureError, PoseError, CameraError
        If none of the stills can be used.
    """
    together = _detect_together(pictures, settings)
    none_used = True
    for still in (_detect_one(path, settings) for path in pictures) if settings.each else together:
        if isinstance(still, LaneError):
            failures.append(still)
        else:
            none_used = False
            yield still
    if none_used:
        raise type(failures[0])("\n".join(map(str, failures)))


def _detect_together(pictures: Sequence[Path], settings: DriveSettings) -> Iterator[DetectedStill | LaneError]:
    """What is found in each still of one camera, after the errors of the stills that cannot be used."""
    size, usable, failures = _select_usable(pictures)
    yield from failures
    try:
        camera, pose = ensure_pose(settings.camera_for(size, usable[0]), usable)
    except PoseError as error:
        raise PoseError(f"{error}{SEVERAL_CAMERAS if len(usable) > 1 else ''}") from error
    for path in usable:
        start_s = time.perf_counter()
        image = read_image(path)
        detection = pose.still if pose and pose.still else detect_still(image, camera)
        yield DetectedStill(path, image, detection, pose, time.perf_counter() - start_s)


def _detect_one(path: Path, settings: DriveSettings) -> DetectedStill | LaneError:
    """What is found in a still of a camera of its own; an error if it cannot be used."""
    try:
        if path.suffix.lower() not in PICTURE_SUFFIXES:
            raise PictureError(f"{path}: is no still; --each is for stills of different cameras, omit it.")
        image = read_image(path)
        camera = settings.for_still(path).camera_for((image.shape[1], image.shape[0]), path)
        start_s = time.perf_counter()
        try:
            camera, pose = ensure_pose(camera, image)
            detection = pose.still if pose and pose.still else detect_still(image, camera)
        except (PoseError, CameraError) as error:
            raise type(error)(f"{path}: {error}") from error
        return DetectedStill(path, image, detection, pose, time.perf_counter() - start_s)
    except LaneError as error:
        return error


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
        length_s=float(frame_lengths_s(columns["time_s"]).sum()),
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
