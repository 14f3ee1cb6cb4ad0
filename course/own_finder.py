"""Scores of a reader's lane finder on the three embedded videos."""

from __future__ import annotations

from benchmark.evaluation import score_video
from benchmark.own_finder import OwnFinder
from benchmark.scored_drive import COMMITTED, PROJECT_ROOT
from benchmark.scores import Row


def score_finder(find: OwnFinder | str, *, every: int = 10, name: str | None = None) -> list[Row]:
    """Score a finder on the three embedded videos: a row of the benchmark's table for each.

    Parameters
    ----------
    find : callable or str
        Takes a raw RGB picture and the camera with its pose. Returns the left and the right line in metres as
        `np.polyfit` does (y = np.polyval(line, x)), or None where it finds no lane. Or a system of the benchmark by
        its name, for example "tracker".
    every : int
        Only each `every`-th frame is scored; a finder with a memory needs all of them.
    """
    rows = []
    for scene, file in COMMITTED.items():
        row = score_video(PROJECT_ROOT / "test_videos" / file, find, every=every, name=name)
        rows.append(row | {"scene": scene})
    return rows
