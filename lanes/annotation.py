"""What `annotate` takes and gives: the options of drives and stills, and a result."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from lanes.camera.field_of_view import FieldOfView
from lanes.camera.model import Camera
from lanes.detect.markings import Markings
from lanes.equality import ByValue
from lanes.errors import LaneError
from lanes.pose.estimate import PoseEstimate
from lanes.telemetry import Telemetry


@dataclass(frozen=True, kw_only=True)
class DriveOptions:
    """The keyword options of `lanes.annotate`, which describes them."""

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


@dataclass(frozen=True, kw_only=True)
class DriveSettings(DriveOptions):
    """How drives and stills are annotated; can be sent to another process.

    `field`, of an uncalibrated lens, is used if there is no `camera`, not even one in a
    robot log.
    """

    output: Path
    camera: Camera | None = None
    field: FieldOfView | None = None
    # The options of the command line that name the camera, for the commands in the
    # report.
    camera_options: str = ""


def require_options(options: dict[str, Any]) -> DriveOptions:
    """The options by their names; raises LaneError for one that does not exist."""
    known = {field.name for field in fields(DriveOptions)}
    unknown = sorted(options.keys() - known)
    if unknown:
        raise LaneError(
            f"annotate has no option {', '.join(unknown)}; its options are "
            f"{', '.join(sorted(known))}."
        )
    return DriveOptions(**options)


@dataclass(frozen=True, eq=False)
class Annotation(ByValue):
    """Result of annotating one video, or stills."""

    # The files written: annotated video, telemetry and report, or annotated images and
    # telemetry.
    outputs: tuple[Path, ...]
    # The columns (rows,) of the telemetry by name, a row per frame or still, as
    # `read_telemetry` returns them.
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
        if len(self.outputs) > 3:
            files += f" and {len(self.outputs) - 3} more"
        rows = len(self.telemetry["state"])
        return f"Annotation({rows} rows of telemetry, {files})"
