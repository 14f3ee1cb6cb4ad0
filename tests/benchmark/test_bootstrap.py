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

FRAMES = 100


def drawn_drives(
    rng: np.random.Generator, *, drives: int = 30, frames: int = 50
) -> tuple[np.ndarray, np.ndarray]:
    """Flags with a mean of 0.8 in drives that differ: their shares have a Beta(4, 1)
    distribution.
    """
    shares = rng.beta(4, 1, drives)
    return rng.uniform(size=(drives, frames)).ravel() < shares.repeat(
        frames
    ), np.arange(drives).repeat(frames)


def test_95_percent_of_the_intervals_contain_the_true_share():
    rng = np.random.default_rng(5)
    drawn = [drawn_drives(rng) for _ in range(200)]
    by_drive = [share_interval(*some) for some in drawn]
    assert 0.88 <= np.mean([low <= 0.8 <= high for low, high in by_drive]) <= 0.99
    # as if the frames were independent
    by_frame = [
        wilson_interval(flags.sum(), np.array(len(flags))) for flags, _ in drawn
    ]
    assert np.mean([low <= 0.8 <= high for low, high in by_frame]) < 0.6
    # Newcombe, Statistics in Medicine 17 (1998), table I: 15 of 148, 0 of 20
    low, high = wilson_interval(np.array([15, 0]), np.array([148, 20]))
    assert (*low, *high) == pytest.approx((0.0624, 0.0, 0.1605, 0.1611), abs=5e-5)
    # drives without a failure have an interval, too
    assert share_interval(np.ones(100, bool), np.arange(100) // 20) == (
        pytest.approx(0.963, abs=1e-3),
        1,
    )


def result(
    correct: np.ndarray, *, scene: str = "a", system: str = "s", exists: bool = True
) -> Result:
    """A drive with these correct frames; all other lanes are confident and wrong."""
    nothing = dict.fromkeys(
        (field.name for field in fields(FrameErrors)), np.zeros(len(correct))
    )
    some = np.ones(len(correct), bool)
    errors = {
        "exists": some & exists,
        "available": some,
        "confident": some if exists else ~correct,
        "lateral_m": np.zeros((len(correct), 5)),
        "near_rms_m": np.where(correct, 0.1, 1.0),
    }
    return Result(scene, "hard", system, FrameErrors(**nothing | errors))


def drives(shares: list[float], **names: str) -> list[Result]:
    """A drive for each share of correct frames, the first ones of the drive."""
    frames = np.arange(FRAMES)
    return [
        result(frames < share * FRAMES, scene=f"scene {n}", **names)
        for n, share in enumerate(shares)
    ]


BEST = [1.0, 0.9, 0.95, 1.0, 0.9, 0.95, 1.0, 0.9]


def test_worse_in_every_drive_is_significant_and_in_one_of_eight_is_not():
    """In the latter, 80 of 800 frames would decide it if they were independent."""
    every = [share - 0.05 for share in BEST]
    one = [0.2, *BEST[1:]]
    assert among_best([drives(every), drives(BEST)]) == [False, True]
    assert among_best([drives(BEST), drives(one)]) == [True, True]
    # no lane: false ones count
    quiet, false = (
        result(np.full(100, quiet), exists=False) for quiet in (True, False)
    )
    assert among_best([[false], [quiet]]) == [False, True]
    assert np.isnan(accuracy_interval([false])).all()


def test_a_single_drive_is_divided_into_seconds():
    # 0.2 s of failures in one of ten seconds are not significant, 0.2 s in each are
    once = np.ones(250, bool)
    always = np.ones(250, bool)
    once[:5], always[np.arange(250) % 25 < 5] = False, False
    systems = [[result(np.ones(250, bool))], [result(once)], [result(always)]]
    assert among_best(systems) == [True, True, False]
    low, high = accuracy_interval(systems[1])
    assert low < 245 / 250 < high
