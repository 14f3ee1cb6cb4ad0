"""The engine does not lie: what share of the frames of the whole suite it gets wrong while it says that it is sure.

The table is the committed one, made by `python -m benchmark -o docs/benchmark`; test_regression.py holds
fresh frames to the same promise. A promise that is not kept is a failing test: not one to be loosened.
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
# Of the frames without a lane, and of those with one: what share may be surely wrong.
PROMISED = {"where there is no lane": 0.0, "elsewhere": 0.005}


def rows_of_the_engine() -> list[Row]:
    """A row a scene, without the sums."""
    return [row for row in read_scores(TABLE) if row["system"] == TRACKER and not row["scene"].startswith("all ")]


def surely_wrong(rows: Iterable[Row]) -> float:
    """Share of all frames of these rows."""
    frames = [(row["frames"], row["confident_and_wrong_share"]) for row in rows]
    return sum(count * share for count, share in frames) / sum(count for count, _ in frames)


@pytest.mark.parametrize(
    ("where", "chosen"),
    [
        ("where there is no lane", lambda row: row["difficulty"] == NO_LANE),
        ("elsewhere", lambda row: row["difficulty"] != NO_LANE),
    ],
)
def test_the_engine_is_surely_wrong_as_seldom_as_promised(where: str, chosen: Callable[[Row], bool]):
    assert surely_wrong(row for row in rows_of_the_engine() if chosen(row)) <= PROMISED[where]


def test_no_scene_and_no_frame_is_left_out():
    """Else the promise would be kept by looking away."""
    rows = {row["scene"]: row for row in rows_of_the_engine()}
    assert rows.keys() == SUITE.keys()
    for name, scene in SUITE.items():
        assert rows[name]["difficulty"] == scene.difficulty
        assert rows[name]["frames"] == pytest.approx(25 * scene.seconds, abs=1)
        # a lane in all frames or in none, as the scenes' own truth has it (tests/simulator/test_suite.py)
        assert rows[name]["lane_frames"] == (0 if scene.difficulty == NO_LANE else rows[name]["frames"])


def test_sure_is_what_the_benchmark_calls_sure():
    """A higher bar would hide wrong frames; the table's own words state it."""
    assert CONFIDENT == 0.9
    words = (TABLE.parent / "README.md").read_text(encoding="utf-8")
    assert re.search(r"confidence of 0\.9 or more", words)
