"""Scores of a reader's lane finder on the three embedded videos, next to the systems of the benchmark."""

from __future__ import annotations

from collections.abc import Sequence

from benchmark.evaluation import score_video
from benchmark.own_finder import OwnFinder
from benchmark.reporting.tables import markdown_table, read_scores
from benchmark.scored_drive import COMMITTED, PROJECT_ROOT
from benchmark.scores import Row

# Variant 0 of the scenes, as the embedded videos are.
SCORES = PROJECT_ROOT / "docs" / "benchmark" / "tuning_set" / "benchmark.csv"


def score_finder(find: OwnFinder, *, every: int = 10, name: str = "my_finder") -> list[Row]:
    """Score a finder on the three embedded videos: a row of the benchmark's table for each.

    Parameters
    ----------
    find : callable
        Takes a raw RGB picture and the camera with its pose. Returns the left and the right line in metres as
        `np.polyfit` does (y = np.polyval(line, x)), or None where it finds no lane.
    every : int
        Only each `every`-th frame is scored; a finder with a memory needs all of them.
    """
    rows = []
    for scene, file in COMMITTED.items():
        row = score_video(PROJECT_ROOT / "test_videos" / file, find, every=every, name=name)
        rows.append(row | {"scene": scene})
    return rows


def finder_table(rows: Sequence[Row]) -> str:
    """Markdown table: the rows of `score_finder`, next to the rows of the systems on the same videos."""
    known = {(row["scene"], row["system"]): row for row in read_scores(SCORES)}
    systems = list(dict.fromkeys(system for _, system in known))
    table = []
    for own in rows:
        beside = [known[own["scene"], system] for system in systems if (own["scene"], system) in known]
        table += [row | {"difficulty": beside[0]["difficulty"]} for row in [*beside, own]]
    return markdown_table(table)
