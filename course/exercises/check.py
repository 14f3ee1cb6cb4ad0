"""The check of an exercise by its number."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module

import numpy as np

from course.exercises.verdict import NOT_TRIED, Checks, Verdict, hint

CHAPTERS = range(1, 17)
# Each check takes the answer and named arguments of the exercise, and returns a Verdict.
CHECKS: Checks = {}
for _chapter in CHAPTERS:
    CHECKS |= import_module(f"course.exercises.chapter_{_chapter:02}").CHECKS


def check_exercise(number: str, answer: object, **given: object) -> None:
    """Check the answer to an exercise and print the verdict.

    Prints "6.1: not tried yet.", a hint, or "6.1: correct, ..." with the number reached. An answer of None, or a
    function that returns None, is not tried yet.

    Parameters
    ----------
    number : str
        Number of the exercise, for example "6.1".
    answer : object
        A value, or a function that the check calls.
    **given
        Further arguments of the check, as in the starter cell of the exercise.

    Raises
    ------
    ValueError
        If no exercise has this number.
    """
    if number not in CHECKS:
        raise ValueError(f"there is no exercise {number!r}; the exercises are {', '.join(sorted(CHECKS))}.")
    print(f"{number}: {_judge(CHECKS[number], answer, given)}")


def _judge(check: Callable[..., Verdict], answer: object, given: dict[str, object]) -> Verdict:
    if answer is None:
        return NOT_TRIED
    if _has_nan(answer):
        return hint("the answer has a NaN (not a number): look for a point outside the image, or for 0 / 0.")
    try:
        return check(answer, **given)
    except Exception as error:  # the answer is code of the reader, which may raise anything
        return hint(f"your answer raised {type(error).__name__}: {error}")


def _has_nan(answer: object) -> bool:
    """Whether an answer is a NaN, or numbers with a NaN among them; not if it is a function or text."""
    try:
        return bool(np.isnan(np.asarray(answer, float)).any())
    except (TypeError, ValueError):
        return False
