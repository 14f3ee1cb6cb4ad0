"""Lens models, and the camera files that name them: YAML as written here, of ROS, OpenCV's FileStorage and Kalibr.

A lens model maps rays to the image, up to a largest angle. A new model is one entry of `LENS_MODELS`.
Directions (x, y) are those of rays with z = 1. The files have many names for a model; here the
number of coefficients, in OpenCV's order, identifies it.
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


@dataclass(frozen=True)
class LensModel:
    """How a lens distorts directions, by the `name` in ROS and `other_names` (Kalibr, OpenCV, RealSense, drivers).

    `distort(x, y, *coefficients)` returns the distorted directions. `ratio(*coefficients)` are numerator and
    denominator of the radial part, in powers of the squared tangent of the angle to the optical axis; for a fisheye
    lens in those of the squared angle. `opencv` has `undistortPoints` and `initUndistortRectifyMap`.
    """

    name: str
    other_names: tuple[str, ...]
    distort: Callable[..., tuple[np.ndarray, np.ndarray]]
    ratio: Callable[..., tuple[Sequence[float], Sequence[float]]]
    opencv: Any = cv2

    @property
    def is_fisheye(self) -> bool:
        """Whether the distortion is a polynomial of the angle to the optical axis."""
        return self.opencv is cv2.fisheye


def _distort_brown(
    x: np.ndarray, y: np.ndarray, k1: float, k2: float, p1: float, p2: float, k3: float, *denominator: float
) -> tuple[np.ndarray, np.ndarray]:
    """The distortion of Brown and Conrady, also with a denominator k4, k5, k6."""
    if not any((k1, k2, p1, p2, k3, *denominator)):
        return x, y
    r2 = x * x + y * y
    r4 = r2 * r2
    radial = 1 + k1 * r2 + k2 * r4 + k3 * (r4 * r2)
    if denominator:
        k4, k5, k6 = denominator
        radial = radial / (1 + k4 * r2 + k5 * r4 + k6 * (r4 * r2))
    two_xy = 2 * x * y
    return x * radial + p1 * two_xy + p2 * (r2 + 2 * x * x), y * radial + p1 * (r2 + 2 * y * y) + p2 * two_xy


def _brown_ratio(k1: float, k2: float, p1: float, p2: float, k3: float, *denominator: float) -> tuple:
    return (1.0, k1, k2, k3), (1.0, *denominator)


def _distort_fisheye(x: np.ndarray, y: np.ndarray, *coefficients: float) -> tuple[np.ndarray, np.ndarray]:
    """The distortion of Kannala and Brandt (PAMI 2006)."""
    tangent = np.hypot(x, y)
    distorted = distort_angle(np.arctan(tangent), *coefficients)
    scale = np.divide(distorted, tangent, out=np.ones_like(tangent), where=tangent > 1e-9)
    return x * scale, y * scale


def distort_angle(angle_rad: np.ndarray, k1: float, k2: float, k3: float, k4: float) -> np.ndarray:
    """Distance from the principal point, in focal lengths, at which a fisheye lens shows an angle."""
    a2 = angle_rad * angle_rad
    return angle_rad * (1 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4))))


_BROWN_NAMES = ("", "none", "radtan", "brown_conrady", "brown-conrady", "pinhole")
_FISHEYE_NAMES = ("fisheye", "kannala_brandt4", "equi")
# By the number of coefficients, which are in OpenCV's order.
LENS_MODELS = {
    4: LensModel("equidistant", _FISHEYE_NAMES, _distort_fisheye, lambda *k: ((1.0, *k), (1.0,)), cv2.fisheye),
    5: LensModel("plumb_bob", _BROWN_NAMES, _distort_brown, _brown_ratio),
    8: LensModel("rational_polynomial", ("rational",), _distort_brown, _brown_ratio),
}


@lru_cache(maxsize=32)
def largest_ray(*distortion: float) -> float:
    """Tangent of the largest angle to the optical axis up to which the distortion is monotonic; see `Camera`.

    Cached, because pitch motion makes a new camera with the same lens in every frame.
    """
    model = LENS_MODELS[len(distortion)]
    numerator, denominator = map(Polynomial, model.ratio(*distortion))
    # The derivative of r n(r^2) / d(r^2) by r, times d^2, as a polynomial in r^2. Where d is 0, the ratio has a pole.
    square = Polynomial((0.0, 1.0))
    growth = (numerator + 2 * square * numerator.deriv()) * denominator - 2 * square * numerator * denominator.deriv()
    # Roots in 1 / r^2: then the first coefficient is 1, never 0.
    roots = np.concatenate([np.roots(polynomial.coef) for polynomial in (growth, denominator)])
    inverse_square = max(roots[np.isreal(roots)].real, default=0.0)
    first = float(inverse_square**-0.5) if inverse_square > 0 else np.inf
    if model.is_fisheye:
        return float(np.tan(first)) if first < np.pi / 2 else np.inf
    return first


# Camera files, as one layout: that of ROS `camera_info` files.


class _Dumper(yaml.SafeDumper):
    """Lists on one line: cv2.FileStorage does not read those that begin in the column of their key."""


def _represent_list(dumper: Any, values: list) -> yaml.Node:
    return dumper.represent_sequence("tag:yaml.org,2002:seq", values, flow_style=True)


_Dumper.add_representer(list, _represent_list)


def parse_camera_yaml(text: str) -> Any:
    """The content of YAML, also of OpenCV's, with a first line and a tag of its own. Raises yaml.YAMLError."""
    if text.lstrip().startswith("<?xml"):
        raise yaml.YAMLError("it is XML; write it as YAML, as cv2.FileStorage does for a name that ends in .yaml")
    text = re.sub(r"\A%YAML[:\s]\s*1\.\d\s*\n(---\s*\n)?", "", text)
    return parse_yaml(re.sub(r"!!opencv-matrix\b", "", text))


