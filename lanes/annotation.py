"""What `annotate` takes and gives: the options of drives and stills, and a result."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import TypedDict

from lanes.camera.field_of_view import FieldOfView
from lanes.camera.model import Camera
from lanes.detect.markings import Markings
from lanes.equality import ByValue
from lanes.errors import LaneError
from lanes.pose.estimate import PoseEstimate
from lanes.telemetry import Telemetry


class AnnotateOptions(TypedDict, total=False):
    """The keyword options of `lanes.annotate`, which describes them.

    `DriveSettings` has the same names, and the defaults.
    """

    each: bool
    style: str
    start_s: float
    end_s: float | None
    report: bool
    progress: bool
    topic: str | None
    markings: Markings | None
    camera_offset_m: float | None
    car_width_m: float | None
    lane_width_m: float | None
    height_m: float | None
    speed_mps: float | None


@dataclass(frozen=True, kw_only=True)
class DriveSettings:
    """How drives and stills are annotated; can be sent to another process.

    `field`, of an uncalibrated lens, is used if there is no `camera`, not even one in a
    robot log. `camera_options` are those of the command line that name the camera, for
    the commands in the report.
    """

    output: Path
    camera: Camera | None = None
    field: FieldOfView | None = None
    camera_options: str = ""
    # the options of `lanes.annotate`
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


def require_options(options: Collection[str]) -> None:
    """Raise LaneError for an option that `lanes.annotate` does not have."""
    known = AnnotateOptions.__annotations__.keys()
    unknown = sorted(set(options) - known)
    if unknown:
        raise LaneError(
            f"annotate has no option {', '.join(unknown)}; its options are "
            f"{', '.join(sorted(known))}."
        )


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
