"""Curves over time as SVG; the browser stretches them to the available width."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from html import escape

import numpy as np

from lanes.drives.report.moments import runs

# Size of each SVG drawing in its own units.
WIDTH, HEIGHT = 1000, 100
# A screen does not resolve more columns. A longer curve is reduced to the minimum and maximum of each column.
MAX_COLUMNS = 1000
# Share of the values within the limits of an axis, so that single outliers do not flatten the curve.
AXIS_SHARE = 0.98


@dataclass(frozen=True, eq=False)
class Curve:
    """A measured quantity over time.

    Attributes
    ----------
    key, title, unit : str
        `key` is part of the HTML id.
    values : ndarray of shape (frames,)
        NaN for frames without a measurement.
    std : ndarray of shape (frames,), optional
        Standard deviation, drawn as a band.
    span : tuple of float
        Range that the axis covers at least.
    """

    key: str
    title: str
    unit: str
    values: np.ndarray
    std: np.ndarray | None = None
    span: tuple[float, float] = (0.0, 1.0)

    def limits(self) -> tuple[float, float]:
        """Lowest and highest value of the axis, rounded outwards to ticks."""
        known = self.values[np.isfinite(self.values)]
        low, high = np.quantile(known, [(1 - AXIS_SHARE) / 2, (1 + AXIS_SHARE) / 2]) if len(known) else self.span
        step = _tick_step(min(low, self.span[0]), max(high, self.span[1]))
        return (
            float(np.floor(min(low, self.span[0]) / step + 1e-9) * step),
            float(np.ceil(max(high, self.span[1]) / step - 1e-9) * step),
        )

    def ticks(self) -> list[float]:
        """Values with a tick label."""
        low, high = self.limits()
        step = _tick_step(low, high)
        return [round(float(v), 9) + 0.0 for v in np.arange(np.ceil(low / step - 1e-9), high / step + 1e-9) * step]


def draw_curve(curve: Curve, time_s: np.ndarray) -> str:
    """The curve as an HTML <figure> with caption, tick labels, band and line, over frame times of shape (frames,)."""
    low, high = curve.limits()

    def to_y(value: float) -> float:
        return 100 * (high - value) / (high - low)

    ticks = "".join(f'<span style="top:{to_y(v):.1f}%">{v:g}</span>' for v in curve.ticks())
    grid = "".join(f"M0 {to_y(v):.2f}H{WIDTH}" for v in curve.ticks())
    x = _time_to_x(time_s)
    band = "" if curve.std is None else f'<path class="band" d="{_band(x, curve, to_y)}"/>'
    return (
        f'<figure class="curve" id="curve-{escape(curve.key)}">'
        f"<figcaption>{escape(curve.title)} <small>{escape(curve.unit)}</small></figcaption>"
        f'<div class="ticks" aria-hidden="true">{ticks}</div>'
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" preserveAspectRatio="none" aria-hidden="true">'
        f'<path class="grid" d="{grid}"/>{band}<path class="line" d="{_line(x, curve.values, to_y)}"/>'
        "</svg></figure>"
    )


def draw_states(state: np.ndarray, time_s: np.ndarray) -> str:
    """The states of shape (frames,) as an HTML <figure> with a strip of colours."""
    edges = np.append(_time_to_x(time_s), WIDTH)
    bars = "".join(
        f'<path class="{escape(name)}" d="M{edges[first]:.2f} 0H{edges[end]:.2f}V{HEIGHT}H{edges[first]:.2f}Z"/>'
        for name, first, end in runs(state)
    )
    return (
        '<figure class="states"><figcaption>State</figcaption>'
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" preserveAspectRatio="none" aria-hidden="true">{bars}</svg></figure>'
    )


def _time_to_x(time_s: np.ndarray) -> np.ndarray:
    """Horizontal positions of the frame times; the last frame ends at `WIDTH`."""
    since = time_s - time_s[0]
    last = np.median(np.diff(since)) if len(since) > 1 else 1.0
    return WIDTH * since / (since[-1] + last)


def _tick_step(low: float, high: float) -> float:
    """A step of 1, 2 or 5 times a power of ten that gives three to six ticks."""
    rough = (high - low) / 4
    power = 10.0 ** np.floor(np.log10(rough))
    return float(min((power * m for m in (1, 2, 5, 10)), key=lambda step: abs(step - rough)))


def _path(points: Iterable[tuple[float, float]], to_y: Callable[[float], float]) -> str:
    return "M" + "L".join(f"{x:.2f} {to_y(value):.2f}" for x, value in points)


def _line(x: np.ndarray, values: np.ndarray, to_y: Callable[[float], float]) -> str:
    return "".join(_path(zip(*run, strict=True), to_y) for run in _finite_runs(*_decimate(x, values)))


def _band(x: np.ndarray, curve: Curve, to_y: Callable[[float], float]) -> str:
    step = -(-len(x) // MAX_COLUMNS)
    x, low, high = x[::step], (curve.values - curve.std)[::step], (curve.values + curve.std)[::step]
    shapes = []
    for xs, lows, highs in _finite_runs(x, low, high):
        corners = [*zip(xs, highs, strict=True), *zip(xs[::-1], lows[::-1], strict=True)]
        shapes.append(_path(corners, to_y) + "Z")
    return "".join(shapes)


def _decimate(x: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The points, or for a long curve the minimum and maximum of each of `MAX_COLUMNS` columns, in order."""
    if len(x) <= 2 * MAX_COLUMNS:
        return x, values
    kept = []
    for part in np.array_split(np.arange(len(x)), MAX_COLUMNS):
        known = part[np.isfinite(values[part])]
        kept += sorted({known[values[known].argmin()], known[values[known].argmax()]}) if len(known) else [part[0]]
    return x[kept], values[kept]


def _finite_runs(x: np.ndarray, *columns: np.ndarray) -> list[tuple[np.ndarray, ...]]:
    """The runs of points in which all columns (N,) are finite."""
    finite = np.isfinite(columns).all(axis=0).astype(str)
    return [
        tuple(column[first:end] for column in (x, *columns)) for label, first, end in runs(finite) if label == "True"
    ]
