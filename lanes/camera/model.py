"""The camera: intrinsics, pose, projection between pixels and the road, undistortion,
and camera files.

Conventions
-----------
- pixels are (column u, row v), integer coordinates at pixel centres, as in OpenCV;
- camera axes are OpenCV's: x right, y down, z forward;
- the road frame is ISO 8855: x forward, y left, z up, metres, origin on the road below
  the camera;
- pose angles: pitch > 0 looks down, yaw > 0 looks left, roll > 0 has the right side
  down.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from datetime import date
from functools import cached_property, lru_cache
from pathlib import Path

import cv2
import numpy as np
import yaml

from lanes.camera.lens import (
    LENS_MODELS,
    LensModel,
    as_ros_layout,
    describe_foreign,
    distort_angle,
    dump_yaml,
    largest_ray,
    parse_camera_yaml,
    parse_distortion,
)
from lanes.equality import ByValue
from lanes.errors import CameraError, PictureError, require_number, require_type
from lanes.files import read_text, require_file, write_atomically
from lanes.recording import MAX_PIXELS
from lanes.video.images import require_rgb, upright_axes

# Plausible horizontal fields of view of a dashcam, degrees.
HFOV_RANGE_DEG = 10, 150
# Wider views are those of a fisheye lens unless the lens is named: a pinhole camera of
# 110 degrees has twice as many pixels per degree at the border as in the middle, so
# action cameras and dashcams do not map like this.
WIDE_HFOV_DEG = 95
LENSES = ("pinhole", "equidistant")
# Largest distance of a camera from the middle of its car, metres: lorries are 2.55 m
# wide.
MAX_OFFSET_M = 2.0
# Width of a passenger car over its tyres where none is given, and that of motorcycles
# to lorries with mirrors, metres.
CAR_WIDTH_M = 1.8
CAR_WIDTH_RANGE_M = (0.5, 3.5)
# Steps of the fixed-point iteration of undistortion, and where it ends. Most pixels
# need ten steps, the corners of a 100 degree lens several hundred: there 50 steps leave
# an error of one pixel, and the default of 5 steps one of forty.
UNDISTORT_UNTIL = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 1000, 1e-12)


@dataclass(frozen=True)
class CameraPose:
    """Height of the camera above the road and its three angles (extrinsics).

    >>> lanes.CameraPose(height_m=1.3, pitch_rad=0.03).describe()
    '1.30 m high, pitch 1.72, yaw 0.00, roll 0.00 deg'

    Raises LaneError if the height is not positive, a number is not finite, or an angle
    is more than a right one.
    """

    height_m: float
    pitch_rad: float = 0.0
    yaw_rad: float = 0.0
    roll_rad: float = 0.0

    def __post_init__(self) -> None:
        for name, value in list(vars(self).items()):
            object.__setattr__(self, name, require_number(value, name))
        for name in ("pitch_rad", "yaw_rad", "roll_rad"):
            angle_rad = getattr(self, name)
            if abs(angle_rad) > np.pi / 2:
                raise CameraError(
                    f"{name} = {angle_rad:g} is more than a right angle; give radians: "
                    f"np.radians({angle_rad:g})."
                )
        if self.height_m <= 0:
            raise CameraError(
                f"height_m = {self.height_m:g}: the height must be positive."
            )

    def describe(self) -> str:
        """Text such as "1.32 m high, pitch -1.80, yaw -1.36, roll 0.40 deg"."""
        pitch_deg = np.degrees(self.pitch_rad)
        yaw_deg = np.degrees(self.yaw_rad)
        roll_deg = np.degrees(self.roll_rad)
        angles = f"pitch {pitch_deg:.2f}, yaw {yaw_deg:.2f}, roll {roll_deg:.2f} deg"
        return f"{self.height_m:.2f} m high, {angles}"

    @cached_property
    def rotation(self) -> np.ndarray:
        """Rotation matrix (3, 3) from the road frame to camera axes; read-only."""
        body = _turn_z(self.yaw_rad) @ _turn_y(self.pitch_rad) @ _turn_x(self.roll_rad)
        # from forward, left, up to right, down, forward
        body_to_camera = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
        rotation = body_to_camera @ body.T
        rotation.setflags(write=False)
        return rotation


def _turn_x(angle_rad: float) -> np.ndarray:
    """Rotation matrix (3, 3) about the x axis."""
    c = np.cos(angle_rad)
    s = np.sin(angle_rad)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def _turn_y(angle_rad: float) -> np.ndarray:
    """Rotation matrix (3, 3) about the y axis."""
    c = np.cos(angle_rad)
    s = np.sin(angle_rad)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def _turn_z(angle_rad: float) -> np.ndarray:
    """Rotation matrix (3, 3) about the z axis."""
    c = np.cos(angle_rad)
    s = np.sin(angle_rad)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


@dataclass(frozen=True)
class PoseStd:
    """Standard deviations of an estimated pose: of the height, as a share of it, and of
    the roll.

    They move lines sideways. Errors of pitch and yaw hardly do: the lane shows them.
    """

    height_share: float
    roll_rad: float

    def __post_init__(self) -> None:
        for name, value in list(vars(self).items()):
            object.__setattr__(self, name, require_number(value, name))


@dataclass(frozen=True)
class CalibrationReport:
    """Result of a calibration: root mean square reprojection errors of all corners and
    of each board used.

    `board_rms_px` has the boards by the name of their image, `rejected` the images that
    were not used, and why; `date` is ISO 8601, today by default. `focal_std_share` is
    the standard deviation of the focal length as a share of it; 0 if it is unknown.
    """

    rms_px: float
    board_rms_px: dict[str, float] = field(default_factory=dict)
    rejected: dict[str, str] = field(default_factory=dict)
    date: str = field(default_factory=lambda: date.today().isoformat())
    focal_std_share: float = 0.0


@dataclass(frozen=True, eq=False)
class Camera(ByValue):
    """Intrinsics and pose of one camera at one image size.

    >>> camera = lanes.Camera.from_fov((1280, 720), hfov_deg=60)
    >>> camera = camera.with_pose(lanes.CameraPose(height_m=1.3, pitch_rad=0.03))

    Parameters
    ----------
    width, height : int
        Image size that the intrinsics refer to.
    matrix : ndarray of shape (3, 3)
        Camera matrix (focal lengths and principal point, pixels).
    distortion : ndarray of shape (5,), (8,) or (4,), optional
        Coefficients in OpenCV's order. The number of them is the model, here with its
        name in ROS: five are Brown-Conrady's k1, k2, p1, p2, k3 (plumb_bob); eight have
        a denominator as well, k4, k5, k6 (rational_polynomial); four are those of a
        fisheye lens (equidistant, `cv2.fisheye`).
    pose : CameraPose, optional
        Extrinsics; without them projections to and from the road raise a CameraError.
    pose_std : PoseStd, optional
        Of a pose that was estimated; the stated standard deviations of lanes contain
        it.
    lens_std_m : float
        Standard deviation of the lateral positions of lines by the intrinsics, if these
        were assumed; they contain it as well.
    report : CalibrationReport, optional
        Result of the calibration.
    offset_m : float
        Position of the camera left of the middle of the car. The road frame begins
        below the camera; offset and departure of a lane are those of the car.
    car_width_m : float
        Width of the car over its tyres, for departure warnings.
    calibrated : bool
        Whether the intrinsics were measured, not derived from a field of view.

    Raises CameraError if no camera has such intrinsics.
    """

    width: int
    height: int
    matrix: np.ndarray
    distortion: np.ndarray = field(default_factory=lambda: np.zeros(5))
    pose: CameraPose | None = None
    report: CalibrationReport | None = None
    offset_m: float = 0.0
    calibrated: bool = True
    car_width_m: float = CAR_WIDTH_M
    pose_std: PoseStd | None = None
    lens_std_m: float = 0.0

    def __post_init__(self) -> None:
        try:
            matrix = np.asarray(self.matrix, float).reshape(3, 3)
            distortion = np.asarray(self.distortion, float).ravel()
        except (TypeError, ValueError) as error:
            raise CameraError(
                "invalid camera: matrix (3, 3) and distortion must be numbers "
                f"({error})."
            ) from error
        offset_m = require_number(self.offset_m, "offset_m")
        car_width_m = require_number(self.car_width_m, "car_width_m")
        object.__setattr__(self, "matrix", matrix)
        object.__setattr__(self, "distortion", distortion)
        object.__setattr__(self, "offset_m", offset_m)
        object.__setattr__(self, "car_width_m", car_width_m)
        fault = _find_fault(
            self.size,
            tuple(matrix.ravel().tolist()),
            tuple(distortion.tolist()),
            offset_m,
            car_width_m,
        )
        if fault:
            raise CameraError(f"invalid camera: {fault}.")

    @classmethod
    def from_fov(
        cls,
        size: tuple[int, int],
        hfov_deg: float,
        pose: CameraPose | None = None,
        *,
        lens: str | None = None,
    ) -> Camera:
        """An uncalibrated camera from its horizontal field of view in degrees.

        `size` is (width, height). `lens` is one of `LENSES`: straight lines stay
        straight in the image of a "pinhole" camera; in that of an "equidistant" one, a
        fisheye lens, the distance from the centre is proportional to the angle. Without
        it, views of more than `WIDE_HFOV_DEG` are equidistant. Raises CameraError if
        the field of view is not between 10 and 150 degrees, or the lens is none of
        these.
        """
        hfov_deg = require_number(hfov_deg, "hfov_deg")
        least_deg, most_deg = HFOV_RANGE_DEG
        if not least_deg <= hfov_deg <= most_deg:
            raise CameraError(
                f"a horizontal field of view of {hfov_deg:g} degrees is not plausible "
                f"for a dashcam; give {least_deg} to {most_deg}."
            )
        pinhole, equidistant = LENSES
        if lens is None:
            lens = equidistant if hfov_deg > WIDE_HFOV_DEG else pinhole
        if lens not in LENSES:
            known = ", ".join(LENSES)
            raise CameraError(f"lens {lens!r} is not known; give one of {known}.")

        width, height = size
        half_rad = np.radians(hfov_deg) / 2
        half_in_focal = np.tan(half_rad) if lens == pinhole else half_rad
        focal_px = width / 2 / half_in_focal
        matrix = np.eye(3)
        matrix[0, 0] = focal_px
        matrix[1, 1] = focal_px
        matrix[0, 2] = (width - 1) / 2
        matrix[1, 2] = (height - 1) / 2
        distortion = np.zeros(5 if lens == pinhole else 4)
        return cls(width, height, matrix, distortion, pose, calibrated=False)

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        return self.width, self.height

    @property
    def hfov_deg(self) -> float:
        """Angle in degrees between the left and the right border of the image, in the
        row of the principal point.
        """
        row = self.matrix[1, 2]
        borders = np.array([[-0.5, row], [self.width - 0.5, row]])
        if not self.is_fisheye:
            left_rad, right_rad = np.arctan(self.rays(borders)[:, 0])
            return float(np.degrees(right_rad - left_rad))
        # more than 90 degrees to the optical axis there is no ray with z = 1
        angles = np.linspace(0, np.pi, 10_000)
        distorted = distort_angle(angles, *self.distortion.tolist())
        end = distorted.argmax() + 1
        from_centre = np.abs(borders[:, 0] - self.matrix[0, 2]) / self.matrix[0, 0]
        both_rad = np.interp(from_centre, distorted[:end], angles[:end])
        return float(np.degrees(both_rad.sum()))

    def __repr__(self) -> str:
        size = f"{self.width}x{self.height} px"
        focal = f"focal length {self.matrix[0, 0]:.0f} px"
        field_of_view = f"field of view {self.hfov_deg:.1f} deg"
        bent = "" if np.any(self.distortion) else ", no distortion"
        pose = self.pose.describe() if self.pose else "unknown"
        return f"Camera({size}, {focal}, {field_of_view}{bent}, pose {pose})"

    def with_pose(self, pose: CameraPose) -> Camera:
        """The same camera with another pose, as certain as the one before."""
        return replace(self, pose=pose)

    def has_aspect_of(self, size: tuple[int, int]) -> bool:
        """Whether images of `size` (width, height) show the same area as those of this
        camera, resized.
        """
        # the ratios of 1281x721 and 1280x720 differ by 0.0006, those of common formats
        # (16:10 and 16:9) by 0.18
        width, height = size
        return abs(width / height - self.width / self.height) <= 0.005

    def scaled(self, size: tuple[int, int]) -> Camera:
        """The same camera for images resized to `size` (width, height).

        Raises CameraError if the aspect ratio differs: the image was cropped, so the
        principal point is unknown.
        """
        width, height = size
        if not self.has_aspect_of(size):
            raise CameraError(
                f"a {width}x{height} image has another aspect ratio than the "
                f"calibrated {self.width}x{self.height}: it was cropped or turned, so "
                "the calibration cannot be rescaled; calibrate at that size."
            )
        # as in `resize_points`: shift by half a pixel, scale, shift back
        scale = np.diag([width / self.width, height / self.height, 1.0])
        shift = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
        matrix = np.linalg.inv(shift) @ scale @ shift @ self.matrix
        return replace(self, width=width, height=height, matrix=matrix)

    def turned(self, orientation: int) -> Camera:
        """The camera of the upright images, if this one is that of the images as stored
        with an EXIF orientation.

        Raises CameraError if the camera has a pose, which is one for upright images
        already.
        """
        if self.pose is not None:
            raise CameraError(
                "a camera with a pose cannot be turned: its pose is that of upright "
                "images."
            )
        if orientation == 1:
            return self
        if self.matrix[0, 1]:
            raise CameraError(
                "a camera with a skew in its matrix is not turned; calibrate with "
                "upright images."
            )
        axes = upright_axes(orientation)
        exchanged = np.abs(axes)
        old_middle = (np.array(self.size) - 1) / 2
        size = exchanged @ self.size
        middle = (size - 1) / 2

        # focal lengths change places, the principal point turns about the middle
        matrix = np.eye(3)
        matrix[[0, 1], [0, 1]] = exchanged @ self.matrix[[0, 1], [0, 1]]
        matrix[:2, 2] = axes @ (self.matrix[:2, 2] - old_middle) + middle
        distortion = np.array(self.distortion, float)
        if not self.is_fisheye:
            # (p2, p1) is a vector in the image
            distortion[[3, 2]] = axes @ distortion[[3, 2]]
        width, height = size.tolist()
        return replace(
            self,
            width=int(width),
            height=int(height),
            matrix=matrix,
            distortion=distortion,
        )

    def require_size(
        self, image: np.ndarray | str | Path, name: object = "image"
    ) -> np.ndarray:
        """As `lanes.video.images.require_rgb`; also raises PictureError if the image
        has another size than the camera's.
        """
        if isinstance(image, str | Path):
            name = image
        image = require_rgb(image, name)
        height, width = image.shape[:2]
        if (width, height) == self.size:
            return image
        if self.calibrated:
            origin = "was calibrated for"
            remedy = (
                "use an image of that size, or camera.scaled(size) for a resized one."
            )
        else:
            origin = "is that of images of"
            remedy = (
                "use images of one size, or annotate the stills of several cameras "
                "with --each."
            )
        size = f"{self.width}x{self.height}"
        raise PictureError(
            f"{name}: is {width}x{height} pixels, but the camera {origin} {size}; "
            f"{remedy}"
        )

    def undistort_points(self, pixels: np.ndarray) -> np.ndarray:
        """Pixels (N, 2) of the undistorted image for raw pixels (N, 2)."""
        rays = self.rays(pixels)
        return rays[:, :2] @ self.matrix[:2, :2].T + self.matrix[:2, 2]

    def distort_points(self, pixels: np.ndarray) -> np.ndarray:
        """Raw pixels (N, 2) for pixels (N, 2) of the undistorted image."""
        pixels = np.asarray(pixels, float).reshape(-1, 2)
        from_centre = pixels - self.matrix[:2, 2]
        xy = from_centre @ np.linalg.inv(self.matrix[:2, :2]).T
        return self._project(np.column_stack([xy, np.ones(len(pixels))]))

    def rays(self, pixels: np.ndarray) -> np.ndarray:
        """Viewing rays (N, 3) of raw pixels (N, 2), in camera axes, z = 1."""
        pixels = np.asarray(pixels, float).reshape(-1, 1, 2)
        if not len(pixels):
            return np.empty((0, 3))
        skew = self.matrix[0, 1]
        if skew:  # OpenCV ignores it
            below_centre = pixels[..., 1:] - self.matrix[1, 2]
            pixels = pixels - below_centre * [skew / self.matrix[1, 1], 0]
        xy = self.model.opencv.undistortPoints(
            pixels, self.matrix, self.distortion, criteria=UNDISTORT_UNTIL
        )
        return np.column_stack([xy.reshape(-1, 2), np.ones(len(pixels))])

    def road_to_pixels(self, points_m: np.ndarray) -> np.ndarray:
        """Raw pixels (N, 2) of points (N, 2) on the road or (N, 3) in the road frame,
        metres.

        NaN for points behind the camera or outside the range of the lens model
        (`largest_ray`).
        """
        pose = self.require_pose()
        points = np.asarray(points_m, float)
        if points.shape[-1] == 2:
            points = np.column_stack([points, np.zeros(len(points))])
        from_camera = points - [0, 0, pose.height_m]
        return self._project(from_camera @ pose.rotation.T)

    def pixels_to_road(self, pixels: np.ndarray) -> np.ndarray:
        """Points (N, 2) on the flat road, metres, of raw pixels (N, 2).

        NaN at and above the horizon.
        """
        pose = self.require_pose()
        directions = self.rays(pixels) @ pose.rotation
        down = directions[:, 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = np.where(down < -1e-9, -pose.height_m / down, np.nan)
        return directions[:, :2] * distance[:, None]

    @property
    def model(self) -> LensModel:
        """The lens model, by the number of coefficients."""
        return LENS_MODELS[len(self.distortion)]

    @property
    def is_fisheye(self) -> bool:
        """Whether the distortion is that of a fisheye lens: a polynomial of the angle
        to the optical axis.
        """
        return self.model.is_fisheye

    @property
    def largest_ray(self) -> float:
        """Tangent of the largest angle to the optical axis up to which the distortion
        is monotonic.

        Beyond it the model would map points far outside the field of view into the
        image.
        """
        return largest_ray(*self.distortion.tolist())

    def _project(self, points: np.ndarray) -> np.ndarray:
        """Raw pixels (N, 2) of points (N, 3) in camera axes by the lens model; NaN
        where it does not hold.

        They are those of cv2.projectPoints, which also computes derivatives and takes
        ten times as long.
        """
        x, y, z = points.T
        visible = (z > 1e-6) & (np.hypot(x, y) < self.largest_ray * z)
        inverse = 1 / np.where(visible, z, np.nan)
        x, y = self.model.distort(x * inverse, y * inverse, *self.distortion.tolist())

        (fx, skew, cx), (_, fy, cy) = self.matrix[:2]
        v = y * fy + cy
        if skew:
            return np.column_stack([x * fx + y * skew + cx, v])
        return np.column_stack([x * fx + cx, v])

    def require_pose(self) -> CameraPose:
        """The camera pose; raises CameraError if the camera has none."""
        if self.pose is None:
            raise CameraError(
                "this camera has no pose (height and angles), so pixels cannot be "
                "placed on the road; give one or estimate it."
            )
        return self.pose


def resize_points(
    pixels: np.ndarray, scale: float | tuple[float, float] | np.ndarray
) -> np.ndarray:
    """Pixels (..., 2) of an image after it is resized by a factor, or by a factor
    (columns, rows).

    Pixel centres are at integers, so the image begins at -0.5: shift by half a pixel,
    scale, shift back.
    """
    return (pixels + 0.5) * scale - 0.5


def undistort(image: np.ndarray, camera: Camera) -> np.ndarray:
    """The RGB image (height, width, 3), uint8, without lens distortion, with the same
    camera matrix.

    Raises PictureError if the image is not RGB, or has another size than the camera;
    see `Camera.scaled`.
    """
    image = camera.require_size(image)
    matrix = tuple(camera.matrix.ravel())
    maps = _undistortion_maps(camera.size, matrix, tuple(camera.distortion))
    return cv2.remap(image, maps[0], maps[1], cv2.INTER_LINEAR)


@lru_cache(maxsize=8)
def _undistortion_maps(
    size: tuple[int, int], matrix: tuple[float, ...], distortion: tuple[float, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Maps for cv2.remap, cached for each lens: they take as long as ten remaps."""
    K = np.reshape(matrix, (3, 3))
    skew = K[0, 1]
    opencv = LENS_MODELS[len(distortion)].opencv
    kind = cv2.CV_32FC1 if skew else cv2.CV_16SC2
    map_u, map_v = opencv.initUndistortRectifyMap(
        K, np.array(distortion), np.eye(3), K, size, kind
    )
    if not skew:
        return map_u, map_v
    # OpenCV's maps are those without the skew
    map_u += (map_v - K[1, 2]) * np.float32(skew / K[1, 1])
    return cv2.convertMaps(map_u, map_v, cv2.CV_16SC2)


