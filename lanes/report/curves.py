"""Curves over time as SVG; the browser stretches them to the available width."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from html import escape
from typing import TypeVar

import numpy as np

from lanes.report.moments import runs

# Size of each SVG drawing in its own units.
WIDTH, HEIGHT = 1000, 100
# A screen does not resolve more columns. A longer curve is reduced to the minimum and maximum of each column.
MAX_COLUMNS = 1000
# Share of the values within the limits of an axis, so that single outliers do not flatten the curve.
AXIS_SHARE = 0.98

Heights = TypeVar("Heights", float, np.ndarray)


@dataclass(frozen=True, eq=False)
class Curve:
    """A measured quantity over time.

    `key` is part of the HTML id; `values` (frames,) are NaN without a measurement; their standard deviations are drawn
    as a band; `span` is the range that the axis covers at least.
    """

    key: str
    title: str
    unit: str
    values: np.ndarray
    std: np.ndarray | None = None
    span: tuple[float, float] = (0.0, 1.0)

    def limits(self) -> tuple[float, float]:
        """Lowest and highest value of the axis, rounded outwards to ticks."""
        low, high = self.span
        known = self.values[np.isfinite(self.values)]
        if len(known):
            quantiles = np.quantile(known, [(1 - AXIS_SHARE) / 2, (1 + AXIS_SHARE) / 2])
            low, high = min(low, quantiles[0]), max(high, quantiles[1])
        step = _tick_step(low, high)
        return float(np.floor(low / step + 1e-9) * step), float(np.ceil(high / step - 1e-9) * step)

    def ticks(self) -> list[float]:
        """Values with a tick label."""
        low, high = self.limits()
        step = _tick_step(low, high)
        return [round(float(v), 9) + 0.0 for v in np.arange(np.ceil(low / step - 1e-9), high / step + 1e-9) * step]


def draw_curve(curve: Curve, time_s: np.ndarray) -> str:
    """The curve as an HTML <figure> with caption, tick labels, band and line, over frame times of shape (frames,)."""
    low, high = curve.limits()

    def to_y(values: Heights) -> Heights:
        return 100 * (high - values) / (high - low)

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


def _path(x: np.ndarray, y: np.ndarray) -> str:
    return "M" + "L".join(f"{u:.2f} {v:.2f}" for u, v in zip(x, y, strict=True))


def _line(x: np.ndarray, values: np.ndarray, to_y: Callable[[np.ndarray], np.ndarray]) -> str:
    x, values = _decimate(x, values)
    return "".join(_path(x[run], to_y(values[run])) for run in _finite_runs(values))


def _band(x: np.ndarray, curve: Curve, to_y: Callable[[np.ndarray], np.ndarray]) -> str:
    step = -(-len(x) // MAX_COLUMNS)
    x, low, high = x[::step], to_y(curve.values - curve.std)[::step], to_y(curve.values + curve.std)[::step]
    return "".join(
        _path(np.append(x[run], x[run][::-1]), np.append(high[run], low[run][::-1])) + "Z" for run in _finite_runs(low)
    )


def _decimate(x: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The points, or for a long curve the minimum and maximum of each of `MAX_COLUMNS` columns, in order."""
    if len(x) <= 2 * MAX_COLUMNS:
        return x, values
    kept = []
    for part in np.array_split(np.arange(len(x)), MAX_COLUMNS):
        known = part[np.isfinite(values[part])]
        kept += sorted({known[values[known].argmin()], known[values[known].argmax()]}) if len(known) else [part[0]]
    return x[kept], values[kept]


def _finite_runs(values: np.ndarray) -> list[slice]:
    return np.ma.clump_unmasked(np.ma.masked_invalid(values))
