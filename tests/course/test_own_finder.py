"""The table of the reader's own finder beside the systems."""

from __future__ import annotations

from benchmark.scored_drive import COMMITTED
from course.own_finder import finder_table, score_finder


def test_a_finder_without_a_lane_scores_zero_in_its_own_column():
    rows = score_finder(lambda image, camera: None, every=100, name="nothing")
    assert [row["scene"] for row in rows] == list(COMMITTED)
    head, _, *lines = finder_table(rows).splitlines()
    assert head.split("|")[-2].strip() == "nothing"
    assert len(lines) == len(COMMITTED)
    assert all(line.split("|")[-2].strip() == "0.0%, lost" for line in lines)
