"""Camera pose from the files of a drive: stills, videos, or frames of a live camera."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from lanes.camera.camera import Camera
from lanes.camera.pose_from_lanes.estimator import estimate_pose
from lanes.camera.pose_from_lanes.pose_estimate import PoseError, PoseEstimate
from lanes.io.footage import pick_pictures
from lanes.io.images import list_pictures, read_image

# Pictures taken from a drive; more did not improve the estimate.
POSE_PICTURES = 40


def pose_from_drive(
    camera: Camera,
    files: Sequence[Path],
    *,
    start_s: float = 0.0,
    end_s: float | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Camera, PoseEstimate | None]:
    """The camera with a pose: its own if it has one, otherwise the pose estimated from the files.

    `files` are stills and videos of one drive; of the videos the part from `start_s` to `end_s` is used. `progress` is
    called with (pictures done, pictures in all). The second result is None if the camera already had a pose.

    Raises
    ------
    PoseError
        If the files do not determine the pose; see `estimate_pose`.
    PictureError
        If a picture is not of the camera's size.
    """
    if camera.pose is not None:
        return camera, None
    pictures = pick_pictures(list(files), POSE_PICTURES, require=camera.require_size, start_s=start_s, end_s=end_s)
    return pose_from_pictures(camera, pictures, str(files[0]), progress=progress)


def pose_from_pictures(
    camera: Camera,
    pictures: Iterable[np.ndarray],
    name: str,
    *,
    progress: Callable[[int, int], None] | None = None,
    **options: float | None,
) -> tuple[Camera, PoseEstimate]:
    """The camera with the pose estimated from pictures, and the estimate.

    The name of the drive precedes the message of an error. `options` are `lane_width_m` and `height_m` of
    `estimate_pose`, to which also `progress` and the pictures are passed.

    Raises
    ------
    PoseError
        If the pictures do not determine the pose; see `estimate_pose`.
    """
    try:
        estimate = estimate_pose(pictures, camera, progress=progress, **options)
    except PoseError as error:
        raise PoseError(f"{name}: {error}") from error
    return camera.with_pose(estimate.pose), estimate


def estimate_camera_pose(camera: Camera, folder: str | Path) -> Camera:
    """The camera with the pose estimated from a folder of pictures of one drive.

    Raises
    ------
    FileNotFoundError
        If the folder does not exist or holds no picture.
    PictureError
        If a picture cannot be read or is not of the camera's size.
    PoseError
        If the pictures do not determine the pose; see `estimate_pose`.
    """
    return camera.with_pose(estimate_pose(_read_pictures(folder, camera), camera).pose)


def _read_pictures(folder: str | Path, camera: Camera) -> Iterator[np.ndarray]:
    for path in list_pictures(folder):
        image = read_image(path)
        camera.require_size(image, path)
        yield image
