"""Results that hold arrays, compared by value."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np


class ByValue:
    """Base class of dataclasses with ``eq=False``: equal if all fields are, arrays element by element, NaN to NaN."""

    def __eq__(self, other: object) -> bool:
        return same_value(self, other) if type(other) is type(self) else NotImplemented

    def __hash__(self) -> int:
        # Of what can be hashed at once; equal results have equal ones.
        return hash(tuple(value for value in _field_values(self) if isinstance(value, int | float | str)))


def same_value(a: Any, b: Any) -> bool:
    """Whether two values are equal; arrays, tuples, dicts and dataclasses are compared by what they hold."""
    if a is b:
        return True
    if isinstance(a, np.ndarray):
        numbers = a.dtype.kind in "fc"
        return isinstance(b, np.ndarray) and a.dtype == b.dtype and np.array_equal(a, b, equal_nan=numbers)
    if type(a) is not type(b):
        return bool(a == b)
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same_value(value, b[key]) for key, value in a.items())
    if is_dataclass(a):
        a, b = _field_values(a), _field_values(b)
    if isinstance(a, tuple | list):
        return len(a) == len(b) and all(map(same_value, a, b))
    return bool(a == b)


def _field_values(result: Any) -> tuple:
    return tuple(getattr(result, field.name) for field in fields(result))
