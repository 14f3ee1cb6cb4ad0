"""Intervals of shares: against the textbook, and against drawn drives."""

from __future__ import annotations

import numpy as np
import pytest

from benchmark.bootstrap import frame_clusters, mean_interval, ratio_interval, share_interval, wilson_interval


def drawn_drives(rng: np.random.Generator, *, drives: int = 30, frames: int = 50) -> tuple[np.ndarray, np.ndarray]:
    """Flags with a mean of 0.8 in drives that differ: their shares have a Beta(4, 1) distribution."""
    shares = rng.beta(4, 1, drives)
    return rng.uniform(size=(drives, frames)).ravel() < shares.repeat(frames), np.arange(drives).repeat(frames)


def test_95_percent_of_the_intervals_contain_the_true_share():
    rng = np.random.default_rng(5)
    drawn = [drawn_drives(rng) for _ in range(200)]
    by_drive = [share_interval(*some) for some in drawn]
    assert 0.88 <= np.mean([low <= 0.8 <= high for low, high in by_drive]) <= 0.99
    # as if the frames were independent
    by_frame = [wilson_interval(flags.sum(), np.array(len(flags))) for flags, _ in drawn]
    assert np.mean([low <= 0.8 <= high for low, high in by_frame]) < 0.6


def test_independent_frames_get_the_interval_of_wilson():
    flags = np.random.default_rng(1).uniform(size=2000) < 0.7
    wilson = wilson_interval(flags.sum(), np.array(2000))
    assert share_interval(flags, np.arange(2000)) == pytest.approx(wilson, abs=0.002)


def test_drives_without_a_failure_have_an_interval():
    low, high = share_interval(np.ones(100, bool), np.arange(100) // 20)
    assert (low, high) == (pytest.approx(0.963, abs=1e-3), 1)


def test_intervals_are_the_same_in_every_run_and_nan_without_values():
    flags, clusters = drawn_drives(np.random.default_rng(0))
    assert share_interval(flags, clusters) == share_interval(flags, clusters)
    for interval in (share_interval, mean_interval, ratio_interval):
        assert np.isnan(interval(np.zeros(0, bool), np.zeros(0, int))).all()


def test_clusters_are_drives_and_seconds_of_a_single_drive():
    assert frame_clusters([2, 3], [25.0, 25.0]).tolist() == [0, 0, 1, 1, 1]
    assert frame_clusters([5], [2.0]).tolist() == [0, 0, 1, 1, 2]


def test_wilson_interval_is_that_of_the_textbook():
    # Newcombe, Statistics in Medicine 17 (1998), table I: 81 of 263, 15 of 148, 0 of 20, 1 of 29
    low, high = wilson_interval(np.array([81, 15, 0, 1]), np.array([263, 148, 20, 29]))
    assert low == pytest.approx([0.2553, 0.0624, 0.0, 0.0061], abs=5e-5)
    assert high == pytest.approx([0.3662, 0.1605, 0.1611, 0.1718], abs=5e-5)


def test_shares_of_0_and_1_are_inside_their_intervals():
    count = np.arange(1, 300)
    assert (wilson_interval(count, count)[1] == 1).all()
    assert (wilson_interval(0 * count, count)[0] == 0).all()
