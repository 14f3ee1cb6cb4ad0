"""The check of an exercise by its number."""

from __future__ import annotations

import numpy as np

from course.exercises import chapters_01_04, chapters_05_08, chapters_09_12, chapters_13_16
from course.exercises.hints import Checks, HintError, require, tried

CHECKS: Checks = chapters_01_04.CHECKS | chapters_05_08.CHECKS | chapters_09_12.CHECKS | chapters_13_16.CHECKS


def check_exercise(number: str, answer: object, **given: object) -> None:
    """Check the answer to an exercise and print the verdict.

    Prints "6.1: not tried yet.", a hint, or "6.1: correct, ..." with the number reached. An answer of None, or a
    function that returns None, is not tried yet. Raises ValueError if no exercise has this number.

    Parameters
    ----------
    number : str
        Number of the exercise, for example "6.1".
    answer : object
        A value, or a function that the check calls.
    **given
        Further arguments of the check, as in the starter cell of the exercise.
    """
    if number not in CHECKS:
        raise ValueError(f"there is no exercise {number!r}; the exercises are {', '.join(sorted(CHECKS))}.")
    try:
        nan = "the answer has a NaN (not a number): look for a point outside the image, or for 0 / 0."
        require(not _has_nan(tried(answer)), nan)
        verdict = f"correct, {CHECKS[number](answer, **given)}"
    except HintError as hint:
        verdict = str(hint)
    except Exception as error:  # the answer is code of the reader, which may raise anything
        verdict = f"your answer raised {type(error).__name__}: {error}"
    print(f"{number}: {verdict}")


def _has_nan(answer: object) -> bool:
    """Whether an answer is a NaN, or numbers with a NaN among them; not if it is a function or text."""
    try:
        return bool(np.isnan(np.asarray(answer, float)).any())
    except (TypeError, ValueError):
        return False
