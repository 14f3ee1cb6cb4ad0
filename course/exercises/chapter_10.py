"""Exercise of chapter 10, look for paint."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from course.exercises.verdict import NOT_TRIED, Verdict, correct, hint

# Cells at either end of a row that do not count, and the positions of the stripes and edges.
MARGIN, PLACE = 40, 150
# Gray levels of the road, and of the contrast of paint and seams.
ROAD, CONTRAST = 120.0, 60.0


def check_stripe_response(respond: Callable[[np.ndarray, int], np.ndarray]) -> Verdict:
    """10.1: the response of the band filter along one row."""
    stripe, double, edge, seam = (_row(3), _row(7), _edge(), _row(3, contrast=-CONTRAST))
    if respond(stripe.copy(), 3) is None:
        return NOT_TRIED
    on_stripe, on_double, on_edge, on_seam = (
        np.asarray(respond(row.copy(), width), float) for row, width in ((stripe, 3), (double, 7), (edge, 3), (seam, 3))
    )
    if on_stripe.shape != stripe.shape:
        return hint(f"the result has shape {on_stripe.shape}; it needs one number for each cell, {stripe.shape}.")
    if not all(np.isfinite(scores[MARGIN:-MARGIN]).all() for scores in (on_stripe, on_double, on_edge, on_seam)):
        return hint("some scores are NaN or infinite.")
    course_score = _respond(stripe, 3)
    expected = course_score[PLACE]
    if on_stripe[PLACE] < 0:
        return hint(f"a bright stripe scores {on_stripe[PLACE]:.1f}. Subtract the road from the stripe.")
    if on_seam[PLACE] > 0:
        return hint(f"a dark seam scores {on_seam[PLACE]:.1f}. It is no paint: take no absolute value.")
    if abs(on_stripe[PLACE] - expected) > 0.1 * expected:
        return hint(
            f"the stripe scores {on_stripe[PLACE]:.1f} instead of {expected:.1f}. Divide by the noise, 1 + n; n is "
            "the mean over 51 cells."
        )
    near_edge = on_edge[MARGIN:-MARGIN].max()
    if near_edge > 2:
        return hint(f"an edge of a shadow scores {near_edge:.1f}. Subtract the larger of the two sides: max(m_l, m_r).")
    wide = _respond(double, 7)[PLACE]
    if abs(on_double[PLACE] - wide) > 0.1 * wide:
        return hint(
            f"a double line 7 cells wide scores {on_double[PLACE]:.1f} instead of {wide:.1f}. "
            "The width decides over the mean in the centre and over the distance of the strips of road."
        )
    worst = MARGIN + int(np.abs(on_stripe - course_score)[MARGIN:-MARGIN].argmax())
    if abs(on_stripe[worst] - course_score[worst]) > 0.1 * expected:
        return hint(
            f"{abs(worst - PLACE)} cells beside the middle of a stripe the score is {on_stripe[worst]:.1f} "
            f"instead of {course_score[worst]:.1f}. Check gap, strips and noise."
        )
    return correct(
        f"a stripe scores {expected:.1f}, an edge at most {max(near_edge, 0):.1f}, a seam {on_seam[PLACE]:.1f}."
    )


def _row(width: int, *, contrast: float = CONTRAST) -> np.ndarray:
    """A row of the road with a stripe in the middle."""
    row = ROAD + np.random.default_rng(10).normal(0, 2, 2 * PLACE + 1)
    row[PLACE - width // 2 : PLACE + width // 2 + 1] += contrast
    return row


def _edge() -> np.ndarray:
    """A row that is dark in its middle: the edges of a shadow, one of each kind."""
    row = _row(1, contrast=0.0)
    row[PLACE - 30 : PLACE + 30] -= CONTRAST
    return row


def _respond(row: np.ndarray, width: int) -> np.ndarray:
    """The response as the course defines it."""
    centre, road = _mean(row, width), _mean(row, 3)
    reach = width // 2 + 3
    noise = 1 + _mean(np.abs(np.diff(row, prepend=row[0])), 51)
    return (centre - np.maximum(np.roll(road, reach), np.roll(road, -reach))) / noise


def _mean(values: np.ndarray, count: int) -> np.ndarray:
    return np.convolve(values, np.ones(count) / count, mode="same")


CHECKS = {"10.1": check_stripe_response}
