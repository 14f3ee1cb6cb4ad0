"""Tables of scored stills: of systems, of stated uncertainty, of labelled sets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from benchmark.consistency import describe_z, z_summary
from benchmark.real_roads.scored import (
    COMPARED_AT_M,
    OTHER_LINE_M,
    ScoredLane,
    all_z,
)
from benchmark.real_roads.sets import RoadSet
from lanes.describe import format_table, number_cells
from lanes.score import StillScore, reliability, summarize

LEGEND = """\
z: lateral error against the label, both projected to the flat road, divided by its
standard deviation: that of the lane at this picture row and 1.6 px of the label. Cells:
root mean square (1 is wanted), percent within 1 and 2 (68/95).
Right: every labelled line is matched."""


def describe_labelled(scored: Mapping[str, Sequence[ScoredLane]]) -> str:
    """A table of the scores, a line for each system."""
    rows = {}
    for system, lanes in scored.items():
        rows[system] = summarize([one.score for one in lanes])
    headings, cells = number_cells(rows)
    return format_table(headings, cells)


def describe_lanes(scored: Sequence[ScoredLane]) -> str:
    """Tables of z at each distance, and of the right lanes by confidence."""
    compared = np.isfinite(all_z(scored)).sum(axis=(0, 1))
    rows = {}
    for x_m, count, cell in zip(COMPARED_AT_M, compared, _z_cells(scored), strict=True):
        rows[f"lateral, {x_m:.0f} m"] = [f"{count}", cell]
    other_lines = sum(one.other_lines for one in scored)
    headings, cells = number_cells(reliability(one.score for one in scored))
    return (
        f"{format_table(('compared', 'z'), rows)}\n"
        f"left out, error above {OTHER_LINE_M:g} m: {other_lines}\n"
        f"{format_table(headings, cells)}\n{LEGEND}"
    )


def summarize_lanes(scored: Sequence[ScoredLane]) -> str:
    """The same in one line."""
    sure = reliability(one.score for one in scored)["0.9 or more"]
    at = "/".join(f"{x:.0f}" for x in COMPARED_AT_M)
    return (
        f"z at {at} m: {', '.join(_z_cells(scored))}; 0.9 or more: {sure['right']} of "
        f"{sure['lanes']} right, {sure['of right lanes']:.0%} of the right lanes"
    )


def _z_cells(scored: Sequence[ScoredLane]) -> list[str]:
    """Summaries of z in words, for each distance."""
    cells = []
    for z in np.moveaxis(all_z(scored), 2, 0):
        summary = z_summary(z[np.isfinite(z)])
        cells.append(describe_z(summary))
    return cells


def describe(
    sets: Sequence[RoadSet], way: str, scored: Sequence[Sequence[ScoredLane]]
) -> str:
    """`set_rows` as text."""
    return format_table(*number_cells(set_rows(sets, way, scored)))


def set_rows(
    sets: Sequence[RoadSet], way: str, scored: Sequence[Sequence[ScoredLane]]
) -> dict[str, dict[str, float]]:
    """Scores of each set that has some, then of the sets of each half and of all."""
    rows = {}
    of_half: dict[str, list] = {f"{way} {half}": [] for half in ("A", "B", "AB")}
    for roads, lanes in zip(sets, scored, strict=True):
        if not lanes:
            continue
        scores = [one.score for one in lanes]
        rows[roads.row_name] = _summary([scores])
        of_half[f"{way} {roads.half}"].append(scores)
        of_half[f"{way} AB"].append(scores)
    for name, some in of_half.items():
        if some:
            rows[name] = _summary(some)
    return rows


def _summary(sets: Sequence[Sequence[StillScore]]) -> dict[str, float]:
    """Mean and lowest share of right points of the sets, and the right images of all of
    them.
    """
    points = [summarize(scores)["ego accuracy"] for scores in sets]
    every = [score for scores in sets for score in scores]
    lines = np.concatenate([score.values["ego matched"] for score in every])
    right = [score.right for score in every if score.right is not None]
    sure = reliability(every)["0.9 or more"]
    return {
        "points": float(np.mean(points)),
        "lowest": min(points),
        "images": len(right),
        "right": sum(right),
        "right share": float(np.mean(right)),
        "0.9 or more": sure["lanes"],
        "of them right": sure["right"],
        "of right lanes": sure["of right lanes"],
        "lines": int(np.isfinite(lines).sum()),
        "matched": int(np.nansum(lines)),
    }
