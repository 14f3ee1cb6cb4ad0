"""How a check tells what is wrong with an answer: it raises a `HintError`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

Answer = TypeVar("Answer")


class HintError(Exception):
    """The answer is wrong; the sentence describes it and names the next step."""


def require(fulfilled: object, sentence: str) -> None:
    """Raise a `HintError` unless a condition is fulfilled."""
    if not fulfilled:
        raise HintError(sentence)


def tried(answer: Answer | None) -> Answer:
    """The answer; the starter is None, or a function that returns None."""
    if answer is None:
        raise HintError("not tried yet.")
    return answer


def require_shape(answer: Any, shape: tuple[int, ...], what: str) -> Any:
    """The answer as an array of this shape, or as a number if that is ().

    `what` is the sentence for another shape, and for text instead of numbers.
    """
    has_shape = np.shape(answer) == shape
    require(has_shape, f"{what}; yours has the shape {np.shape(answer)}.")
    is_text = np.asarray(answer).dtype.kind in "SU"
    require(not is_text, f"{what}; yours is text: remove the quotes.")
    return np.asarray(answer, float)[()]


def require_equal(
    found: ArrayLike,
    true: ArrayLike,
    mistakes: Mapping[str, ArrayLike],
    otherwise: str,
    *,
    said: str = "",
    rtol: float = 0,
    atol: ArrayLike = 0,
) -> None:
    """Raise a `HintError` unless the numbers found are the true ones.

    It is the sentence of the mistake that leads to the numbers found, else `otherwise`,
    after the words `said`.
    """
    for sentence, numbers in {"": true, **mistakes}.items():
        same_shape = np.shape(found) == np.shape(numbers)
        if same_shape and np.isclose(found, numbers, rtol, atol).all():
            require(not sentence, said + sentence)
            return
    raise HintError(said + otherwise)
