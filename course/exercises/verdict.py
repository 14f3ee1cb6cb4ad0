"""The verdict of a check about an answer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


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
