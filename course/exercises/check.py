"""The check of an exercise by its number."""

from __future__ import annotations

import os
from collections.abc import Callable

import numpy as np

from course.exercises import (
    chapters_01_04,
    chapters_05_06,
    chapters_07_08,
    chapters_09_12,
    chapters_13_16,
)
from course.exercises.hints import HintError, require, tried

# A teacher grades with this environment variable set: a wrong answer is an error then,
# so that nbval, which compares outputs and notices errors, fails the cell.
GRADING = "LANES_GRADING"

NAN_HINT = (
    "the answer has a NaN (not a number): look for a point outside the image, or for "
    "0 / 0."
)


class WrongAnswerError(AssertionError):
    """The answer to an exercise is wrong or not tried yet; the message is the hint."""


# The checks by exercise: each takes the answer, and by name what the exercise gives it.
# It returns a sentence with the number reached, for example "3.58 m (truth 3.66 m).",
# or raises a `HintError`.
CHECKS: dict[str, Callable[..., str]] = {
    "1.1": chapters_01_04.check_best_ruler,
    "2.1": chapters_01_04.check_board_errors,
    "3.1": chapters_01_04.check_undistort_pixel,
    "4.1": chapters_01_04.check_four_points,
    "5.1": chapters_05_06.check_paint_mask,
    "6.1": chapters_05_06.check_lane_width,
    "6.2": chapters_05_06.check_coasting,
    "7.1": chapters_07_08.check_ransac_choice,
    "8.1": chapters_07_08.check_bar,
    "8.2": chapters_07_08.check_sanity,
    "8.3": chapters_07_08.check_own_road,
    "9.1": chapters_09_12.check_pitch_error,
    "10.1": chapters_09_12.check_stripe_response,
    "11.1": chapters_09_12.check_known_width,
    "12.1": chapters_09_12.check_noise,
    "12.2": chapters_09_12.check_gate,
    "13.1": chapters_13_16.check_occlusion_map,
    "14.1": chapters_13_16.check_largest_share,
    "15.1": chapters_13_16.check_honest_finder,
    "16.1": chapters_13_16.check_loss_gradient,
}


def check_exercise(number: str, answer: object, **given: object) -> None:
    """Check the answer to an exercise and print the verdict.

    Prints "6.1: not tried yet.", a hint, or "6.1: correct, ..." with the number
    reached. An answer of None, or a function that returns None, is not tried yet.

    Raises ValueError if no exercise has this number. If the environment variable
    LANES_GRADING is set (not to 0), every verdict but "correct" is raised as a
    `WrongAnswerError` and not printed.

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
        numbers = ", ".join(sorted(CHECKS))
        raise ValueError(
            f"there is no exercise {number!r}; the exercises are {numbers}."
        )
    correct = False
    try:
        require(not _has_nan(tried(answer)), NAN_HINT)
        verdict = f"correct, {CHECKS[number](answer, **given)}"
        correct = True
    except HintError as hint:
        verdict = str(hint)
    except (
        Exception
    ) as error:  # the answer is code of the reader, which may raise anything
        verdict = f"your answer raised {type(error).__name__}: {error}"
    sentence = f"{number}: {verdict}"
    if not correct and is_grading():
        raise WrongAnswerError(sentence)
    print(sentence)


def is_grading() -> bool:
    """Whether a wrong answer is an error: the environment variable LANES_GRADING is
    set, and not to 0.
    """
    return os.environ.get(GRADING, "0") not in ("", "0")


def _has_nan(answer: object) -> bool:
    """Whether an answer is a NaN, or numbers with a NaN among them; not if it is a
    function or text.
    """
    try:
        return bool(np.isnan(np.asarray(answer, float)).any())
    except (TypeError, ValueError):
        return False