def dump_yaml(content: dict) -> str:
    """YAML that PyYAML, yaml-cpp (ROS) and cv2.FileStorage read."""
    return yaml.dump(content, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=120)


def as_ros_layout(content: Any) -> Any:
    """The content of a camera file of Kalibr, of OpenCV or of ROS in the layout of ROS.

    Raises KeyError, TypeError or ValueError if an entry is missing or not valid, or a model is not known.
    """
    if not isinstance(content, dict):
        return content
    if cameras := [name for name in content if re.fullmatch(r"cam\d+", str(name))]:
        return _of_kalibr(content, cameras)
    # names of OpenCV's samples, old and new, with those of ROS
    names = {"Camera_Matrix": "camera_matrix", "cameraMatrix": "camera_matrix", "K": "camera_matrix"}
    names |= dict.fromkeys(("Distortion_Coefficients", "distCoeffs", "D"), "distortion_coefficients")
    names |= {"image_Width": "image_width", "image_Height": "image_height"}
    content = {names.get(name, name): value for name, value in content.items()}
    if content.get("fisheye_model"):  # of OpenCV's sample
        content["distortion_model"] = "equidistant"
    return content


def _of_kalibr(content: dict, cameras: list[str]) -> dict:
    """The only camera of Kalibr's camchain in the layout of ROS."""
    if len(cameras) > 1:
        raise ValueError(f"it holds {len(cameras)} cameras, {', '.join(cameras)}; save the one to use in a file alone")
    camera = content[cameras[0]]
    if camera["camera_model"] != "pinhole":
        raise ValueError(f"camera model {camera['camera_model']!r:.40} of Kalibr is not supported, only 'pinhole'")
    (fu, fv, pu, pv), (width, height) = camera["intrinsics"], camera["resolution"]
    return {
        "image_width": width,
        "image_height": height,
        "camera_matrix": {"data": [fu, 0, pu, 0, fv, pv, 0, 0, 1]},
        "distortion_model": camera["distortion_model"],
        "distortion_coefficients": {"data": camera["distortion_coeffs"]},
    }


def parse_distortion(model: object, coefficients: Any) -> np.ndarray:
    """The coefficients (4,), (5,) or (8,) of a lens from the name of its model, or without one from their number.

    Raises ValueError if the model is not known, or has other coefficients.
    """
    data = np.array(coefficients, float).ravel()
    data = data if data.size else np.zeros(4)  # so does ROS write a lens without distortion
    counts = {name: count for count, lens in LENS_MODELS.items() for name in (lens.name, *lens.other_names)}
    name = str(model or (LENS_MODELS[8].name if len(data) == 8 else "")).lower()
    if name not in counts:
        known = ", ".join(sorted(filter(None, counts)))
        raise ValueError(f"distortion model {name!r:.40} is not supported, only {known}")
    count = counts[name]
    if count == 5 and data[5:8].any():  # of the longer model, whose name some programs leave out
        count = 8
    if count == 8 and data[8:].any():
        raise ValueError("its thin prism or tilt coefficients (the ninth to fourteenth) are not supported unless zero")
    # the last coefficients may be left out, or be followed by those of a longer model, if they are zero
    if len(data) < 4 or np.any(data[count:]):
        raise ValueError(f"{LENS_MODELS[count].name} has {count} distortion coefficients, not {data.size}")
    return np.pad(data[:count], (0, max(0, count - len(data))))
