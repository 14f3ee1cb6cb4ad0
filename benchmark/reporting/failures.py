"""Where in a drive a system is not right, in words: what to look at first."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import groupby

import numpy as np

from benchmark.errors import FrameErrors
from benchmark.scores import Result

RIGHT, LOST, UNSURE, SURE, FALSE = "right", "lost", "wrong", "surely wrong", "a lane where there is none"


def describe_failures(results: Iterable[Result]) -> str:
    """A line for each drive that is not right throughout: when, how, and how far off."""
    lines = []
    for result in results:
        if spans := failures(result.errors, result.fps):
            lines.append(f"{result.scene}, {result.system}: " + "; ".join(spans))
    return "\n".join(lines)


def failures(errors: FrameErrors, fps: float) -> list[str]:
    """Spans of frames that fail alike, as "lost 1.20-1.84 s", those that are wrong with the largest error."""
    spans, at = [], 0
    for kind, group in groupby(frame_kinds(errors)):
        end = at + len(list(group))
        if kind != RIGHT:
            spans.append(f"{kind}{_how_far(errors.near_m[at:end])} {at / fps:.2f}-{end / fps:.2f} s")
        at = end
    return spans


def _how_far(near_m: np.ndarray) -> str:
    """The largest error, where there is one."""
    worst_m = np.nanmax(near_m, initial=-np.inf)
    if worst_m == np.inf:
        return " (a line turns back too soon)"
    return f" by {worst_m:.2f} m" if worst_m >= 0 else ""


def frame_kinds(errors: FrameErrors) -> list[str]:
    """What is to be said of each frame; an unsure lane where there is none is nothing to complain about."""
    cases = [errors.right | (~errors.exists & ~errors.confident), ~errors.exists, ~errors.given, errors.confident]
    return np.select(cases, [RIGHT, FALSE, LOST, SURE], UNSURE).tolist()
