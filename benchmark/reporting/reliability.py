"""Does the confidence keep its word? How often lanes of each confidence are right, and what is left of them.

Right is here what the confidence speaks of: both lines within 0.2 m over 5 to 30 m (`lanes.tracking.confidence`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from benchmark.errors import FrameErrors
from lanes.tracking.confidence import RIGHT_M

# Tenths, and the last one halved: most lanes are there.
EDGES = np.array([*np.arange(0, 0.95, 0.1), 0.95, 1.0])
# 95 % of a normal distribution lie within so many standard deviations.
Z = 1.96


@dataclass(frozen=True, eq=False)
class Reliability:
    """How often lanes were right, in bins of stated confidence; bins without lanes are left out.

    Parameters
    ----------
    stated : ndarray of shape (B,)
        Mean stated confidence.
    right, low, high : ndarray of shape (B,)
        Share that is right, and its 95 % interval.
    count : ndarray of shape (B,), int
        Lanes.
    """

    stated: np.ndarray
    right: np.ndarray
    low: np.ndarray
    high: np.ndarray
    count: np.ndarray


@dataclass(frozen=True, eq=False)
class Precision:
    """Share of lanes that are right, when only those above some confidence are taken, over the share of frames covered.

    Parameters
    ----------
    coverage, precision : ndarray of shape (K,)
        Of the frames with a lane, those in which one is given; and how many of the given ones are right.
    """

    coverage: np.ndarray
    precision: np.ndarray


@dataclass(frozen=True, eq=False)
class StatedLanes:
    """The lanes that a system gave in some frames.

    Parameters
    ----------
    confidence : ndarray of shape (M,)
        1 where none is stated.
    right, exists : ndarray of shape (M,), bool
        Whether it is right, and whether there is a lane at all.
    lane_frames : int
        Frames with a lane, given or not.
    """

    confidence: np.ndarray
    right: np.ndarray
    exists: np.ndarray
    lane_frames: int

    @classmethod
    def of(cls, drives: Iterable[FrameErrors]) -> StatedLanes:
        """From the errors of drives."""
        drives = list(drives)
        given = np.concatenate([drive.given for drive in drives])
        exists = np.concatenate([drive.exists for drive in drives])
        right = exists & (np.concatenate([drive.far_m for drive in drives]) <= RIGHT_M)
        confidence = np.nan_to_num(np.concatenate([drive.confidence for drive in drives]), nan=1.0)
        return cls(confidence[given], right[given], exists[given], int(exists.sum()))

    def reliability(self) -> Reliability:
        """Stated confidence against the share that is right."""
        place = np.clip(np.searchsorted(EDGES, self.confidence, side="right") - 1, 0, len(EDGES) - 2)
        bins = len(EDGES) - 1
        count = np.bincount(place, minlength=bins)
        stated, right = (np.bincount(place, of, bins)[count > 0] for of in (self.confidence, self.right))
        count = count[count > 0]
        return Reliability(stated / count, right / count, *wilson_interval(right, count), count)

    def precision(self) -> Precision:
        """What is right among the lanes above each confidence that occurs, from the highest to the lowest."""
        order = np.argsort(-self.confidence, kind="stable")
        last = np.flatnonzero(np.diff(self.confidence[order], append=-1.0))
        right, covered = np.cumsum(self.right[order])[last], np.cumsum(self.exists[order])[last]
        return Precision(covered / max(self.lane_frames, 1), right / (last + 1))


def wilson_interval(right: np.ndarray, count: np.ndarray, *, z: float = Z) -> tuple[np.ndarray, np.ndarray]:
    """Limits of a share of which `right` of `count` independent trials are known, at `z` standard deviations.

    E. B. Wilson, "Probable inference, the law of succession, and statistical inference", JASA 22, 1927. Frames of a
    drive are not independent, so that the true interval is wider.
    """
    share = right / count
    middle = (share + z**2 / (2 * count)) / (1 + z**2 / count)
    half = z / (1 + z**2 / count) * np.sqrt(share * (1 - share) / count + z**2 / (4 * count**2))
    # at 0 and 1 rounding would put the share itself outside
    return np.clip(middle - half, 0.0, share), np.clip(middle + half, share, 1.0)
