"""The benchmark's tables and figures: for the terminal, in Markdown, and read from a
file.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmark.consistency import AvailableLanes, describe_confidence
from benchmark.scores import Result
from benchmark.tables import describe_interval, describe_scores, results_table
from tests.benchmark.test_bootstrap import result


def row(scene: str, system: str, **numbers: float) -> dict:
    names = ("lateral_5m", "lateral_15m", "lateral_30m", "lateral_5_20m", "offset")
    base = {f"{name}_{part}_m": 0.123 for name in names for part in ("median", "p95")}
    base |= {f"heading_{part}_rad": 0.001 for part in ("median", "p95")}
    base |= {f"curvature_{part}_per_m": 0.0001 for part in ("median", "p95")}
    base |= {
        "recovery_median_frames": 0.0,
        "recovery_longest_frames": 12.0,
        "time_median_ms": 9.0,
        "frames": 100.0,
    }
    base |= {"available_share": 1.0, "accuracy": 0.5, "confident_and_wrong_share": 0.25}
    about = {
        "scene": scene,
        "difficulty": "hard",
        "system": system,
        "pose": "true",
        "workers": 1.0,
    }
    return about | base | numbers


class TestTables:
    def test_nan_is_a_dash(self):
        nothing = dict.fromkeys(
            ("lateral_5m_median_m", "lateral_5m_p95_m", "available_share"), np.nan
        )
        heads, units, scene, line = describe_scores(
            [row("fog", "tracker", **nothing)]
        ).splitlines()
        assert scene == "fog (hard, 100 frames)"
        large = {
            f"lateral_{x}m_{part}_m": x * k
            for x in (5, 15, 30)
            for part, k in (("median", 0.3), ("p95", 0.33))
        }
        assert " 150/165 450/495  900/990   12/12 " in describe_scores(
            [row("hairpin", "tracker", **large)]
        )
        assert (
            " ".join(line.split())
            == "tracker - 50.0 25.0 - 12/12 12/12 12/12 12/12 0.1/0.1 0.1/0.1 0/12 9.0"
        )

    def test_what_is_not_significantly_worse_is_marked_and_intervals_are_rounded_outwards(
        self,
    ):
        """In Markdown, too: tests/end_to_end/test_docs.py compares the tables of the
        README.
        """
        numbers = {"accuracy_low": 0.4321, "accuracy_high": 0.9}
        rows = [
            row("bridge", name, among_best=best, **numbers)
            for name, best in (("a", 1.0), ("b", 0.0))
        ]
        marked = [
            line.split()[2]
            for line in describe_scores(rows).splitlines()
            if line.startswith("  ")
        ][2:]
        assert marked == ["50.0*", "50.0"]
        cells = [
            describe_interval(*interval)
            for interval in ((0.931, 0.989), (0.93, 1.0), (0.0, 0.0004))
        ]
        assert cells == ["(93-99)", "(93-100)", "(0-1)"]

    def test_other_files_are_refused(self, tmp_path):
        with pytest.raises(
            FileNotFoundError, match=r"none.csv: there is no such table"
        ):
            results_table(tmp_path / "none.csv")
        (tmp_path / "other.csv").write_text("frame,time_s\n0,0\n")
        with pytest.raises(
            ValueError, match=r"other.csv: is not a table of the benchmark"
        ):
            results_table(tmp_path / "other.csv")


def some_lanes(confidence: list[float], correct: list[bool]) -> AvailableLanes:
    """Lanes of which each is of another drive."""
    return AvailableLanes(*map(np.array, (confidence, correct, range(len(correct)))))


def test_bins_hold_mean_confidence_and_accuracy():
    rates = some_lanes(
        [0.05, 0.41, 0.49, 0.93, 0.97, 1.0], [False, True, False, True, True, False]
    ).reliability()
    confidence, accuracy, low, high, lanes = np.array(rates).T
    assert confidence == pytest.approx([0.05, 0.45, 0.93, 0.985])
    assert accuracy == pytest.approx([0, 0.5, 1, 0.5])
    assert lanes.tolist() == [1, 2, 1, 2]
    assert ((low <= accuracy) & (accuracy <= high)).all()


def test_summary_of_the_confidence_counted_by_hand():
    cells = some_lanes(
        [0.95, 0.9, 0.97, 0.8, 0.6, 0.3], [True, True, False, True, False, True]
    ).summary_cells()
    assert [cell.split()[0] for cell in cells] == [
        "3",
        "66.7%",
        "50.0%",
        "2",
        "70.0%",
        "50.0%",
    ]
    nothing = some_lanes([0.95], [True]).summary_cells()
    assert nothing == ["1", "100.0% (20-100)", "100.0% (20-100)", "0", "-", "-"]


def test_only_available_lanes_count_and_correct_is_up_to_30_m():
    errors = replace(
        result(np.ones(4, bool)).errors,
        exists=np.array([True, True, True, False]),
        available=np.array([True, True, False, True]),
        full_rms_m=np.array([0.1, 0.3, np.nan, np.nan]),
        confidence=np.array([0.7, np.nan, np.nan, 0.2]),
    )
    lanes = AvailableLanes.from_results(
        [Result(name, "hard", "tracker", errors) for name in ("one", "two")]
    )
    assert lanes.confidence.tolist() == [0.7, 1, 0.2] * 2
    assert lanes.correct.tolist() == [True, False, False] * 2
    assert lanes.clusters.tolist() == [0] * 3 + [1] * 3
    unstated = replace(errors, confidence=np.full(4, np.nan))
    table = describe_confidence(
        [Result("one", "hard", "a", errors), Result("one", "hard", "b", unstated)]
    )
    assert "hard, a" in table
    assert "hard, b" not in table
