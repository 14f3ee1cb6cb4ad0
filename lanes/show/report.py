"""The report of a drive as one HTML file that works offline in any browser.

A video of up to `_MAX_EMBEDDED_BYTES` is embedded, so that the report can be sent by mail. A larger video is linked and
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
from collections.abc import Callable, Mapping, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from urllib.parse import quote

import numpy as np

from lanes.describe import describe_bend, describe_offset
from lanes.detect.confidence import LEAST_CONFIDENCE, LIKELY_CONFIDENCE, SURE_CONFIDENCE
from lanes.detect.lane import LOST, TRACKING
from lanes.files import write_atomically

# Columns by name, arrays (frames,), as `lanes.files.read_telemetry` returns them.
Telemetry = Mapping[str, np.ndarray]
# Base64 makes it 4/3 as large: below the limit of most mail servers, 25 MB.
_MAX_EMBEDDED_BYTES = 16_000_000
# Telemetry columns in the page, with their number of decimals.
_PAGE_COLUMNS = {
    "frame": 0,
    "offset_m": 4,
    "offset_std_m": 4,
    "curvature_per_m": 6,
    "curvature_std_per_m": 6,
    "confidence": 3,
    "lane_width_m": 2,
}
# Classes of the confidence, best first: name, smallest confidence, words. A lost lane is in the last one.
_LEVELS = (
    ("sure", SURE_CONFIDENCE, f"confidence {SURE_CONFIDENCE:g} or more"),
    ("likely", LIKELY_CONFIDENCE, f"{LIKELY_CONFIDENCE:g} to {SURE_CONFIDENCE:g}"),
    ("uncertain", LEAST_CONFIDENCE, f"below {LIKELY_CONFIDENCE:g}"),
    ("none", 0.0, "no lane"),
)


def write_report(
    path: str | Path,
    *,
    title: str,
    video: str | Path,
    telemetry: Telemetry,
    settings: Mapping[str, str],
    warnings: Sequence[str] = (),
    command: str = "",
    max_embedded_bytes: int = _MAX_EMBEDDED_BYTES,
) -> Path:
    """Write the report of an annotated mp4 video with its telemetry into its folder; returns the `path`.

    `settings` are shown as a table, `warnings` at the top. `command` explains the frame at the seconds that follow it.
    """
    video = Path(video)
    embedded = video.stat().st_size <= max_embedded_bytes
    parts = {
        "title": escape(title),
        "kind": "lane report",
        "summary": escape(_summary(telemetry)),
        "warnings": "".join(f"<li>{escape(warning)}</li>" for warning in warnings),
        "video_name": escape(video.name),
        "video_link": escape(quote(os.fsencode(video.name))),
        "video_data": base64.b64encode(video.read_bytes()).decode() if embedded else "",
        "settings": "".join(f"<tr><th>{escape(k)}</th><td>{escape(v)}</td></tr>" for k, v in settings.items()),
    }
    return fill_page(
        path,
        "report",
        parts,
        _frames(telemetry) | {"command": command, "levels": {name: words for name, _, words in _LEVELS}},
    )


def fill_page(path: str | Path, name: str, parts: Mapping[str, str], data: object) -> Path:
    """Write a page with the body `name`.html, whose script `name`.js reads the data; returns the `path`."""
    script = _asset(f"{name}.js")
    script_hash = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    # With "<" escaped, so that it cannot end the <script> element around it.
    text = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    style = _asset("page.css") + _asset(f"{name}.css")
    parts = {"style": style, "script": script, "script_hash": script_hash, "data": text, **parts}
    template = _asset("page.html").replace("{{body}}", _asset(f"{name}.html"))
    # In one pass, so that a {{name}} inside a part stays as it is.
    page = re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], template)
    # File names may contain bytes that are not valid UTF-8.
    write_atomically(path, page.encode(errors="replace"))
    return Path(path)


def _asset(name: str) -> str:
    return files("lanes").joinpath("show", "pages", name).read_text(encoding="utf-8")


def share_tracked(telemetry: Telemetry) -> float:
    """Share of the frames with state "tracking", 0 to 1."""
    return float(np.mean(telemetry["state"] == TRACKING))


def _confidence_levels(telemetry: Telemetry) -> np.ndarray:
    """Name (N,) of the class of `_LEVELS` of each frame."""
    confidence = np.where(telemetry["state"] == LOST, 0.0, telemetry["confidence"])
    names, least, _ = zip(*_LEVELS, strict=True)
    return np.array(names)[(confidence[:, None] < least).sum(axis=1)]


def describe_shares(telemetry: Telemetry) -> str:
    """How many of the frames have which confidence, as "confidence 0.9 or more in 78%, 0.5 to 0.9 in 9%, ..."."""
    levels = _confidence_levels(telemetry)
    return ", ".join(f"{words} in {np.mean(levels == name):.0%}" for name, _, words in _LEVELS) + " of them"


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
        f"{len(time_s)} frames, {time_s[-1] - time_s[0]:.1f} s; {describe_shares(telemetry)}; "
        f"{f'lost for {lost_s:.1f} s in total' if lost_s else 'never lost'}."
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
    """Data for the script: times since the first frame, texts, `_PAGE_COLUMNS`, and where words change."""
    time_s = telemetry["time_s"] - telemetry["time_s"][0]
    columns = {name: _rounded(telemetry[name], digits) for name, digits in _PAGE_COLUMNS.items()}
    words = {
        "left_types": line_types(telemetry, "left"),
        "right_types": line_types(telemetry, "right"),
        "bend": _words(describe_bend, telemetry["curvature_per_m"], telemetry["curvature_std_per_m"]),
        "offset": _words(describe_offset, telemetry["offset_m"], telemetry["offset_std_m"]),
    }
    texts = {name: _texts(telemetry, name).tolist() for name in ("state", "departure")}
    texts["level"] = _confidence_levels(telemetry).tolist()
    changes = {name: _changes(column) for name, column in words.items()}
    return {
        "time_s": _rounded(time_s, 4),
        "first_s": round(float(telemetry["time_s"][0]), 4),
        **texts,
        **changes,
        **columns,
    }


def _changes(words: np.ndarray) -> list[tuple[int, str]]:
    """The frames at which words (N,) change, and the words from then on."""
    changes = np.flatnonzero(np.append(True, words[1:] != words[:-1]))
    return [(int(k), str(words[k])) for k in changes]


def _words(describe: Callable[..., str], values: np.ndarray, stds: np.ndarray) -> np.ndarray:
    """Measurements (N,) with their standard deviations (N,) in the words of the overlay."""
    pairs = zip(values, stds, strict=True)
    return np.array([describe(value, std) if np.isfinite(value) else describe(None) for value, std in pairs])


def _rounded(values: np.ndarray, digits: int) -> list:
    return [round(float(v), digits) if np.isfinite(v) else None for v in values]