# Camera files: YAML in the layout of ROS camera_info plus `pose:` and `calibration:`
# blocks; others are read as well (lanes/camera/lens.py).


def save_camera(camera: Camera, path: str | Path) -> Path:
    """Write a camera file, which `load_camera`, ROS and cv2.FileStorage read; returns
    its path.

    >>> lanes.save_camera(camera, "camera.yaml")  # doctest: +SKIP

    Raises OSError if the file cannot be written.
    """
    path = Path(path)
    write_atomically(path, dump_yaml(camera_to_dict(camera)).encode())
    return path


def camera_to_dict(camera: Camera) -> dict:
    """The content of a camera file, and of the `camera` part of a truth file;
    `camera_from_dict` reads it back.
    """
    content: dict = {
        "image_width": int(camera.width),
        "image_height": int(camera.height),
        "camera_name": "dashcam",
        "camera_matrix": _matrix_entry(camera.matrix),
        "distortion_model": camera.model.name,
        "distortion_coefficients": _matrix_entry(
            np.reshape(camera.distortion, (1, -1))
        ),
        # ROS's parser requires these two: an undistorted image has the same camera
        # matrix
        "rectification_matrix": _matrix_entry(np.eye(3)),
        "projection_matrix": _matrix_entry(
            np.column_stack([camera.matrix, np.zeros(3)])
        ),
    }
    if not camera.calibrated:
        content["calibrated"] = False
    if camera.offset_m:
        content["camera_offset_m"] = camera.offset_m
    if camera.car_width_m != CAR_WIDTH_M:
        content["car_width_m"] = camera.car_width_m
    if camera.pose:
        content["pose"] = asdict(camera.pose)
    if camera.lens_std_m:
        content["lens_std_m"] = camera.lens_std_m
    if camera.pose_std:
        content["pose_std"] = asdict(camera.pose_std)
    if camera.report:
        content["calibration"] = _report_entry(camera.report)
    return content


