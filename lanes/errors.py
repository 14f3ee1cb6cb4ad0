"""Errors, checks of arguments, and results that are compared by value.

The message of an error names the file, the fault and the remedy.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import fields, is_dataclass
from numbers import Real
from typing import Any, TypeVar

import numpy as np

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


def require_number(value: object, name: str, *, positive: bool = False, finite: bool = True) -> float:
    """The number as a Python float: of an int, float, Fraction or NumPy number.

    Raises LaneError otherwise.
    """
    number = None
    if isinstance(value, Real) and not isinstance(value, bool):
        with suppress(OverflowError):  # of integers
            number = float(value)
    if number is None or (finite and not math.isfinite(number)) or (positive and not number > 0):
        kind = "positive " if positive else "finite " if finite else ""
        raise LaneError(f"{name} must be a {kind}number; got {value!r}.")
    return number


def require_type(value: Any, kind: type[_T], name: str, remedy: str = "") -> _T:
    """The value, if it is of that kind; raises LaneError with the remedy otherwise."""
    if not isinstance(value, kind):
        remedy = remedy or f"make them with {kind.__name__}(name=value), or omit them"
        raise LaneError(f"{name} must be {kind.__name__}, not {type(value).__name__}; {remedy}.")
    return value


class ByValue:
    """Base class of dataclasses with ``eq=False``: equal if all fields are, arrays
    element by element, NaN to NaN.
    """

    def __eq__(self, other: object) -> bool:
        return _same_value(self, other) if type(other) is type(self) else NotImplemented

    def __hash__(self) -> int:
        # Of what can be hashed at once; equal results have equal ones.
        return hash(tuple(value for value in _field_values(self) if isinstance(value, int | float | str)))


def _same_value(a: Any, b: Any) -> bool:
    """Whether two values are equal; arrays, tuples, dicts and dataclasses are compared
    by what they hold.
    """
    if a is b:
        return True
    if isinstance(a, np.ndarray):
        numbers = a.dtype.kind in "fc"
        return isinstance(b, np.ndarray) and a.dtype == b.dtype and np.array_equal(a, b, equal_nan=numbers)
    if type(a) is not type(b):
        return bool(a == b)
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(_same_value(value, b[key]) for key, value in a.items())
    if is_dataclass(a):
        a, b = _field_values(a), _field_values(b)
    if isinstance(a, tuple | list):
        return len(a) == len(b) and all(map(_same_value, a, b))
    return bool(a == b)


def _field_values(result: Any) -> tuple:
    return tuple(getattr(result, field.name) for field in fields(result))
