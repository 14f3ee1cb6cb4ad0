"""How drives are annotated, and what came of one: plain data that can be sent to another process."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from platform import python_version

import av
import cv2
import numpy as np

from lanes.camera.camera import Camera
from lanes.camera.camera_pose import CameraError
from lanes.camera.field_of_view import FieldOfView
from lanes.camera.pose_change import PoseChange
from lanes.camera.pose_from_lanes.pose_estimate import PoseEstimate, describe_accuracy
from lanes.io.frames import PictureError


@dataclass(frozen=True, kw_only=True)
class DriveSettings:
    """How to annotate drives.

    Parameters
    ----------
    output : Path
        Folder for the results, which take their names from the drives.
    camera : Camera, optional
        The lens; without a pose the drive's own pictures tell it. Rescaled to drives of another size and the same
        shape.
    field : FieldOfView, optional
        Of a lens that was never calibrated, instead of `camera`.
    style : str
        One of `lanes.drives.overlay_styles.STYLES`.
    start_s, end_s : float
        The piece of each video, seconds since its first frame.
    report : bool
        Write the HTML report beside each video.
    progress : bool
        Show a bar where stderr is a terminal.
    overlapped : bool
        Read, process and write at the same time; see `annotate_video`.
    """

    output: Path
    camera: Camera | None = None
    field: FieldOfView | None = None
    style: str = "lane"
    start_s: float = 0.0
    end_s: float | None = None
    report: bool = True
    progress: bool = True
    overlapped: bool = True

    def camera_for(self, size: tuple[int, int], name: object = "picture") -> Camera:
        """The camera for pictures of `size` (width, height); errors begin with the `name` of the drive.

        Raises
        ------
        CameraError
            If no lens was named, or its pictures have another shape.
        """
        if self.camera is not None:
            try:
                return self.camera if self.camera.size == size else self.camera.scaled(size)
            except CameraError as error:
                raise CameraError(f"{name}: {error}") from error
        if self.field is None:
            raise CameraError(f"{name}: no lens is known; give a camera or a horizontal field of view.")
        return Camera.from_fov(size, self.field.hfov_deg)


@dataclass(frozen=True)
class DriveResult:
    """What came of one drive.

    Attributes
    ----------
    source : str
        Name of the video, or of the camera.
    video, telemetry : Path
        Files written.
    report : Path or None
    camera : Camera
        As used, with its pose.
    pose : PoseEstimate or None
        None where the camera came with its pose.
    frames : int
    tracked_share : float
        Share of the frames in which the lane was tracked.
    lost_s : float
        How long it was not known.
    frames_per_s : float
        Frames annotated in a second of work, reading and writing included; the camera pose's estimate is left out.
    moved : PoseChange or None
        Whether the camera seems to have moved on the way.
    missing : int
        Frames that are damaged in the video, or not there although it announces them.
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
    moved: PoseChange | None = None
    missing: int = 0

    def describe(self) -> str:
        """The drive in a sentence, after the camera pose if it was estimated."""
        written = f"{self.video} with telemetry{' and report' if self.report else ''} beside it"
        moved = f"\n{self.source}: {self.moved.describe()}" if self.moved else ""
        accuracy = [describe_accuracy(self.pose, self.camera)] if self.pose else []
        frames = describe_frames(self.frames, self.missing)
        return _below_pose(
            self.pose,
            *accuracy,
            f"{self.source}: {frames}, lane tracked in {self.tracked_share:.0%} of them, lost for {self.lost_s:.1f} s; "
            f"{self.frames_per_s:.0f} frames/s; wrote {written}{moved}",
        )


@dataclass(frozen=True)
class StillsResult:
    """What came of stills.

    Attributes
    ----------
    pictures : tuple of Path
        Written, in the order of the stills.
    telemetry : Path
    found : int
        In how many there was a lane.
    pose : PoseEstimate or None
        None where the camera came with its pose.
    failures : tuple of PictureError
        One for each still that could not be used, naming it.
    """

    pictures: tuple[Path, ...]
    telemetry: Path
    found: int
    pose: PoseEstimate | None
    failures: tuple[PictureError, ...] = ()

    def describe(self) -> str:
        """The stills in a sentence, after the camera pose if it was estimated."""
        folder = self.telemetry.parent
        return _below_pose(
            self.pose,
            f"stills: {len(self.pictures)} pictures, lane found in {self.found}; wrote them and "
            f"{self.telemetry.name} to {folder}",
        )


def _below_pose(pose: PoseEstimate | None, *sentences: str) -> str:
    return "\n".join([*([pose.describe()] if pose else []), *sentences])


def describe_frames(frames: int, missing: int) -> str:
    """Words: "250 frames", "247 frames (3 more are damaged or missing in the video)"."""
    more = f" ({missing} more {'is' if missing == 1 else 'are'} damaged or missing in the video)" if missing else ""
    return f"{frames} frames{more}"


def describe_settings(
    source: str, camera: Camera, pose: PoseEstimate | None, settings: DriveSettings
) -> dict[str, str]:
    """What a drive was annotated with, for people."""
    if settings.camera is None:
        lens = f"field of view {settings.field.hfov_deg:.3g}°, {settings.field.source}, not calibrated"
    elif camera.report is None:
        lens = "as the camera file says"
    else:
        lens = f"calibrated on {len(camera.report.board_rms_px)} boards, error {camera.report.rms_px:.2f} px"
    return {
        "video": source,
        "piece": f"from {settings.start_s:g} s to {'the end' if settings.end_s is None else f'{settings.end_s:g} s'}",
        "picture": f"{camera.width}x{camera.height} pixels",
        "lens": f"{lens}; focal length {camera.matrix[0, 0]:.0f} px",
        "pose": pose.describe() if pose else f"as the camera file says: {camera.pose.describe()}",
        "style": settings.style,
        "versions": ", ".join(f"{name} {version}" for name, version in versions().items()),
    }


def versions() -> dict[str, str]:
    """What the results depend on, besides this project."""
    return {"Python": python_version(), "OpenCV": cv2.__version__, "numpy": np.__version__, "PyAV": av.__version__}
