"""What a drive's telemetry says as a whole: tracked share, time lost, types of the lines, and the worst moments.

Telemetry is a mapping of column names to arrays (frames,), as `read_telemetry` returns it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from lanes.describe import describe_std
from lanes.detect.lane import COASTING, LOST, TRACKING

# Largest number of moments of a kind, and the least time between two: closer ones show the same situation.
MAX_MOMENTS, MIN_SPACING_S = 3, 2.0

Telemetry = Mapping[str, np.ndarray]
# A moment of the drive: seconds since its first frame, and a text.
Moment = tuple[float, str]


def share_tracked(telemetry: Telemetry) -> float:
    """Share of the frames with state "tracking", 0 to 1."""
    return float(np.mean(telemetry["state"] == TRACKING))


def seconds_lost(telemetry: Telemetry) -> float:
    """Total time with state "lost", seconds."""
    return float(frame_lengths_s(telemetry["time_s"])[telemetry["state"] == LOST].sum())


def frame_lengths_s(time_s: np.ndarray) -> np.ndarray:
    """Duration (N,) of each frame in seconds: until the next frame; the median duration for the last one."""
    steps = np.diff(time_s)
    return np.append(steps, np.median(steps) if len(steps) else 0.0)


def line_types(telemetry: Telemetry, side: str) -> np.ndarray:
    """Type (N,) of the "left" or "right" line in each frame, as text: "yellow double solid", or "unknown"."""
    columns = [_texts(telemetry, f"{side}_{name}") for name in ("colour", "double", "kind")]
    columns[1] = np.where(np.isin(columns[1], ("1", "1.0")), "double", "")
    return np.array([" ".join(filter(None, words)) or "unknown" for words in zip(*columns, strict=True)], str)


def worst_moments(telemetry: Telemetry) -> dict[str, list[Moment]]:
    """The worst moments of a drive by kind, from the worst on; the list of a kind that does not occur is empty."""
    state, departure = telemetry["state"], _texts(telemetry, "departure")
    confidence = np.where(state == LOST, np.nan, telemetry["confidence"])
    # Negative, so that the largest standard deviations are the lowest values.
    offset_m, bend_per_km = -telemetry["offset_std_m"], -1000 * telemetry["curvature_std_per_m"]
    return {
        "Lane not seen": _longest(telemetry, state, (LOST, COASTING), "{} for {:.1f} s"),
        "Lane departures": _longest(telemetry, departure, ("left", "right"), "towards the {} line, {:.1f} s"),
        "Lowest confidence": _lowest(telemetry, confidence, "confidence {:.2f}".format),
        "Least certain offset": _lowest(telemetry, offset_m, lambda std_m: f"± {describe_std(std_m)} m"),
        "Least certain bend": _lowest(telemetry, bend_per_km, "± {:.2f} per km".format),
    }


def runs(labels: np.ndarray) -> Iterator[tuple[str, int, int]]:
    """Runs of equal labels (N,) as (label, first index, one past the last index)."""
    edges = np.unique([0, *(1 + np.flatnonzero(labels[1:] != labels[:-1])), len(labels)])
    for first, end in pairwise(edges):
        yield str(labels[first]), int(first), int(end)


def _texts(telemetry: Telemetry, name: str) -> np.ndarray:
    """A column (N,) as text; empty where it has no value, or if there is no such column."""
    column = telemetry.get(name, np.full(len(telemetry["time_s"]), np.nan))
    return np.where(column.astype(str) == "nan", "", column.astype(str))


def _longest(telemetry: Telemetry, labels: np.ndarray, wanted: tuple[str, ...], text: str) -> list[Moment]:
    """The longest runs of the wanted labels; `text` is a format of label and seconds."""
    time_s, lengths_s = telemetry["time_s"] - telemetry["time_s"][0], frame_lengths_s(telemetry["time_s"])
    spans = [(label, first, float(lengths_s[first:end].sum())) for label, first, end in runs(labels) if label in wanted]
    spans = sorted(spans, key=lambda span: -span[2])[:MAX_MOMENTS]
    return [(float(time_s[first]), text.format(label, length_s)) for label, first, length_s in spans]


def _lowest(telemetry: Telemetry, values: np.ndarray, describe: Callable[[float], str]) -> list[Moment]:
    """The lowest local minima of values (N,), at least `MIN_SPACING_S` apart; `describe` words their size."""
    time_s = telemetry["time_s"] - telemetry["time_s"][0]
    values = np.where(np.isfinite(values), values, np.inf)
    radius = max(1, round(MIN_SPACING_S / 2 / np.median(np.diff(time_s)))) if len(time_s) > 1 else 1
    padded = np.pad(values, radius, constant_values=np.inf)
    minima = np.flatnonzero(np.isfinite(values) & (values == sliding_window_view(padded, 2 * radius + 1).min(axis=1)))
    chosen: list[int] = []
    for frame in minima[np.argsort(values[minima], kind="stable")]:
        if len(chosen) < MAX_MOMENTS and all(abs(time_s[frame] - time_s[c]) >= MIN_SPACING_S for c in chosen):
            chosen.append(frame)
    return [(float(time_s[frame]), describe(abs(values[frame]))) for frame in chosen]
