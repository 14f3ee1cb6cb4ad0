"""Whole drives and stills: camera pose, lane, annotated video or images, telemetry and report."""

from __future__ import annotations

import shlex
import sys
import time
import warnings
from collections import Counter
from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import closing, nullcontext, suppress
from dataclasses import dataclass, fields, replace
from functools import partial
from itertools import chain
from pathlib import Path
from platform import python_version
from typing import Any

import av
import cv2
import numpy as np

from lanes.camera.field_of_view import GIVEN, FieldOfView, find_field_of_view, read_log_camera
from lanes.camera.model import Camera, CameraPose, require_camera
from lanes.console import progress_line
from lanes.describe import describe_offset
from lanes.detect.lane import LOST, POSE_NAMES, Lane, telemetry_row
from lanes.detect.markings import Markings
from lanes.detect.search import DETECTOR, StillDetection
from lanes.errors import ByValue, CameraError, LaneError, PictureError, PoseError, VideoError
from lanes.files import TelemetryWriter, translate_write_errors
from lanes.pose.change import describe_wrong_yaw, find_pose_change, find_wrong_yaw
from lanes.pose.estimate import ESTIMATED, POSE_PICTURES, PoseEstimate, detect_in_drive, ensure_pose, estimate_pose
from lanes.ros.robot_log import index_log
from lanes.show.draw import draw_lane, track_lane
from lanes.show.lane_messages import MESSAGES_SUFFIX, write_lane_messages
from lanes.show.report import Telemetry, describe_confidence, describe_shares, seconds_lost, write_report
from lanes.tracking.departure import describe_crossings
from lanes.tracking.tracker import LaneTracker, TrackerSettings
from lanes.video.images import opencv_threads, read_image, write_image
from lanes.video.reader import MIRRORED_WORDS, TimedFrame, VideoInfo, describe_jumps, inspect_video, read_frames
from lanes.video.sources import Sources, find_sources, read_turn, require_distinct_outputs, require_topic, sample_images
from lanes.video.writer import process_video


@dataclass(frozen=True, kw_only=True)
class DriveSettings:
    """How drives and stills are annotated, see `annotate`; can be sent to another process.

    `field`, of an uncalibrated lens, is used if there is no `camera`, not even one in a robot log.
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
    topic: str | None = None
    markings: Markings | None = None
    camera_offset_m: float | None = None
    car_width_m: float | None = None
    lane_width_m: float | None = None
    height_m: float | None = None
    speed_mps: float | None = None
    # The options of the command line that name the camera, for the commands in the report.
    camera_options: str = ""

    def camera_for(self, size: tuple[int, int], file: Path) -> Camera:
        """The camera of a file with upright images of `size` (width, height).

        A camera without a pose may be one for images as the sensor sees them: it is turned as the file says, if it then
        has the aspect ratio of the images. Raises CameraError if it has another one.
        """
        camera = self._intrinsics_for(size, file)
        offset_m = camera.offset_m if self.camera_offset_m is None else self.camera_offset_m
        car_width_m = self.car_width_m or camera.car_width_m
        if (offset_m, car_width_m) == (camera.offset_m, camera.car_width_m):
            return camera
        return replace(camera, offset_m=offset_m, car_width_m=car_width_m)

    def _intrinsics_for(self, size: tuple[int, int], file: Path) -> Camera:
        given = self.camera or (self.field and self.field.source == GIVEN)
        camera = self.camera if given else read_log_camera(file, self.topic)
        if camera is None:
            field = self.field_of(file)
            if doubt := field.doubt_about(size):
                warnings.warn(f"{file}: {doubt}.", stacklevel=1)
            return field.camera(size)
        if camera.pose is None and (turned := camera.turned(read_turn(file))).has_aspect_of(size):
            camera = turned
        try:
            return camera if camera.size == size else camera.scaled(size)
        except CameraError as error:
            raise CameraError(f"{file}: {error}") from error

    def ensure_pose(self, camera: Camera, source: Any, **options: Any) -> tuple[Camera, PoseEstimate | None]:
        """As `lanes.pose.estimate.ensure_pose`, with the given height or lane width; CameraError if the camera has a pose."""
        if camera.pose and (self.height_m or self.lane_width_m):
            raise CameraError(
                "the camera file holds a pose; omit --height and --lane-width, or estimate it again with `pose`."
            )
        if self.progress and sys.stderr.isatty():
            options.setdefault("progress", progress_line("pose"))
        given = {"height_m": self.height_m, "lane_width_m": self.lane_width_m, "markings": self.markings}
        return ensure_pose(camera, source, **given, **options)

    def field_of(self, file: Path) -> FieldOfView:
        """The field of view of an uncalibrated lens; with `each` that of the file's own EXIF entries, unless given."""
        if self.field is None or (self.each and self.field.assumed):
            return find_field_of_view([file])
        return self.field

    def describe_lens(self, file: Path) -> str:
        """Words such as "; field of view 62.6 deg, as a.jpg says (EXIF)"; empty if the camera is given."""
        return "" if self.camera else f"; {self.field_of(file).words}"


