"""Exercise of chapter 15: a finder that knows when it sees too little."""

from __future__ import annotations

from pathlib import Path

from benchmark.own_finder import Lines, OwnFinder
from benchmark.scored_drive import COMMITTED, PROJECT_ROOT
from benchmark.scores import Row
from course.exercises.verdict import NOT_TRIED, Verdict, correct, hint
from course.own_finder import score_finders
from lanes.camera import load_camera
from lanes.video.reader import read_video

# Share of right frames on the motorway and on challenge, and of wrong ones in the hairpins. The table of the chapter
# has those of the joint fit alone.
LEAST_RIGHT, MOST_WRONG = 0.9, 0.2
HAIRPINS = "harder-challenge"


def check_honest_finder(find: OwnFinder) -> Verdict:
    """15.1: a finder that is right on good roads, and returns None in hairpins instead of a wrong lane."""
    if used := {"find_lane", "LaneTracker", "track"} & set(find.__code__.co_names):
        return hint(f"{min(used)} is the engine. Build your finder from your own parts: joint_finder and your mask.")
    if all(_first_lines(find, PROJECT_ROOT / "test_videos" / file) is None for file in COMMITTED.values()):
        return NOT_TRIED
    rows = {scene: scores["yours"] for scene, scores in score_finders({"yours": find})}
    reached = ", ".join(
        f"{scene} {row['accuracy']:.0%} right, {_wrong_share(row):.0%} wrong" for scene, row in rows.items()
    )
    good = {scene: row for scene, row in rows.items() if scene != HAIRPINS}
    if all(row["lateral_5_20m_median_m"] > 3 for row in good.values()):
        return hint(f"{reached}. The lines are metres away from the truth: are they in metres, left line first?")
    too_few = [scene for scene, row in good.items() if row["accuracy"] < LEAST_RIGHT]
    if too_few:
        return hint(f"{reached}. On {' and '.join(too_few)} too few frames are right: is the finder too careful?")
    if _wrong_share(rows[HAIRPINS]) > MOST_WRONG:
        return hint(f"{reached}. In the hairpins, return None where the fit does not explain what is seen.")
    return correct(f"{reached}.")


def _wrong_share(row: Row) -> float:
    """Share of the frames in which a wrong lane is returned; None is not wrong."""
    return float(row["confident_and_wrong_share"])


def _first_lines(find: OwnFinder, video: Path) -> Lines | None:
    """What a finder returns for the first frame of a video."""
    return find(next(read_video(video)), load_camera(video.with_suffix(".yaml")))


CHECKS = {"15.1": check_honest_finder}
