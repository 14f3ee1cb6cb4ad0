"""Field of view of the camera from the files of a drive: EXIF, broken lines of known period, or the default."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from lanes.camera.camera import Camera
from lanes.camera.camera_pose import CameraError
from lanes.camera.field_of_view import DEFAULT_HFOV_DEG, FieldOfView, read_hfov
from lanes.camera.pose_from_lanes.pose_estimate import PoseError
from lanes.camera.pose_from_lanes.pose_from_files import POSE_PICTURES, pose_from_pictures
from lanes.drives.dash_period import measure_dash_period
from lanes.io.footage import pick_pictures
from lanes.io.images import PICTURE_SUFFIXES

# Lenses to look at broken lines with: where one shows their period outside 4 to 30 m, the next does not.
TRIED_HFOV_DEG = (60.0, 100.0)


def find_field_of_view(files: Sequence[Path], *, dash_period_m: float | None = None) -> FieldOfView:
    """The horizontal field of view of the camera that took stills and videos.

    Parameters
    ----------
    files : sequence of Path
        Of one camera; at least one.
    dash_period_m : float, optional
        Length of one dash and one gap of the road's broken lines. Without it the EXIF entries of the stills are asked,
        and where they do not tell it either, `DEFAULT_HFOV_DEG` is assumed.

    Raises
    ------
    CameraError
        If the files show no broken line that repeats clearly.
    """
    if dash_period_m is not None:
        return _from_dashes(files, dash_period_m)
    for file in files:
        hfov_deg = read_hfov(file) if Path(file).suffix.lower() in PICTURE_SUFFIXES else None
        if hfov_deg is not None:
            return FieldOfView(hfov_deg, f"as {Path(file).name} says (EXIF)")
    return FieldOfView(DEFAULT_HFOV_DEG, "assumed, because neither the command nor the files name one", assumed=True)


def _from_dashes(files: Sequence[Path], dash_period_m: float) -> FieldOfView:
    if not files:
        raise CameraError("a live camera's broken lines are not measured; give --hfov, or an earlier drive's --camera.")
    images = list(pick_pictures(list(files), POSE_PICTURES))
    size = images[0].shape[1], images[0].shape[0]
    for hfov_deg in TRIED_HFOV_DEG:
        camera = Camera.from_fov(size, hfov_deg)
        try:
            camera, _ = pose_from_pictures(camera, images, str(files[0]))
        except PoseError:
            continue
        period = measure_dash_period(images, camera)
        if period is not None:
            focal_px = camera.matrix[0, 0] * dash_period_m / period.period_m
            hfov_deg = float(np.degrees(2 * np.arctan(size[0] / 2 / focal_px)))
            return FieldOfView(hfov_deg, f"from {period.lines} broken lines of {dash_period_m:g} m, to about 10 %")
    raise CameraError(
        f"{files[0]}: shows no broken line that repeats clearly, so its period does not tell the field of view; "
        "give --hfov, or pictures of a motorway."
    )
