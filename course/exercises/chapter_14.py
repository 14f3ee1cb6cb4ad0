"""Exercise of chapter 14, measure the errors."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from course.exercises.verdict import NOT_TRIED, Verdict, correct, find_mistake, hint

# Number of frames, and the shares of right frames that are asked for.
FRAMES, LEAST_RIGHT = 4000, (0.8, 0.9, 0.95)

MISTAKES = (
    "you keep the least confident frames first: sort the other way round.",
    "you stop where the share first falls below the limit; farther on it can rise again. Take the last place at which "
    "it is reached.",
    "this is the share of frames with a confidence above the limit. The confidence need not be true: count the right "
    "frames.",
    "this is the share of right frames among all. How many can be kept?",
    "this is a number of frames. Divide by all frames.",
)

LargestShare = Callable[[np.ndarray, np.ndarray, float], float]


def check_largest_share(largest_share: LargestShare) -> Verdict:
    """14.1: the largest share of frames to keep, the most confident ones, of which a given share is right."""
    confidence, right = _frames()
    found = [largest_share(confidence.copy(), right.copy(), least) for least in LEAST_RIGHT]
    if any(share is None for share in found):
        return NOT_TRIED
    if any(np.ndim(share) for share in found):
        return hint("return one number, the share of the frames that are kept.")
    true, *wrong = zip(*(_kept_shares(confidence, right, least) for least in LEAST_RIGHT), strict=True)
    if not np.allclose(found, true, atol=1e-9):
        if mistake := find_mistake(found, dict(zip(MISTAKES, wrong, strict=True)), atol=1e-9):
            return hint(mistake)
        return hint(
            f"for {LEAST_RIGHT[0]:.0%} yours is {found[0]:.3f}, the true share {true[0]:.3f}. Sort by confidence, "
            "highest first; of the first k frames the share of right ones is a cumulative mean."
        )
    none = largest_share(confidence.copy(), np.zeros(FRAMES, bool), 0.9)
    if none != 0:
        return hint(f"if no frame is right, none can be kept: return 0, not {none}.")
    return correct(
        f"to be right in {LEAST_RIGHT[-1]:.0%}, this system may show {true[-1]:.0%} of its frames; in "
        f"{LEAST_RIGHT[0]:.0%}, {true[0]:.0%} of them."
    )


def _frames() -> tuple[np.ndarray, np.ndarray]:
    """Confidence and correctness of the frames of a system that is too sure; no two frames are equally sure."""
    random = np.random.default_rng(14)
    confidence = random.uniform(0.5, 1, FRAMES)
    return confidence, random.random(FRAMES) < confidence**2


def _kept_shares(confidence: np.ndarray, right: np.ndarray, least: float) -> list[float]:
    """The share to keep, and those that the `MISTAKES` lead to."""
    counts = np.arange(1, len(right) + 1)
    falling, rising = (np.cumsum(right[order]) / counts for order in (np.argsort(-confidence), np.argsort(confidence)))
    kept = int(np.flatnonzero(falling >= least)[-1:].sum()) + 1
    from_below = (np.flatnonzero(rising >= least)[-1:].sum() + 1) / len(right) if (rising >= least).any() else 0.0
    until_below = np.flatnonzero(falling < least)[0] / len(right)
    return [kept / len(right), from_below, until_below, (confidence >= least).mean(), right.mean(), kept]


CHECKS = {"14.1": check_largest_share}
