"""Intervals of shares, and which systems are among the best: against the textbook, and
on drawn drives.
"""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from benchmark.errors import FrameErrors
from benchmark.scores import (
    Result,
    accuracy_interval,
    among_best,
    share_interval,
    wilson_interval,
)

TRUE_SHARE = 0.8


@pytest.fixture(scope="module")
def drawn() -> list[tuple[np.ndarray, np.ndarray]]:
    """Flags and clusters of 200 sets of 30 drives that differ.

    The shares of the drives have a Beta(4, 1) distribution with a mean of TRUE_SHARE.
    """
    rng = np.random.default_rng(5)
    sets = []
    for _ in range(200):
        shares = rng.beta(4, 1, 30)
        flags = rng.uniform(size=(30, 50)).ravel() < shares.repeat(50)
        sets.append((flags, np.arange(30).repeat(50)))
    return sets


def share_of_hits(intervals: list[tuple[float, float]]) -> float:
    """The share of the intervals that contain TRUE_SHARE."""
    return float(np.mean([low <= TRUE_SHARE <= high for low, high in intervals]))


def test_95_percent_of_the_intervals_contain_the_true_share(drawn):
    intervals = [share_interval(flags, clusters) for flags, clusters in drawn]
    assert share_of_hits(intervals) == pytest.approx(0.935, abs=0.055)


def test_intervals_of_independent_frames_would_be_too_narrow(drawn):
    intervals = []
    for flags, _ in drawn:
        intervals.append(wilson_interval(flags.sum(), np.array(len(flags))))
    assert share_of_hits(intervals) < 0.6


def test_wilson_intervals_are_those_of_the_literature():
    """Newcombe, Statistics in Medicine 17 (1998), table I: 15 of 148, 0 of 20."""
    low, high = wilson_interval(np.array([15, 0]), np.array([148, 20]))
    assert low == pytest.approx([0.0624, 0.0], abs=5e-5)
    assert high == pytest.approx([0.1605, 0.1611], abs=5e-5)


def test_drives_without_a_failure_have_an_interval():
    low, high = share_interval(np.ones(100, bool), np.arange(100) // 20)
    assert low == pytest.approx(0.963, abs=1e-3)
    assert high == 1


def result(
    correct: np.ndarray, *, scene: str = "a", system: str = "s", exists: bool = True
) -> Result:
    """A drive with these correct frames; all other lanes are confident and wrong."""
    frames = len(correct)
    arrays = {field.name: np.zeros(frames) for field in fields(FrameErrors)}
    arrays["exists"] = np.full(frames, exists)
    arrays["available"] = np.ones(frames, bool)
    arrays["confident"] = arrays["available"] if exists else ~correct
    arrays["lateral_m"] = np.zeros((frames, 5))
    arrays["near_rms_m"] = np.where(correct, 0.1, 1.0)
    return Result(scene, "hard", system, FrameErrors(**arrays))


def drives(shares: list[float], frames: int = 100) -> list[Result]:
    """A drive for each share of correct frames, the first ones of the drive."""
    results = []
    for number, share in enumerate(shares):
        correct = np.arange(frames) < share * frames
        results.append(result(correct, scene=f"scene {number}"))
    return results


BEST = [1.0, 0.9, 0.95, 1.0, 0.9, 0.95, 1.0, 0.9]


def test_worse_in_every_drive_is_significant():
    worse = drives([share - 0.05 for share in BEST])
    assert among_best([worse, drives(BEST)]) == [False, True]


def test_worse_in_one_of_eight_drives_is_not_significant():
    """80 of 800 frames would decide it if they were independent."""
    worse_once = drives([0.2, *BEST[1:]])
    assert among_best([drives(BEST), worse_once]) == [True, True]


def test_where_no_lane_exists_false_lanes_decide():
    quiet = result(np.ones(100, bool), exists=False)
    false = result(np.zeros(100, bool), exists=False)
    assert among_best([[false], [quiet]]) == [False, True]


def test_without_a_true_lane_the_accuracy_has_no_interval():
    assert np.isnan(accuracy_interval([result(np.ones(100, bool), exists=False)])).all()


PERFECT = np.ones(250, bool)
# 0.2 s of failures in one of ten seconds, and in each.
ONCE = np.arange(250) >= 5
ALWAYS = np.arange(250) % 25 >= 5


def test_the_differences_in_a_single_drive_are_those_of_its_seconds():
    systems = [[result(correct)] for correct in (PERFECT, ONCE, ALWAYS)]
    assert among_best(systems) == [True, True, False]


def test_a_single_drive_has_an_interval():
    low, high = accuracy_interval([result(ONCE)])
    assert low < 245 / 250 < high
