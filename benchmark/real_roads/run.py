"""Find the lanes of the stills of a folder with the engine of this project, and score
them.

Each still alone (own), with the pose of its set (set), and tracked through its clip
(clips). The lanes of each way are written as predictions, and scored as those of any
program. Nothing is known about the cameras, unless a lens is given.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.real_roads.score import report, sizes_of_stills
from benchmark.real_roads.scored import ScoredLane
from benchmark.real_roads.sets import (
    RoadSet,
    add_road_arguments,
    choose_road_sets,
)
from benchmark.real_roads.ways import WAYS, score_sets, sets_in_way
from lanes.camera.model import load_camera
from lanes.files import write_json_lines
from lanes.labels import NO_POINT
from lanes.score import StillScore

EXAMPLES = """\
  {program} found_roads --workers 2
  {program} found_roads --only own --half A -o half_a"""


def write_predictions(
    path: Path, sets: Sequence[RoadSet], scored: Sequence[Sequence[ScoredLane]]
) -> Path:
    """Write the lanes that were found as predictions; returns the path."""
    sizes = sizes_of_stills(sets)
    entries = []
    for lanes in scored:
        for one in lanes:
            entries.append(_as_prediction(one.score, sizes[one.score.label.name]))
    return write_json_lines(path, entries)


def _as_prediction(score: StillScore, size: tuple[int, int]) -> dict[str, Any]:
    """Lines in a still of `size`; frames of its clip can have another one."""
    found = score.prediction
    scale_x, scale_y = np.divide(size, score.size)
    seen = found.columns >= 0
    columns = np.where(seen, found.columns * scale_x, NO_POINT)
    return {
        "raw_file": found.name,
        "h_samples": np.round(found.rows * scale_y, 2).tolist(),
        "lanes": np.round(columns, 2).tolist(),
        "sides": list(found.sides),
        "confidence": round(found.confidence or 0.0, 4),
    }


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of this command."""
    add_road_arguments(parser)
    parser.add_argument(
        "--camera",
        type=load_camera,
        help="the lens of all stills (default: unknown cameras)",
    )
    parser.add_argument(
        "--only", choices=WAYS, help="one way to look at the sets (default: all)"
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("found_roads_results"),
        metavar="FOLDER",
        help="folder of the lanes and pages (default: %(default)s)",
    )


def run(options: argparse.Namespace) -> int:
    """Find lanes in each way, write them, and print their scores."""
    sets = choose_road_sets(options, options.camera)
    for way in [options.only] if options.only else WAYS:
        some = sets_in_way(sets, way)
        if not some:
            print(f"{way}: no set can be looked at in this way")
            continue
        scored = score_sets(some, way, workers=options.workers)
        file = write_predictions(options.output / f"{way}.jsonl", some, scored)
        report(some, file, file.with_suffix(".html"))
    return 0
