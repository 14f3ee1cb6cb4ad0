"""Covariance of the errors of a fit or of the filter, which is what a lane states.

Fit and filter assume more noise than most roads and pictures have, so that worn paint and hairpins do not surprise
them. The assumed noise sets the gain. It is not the size of the errors: with a gain K that was made for other noise,
the errors have the covariance

    E = (I - K H) E_before (I - K H)^T + K R K^T

for the covariance E_before of the prior's errors and R of the measurements' (A. Gelb, "Applied optimal estimation",
1974, section 7.2). R is estimated from the residuals of the stripes, E_before is that of roads as they are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import exp

import numpy as np

from lanes.tracking.fitting import LaneFit
from lanes.tracking.model import (
    CURVATURE,
    KNOTS_M,
    PITCH,
    PRIOR,
    PRIOR_STD,
    RATE,
    RATE_STEPS,
    VERTICAL_CURVATURE,
)


@dataclass(frozen=True)
class ErrorParameters:
    """Noise of roads and pictures; fitted on seeds 0 and 1 of the rendered suite, checked on others."""

    # The residuals of stripes along a line are correlated (paint, lens): variance of their mean, relative to that of
    # independent ones.
    correlation: float = 4.0
    # Variance factor of a picture without stripes, its weight in stripes, and its smallest value.
    usual_factor: float = 0.06
    usual_weight: float = 10.0
    min_factor: float = 0.01
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
# Curvatures at the car and at the knots of the rate, for curvature, rate and rate steps.
_CURVATURES_AT_KNOTS = np.hstack(
    [np.ones((4, 1)), np.maximum(np.subtract.outer([0.0, *KNOTS_M], [0.0, *KNOTS_M]), 0.0)[:, :-1], np.zeros((4, 1))]
)
_CURVATURE_CHAIN = [CURVATURE, RATE, *range(RATE_STEPS.start, RATE_STEPS.stop)]


@dataclass(frozen=True)
class VarianceFactor:
    """Variance of the stripes' residuals, relative to the assumed one (adjustment computation: a posteriori factor)."""

    # Sum of the weighted squared residuals over the assumed variances, and of the weights.
    squares: float = ERRORS.usual_factor * ERRORS.usual_weight
    weight: float = ERRORS.usual_weight

    @property
    def value(self) -> float:
        """The estimate."""
        return max(self.squares / self.weight, ERRORS.min_factor)

    def add(self, fit: LaneFit, *, index: int = 0, elapsed_s: float = 0.0) -> VarianceFactor:
        """The factor after `elapsed_s` seconds, with the residuals of lane `index` of a fit."""
        kept = exp(-elapsed_s / ERRORS.memory_s)
        squares, weight = float(fit.squares[index]), float(fit.explained[index])
        return replace(self, squares=kept * self.squares + squares, weight=kept * self.weight + weight)


def fit_errors(fit: LaneFit, index: int) -> np.ndarray:
    """(15, 15) covariance of the errors of lane `index`, fitted to one picture without a prediction."""
    kept, measured = split_gain(np.linalg.inv(fit.information[index]), fit.prior[index])
    factor = VarianceFactor().add(fit, index=index).value * ERRORS.correlation
    return (kept * road_std(fit.lane[index]) ** 2) @ kept.T + factor * measured


def split_gain(covariance: np.ndarray, prior_information: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """I - K H and K R K^T, (15, 15) each, of an update with this result and this inverse covariance of its prior."""
    kept = covariance @ prior_information
    measured = covariance - kept @ covariance
    return kept, (measured + measured.T) / 2


def road_std(lane: np.ndarray) -> np.ndarray:
    """(15,) standard deviations of the parameters on roads as they are, near a lane (15,)."""
    curvature = float(np.abs(_CURVATURES_AT_KNOTS @ lane[_CURVATURE_CHAIN]).max())
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
