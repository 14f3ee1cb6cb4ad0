"""Which systems are among the best: drawn drives, with a known difference."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmark.bootstrap import accuracy_interval, among_best
from benchmark.errors import FrameErrors
from benchmark.scores import Result, score_rows, total_rows

FRAMES = 100


def result(correct: np.ndarray, *, scene: str = "a", system: str = "s", exists: bool = True) -> Result:
    """A drive with these correct frames; all other lanes are confident and wrong."""
    nothing = np.zeros(len(correct))
    errors = FrameErrors(
        exists=np.full(len(correct), exists),
        available=np.ones(len(correct), bool),
        confident=~correct if not exists else np.ones(len(correct), bool),
        lateral_m=np.zeros((len(correct), 5)),
        near_rms_m=np.where(correct, 0.1, 1.0),
        full_rms_m=nothing,
        in_picture_rms_m=nothing,
        offset_m=nothing,
        heading_rad=nothing,
        curvature_per_m=nothing,
        confidence=nothing,
        time_ms=nothing,
    )
    return Result(scene, "hard", system, errors)


def drives(shares: list[float], **names: str) -> list[Result]:
    """A drive for each share of correct frames, the first ones of the drive."""
    return [
        result(np.arange(FRAMES) < share * FRAMES, scene=f"scene {number}", **names)
        for number, share in enumerate(shares)
    ]


BEST = [1.0, 0.9, 0.95, 1.0, 0.9, 0.95, 1.0, 0.9]


def test_worse_in_every_drive_is_significant():
    worse = [share - 0.05 for share in BEST]
    assert among_best([drives(worse), drives(BEST)]) == [False, True]


def test_worse_in_one_of_eight_drives_is_not():
    one_failure = [0.2, *BEST[1:]]
    assert among_best([drives(BEST), drives(one_failure)]) == [True, True]
    # although its frames, if they were independent, would decide it
    failed, frames = 80, 800
    assert failed / frames > 5 * np.sqrt(0.1 * 0.9 / frames)


def test_the_same_drives_are_compared():
    """Drives differ more than systems: unpaired intervals overlap, the difference is decided."""
    shares = np.linspace(0.1, 0.9, 9)
    first, second = drives(list(shares)), drives(list(shares - 0.05))
    assert accuracy_interval(first)[0] < accuracy_interval(second)[1]
    assert among_best([first, second]) == [True, False]


def test_equal_systems_are_both_best():
    assert among_best([drives(BEST), drives(BEST), drives([0.0] * 8)]) == [True, True, False]


def test_a_single_drive_is_divided_into_seconds():
    # 0.2 s of failures in one of ten seconds are not significant, 0.2 s in each are
    once, always = np.ones(250, bool), np.ones(250, bool)
    once[:5], always[np.arange(250) % 25 < 5] = False, False
    systems = [[result(np.ones(250, bool))], [result(once)], [result(always)]]
    assert among_best(systems) == [True, True, False]
    low, high = accuracy_interval(systems[1])
    assert low < 245 / 250 < high


def test_without_a_lane_the_fewest_confident_and_wrong_frames_are_best():
    quiet, false = (result(np.full(100, quiet), exists=False) for quiet in (True, False))
    assert among_best([[false], [quiet]]) == [False, True]
    assert np.isnan(accuracy_interval([false])).all()


def test_rows_have_the_interval_and_the_mark():
    results = [
        one for pair in zip(drives(BEST, system="good"), drives([0.0] * 8, system="bad"), strict=True) for one in pair
    ]
    good, bad = total_rows(results)
    assert (good["among_best"], bad["among_best"]) == (1, 0)
    assert good["accuracy"] == pytest.approx(0.95)
    assert good["accuracy_low"] < 0.95 < good["accuracy_high"]
    assert [row["among_best"] for row in score_rows(results)] == [1, 0] * 8
    alone = score_rows([replace(results[0], scene="alone")])
    assert np.isnan(alone[0]["among_best"])
