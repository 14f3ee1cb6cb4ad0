"""Curves over time as SVG, stretched by the browser to whatever width there is."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape

import numpy as np

from lanes.drives.report.moments import runs

# Units of the drawings; the browser stretches them.
WIDTH, HEIGHT = 1000, 100
# More points than this are not told apart on a screen: each column then shows its lowest and its highest value.
COLUMNS = 1000
# Share of the values that an axis must hold: single wild frames would flatten the rest.
HELD = 0.98


@dataclass(frozen=True, eq=False)
class Curve:
    """A measured value over time.

    Attributes
    ----------
    key, title, unit : str
        Its key names it in the page's script.
    values : ndarray of shape (frames,)
        NaN where nothing was measured.
    std : ndarray of shape (frames,), optional
        Standard deviation, drawn as a band.
    span : tuple of float
        What the axis shows at least.
    """

    key: str
    title: str
    unit: str
    values: np.ndarray
    std: np.ndarray | None = None
    span: tuple[float, float] = (0.0, 1.0)

    def limits(self) -> tuple[float, float]:
        """Lowest and highest value of the axis, on ticks."""
        known = self.values[np.isfinite(self.values)]
        low, high = np.quantile(known, [(1 - HELD) / 2, (1 + HELD) / 2]) if len(known) else self.span
        step = _tick_step(min(low, self.span[0]), max(high, self.span[1]))
        return (
            float(np.floor(min(low, self.span[0]) / step + 1e-9) * step),
            float(np.ceil(max(high, self.span[1]) / step - 1e-9) * step),
        )

    def ticks(self) -> list[float]:
        """Values to label."""
        low, high = self.limits()
        step = _tick_step(low, high)
        return [round(float(v), 9) + 0.0 for v in np.arange(np.ceil(low / step - 1e-9), high / step + 1e-9) * step]


def draw_curve(curve: Curve, time_s: np.ndarray) -> str:
    """The curve as a <figure>: caption, tick labels, band and line over the frames' times (frames,)."""
    low, high = curve.limits()

    def down(value: float) -> float:
        return 100 * (high - value) / (high - low)

    ticks = "".join(f'<span style="top:{down(v):.1f}%">{v:g}</span>' for v in curve.ticks())
    grid = "".join(f"M0 {down(v):.2f}H{WIDTH}" for v in curve.ticks())
    across = _across(time_s)
    band = "" if curve.std is None else f'<path class="band" d="{_band(across, curve, down)}"/>'
    return (
        f'<figure class="curve" id="curve-{escape(curve.key)}">'
        f"<figcaption>{escape(curve.title)} <small>{escape(curve.unit)}</small></figcaption>"
        f'<div class="ticks" aria-hidden="true">{ticks}</div>'
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" preserveAspectRatio="none" aria-hidden="true">'
        f'<path class="grid" d="{grid}"/>{band}<path class="line" d="{_line(across, curve.values, down)}"/>'
        "</svg></figure>"
    )


def draw_states(state: np.ndarray, time_s: np.ndarray) -> str:
    """The states (frames,) as a strip of colours."""
    edges = np.append(_across(time_s), WIDTH)
    bars = "".join(
        f'<path class="{escape(name)}" d="M{edges[first]:.2f} 0H{edges[end]:.2f}V{HEIGHT}H{edges[first]:.2f}Z"/>'
        for name, first, end in runs(state)
    )
    return (
        '<figure class="states"><figcaption>State</figcaption>'
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" preserveAspectRatio="none" aria-hidden="true">{bars}</svg></figure>'
    )


def _across(time_s: np.ndarray) -> np.ndarray:
    """Times as places across the drawing; the last frame ends at its right edge."""
    since = time_s - time_s[0]
    last = np.median(np.diff(since)) if len(since) > 1 else 1.0
    return WIDTH * since / (since[-1] + last)


def _tick_step(low: float, high: float) -> float:
    """A round step, 1, 2 or 5 times a power of ten, that makes three to six ticks."""
    rough = (high - low) / 4
    power = 10.0 ** np.floor(np.log10(rough))
    return float(min((power * m for m in (1, 2, 5, 10)), key=lambda step: abs(step - rough)))


def _line(across: np.ndarray, values: np.ndarray, down) -> str:
    return "".join(
        "M" + "L".join(f"{x:.2f} {down(v):.2f}" for x, v in zip(*piece, strict=True))
        for piece in _pieces(*_thinned(across, values))
    )


def _band(across: np.ndarray, curve: Curve, down) -> str:
    step = -(-len(across) // COLUMNS)
    x, low, high = across[::step], (curve.values - curve.std)[::step], (curve.values + curve.std)[::step]
    shapes = []
    for xs, lows, highs in _pieces(x, low, high):
        corners = [*zip(xs, highs, strict=True), *zip(xs[::-1], lows[::-1], strict=True)]
        shapes.append("M" + "L".join(f"{x:.2f} {down(v):.2f}" for x, v in corners) + "Z")
    return "".join(shapes)


def _thinned(across: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """As they are, or if there are very many the lowest and highest value of each of `COLUMNS` columns, in order."""
    if len(across) <= 2 * COLUMNS:
        return across, values
    kept = []
    for part in np.array_split(np.arange(len(across)), COLUMNS):
        known = part[np.isfinite(values[part])]
        kept += sorted({known[values[known].argmin()], known[values[known].argmax()]}) if len(known) else [part[0]]
    return across[kept], values[kept]


def _pieces(across: np.ndarray, *columns: np.ndarray) -> list[tuple[np.ndarray, ...]]:
    """Where all columns (N,) are known, piece by piece."""
    known = np.isfinite(columns).all(axis=0).astype(str)
    return [
        tuple(column[first:end] for column in (across, *columns))
        for label, first, end in runs(known)
        if label == "True"
    ]
