"""Settings for annotating drives, and the results: plain dataclasses that can be sent to another process."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from platform import python_version

import av
import cv2
import numpy as np

from lanes.camera.camera import Camera
from lanes.camera.camera_pose import CameraError
from lanes.camera.field_of_view import FieldOfView, find_field_of_view
from lanes.camera.pose_change import PoseChange, describe_wrong_yaw
from lanes.pose_from_lanes.pose_estimate import PoseEstimate, describe_accuracy

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
        One of `lanes.drives.overlay_styles.STYLES`.
    start_s, end_s : float
        Part of each video to annotate, in seconds since its first frame; `end_s` None: up to the end.
    report : bool
        Write an HTML report next to each video.
    progress : bool
        Show a progress bar if stderr is a terminal.
    overlapped : bool
        Read, process and write in parallel; see `annotate_video`.
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
    overlapped: bool = True

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
    pose_change: PoseChange | None = None
    wrong_yaw_rad: float | None = None
    missing: int = 0
    lost_sound: bool = False

    def describe(self) -> str:
        """A sentence about the drive, after the camera pose if it was estimated."""
        lines = [self.pose.describe(), describe_accuracy(self.pose, self.camera)] if self.pose else []
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
