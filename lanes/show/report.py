"""The report of a drive as one HTML file that works offline in any browser.

A video of up to `_MAX_EMBEDDED_BYTES` is embedded, so that the report can be sent by
mail. A larger video is linked and must stay in the same folder. The pages are templates
of Jinja, which escapes file names and settings. A content security policy allows only
the page's own script, which draws the curves and finds the worst moments in the
telemetry of the page; the page of scores has none.
"""

from __future__ import annotations

import base64
import hashlib
import os
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import numpy as np

from lanes.describe import describe_bend, describe_offset
from lanes.detect.confidence import (
    LEAST_CONFIDENCE,
    LIKELY_CONFIDENCE,
    SURE_CONFIDENCE,
)
from lanes.detect.lane import TRACKING
from lanes.files import write_atomically
from lanes.telemetry import LOST, Telemetry

if TYPE_CHECKING:
    from jinja2 import Environment

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
# Smallest confidence of each class, best first, and its words. A lost lane is in the
# last one.
_LEAST_OF_LEVEL = {
    "sure": SURE_CONFIDENCE,
    "likely": LIKELY_CONFIDENCE,
    "uncertain": LEAST_CONFIDENCE,
    "none": 0.0,
}
_LEVEL_WORDS = {
    "sure": f"confidence {SURE_CONFIDENCE:g} or more",
    "likely": f"{LIKELY_CONFIDENCE:g} to {SURE_CONFIDENCE:g}",
    "uncertain": f"below {LIKELY_CONFIDENCE:g}",
    "none": "no lane",
}


def write_report(  # noqa: PLR0913 (options, called by name)
    path: str | Path,
    *,
    title: str,
    video: str | Path,
    telemetry: Telemetry,
    settings: Mapping[str, str],
    warnings: Sequence[str] = (),
    command: str = "",
    other_poses: Sequence[tuple[int, str]] = (),
    max_embedded_bytes: int = _MAX_EMBEDDED_BYTES,
) -> Path:
    """Write the report of an annotated mp4 video with its telemetry into its folder.

    `settings` are shown as a table, `warnings` at the top. `command` explains the frame
    at the seconds that follow it. `other_poses` are the rows from which on the lane was
    found with another camera pose, and the poses in words. Returns the `path`.
    """
    video = Path(video)
    video_data = ""
    if video.stat().st_size <= max_embedded_bytes:
        video_data = base64.b64encode(video.read_bytes()).decode()
    script = _read_asset("report.js")
    digest = hashlib.sha256(script.encode()).digest()
    return write_page(
        path,
        "report",
        {
            "title": title,
            "summary": _summary(telemetry),
            "warnings": warnings,
            "video_name": video.name,
            "video_link": quote(os.fsencode(video.name)),
            "video_data": video_data,
            "settings": settings,
            "script": script,
            "script_hash": base64.b64encode(digest).decode(),
            "data": {
                **_frames(telemetry),
                "command": command,
                "levels": _LEVEL_WORDS,
                "poses": list(other_poses),
            },
        },
    )


def write_page(path: str | Path, name: str, values: Mapping[str, Any]) -> Path:
    """Write the page of the template `name`.html; returns the `path`.

    All `values` are escaped, except those that the template marks as safe.
    """
    style = _read_asset("page.css") + _read_asset(f"{name}.css")
    template = _templates().get_template(f"{name}.html")
    page = template.render(values, style=style)
    # File names may contain bytes that are not valid UTF-8.
    write_atomically(path, page.encode(errors="replace"))
    return Path(path)


