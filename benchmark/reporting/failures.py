"""The failures of a system on a drive, in words: spans of frames, the kind of failure, the largest error."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import groupby

import numpy as np

from benchmark.errors import FrameErrors
from benchmark.result import Result

CORRECT, LOST, WRONG = "correct", "lost", "wrong"
CONFIDENT_AND_WRONG, FALSE_LANE = "confident and wrong", "a lane where none exists"


def describe_failures(results: Iterable[Result]) -> str:
    """A line for each drive with failures: kind, largest error and time span of each."""
    lines = []
    for result in results:
        if spans := failure_spans(result.errors, result.fps):
            lines.append(f"{result.scene}, {result.system}: " + "; ".join(spans))
    return "\n".join(lines)


def failure_spans(errors: FrameErrors, fps: float) -> list[str]:
    """Spans of consecutive frames with the same kind of failure, as "lost 1.20-1.84 s" or "wrong by 0.50 m ..."."""
    spans, at = [], 0
    for kind, group in groupby(frame_kinds(errors)):
        end = at + len(list(group))
        if kind != CORRECT:
            spans.append(f"{kind}{_largest_error(errors.near_rms_m[at:end])} {at / fps:.2f}-{end / fps:.2f} s")
        at = end
    return spans


def _largest_error(near_rms_m: np.ndarray) -> str:
    """The largest error in words; empty if all are NaN."""
    worst_m = np.nanmax(near_rms_m, initial=-np.inf)
    return f" by {worst_m:.2f} m" if worst_m >= 0 else ""


def frame_kinds(errors: FrameErrors) -> list[str]:
    """The kind of each frame; where no lane exists, a lane reported without confidence is no failure."""
    correct = errors.correct | (~errors.exists & ~errors.confident)
    cases = [correct, ~errors.exists, ~errors.available, errors.confident]
    return np.select(cases, [CORRECT, FALSE_LANE, LOST, CONFIDENT_AND_WRONG], WRONG).tolist()
