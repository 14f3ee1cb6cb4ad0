"""The verdict of a check about an answer."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike


@dataclass(frozen=True)
class Verdict:
    """The result of a check: whether the answer is correct, and a sentence with the number reached or a hint."""

    correct: bool
    sentence: str

    def __str__(self) -> str:
        return f"correct, {self.sentence}" if self.correct else self.sentence


# The checks of a chapter: each takes the answer, and by name what the exercise gives it.
Checks = dict[str, Callable[..., Verdict]]

NOT_TRIED = Verdict(False, "not tried yet.")


def correct(sentence: str) -> Verdict:
    """The answer is correct; `sentence` states the number reached, for example "3.58 m (truth 3.66 m)."."""
    return Verdict(True, sentence)


def hint(sentence: str) -> Verdict:
    """The answer is wrong; `sentence` describes it and names the next step."""
    return Verdict(False, sentence)


def find_mistake(
    found: ArrayLike, mistakes: Mapping[str, ArrayLike], *, rtol: float = 0, atol: float = 0
) -> str | None:
    """The sentence about the mistake that leads to the numbers found, or None; `mistakes` has the numbers of each."""
    for sentence, wrong in mistakes.items():
        if np.shape(found) == np.shape(wrong) and np.allclose(found, wrong, rtol, atol):
            return sentence
    return None
