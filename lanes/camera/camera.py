"""The camera: lens, pose, and the way between pixels and the road.

Conventions
-----------
- pixels are (column u, row v), integer coordinates at pixel centres, as in OpenCV;
- camera axes are OpenCV's: x right, y down, z forward;
- the road frame is ISO 8855: x forward, y left, z up, metres, origin on the road below the camera;
- pose angles: pitch > 0 looks down, yaw > 0 looks left, roll > 0 has the right side down.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from datetime import date
from functools import lru_cache

import cv2
import numpy as np

from lanes.camera.camera_pose import CameraError, CameraPose
from lanes.io.describe import html_table
from lanes.io.frames import Frame, require_rgb, require_size

# Pictures whose aspect ratios differ by less than this come from the same sensor area: 1281x721 beside 1280x720
# differs by 0.0006, the next common format (16:10 beside 16:9) by 0.18.
SAME_ASPECT = 0.005


@dataclass(frozen=True)
class CalibrationReport:
    """How a calibration went: root mean square error in pixels over all corners, and each board's own."""

    rms_px: float
    board_rms_px: dict[str, float] = field(default_factory=dict)
    rejected: dict[str, str] = field(default_factory=dict)
    date: str = field(default_factory=lambda: date.today().isoformat())


@dataclass(frozen=True, eq=False)
class Camera:
    """Lens and pose of one camera at one picture size.

    Parameters
    ----------
    width, height : int
        Frame size in pixels that the numbers below belong to.
    matrix : ndarray of shape (3, 3)
        Camera matrix (focal lengths and principal point, pixels).
    distortion : ndarray of shape (5,)
        Brown-Conrady coefficients k1, k2, p1, p2, k3 in OpenCV's order ("plumb_bob" in ROS).
    pose : CameraPose, optional
        Needed by everything that speaks of the road.
    report : CalibrationReport, optional
        How the numbers were found.
    """

    width: int
    height: int
    matrix: np.ndarray
    distortion: np.ndarray
    pose: CameraPose | None = None
    report: CalibrationReport | None = None

    @classmethod
    def from_fov(cls, size: tuple[int, int], hfov_deg: float, pose: CameraPose | None = None) -> Camera:
        """A camera without distortion from its horizontal field of view in degrees; `size` is (width, height)."""
        if not 10 <= hfov_deg <= 150:
            raise CameraError(
                f"a horizontal field of view of {hfov_deg} degrees is not that of a dashcam; give 10 to 150."
            )
        width, height = size
        focal_px = width / 2 / np.tan(np.radians(hfov_deg) / 2)
        matrix = np.array([[focal_px, 0, (width - 1) / 2], [0, focal_px, (height - 1) / 2], [0, 0, 1]])
        return cls(width, height, matrix, np.zeros(5), pose)

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        return self.width, self.height

    @property
    def hfov_deg(self) -> float:
        """Horizontal field of view, degrees, leaving the distortion aside."""
        return float(np.degrees(2 * np.arctan(self.width / 2 / self.matrix[0, 0])))

    def summary(self) -> dict[str, str]:
        """Frame size, lens, pose and calibration, by name."""
        words = {
            "picture": f"{self.width}x{self.height} px",
            "lens": f"focal length {self.matrix[0, 0]:.0f} px, field of view {self.hfov_deg:.1f} deg"
            + ("" if np.any(self.distortion) else ", no distortion"),
            "pose": self.pose.describe() if self.pose else "unknown",
        }
        if self.report:
            words["calibration"] = f"{len(self.report.board_rms_px)} boards, error {self.report.rms_px:.2f} px"
        return words

    def __repr__(self) -> str:
        words = self.summary()
        return f"Camera({words['picture']}, {words['lens']}, pose {words['pose']})"

    def _repr_html_(self) -> str:
        return html_table("Camera", self.summary())

    def with_pose(self, pose: CameraPose) -> Camera:
        """The same lens on another pose."""
        return replace(self, pose=pose)

    def with_report(self, report: CalibrationReport) -> Camera:
        """The same camera with another account of its calibration."""
        return replace(self, report=report)

    def scaled(self, size: tuple[int, int]) -> Camera:
        """The same camera for pictures resized to `size` (width, height).

        Raises
        ------
        CameraError
            If the aspect ratio differs, because then the picture was cropped and the principal point is unknown.
        """
        width, height = size
        if abs(width / height - self.width / self.height) > SAME_ASPECT:
            raise CameraError(
                f"a {width}x{height} picture has another shape than the calibrated {self.width}x{self.height}: "
                "it was cropped, so the calibration cannot be rescaled; calibrate at that size."
            )
        # Pixel centres lie at integers, so the picture's edge is at -0.5: shift by half a pixel, scale, shift back.
        scale = np.diag([width / self.width, height / self.height, 1.0])
        shift = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
        return replace(self, width=width, height=height, matrix=np.linalg.inv(shift) @ scale @ shift @ self.matrix)

    def require_size(self, image: Frame, name: object = "picture") -> None:
        """Raise PictureError unless the picture has the size of the calibration; the message starts with `name`."""
        require_size(image, self.size, name)

    def undistort_points(self, pixels: np.ndarray) -> np.ndarray:
        """Raw pixels (N, 2) to the pixels (N, 2) of the undistorted picture."""
        rays = self.rays(pixels)
        return rays[:, :2] @ self.matrix[:2, :2].T + self.matrix[:2, 2]

    def distort_points(self, pixels: np.ndarray) -> np.ndarray:
        """Pixels (N, 2) of the undistorted picture to raw pixels (N, 2)."""
        pixels = np.asarray(pixels, float).reshape(-1, 2)
        rays = np.column_stack(
            [(pixels - self.matrix[:2, 2]) @ np.linalg.inv(self.matrix[:2, :2]).T, np.ones(len(pixels))]
        )
        return self._project_camera_points(rays)

    def rays(self, pixels: np.ndarray) -> np.ndarray:
        """Directions (N, 3) in camera axes, z = 1, that raw pixels (N, 2) look along."""
        pixels = np.asarray(pixels, float).reshape(-1, 1, 2)
        if not len(pixels):
            return np.empty((0, 3))
        # As many steps of the fixed-point iteration as it takes: most pixels need ten, the corners of a lens of 100
        # degrees some hundreds (there 50 leave a pixel and 5, the default, forty).
        stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 1000, 1e-12)
        xy = cv2.undistortPoints(pixels, self.matrix, self.distortion, criteria=stop)
        return np.column_stack([xy.reshape(-1, 2), np.ones(len(pixels))])

    def road_to_pixels(self, points_m: np.ndarray) -> np.ndarray:
        """Points (N, 2) on the road or (N, 3) above it, metres, to raw pixels (N, 2); NaN where the lens is blind."""
        pose = self.require_pose()
        points = np.asarray(points_m, float)
        if points.shape[-1] == 2:
            points = np.column_stack([points, np.zeros(len(points))])
        return self._project_camera_points((points - [0, 0, pose.height_m]) @ pose.rotation().T)

    def pixels_to_road(self, pixels: np.ndarray) -> np.ndarray:
        """Raw pixels (N, 2) to points (N, 2) on the flat road, metres; NaN at and above the horizon."""
        pose = self.require_pose()
        directions = self.rays(pixels) @ pose.rotation()
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = np.where(directions[:, 2] < -1e-9, -pose.height_m / directions[:, 2], np.nan)
        return directions[:, :2] * distance[:, None]

    @property
    def largest_ray(self) -> float:
        """Tangent of the widest angle from the axis at which the distortion polynomial still grows with the angle.

        Beyond it the polynomial folds back and would put points far outside the view into the picture.
        """
        k1, k2, _, _, k3 = self.distortion
        return _largest_ray(float(k1), float(k2), float(k3))

    def _project_camera_points(self, points: np.ndarray) -> np.ndarray:
        z = points[:, 2]
        visible = (z > 1e-6) & (np.hypot(points[:, 0], points[:, 1]) < self.largest_ray * z)
        if visible.all():
            return self._through_lens(*points.T)  # the usual case: picking and placing takes half as long as the lens
        pixels = np.full((len(points), 2), np.nan)
        pixels[visible] = self._through_lens(*points[visible].T)
        return pixels

    def _through_lens(self, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Pixels (N, 2) of points before the camera: Brown and Conrady's model in the order of cv2.projectPoints.

        Bit for bit what that returns, without its derivatives, which cost ten times as much as the points.
        """
        k1, k2, p1, p2, k3 = (float(k) for k in np.ravel(self.distortion))
        inverse = 1 / z
        x, y = x * inverse, y * inverse
        r2 = x * x + y * y
        r4 = r2 * r2
        radial = 1 + k1 * r2 + k2 * r4 + k3 * (r4 * r2)
        twice = 2 * x * y
        u = x * radial + p1 * twice + p2 * (r2 + 2 * x * x)
        v = y * radial + p1 * (r2 + 2 * y * y) + p2 * twice
        return np.column_stack([u * self.matrix[0, 0] + self.matrix[0, 2], v * self.matrix[1, 1] + self.matrix[1, 2]])

    def require_pose(self) -> CameraPose:
        """The camera pose; CameraError where there is none."""
        if self.pose is None:
            raise CameraError(
                "this camera has no pose (height and angles), so pixels cannot be placed on the road; "
                "give one or estimate it."
            )
        return self.pose


@lru_cache(maxsize=32)
def _largest_ray(k1: float, k2: float, k3: float) -> float:
    """Found once for each lens: a camera that nods is a new one in every frame, with the same lens."""
    # derivative of r (1 + k1 r^2 + k2 r^4 + k3 r^6), as a polynomial in 1 / r^2, whose first coefficient is never 0
    roots = np.roots([1.0, 3 * k1, 5 * k2, 7 * k3])
    inverse_square = max(roots[np.isreal(roots)].real, default=0.0)
    return float(inverse_square**-0.5) if inverse_square > 0 else np.inf


def undistort(image: np.ndarray, camera: Camera, *, rescale: bool = False) -> np.ndarray:
    """Take the lens distortion out of a picture.

    Parameters
    ----------
    image : ndarray of shape (height, width, 3), uint8
        RGB, as taken.
    camera : Camera
        The undistorted picture keeps its camera matrix, so straight lines are straight and the centre stays put.
    rescale : bool
        Accept a picture that was resized (same aspect ratio) and rescale the calibration to it.

    Returns
    -------
    ndarray of the same shape, uint8

    Raises
    ------
    PictureError
        If the size is not the calibration's and `rescale` was not asked for.
    CameraError
        If `rescale` was asked for and the aspect ratio differs.
    """
    require_rgb(image)
    size = (image.shape[1], image.shape[0])
    if rescale and size != camera.size:
        camera = camera.scaled(size)
    camera.require_size(image)
    map_u, map_v = _undistortion_maps(size, tuple(camera.matrix.ravel()), tuple(np.ravel(camera.distortion)))
    return cv2.remap(image, map_u, map_v, cv2.INTER_LINEAR)


@lru_cache(maxsize=8)
def _undistortion_maps(size: tuple[int, int], matrix: tuple, distortion: tuple) -> tuple[np.ndarray, np.ndarray]:
    """Lookup maps, built once for each lens: building them costs as much as using them ten times."""
    matrix = np.reshape(matrix, (3, 3))
    return cv2.initUndistortRectifyMap(matrix, np.array(distortion), None, matrix, size, cv2.CV_16SC2)
