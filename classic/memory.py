"""Temporal smoothing of one lane line: mean of the last accepted fits, with a gate for new ones."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf

import numpy as np

from classic.fit import LineFit, mean_fit

Limits = tuple[float, float, float]


@dataclass(frozen=True)
class LineMemory:
    """Recent fits of one line. Immutable: `update` returns the memory after the next frame.

    Parameters
    ----------
    length : int
        Number of accepted fits averaged in `average`.
    measured_length : int, optional
        Number of accepted fits averaged in `measured_average`; default `length`.
    accept_limits, blend_limits : tuple of float
        Largest ``|dA|``, ``|dB|``, ``|dC|`` between a new fit and `average`, pixels. Within `accept_limits` the fit is
        accepted, within `blend_limits` it is blended with `average`, otherwise it is rejected.
    blend_weight : float, in range 0..1
        Weight of a blended fit; `average` has the rest.
    max_missed : int
        After more missed frames in a row the line is deleted, so that a wrong line does not persist.
    search_again : bool
        After a missed frame, search with sliding windows in the next one instead of around the previous line.
    """

    length: int
    measured_length: int | None = None
    accept_limits: Limits = (inf, inf, inf)
    blend_limits: Limits = (0, 0, 0)
    blend_weight: float = 0.0
    max_missed: int = 25
    search_again: bool = True
    fits: tuple[LineFit, ...] = ()
    missed: int = 0
    state: str = "lost"

    @property
    def average(self) -> LineFit | None:
        """Mean of the last `length` fits; None before the first fit and after too many missed frames."""
        return mean_fit(self.fits[-self.length :])

    @property
    def measured_average(self) -> LineFit | None:
        """Mean of the last `measured_length` fits, for measurements on the road."""
        return mean_fit(self.fits)

    @property
    def search_prior(self) -> LineFit | None:
        """The line around which to search in the next frame; None for a search with sliding windows."""
        return None if self.missed and self.search_again else self.average

    def update(self, fit: LineFit | None) -> LineMemory:
        """The memory after the next frame, with the fit of that frame or None.

        Its `state` is "found" if the fit was accepted and "kept" if it was blended, rejected or missing. It is "lost"
        if the memory has no line.
        """
        accepted = None if fit is None else self._accept(fit)
        if accepted is None:
            missed = self.missed + 1
            if not self.fits or missed > self.max_missed:
                return replace(self, fits=(), missed=0, state="lost")
            return replace(self, missed=missed, state="kept")
        fits = (*self.fits, accepted)[-(self.measured_length or self.length) :]
        return replace(self, fits=fits, missed=0, state="found" if accepted is fit else "kept")

    def scaled(self, sx: float, sy: float) -> LineMemory:
        """The same parameters, without fits, for images scaled by `sx` in columns and `sy` in rows.

        A, B and C have the units px/px^2, px/px and px.
        """
        factors = (sx / sy**2, sx / sy, sx)
        accept_limits, blend_limits = (
            tuple(np.multiply(limits, factors).tolist()) for limits in (self.accept_limits, self.blend_limits)
        )
        return replace(self, accept_limits=accept_limits, blend_limits=blend_limits, fits=(), missed=0, state="lost")

    def _accept(self, fit: LineFit) -> LineFit | None:
        """The fit if it is accepted, its blend with the average, or None if it is rejected."""
        previous = self.average
        if previous is None:
            return fit
        average = np.array(previous.coefficients)
        change = fit.coefficients - average
        if (np.abs(change) <= self.accept_limits).all():
            return fit
        if self.blend_weight == 0 or (np.abs(change) > self.blend_limits).any():
            return None
        return replace(fit, coefficients=tuple((average + self.blend_weight * change).tolist()))
