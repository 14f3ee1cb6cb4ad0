"""Exercise of chapter 11, fit one model to both lines."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from course.exercises.verdict import NOT_TRIED, Verdict, correct, find_mistake, hint

KnownWidthFit = Callable[[np.ndarray, np.ndarray, np.ndarray, float], np.ndarray]
# The lane of the check: centre (m), heading (rad), curvature (1/m), width (m).
CENTRE_M, HEADING_RAD, CURVATURE_PER_M, WIDTH_M = 0.25, -0.012, 0.002, 3.66
TOLERANCES = np.array([0.03, 0.004, 2e-4])
# Another lane, on the left of the car: both of its lines have a positive y.
OTHER_CENTRE_M, OTHER_WIDTH_M = 2.5, 3.0


def check_known_width(fit: KnownWidthFit) -> Verdict:
    """11.1: the lane from one of its lines, with a known width."""
    lane, other = (CENTRE_M, WIDTH_M), (OTHER_CENTRE_M, OTHER_WIDTH_M)
    fits = [_fit_line(fit, side, *lane) for side in (1, -1)]
    if fits[0] is None:
        return NOT_TRIED
    if any(np.shape(found) != (3,) for found in fits):
        return hint(f"the result has shape {np.shape(fits[0])}; return the centre, the heading and the curvature.")
    left, right = (np.asarray(found, float) - [CENTRE_M, HEADING_RAD, CURVATURE_PER_M] for found in fits)
    if abs(left[2] + CURVATURE_PER_M / 2) < TOLERANCES[2]:
        return hint("the curvature is half of the true one: use x^2 / 2.")
    mistakes = {
        "left: this is the line. Use the width.": WIDTH_M / 2,
        "right: it is half a width from either line.": -WIDTH_M / 2,
        "left: it is on the wrong side of the left line. To the right y is smaller.": WIDTH_M,
    }
    if mistake := find_mistake(left[0], mistakes, atol=0.1):
        return hint(f"the centre lies {abs(left[0]):.2f} m too far {mistake}")
    if not (np.abs(left) <= TOLERANCES).all():
        centre_m, heading_rad, curvature_per_m = fits[0]
        return hint(
            f"centre {centre_m:.2f} m, heading {heading_rad:.3f} rad, curvature {1e3 * curvature_per_m:.1f} 1/km; true "
            f"are {CENTRE_M} m (left is positive), {HEADING_RAD} rad and {1e3 * CURVATURE_PER_M:.1f} 1/km."
        )
    if not (np.abs(right) <= TOLERANCES).all():
        return hint("with the left line it is right, but not with the right line, where `left` is False.")
    if not all(abs(_fit_line(fit, side, *other)[0] - OTHER_CENTRE_M) <= TOLERANCES[0] for side in (1, -1)):
        return hint(
            f"in a lane {OTHER_WIDTH_M} m wide beside the car it is wrong. Use width_m and left, not {WIDTH_M} m and "
            "the sign of y."
        )
    mixed = _fit_both(fit)
    if np.shape(mixed) != (3,) or not (np.abs(mixed - [CENTRE_M, HEADING_RAD, CURVATURE_PER_M]) <= TOLERANCES).all():
        return hint("with candidates of both lines it is wrong: each of them counts, with its own half width.")
    return correct(f"with one line the centre is off by {100 * max(abs(left[0]), abs(right[0])):.1f} cm at most.")


def _fit_line(fit: KnownWidthFit, side: int, centre_m: float, width_m: float) -> np.ndarray:
    """The answer for candidates on the left (+1) or right (-1) line of a lane, with a noise of 2 cm."""
    x_m = np.geomspace(5.0, 30.0, 80)
    noise_m = np.random.default_rng(11).normal(0, 0.02, len(x_m))
    y_m = centre_m + side * width_m / 2 + HEADING_RAD * x_m + CURVATURE_PER_M * x_m**2 / 2 + noise_m
    return fit(x_m, y_m, np.full(len(x_m), side > 0), width_m)


def _fit_both(fit: KnownWidthFit) -> np.ndarray:
    """The answer for candidates of both lines; those of the left one are 0.5 m off, few, and cannot decide alone."""
    x_m = np.geomspace(5.0, 30.0, 400)
    left = np.arange(len(x_m)) % 100 == 0
    off_m = np.where(left, 0.5, 0.0)
    y_m = CENTRE_M + np.where(left, 1, -1) * WIDTH_M / 2 + HEADING_RAD * x_m + CURVATURE_PER_M * x_m**2 / 2 + off_m
    return np.asarray(fit(x_m, y_m, left, WIDTH_M), float)


CHECKS = {"11.1": check_known_width}
