"""Errors of this package: each message names the file, the fault and the remedy."""

from __future__ import annotations

import math
from contextlib import suppress
from numbers import Real
from typing import Any, TypeVar

T = TypeVar("T")


class LaneError(ValueError):
    """The input cannot be used; the base class of all errors of this package."""


def require_number(value: object, name: str, *, positive: bool = False, finite: bool = True) -> float:
    """The number as a Python float: of an int, float, Fraction or NumPy number. Raises LaneError otherwise."""
    number = None
    if isinstance(value, Real) and not isinstance(value, bool):
        with suppress(OverflowError):  # of integers
            number = float(value)
    if number is None or (finite and not math.isfinite(number)) or (positive and not number > 0):
        kind = "positive " if positive else "finite " if finite else ""
        raise LaneError(f"{name} must be a {kind}number; got {value!r}.")
    return number


def require_type(value: Any, kind: type[T], name: str, remedy: str = "") -> T:
    """The value, if it is of that kind; raises LaneError with the remedy otherwise."""
    if not isinstance(value, kind):
        remedy = remedy or f"make them with {kind.__name__}(name=value), or omit them"
        raise LaneError(f"{name} must be {kind.__name__}, not {type(value).__name__}; {remedy}.")
    return value


class PictureError(LaneError):
    """A picture cannot be used; the message names the file, the fault and a remedy."""


class CameraError(LaneError):
    """A camera, camera file or calibration cannot be used; the message says which, why and what to do."""


class PoseError(LaneError):
    """The camera pose cannot be estimated from the pictures; the message says why and what to do."""

    # Exit status of a command: the input is valid, but the task failed.
    exit_status = 1


class VideoError(LaneError):
    """A video cannot be used; the message names the file, the fault and a remedy."""
