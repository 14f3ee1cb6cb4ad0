"""Score every lane finder on drives whose truth is known: the suite's scenes (rendered on demand,
kept in a cache) and the committed videos. Writes benchmark.csv, benchmark.png and reliability.png.
What is finished is kept, so that an interrupted run goes on where it was.
With --speed: how long they take instead, from file to file too, and how much memory (some minutes).
With --labels: score them, or a file of predictions, on stills that were labelled by hand.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from lanes.cli.arguments import add_lens, find_lens
from lanes.io.console import positive_int, progress_line, run_command, run_program

EXAMPLES = """\
  python -m benchmark --list
  python -m benchmark --workers 2 -o results
  python -m benchmark --system tracker --estimated-pose motorway
  python -m benchmark --system tracker,best_channel my_drive.mp4
  python -m benchmark --speed
  python -m benchmark --labels stills/labels.jsonl --camera camera.yaml
  python -m benchmark --labels stills/labels.jsonl --predictions lanes.jsonl"""


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
        "--system",
        type=lambda text: text.split(","),
        action="extend",
        metavar="NAME,...",
        help="hls_sobel, equalized_hsv, best_channel, tracker (default: all)",
    )
    parser.add_argument(
        "--estimated-pose", action="store_true", help="estimate the camera pose from each video, as on real drives"
    )
    parser.add_argument("--speed", action="store_true", help="measure time and memory on the committed video")
    parser.add_argument("--workers", type=positive_int, default=1, metavar="N", help="processes (default: %(default)s)")
    parser.add_argument("-o", "--output", type=Path, default=Path("."), metavar="FOLDER", help="default: here")
    labelled = parser.add_argument_group("stills labelled by hand")
    labelled.add_argument(
        "--labels", type=Path, metavar="JSONL", help="labels in TuSimple's format; raw_file is relative to this file"
    )
    labelled.add_argument(
        "--predictions", type=Path, metavar="JSONL", help="score these, as `detect` writes them, and run no system"
    )
    add_lens(labelled)


def run(options: argparse.Namespace) -> int:
    """Score, print the table and write the files."""
    from benchmark.runner import run_benchmark
    from benchmark.suite_drives import choose_drives, list_drives
    from benchmark.systems import SYSTEMS

    if options.list:
        for drive in list_drives().values():
            print(f"{drive.name:24}{drive.difficulty:9}{drive.what}")
        return 0
    if options.speed:
        return measure_speeds()
    if options.labels:
        return score_labelled(options)
    if options.predictions:
        raise ValueError(f"{options.predictions}: predictions of what? Name the labels with --labels.")
    results = run_benchmark(
        choose_drives(options.scenes),
        options.system or SYSTEMS,
        workers=options.workers,
        estimated_pose=options.estimated_pose,
        progress=progress_line,
    )
    _report(results, options.output)
    return 0


def measure_speeds() -> int:
    """Measure time and memory on the committed video."""
    from benchmark.dataset import PROJECT_ROOT
    from benchmark.speed.speed import measure_speed

    print(measure_speed(PROJECT_ROOT / "test_videos" / "project_video.mp4", progress=progress_line).describe())
    return 0


def score_labelled(options: argparse.Namespace) -> int:
    """Score a file of predictions, or every system, on the stills of `options.labels`."""
    from benchmark.labels.stills import describe_labelled, score_stills
    from benchmark.labels.tusimple import EGO_LANE_NOTE, pair_predictions, read_labels, read_predictions, score_lines
    from benchmark.systems import SYSTEMS
    from lanes.camera.pose_from_lanes.pose_from_files import pose_from_drive

    labels, folder = read_labels(options.labels), options.labels.parent
    if options.predictions:
        pairs = pair_predictions(labels, read_predictions(options.predictions))
        scores = {options.predictions.name: [score for pair in pairs for score in score_lines(*pair)]}
    else:
        options.files = [folder / label.name for label in labels]
        camera, estimate = pose_from_drive(find_lens(options), options.files, progress=progress_line("pose"))
        if estimate:
            print(estimate.describe())
        scores = score_stills(labels, folder, camera, options.system or SYSTEMS, progress=progress_line("stills"))
    print(describe_labelled(scores))
    print(f"{len(labels)} stills; {EGO_LANE_NOTE}")
    return 0


def _report(results: list, folder: Path) -> None:
    from benchmark.reporting.failures import describe_failures
    from benchmark.reporting.figures import save_reliability_figure, save_scores_figure
    from benchmark.reporting.tables import describe_run, describe_scores
    from benchmark.scores import score_rows, total_rows
    from benchmark.systems import TRACKER
    from lanes.io.telemetry import write_telemetry

    rows = [*score_rows(results), *total_rows(results)]
    print(describe_scores(rows))
    print(describe_run(rows))
    engine = describe_failures([result for result in results if result.system == TRACKER])
    print(f"Where the tracker is not right:\n{engine or 'nowhere'}")
    written = [
        write_telemetry(folder / "benchmark.csv", rows),
        save_scores_figure(folder / "benchmark.png", rows),
        save_reliability_figure(folder / "reliability.png", results),
    ]
    print(f"wrote {', '.join(str(path) for path in written if path)}")


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit status, see `run_command`."""
    arguments = sys.argv[1:] if arguments is None else arguments
    return run_command(sys.modules[__name__], "python -m benchmark", arguments)


if __name__ == "__main__":
    run_program(main)
