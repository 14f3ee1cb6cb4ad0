"""The drive on which exercise 12.2 tries a correct step: some of its measurements are of the neighbouring lane."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from course.exercises.drawings import FilteredDrive

Correct = Callable[..., tuple[np.ndarray, np.ndarray]]
# Measurements, seconds between two of them, speed, and how many are of the neighbouring lane, and how far that is.
COUNT, STEP_S, SPEED_MPS = 100, 0.1, 27.0
WRONG_COUNT, LANE_M = 10, 3.7
# As in chapter 12, states are (offset, heading, curvature). Measurements are (left + right, heading): H is not square.
F = np.array([[1, -SPEED_MPS * STEP_S, 0], [0, 1, 0], [0, 0, 1]])
H = np.diag([-2.0, 1, 1])[:2]
Q = np.diag([0.03, 0.02, 0.005]) ** 2 * STEP_S
FIRST_P = np.diag([1, 0.05, 0.005]) ** 2
NOISE_STD = np.array([0.15, 0.006])


def filter_drive(correct_state: Correct) -> FilteredDrive | None:
    """The drive filtered with a correct step; None if it raises an error or returns other shapes."""
    true_m, measurements = simulate_drive()
    state, covariance = np.zeros(3), FIRST_P
    accepted, offset_m, std_m = [], [], []
    for z in measurements:
        state, covariance = F @ state, F @ covariance @ F.T + Q
        try:
            with np.errstate(all="ignore"):
                found = correct_state(state.copy(), covariance.copy(), z.copy(), np.diag(NOISE_STD**2), H.copy())
            new_state, covariance = (np.asarray(part, float) for part in found)
        except Exception:  # the code of the reader may raise anything
            return None
        if new_state.shape != (3,) or covariance.shape != (3, 3):
            return None
        accepted.append(not np.array_equal(new_state, state))
        state = new_state
        offset_m.append(state[0])
        std_m.append(np.sqrt(max(covariance[0, 0], 0)))
    series = true_m, -measurements[:, 0] / 2, np.array(accepted), np.array(offset_m), np.array(std_m)
    return FilteredDrive(np.arange(COUNT) * STEP_S, *series)


def simulate_drive() -> tuple[np.ndarray, np.ndarray]:
    """True offsets (N,), metres, and measurements (N, 2)."""
    rng = np.random.default_rng(12)
    heading = 0.01 * np.sin(np.arange(COUNT) * STEP_S)
    states = np.column_stack([0.3 - SPEED_MPS * STEP_S * np.cumsum(heading), heading, np.zeros(COUNT)])
    measurements = states @ H.T + rng.normal(0, NOISE_STD, (COUNT, 2))
    # not the first ones, with which the filter finds the lane
    wrong = rng.choice(np.arange(5, COUNT), WRONG_COUNT, replace=False)
    measurements[wrong, 0] += 2 * LANE_M * rng.choice([-1, 1], WRONG_COUNT)
    return states[:, 0], measurements
