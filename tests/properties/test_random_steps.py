"""The filter's covariance over many random steps: measurements, gaps, changes of speed, lane changes, restarts."""

from __future__ import annotations

from random import Random

import numpy as np

from lanes.detect.fit import FIT
from lanes.detect.road import PARAMETERS, SIDES, lateral_gradients
from lanes.tracking.filter import (
    FILTER,
    State,
    initial_state,
    predict,
    to_adjacent_lane,
    update,
    with_given_speed,
)
from lanes.tracking.tracker import TrackerSettings
from tests.support.examples import TIMES

PRIOR = FIT.prior
# Derivatives of the lateral positions of both lines, 4 to 68 m ahead, with respect to the lane parameters.
ROWS = lateral_gradients(np.arange(4.0, 70, 4)).reshape(-1, PARAMETERS)
# Seconds between frames: a repeated frame, usual frame rates, dropped frames, the longest gap without a restart.
CLOCK = (0.0, 1 / 60, 0.04, 0.04, 0.1, 0.5, TrackerSettings.max_coast_s)
# Speeds; standard deviations of the measured positions; factors on the prior standard deviation of a new lane.
SPEEDS_MPS = (None, 0.0, 8.0, 25.0, FILTER.max_speed_mps)
POSITION_STD_M, PRIOR_FACTORS = (0.01, 0.1, 1.0), (0.1, 1.0, 3.0)


class Drive:
    """Random steps. Single numbers come from Python's generator, because numpy's takes ten times as long."""

    def __init__(self, seed: int) -> None:
        self.dice, self.rng = Random(seed), np.random.default_rng(seed)

    def begin(self) -> State:
        """State estimate after a first frame, of any road at any speed."""
        spread = PRIOR.std * self.rng.uniform(0.01, 1, PARAMETERS)
        lane = PRIOR.mean + PRIOR.std * self.dice.choice(PRIOR_FACTORS) * self.rng.normal(size=PARAMETERS)
        return initial_state(np.clip(lane, -PRIOR.limit, PRIOR.limit), np.diag(spread**2), self.dice.choice(SPEEDS_MPS))

    def move(self, estimate: State) -> State:
        """State estimate at the next frame, perhaps at another speed or in the next lane."""
        kind = self.dice.random()
        if kind < 0.002:
            return self.begin()
        if kind < 0.005:
            estimate = to_adjacent_lane(estimate, self.dice.choice(SIDES), PRIOR)
        estimate = predict(estimate, self.dice.choice(CLOCK))
        if kind < 0.5:
            estimate = with_given_speed(estimate, self.dice.uniform(0, FILTER.max_speed_mps))
        return estimate

    def measure(self, estimate: State) -> State:
        """Update with 0 to 29 measured positions of any precision."""
        rows = ROWS[self.rng.integers(0, len(ROWS), self.dice.randrange(30))] / self.dice.choice(POSITION_STD_M)
        covariance = np.linalg.inv(np.linalg.inv(estimate.lane_covariance) + rows.T @ rows)
        return update(estimate, estimate.lane + covariance @ (rows.T @ self.rng.normal(size=len(rows))), covariance)


def test_the_covariance_stays_positive_definite():
    drive = Drive(seed=1)
    estimate = drive.begin()
    for _ in range(3 * TIMES):
        seen = []
        for _ in range(1000):
            moved = drive.move(estimate)
            estimate = drive.measure(moved)
            seen += moved.covariance, estimate.covariance
            assert np.isfinite(estimate.mean).all()
        covariances = np.array(seen)
        std = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
        assert std.min() > 0
        correlations = covariances / (std[:, :, None] * std[:, None, :])
        np.testing.assert_allclose(correlations, np.swapaxes(correlations, 1, 2), atol=1e-9)
        # only a positive definite matrix has a Cholesky root
        np.linalg.cholesky(correlations)
