"""Fitting a lane line: least squares with guards, and RANSAC.

A line in the view is x = A y^2 + B y + C: column as a function of row, because lane lines run up the view.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class LineFit:
    """One lane line in the view.

    Parameters
    ----------
    coefficients : tuple of float
        (A, B, C) of x = A y^2 + B y + C, x the column and y the row in pixels, y growing downward.
    pixels : int
        How many pixels support it.
    rows_px : tuple of float
        First and last row with such a pixel; outside of them the line is a guess.
    """

    coefficients: tuple[float, float, float]
    pixels: int
    rows_px: tuple[float, float]

    def columns(self, rows_px: np.ndarray | float) -> np.ndarray:
        """Columns in pixels at the given rows."""
        return np.polyval(self.coefficients, rows_px)

    def points(self, height: int, *, step_px: int = 8) -> np.ndarray:
        """Points (N, 2) as (column, row) from the view's top row to its bottom row, far to near, for drawing."""
        rows = np.append(np.arange(0, height - 1, step_px), height - 1)
        return np.column_stack([self.columns(rows), rows])


def fit_line(pixels: np.ndarray, *, min_span_px: float = 2) -> LineFit | None:
    """Least-squares parabola through the pixels of one line.

    Parameters
    ----------
    pixels : ndarray of shape (N, 2)
        (column, row) of each pixel.
    min_span_px : float
        Fewer rows than this between first and last pixel cannot show a bend.

    Returns
    -------
    LineFit or None
        None where the pixels do not determine a parabola: fewer than three different rows, or too short a span.
    """
    pixels = np.asarray(pixels, float).reshape(-1, 2)
    if not _determines_parabola(pixels[:, 1], min_span_px):
        return None
    x, y = pixels.T
    middle, half = _centre(y)
    powers = _powers((y - middle) / half)
    return _as_fit(np.linalg.solve(powers.T @ powers, powers.T @ x), middle, half, y)


def ransac_line(
    pixels: np.ndarray,
    *,
    trials: int = 100,
    samples: int = 150,
    residual_px: float = 15.0,
    seed: int = 0,
    min_span_px: float = 2,
) -> LineFit | None:
    """Parabola through the largest group of pixels that agree (random sample consensus, Fischler and Bolles 1981).

    Every trial fits `samples` pixels drawn with replacement and counts the pixels within `residual_px` of it; the
    pixels of the best trial are fitted by least squares. At most 2000 evenly spread pixels do the counting.

    Parameters
    ----------
    pixels : ndarray of shape (N, 2)
        (column, row) of each pixel.
    trials, samples : int
    residual_px : float, > 0
        Largest distance along the row.
    seed : int
        The same seed gives the same line.
    min_span_px : float
        See `fit_line`.

    Returns
    -------
    LineFit or None
        As for `fit_line`.
    """
    pixels = np.asarray(pixels, float).reshape(-1, 2)
    if not _determines_parabola(pixels[:, 1], min_span_px):
        return None
    x, y = pixels.T
    middle, half = _centre(y)
    powers = _powers((y - middle) / half)
    drawn = np.random.default_rng(seed).integers(len(x), size=(trials, min(samples, len(x))))
    p = powers[drawn]
    # A trial may draw fewer than three different rows; the pseudo-inverse then gives some flat line, which loses.
    models = np.linalg.pinv(p.transpose(0, 2, 1) @ p, hermitian=True) @ (p.transpose(0, 2, 1) @ x[drawn][..., None])
    jury = slice(None, None, -(-len(x) // 2000))
    agree = np.abs(powers[jury] @ models[..., 0].T - x[jury, None]) <= residual_px
    best = models[np.argmax(agree.sum(axis=0)), :, 0]
    return fit_line(pixels[np.abs(powers @ best - x) <= residual_px], min_span_px=min_span_px)


def mean_fit(fits: Sequence[LineFit]) -> LineFit | None:
    """Plain mean of the coefficients, total support; None of no fits."""
    if not fits:
        return None
    first, last = zip(*(fit.rows_px for fit in fits), strict=True)
    a, b, c = np.mean([fit.coefficients for fit in fits], axis=0).tolist()
    return LineFit((a, b, c), sum(fit.pixels for fit in fits), (min(first), max(last)))


def mean_distance_px(fit: LineFit, other: LineFit, height: int) -> float:
    """Mean absolute distance between two lines along the rows 0..height-1, pixels."""
    rows = np.arange(height)
    return float(np.abs(fit.columns(rows) - other.columns(rows)).mean())


def _determines_parabola(rows: np.ndarray, min_span_px: float) -> bool:
    if len(rows) < 3:
        return False
    first, last = rows.min(), rows.max()
    return last - first >= max(min_span_px, 2) and bool(((rows > first) & (rows < last)).any())


def _centre(rows: np.ndarray) -> tuple[float, float]:
    """Middle and half span: in rows scaled to -1..1 the normal equations are well conditioned."""
    return (rows.min() + rows.max()) / 2, (rows.max() - rows.min()) / 2


def _powers(rows: np.ndarray) -> np.ndarray:
    return np.column_stack([rows * rows, rows, np.ones_like(rows)])


def _as_fit(scaled: np.ndarray, middle: float, half: float, rows: np.ndarray) -> LineFit:
    """Undo the scaling of the rows: substitute (y - middle) / half."""
    a, b = scaled[0] / half**2, scaled[1] / half
    coefficients = (a, b - 2 * a * middle, scaled[2] - b * middle + a * middle**2)
    return LineFit(tuple(float(c) for c in coefficients), len(rows), (float(rows.min()), float(rows.max())))