@dataclass(frozen=True, eq=False)
class Annotation(ByValue):
    """Result of annotating one video, or stills."""

    # The files written: annotated video, telemetry and report, or annotated images and telemetry.
    outputs: tuple[Path, ...]
    # The columns (rows,) of the telemetry by name, a row per frame or still, as `read_telemetry` returns them.
    telemetry: Telemetry
    # The result and the files written, in words.
    description: str
    # None if the camera already had a pose, or every still has a camera of its own.
    pose: PoseEstimate | None = None
    # Frames that are damaged in the video, or announced by it but absent.
    missing: int = 0
    # One error for each still that could not be used.
    failures: tuple[LaneError, ...] = ()

    def __repr__(self) -> str:
        files = ", ".join(path.name for path in self.outputs[:3])
        more = f" and {len(self.outputs) - 3} more" if len(self.outputs) > 3 else ""
        return f"Annotation({len(self.telemetry['state'])} rows of telemetry, {files}{more})"


def annotate(
    sources: str | Path | Iterable[str | Path], output: str | Path, camera: Camera | None = None, **options: Any
) -> list[Annotation]:
    """Draw the lane on videos and stills, and write its telemetry; returns a result for each video and for the stills.

    >>> (result,) = lanes.annotate("drive.mp4", "out/", camera)  # doctest: +SKIP
    >>> result.telemetry["offset_m"]  # doctest: +SKIP

    Parameters
    ----------
    sources : path, or iterable of paths
        Videos, stills, folders of them, and patterns such as ``drives/*.mp4``.
    output : path
        Folder for the results. They are named after the sources.
    camera : Camera, optional
        If it has no pose, the pose is estimated from each drive. It is rescaled to images of another size with the same
        aspect ratio. Without a camera the field of view is that of the stills' EXIF entries, or 60 degrees.
    each : bool
        Every still is of a camera of its own. By default they share one camera.
    style : str
        A name in `lanes.show.draw.STYLES`; "lane" by default.
    start_s, end_s : float
        Part of each video to annotate, in seconds since its first frame. By default the whole video.
    report : bool
        Write an HTML report next to each video, as is the default.
    progress : bool
        Show a progress bar, as is the default, if stderr is a terminal or a notebook.
    topic : str
        Topic of the images in robot logs; by default the only one. See `lanes.show.lane_messages` for their output.
    markings : callable, as for `lanes.find_lane`
    camera_offset_m : float
        Position of the camera left of the middle of the car, negative right; by default that of `camera`.
    car_width_m : float
        Width of the car over its tyres, for departure warnings; by default that of `camera`.
    height_m, lane_width_m : float
        Height of the camera, or width of the lanes, if the pose is estimated; see `lanes.estimate_pose`.
    speed_mps : float
        Speed of the car; estimated if not given.

    Raises
    ------
    FileNotFoundError, LaneError, OSError
        If a source cannot be used, or an output cannot be written; raised after the other sources were annotated.
    ValueError
        If an output would overwrite a source or another output.
    """
    names = [sources] if isinstance(sources, str | Path) else sources
    known = {field.name for field in fields(DriveSettings)} - {"output", "camera", "field"}
    if unknown := options.keys() - known:
        words = ", ".join(sorted(unknown)), ", ".join(sorted(known))
        raise LaneError(f"annotate has no option {words[0]}; its options are {words[1]}.")
    found = find_sources(map(str, names))
    require_topic(found.videos, options.get("topic"))
    field = find_field_of_view(found.files, options.get("topic")).warn() if camera is None else None
    camera = camera if camera is None else require_camera(camera)
    settings = DriveSettings(output=Path(output), camera=camera, field=field, **options)
    outcomes = list(annotate_sources(found, settings))
    results = [outcome for outcome in outcomes if isinstance(outcome, Annotation)]
    failures = [outcome for outcome in outcomes if not isinstance(outcome, Annotation)]
    failures += [failure for result in results for failure in result.failures]
    if failures:
        raise type(failures[0])("\n".join(map(str, failures)))
    return results


