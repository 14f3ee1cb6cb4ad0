"""Intervals of shares of frames that are not independent.

Frames of a drive resemble each other, so whole drives are drawn with replacement (cluster bootstrap). A single drive is
divided into blocks of one second. See A. C. Davison and D. V. Hinkley, "Bootstrap methods and their application", 1997,
sections 3.8 and 8.2.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

RESAMPLINGS, SEED = 4000, 0
# Percentiles of a 95 % interval; 95 % of a normal distribution lie within 1.96 standard deviations.
PERCENTILES, Z_95 = (2.5, 97.5), 1.96
BLOCK_S = 1.0


def frame_clusters(frames: Sequence[int], fps: Sequence[float]) -> np.ndarray:
    """(N,) cluster of each frame of drives, joined: the number of its drive, or of its second in a single drive.

    `frames` and `fps` are those of each drive.
    """
    if len(frames) == 1:
        return (np.arange(frames[0]) / (BLOCK_S * fps[0])).astype(int)
    return np.repeat(np.arange(len(frames)), frames)


def mean_interval(values: np.ndarray, clusters: np.ndarray) -> tuple[float, float]:
    """95 % interval of the mean of values (N,) in clusters (N,), which are drawn with replacement.

    Percentiles of the bootstrap; NaN without any value.
    """
    if not len(values):
        return float("nan"), float("nan")
    _, index, count = np.unique(clusters, return_inverse=True, return_counts=True)
    drawn = np.random.default_rng(SEED).multinomial(len(count), np.full(len(count), 1 / len(count)), RESAMPLINGS)
    low, high = np.percentile((drawn @ np.bincount(index, values)) / (drawn @ count), PERCENTILES)
    return float(low), float(high)


def share_interval(flags: np.ndarray, clusters: np.ndarray) -> tuple[float, float]:
    """95 % interval of the share of True in flags (N,) bool, in clusters (N,); NaN without any flag.

    It is never narrower than Wilson's interval: the bootstrap gives a width of 0 where all clusters have a share of 0,
    or all have 1.
    """
    if not len(flags):
        return float("nan"), float("nan")
    low, high = mean_interval(flags, clusters)
    wilson_low, wilson_high = wilson_interval(flags.sum(), np.array(len(flags)))
    return min(low, float(wilson_low)), max(high, float(wilson_high))


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
