"""The result of a system on a scene: the errors of its frames, and the conditions of the measurement."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from benchmark.consistency import NormalizedErrors
from benchmark.errors import FrameErrors


@dataclass(frozen=True, eq=False)
class Result:
    """The errors of one system on one scene, and the conditions of the measurement.

    `pose` is the source of the camera pose: "true", "estimated" or "not found". `workers` and `machine` (see
    `describe_machine`) are the number of processes and the machine of the time measurement. `normalized` are the errors
    in stated standard deviations, None for a system that states none.
    """

    scene: str
    difficulty: str
    system: str
    errors: FrameErrors
    pose: str = "true"
    workers: int = 1
    fps: float = 25.0
    machine: str = ""
    normalized: NormalizedErrors | None = None


def by_difficulty(results: Iterable[Result]) -> dict[tuple[str, str], list[Result]]:
    """The results of each difficulty and system, in the order in which these first occur."""
    groups: dict[tuple[str, str], list[Result]] = {}
    for result in results:
        groups.setdefault((result.difficulty, result.system), []).append(result)
    return groups
