"""Share of the frames of the whole suite in which the tracker is confident and wrong.

The table is the committed one, made by `python -m benchmark -o docs/benchmark`; test_regression.py checks the
same limit on new frames. A limit that is exceeded is a defect of the tracker; do not loosen it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable

import pytest

from benchmark.dataset import PROJECT_ROOT
from benchmark.errors import CONFIDENT
from benchmark.reporting.tables import read_scores
from benchmark.scores import Row
from benchmark.systems import TRACKER
from simulator.scenes.suite import SUITE

TABLE = PROJECT_ROOT / "docs" / "benchmark" / "benchmark.csv"
NO_LANE = "no lane"
# Largest share of confident and wrong frames, of those without a lane and of those with one.
PROMISED = {"where there is no lane": 0.0, "elsewhere": 0.005}


def tracker_rows() -> list[Row]:
    """One row per scene, without the totals."""
    return [row for row in read_scores(TABLE) if row["system"] == TRACKER and not row["scene"].startswith("all ")]


def confident_and_wrong(rows: Iterable[Row]) -> float:
    """Share of confident and wrong frames, over all frames of these rows."""
    frames = [(row["frames"], row["confident_and_wrong_share"]) for row in rows]
    return sum(count * share for count, share in frames) / sum(count for count, _ in frames)


@pytest.mark.parametrize(
    ("where", "chosen"),
    [
        ("where there is no lane", lambda row: row["difficulty"] == NO_LANE),
        ("elsewhere", lambda row: row["difficulty"] != NO_LANE),
    ],
)
def test_the_tracker_is_confident_and_wrong_as_rarely_as_promised(where: str, chosen: Callable[[Row], bool]):
    assert confident_and_wrong(row for row in tracker_rows() if chosen(row)) <= PROMISED[where]


def test_no_scene_and_no_frame_is_left_out():
    """Missing rows or frames could hide wrong ones."""
    rows = {row["scene"]: row for row in tracker_rows()}
    assert rows.keys() == SUITE.keys()
    for name, scene in SUITE.items():
        assert rows[name]["difficulty"] == scene.difficulty
        assert rows[name]["frames"] == pytest.approx(25 * scene.seconds, abs=1)
        # a lane in all frames or in none, as the scenes' own truth has it (tests/simulator/test_suite.py)
        assert rows[name]["lane_frames"] == (0 if scene.difficulty == NO_LANE else rows[name]["frames"])


def test_confident_means_the_same_in_the_table_and_in_its_text():
    """A higher threshold would hide wrong frames."""
    assert CONFIDENT == 0.9
    words = (TABLE.parent / "README.md").read_text(encoding="utf-8")
    assert re.search(r"confidence of 0\.9 or more", words)
