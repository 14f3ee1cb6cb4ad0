"""Bird's-eye view of the classic recipes: a homography from four points, and its scale in metres.

The image is the undistorted one, and the bird's-eye view the warped one, both in pixels (u, v). Road points are
(x forward, y left) in metres, as in lanes.camera.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from lanes.camera import Camera
from lanes.errors import CameraError, PictureError
from lanes.images import require_rgb


@dataclass(frozen=True, eq=False)
class FourPointWarp:
    """Homography that maps four points of the image to four points of the bird's-eye view.

    If the four points form a rectangle on a flat road, the bird's-eye view is a map of the road with two constant
    scales. The trapezia of the classic recipes were chosen by eye and fulfil this only approximately.

    Parameters
    ----------
    source_px : array_like of shape (4, 2)
        Points (u, v) in the undistorted image, in order around the quadrangle.
    destination_px : array_like of shape (4, 2)
        Corresponding points in the bird's-eye view, in the same order.
    size : tuple of int
        (width, height) in pixels, of the image and of the bird's-eye view.

    Raises
    ------
    ValueError
        If there are not four points, or they do not go around a convex quadrangle.
    """

    source_px: np.ndarray
    destination_px: np.ndarray
    size: tuple[int, int]
    matrix: np.ndarray = field(init=False, repr=False)
    inverse: np.ndarray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        for name in ("source_px", "destination_px"):
            points = np.array(getattr(self, name), np.float32)
            # OpenCV silently returns a singular homography for collinear points and self-intersecting quadrangles.
            if points.shape != (4, 2) or not np.isfinite(points).all() or not cv2.isContourConvex(points):
                raise ValueError(
                    f"{name}: expected four points (u, v) in order around a convex quadrangle, got {points.tolist()}."
                )
            object.__setattr__(self, name, points)
        object.__setattr__(self, "matrix", cv2.getPerspectiveTransform(self.source_px, self.destination_px))
        object.__setattr__(self, "inverse", np.linalg.inv(self.matrix))

    def image_to_birdseye(self, image: np.ndarray) -> np.ndarray:
        """Bird's-eye view of an undistorted image, both of `size`; binaries (2-D) keep their two values.

        Raises PictureError if `image` is not an RGB image or a binary of that size.
        """
        if not (isinstance(image, np.ndarray) and image.ndim == 2 and image.dtype == np.uint8):
            image = require_rgb(image)
        (width, height), got = self.size, image.shape[1::-1]
        if got != (width, height):
            raise PictureError(
                f"picture: is {got[0]}x{got[1]} pixels, but this warp is for {width}x{height}; "
                "use a picture of that size, or a warp made for this one."
            )
        interpolation = cv2.INTER_NEAREST if image.ndim == 2 else cv2.INTER_LINEAR
        return cv2.warpPerspective(image, self.matrix, self.size, flags=interpolation)

    def points_to_birdseye(self, points_px: np.ndarray) -> np.ndarray:
        """Points (N, 2) of the bird's-eye view for points (N, 2) of the undistorted image."""
        return _transform(points_px, self.matrix)

    def points_to_image(self, points_px: np.ndarray) -> np.ndarray:
        """Points (N, 2) of the undistorted image for points (N, 2) of the bird's-eye view."""
        return _transform(points_px, self.inverse)


def birdseye_to_road(points_px: np.ndarray, warp: FourPointWarp, camera: Camera) -> np.ndarray:
    """Points (N, 2) on the flat road of points (N, 2) in the bird's-eye view; exact for every quadrangle.

    Road points are (x forward, y left) in metres, NaN at and above the horizon. The distortion of the camera is not
    applied, because `warp` starts from the undistorted image. Raises CameraError if the camera has no pose.
    """
    pinhole = replace(camera, distortion=np.zeros(5))
    return pinhole.pixels_to_road(warp.points_to_image(points_px))


@dataclass(frozen=True, eq=False)
class RoadAxes:
    """Distance ahead (height,) of each row and lateral position (width,) of each column of a view, metres."""

    x_m: np.ndarray
    y_m: np.ndarray


def road_axes(warp: FourPointWarp, camera: Camera) -> RoadAxes:
    """Axes in metres of a bird's-eye view, for `lanes.figures.show_birdseye`.

    They are exact if the four points are a rectangle on the road, parallel to the car's axis. Otherwise they hold for
    the centre column and the bottom row. Raises CameraError if the camera has no pose.
    """
    width, height = warp.size
    rows, columns = np.arange(height), np.arange(width)
    centre_column = np.column_stack([np.full(height, (width - 1) / 2), rows])
    bottom_row = np.column_stack([columns, np.full(width, height - 1)])
    x_m, y_m = (birdseye_to_road(points, warp, camera) for points in (centre_column, bottom_row))
    return RoadAxes(x_m[:, 0], y_m[:, 1])


def scale_to_road(
    points_px: np.ndarray, metres_per_px: tuple[float, float], birdseye_size: tuple[int, int]
) -> np.ndarray:
    """Points (N, 2) on the road of points (N, 2) in the bird's-eye view by constant scales, as in the original recipes.

    `metres_per_px` is (metres per column, metres per row), for example (3.7 / 700, 30 / 720), and `birdseye_size` is
    (width, height) in pixels. Road points are (x forward, y left) in metres from the centre of the bottom row. This
    assumes that the car is there and that the columns are parallel to its axis.
    """
    points = np.asarray(points_px, float)
    width, height = birdseye_size
    return np.column_stack(
        [(height - 1 - points[:, 1]) * metres_per_px[1], ((width - 1) / 2 - points[:, 0]) * metres_per_px[0]]
    )


def metres_per_pixel(warp: FourPointWarp, camera: Camera) -> tuple[float, float]:
    """(metres per column, metres per row) of a four-point warp, from the camera pose.

    Constant scales are exact only if the quadrangle is a rectangle on the road. The lateral scale is the local Jacobian
    at the centre of the bottom row, where the offset is measured. The longitudinal scale is the distance on the road
    between the bottom and top row along the centre column, divided by the number of rows. Raises CameraError if the
    camera has no pose, or the bird's-eye view reaches the horizon.
    """
    width, height = warp.size
    centre, bottom = (width - 1) / 2, height - 1
    points = np.array([[centre - 0.5, bottom], [centre + 0.5, bottom], [centre, bottom], [centre, 0]])
    road = birdseye_to_road(points, warp, camera)
    if not np.isfinite(road).all():
        raise CameraError(
            "the quadrangle of the warp reaches the horizon of this camera pose, so its rows have no length on the "
            "road; choose lower points or correct the pitch of the camera pose."
        )
    lateral = float(np.linalg.norm(road[0] - road[1]))
    longitudinal = float(np.linalg.norm(road[3] - road[2])) / max(height - 1, 1)
    return lateral, longitudinal


def _transform(points_px: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    points = np.asarray(points_px, float).reshape(-1, 2)
    if not len(points):
        return points
    return cv2.perspectiveTransform(points[:, None], matrix)[:, 0]
