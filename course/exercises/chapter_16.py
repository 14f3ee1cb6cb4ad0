"""Exercise of chapter 16, learn the filter."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from course.exercises.verdict import NOT_TRIED, Verdict, correct, hint

EXAMPLES, CELLS = 60, 21
# Step of the differences that the gradient is compared with.
STEP = 1e-5


def check_loss_gradient(gradient: Callable[..., tuple[np.ndarray, float]]) -> Verdict:
    """16.1: the gradient of the cross-entropy by the weights and the bias."""
    rng = np.random.default_rng(16)
    cells, is_paint = rng.normal(size=(EXAMPLES, CELLS)), rng.random(EXAMPLES) < 0.3
    weights, bias = rng.normal(0, 0.2, CELLS), -0.4
    answer = gradient(cells.copy(), is_paint.copy(), weights.copy(), bias)
    if answer is None:
        return NOT_TRIED
    try:
        by_weights, by_bias = (np.asarray(part, float) for part in answer)
    except (TypeError, ValueError):
        return hint("return two things: the derivatives by the weights, an array (21,), and the derivative by b.")
    if by_weights.shape != (CELLS,) or by_bias.shape != ():
        return hint(f"the shapes are {by_weights.shape} and {by_bias.shape}; they must be (21,) and ().")
    expected, expected_bias = _differences(cells, is_paint, weights, bias)
    if np.allclose(by_weights, -expected, rtol=1e-3) and not np.allclose(expected, 0):
        return hint("this points downhill. The gradient points uphill; the descent subtracts it.")
    if np.allclose(by_weights, EXAMPLES * expected, rtol=1e-3):
        return hint("this is the gradient of the sum. L is the mean over the examples.")
    error = float(np.abs(by_weights - expected).max())
    if not error <= 1e-4:
        return hint(f"the derivatives by the weights are off by up to {error:.3f}. Does the factor p (1 - p) cancel?")
    if not abs(by_bias - expected_bias) <= 1e-4:
        return hint(f"the derivative by b is {by_bias:.3f} instead of {expected_bias:.3f}. Its input is always 1.")
    return correct(f"within {max(error, 1e-6):.0e} of the differences of L.")


def _differences(cells: np.ndarray, is_paint: np.ndarray, weights: np.ndarray, bias: float) -> tuple[np.ndarray, float]:
    """Central differences of the cross-entropy by each weight (21,), and by the bias."""
    steps = STEP * np.eye(CELLS)
    by_weights = [
        _loss(cells, is_paint, weights + step, bias) - _loss(cells, is_paint, weights - step, bias) for step in steps
    ]
    by_bias = _loss(cells, is_paint, weights, bias + STEP) - _loss(cells, is_paint, weights, bias - STEP)
    return np.array(by_weights) / (2 * STEP), by_bias / (2 * STEP)


def _loss(cells: np.ndarray, is_paint: np.ndarray, weights: np.ndarray, bias: float) -> float:
    log_odds = cells @ weights + bias
    return float(np.logaddexp(0, np.where(is_paint, -log_odds, log_odds)).mean())


CHECKS = {"16.1": check_loss_gradient}
