"""The report of a drive as one HTML file that works offline in any browser.

A video of up to `MAX_EMBEDDED_BYTES` is embedded, so that the report can be sent by mail. A larger video is linked and
must stay in the same folder. File names and settings are escaped. A content security policy allows only the page's own
script. The curves are SVG, which the browser stretches to the available width.
"""

from __future__ import annotations

import base64
import hashlib
import json
import os
import re
from collections import Counter
from collections.abc import Mapping
from html import escape
from importlib.resources import files
from pathlib import Path
from urllib.parse import quote

import numpy as np

from lanes.files import write_atomically
from lanes.report.moments import Moment, Telemetry, line_types, runs, seconds_lost, share_tracked, worst_moments

# Base64 makes it 4/3 as large: below the limit of most mail servers, 25 MB.
MAX_EMBEDDED_BYTES = 16_000_000
# Telemetry columns in the page, with their number of decimals.
PAGE_COLUMNS = {
    "frame": 0,
    "offset_m": 4,
    "offset_std_m": 4,
    "curvature_per_m": 6,
    "curvature_std_per_m": 6,
    "confidence": 3,
    "lane_width_m": 2,
}
# Size of each SVG drawing in its own units.
WIDTH, HEIGHT = 1000, 100
# A screen does not resolve more columns. A longer curve is reduced to the minimum and maximum of each column.
MAX_COLUMNS = 1000
# Share of the values within the limits of an axis, so that single outliers do not flatten the curve.
AXIS_SHARE = 0.98


def write_report(
    path: str | Path,
    *,
    title: str,
    video: str | Path,
    telemetry: Telemetry,
    settings: Mapping[str, str],
    max_embedded_bytes: int = MAX_EMBEDDED_BYTES,
) -> Path:
    """Write the report of an annotated mp4 video with its telemetry into its folder; returns the `path`.

    `settings` are shown as a table.
    """
    video = Path(video)
    embedded = video.stat().st_size <= max_embedded_bytes
    parts = {
        "title": escape(title),
        "summary": escape(_summary(telemetry)),
        "video_name": escape(video.name),
        "video_link": escape(quote(os.fsencode(video.name))),
        "video_data": base64.b64encode(video.read_bytes()).decode() if embedded else "",
        "states": draw_states(telemetry["state"], telemetry["time_s"]),
        "curves": _draw_curves(telemetry),
        "moments": "".join(_list_moments(kind, moments) for kind, moments in worst_moments(telemetry).items()),
        "settings": "".join(f"<tr><th>{escape(k)}</th><td>{escape(v)}</td></tr>" for k, v in settings.items()),
    }
    return fill_page(path, "report", parts, _frames(telemetry))


def fill_page(path: str | Path, name: str, parts: Mapping[str, str], data: object) -> Path:
    """Write a page from the template `name`.html, whose script `name`.js reads the data; returns the `path`."""
    script = _asset(f"{name}.js")
    script_hash = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    # With "<" escaped, so that it cannot end the <script> element around it.
    text = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    parts = {"style": _asset("report.css"), "script": script, "script_hash": script_hash, "data": text, **parts}
    # In one pass, so that a {{name}} inside a part stays as it is.
    page = re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], _asset(f"{name}.html"))
    # File names may contain bytes that are not valid UTF-8.
    write_atomically(path, page.encode(errors="replace"))
    return Path(path)


