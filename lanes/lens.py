"""Lens models: where a lens shows a ray, up to which angle that holds, and what camera files call the model.

A new model is one entry of `LENS_MODELS`. Directions (x, y) are those of rays with z = 1.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.polynomial import Polynomial


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
