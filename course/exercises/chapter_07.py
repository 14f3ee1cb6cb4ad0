"""Exercise of chapter 7, fit and measure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from course.exercises.verdict import Checks, Verdict, correct, hint
from helpers import ransac_line

# 7.1: outliers of the streaked line, required probability of a sample without outliers, and limit on the trials.
OUTLIER_SHARE, REQUIRED_PROBABILITY, MAX_TRIALS = 0.4, 0.999, 40


def check_ransac_choice(choice: Sequence[int], *, pixels: np.ndarray, line: Sequence[float]) -> Verdict:
    """7.1: pixels a trial and number of trials of RANSAC; `line` is the true (A, B, C) of `pixels` (N, 2)."""
    if np.shape(choice) != (2,) or any(int(number) != number or number < 1 for number in choice):
        return hint("give two whole numbers: pixels a trial, and trials.")
    samples, trials = map(int, choice)
    if samples < 3:
        return hint(f"{samples} pixels do not determine a parabola, which has three coefficients.")
    if trials > MAX_TRIALS and samples == 3:
        return hint(
            f"{trials} trials are more than needed. A sample is clean if all its pixels are *inliers*: the probability "
            f"is 0.6 to the power of 3, not 0.4 to the power of 3, and at most {MAX_TRIALS} trials are allowed."
        )
    clean = (1 - OUTLIER_SHARE) ** samples
    # of at least one clean sample, with one trial less and with all of them
    before, probability = (1 - (1 - clean) ** count for count in (trials - 1, trials))
    if probability < REQUIRED_PROBABILITY or trials > MAX_TRIALS:
        more = " Three pixels determine a parabola; more make a clean sample rarer." if samples > 3 else ""
        return hint(
            f"a sample of {samples} pixels is clean with the probability {clean:.1%}, at least one of {trials} samples "
            f"with {probability:.2%}. Required are {REQUIRED_PROBABILITY:.2%} in at most {MAX_TRIALS} trials.{more}"
        )
    if before >= REQUIRED_PROBABILITY:
        return hint(f"{trials} is not the smallest number of trials that is enough.")
    fit = ransac_line(pixels, trials=trials, samples=samples)
    if fit is None:
        return hint(f"RANSAC finds no line with {trials} trials of {samples} pixels.")
    rows = np.arange(720)
    error_px = np.abs(fit.columns(rows) - np.polyval(line, rows)).max()
    return correct(
        f"{probability:.2%} with {trials} trials of {samples} pixels; the line is off by {error_px:.1f} columns."
    )


CHECKS: Checks = {"7.1": check_ransac_choice}
