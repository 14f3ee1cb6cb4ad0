"""Exercises of chapter 7, fit and measure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from classic.fit import ransac_line
from course.exercises.verdict import Checks, Verdict, correct, hint

# 7.1: outliers of the streaked line, required probability of a sample without outliers, and limit on the trials.
OUTLIER_SHARE, REQUIRED_PROBABILITY, MAX_TRIALS = 0.4, 0.999, 40
# 7.2: published radii and offset of recipe hls_sobel on Udacity's test5.jpg, metres.
PUBLISHED_M = (724.0, 1614.0, 0.170)


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
        return hint(
            f"a sample of {samples} pixels is clean with the probability {clean:.1%}, at least one of {trials} samples "
            f"with {probability:.2%}. Required are {REQUIRED_PROBABILITY:.2%} in at most {MAX_TRIALS} trials."
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


def check_corrected_measures(
    corrected: Sequence[float], *, usual_m: tuple[float, float], true_m: tuple[float, float]
) -> Verdict:
    """7.2: radii and offset with the right scales; `usual_m` and `true_m` are metres per column and per row."""
    if np.shape(corrected) != (3,):
        return hint("give three numbers: radius left, radius right, offset.")
    radii_m, offset_m = np.array(corrected[:2], float), float(corrected[2])
    across, along = true_m[0] / usual_m[0], true_m[1] / usual_m[1]
    published_m = np.array(PUBLISHED_M[:2])

    def used(factor: float) -> bool:
        return bool(np.allclose(radii_m, published_m * factor, rtol=0.005))

    if used(across / along**2):
        return hint(f"{radii_m[0]:.0f} m: the factor is upside down. A row is longer than the usual one.")
    if used(along / across):
        return hint(f"{radii_m[0]:.0f} m: the length along the road counts squared.")
    if used(along**2) or used(along) or used(across):
        return hint(f"{radii_m[0]:.0f} m: the radius depends on both scales, as s_v squared over s_u.")
    if not used(along**2 / across):
        return hint(f"{radii_m[0]:.0f} m: multiply the radius by the ratio of s_v squared over s_u, true to usual.")
    if abs(offset_m - PUBLISHED_M[2] * across) > 0.001:
        return hint(
            f"the radii are right. The offset, {offset_m:.3f} m, is a length across the road: one "
            "scale, once. Three decimals, with the sign of the published one."
        )
    too_small = 1 - published_m[0] / radii_m[0]
    return correct(
        f"{radii_m[0]:.0f} m, {radii_m[1]:.0f} m and {offset_m:.3f} m; the radii were {too_small:.0%} too small."
    )


CHECKS: Checks = {"7.1": check_ransac_choice, "7.2": check_corrected_measures}