def _report_entry(report: CalibrationReport) -> dict:
    board_rms_px = {}
    for name, error_px in report.board_rms_px.items():
        board_rms_px[name] = round(float(error_px), 4)
    return {
        "rms_px": round(float(report.rms_px), 4),
        "boards_used": len(report.board_rms_px),
        "board_rms_px": board_rms_px,
        "rejected": dict(report.rejected),
        "date": report.date,
        "focal_std_share": round(float(report.focal_std_share), 4),
    }


def _matrix_entry(matrix: np.ndarray) -> dict:
    rows, columns = matrix.shape
    return {
        "rows": rows,
        "cols": columns,
        "dt": "d",  # with the type, cv2.FileStorage reads it as a matrix
        "data": np.ravel(matrix).astype(float).tolist(),
    }


def load_camera(path: str | Path) -> Camera:
    """Read a camera file: ours, or one of ROS (also a `CameraInfo` that was printed),
    of OpenCV's FileStorage (YAML) or of Kalibr.

    >>> camera = lanes.load_camera("camera.yaml")  # doctest: +SKIP

    Raises FileNotFoundError if the file does not exist, or CameraError if it is not a
    camera file, lacks an entry, or has values that no camera can have.
    """
    with require_file(path, "camera", error=CameraError).open("rb") as file:
        head = file.read(_HEAD_BYTES)
    foreign = describe_foreign(head)
    is_binary = b"\0" in head or not head.isascii()
    if foreign and is_binary:
        raise CameraError(f"{path}: {foreign}")
    # a file with a thousand boards has 50 kB
    text = read_text(path, "camera", error=CameraError, max_bytes=1_000_000)
    try:
        return camera_from_dict(as_ros_layout(parse_camera_yaml(text)))
    except (KeyError, *_UNUSABLE_ERRORS) as error:
        if foreign:
            raise CameraError(f"{path}: {foreign}") from error
        reason = " ".join(str(error).split())
        if isinstance(error, KeyError):
            reason = f"entry {error} is missing"
        raise CameraError(_UNUSABLE.format(path, reason)) from error


