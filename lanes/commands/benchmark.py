"""Score every lane finder on drives whose truth is known: the suite's scenes (rendered on demand,
kept in a cache) and the committed videos; or, with --labels, on pictures labelled by hand.
Writes benchmark.csv, benchmark.png and reliability.png. What is finished is kept, so that an
interrupted run goes on where it was.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from lanes.commands.arguments import count, progress_line

EXAMPLES = """\
  python -m lanes benchmark --list
  python -m lanes benchmark --workers 2 -o results
  python -m lanes benchmark motorway --system metric --estimated-mount
  python -m lanes benchmark my_drive.mp4"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this command."""
    parser.add_argument(
        "scenes",
        nargs="*",
        metavar="SCENE",
        help="scenes of the suite (default: all), or videos with their truth (.csv) and camera (.yaml) beside them",
    )
    parser.add_argument("--list", action="store_true", help="say which scenes there are, and do nothing")
    parser.add_argument(
        "--system", nargs="+", metavar="NAME", help="hls_sobel, equalized_hsv, best_channel, metric (default: all)"
    )
    parser.add_argument(
        "--estimated-mount", action="store_true", help="estimate the camera's mount from each video, as on real drives"
    )
    parser.add_argument("--workers", type=count, default=1, metavar="N", help="processes (default: %(default)s)")
    parser.add_argument("-o", "--output", type=Path, default=Path("."), metavar="FOLDER", help="default: here")


def run(options: argparse.Namespace) -> int:
    """Score, print the table and write the files."""
    from lanes.benchmark.drives import choose_drives, list_drives
    from lanes.benchmark.runner import run_benchmark
    from lanes.benchmark.systems import SYSTEMS

    if options.list:
        for drive in list_drives().values():
            print(f"{drive.name:24}{drive.difficulty:9}{drive.what}")
        return 0
    results = run_benchmark(
        choose_drives(options.scenes),
        options.system or SYSTEMS,
        workers=options.workers,
        estimated_mount=options.estimated_mount,
        progress=progress_line,
    )
    _report(results, options.output)
    return 0


def _report(results: list, folder: Path) -> None:
    from lanes.benchmark.figures import save_reliability_figure, save_scores_figure
    from lanes.benchmark.scores import score_rows, total_rows
    from lanes.benchmark.tables import describe_run, describe_scores
    from lanes.video.telemetry import write_telemetry

    rows = [*score_rows(results), *total_rows(results)]
    print(describe_scores(rows))
    print(describe_run(rows))
    written = [
        write_telemetry(folder / "benchmark.csv", rows),
        save_scores_figure(folder / "benchmark.png", rows),
        save_reliability_figure(folder / "reliability.png", results),
    ]
    print(f"wrote {', '.join(str(path) for path in written if path)}")