def _asset(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")


def _summary(telemetry: Telemetry) -> str:
    time_s, offset_m, lost_s = telemetry["time_s"], telemetry["offset_m"], seconds_lost(telemetry)
    sentence = (
        f"{len(time_s)} frames, {time_s[-1] - time_s[0]:.1f} s. Lane tracked in {share_tracked(telemetry):.0%} of the "
        f"frames, {f'lost for {lost_s:.1f} s in total' if lost_s else 'never lost'}."
    )
    if not np.isfinite(offset_m).any():
        return sentence
    low, high, median = np.nanmin(offset_m), np.nanmax(offset_m), np.nanmedian(telemetry["confidence"])
    left, right = (Counter(line_types(telemetry, side)).most_common(1)[0][0] for side in ("left", "right"))
    return (
        f"{sentence} Offset from {low:+.2f} to {high:+.2f} m, median confidence {median:.2f}. "
        f"Most of the time the left line is {left}, the right line {right}."
    )


def _frames(telemetry: Telemetry) -> dict[str, list]:
    """Data for the script: times since the first frame, states, `PAGE_COLUMNS`, and where the line types change."""
    time_s = telemetry["time_s"] - telemetry["time_s"][0]
    columns = {name: _rounded(telemetry[name], digits) for name, digits in PAGE_COLUMNS.items()}
    for side in ("left", "right"):
        columns[f"{side}_types"] = [[first, words] for words, first, _ in runs(line_types(telemetry, side))]
    return {"time_s": _rounded(time_s, 4), "state": telemetry["state"].tolist(), **columns}


def _rounded(values: np.ndarray, digits: int) -> list:
    return [round(float(v), digits) if np.isfinite(v) else None for v in values]


def _list_moments(kind: str, moments: list[Moment]) -> str:
    """The moments of a kind as buttons; empty without one."""
    items = ""
    for time_s, text in moments:
        label = f"<b>{time_s // 60:.0f}:{time_s % 60:04.1f}</b> {escape(text)}"
        items += f'<li><button type="button" data-time="{time_s:.4f}">{label}</button></li>'
    return f"<h3>{escape(kind)}</h3><ul>{items}</ul>" if items else ""


# Curves over time.


def _draw_curves(telemetry: Telemetry) -> str:
    """Offset, curvature and confidence over time as HTML."""
    time_s, offset_m, offset_std_m = (telemetry[name] for name in ("time_s", "offset_m", "offset_std_m"))
    per_km, std_per_km = 1000 * telemetry["curvature_per_m"], 1000 * telemetry["curvature_std_per_m"]
    bend = "per km, > 0: bends left; 1 per km is a radius of 1 km"
    correct = "probability of an error below 0.2 m"
    return (
        draw_curve("Offset", "m, > 0: left of the lane centre", offset_m, offset_std_m, (-0.5, 0.5), time_s)
        + draw_curve("Curvature", bend, per_km, std_per_km, (-1.0, 1.0), time_s)
        + draw_curve("Confidence", correct, telemetry["confidence"], None, (0.0, 1.0), time_s)
    )


def draw_curve(
    title: str, unit: str, values: np.ndarray, std: np.ndarray | None, span: tuple[float, float], time_s: np.ndarray
) -> str:
    """A measured quantity over time as an HTML <figure> with caption, tick labels, curve and band.

    `values` (frames,) are NaN without a measurement. The band is one standard deviation `std` wide to either side.
    `span` is the range that the axis covers at least.
    """
    ticks = _ticks(values, span)

    def to_y(values: np.ndarray) -> np.ndarray:
        return HEIGHT * (ticks[-1] - values) / (ticks[-1] - ticks[0])

    x = _time_to_x(time_s)
    labels = "".join(f'<span style="top:{y:.1f}%">{v:g}</span>' for v, y in zip(ticks, to_y(ticks), strict=True))
    grid = "".join(f"M0 {y:.2f}H{WIDTH}" for y in to_y(ticks))
    band = "" if std is None else f'<path class="band" d="{_band(x, to_y(values + std), to_y(values - std))}"/>'
    return (
        f'<figure class="curve" id="curve-{escape(title.lower())}">'
        f"<figcaption>{escape(title)} <small>{escape(unit)}</small></figcaption>"
        f'<div class="ticks" aria-hidden="true">{labels}</div>'
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" preserveAspectRatio="none" aria-hidden="true">'
        f'<path class="grid" d="{grid}"/>{band}<path class="line" d="{_line(x, to_y(values))}"/>'
        "</svg></figure>"
    )


def _ticks(values: np.ndarray, span: tuple[float, float]) -> np.ndarray:
    """Values with a tick label: the limits of the axis, and three to six round values between them."""
    low, high = span
    known = values[np.isfinite(values)]
    if len(known):
        quantiles = np.quantile(known, [(1 - AXIS_SHARE) / 2, (1 + AXIS_SHARE) / 2])
        low, high = min(low, quantiles[0]), max(high, quantiles[1])
    power = 10.0 ** np.floor(np.log10((high - low) / 4))
    step = min((power * m for m in (1, 2, 5, 10)), key=lambda step: abs(step - (high - low) / 4))
    return step * np.arange(np.floor(low / step + 1e-9), np.ceil(high / step - 1e-9) + 1)


def draw_states(state: np.ndarray, time_s: np.ndarray) -> str:
    """The states of shape (frames,) as an HTML <figure> with a strip of colours, and a legend with their shares."""
    edges = np.append(_time_to_x(time_s), WIDTH)
    bars = "".join(
        f'<path class="{escape(name)}" d="M{edges[first]:.2f} 0H{edges[end]:.2f}V{HEIGHT}H{edges[first]:.2f}Z"/>'
        for name, first, end in runs(state)
    )
    names = Counter(state.tolist()).most_common()
    legend = "".join(f'<li><i class="{escape(n)}"></i>{escape(n)} {k / len(state):.0%}</li>' for n, k in names)
    return (
        '<figure class="states"><figcaption>State</figcaption>'
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" preserveAspectRatio="none" aria-hidden="true">{bars}</svg></figure>'
        f'<ul class="legend">{legend}</ul>'
    )


def _time_to_x(time_s: np.ndarray) -> np.ndarray:
    """Horizontal positions of the frame times; the last frame ends at `WIDTH`."""
    since = time_s - time_s[0]
    last = np.median(np.diff(since)) if len(since) > 1 else 1.0
    return WIDTH * since / (since[-1] + last)


def _line(x: np.ndarray, y: np.ndarray) -> str:
    """An SVG path through the points; of a long curve the minimum and maximum of each of `MAX_COLUMNS` columns."""
    if len(x) > 2 * MAX_COLUMNS:
        kept = []
        for part in np.array_split(np.arange(len(x)), MAX_COLUMNS):
            known = part[np.isfinite(y[part])]
            kept += sorted({known[y[known].argmin()], known[y[known].argmax()]}) if len(known) else [part[0]]
        x, y = x[kept], y[kept]
    return "".join(_path(x[run], y[run]) for run in _finite_runs(y))


def _band(x: np.ndarray, high: np.ndarray, low: np.ndarray) -> str:
    """An SVG path around the area between two curves."""
    step = -(-len(x) // MAX_COLUMNS)
    x, high, low = x[::step], high[::step], low[::step]
    return "".join(
        _path(np.append(x[run], x[run][::-1]), np.append(high[run], low[run][::-1])) + "Z" for run in _finite_runs(low)
    )


def _path(x: np.ndarray, y: np.ndarray) -> str:
    return "M" + "L".join(f"{u:.2f} {v:.2f}" for u, v in zip(x, y, strict=True))


def _finite_runs(values: np.ndarray) -> list[slice]:
    return np.ma.clump_unmasked(np.ma.masked_invalid(values))