# Part of a file that shows which program has written it.
_HEAD_BYTES = 100_000
# What reading the entries of a camera file may raise.
_UNUSABLE_ERRORS = (
    yaml.YAMLError,
    AttributeError,
    OverflowError,
    RecursionError,
    TypeError,
    ValueError,
)
_UNUSABLE = "{}: is not a usable camera file ({}); make it again by calibrating."


def camera_from_dict(content: dict) -> Camera:
    """The camera of a parsed camera file or of the `camera` part of a truth file.

    Raises KeyError if an entry is missing, and ValueError, TypeError, AttributeError or
    OverflowError if one is not valid.
    """
    if not isinstance(content, dict):
        raise ValueError("it has no entries")
    matrix = np.array(content["camera_matrix"]["data"], float).reshape(3, 3)
    distortion = parse_distortion(
        content.get("distortion_model"), content["distortion_coefficients"]["data"]
    )
    width = int(content["image_width"])
    height = int(content["image_height"])
    if not (0 < matrix[0, 2] < width and 0 < matrix[1, 2] < height):
        raise ValueError("its principal point is not in the image")
    pose = _parse_pose(content["pose"]) if "pose" in content else None
    pose_std = None
    if "pose_std" in content:
        stds = content["pose_std"].items()
        pose_std = PoseStd(**{name: float(value) for name, value in stds})
    report = None
    if "calibration" in content:
        report = _parse_report(content["calibration"])
    return Camera(
        width,
        height,
        matrix,
        distortion,
        pose=pose,
        report=report,
        offset_m=content.get("camera_offset_m", 0.0),
        calibrated=content.get("calibrated", True) is not False,
        car_width_m=content.get("car_width_m", CAR_WIDTH_M),
        pose_std=pose_std,
        lens_std_m=float(content.get("lens_std_m", 0.0)),
    )


