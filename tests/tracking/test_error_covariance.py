"""The covariance of the errors, against drawn errors."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from lanes.detect.error_covariance import ERRORS, ResidualStatistics, road_std, split_gain

from lanes.detect.road import CENTRE, CURVATURE, HEADING, PARAMETERS, RATE, RATE_STEPS
from lanes.track.filter import LANE, STATES, initial_state, predict, update_state
from tests.support.shapes import a_lane

STD = a_lane(
    centre=0.1,
    width=0.1,
    heading=0.01,
    curvature=1e-3,
    rate=1e-5,
    pitch=5e-3,
    vertical=1e-4,
    rate_steps=1e-5,
    adjacent=0.1,
)
LANE_BEFORE = a_lane(centre=0.3, width=3.6, heading=0.02, curvature=2e-3)


def measure(covariance: np.ndarray, variance: float) -> tuple[np.ndarray, np.ndarray]:
    """Updated covariance and gain for a measurement of the lateral position 10 m ahead with this variance."""
    row = np.zeros(len(covariance))
    row[[CENTRE, HEADING]] = 1, 10
    gain = covariance @ row / (row @ covariance @ row + variance)
    kept = np.eye(len(covariance)) - np.outer(gain, row)
    return kept @ covariance, gain


def test_errors_of_a_filter_whose_assumed_noise_is_too_large():
    """Errors drawn with a quarter of the assumed variances before, and a ninth in the measurement."""
    state = predict(initial_state(LANE_BEFORE, np.diag(STD**2), 20.0), 0.1)
    state = replace(state, errors=state.covariance / 4)
    covariance, gain = measure(state.covariance, 0.09)
    updated = update_state(state, state.lane, covariance[LANE, LANE], noise_factor=1 / 9)
    rng = np.random.default_rng(1)
    errors = rng.multivariate_normal(np.zeros(STATES), state.errors, 40_000)
    innovation = rng.normal(0, 0.1, len(errors)) - errors[:, CENTRE] - 10 * errors[:, HEADING]
    drawn = np.cov((errors + innovation[:, None] * gain).T)
    std = np.sqrt(np.diag(drawn))
    np.testing.assert_allclose(np.sqrt(np.diag(updated.errors)), std, rtol=0.02)
    np.testing.assert_allclose(updated.errors / np.outer(std, std), drawn / np.outer(std, std), atol=0.03)
    # what the filter itself believes is far too large
    assert updated.covariance[CENTRE, CENTRE] > 2 * drawn[CENTRE, CENTRE]


def test_with_the_assumed_noise_the_errors_are_those_that_the_filter_assumes():
    state = predict(initial_state(LANE_BEFORE, np.diag(STD**2), 20.0), 0.1)
    state = replace(state, errors=state.covariance.copy())
    covariance, _ = measure(state.covariance, 0.01)
    updated = update_state(state, state.lane, covariance[LANE, LANE])
    np.testing.assert_allclose(updated.errors, updated.covariance, rtol=1e-6, atol=1e-10)


def test_the_gain_splits_into_what_is_kept_and_what_is_measured():
    before = np.diag(STD**2)
    after, gain = measure(before, 0.04)
    kept, measured = split_gain(after, np.linalg.inv(before))
    np.testing.assert_allclose(kept @ before @ kept.T + measured, after, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(measured, 0.04 * np.outer(gain, gain), rtol=1e-5, atol=1e-12)


def test_errors_grow_while_nothing_is_measured_and_more_in_a_bend():
    straight, bend = (initial_state(a_lane(width=3.6, curvature=k), np.diag(STD**2), 15.0) for k in (0.0, 0.04))
    for state in (straight, bend):
        later = predict(state, 0.5)
        assert (np.diag(later.errors)[[CENTRE, HEADING]] > np.diag(state.errors)[[CENTRE, HEADING]]).all()
    grown = [predict(state, 0.5).errors[RATE, RATE] for state in (straight, bend)]
    assert grown[1] > 100 * grown[0]


def fitted(residuals: np.ndarray) -> SimpleNamespace:
    """A fit with a line that has a stripe in each row, and one without any."""
    count = len(residuals)
    members = np.zeros((1, 2, count), bool)
    members[0, 0] = True
    return SimpleNamespace(
        weight=np.ones((1, count)),
        explained=np.array([float(count)]),
        normalized=residuals[None],
        members=members,
        stripes=SimpleNamespace(row=np.arange(count)),
    )


def autoregressive(correlation: float, count: int, seed: int = 5) -> np.ndarray:
    """Residuals of variance 1 whose neighbours have this correlation."""
    rng = np.random.default_rng(seed)
    values = [rng.normal()]
    for _ in range(count - 1):
        values.append(correlation * values[-1] + rng.normal(0, (1 - correlation**2) ** 0.5))
    return np.array(values)


@pytest.mark.parametrize("correlation", [0.0, 0.3, 0.7])
def test_statistics_of_correlated_residuals(correlation):
    found = ResidualStatistics().add(fitted(0.5 * autoregressive(correlation, 20_000)))
    assert found.variance == pytest.approx(0.25, rel=0.05)
    assert found.correlation == pytest.approx(correlation, abs=0.03)


def test_the_effective_variance_is_that_of_the_mean_of_correlated_residuals():
    """The mean of 400 residuals with a correlation of 0.6 varies four times as much as that of independent ones."""
    runs = np.array([autoregressive(0.6, 400, seed) for seed in range(400)])
    found = ResidualStatistics().add(fitted(autoregressive(0.6, 20_000)))
    assert found.effective_variance / ERRORS.shared_factor == pytest.approx(400 * runs.mean(axis=1).var(), rel=0.15)


def test_without_stripes_and_without_residuals():
    assert ResidualStatistics().variance == pytest.approx(ERRORS.usual_variance)
    assert ResidualStatistics().correlation == pytest.approx(ERRORS.usual_correlation)
    assert ResidualStatistics().add(fitted(np.zeros(1000))).variance == ERRORS.min_variance


def test_old_frames_are_forgotten():
    found = ResidualStatistics()
    for scale in [1.0] * 50 + [0.2] * 50:
        found = found.add(fitted(scale * autoregressive(0.0, 100)), elapsed_s=0.04)
    assert found.variance == pytest.approx(0.04, abs=0.03)


def test_roads_that_bend_anywhere_in_view_are_less_certain():
    straight, bend, ahead = road_std(a_lane(width=3.5)), road_std(a_lane(curvature=0.05)), a_lane()
    ahead[RATE_STEPS.start] = 2e-3
    assert bend[RATE] > 10 * straight[RATE] and bend[CURVATURE] > straight[CURVATURE]
    assert road_std(ahead)[RATE] > 10 * straight[RATE]
    assert straight.shape == (PARAMETERS,)
