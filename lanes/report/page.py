"""The report of a drive as one HTML file that works offline in any browser.

A video of up to `MAX_EMBEDDED_BYTES` is embedded, so that the report can be sent by mail. A larger video is linked and
must stay in the same folder. File names and settings are escaped. A content security policy allows only the page's own
script, which draws the curves and finds the worst moments in the telemetry of the page.
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

from lanes.detect.lane import LOST, TRACKING
from lanes.files import write_atomically

# Columns by name, arrays (frames,), as `lanes.files.read_telemetry` returns them.
Telemetry = Mapping[str, np.ndarray]
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


def share_tracked(telemetry: Telemetry) -> float:
    """Share of the frames with state "tracking", 0 to 1."""
    return float(np.mean(telemetry["state"] == TRACKING))


def seconds_lost(telemetry: Telemetry) -> float:
    """Total time with state "lost", seconds."""
    return float(frame_lengths_s(telemetry["time_s"])[telemetry["state"] == LOST].sum())


def describe_confidence(telemetry: Telemetry) -> str:
    """The median confidence where a lane is known, as ", median confidence 0.93"; empty without any."""
    confidence = telemetry["confidence"][telemetry["state"] != LOST]
    return f", median confidence {np.median(confidence):.2f}" if len(confidence) else ""


def frame_lengths_s(time_s: np.ndarray) -> np.ndarray:
    """Duration (N,) of each frame in seconds: until the next frame; the median duration for the last one."""
    steps = np.diff(time_s)
    return np.append(steps, np.median(steps) if len(steps) else 0.0)


def line_types(telemetry: Telemetry, side: str) -> np.ndarray:
    """Type (N,) of the "left" or "right" line in each frame, as text: "yellow double solid", or "unknown"."""
    columns = [_texts(telemetry, f"{side}_{name}") for name in ("colour", "double", "kind")]
    columns[1] = np.where(np.isin(columns[1], ("1", "1.0")), "double", "")
    return np.array([" ".join(filter(None, words)) or "unknown" for words in zip(*columns, strict=True)], str)


def _texts(telemetry: Telemetry, name: str) -> np.ndarray:
    """A column (N,) as text; empty where it has no value, or if there is no such column."""
    column = telemetry.get(name, np.full(len(telemetry["time_s"]), np.nan))
    return np.where(column.astype(str) == "nan", "", column.astype(str))


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
    """Data for the script: times since the first frame, texts, `PAGE_COLUMNS`, and where the line types change."""
    time_s = telemetry["time_s"] - telemetry["time_s"][0]
    columns = {name: _rounded(telemetry[name], digits) for name, digits in PAGE_COLUMNS.items()}
    for side in ("left", "right"):
        types = line_types(telemetry, side)
        changes = np.flatnonzero(np.append(True, types[1:] != types[:-1]))
        columns[f"{side}_types"] = [[int(k), str(types[k])] for k in changes]
    words = {name: _texts(telemetry, name).tolist() for name in ("state", "departure")}
    return {"time_s": _rounded(time_s, 4), **words, **columns}


def _rounded(values: np.ndarray, digits: int) -> list:
    return [round(float(v), digits) if np.isfinite(v) else None for v in values]
