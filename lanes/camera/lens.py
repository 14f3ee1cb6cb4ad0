"""Lens models, and the camera files that name them: YAML as written here, of ROS, also
messages that were printed, OpenCV's FileStorage and Kalibr.

A lens model maps rays to the image, up to a largest angle. A new model is one entry of
`LENS_MODELS`. Directions (x, y) are those of rays with z = 1. The files have many names
for a model; here the number of coefficients, in OpenCV's order, identifies it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import yaml
from numpy.polynomial import Polynomial

from lanes.files import parse_yaml

# Distorted directions x and y.
Directions = tuple[np.ndarray, np.ndarray]
# Coefficients of a numerator and of a denominator, in ascending powers.
Ratio = tuple[Sequence[float], Sequence[float]]


@dataclass(frozen=True)
class LensModel:
    """How a lens distorts directions, by the `name` in ROS and `other_names` (Kalibr,
    OpenCV, RealSense, drivers).

    `distort(x, y, *coefficients)` returns the distorted directions.
    `ratio(*coefficients)` are numerator and denominator of the radial part, in powers
    of the squared tangent of the angle to the optical axis; for a fisheye lens in those
    of the squared angle. `opencv` has `undistortPoints` and `initUndistortRectifyMap`.
    """

    name: str
    other_names: tuple[str, ...]
    distort: Callable[..., Directions]
    ratio: Callable[..., Ratio]
    opencv: Any = cv2

    @property
    def is_fisheye(self) -> bool:
        """Whether the distortion is a polynomial of the angle to the optical axis."""
        return self.opencv is cv2.fisheye


def _distort_brown(
    x: np.ndarray,
    y: np.ndarray,
    k1: float,
    k2: float,
    p1: float,
    p2: float,
    k3: float,
    *denominator: float,
) -> Directions:
    """The distortion of Brown and Conrady, also with a denominator k4, k5, k6."""
    if not any((k1, k2, p1, p2, k3, *denominator)):
        return x, y
    r2 = x * x + y * y
    r4 = r2 * r2
    r6 = r4 * r2
    radial = 1 + k1 * r2 + k2 * r4 + k3 * r6
    if denominator:
        k4, k5, k6 = denominator
        radial = radial / (1 + k4 * r2 + k5 * r4 + k6 * r6)
    two_xy = 2 * x * y
    tangential_x = p1 * two_xy
    tangential_y = p1 * (r2 + 2 * y * y)
    return (
        x * radial + tangential_x + p2 * (r2 + 2 * x * x),
        y * radial + tangential_y + p2 * two_xy,
    )


def _brown_ratio(
    k1: float, k2: float, p1: float, p2: float, k3: float, *denominator: float
) -> Ratio:
    return (1.0, k1, k2, k3), (1.0, *denominator)


def _distort_fisheye(x: np.ndarray, y: np.ndarray, *coefficients: float) -> Directions:
    """The distortion of Kannala and Brandt (PAMI 2006)."""
    tangent = np.hypot(x, y)
    distorted = distort_angle(np.arctan(tangent), *coefficients)
    # on the optical axis nothing is distorted
    scale = np.ones_like(tangent)
    np.divide(distorted, tangent, out=scale, where=tangent > 1e-9)
    return x * scale, y * scale


def _fisheye_ratio(*coefficients: float) -> Ratio:
    return (1.0, *coefficients), (1.0,)


def distort_angle(
    angle_rad: np.ndarray, k1: float, k2: float, k3: float, k4: float
) -> np.ndarray:
    """Distance from the principal point, in focal lengths, at which a fisheye lens
    shows an angle.
    """
    a2 = angle_rad * angle_rad
    return angle_rad * (1 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4))))


_EQUIDISTANT = LensModel(
    name="equidistant",
    other_names=("fisheye", "kannala_brandt4", "equi"),
    distort=_distort_fisheye,
    ratio=_fisheye_ratio,
    opencv=cv2.fisheye,
)
_PLUMB_BOB = LensModel(
    name="plumb_bob",
    other_names=("", "none", "radtan", "brown_conrady", "brown-conrady", "pinhole"),
    distort=_distort_brown,
    ratio=_brown_ratio,
)
_RATIONAL = LensModel(
    name="rational_polynomial",
    other_names=("rational",),
    distort=_distort_brown,
    ratio=_brown_ratio,
)
# By the number of coefficients, which are in OpenCV's order.
LENS_MODELS = {4: _EQUIDISTANT, 5: _PLUMB_BOB, 8: _RATIONAL}


@lru_cache(maxsize=32)
def largest_ray(*distortion: float) -> float:
    """Tangent of the largest angle to the optical axis up to which the distortion is
    monotonic; see `Camera`.

    Cached, because pitch motion makes a new camera with the same lens in every frame.
    """
    model = LENS_MODELS[len(distortion)]
    numerator, denominator = map(Polynomial, model.ratio(*distortion))
    # The derivative of r n(r^2) / d(r^2) by r, times d^2, as a polynomial in r^2. Where
    # d is 0, the ratio has a pole.
    r2 = Polynomial((0.0, 1.0))
    growth_above = (numerator + 2 * r2 * numerator.deriv()) * denominator
    growth_below = 2 * r2 * numerator * denominator.deriv()
    growth = growth_above - growth_below

    # Roots in 1 / r^2: then the first coefficient is 1, never 0.
    roots = np.concatenate([np.roots(growth.coef), np.roots(denominator.coef)])
    real_roots = roots[np.isreal(roots)].real
    inverse_square = max(real_roots, default=0.0)
    largest = float(inverse_square**-0.5) if inverse_square > 0 else np.inf
    if not model.is_fisheye:
        return largest
    return float(np.tan(largest)) if largest < np.pi / 2 else np.inf


# Camera files, as one layout: that of ROS `camera_info` files.

# Names of OpenCV's samples, old and new, and those of ROS for them.
_ROS_NAMES = {
    "Camera_Matrix": "camera_matrix",
    "cameraMatrix": "camera_matrix",
    "K": "camera_matrix",
    "Distortion_Coefficients": "distortion_coefficients",
    "distCoeffs": "distortion_coefficients",
    "D": "distortion_coefficients",
    "dist_coeff": "distortion_coefficients",
    "dist_coeffs": "distortion_coefficients",
    "dist": "distortion_coefficients",
    "mtx": "camera_matrix",
    # of the message, in ROS 2 in lower case
    "k": "camera_matrix",
    "d": "distortion_coefficients",
    "width": "image_width",
    "height": "image_height",
    "image_Width": "image_width",
    "image_Height": "image_height",
}
# Names of a list of width and height.
_SIZES = ("image_size", "resolution")


@dataclass(frozen=True)
class ForeignFile:
    """A file that holds a lens, but is not read: what it is, what it begins with or
    holds, and what to copy from it.
    """

    name: str
    pattern: str
    entries: str


_FOREIGN = (
    ForeignFile(
        "a cameras.txt of COLMAP",
        r"^\s*\d+ +[A-Z_]*(PINHOLE|RADIAL|OPENCV|FOV)[A-Z_]* +\d+ +\d+ ",
        "width, height, fx, fy, cx, cy, and of OPENCV k1, k2, p1, p2",
    ),
    ForeignFile(
        "a transforms.json of nerfstudio",
        r"[\"']fl_x[\"']",
        "w, h, fl_x, fl_y, cx, cy, k1, k2, p1, p2",
    ),
    ForeignFile(
        "a sensor.yaml of EuRoC",
        r"^sensor_type:",
        "resolution, intrinsics (fx, fy, cx, cy), distortion_coefficients",
    ),
    ForeignFile(
        "a camera of VINS",
        r"^projection_parameters:|^model_type:",
        "image_width, image_height, and fx, fy, cx, cy, k1, k2, p1, p2 of its blocks",
    ),
    ForeignFile(
        "a lens profile of Gyroflow",
        r"[\"']fisheye_params[\"']",
        "calib_dimension, camera_matrix, and distortion_coeffs with the entry "
        "distortion_model: equidistant",
    ),
    ForeignFile(
        "an ost.txt of ROS",
        r"^# oST version",
        "width, height, camera matrix, distortion, or use its ost.yaml",
    ),
    ForeignFile(
        "an archive of NumPy",
        r"\A(PK\x03\x04|\x93NUMPY)",
        "camera matrix and distortion, which np.load reads, and the size of the images",
    ),
    ForeignFile(
        "a pickle, which is not opened because it can run programs",
        r"\A(\x80[\x01-\x05]|\([dl]p?\d|[\]}]q\x00)",
        "camera matrix and distortion, and the size of the images",
    ),
)


def describe_foreign(data: bytes) -> str:
    """What a file is that is no camera file, and what to copy from it; empty for others
    than those of some known programs.
    """
    text = data.decode("latin-1")
    for foreign in _FOREIGN:
        if re.search(foreign.pattern, text, re.MULTILINE):
            return (
                f"is {foreign.name}, no camera file; copy into a YAML file with "
                "image_width, image_height, camera_matrix: {data: [fx, 0, cx, 0, fy, "
                "cy, 0, 0, 1]} and distortion_coefficients: {data: [k1, k2, p1, p2, "
                f"k3]}} its {foreign.entries}."
            )
    return ""


class _Dumper(yaml.SafeDumper):
    """Lists on one line: cv2.FileStorage does not read those that begin in the column
    of their key.
    """


def _represent_list(dumper: Any, values: list) -> yaml.Node:
    tag = "tag:yaml.org,2002:seq"
    return dumper.represent_sequence(tag, values, flow_style=True)


_Dumper.add_representer(list, _represent_list)


def parse_camera_yaml(text: str) -> Any:
    """The content of YAML, also of OpenCV's, with a first line and a tag of its own.

    Raises yaml.YAMLError.
    """
    if text.lstrip().startswith("<?xml"):
        raise yaml.YAMLError(
            "it is XML; write it as YAML, as cv2.FileStorage does for a name that ends "
            "in .yaml"
        )
    text = re.sub(r"\A%YAML[:\s]\s*1\.\d\s*\n", "", text)
    text = re.sub(r"!!opencv-(nd-)?matrix\b", "", text)
    # messages that were printed have a line of dashes between them
    parts = re.split(r"^---\s*$", text, flags=re.MULTILINE)
    documents = [parse_yaml(part) for part in parts if part.strip()]
    cameras = []
    for document in documents:
        if isinstance(document, dict):
            document.pop("header", None)
        if document not in cameras:
            cameras.append(document)
    if len(cameras) > 1:
        raise yaml.YAMLError(
            f"it holds {len(cameras)} different cameras; save the one to use in a file "
            "alone"
        )
    return cameras[0] if cameras else None


def dump_yaml(content: dict) -> str:
    """YAML that PyYAML, yaml-cpp (ROS) and cv2.FileStorage read."""
    return yaml.dump(
        content, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=120
    )


def as_ros_layout(content: Any) -> Any:
    """The content of a camera file of Kalibr, of OpenCV or of ROS in the layout of ROS.

    Raises KeyError, TypeError or ValueError if an entry is missing or not valid, or a
    model is not known.
    """
    if not isinstance(content, dict):
        return content
    cameras = [name for name in content if re.fullmatch(r"cam\d+", str(name))]
    if cameras:
        return _of_kalibr(content, cameras)
    ros = {_ROS_NAMES.get(name, name): value for name, value in content.items()}
    if ros.get("fisheye_model"):  # of OpenCV's sample
        ros["distortion_model"] = "equidistant"
    for name in _SIZES:
        if name in ros and "image_width" not in ros:
            ros["image_width"], ros["image_height"] = ros[name]
    for name in ("camera_matrix", "distortion_coefficients"):
        if isinstance(ros.get(name), list):
            ros[name] = {"data": np.array(ros[name], float).ravel().tolist()}
    _require_whole_image(ros)
    return ros


def _require_whole_image(ros: dict) -> None:
    """Raise ValueError if a message of ROS has no calibration, or is that of a part of
    the image.
    """
    if not np.any(ros["camera_matrix"]["data"]):
        raise ValueError("its K is zero: the driver has no calibration")
    roi = ros.get("roi") or {}
    sizes = {"width": ros["image_width"], "height": ros["image_height"]}
    is_part = any(roi.get(name) not in (None, 0, size) for name, size in sizes.items())
    binning = max(ros.get("binning_x", 0), ros.get("binning_y", 0))
    if is_part or binning > 1:
        raise ValueError(
            "it has a region of interest or binning; give the log, which has the size "
            "of the images, without a camera file"
        )


def _of_kalibr(content: dict, cameras: list[str]) -> dict:
    """The only camera of Kalibr's camchain in the layout of ROS."""
    if len(cameras) > 1:
        raise ValueError(
            f"it holds {len(cameras)} cameras, {', '.join(cameras)}; save the one to "
            "use in a file alone"
        )
    camera = content[cameras[0]]
    model = camera["camera_model"]
    if model != "pinhole":
        raise ValueError(
            f"camera model {model!r:.40} of Kalibr is not supported, only 'pinhole'"
        )
    fu, fv, pu, pv = camera["intrinsics"]
    width, height = camera["resolution"]
    return {
        "image_width": width,
        "image_height": height,
        "camera_matrix": {"data": [fu, 0, pu, 0, fv, pv, 0, 0, 1]},
        "distortion_model": camera["distortion_model"],
        "distortion_coefficients": {"data": camera["distortion_coeffs"]},
    }


