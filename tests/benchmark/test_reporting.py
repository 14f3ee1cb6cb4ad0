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

NUMBERS = {
    "frames": 100.0,
    "workers": 1.0,
    "available_share": 1.0,
    "accuracy": 0.5,
    "confident_and_wrong_share": 0.25,
    "lateral_5m_median_m": 0.12,
    "lateral_5m_p95_m": 0.345,
    "lateral_15m_median_m": 0.123,
    "lateral_15m_p95_m": 0.5,
    "lateral_30m_median_m": 4.5,
    "lateral_30m_p95_m": 9.9,
    "lateral_5_20m_median_m": 0.05,
    "lateral_5_20m_p95_m": 0.25,
    "offset_median_m": 0.01,
    "offset_p95_m": 0.02,
    "heading_median_rad": 0.001,
    "heading_p95_rad": 0.02,
    "curvature_median_per_m": 0.0001,
    "curvature_p95_per_m": 0.002,
    "recovery_median_frames": 3.0,
    "recovery_longest_frames": 12.0,
    "time_median_ms": 9.04,
}


def row(scene: str = "fog", system: str = "tracker", **numbers: float) -> dict:
    about = {"scene": scene, "difficulty": "hard", "system": system, "pose": "true"}
    return about | NUMBERS | numbers


def cells(**numbers: float) -> list[str]:
    """The cells of the only line of a table, without the name of the system."""
    *_, line = describe_scores([row(**numbers)]).splitlines()
    return line.split()[1:]


def test_a_line_has_the_numbers_in_the_units_of_its_headings():
    _, units, scene, _ = describe_scores([row()]).splitlines()
    assert scene == "fog (hard, 100 frames)"
    assert dict(zip(cells(), units.split(), strict=True)) == {
        "100.0": "%",
        "50.0": "%",
        "25.0": "%",
        "12/34": "cm",
        "12/50": "cm",
        "450/990": "cm",
        "5.0/25": "cm",
        "1.0/2.0": "cm",
        "0.1/1.1": "deg",
        "0.1/2.0": "1/km",
        "3/12": "frames",
        "9.0": "ms",
    }


@pytest.mark.parametrize(
    ("place", "column"),
    [(0, "available_share"), (3, "lateral_5m_median_m"), (5, "lateral_30m_median_m")],
)
def test_nan_is_a_dash(place, column):
    assert cells(**{column: np.nan})[place] == "-"


def test_what_is_not_significantly_worse_is_marked():
    rows = [row(system="a", among_best=1.0), row(system="b", among_best=0.0)]
    *_, best, other = describe_scores(rows).splitlines()
    assert best.split()[2] == "50.0*"
    assert other.split()[2] == "50.0"


@pytest.mark.parametrize(
    ("low", "high", "words"),
    [(0.931, 0.989, "(93-99)"), (0.93, 1.0, "(93-100)"), (0.0, 0.0004, "(0-1)")],
)
def test_intervals_are_rounded_outwards(low, high, words):
    assert describe_interval(low, high) == words


def test_a_missing_table_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"none.csv: there is no such table"):
        results_table(tmp_path / "none.csv")


def test_another_file_is_refused(tmp_path):
    (tmp_path / "other.csv").write_text("frame,time_s\n0,0\n")
    with pytest.raises(ValueError, match=r"other.csv: is not a table of the benchmark"):
        results_table(tmp_path / "other.csv")