@lru_cache(maxsize=1)
def _templates() -> Environment:
    # Imported here: commands without a page start sooner.
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    templates = Environment(
        loader=FunctionLoader(_read_asset),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.policies["json.dumps_kwargs"] = {
        "separators": (",", ":"),
        "allow_nan": False,
    }
    return templates


def _read_asset(name: str) -> str:
    return files("lanes").joinpath("show", "pages", name).read_text(encoding="utf-8")


def share_tracked(telemetry: Telemetry) -> float:
    """Share of the frames with state "tracking", 0 to 1."""
    return float(np.mean(telemetry["state"] == TRACKING))


def _confidence_levels(telemetry: Telemetry) -> np.ndarray:
    """Name (N,) of the class of `_LEAST_OF_LEVEL` of each frame."""
    lost = telemetry["state"] == LOST
    confidence = np.where(lost, 0.0, telemetry["confidence"])
    least = np.array(list(_LEAST_OF_LEVEL.values()))
    better_classes = (confidence[:, None] < least).sum(axis=1)
    return np.array(list(_LEAST_OF_LEVEL))[better_classes]


def describe_shares(telemetry: Telemetry) -> str:
    """How many of the frames have which confidence.

    As "confidence 0.9 or more in 78%, 0.5 to 0.9 in 9%, ...".
    """
    levels = _confidence_levels(telemetry)
    shares = []
    for name, words in _LEVEL_WORDS.items():
        share = np.mean(levels == name)
        shares.append(f"{words} in {share:.0%}")
    return f"{', '.join(shares)} of them"


def seconds_lost(telemetry: Telemetry) -> float:
    """Total time with state "lost", seconds."""
    lost = telemetry["state"] == LOST
    return float(frame_lengths_s(telemetry["time_s"])[lost].sum())


def describe_confidence(telemetry: Telemetry) -> str:
    """The median confidence where a lane is known, as ", median confidence 0.93".

    Empty without any.
    """
    known = telemetry["state"] != LOST
    if not known.any():
        return ""
    median = np.median(telemetry["confidence"][known])
    return f", median confidence {median:.2f}"


def frame_lengths_s(time_s: np.ndarray) -> np.ndarray:
    """Duration (N,) of each frame in seconds: until the next frame.

    The last one has the median duration.
    """
    steps_s = np.diff(time_s)
    last_s = np.median(steps_s) if len(steps_s) else 0.0
    return np.append(steps_s, last_s)


def line_types(telemetry: Telemetry, side: str) -> np.ndarray:
    """Type (N,) of the "left" or "right" line in each frame, as text.

    Such as "yellow double solid", or "unknown".
    """
    colours = _texts(telemetry, f"{side}_colour")
    is_double = np.isin(_texts(telemetry, f"{side}_double"), ("1", "1.0"))
    kinds = _texts(telemetry, f"{side}_kind")
    types = []
    for colour, double, kind in zip(colours, is_double, kinds, strict=True):
        words = [colour, "double" if double else "", kind]
        types.append(" ".join(filter(None, words)) or "unknown")
    return np.array(types, str)


def _texts(telemetry: Telemetry, name: str) -> np.ndarray:
    """A column (N,) as text; empty where it has no value, or if there is none."""
    if name not in telemetry:
        return np.full(len(telemetry["time_s"]), "")
    texts = telemetry[name].astype(str)
    return np.where(texts == "nan", "", texts)


def _summary(telemetry: Telemetry) -> str:
    time_s, offset_m = telemetry["time_s"], telemetry["offset_m"]
    lost_s = seconds_lost(telemetry)
    lost = f"lost for {lost_s:.1f} s in total" if lost_s else "never lost"
    sentence = (
        f"{len(time_s)} frames, {time_s[-1] - time_s[0]:.1f} s; "
        f"{describe_shares(telemetry)}; {lost}."
    )
    if not np.isfinite(offset_m).any():
        return sentence

    confidence = np.nanmedian(telemetry["confidence"])
    left = _most_common(line_types(telemetry, "left"))
    right = _most_common(line_types(telemetry, "right"))
    return (
        f"{sentence} Offset from {np.nanmin(offset_m):+.2f} to "
        f"{np.nanmax(offset_m):+.2f} m, median confidence {confidence:.2f}. "
        f"Most of the time the left line is {left}, the right line {right}."
    )


def _most_common(texts: np.ndarray) -> str:
    ((text, _),) = Counter(texts.tolist()).most_common(1)
    return text


def _frames(telemetry: Telemetry) -> dict[str, Any]:
    """Data for the script: times since the first frame, texts, columns, words.

    Words are given for the frames at which they change.
    """
    first_s = telemetry["time_s"][0]
    bend_words = _describe(
        describe_bend, telemetry["curvature_per_m"], telemetry["curvature_std_per_m"]
    )
    offset_words = _describe(
        describe_offset, telemetry["offset_m"], telemetry["offset_std_m"]
    )
    data: dict[str, Any] = {
        "time_s": _rounded(telemetry["time_s"] - first_s, 4),
        "first_s": round(float(first_s), 4),
        "state": _texts(telemetry, "state").tolist(),
        "departure": _texts(telemetry, "departure").tolist(),
        "level": _confidence_levels(telemetry).tolist(),
        "left_types": _changes(line_types(telemetry, "left")),
        "right_types": _changes(line_types(telemetry, "right")),
        "bend": _changes(bend_words),
        "offset": _changes(offset_words),
    }
    for name, digits in _PAGE_COLUMNS.items():
        data[name] = _rounded(telemetry[name], digits)
    return data


def _changes(words: np.ndarray) -> list[tuple[int, str]]:
    """The frames at which words (N,) change, and the words from then on."""
    changed = np.append(True, words[1:] != words[:-1])
    return [(int(frame), str(words[frame])) for frame in np.flatnonzero(changed)]


def _describe(
    describe: Callable[..., str], values: np.ndarray, stds: np.ndarray
) -> np.ndarray:
    """Values (N,) with standard deviations (N,) in the words of the overlay."""
    words = []
    for value, std in zip(values, stds, strict=True):
        known = np.isfinite(value)
        words.append(describe(value, std) if known else describe(None))
    return np.array(words)


def _rounded(values: np.ndarray, digits: int) -> list[float | None]:
    """The values (N,) as numbers of JSON; None where there is none."""
    known = np.isfinite(values)
    return [
        round(float(value), digits) if is_known else None
        for value, is_known in zip(values, known, strict=True)
    ]
