"""Results with arrays that are compared by value."""

from __future__ import annotations

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
        values = _values(self)
        return hash(tuple(v for v in values if isinstance(v, int | float | str)))


def _same_value(a: Any, b: Any) -> bool:
    """Whether two values are equal; arrays, tuples, dicts and dataclasses are compared
    by what they hold.
    """
    if a is b:
        return True
    if isinstance(a, np.ndarray):
        if not isinstance(b, np.ndarray) or a.dtype != b.dtype:
            return False
        return np.array_equal(a, b, equal_nan=a.dtype.kind in "fc")
    if type(a) is not type(b):
        return bool(a == b)
    if isinstance(a, dict):
        if a.keys() != b.keys():
            return False
        b = [b[key] for key in a]
        a = list(a.values())
    elif is_dataclass(a):
        a = _values(a)
        b = _values(b)
    if isinstance(a, tuple | list):
        return len(a) == len(b) and all(map(_same_value, a, b))
    return bool(a == b)


def _values(result: Any) -> list:
    return [getattr(result, field.name) for field in fields(result)]