def test_the_markdown_table_has_a_cell_for_each_scene_and_system(tmp_path):
    """A total has the interval, a scene without a lane the share of false ones."""
    (tmp_path / "benchmark.csv").write_text(
        "scene,difficulty,system,accuracy,accuracy_low,accuracy_high,among_best,"
        "lateral_5_20m_p95_m,confident_and_wrong_share\n"
        "fog,hard,a,0.5,0.4,0.6,1,0.123,0.1\n"
        "fog,hard,b,0.25,0.2,0.3,0,,0.2\n"
        "mat,no lane,a,,,,0,,0.125\n"
        "all hard,hard,b,0.25,0.201,0.3,1,0.5,0.2\n"
    )
    assert results_table(tmp_path / "benchmark.csv").splitlines() == [
        "| scene | difficulty | a | b |",
        "|---|---|---|---|",
        "| fog | hard | **50.0%, 0.12 m** | 25.0%, lost |",
        "| mat | no lane | 12.5% false |  |",
        "| all hard | hard |  | **25.0% (20-30), 0.50 m** |",
    ]


def some_lanes(confidence: list[float], correct: list[bool]) -> AvailableLanes:
    """Lanes of which each is of another drive."""
    clusters = np.arange(len(correct))
    return AvailableLanes(np.array(confidence), np.array(correct), clusters)


class TestReliability:
    @pytest.fixture
    def bins(self) -> np.ndarray:
        """Four bins: mean confidence, accuracy, its interval, number of lanes."""
        lanes = some_lanes(
            [0.05, 0.41, 0.49, 0.93, 0.97, 1.0],
            [False, True, False, True, True, False],
        )
        return np.array(lanes.reliability()).T

    def test_bins_hold_the_mean_confidence(self, bins):
        assert bins[0] == pytest.approx([0.05, 0.45, 0.93, 0.985])

    def test_bins_hold_the_accuracy(self, bins):
        assert bins[1] == pytest.approx([0, 0.5, 1, 0.5])

    def test_bins_hold_the_number_of_lanes(self, bins):
        assert bins[4].tolist() == [1, 2, 1, 2]

    def test_the_interval_contains_the_accuracy(self, bins):
        _, accuracy, low, high, _ = bins
        assert (low <= accuracy).all()
        assert (accuracy <= high).all()


def test_the_summary_of_the_confidence_is_as_counted_by_hand():
    lanes = some_lanes(
        [0.95, 0.9, 0.97, 0.8, 0.6, 0.3], [True, True, False, True, False, True]
    )
    numbers = [cell.split()[0] for cell in lanes.summary_cells()]
    assert numbers == ["3", "66.7%", "50.0%", "2", "70.0%", "50.0%"]


def test_without_likely_lanes_their_cells_are_dashes():
    cells = some_lanes([0.95], [True]).summary_cells()
    assert cells == ["1", "100.0% (20-100)", "100.0% (20-100)", "0", "-", "-"]


def a_result(scene: str = "one", system: str = "a") -> Result:
    """Lanes: correct, wrong, not available, and where none exists."""
    errors = replace(
        result(np.ones(4, bool)).errors,
        exists=np.array([True, True, True, False]),
        available=np.array([True, True, False, True]),
        full_rms_m=np.array([0.1, 0.3, np.nan, np.nan]),
        confidence=np.array([0.7, np.nan, np.nan, 0.2]),
    )
    return Result(scene, "hard", system, errors)


class TestAvailableLanes:
    @pytest.fixture
    def lanes(self) -> AvailableLanes:
        return AvailableLanes.from_results([a_result("one"), a_result("two")])

    def test_a_lane_without_a_confidence_has_1(self, lanes):
        assert lanes.confidence.tolist() == [0.7, 1, 0.2] * 2

    def test_a_lane_is_correct_up_to_30_m(self, lanes):
        assert lanes.correct.tolist() == [True, False, False] * 2

    def test_each_drive_is_a_cluster(self, lanes):
        assert lanes.clusters.tolist() == [0] * 3 + [1] * 3


def test_only_systems_that_state_a_confidence_are_described():
    stated = a_result(system="a")
    nothing = replace(stated.errors, confidence=np.full(4, np.nan))
    unstated = Result("one", "hard", "b", nothing)
    table = describe_confidence([stated, unstated])
    assert "hard, a" in table
    assert "hard, b" not in table
