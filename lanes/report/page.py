"""The report of a drive as one HTML file that works offline in any browser.

A video of up to `MAX_EMBEDDED_BYTES` is embedded, so that the report can be sent by mail. A larger video is linked and
must stay in the same folder. File names and settings are escaped. A content security policy allows only the page's own
script.
"""

from __future__ import annotations

import base64
import hashlib
import json
import os
import re
from collections.abc import Mapping
from html import escape
from importlib.resources import files
from pathlib import Path
from urllib.parse import quote

import numpy as np

from lanes.files import write_atomically
from lanes.report.curves import Curve, draw_curve, draw_states
from lanes.report.moments import Moment, Telemetry, seconds_lost, share_tracked, worst_moments

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


def write_report(
    path: str | Path,
    *,
    title: str,
    video: str | Path,
    telemetry: Telemetry,
    settings: Mapping[str, str],
    max_embedded_bytes: int = MAX_EMBEDDED_BYTES,
) -> Path:
    """Write the report of an annotated mp4 video into its folder; returns the `path`.

    `telemetry` is that of the video, as returned by `read_telemetry`. `settings` are shown as a table.

    Raises
    ------
    OSError
        If the video cannot be read or the report cannot be written.
    """
    video = Path(video)
    time_s = telemetry["time_s"]
    script = _asset("report.js")
    embedded = video.stat().st_size <= max_embedded_bytes
    page = _fill(
        _asset("report.html"),
        title=escape(title),
        summary=escape(_summary(telemetry)),
        video_name=escape(video.name),
        video_link=escape(quote(os.fsencode(video.name))),
        video_data=base64.b64encode(video.read_bytes()).decode() if embedded else "",
        style=_asset("report.css"),
        script=script,
        script_hash=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
        data=_script_safe_json(_frames(telemetry)),
        states=draw_states(telemetry["state"], time_s) + _legend(telemetry["state"]),
        curves="".join(draw_curve(curve, time_s) for curve in _curves(telemetry)),
        moments="".join(_moments(kind, moments) for kind, moments in worst_moments(telemetry).items() if moments),
        settings="".join(f"<tr><th>{escape(k)}</th><td>{escape(v)}</td></tr>" for k, v in settings.items()),
    )
    # File names may contain bytes that are not valid UTF-8.
    write_atomically(path, page.encode(errors="replace"))
    return Path(path)


def _asset(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")


def _fill(template: str, **parts: str) -> str:
    """The template with each {{name}} replaced. One pass, so that a {{name}} inside a part stays as it is."""
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], template)


def _script_safe_json(content: object) -> str:
    """JSON with "<" escaped, so that it cannot end the <script> element around it."""
    return json.dumps(content, separators=(",", ":")).replace("<", "\\u003c")


def _frames(telemetry: Telemetry) -> dict[str, list]:
    """Times since the first frame, states and `PAGE_COLUMNS`, for the script of the page."""
    time_s = telemetry["time_s"] - telemetry["time_s"][0]
    columns = {name: _rounded(telemetry[name], digits) for name, digits in PAGE_COLUMNS.items()}
    return {"time_s": _rounded(time_s, 4), "state": telemetry["state"].tolist(), **columns}


def _rounded(values: np.ndarray, digits: int) -> list[float | None]:
    return [round(float(v), digits) if np.isfinite(v) else None for v in values]


def _curves(telemetry: Telemetry) -> list[Curve]:
    per_km = 1000 * telemetry["curvature_per_m"], 1000 * telemetry["curvature_std_per_m"]
    offset = telemetry["offset_m"], telemetry["offset_std_m"]
    return [
        Curve("offset", "Offset", "m, > 0: left of the lane centre", *offset, (-0.5, 0.5)),
        Curve("curvature", "Curvature", "per km, > 0: bends left; 1 per km is a radius of 1 km", *per_km, (-1, 1)),
        Curve("confidence", "Confidence", "probability of an error below 0.2 m", telemetry["confidence"]),
    ]


def _legend(state: np.ndarray) -> str:
    names = sorted(set(state.tolist()), key=lambda name: -np.sum(state == name))
    items = (f'<li><i class="{escape(n)}"></i>{escape(n)} {np.mean(state == n):.0%}</li>' for n in names)
    return f'<ul class="legend">{"".join(items)}</ul>'


def _moments(kind: str, moments: list[Moment]) -> str:
    items = ""
    for moment in moments:
        minutes, seconds = divmod(moment.time_s, 60)
        text = f"<b>{minutes:.0f}:{seconds:04.1f}</b> {escape(moment.text)}"
        items += f'<li><button type="button" data-time="{moment.time_s:.4f}">{text}</button></li>'
    return f"<h3>{escape(kind)}</h3><ul>{items}</ul>"


def _summary(telemetry: Telemetry) -> str:
    time_s, offset_m = telemetry["time_s"], telemetry["offset_m"]
    lost_s = seconds_lost(telemetry)
    sentence = (
        f"{len(time_s)} frames, {time_s[-1] - time_s[0]:.1f} s. Lane tracked in {share_tracked(telemetry):.0%} of the "
        f"frames, {f'lost for {lost_s:.1f} s in total' if lost_s else 'never lost'}."
    )
    if not np.isfinite(offset_m).any():
        return sentence
    low, high, median = np.nanmin(offset_m), np.nanmax(offset_m), np.nanmedian(telemetry["confidence"])
    return f"{sentence} Offset from {low:+.2f} to {high:+.2f} m, median confidence {median:.2f}."
