"""Exercise of chapter 14, measure the errors."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np

from course.exercises.verdict import NOT_TRIED, Verdict, correct, hint

# Groups of confidence, and the number of frames.
GROUPS, FRAMES = ((0.5, 0.6), (0.6, 0.7), (0.7, 0.8), (0.8, 0.9), (0.9, 0.95)), 4000

ShareRight = Callable[[np.ndarray, np.ndarray, float, float], float]


def check_share_right(share_right: ShareRight) -> Verdict:
    """14.1: the share of right frames among those with a confidence in [low, high)."""
    confidence, right = _frames()
    found = [_call(share_right, confidence, right, *group) for group in GROUPS]
    if any(share is None for share in found):
        return NOT_TRIED
    if any(np.ndim(share) for share in found):
        return hint("return one number, the share of the group.")
    true = [right[(confidence >= low) & (confidence < high)].mean() for low, high in GROUPS]
    if not np.allclose(found, true):
        wrong = [_wrong_shares(confidence, right, *group) for group in GROUPS]
        for sentence in wrong[0]:
            if np.allclose(found, [shares[sentence] for shares in wrong]):
                return hint(sentence)
        low, high = GROUPS[0]
        return hint(
            f"from {low} to {high} yours is {found[0]:.3f}, the true share {true[0]:.3f}. Divide the number of right "
            "frames in the group by the number of all frames in it."
        )
    empty = _call(share_right, confidence, right, 0.0, 0.1)
    if empty is None or not np.isnan(empty):
        return hint(f"a group without frames has no share: return np.nan, not {empty}.")
    (low, high), share = GROUPS[-1], true[-1]
    return correct(
        f"of the frames with a confidence of {low} to {high}, {share:.0%} are right: this system is too sure."
    )


def _frames() -> tuple[np.ndarray, np.ndarray]:
    """Confidence, in whole percents from 0.5 to 1, and correctness of the frames of a system that is too sure."""
    random = np.random.default_rng(14)
    confidence = random.integers(50, 101, FRAMES) / 100
    return confidence, random.random(FRAMES) < confidence**2


def _wrong_shares(confidence: np.ndarray, right: np.ndarray, low: float, high: float) -> dict[str, float]:
    """What wrong answers return for a group, by the hint they get."""
    inside = (confidence >= low) & (confidence < high)
    closed, opened = (confidence >= low) & (confidence <= high), (confidence > low) & (confidence < high)
    return {
        "this is a share of all frames. Divide by the frames in the group.": (right & inside).mean(),
        "this is a share of the right frames. Divide by the frames in the group.": inside[right].mean(),
        "this is the number of right frames. Divide by the frames in the group.": right[inside].sum(),
        "this is the mean confidence. Take the mean of `right` in the group.": confidence[inside].mean(),
        "this is the share of wrong frames.": 1 - right[inside].mean(),
        "a confidence of exactly `high` belongs to the next group: use < there.": right[closed].mean(),
        "a confidence of exactly `low` belongs to the group: use >= there.": right[opened].mean(),
    }


def _call(share_right: ShareRight, confidence: np.ndarray, right: np.ndarray, low: float, high: float) -> float:
    with warnings.catch_warnings():
        # NumPy warns of the mean of an empty group. It is NaN, which is the right answer.
        warnings.simplefilter("ignore", RuntimeWarning)
        return share_right(confidence.copy(), right.copy(), low, high)


CHECKS = {"14.1": check_share_right}
