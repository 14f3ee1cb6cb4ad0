"""Exercise of chapter 15: a finder that is better than the starter."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from benchmark.own_finder import Lines, OwnFinder
from benchmark.scored_drive import COMMITTED, PROJECT_ROOT
from benchmark.scores import Row
from course.exercises.verdict import NOT_TRIED, Verdict, correct, hint
from course.own_finder import score_finder
from lanes.camera import load_camera
from lanes.video.reader import read_video

# Points of accuracy on the motorway that a better finder gains at least.
GAIN = 0.10
# Points that it may lose on another video: a finder that fails there is right in some frames by chance.
LOSS = 0.05


def check_better_finder(find: OwnFinder, *, starter: Sequence[Row], every: int = 10) -> Verdict:
    """15.1: a finder that beats the starter on the motorway and loses at most `LOSS` on the others.

    `every` is that of `score_finder`, and the one that `starter` was scored with.
    """
    if all(_first_lines(find, PROJECT_ROOT / "test_videos" / file) is None for file in COMMITTED.values()):
        return NOT_TRIED
    rows = score_finder(find, every=every)
    before, after = ({row["scene"]: row["accuracy"] for row in scores} for scores in (starter, rows))
    reached = ", ".join(f"{scene} {before[scene]:.0%} -> {after[scene]:.0%}" for scene in after)
    if all(row["lateral_5_20m_median_m"] > 3 for row in rows):
        return hint(f"{reached}. The lines are metres away from the truth: are they in metres, left line first?")
    worse = [scene for scene in after if after[scene] < before[scene] - LOSS]
    if worse:
        return hint(f"{reached}. It loses on {', '.join(worse)}.")
    if after["motorway"] < min(before["motorway"] + GAIN, 1.0):
        return hint(f"{reached}. The motorway needs {GAIN:.0%} more; what do the wrong frames have in common?")
    return correct(f"{reached}.")


def _first_lines(find: OwnFinder, video: Path) -> Lines | None:
    """What a finder returns for the first frame of a video."""
    return find(next(read_video(video)), load_camera(video.with_suffix(".yaml")))


CHECKS = {"15.1": check_better_finder}
