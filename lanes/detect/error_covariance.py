"""Covariance of the errors of a fit or of the filter, which is what a lane states.

Fit and filter assume more noise than most roads and pictures have, so that worn paint and hairpins do not surprise
them. The assumed noise sets the gain. It is not the size of the errors: with a gain K that was made for other noise,
the errors have the covariance

    E = (I - K H) E_before (I - K H)^T + K R K^T

for the covariance E_before of the prior's errors and R of the measurements' (A. Gelb, "Applied optimal estimation",
1974, section 7.2). R is estimated from the residuals of the stripes, E_before is that of roads as they are.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp

import numpy as np

from lanes.detect.fit import LaneFit
from lanes.detect.road import CURVATURE, PITCH, PRIOR, PRIOR_STD, RATE, RATE_STEPS, VERTICAL_CURVATURE, max_curvature


@dataclass(frozen=True)
class ErrorParameters:
    """Noise of roads and pictures; fitted on seeds 0 and 1 of the rendered suite, checked on others."""

    # In a picture without stripes: variance of the residuals relative to the assumed one, correlation of those in
    # neighbouring rows, and the weight of both in stripes.
    usual_variance: float = 0.06
    usual_correlation: float = 0.4
    usual_weight: float = 10.0
    # Smallest variance, and largest correlation: a row shows paint 0.1 to 1.5 m long.
    min_variance: float = 0.01
    max_correlation: float = 0.85
    # What the correlation of neighbouring rows does not show: errors that a whole line shares.
    shared_factor: float = 2.0
    # Time in which the residuals of a drive lose their weight.
    memory_s: float = 0.5
    # Standard deviations of straight and level roads, and of the pitch of cars; `PriorParameters` has larger ones.
    rate_per_m2: float = 2e-5
    vertical_per_m: float = 5e-5
    pitch_rad: float = 0.006
    # Growth of the rate's standard deviation with the largest curvature in view, per metre; and of the rate steps' with
    # that of the rate.
    rate_share_per_m: float = 0.1
    rate_step_share: float = 1.5


ERRORS = ErrorParameters()


@dataclass(frozen=True)
class ResidualStatistics:
    """Sums over the residuals of stripes, in assumed standard deviations; older frames of a drive decay."""

    # Sum of the weights, and of the weighted squares.
    weight: float = ERRORS.usual_weight
    squares: float = ERRORS.usual_weight * ERRORS.usual_variance
    # Sums over pairs of stripes of one line in neighbouring rows: of the products, and of the mean squares.
    products: float = ERRORS.usual_weight * ERRORS.usual_variance * ERRORS.usual_correlation
    pair_squares: float = ERRORS.usual_weight * ERRORS.usual_variance

    def add(self, fit: LaneFit, *, index: int = 0, elapsed_s: float = 0.0) -> ResidualStatistics:
        """The sums `elapsed_s` seconds later, with the residuals of lane `index` of a fit."""
        kept, normalized = exp(-elapsed_s / ERRORS.memory_s), fit.normalized[index]
        products, pair_squares = np.sum([_pair_sums(fit, index, line) for line in range(2)], axis=0).tolist()
        return ResidualStatistics(
            kept * self.weight + float(fit.explained[index]),
            kept * self.squares + float(fit.weight[index] @ (normalized * normalized)),
            kept * self.products + products,
            kept * self.pair_squares + pair_squares,
        )

    @property
    def variance(self) -> float:
        """Variance of a residual, relative to the assumed one (a posteriori variance factor)."""
        return max(self.squares / self.weight, ERRORS.min_variance)

    @property
    def correlation(self) -> float:
        """Correlation of the residuals of neighbouring rows."""
        return min(max(self.products / self.pair_squares, 0.0), ERRORS.max_correlation)

    @property
    def effective_variance(self) -> float:
        """Variance that independent residuals would have if their mean had the variance of the mean of these.

        (1 + r) / (1 - r) is that of a first-order autoregressive sequence with the correlation r.
        """
        r = self.correlation
        return ERRORS.shared_factor * self.variance * (1 + r) / (1 - r)


def _pair_sums(fit: LaneFit, index: int, line: int) -> tuple[float, float]:
    """Sums over pairs of stripes of a line in neighbouring rows: of the products, and of the mean squares."""
    on_line = np.flatnonzero(fit.members[index, line])
    row, residual = fit.stripes.row[on_line], fit.normalized[index, on_line]
    first = np.flatnonzero(row[1:] - row[:-1] == 1)
    a, b = residual[first], residual[first + 1]
    return float(a @ b), float(a @ a + b @ b) / 2


def fit_errors(fit: LaneFit, index: int) -> np.ndarray:
    """(15, 15) covariance of the errors of lane `index`, fitted to one picture without a prediction."""
    kept, measured = split_gain(fit.covariance[index], fit.prior[index])
    variance = ResidualStatistics().add(fit, index=index).effective_variance
    return (kept * road_std(fit.lane[index]) ** 2) @ kept.T + variance * measured


def split_gain(covariance: np.ndarray, prior_information: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """I - K H and K R K^T, (15, 15) each, of an update with this result and this inverse covariance of its prior."""
    kept = covariance @ prior_information
    measured = covariance - kept @ covariance
    return kept, (measured + measured.T) / 2


def road_std(lane: np.ndarray) -> np.ndarray:
    """(15,) standard deviations of the parameters on roads as they are, near a lane (15,)."""
    curvature = max_curvature(lane)
    excess = max(curvature - PRIOR.motorway_curvature_per_m, 0.0)
    std = PRIOR_STD.copy()
    std[CURVATURE] += PRIOR.curvature_share * curvature
    std[RATE] = ERRORS.rate_per_m2 + ERRORS.rate_share_per_m * excess
    std[RATE_STEPS] = ERRORS.rate_step_share * std[RATE]
    std[PITCH] = ERRORS.pitch_rad
    vertical = np.abs(lane[VERTICAL_CURVATURE]).max()
    std[VERTICAL_CURVATURE] = (
        ERRORS.vertical_per_m + PRIOR.vertical_bend_share * excess + PRIOR.vertical_share * vertical
    )
    return std