def require_camera(camera: object) -> Camera:
    """The camera; raises LaneError if it is none."""
    remedy = "make one with Camera.from_fov, or read one with load_camera"
    return require_type(camera, Camera, "camera", remedy)


@lru_cache(maxsize=32)
def _find_fault(
    size: tuple[int, int],
    matrix: tuple[float, ...],
    distortion: tuple[float, ...],
    offset_m: float,
    car_width_m: float,
) -> str:
    """Why a camera is not plausible; empty if it is.

    Cached, because pitch motion makes a camera in every frame.
    """
    low_m, high_m = CAR_WIDTH_RANGE_M
    if abs(offset_m) > MAX_OFFSET_M:
        return (
            f"a camera {offset_m:g} m beside the middle of the car is not plausible; "
            f"give {-MAX_OFFSET_M:g} to {MAX_OFFSET_M:g} metres"
        )
    if not low_m <= car_width_m <= high_m:
        return (
            f"a car {car_width_m:g} m wide is not plausible; give {low_m:g} to "
            f"{high_m:g} metres"
        )
    if not np.isfinite([*matrix, *distortion]).all():
        return "its intrinsics are not finite"
    if len(distortion) not in LENS_MODELS:
        *counts, last_count = map(str, LENS_MODELS)
        known = f"{', '.join(counts)} or {last_count}"
        return f"it has {len(distortion)} distortion coefficients, not {known}"
    # those of long focal lengths are several hundred; larger ones overflow the
    # polynomial
    if max(map(abs, distortion), default=0) > 1e6:
        return "a distortion coefficient is not between -1e+06 and 1e+06"
    return _find_fault_of_matrix(size, matrix)


