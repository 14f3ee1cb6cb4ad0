"""Calibration of the confidence: reliability diagram, and precision when only the most confident lanes are used.

A lane is correct here if both lines are within 0.2 m over 5 to 30 m: the confidence is the probability of that
(`lanes.tracking.confidence`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from benchmark.errors import FrameErrors
from lanes.tracking.confidence import CORRECT_WITHIN_M

# Steps of 0.1; the last one is halved, because most lanes are in it.
BIN_EDGES = np.array([*np.arange(0, 0.95, 0.1), 0.95, 1.0])
# 95 % of a normal distribution lie within 1.96 standard deviations.
Z_95 = 1.96


class Reliability(NamedTuple):
    """Accuracy of the lanes in B bins of confidence; bins without lanes are left out.

    Mean confidence, share of correct lanes with its 95 % interval, and number of lanes in each bin.
    """

    confidence: np.ndarray
    accuracy: np.ndarray
    low: np.ndarray
    high: np.ndarray
    counts: np.ndarray


class PrecisionCurve(NamedTuple):
    """Precision of the lanes above a confidence, against the share of frames in which such a lane is available.

    `available` (K,) is the share of the frames with a true lane in which a lane is used, `precision` (K,) the share of
    the used lanes that is correct.
    """

    available: np.ndarray
    precision: np.ndarray


@dataclass(frozen=True, eq=False)
class AvailableLanes:
    """The M lanes that a system reported in some frames: confidence (1 if none is stated), correct, true lane exists.

    `lane_frames` is the number of frames with a true lane, including those in which the system reported none.
    """

    confidence: np.ndarray
    correct: np.ndarray
    exists: np.ndarray
    lane_frames: int

    @classmethod
    def from_errors(cls, drives: Iterable[FrameErrors]) -> AvailableLanes:
        """From the errors of drives."""
        drives = list(drives)
        available = np.concatenate([drive.available for drive in drives])
        exists = np.concatenate([drive.exists for drive in drives])
        correct = exists & (np.concatenate([drive.full_rms_m for drive in drives]) <= CORRECT_WITHIN_M)
        confidence = np.nan_to_num(np.concatenate([drive.confidence for drive in drives]), nan=1.0)
        return cls(confidence[available], correct[available], exists[available], int(exists.sum()))

    def reliability(self) -> Reliability:
        """The reliability diagram: accuracy against confidence."""
        bins = len(BIN_EDGES) - 1
        index = np.clip(np.searchsorted(BIN_EDGES, self.confidence, side="right") - 1, 0, bins - 1)
        count = np.bincount(index, minlength=bins)
        confidence, correct = (np.bincount(index, w, bins)[count > 0] for w in (self.confidence, self.correct))
        count = count[count > 0]
        return Reliability(confidence / count, correct / count, *wilson_interval(correct, count), count)

    def precision_curve(self) -> PrecisionCurve:
        """Precision of the lanes above each confidence that occurs, from the highest to the lowest."""
        order = np.argsort(-self.confidence, kind="stable")
        last = np.flatnonzero(np.diff(self.confidence[order], append=-1.0))
        correct, covered = np.cumsum(self.correct[order])[last], np.cumsum(self.exists[order])[last]
        return PrecisionCurve(covered / max(self.lane_frames, 1), correct / (last + 1))


def wilson_interval(successes: np.ndarray, count: np.ndarray, *, z: float = Z_95) -> tuple[np.ndarray, np.ndarray]:
    """Wilson score interval of a proportion: lower and upper limit at `z` standard deviations.

    E. B. Wilson, "Probable inference, the law of succession, and statistical inference", JASA 22, 1927. It assumes
    independent trials. Frames of a drive are correlated, so the true interval is wider.
    """
    share = successes / count
    middle = (share + z**2 / (2 * count)) / (1 + z**2 / count)
    half = z / (1 + z**2 / count) * np.sqrt(share * (1 - share) / count + z**2 / (4 * count**2))
    # clipped, because rounding could exclude the share itself at 0 and 1
    return np.clip(middle - half, 0.0, share), np.clip(middle + half, share, 1.0)
