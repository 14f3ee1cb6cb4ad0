"""The report of a drive as one HTML file that works offline in any browser.

A video of up to `MAX_EMBEDDED_BYTES` is embedded, so that the report can be sent by mail. A larger video is linked and
must stay in the same folder. File names and settings are escaped. A content security policy allows only the page's own
script, which draws the curves from the telemetry in the page.
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
