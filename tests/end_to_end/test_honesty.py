"""How often the tracker is confident and wrong: on videos followed here, and in the
published table of the suite.

A wrong lane with a confidence of 0.9 or more is confident and wrong. The bounds are
what README and docs promise; they are not to be loosened.
"""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import islice

import av
import numpy as np
import pytest

from benchmark.errors import CONFIDENT
from benchmark.evaluation import COMMITTED
from benchmark.scores import Row
from benchmark.systems import TRACKER
from benchmark.tables import read_scores
from lanes.camera.model import Camera, CameraPose
from lanes.tracking.tracker import LaneTracker
from simulator.scenes.suite import SUITE
from tests.support.committed import CommittedDrive
from tests.support.painted_drive import SMALL, TAR, PaintedDrive, Stripe, s_bend
from tests.support.project import ROOT

TABLE = ROOT / "docs" / "benchmark" / "benchmark.csv"
NO_LANE = "no lane"
# Largest share of confident and wrong frames, among those without a lane and those with
# one.
PROMISED = {NO_LANE: 0.0, "lane": 0.01}
# The variants of the suite that anything was chosen or fitted on.
TUNING_SET = {0, 1, 2, 7}
# The part of each committed video that is followed.
BEGIN_S, END_S = 3.6, 5.6


def test_the_tracker_is_seldom_confident_and_wrong_on_the_committed_videos():
    """Of the frames of all three, as in the published table: one frame of one video is
    more than this share.
    """
    errors = []
    for scene in COMMITTED:
        drive = CommittedDrive(scene, start_s=BEGIN_S, end_s=END_S)
        errors.append(
            drive.follow(
                (frame, None, number) for number, frame in enumerate(drive.frames)
            )[1]
        )
    assert [len(of_scene.available) for of_scene in errors] == [
        round(25 * (END_S - BEGIN_S))
    ] * len(COMMITTED)
    assert (
        np.concatenate([of_scene.confident_and_wrong for of_scene in errors]).mean()
        <= PROMISED["lane"]
    )
    # a shifted lane counts: otherwise this could not fail, nor if the tracker were
    # never confident
    first = errors[0]
    shifted = replace(
        first, lateral_m=first.lateral_m + 0.5, near_rms_m=first.near_rms_m + 0.5
    )
    assert shifted.confident_and_wrong.mean() > 0.9


# Roads without lane lines: a seam, patches with sharp edges, shadows of trees across
# the road, a black picture.
BARE_ROADS = {
    "seam": {"ground": (Stripe(0.3, 0.05, TAR), Stripe(-2.1, 0.06, TAR))},
    "patches": {
        "ground": (Stripe(-1.6, 1.4, (84, 84, 84)), Stripe(3.4, 0.8, (140, 140, 138)))
    },
    "shadows": {
        "shades": tuple(
            Stripe(0.0, 12.0, along_m=(at, at + 4.0))
            for at in (10.0, 22.0, 41.0, 60.0, 85.0)
        )
    },
    "black": {"black_s": (0.0, np.inf)},
}


@pytest.mark.parametrize("road", BARE_ROADS)
def test_the_tracker_is_never_confident_where_there_is_no_lane(road):
    drive = PaintedDrive(s_bend(), (), camera=SMALL, **BARE_ROADS[road])
    tracker = LaneTracker(SMALL, fps=25)
    tracked = [tracker.update(drive.frame(number / 25)) for number in range(25)]
    wrong = [lane is not None and lane.confidence >= CONFIDENT for lane in tracked]
    assert np.mean(wrong) <= PROMISED[NO_LANE]


# The published table is made by `python -m benchmark --seed 31 -o docs/benchmark`.


@pytest.fixture(scope="module")
def published() -> dict[tuple[str, int], Row]:
    """The tracker's row of each scene and variant, without the sums: that of ("dips",
    31) is named "dips-31".
    """
    rows = {}
    for row in read_scores(TABLE):
        if row["system"] == TRACKER and not row["scene"].startswith("all "):
            scene, number = re.fullmatch(r"(.*?)(?:-(\d+))?", row["scene"]).groups(
                default="0"
            )
            rows[scene, int(number)] = row
    return rows


@pytest.mark.parametrize("bound", PROMISED)
def test_the_published_shares_are_within_the_bounds(published, bound):
    rows = [
        row
        for row in published.values()
        if (row["difficulty"] == NO_LANE) == (bound == NO_LANE)
    ]
    wrong = sum(row["frames"] * row["confident_and_wrong_share"] for row in rows)
    assert wrong / sum(row["frames"] for row in rows) <= PROMISED[bound]


def test_the_published_table_has_every_scene_and_frame(published):
    """Otherwise a bound could be met by leaving frames out."""
    rows = {scene: row for (scene, _), row in published.items()}
    assert rows.keys() == SUITE.keys()
    for name, scene in SUITE.items():
        assert rows[name]["difficulty"] == scene.difficulty
        assert rows[name]["frames"] == pytest.approx(25 * scene.seconds, abs=1)
        # all frames of a scene have a lane, or none has, as in its truth
        # (tests/simulator/test_scenes.py)
        assert rows[name]["lane_frames"] == (
            0 if scene.difficulty == NO_LANE else rows[name]["frames"]
        )


def test_the_published_table_is_not_of_the_tuning_set(published):
    (variant,) = {variant for _, variant in published}
    words = (TABLE.parent / "README.md").read_text(encoding="utf-8")
    assert variant not in TUNING_SET
    assert f"--seed {variant} " in words
    # a higher limit would hide wrong frames
    assert CONFIDENT == 0.9
    assert re.search(r"confidence of 0\.9 or more", words)


@pytest.mark.skipif(
    "lavfi" not in av.formats_available,
    reason="this build of PyAV has no test patterns",
)
def test_a_moving_test_pattern_is_no_road():
    """Its stripes may be tracked, but with little confidence."""
    tracker = LaneTracker(Camera.from_fov((640, 360), 60, CameraPose(1.35)), fps=25)
    with av.open("testsrc2=size=640x360:rate=25", format="lavfi") as pattern:
        frames = [
            frame.to_ndarray(format="rgb24")
            for frame in islice(pattern.decode(video=0), 30)
        ]
    lanes = [tracker.update(frame) for frame in frames]
    assert len(lanes) == 30
    assert max(lane.confidence if lane else 0.0 for lane in lanes) < 0.5
