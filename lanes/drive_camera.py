"""The camera of a drive or of stills: as given, as the files say, or estimated."""

from __future__ import annotations

import sys
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

from lanes.annotation import DriveSettings
from lanes.camera.field_of_view import (
    GIVEN,
    FieldOfView,
    find_field_of_view,
    read_log_camera,
)
from lanes.camera.model import Camera
from lanes.console import progress_line
from lanes.errors import CameraError
from lanes.pose.estimate import PoseEstimate, Progress, ensure_pose
from lanes.video.sources import read_turn


def camera_for(settings: DriveSettings, size: tuple[int, int], file: Path) -> Camera:
    """The camera of a file with upright images of `size` (width, height).

    A camera without a pose may be one for images as the sensor sees them: it is turned
    as the file says, if it then has the aspect ratio of the images. Raises CameraError
    if it has another one.
    """
    camera = _lens_for(settings, size, file)
    offset_m = settings.camera_offset_m
    if offset_m is None:
        offset_m = camera.offset_m
    car_width_m = settings.car_width_m or camera.car_width_m
    if (offset_m, car_width_m) == (camera.offset_m, camera.car_width_m):
        return camera
    return replace(camera, offset_m=offset_m, car_width_m=car_width_m)


def _lens_for(settings: DriveSettings, size: tuple[int, int], file: Path) -> Camera:
    """The given camera, that in a robot log, or one with a field of view."""
    camera = settings.camera
    is_field_given = settings.field is not None and settings.field.source == GIVEN
    if camera is None and not is_field_given:
        camera = read_log_camera(file, settings.topic)
    if camera is None:
        field = field_for(settings, file)
        doubt = field.doubt_about(size)
        if doubt:
            warnings.warn(f"{file}: {doubt}.", stacklevel=1)
        return field.camera(size)

    if camera.pose is None:
        turned = camera.turned(read_turn(file))
        if turned.has_aspect_of(size):
            camera = turned
    try:
        return camera if camera.size == size else camera.scaled(size)
    except CameraError as error:
        raise CameraError(f"{file}: {error}") from error


def field_for(settings: DriveSettings, file: Path) -> FieldOfView:
    """The field of view of an uncalibrated lens.

    With `each` it is that of the file's own EXIF entries, unless given.
    """
    field = settings.field
    if field is None or (settings.each and field.assumed):
        return find_field_of_view([file])
    return field


def describe_lens(settings: DriveSettings, file: Path) -> str:
    """Words such as "; field of view 62.6 deg, as a.jpg says (EXIF)".

    They are empty if the camera is given.
    """
    return "" if settings.camera else f"; {field_for(settings, file).words}"


def pose_for(
    settings: DriveSettings,
    camera: Camera,
    source: Any,
    *,
    progress: Progress | None = None,
    **part: Any,
) -> tuple[Camera, PoseEstimate | None]:
    """As `lanes.pose.estimate.ensure_pose`, with the given height or lane width.

    Raises CameraError if a camera with a pose has another given height or width.
    """
    if camera.pose and (settings.height_m or settings.lane_width_m):
        raise CameraError(
            "the camera file holds a pose; omit --height and --lane-width, or estimate "
            "it again with `pose`."
        )
    if progress is None and settings.progress and sys.stderr.isatty():
        progress = progress_line("pose")
    return ensure_pose(
        camera,
        source,
        height_m=settings.height_m,
        lane_width_m=settings.lane_width_m,
        markings=settings.markings,
        progress=progress,
        **part,
    )
