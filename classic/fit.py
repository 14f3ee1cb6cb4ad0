"""Parabolas of one lane line: fits in the bird's-eye view by least squares and RANSAC, and the line on the road.

In the bird's-eye view a line is x = A y^2 + B y + C, the column as a function of the row, because lane lines are nearly
vertical there. On the road it is y = c0 + c1 x + c2 x^2 / 2, x forward and y left of the car, metres.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

# RANSAC counts the inliers of a trial among at most this many pixels.
MAX_COUNTED_PIXELS = 2000


@dataclass(frozen=True)
class LineFit:
    """One lane line in the bird's-eye view.

    Parameters
    ----------
    coefficients : tuple of float
        (A, B, C) of x = A y^2 + B y + C, x the column and y the row in pixels, y growing downward.
    pixels : int
        Number of pixels that support the line.
    rows_px : tuple of float
        First and last row with such a pixel; beyond them the line is extrapolated.
    """

    coefficients: tuple[float, float, float]
    pixels: int
    rows_px: tuple[float, float]

    def columns(self, rows_px: np.ndarray | float) -> np.ndarray:
        """Columns in pixels at the given rows."""
        return np.polyval(self.coefficients, rows_px)

    def points(self, height: int) -> np.ndarray:
        """Points (N, 2) as (column, row) in every eighth row and the last, far to near, for drawing."""
        rows = np.append(np.arange(0, height - 1, 8), height - 1)
        return np.column_stack([self.columns(rows), rows])


def fit_line(pixels: np.ndarray, *, min_span_px: float = 2) -> LineFit | None:
    """Least-squares parabola through the pixels (N, 2) (column, row) of one line.

    None if the pixels do not determine a parabola: fewer than three different rows, or fewer than `min_span_px` rows
    between the first and the last pixel.
    """
    pixels = np.asarray(pixels, float).reshape(-1, 2)
    if not _determines_parabola(pixels[:, 1], min_span_px):
        return None
    x, y = pixels.T
    powers, centre, half_span = _scaled_powers(y)
    a, b, c = np.linalg.solve(powers.T @ powers, powers.T @ x)
    # Coefficients for unscaled rows: substitute (y - centre) / half_span.
    a, b = a / half_span**2, b / half_span
    coefficients = (float(a), float(b - 2 * a * centre), float(c - b * centre + a * centre**2))
    return LineFit(coefficients, len(y), (float(y.min()), float(y.max())))


def ransac_line(
    pixels: np.ndarray,
    *,
    trials: int = 100,
    samples: int = 3,
    residual_px: float = 15.0,
    seed: int = 0,
    min_span_px: float = 2,
) -> LineFit | None:
    """Parabola through the largest consensus set (RANSAC, Fischler and Bolles 1981); see `fit_line`.

    Every trial fits `samples` pixels, drawn with replacement, and counts the inliers within `residual_px` columns among
    at most `MAX_COUNTED_PIXELS` evenly spaced pixels. The inliers of the best trial are fitted by least squares. The
    same `seed` gives the same line.

    Three pixels determine a parabola. More make each trial less noisy, but its sample is less often free of outliers.
    """
    pixels = np.asarray(pixels, float).reshape(-1, 2)
    if not _determines_parabola(pixels[:, 1], min_span_px):
        return None
    x, y = pixels.T
    powers, _, _ = _scaled_powers(y)
    drawn = np.random.default_rng(seed).integers(len(x), size=(trials, min(samples, len(x))))
    p = powers[drawn]
    # A sample may have fewer than three different rows. The pseudo-inverse then gives a line with few inliers.
    models = np.linalg.pinv(p.transpose(0, 2, 1) @ p, hermitian=True) @ (p.transpose(0, 2, 1) @ x[drawn][..., None])
    subset = slice(None, None, -(-len(x) // MAX_COUNTED_PIXELS))
    inliers = np.abs(powers[subset] @ models[..., 0].T - x[subset, None]) <= residual_px
    best = models[np.argmax(inliers.sum(axis=0)), :, 0]
    return fit_line(pixels[np.abs(powers @ best - x) <= residual_px], min_span_px=min_span_px)


def mean_fit(fits: Sequence[LineFit]) -> LineFit | None:
    """Mean of the coefficients, with the pixels of all fits and the rows that they cover; None without fits."""
    if not fits:
        return None
    first, last = zip(*(fit.rows_px for fit in fits), strict=True)
    a, b, c = np.mean([fit.coefficients for fit in fits], axis=0).tolist()
    return LineFit((a, b, c), sum(fit.pixels for fit in fits), (min(first), max(last)))


def mean_distance_px(fit: LineFit, other: LineFit, height: int) -> float:
    """Mean absolute distance between two lines over the rows 0..height-1, pixels."""
    rows = np.arange(height)
    return float(np.abs(fit.columns(rows) - other.columns(rows)).mean())


@dataclass(frozen=True)
class RoadLine:
    """A lane line on the road: y(x) = c0 + c1 x + c2 x^2 / 2, x forward and y left of the car, metres."""

    c0_m: float
    c1: float
    c2_per_m: float

    def lateral_m(self, x_m: np.ndarray | float) -> np.ndarray | float:
        """Lateral position at `x_m` metres ahead, positive left."""
        return self.c0_m + self.c1 * x_m + self.c2_per_m * np.square(x_m) / 2

    def curvature_per_m(self, x_m: float = 0.0) -> float:
        """Signed curvature y'' / (1 + y'^2)^1.5 in 1/m, by default at the car."""
        return self.c2_per_m / (1 + (self.c1 + self.c2_per_m * x_m) ** 2) ** 1.5


def road_line(fit: LineFit, to_road: Callable[[np.ndarray], np.ndarray], height: int) -> RoadLine | None:
    """The line on the road: points of the line in the bird's-eye view are mapped to the road and fitted in metres.

    A parabola in the bird's-eye view is a parabola on the road only if the scales are constant, but points can always
    be mapped.

    Parameters
    ----------
    to_road : callable
        Maps points (N, 2) of the bird's-eye view to road points (N, 2) in metres: `warp.birdseye_to_road` or
        `warp.scale_to_road`.
    height : int
        Height of the bird's-eye view in pixels; the line is sampled over all rows.

    Returns
    -------
    RoadLine or None
        None if fewer than three points are on the road (the others are above the horizon).
    """
    rows = np.linspace(0, height - 1, 60)
    points = to_road(np.column_stack([fit.columns(rows), rows]))
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < 3 or np.ptp(points[:, 0]) == 0:
        return None
    half_c2, c1, c0 = np.polyfit(points[:, 0], points[:, 1], 2)
    return RoadLine(float(c0), float(c1), float(2 * half_c2))


def _determines_parabola(rows: np.ndarray, min_span_px: float) -> bool:
    if len(rows) < 3:
        return False
    first, last = rows.min(), rows.max()
    return last - first >= max(min_span_px, 2) and bool(((rows > first) & (rows < last)).any())


def _scaled_powers(rows: np.ndarray) -> tuple[np.ndarray, float, float]:
    """Powers (N, 3) of the rows scaled to -1..1, for well-conditioned normal equations; their centre and half span."""
    centre, half_span = (rows.min() + rows.max()) / 2, (rows.max() - rows.min()) / 2
    scaled = (rows - centre) / half_span
    return np.column_stack([scaled * scaled, scaled, np.ones_like(scaled)]), centre, half_span
