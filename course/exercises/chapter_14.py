"""Exercise of chapter 14, measure the errors."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from course.exercises.verdict import NOT_TRIED, Verdict, correct, hint

# Number of frames, and the shares of right frames that are asked for.
FRAMES, LEAST_RIGHT = 4000, (0.8, 0.9, 0.95)

LargestShare = Callable[[np.ndarray, np.ndarray, float], float]


def check_largest_share(largest_share: LargestShare) -> Verdict:
    """14.1: the largest share of frames to keep, the most confident ones, of which a given share is right."""
    confidence, right = _frames()
    found = [largest_share(confidence.copy(), right.copy(), least) for least in LEAST_RIGHT]
    if any(share is None for share in found):
        return NOT_TRIED
    if any(np.ndim(share) for share in found):
        return hint("return one number, the share of the frames that are kept.")
    true = [_kept_shares(confidence, right, least)[""] for least in LEAST_RIGHT]
    if not np.allclose(found, true, atol=1e-9):
        wrong = [_kept_shares(confidence, right, least) for least in LEAST_RIGHT]
        for sentence in wrong[0]:
            if sentence and np.allclose(found, [shares[sentence] for shares in wrong], atol=1e-9):
                return hint(sentence)
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


def _kept_shares(confidence: np.ndarray, right: np.ndarray, least: float) -> dict[str, float]:
    """The share by the hint of the mistake that leads to it; the right one has none."""
    counts = np.arange(1, len(right) + 1)
    falling, rising = (np.cumsum(right[order]) / counts for order in (np.argsort(-confidence), np.argsort(confidence)))
    enough = np.flatnonzero(falling >= least)
    below = np.flatnonzero(falling < least)
    sure = confidence >= least
    return {
        "": (enough[-1] + 1) / len(right) if len(enough) else 0.0,
        "you keep the least confident frames first: sort the other way round.": (
            (np.flatnonzero(rising >= least)[-1:].sum() + 1) / len(right) if (rising >= least).any() else 0.0
        ),
        "you stop where the share first falls below the limit; farther on it can rise again. Take the last place at "
        "which it is reached.": below[0] / len(right),
        "this is the share of frames with a confidence above the limit. The confidence need not be true: count the "
        "right frames.": sure.mean(),
        "this is the share of right frames among all. How many can be kept?": right.mean(),
        "this is a number of frames. Divide by all frames.": float(enough[-1] + 1) if len(enough) else 0.0,
    }


CHECKS = {"14.1": check_largest_share}