def parse_distortion(model: object, coefficients: Any) -> np.ndarray:
    """The coefficients (4,), (5,) or (8,) of a lens from the name of its model, or
    without one from their number.

    Raises ValueError if the model is not known, or has other coefficients.
    """
    data = np.array(coefficients, float).ravel()
    if not data.size:  # so does ROS write a lens without distortion
        data = np.zeros(4)
    if not model and len(data) == 8:
        model = _RATIONAL.name
    count = _count_coefficients(str(model or "").lower())
    if count == 5 and data[5:8].any():
        # of the longer model, whose name some programs leave out
        count = 8
    if count == 8 and data[8:].any():
        raise ValueError(
            "its thin prism or tilt coefficients (the ninth to fourteenth) are not "
            "supported unless zero"
        )
    # the last coefficients may be left out, or be followed by those of a longer model,
    # if they are zero
    if len(data) < 4 or np.any(data[count:]):
        name = LENS_MODELS[count].name
        raise ValueError(f"{name} has {count} distortion coefficients, not {data.size}")
    padded = np.zeros(count)
    padded[: len(data)] = data[:count]
    return padded


def _count_coefficients(name: str) -> int:
    """Number of coefficients of the lens model with a name."""
    known: list[str] = []
    for count, lens in LENS_MODELS.items():
        names = (lens.name, *lens.other_names)
        if name in names:
            return count
        known += filter(None, names)
    raise ValueError(
        f"distortion model {name!r:.40} is not supported, only "
        f"{', '.join(sorted(known))}"
    )
