"""Errors and checks of arguments.

The message of an error names the file, the fault and the remedy.
"""

from __future__ import annotations

import math
from contextlib import suppress
from numbers import Real
from typing import Any, TypeVar

_T = TypeVar("_T")


class LaneError(ValueError):
    """The input cannot be used; the base class of all errors of this package."""


class PictureError(LaneError):
    """An image cannot be used; the message names the file, the fault and a remedy."""


class CameraError(LaneError):
    """A camera, camera file or calibration cannot be used; the message says which, why
    and what to do.
    """


class PoseError(LaneError):
    """The camera pose cannot be estimated from the images; the message says why and
    what to do.
    """


class VideoError(LaneError):
    """A video cannot be used; the message names the file, the fault and a remedy."""


def require_number(
    value: object, name: str, *, positive: bool = False, finite: bool = True
) -> float:
    """The number as a Python float: of an int, float, Fraction or NumPy number.

    Raises LaneError otherwise.
    """
    if isinstance(value, Real) and not isinstance(value, bool):
        with suppress(OverflowError):  # of integers
            number = float(value)
            is_finite = math.isfinite(number) or not finite
            if is_finite and (number > 0 or not positive):
                return number
    kind = ""
    if positive:
        kind = "positive "
    elif finite:
        kind = "finite "
    raise LaneError(f"{name} must be a {kind}number; got {value!r}.")


def require_type(value: Any, kind: type[_T], name: str, remedy: str = "") -> _T:
    """The value, if it is of that kind; raises LaneError with the remedy otherwise."""
    if not isinstance(value, kind):
        wanted = kind.__name__
        given = type(value).__name__
        remedy = remedy or f"make them with {wanted}(name=value), or omit them"
        raise LaneError(f"{name} must be {wanted}, not {given}; {remedy}.")
    return value
