"""The mount from the drive itself, where the camera does not bring one."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np

from lanes.camera import Camera
from lanes.mounting.mount import MountError, MountEstimate, estimate_mount
from lanes.video.footage import pick_pictures

# More pictures than this find nothing new.
MOUNT_PICTURES = 40


def mount_from_drive(
    camera: Camera,
    files: Sequence[Path],
    *,
    start_s: float = 0.0,
    end_s: float | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Camera, MountEstimate | None]:
    """The camera with a mount: its own, or else the one that the files show, videos between `start_s` and `end_s`; and
    the estimate, if there was one.

    Raises
    ------
    MountError
        If the files do not tell it.
    """
    if camera.mount is not None:
        return camera, None
    pictures = pick_pictures(list(files), MOUNT_PICTURES, camera, start_s=start_s, end_s=end_s)
    return mount_from_pictures(camera, pictures, str(files[0]), progress=progress)


def mount_from_pictures(
    camera: Camera, pictures: Iterable[np.ndarray], name: str, *, progress: Callable[[int, int], None] | None = None
) -> tuple[Camera, MountEstimate]:
    """The camera on the mount that pictures show; errors begin with the `name` of the drive."""
    try:
        estimate = estimate_mount(pictures, camera, progress=progress)
    except MountError as error:
        raise MountError(f"{name}: {error}") from error
    return camera.with_mount(estimate.mount), estimate