def annotate_sources(sources: Sources, settings: DriveSettings) -> Iterator[Annotation | OSError | ValueError]:
    """Annotate each video, then all stills; yields the result of each, or the error if it cannot be annotated.

    Raises ValueError if an output would overwrite a video or another output.
    """
    require_distinct_outputs(sources.videos, [output_path(video, settings.output) for video in sources.videos])
    jobs = [partial(annotate_drive, video, settings) for video in sources.videos]
    jobs += [partial(annotate_stills, sources.stills, settings)] if sources.stills else []
    for job in jobs:
        try:
            yield job()
        except (OSError, ValueError) as error:
            yield error


# Drives.


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
    """Track the lane through a video; yields each frame with its lane, None where it is lost.

    >>> for frame, lane in lanes.track("drive.mp4"):  # doctest: +SKIP
    ...     print(frame.time_s, lane)

    Parameters
    ----------
    path : path
        The video.
    camera : Camera, optional
        With its pose, and of the size of the video. Without a camera it is estimated as by `annotate`.
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
    require_topic([Path(path)], topic)
    pose = None
    if camera is None:
        part: dict[str, Any] = {"start_s": start_s, "end_s": end_s, "topic": topic, "markings": markings}
        field = find_field_of_view([Path(path)], topic).warn()
        info, camera, pose = prepare_drive(Path(path), DriveSettings(output=Path(), field=field, **part))
    else:
        info = inspect_video(path, topic=topic)
    size = info.width, info.height
    if require_camera(camera).size != size:
        raise CameraError(f"{path}: is {size[0]}x{size[1]} pixels, unlike the camera; give camera.scaled({size}).")
    tracker = make_tracker(info.fps, camera, pose, markings, speed_mps=speed_mps)
    with closing(read_frames(path, info, start_s=start_s, end_s=end_s, progress=progress)) as frames:
        yield from track_frames(frames, tracker)


def track_frames(frames: Iterable[TimedFrame], tracker: LaneTracker) -> Iterator[tuple[TimedFrame, Lane | None]]:
    """Each frame with its latency, and its lane. The tracker gets the time between frames, which varies."""
    for frame in frames:
        began_s = time.perf_counter()
        lane = tracker.update(frame.image, elapsed_s=frame.elapsed_s)
        yield replace(frame, latency_ms=1e3 * (time.perf_counter() - began_s)), lane


def prepare_drive(video: Path, settings: DriveSettings) -> tuple[VideoInfo, Camera, PoseEstimate | None]:
    """Properties of a video, its camera with the pose, and the pose estimate (None if the camera had a pose)."""
    info = inspect_video(video, topic=settings.topic)
    if settings.start_s >= info.duration_s:
        raise VideoError(f"{video}: lasts {info.duration_s:g} s; begin before that, not at {settings.start_s:g} s.")
    camera = settings.camera_for((info.width, info.height), video)
    options: dict[str, Any] = {"start_s": settings.start_s, "end_s": settings.end_s, "topic": settings.topic}
    images = sample_images([video], POSE_PICTURES, require=camera.require_size, infos={video: info}, **options)
    try:
        return info, *settings.ensure_pose(camera, images)
    except PoseError as error:
        raise PoseError(f"{video}: {error}") from error


def make_tracker(
    fps: float,
    camera: Camera,
    pose: PoseEstimate | None,
    markings: Markings | None,
    settings: TrackerSettings | None = None,
    *,
    speed_mps: float | None = None,
) -> LaneTracker:
    """A tracker for a drive; it looks for the pose again where the lane is not likely, if the `pose` was estimated."""

    def find_pose(image: np.ndarray) -> StillDetection | None:
        with suppress(CameraError):  # the pose sees no road
            detector = settings.detector if settings else DETECTOR
            height_m = pose.given_height_m if pose else None
            return estimate_pose(image, camera, height_m=height_m, markings=markings, settings=detector).still
        return None

    shift = pose.confidence_shift if pose else 0.0
    options: dict[str, Any] = {"speed_mps": speed_mps, "markings": markings, "settings": settings}
    options["confidence_shift"] = shift
    return LaneTracker(camera, fps=fps, find_pose=find_pose if pose else None, **options)


def annotate_drive(video: str | Path, settings: DriveSettings) -> Annotation:
    """Annotate a video, and write its telemetry and report next to it; errors are those of `annotate`.

    Both arguments can be sent to another process. The only side effect is the files written.
    """
    video, target = Path(video), output_path(Path(video), settings.output)
    info, camera, pose = prepare_drive(video, settings)
    with translate_write_errors(target.with_suffix(".html")):
        target.with_suffix(".html").exists()  # its name is the longest: refused now, not after minutes of work
    began_s = time.perf_counter()
    tracker = make_tracker(info.fps, camera, pose, settings.markings, speed_mps=settings.speed_mps)
    path = target.with_suffix(".csv")
    log = index_log(video, info.topic) if info.topic else None
    writer = write_lane_messages(path, tracker, log) if log else nullcontext(TelemetryWriter(path))
    function = track_lane(tracker, style=settings.style)
    # Decoder, tracker and encoder already run in a thread each.
    with opencv_threads(1), writer as table:
        options: dict[str, Any] = {"progress": settings.progress, "telemetry": table, "info": info}
        written = process_video(video, target, function, start_s=settings.start_s, end_s=settings.end_s, **options)
    telemetry, elapsed_s = table.columns(), time.perf_counter() - began_s
    count, missing = written.frames, written.missing
    more = f" ({missing} more {'is' if missing == 1 else 'are'} damaged or missing in the video)" if missing else ""
    outputs = (target, path) + ((path.with_suffix(MESSAGES_SUFFIX),) if info.topic else ())
    doubts = _find_warnings(info, camera, settings, telemetry)
    other_poses = _describe_other_poses(telemetry, camera.require_pose())
    if not other_poses:  # with another pose for a part of the drive, its angles cannot be compared
        doubts += _find_moved_camera(pose, telemetry)
    if info.has_audio and not written.has_audio:
        doubts.append(f"its sound cannot be decoded; {target} has no sound")
    if settings.report:
        page = target.with_suffix(".html")
        write_report(
            page,
            title=video.name,
            video=target,
            telemetry=telemetry,
            settings=_describe_run(video, camera, pose, settings) | {"frames": f"{count} frames{more}"},
            warnings=[*_pose_warnings(video, pose, settings), *doubts],
            command=_explain_command(video, settings),
        )
        outputs += (page,)
    lines = [pose.describe(), pose.describe_accuracy()] if pose else []
    lines.append(
        f"{video}: {count} frames{more}, {describe_shares(telemetry)}; lost for {seconds_lost(telemetry):.1f} s"
        f"{describe_confidence(telemetry)}; {count / elapsed_s:.0f} frames/s; "
        f"wrote {target} with telemetry{' and report' if settings.report else ''} next to it"
    )
    lines += [f"{video}: {words}" for words in (*other_poses, *doubts)]
    return Annotation(outputs, telemetry, "\n".join(lines), pose, missing)


def _find_warnings(info: VideoInfo, camera: Camera, settings: DriveSettings, telemetry: Telemetry) -> list[str]:
    """What seems to be wrong with a video or its camera, a sentence each."""
    mirrored = MIRRORED_WORDS if info.mirrored else None
    centred = settings.camera_offset_m is None and not camera.offset_m
    crossings = describe_crossings(telemetry, camera.car_width_m) if centred else None
    return list(filter(None, [describe_jumps(telemetry["time_s"], info.fps), mirrored, info.note, crossings]))


def _describe_other_poses(telemetry: Telemetry, first: CameraPose) -> list[str]:
    """When the tracker went on with the pose of one image, because no lane was likely with that of the drive."""
    poses = np.column_stack([telemetry[f"pose_{name}"] for name in POSE_NAMES])
    known = np.flatnonzero(np.isfinite(poses[:, 0]))
    before = np.vstack([[getattr(first, name) for name in POSE_NAMES], poses[known]])[:-1]
    changed = known[(np.abs(poses[known] - before) > 1e-9).any(axis=1)]
    described = ((telemetry["time_s"][k], CameraPose(*poses[k]).describe()) for k in changed)
    return [f"from {time_s:.1f} s on with another pose: {words}" for time_s, words in described]


def _find_moved_camera(pose: PoseEstimate | None, telemetry: Telemetry) -> list[str]:
    """What seems to be wrong with the pose that a whole drive was tracked with."""
    if change := find_pose_change(telemetry):
        return [change.describe()]
    if (yaw_rad := find_wrong_yaw(telemetry)) is None:
        return []
    other = "annotate a straighter part of it (--start, --end), or give a camera file with a pose (--camera)."
    remedy = other if pose else "estimate the pose from this drive (`python -m lanes pose`), and annotate it again."
    return [f"{describe_wrong_yaw(yaw_rad)}; {remedy}"]


def _pose_warnings(video: Path, pose: PoseEstimate | None, settings: DriveSettings) -> list[str]:
    """What is doubtful of the lens and of an estimated pose; the terminal shows it before the work."""
    field = None if settings.camera else settings.field_of(video)
    lens = [field.describe()] if field and field.doubtful else []
    return lens + (list(pose.notes) if pose and pose.lane_width_m is None else [])


def _explain_command(video: Path, settings: DriveSettings) -> str:
    """The command that explains a frame of this drive, up to the value of --at."""
    camera = settings.camera_options or ("--camera camera.yaml" if settings.camera else "")
    part = f"--start {settings.start_s:g}" if settings.start_s else ""
    part += f" --end {settings.end_s:g}" if settings.end_s is not None else ""
    return " ".join(filter(None, ["python -m lanes explain", camera, part.strip(), shlex.quote(str(video)), "--at "]))


def _describe_run(video: Path, camera: Camera, pose: PoseEstimate | None, settings: DriveSettings) -> dict[str, str]:
    """The settings and versions that a drive was annotated with, as texts by name, for the report."""
    if settings.camera is None:
        lens = settings.field_of(video).words
    elif camera.report is None:
        lens = "from the camera file"
    else:
        lens = f"calibrated on {len(camera.report.board_rms_px)} boards, error {camera.report.rms_px:.2f} px"
    return {
        "video": str(video),
        "part": f"from {settings.start_s:g} s to {'the end' if settings.end_s is None else f'{settings.end_s:g} s'}",
        "picture": f"{camera.width}x{camera.height} pixels",
        "lens": f"{lens}; focal length {camera.matrix[0, 0]:.0f} px",
        "pose": pose.describe() if pose else f"from the camera file: {camera.require_pose().describe()}",
        "camera": f"{describe_offset(camera.offset_m)} of the car, which is {camera.car_width_m:g} m wide",
        "style": settings.style,
        "markings": str(settings.markings or "own"),
        "versions": ", ".join(f"{name} {version}" for name, version in versions().items()),
    }


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that the results depend on."""
    return {"Python": python_version(), "OpenCV": cv2.__version__, "numpy": np.__version__, "PyAV": av.__version__}


