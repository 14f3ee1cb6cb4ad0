"""Exercise of chapter 10, look for paint."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from course.exercises.verdict import NOT_TRIED, Verdict, correct, hint

# Cells at either end of a row that do not count, and the positions of the stripes and edges.
MARGIN, PLACE = 40, 150
# Gray levels of the road, and of the contrast of paint and seams; largest error, as a share of the score of a stripe.
ROAD, CONTRAST, TOLERANCE = 120.0, 60.0, 0.1


def check_stripe_response(respond: Callable[[np.ndarray, int], np.ndarray]) -> Verdict:
    """10.1: the response of the band filter along one row."""
    if respond(_row(3), 3) is None:
        return NOT_TRIED
    middle, all_cells = slice(PLACE, PLACE + 1), slice(MARGIN, -MARGIN)
    noise = "Subtract the road from the stripe, and divide by 1 + n, where n is the mean over 51 cells."
    width = "The width decides over the mean in the centre and over the distance of the strips of road."
    # row, width of a stripe in it, the cells whose largest score counts, and what to think of if it is wrong
    cases = {
        "a bright stripe": (_row(3), 3, middle, noise),
        "a dark seam": (_row(3, contrast=-CONTRAST), 3, middle, "It is no paint: take no absolute value."),
        "an edge of a shadow": (_edge(), 3, all_cells, "Subtract the larger of the two sides: max(m_l, m_r)."),
        "a double line 7 cells wide": (_row(7), 7, middle, width),
        "a cell beside a stripe": (_row(3), 3, all_cells, "Check gap, strips and noise."),
    }
    reached, tolerance = {}, TOLERANCE * _respond(_row(3), 3)[PLACE]
    for name, (row, cells, place, advice) in cases.items():
        found, expected = np.asarray(respond(row.copy(), cells), float), _respond(row, cells)
        if found.shape != row.shape:
            return hint(f"the result has shape {found.shape}; it needs one number for each cell, {row.shape}.")
        if not np.isfinite(found[all_cells]).all():
            return hint("some scores are NaN or infinite.")
        reached[name] = found[place].max()
        if abs(reached[name] - expected[place].max()) > tolerance:
            return hint(f"{name} scores {reached[name]:.1f} instead of {expected[place].max():.1f}. {advice}")
    worst = int(np.abs(found - expected)[all_cells].argmax()) + MARGIN
    if abs(found[worst] - expected[worst]) > tolerance:
        return hint(f"{name} scores {found[worst]:.1f} instead of {expected[worst]:.1f}. {advice}")
    stripe, seam, edge, *_ = reached.values()
    return correct(f"a stripe scores {stripe:.1f}, an edge at most {max(edge, 0):.1f}, a seam {seam:.1f}.")


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
