"""What a drive's telemetry has to tell: how much of it was tracked, and where it went worst."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from lanes.tracking.tracked_lane import COASTING, LOST, TRACKING

# So many of each kind, and at least so far apart: two beside each other show the same thing.
MOST, APART_S = 3, 2.0

Telemetry = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Moment:
    """A place in the drive worth a look: seconds since its first frame, and what is there."""

    time_s: float
    text: str


def share_tracked(telemetry: Telemetry) -> float:
    """Share of the frames whose state is "tracking"."""
    return float(np.mean(telemetry["state"] == TRACKING))


def seconds_lost(telemetry: Telemetry) -> float:
    """How long the state was "lost"."""
    return float(frame_lengths_s(telemetry["time_s"])[telemetry["state"] == LOST].sum())


def frame_lengths_s(time_s: np.ndarray) -> np.ndarray:
    """How long each frame (N,) is shown: until the next one; the last as long as most."""
    steps = np.diff(time_s)
    return np.append(steps, np.median(steps) if len(steps) else 0.0)


def worst_moments(telemetry: Telemetry) -> dict[str, list[Moment]]:
    """Where to look first, by kind; the worst of each kind first.

    Parameters
    ----------
    telemetry : mapping of str to ndarray of shape (frames,)
        As `read_telemetry` gives it: time_s, state, confidence, offset_std_m, curvature_std_per_m, and departure
        ("left", "right", or empty) where it was watched for.

    Returns
    -------
    dict of str to list of Moment
        Kinds of which there is nothing to tell have an empty list.
    """
    confidence = np.where(telemetry["state"] == LOST, np.nan, telemetry["confidence"])
    departures = _spans(telemetry, np.asarray(telemetry.get("departure", []), str), ("left", "right"))
    return {
        "Lane not seen": [
            Moment(start_s, f"{state} for {length_s:.1f} s")
            for state, start_s, length_s in _longest(_spans(telemetry, telemetry["state"], (LOST, COASTING)))
        ],
        "Lane departures": [
            Moment(start_s, f"towards the {side} line, {length_s:.1f} s")
            for side, start_s, length_s in _longest(departures)
        ],
        "Lowest confidence": [
            Moment(time_s, f"confidence {value:.2f}") for time_s, value in _lowest(telemetry, confidence)
        ],
        "Least certain offset": [
            Moment(time_s, f"± {-value:.2f} m") for time_s, value in _lowest(telemetry, -telemetry["offset_std_m"])
        ],
        "Least certain bend": [
            Moment(time_s, f"± {-1000 * value:.2f} per km")
            for time_s, value in _lowest(telemetry, -telemetry["curvature_std_per_m"])
        ],
    }


def runs(labels: np.ndarray) -> Iterator[tuple[str, int, int]]:
    """Runs of equal labels (N,): (label, first, one past the last)."""
    edges = np.unique([0, *(1 + np.flatnonzero(labels[1:] != labels[:-1])), len(labels)])
    for first, end in pairwise(edges):
        yield str(labels[first]), int(first), int(end)


def _spans(telemetry: Telemetry, labels: np.ndarray, wanted: tuple[str, ...]) -> list[tuple[str, float, float]]:
    """(label, start, length) in seconds of the runs of wanted labels."""
    time_s, lengths_s = telemetry["time_s"] - telemetry["time_s"][0], frame_lengths_s(telemetry["time_s"])
    return [
        (label, float(time_s[first]), float(lengths_s[first:end].sum()))
        for label, first, end in runs(labels)
        if label in wanted
    ]


def _longest(spans: list[tuple[str, float, float]]) -> list[tuple[str, float, float]]:
    return sorted(spans, key=lambda span: -span[2])[:MOST]


def _lowest(telemetry: Telemetry, values: np.ndarray) -> Iterator[tuple[float, float]]:
    """(time, value) of the lowest values (N,), each the lowest around it and apart from the others; NaN never is."""
    time_s = telemetry["time_s"] - telemetry["time_s"][0]
    values = np.where(np.isfinite(values), values, np.inf)
    around = max(1, round(APART_S / 2 / np.median(np.diff(time_s)))) if len(time_s) > 1 else 1
    padded = np.pad(values, around, constant_values=np.inf)
    dips = np.flatnonzero(np.isfinite(values) & (values == sliding_window_view(padded, 2 * around + 1).min(axis=1)))
    taken: list[int] = []
    for at in dips[np.argsort(values[dips], kind="stable")]:
        if len(taken) < MOST and all(abs(time_s[at] - time_s[other]) >= APART_S for other in taken):
            taken.append(at)
            yield float(time_s[at]), float(values[at])
