"""Named drive of the suite with its difficulty."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

from simulator.rendering.drive import Drive

Difficulty = Literal["clean", "medium", "hard", "no lane"]


@dataclass(frozen=True)
class SuiteScene:
    """Drive of a few seconds with exact ground truth.

    Parameters
    ----------
    name : str
        Lower case letters, digits and hyphens, because it is part of file names.
    difficulty : str
        "clean", "medium", "hard" or "no lane".
    seconds : float
        Length of the video.
    description : str
        One sentence that says what the scene shows.
    drive : callable
        Function without arguments that returns the Drive.

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
