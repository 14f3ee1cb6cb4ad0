"""A named drive of the suite: what it shows and how hard it is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

from simulator.rendering.drive import Drive

Difficulty = Literal["clean", "medium", "hard", "no lane"]


@dataclass(frozen=True)
class SuiteScene:
    """A drive of some seconds with exact truth.

    Parameters
    ----------
    name : str
        Lower case letters, digits and hyphens: it becomes a file name.
    difficulty : str
        "clean", "medium", "hard" or "no lane".
    seconds : float
        How long it is to be driven.
    description : str
        One sentence: what is to be seen.
    drive : callable
        Called without arguments, gives the Drive.
    """

    name: str
    difficulty: Difficulty
    seconds: float
    description: str
    drive: Callable[[], Drive]

    def __post_init__(self) -> None:
        if not self.name.replace("-", "").isalnum() or self.name != self.name.lower():
            raise ValueError(f"a scene's name has lower case letters, digits and hyphens only, unlike {self.name!r}.")
        if self.difficulty not in get_args(Difficulty):
            raise ValueError(f"{self.name}: no difficulty {self.difficulty!r}; there are {get_args(Difficulty)}.")
