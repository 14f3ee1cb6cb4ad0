"""Named drive of the suite with its difficulty."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

from simulator.rendering.drive import Drive

Difficulty = Literal["clean", "medium", "hard", "no lane"]


@dataclass(frozen=True)
class SuiteScene:
    """Drive of a few seconds with exact ground truth; `drive` returns it, `description` is one sentence.

    The name has only lower case letters, digits and hyphens, because it is part of file names.

    Raises
    ------
    ValueError
        If the name has other characters or there is no such difficulty.
    """

    name: str
    difficulty: Difficulty
    seconds: float
    description: str
    drive: Callable[[], Drive]

    def __post_init__(self) -> None:
        if not self.name.replace("-", "").isalnum() or self.name != self.name.lower():
            raise ValueError(
                f"a scene's name must consist of lower case letters, digits and hyphens, not {self.name!r}."
            )
        if self.difficulty not in get_args(Difficulty):
            raise ValueError(
                f"{self.name}: unknown difficulty {self.difficulty!r}; choose one of {', '.join(get_args(Difficulty))}."
            )