def output_path(video: Path, folder: Path) -> Path:
    """Path of the annotated video in `folder`."""
    return folder / f"{video.stem}.mp4"


# Stills.


def annotate_stills(stills: Sequence[Path], settings: DriveSettings) -> Annotation:
    """Find the lane in each still independently; write annotated images of the same names and `pictures.csv`.

    A still that cannot be used is skipped; see `Annotation.failures`. Errors are those of `annotate`.
    """
    require_distinct_outputs(stills, [settings.output / path.name for path in stills])
    outputs, lines = [], []
    failures: list[LaneError] = []
    detected = detect_stills(stills, settings, failures)
    first = next(detected)  # raises if no still can be used, before anything is written
    path, pose = settings.output / "pictures.csv", None
    with TelemetryWriter(path) as table:
        for still in chain([first], detected):
            detection = still.detection
            lane, camera = detection.lane, detection.camera
            drawn = draw_lane(still.image, lane, camera, style=settings.style, evidence=detection.evidence)
            outputs.append(write_image(settings.output / still.path.name, drawn))
            table.write({"frame": len(outputs) - 1, "picture": still.path.name, **telemetry_row(lane)})
            if still.pose is None or still.pose.still is None:
                pose = still.pose
            else:
                found = f"{lane.state} (confidence {lane.confidence:.2f})" if lane else LOST
                lines.append(f"{still.path}: {found}; {still.pose.summary_line()}{settings.describe_lens(still.path)}")
    if pose:
        lines.append(pose.describe())
        if pose.state != ESTIMATED:
            remedy = "If the pictures are of several cameras, annotate them with --each."
            lines.append(f"hint: few pictures show this camera pose. {remedy}")
    telemetry = table.columns()
    found_words = f"{describe_shares(telemetry)}{describe_confidence(telemetry)}"
    lines.append(f"stills: {len(outputs)} pictures, {found_words}; wrote them and {path.name} to {path.parent}")
    return Annotation((*outputs, path), telemetry, "\n".join(lines), pose, failures=tuple(failures))


