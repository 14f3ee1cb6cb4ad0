"""Vanishing points from exact pieces of straight and curved lines."""

from __future__ import annotations

import numpy as np
import pytest

from lanes.vanishing_point import X0_BINS, Y0_BINS, Segments, fit_parallel_lines, hough_votes

X0, Y0 = 0.031, -0.042


def pieces(k, bend, noise=0.0, seed=0):
    rng = np.random.default_rng(seed)
    t = np.geomspace(0.06, 0.4, 8)
    k = np.repeat(k, len(t))
    t = np.tile(t, len(k) // len(t))
    bend = bend * (1 + 2 * bend * k)
    x = X0 + k * t + bend / t + rng.normal(0, noise, len(t))
    ones = np.ones_like(t)
    return Segments(x, Y0 + t, k - bend / t**2, 3e-4 * ones, 0.01 * ones, 20 * ones)


def road(bend, noise=0.0):
    return pieces(np.array([-4.0, -1.3, 1.4]), bend, noise)


@pytest.mark.parametrize("bend", [0.0, 0.003, -0.01])
def test_votes_and_fit_find_horizon_and_direction(bend):
    votes = hough_votes(road(bend))
    at = np.unravel_index(votes.argmax(), votes.shape)
    assert Y0_BINS[at[0]] == pytest.approx(Y0, abs=0.011)
    lines = fit_parallel_lines(road(bend), Y0_BINS[at[0]], 0.016)
    assert lines.y0 == pytest.approx(Y0, abs=3e-4)
    assert lines.x0 == pytest.approx(X0, abs=1e-3)
    assert lines.half_curvature == pytest.approx(bend, abs=2e-4)
    np.testing.assert_allclose(lines.lateral, [-4.0, -1.3, 1.4], atol=0.02)


def test_strangers_are_left_out():
    rng = np.random.default_rng(4)
    clean, n = road(0.002, noise=3e-4), 12
    junk = rng.uniform([-0.5, 0.0, -6], [0.5, 0.4, 6], (n, 3)).T
    both = [
        np.concatenate([a, b])
        for a, b in zip(
            (clean.x, clean.y, clean.slope, clean.x_std, clean.slope_std, clean.rows),
            (*junk, np.full(n, 3e-4), np.full(n, 0.01), np.full(n, 20.0)),
            strict=True,
        )
    ]
    lines = fit_parallel_lines(Segments(*both), Y0 + 0.006, 0.016)
    assert lines.y0 == pytest.approx(Y0, abs=1.5e-3)
    assert abs(lines.y0 - Y0) < 4 * lines.y0_std + 5e-4


def test_fewer_than_two_lines_are_none():
    assert fit_parallel_lines(pieces(np.array([1.4]), 0.0), Y0, 0.016) is None
    assert fit_parallel_lines(Segments(*np.empty((6, 0))), Y0, 0.016) is None


def test_no_votes_outside_the_grid():
    outside = road(0.0)
    outside = Segments(outside.x + 2, outside.y, outside.slope, outside.x_std, outside.slope_std, outside.rows)
    assert hough_votes(outside)[:, 10].sum() == 0
    assert len(X0_BINS) == hough_votes(outside).shape[2]
