"""The published results of the engine: lanes that it found, scored without the stills.

`results/` has the lanes in the stills with published labels, as `run` writes them. As a
program this prints the tables of docs/found_roads.md:

    python -m benchmark.real_roads.published
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from benchmark.real_roads.manifest import HERE, read_manifest
from benchmark.real_roads.score import score_predictions
from benchmark.real_roads.scored import ScoredLane
from benchmark.real_roads.sets import RoadSet, read_road_sets
from benchmark.real_roads.tables import set_rows
from benchmark.real_roads.ways import OWN, SET, sets_in_way
from benchmark.tables import markdown_table
from lanes.describe import number_cells
from lanes.score import reliability

RESULTS = HERE / "results"
# A clip needs minutes for a few labelled frames: `run` tracks them, unpublished.
PUBLISHED_WAYS = (OWN, SET)


def published_sets(
    way: str, present: Collection[str] | None = None
) -> tuple[list[RoadSet], list[list[ScoredLane]]]:
    """The published sets, or the part of them with the stills that are `present`, and
    the scores of the published lanes in one of the `PUBLISHED_WAYS`.
    """
    sets = []
    for roads in sets_in_way(read_road_sets(HERE), way):
        labels = roads.labels
        if present is not None:
            labels = [label for label in labels if label.name in present]
        if labels:
            sets.append(replace(roads, labels=labels))
    sizes = {source.file: (source.width, source.height) for source in read_manifest()}
    return sets, score_predictions(sets, RESULTS / f"{way}.jsonl", sizes)


def describe_effect(present: Collection[str]) -> str:
    """What the engine has by the published results on all stills and on those that are
    there.
    """
    lines = []
    for words, names in (("all stills", None), ("the stills here", present)):
        sets, scored = published_sets(OWN, names)
        row = set_rows(sets, OWN, scored)[f"{OWN} AB"]
        right = f"{row['right']} of {row['images']} right"
        lines.append(
            f"published result of the engine on {words}: {row['points']:.3f} of the "
            f"points (mean of {len(sets)} sets), {right}"
        )
    return "\n".join(lines)


def points_table() -> str:
    """A Markdown table with a row for each set, each half and both: in each way the
    share of the label points that are matched, and the images that are right.
    """
    of_way = {way: _rows(way) for way in PUBLISHED_WAYS}
    rows = []
    for name in of_way[OWN]:
        cells = [name]
        for way in PUBLISHED_WAYS:
            row = of_way[way].get(name)
            if row is None:
                cells += ["", ""]
            else:
                cells += [f"{row['points']:.3f}", f"{row['right']} of {row['images']}"]
        rows.append(cells)
    headings = ["set"]
    for way in PUBLISHED_WAYS:
        headings += [f"{way}, points", "right"]
    return markdown_table(headings, rows)


def _rows(way: str) -> dict[str, dict[str, float]]:
    """`set_rows` of the published lanes; sums are named as halves."""
    sets, scored = published_sets(way)
    rows = set_rows(sets, way, scored)
    names = {f"{way} A": "half A", f"{way} B": "half B", f"{way} AB": "both halves"}
    return {names.get(name, name): row for name, row in rows.items()}


def confidence_table() -> str:
    """A Markdown table of stated confidence and right lanes, in each way."""
    rows = []
    for way in PUBLISHED_WAYS:
        _, scored = published_sets(way)
        scores = [one.score for lanes in scored for one in lanes]
        headings, of_range = number_cells(reliability(scores))
        rows += [[way, name, *cells] for name, cells in of_range.items()]
    return markdown_table(["way", "confidence", *headings], rows)


if __name__ == "__main__":
    print(f"{points_table()}\n\n{confidence_table()}")
