"""Scores of a reader's lane finders on the three embedded videos."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from benchmark.evaluation import score_systems
from benchmark.own_finder import OwnFinder
from benchmark.scored_drive import COMMITTED, PROJECT_ROOT
from benchmark.scores import Row
from benchmark.systems import TRACKER

# The tracker has a memory: it gets more frames than a finder that sees each frame alone.
EVERY, TRACKER_EVERY = 10, 2


def score_finders(
    finders: Mapping[str, OwnFinder | str], *, every: int = EVERY
) -> Iterator[tuple[str, dict[str, Row]]]:
    """Score finders on the three embedded videos: after each, its scene and a row of the benchmark's table by name.

    Parameters
    ----------
    finders : mapping of str to (callable or str)
        A function takes a raw RGB picture and the camera with its pose. It returns the left and the right line in
        metres as `np.polyfit` does (y = np.polyval(line, x)), or None where it finds no lane. Or a system of the
        benchmark by its name, for example "tracker".
    every : int
        Only each `every`-th frame is scored, of the tracker each second one; a finder with a memory needs all of them.
    """
    systems = {name: (find, TRACKER_EVERY if find == TRACKER else every) for name, find in finders.items()}
    for scene, file in COMMITTED.items():
        rows = score_systems(PROJECT_ROOT / "test_videos" / file, systems)
        yield scene, {row["system"]: row | {"scene": scene} for row in rows}