@dataclass(frozen=True, eq=False)
class StillResult:
    """A still with its detection, the time of the detection, and its pose estimate (None if the camera had a pose)."""

    path: Path
    image: np.ndarray
    detection: StillDetection
    pose: PoseEstimate | None
    run_time_ms: float


def detect_stills(stills: Sequence[Path], settings: DriveSettings, failures: list[LaneError]) -> Iterator[StillResult]:
    """The detection in each still, one after the other; errors of stills that cannot be used go to `failures`.

    If none of the stills can be used, the errors are raised as one.
    """
    none_used = True
    for group in [[path] for path in stills] if settings.each else [stills]:
        try:
            for still in _detect_group(group, settings, failures):
                none_used = False
                yield still
        except LaneError as error:
            failures.append(error)
    if none_used:
        raise type(failures[-1])("\n".join(map(str, failures)))


def _detect_group(stills: Sequence[Path], settings: DriveSettings, failures: list[LaneError]) -> Iterator[StillResult]:
    """The detection in each still of one camera; see `detect_in_drive` for the pose."""
    sizes: dict[Path, tuple[int, int]] = {}
    for path in stills:
        try:
            image = read_image(path)
            sizes[path] = image.shape[1::-1]
        except PictureError as error:
            failures.append(error)
    if not sizes:
        return
    width, height = Counter(sizes.values()).most_common(1)[0][0]
    used = f"the others used are {width}x{height}; annotate it alone, or all with --each."
    usable = [path for path, size in sizes.items() if size == (width, height)]
    failures += [PictureError(f"{p}: is {w}x{h}, {used}") for p, (w, h) in sizes.items() if p not in usable]
    # A still that is alone stays in memory; several could fill it.
    alone = len(sizes) == 1
    began_s = time.perf_counter()
    try:
        camera = settings.camera_for((width, height), usable[0])
        camera, pose = settings.ensure_pose(camera, image if alone else usable)
    except PoseError as error:
        raise PoseError(f"{usable[0]}: {error}") from error
    for path in usable:
        if not alone:
            image, began_s = read_image(path), time.perf_counter()
        detection, of_still = detect_in_drive(image, camera, pose, settings.markings)
        yield StillResult(path, image, detection, of_still, 1e3 * (time.perf_counter() - began_s))