def _find_fault_of_matrix(size: tuple[int, int], matrix: tuple[float, ...]) -> str:
    """Why an image size and a camera matrix are not plausible; empty if they are."""
    width, height = size
    fx, skew, _, zero, fy, _, *last = matrix
    if min(size) <= 0 or width * height > MAX_PIXELS:
        return f"{width} x {height} is not a valid image size"
    # fields of view from 157 degrees to 1 degree
    least_px = 0.1 * width
    most_px = 60 * width
    if not (least_px <= min(fx, fy) and max(fx, fy) <= most_px):
        return f"a focal length is not between {least_px:g} and {most_px:g} pixels"
    # a sensor has square corners, real lenses have some 0.001: more is another lens
    # model's shift
    if abs(skew) > 0.01 * fx:
        return f"a skew of {skew:g} is more than 0.01 of the focal length"
    if zero or last != [0, 0, 1]:
        return "its camera matrix is not valid"
    return ""


def _parse_pose(content: dict) -> CameraPose:
    pose = CameraPose(**{name: float(value) for name, value in content.items()})
    # lorries carry their cameras at 2.5 m
    if pose.height_m > 20:
        raise ValueError(f"a camera {pose.describe()} does not see the road")
    return pose


def _parse_report(content: dict) -> CalibrationReport:
    board_rms_px = {}
    for name, error_px in content["board_rms_px"].items():
        board_rms_px[str(name)] = float(error_px)
    rejected = {}
    for name, reason in content.get("rejected", {}).items():
        rejected[str(name)] = str(reason)
    return CalibrationReport(
        rms_px=float(content["rms_px"]),
        board_rms_px=board_rms_px,
        rejected=rejected,
        date=str(content["date"]),
        focal_std_share=float(content.get("focal_std_share", 0.0)),
    )
