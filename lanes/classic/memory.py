"""What carries over from frame to frame: the memory of a classic lane line."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf

from lanes.classic.fit import LineFit, mean_fit

Limits = tuple[float, float, float]


@dataclass(frozen=True)
class LineMemory:
    """The recent fits of one line; `update` returns the memory after the next frame and leaves this one alone.

    Parameters
    ----------
    length : int
        `best` is the mean of so many of the last accepted fits.
    measured_length : int, optional
        `smoothest` is the mean of so many, by default the same.
    good, doubtful : tuple of float
        Largest |dA|, |dB|, |dC| against `best` (pixels) of a good and of a doubtful fit; worse is bad.
    doubtful_weight : float, in range 0..1
        A doubtful fit enters at this share of its distance from `best`.
    forget_after : int
        After more missed frames in a row than this the line is forgotten, so that a wrong line cannot stay for ever.
    search_again : bool
        After a missed frame, look with windows in the next one instead of near the old line.
    """

    length: int
    measured_length: int | None = None
    good: Limits = (inf, inf, inf)
    doubtful: Limits = (0, 0, 0)
    doubtful_weight: float = 0.0
    forget_after: int = 25
    search_again: bool = True
    fits: tuple[LineFit, ...] = ()
    missed: int = 0
    state: str = "lost"

    @property
    def best(self) -> LineFit | None:
        """The line so far; None before the first fit and after too many missed frames."""
        return mean_fit(self.fits[-self.length :])

    @property
    def smoothest(self) -> LineFit | None:
        """The line to measure, averaged over `measured_length` fits."""
        return mean_fit(self.fits)

    @property
    def near(self) -> LineFit | None:
        """The line near which to look in the next frame; None asks for a search with windows."""
        return None if self.missed and self.search_again else self.best

    def update(self, fit: LineFit | None) -> LineMemory:
        """The memory after a frame in which `fit`, or nothing, was found.

        Its `state` is "found" if the frame gave a good fit, "kept" if the line is the old one, wholly or nearly
        (bad, doubtful or no fit), "lost" if there is no line.
        """
        weight = self._weight(fit)
        if fit is None or weight == 0:
            missed = self.missed + 1
            if not self.fits or missed > self.forget_after:
                return replace(self, fits=(), missed=0, state="lost")
            return replace(self, missed=missed, state="kept")
        fits = (*self.fits, self._damped(fit, weight))[-(self.measured_length or self.length) :]
        return replace(self, fits=fits, missed=0, state="found" if weight == 1 else "kept")

    def scaled(self, sx: float, sy: float) -> LineMemory:
        """The same, empty, for pictures resized by `sx` across and `sy` along: A, B, C carry px/px^2, px/px and px."""
        factors = (sx / sy**2, sx / sy, sx)
        good, doubtful = (
            tuple(x * f for x, f in zip(limits, factors, strict=True)) for limits in (self.good, self.doubtful)
        )
        return replace(self, good=good, doubtful=doubtful, fits=(), missed=0, state="lost")

    def _weight(self, fit: LineFit | None) -> float:
        best = self.best
        if fit is None or best is None:
            return 1.0
        change = [abs(new - old) for new, old in zip(fit.coefficients, best.coefficients, strict=True)]
        if all(c <= limit for c, limit in zip(change, self.good, strict=True)):
            return 1.0
        return self.doubtful_weight if all(c <= d for c, d in zip(change, self.doubtful, strict=True)) else 0.0

    def _damped(self, fit: LineFit, weight: float) -> LineFit:
        best = self.best
        if best is None or weight == 1:
            return fit
        mixed = (old + weight * (new - old) for new, old in zip(fit.coefficients, best.coefficients, strict=True))
        return replace(fit, coefficients=tuple(mixed))
