"""Results with arrays that are compared by value."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np


class ByValue:
    """Base class of dataclasses with ``eq=False``: equal if all fields are, arrays
    element by element, NaN to NaN.
    """

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return _same_value(self, other)

    def __hash__(self) -> int:
        # Of what can be hashed at once; equal results have equal ones.
        hashable = [
            value for value in _values(self) if isinstance(value, int | float | str)
        ]
        return hash(tuple(hashable))


def _same_value(a: Any, b: Any) -> bool:
    """Whether two values are equal; arrays, tuples, dicts and dataclasses are compared
    by what they hold.
    """
    if a is b:
        return True
    if isinstance(a, np.ndarray):
        return isinstance(b, np.ndarray) and _same_array(a, b)
    if type(a) is not type(b):
        return bool(a == b)
    if isinstance(a, dict):
        return a.keys() == b.keys() and _same_all(a.values(), [b[key] for key in a])
    if is_dataclass(a):
        return _same_all(_values(a), _values(b))
    if isinstance(a, tuple | list):
        return len(a) == len(b) and _same_all(a, b)
    return bool(a == b)


def _same_array(a: np.ndarray, b: np.ndarray) -> bool:
    has_nan = a.dtype.kind in "fc"
    return a.dtype == b.dtype and np.array_equal(a, b, equal_nan=has_nan)


def _same_all(a: Iterable, b: Iterable) -> bool:
    return all(map(_same_value, a, b))


def _values(result: Any) -> list:
    return [getattr(result, field.name) for field in fields(result)]
