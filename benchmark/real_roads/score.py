"""Score the lines that any program finds in the stills of a folder.

Predictions are TuSimple JSON lines: raw_file, lanes (columns, -2 for no point),
optionally h_samples (rows; by default those of the label), sides ("left" and "right"
are the ego lane) and confidence (0 to 1). A row of the table is a set: share of the
labelled points that are matched, the lowest share of a set, images with all lines
right, those with a confidence of 0.9 or more, and matched lines. The last rows are
means of the sets of each half and of all. The page shows every still.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

from benchmark.real_roads.scored import ScoredLane
from benchmark.real_roads.sets import (
    LABELS,
    OFFICIAL,
    RoadSet,
    add_set_arguments,
    read_road_sets,
)
from benchmark.real_roads.tables import set_rows
from lanes.describe import format_table, number_cells
from lanes.files import require_no_input_among
from lanes.labels import read_predictions
from lanes.score import (
    StillScore,
    describe_predictions,
    reliability,
    score_still,
    score_tables,
    write_score_page,
)
from lanes.video.images import read_image

EXAMPLES = """\
  {program} found_roads lanes.jsonl
  {program} found_roads lanes.jsonl --half B -o lanes.html"""
Sizes = Mapping[str, tuple[int, int]]


def score_predictions(
    sets: Sequence[RoadSet], file: Path, sizes: Sizes
) -> list[list[ScoredLane]]:
    """Scores of a file's predictions for each set; errors are those of
    `read_predictions`.

    `sizes` are width and height of the stills by their names.
    """
    labels = [label for roads in sets for label in roads.labels]
    predictions = iter(read_predictions(file, labels))
    scored = []
    for roads in sets:
        lanes = []
        for label, found in zip(roads.labels, predictions, strict=False):
            score = score_still(label, found, sizes[label.name])
            lanes.append(ScoredLane(score))
        scored.append(lanes)
    return scored


def sizes_of_stills(sets: Sequence[RoadSet]) -> dict[str, tuple[int, int]]:
    """Width and height of each labelled still; LaneError if one cannot be read."""
    sizes = {}
    for roads in sets:
        for label in roads.labels:
            height, width = read_image(roads.folder / label.name).shape[:2]
            sizes[label.name] = (width, height)
    return sizes


def report(sets: Sequence[RoadSet], file: Path, page: Path) -> None:
    """Print the scores of a file's predictions, and write the page.

    ValueError without sets.
    """
    if not sets:
        raise ValueError("no labelled set is in this half; choose the other one.")
    scored = score_predictions(sets, file, sizes_of_stills(sets))
    scores = [one.score for lanes in scored for one in lanes]
    rows = set_rows(sets, file.stem, scored)
    print(format_table(*number_cells(rows)))
    print(describe_confidence(scores))
    worst = min(sets, key=lambda one: rows[one.row_name]["points"])
    points = rows[worst.row_name]["points"]
    print(f"worst set: {worst.name}, {points:.3f} of the points")

    pictures = [roads.folder / label.name for roads in sets for label in roads.labels]
    notes = _describe_notes(file, scores, pictures)
    tables = score_tables(scores, max_worst=len(scores))
    written = write_score_page(
        page,
        scores,
        pictures,
        {**tables, "scores": rows},
        title=f"{file} on {sets[0].folder}",
        notes=notes,
    )
    print(f"{notes}wrote {written}")


def _describe_notes(
    file: Path, scores: Sequence[StillScore], pictures: Sequence[Path]
) -> str:
    """A line for each note on the predictions."""
    labels = [score.label for score in scores]
    notes = ""
    found = read_predictions(file, labels)
    for what, some in describe_predictions(labels, found, pictures):
        if some:
            notes += f"note: {len(some)} of {len(labels)} {what}\n"
    return notes


def describe_confidence(scores: Sequence[StillScore]) -> str:
    """A table of stated confidence and right lanes; a sentence without any stated."""
    if all(score.prediction.confidence is None for score in scores):
        return "no confidence is stated"
    return format_table(*number_cells(reliability(scores)))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of this command."""
    add_set_arguments(parser)
    parser.add_argument(
        "predictions", type=Path, metavar="PREDICTIONS", help="lines of a program"
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("found_roads.html"),
        metavar="PAGE",
        help="page to write (default: %(default)s)",
    )


def run(options: argparse.Namespace) -> int:
    """Print the scores, and write the page."""
    folder = options.folder
    sets = [one for one in read_road_sets(folder) if one.half in options.half]
    stills = [folder / label.name for one in sets for label in one.labels]
    inputs = [options.predictions, folder / LABELS, folder / OFFICIAL, *stills]
    require_no_input_among([options.output], inputs)
    report(sets, options.predictions, options.output)
    return 0
