"""Exercises of chapter 12, track with a Kalman filter."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from course.exercises.drawings import draw_filtered_drive
from course.exercises.gated_drive import filter_drive
from course.exercises.verdict import NOT_TRIED, Checks, Verdict, correct, hint

Correct = Callable[..., tuple[np.ndarray, np.ndarray]]
# 99 % of the right measurements of three quantities have a smaller squared Mahalanobis distance (chi-squared).
GATE = 11.34
# 12.1: the mean squared distance of three quantities is 3 if all covariances are right.
MEAN_DISTANCE = (2.8, 3.2)
# A state of offset, heading and curvature, and a measurement of the offset and the heading alone.
STATE, P = np.array([0.2, 0.01, 0.001]), np.array([[4e-4, 2e-5, 0], [2e-5, 1e-5, 1e-7], [0, 1e-7, 4e-8]])
H, R = np.eye(3)[:2], np.array([[9e-4, 1e-5], [1e-5, 4e-6]])


def check_gate(correct_state: Correct) -> Verdict:
    """12.2: the correct step with a gate."""
    verdict = _check_step(correct_state)
    if verdict is not NOT_TRIED and (drive := filter_drive(correct_state)):
        draw_filtered_drive(drive)
    return verdict


def _check_step(correct_state: Correct) -> Verdict:
    """A measurement close to the state, then the gate."""
    near = STATE[:2] + [0.03, 0.002]
    try:
        found = _call(correct_state, near)
    except ValueError as error:
        if "shape" not in str(error) and "dimension" not in str(error):
            raise
        return hint(f"the shapes do not match ({error}). H is not square here: S = H P H^T + R, K = P H^T S^-1.")
    if found is None:
        return NOT_TRIED
    if not _is_step(found):
        return hint("return two values: the state (3,) and its covariance P (3, 3).")
    state, covariance = found
    expected, expected_p = _correct(near)
    if np.allclose(state, STATE, atol=1e-9):
        return hint(f"a measurement that is {_distance(near):.1f} away (squared) is rejected; it fits.")
    if not np.allclose(state, expected, atol=1e-6):
        return hint(f"the offset becomes {state[0]:.4f} instead of {expected[0]:.4f}: state + K (z - H state).")
    if np.allclose(covariance, P, atol=1e-12):
        return hint("the state is right, but P is not updated: a measurement makes it smaller, P - K H P.")
    if not np.allclose(covariance, expected_p, rtol=1e-3, atol=1e-12):
        return hint("the state is right, but P is not P - K H P.")
    return _check_distances(correct_state)


def _check_distances(correct_state: Correct) -> Verdict:
    """Measurements, some of them outside the gate, with the distance that a wrong gate computes."""
    step = np.array([0.6, 0.8]) * np.sqrt(np.diag(H @ P @ H.T + R))
    for squared in (6.0, 10.5, 12.5, 30.0, 200.0):
        z = STATE[:2] + step * np.sqrt(squared / _distance(STATE[:2] + step))
        found = _call(correct_state, z)
        if found is None:
            return hint(f"None is returned at d^2 = {squared:.1f}. Return the state and P, both unchanged if rejected.")
        if not _is_step(found):
            return hint(f"at d^2 = {squared:.1f} return two values, too: the state (3,) and its covariance P (3, 3).")
        accepted = not np.allclose(found[0], STATE, atol=1e-9)
        if accepted and squared > GATE:
            return hint(
                f"a measurement with d^2 = {squared:.1f} is accepted. Above 11.3 return state and P unchanged. "
                "Compare d^2 = nu^T S^-1 nu, not its root."
            )
        if not accepted and squared < GATE:
            return hint(
                f"a measurement with d^2 = {squared:.1f} is rejected. Use the inverse of "
                "S = H P H^T + R, not R alone, and not the diagonal of S."
            )
    if not np.allclose(_call(correct_state, z)[1], P, atol=1e-12):
        return hint("a rejected measurement must leave P as it is, too.")
    return correct("the filter takes what fits and skips the neighbouring lane.")


def _is_step(found: object) -> bool:
    """Whether a state (3,) and a covariance (3, 3) were returned."""
    return isinstance(found, (tuple, list)) and [np.shape(part) for part in found] == [(3,), (3, 3)]


def _call(correct_state: Correct, z: np.ndarray) -> Any:
    return correct_state(STATE.copy(), P.copy(), z.copy(), R.copy(), H.copy())


def _correct(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    gain = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    return STATE + gain @ (z - H @ STATE), P - gain @ H @ P


def _distance(z: np.ndarray) -> float:
    """Squared Mahalanobis distance of a measurement from its prediction."""
    innovation = z - H @ STATE
    return float(innovation @ np.linalg.solve(H @ P @ H.T + R, innovation))


def check_noise(factor: float, *, try_noise: Callable[[float], tuple[float, float]]) -> Verdict:
    """12.1: a factor on Q with which the mean squared distance of the innovations of three numbers is about 3.

    `try_noise` gives this mean, and the RMS error of the offset in cm, for a factor.
    """
    if np.ndim(factor) or not np.isfinite(factor) or factor <= 0:
        return hint("give one positive number, the factor on Q.")
    distance, error_cm = try_noise(float(factor))
    reached = f"with {factor:g} Q the mean d^2 is {distance:.2f}"
    if distance > MEAN_DISTANCE[1]:
        return hint(f"{reached}: the filter is too sure. A larger Q makes it less sure.")
    if distance < MEAN_DISTANCE[0]:
        return hint(f"{reached}: the filter is too unsure. A smaller Q makes it surer.")
    error = "" if np.isnan(error_cm) else f", and the RMS error of the offset {error_cm:.1f} cm"
    return correct(f"{reached}{error}.")


CHECKS: Checks = {"12.1": check_noise, "12.2": check_gate}
