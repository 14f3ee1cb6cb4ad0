"""The road from above: the four-point warp of the classic recipes, and what its pixels mean in metres.

Conventions
-----------
- picture = the undistorted picture, view = the picture warped to look down on the road; both in pixels (u, v);
- road points are (x forward, y left) in metres, as in lanes.camera.camera.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from lanes.camera.camera import Camera
from lanes.camera.camera_pose import CameraError
from lanes.io.frames import PictureError, require_rgb


@dataclass(frozen=True, eq=False)
class FourPointWarp:
    """The view in which four picture points come to lie on four chosen view points.

    Four points on the road that form a rectangle there give a true map of a flat road (up to two scales); the
    trapezia chosen by eye in the classic recipes come close to that, but not quite.

    Parameters
    ----------
    source_px : array_like of shape (4, 2)
        Points (u, v) in the undistorted picture, in order around the quadrangle.
    destination_px : array_like of shape (4, 2)
        Where they come to lie in the view, in the same order.
    size : tuple of int
        (width, height) in pixels, of the picture and of the view.

    Raises
    ------
    ValueError
        If there are not four points, or they do not go around a convex quadrangle.
    """

    source_px: np.ndarray
    destination_px: np.ndarray
    size: tuple[int, int]

    def __post_init__(self) -> None:
        for name in ("source_px", "destination_px"):
            points = np.array(getattr(self, name), np.float32)
            _require_quadrangle(points, name)
            object.__setattr__(self, name, points)
        object.__setattr__(self, "matrix", cv2.getPerspectiveTransform(self.source_px, self.destination_px))
        object.__setattr__(self, "inverse", np.linalg.inv(self.matrix))

    def warp(self, image: np.ndarray) -> np.ndarray:
        """Undistorted picture to view, both (height, width) of `size`; binaries (2-D) keep their two values.

        Raises
        ------
        PictureError
            If `image` is neither an RGB picture nor a binary of that size.
        """
        self._require_size(image)
        return cv2.warpPerspective(image, self.matrix, self.size, flags=_interpolation(image))

    def unwarp(self, image: np.ndarray, size: tuple[int, int] | None = None) -> np.ndarray:
        """View back to an undistorted picture of `size` (width, height), by default the view's own; black outside.

        Raises
        ------
        PictureError
            If `image` is neither an RGB picture nor a binary of the view's size.
        """
        self._require_size(image)
        return cv2.warpPerspective(image, self.inverse, size or self.size, flags=_interpolation(image))

    def points_to_view(self, points_px: np.ndarray) -> np.ndarray:
        """Points (N, 2) of the undistorted picture to points (N, 2) of the view."""
        return _transform(points_px, self.matrix)

    def points_to_picture(self, points_px: np.ndarray) -> np.ndarray:
        """Points (N, 2) of the view to points (N, 2) of the undistorted picture."""
        return _transform(points_px, self.inverse)

    def _require_size(self, image: np.ndarray) -> None:
        if not (isinstance(image, np.ndarray) and image.ndim == 2 and image.dtype == np.uint8):
            require_rgb(image)
        (width, height), got = self.size, image.shape[1::-1]
        if got != (width, height):
            raise PictureError(
                f"picture: is {got[0]}x{got[1]} pixels, but this warp is for {width}x{height}; "
                "use a picture of that size, or a warp made for this one."
            )


def view_to_road(points_px: np.ndarray, warp: FourPointWarp, camera: Camera) -> np.ndarray:
    """Put points of the view on the flat road, exactly, whatever quadrangle the warp was made from.

    Parameters
    ----------
    points_px : ndarray of shape (N, 2)
        Points (u, v) in the view.
    warp : FourPointWarp
    camera : Camera
        With a camera pose; its lens has already been taken out of the picture that `warp` starts from.

    Returns
    -------
    ndarray of shape (N, 2)
        (x forward, y left) in metres; NaN at and above the horizon.

    Raises
    ------
    CameraError
        If the camera has no pose.
    """
    pinhole = replace(camera, distortion=np.zeros(5))
    return pinhole.pixels_to_road(warp.points_to_picture(points_px))


def scale_to_road(points_px: np.ndarray, metres_per_px: tuple[float, float], view_size: tuple[int, int]) -> np.ndarray:
    """Put points of the view on the road by two fixed scales, as the original recipes do.

    Assumes that the car stands at the middle of the view's bottom row and looks along its columns.

    Parameters
    ----------
    points_px : ndarray of shape (N, 2)
        Points (u, v) in the view.
    metres_per_px : tuple of float
        Metres per column and metres per row, for example (3.7 / 700, 30 / 720).
    view_size : tuple of int
        (width, height) in pixels.

    Returns
    -------
    ndarray of shape (N, 2)
        (x forward, y left) in metres, counted from the bottom row and the middle column.
    """
    points = np.asarray(points_px, float)
    width, height = view_size
    return np.column_stack(
        [(height - 1 - points[:, 1]) * metres_per_px[1], ((width - 1) / 2 - points[:, 0]) * metres_per_px[0]]
    )


def metres_per_pixel(warp: FourPointWarp, camera: Camera) -> tuple[float, float]:
    """The two scales that describe a four-point warp best, from the camera pose.

    A single pair of scales is exact only when the quadrangle is a rectangle on the road. Across, the scale is taken
    where the offset is measured, at the middle of the bottom row (the local Jacobian); along, it is the road's length
    between bottom and top row on the middle column, divided by the rows between them.

    Returns
    -------
    tuple of float
        (metres per column, metres per row).

    Raises
    ------
    CameraError
        If the camera has no pose, or the view reaches up to the horizon.
    """
    width, height = warp.size
    middle, bottom = (width - 1) / 2, height - 1
    points = np.array([[middle - 0.5, bottom], [middle + 0.5, bottom], [middle, bottom], [middle, 0]])
    road = view_to_road(points, warp, camera)
    if not np.isfinite(road).all():
        raise CameraError(
            "the warp's quadrangle reaches the horizon of this camera pose, so its rows have no length on the "
            "road; choose lower points or correct the camera pose's pitch."
        )
    across = float(np.linalg.norm(road[0] - road[1]))
    along = float(np.linalg.norm(road[3] - road[2])) / max(height - 1, 1)
    return across, along


def _transform(points_px: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    points = np.asarray(points_px, float).reshape(-1, 2)
    if not len(points):
        return points
    return cv2.perspectiveTransform(points[:, None], matrix)[:, 0]


def _interpolation(image: np.ndarray) -> int:
    return cv2.INTER_NEAREST if image.ndim == 2 else cv2.INTER_LINEAR


def _require_quadrangle(points: np.ndarray, name: str) -> None:
    """Three points in a line, or a bow tie, have no usable homography; OpenCV would answer with a singular matrix."""
    sentence = f"{name}: expected four points (u, v) in order around a convex quadrangle, got {points.tolist()}."
    if points.shape != (4, 2) or not np.isfinite(points).all():
        raise ValueError(sentence)
    edges = np.roll(points, -1, axis=0) - points
    following = np.roll(edges, -1, axis=0)
    turns = edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]
    if not (np.all(turns > 0) or np.all(turns < 0)):
        raise ValueError(sentence)
