"""Score the three recipes, the tracker and its detector on drives with known truth.

A recipe warps with its published points, or with points from the camera pose
(NAME_pose). The drives are the scenes of the suite, which are rendered once and cached,
or your own videos. Writes benchmark.csv, consistency.csv and reliability.png. Finished
scores are cached, so an interrupted run continues where it stopped.
--speed measures times instead (some minutes).
--labels scores the systems on hand-labelled stills instead, as `lanes score` does with
a file of predictions.
--markings scores tracker and detector with the markings of a network
(docs/own_network.md).
--seed scores another variant of each scene: the systems were tuned on numbers 0, 1, 2
and 7.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from lanes.__main__ import add_lens, find_lens
from lanes.console import (
    bounded,
    progress_line,
    run_command,
    run_program,
    split_names,
)
from lanes.detect.markings import load_markings

EXAMPLES = """\
  {program} --list
  {program} --workers 2 -o results
  {program} --system tracker --estimated-pose motorway
  {program} --system tracker,best_channel my_drive.mp4
  {program} --system my_finder.py:my_finder,tracker --workers 2 -o results
  {program} --system tracker,detector --seed 7 -o held_out
  {program} --system tracker --markings model.onnx motorway
  {program} --speed
  {program} --labels stills/labels.jsonl --camera camera.yaml
  {program} --labels world/labels.jsonl --hfov 60 --each-folder"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of this command."""
    parser.add_argument(
        "scenes",
        nargs="*",
        metavar="SCENE",
        help="scene of the suite (default: all), or video with its truth (.csv) and "
        "camera (.yaml) next to it",
    )
    parser.add_argument("--list", action="store_true", help="list the scenes and exit")
    parser.add_argument(
        "--system",
        type=split_names,
        action="extend",
        metavar="NAME,...",
        help="hls_sobel, equalized_hsv, best_channel, each also with points from the "
        "camera pose (hls_sobel_pose, equalized_hsv_pose, best_channel_pose), tracker, "
        "detector (each frame alone; default: all of these), or file.py:function for "
        "your own",
    )
    parser.add_argument(
        "--seed",
        type=bounded(int, 0),
        default=0,
        metavar="N",
        help="score variant number N of each scene: other radii, speeds, camera pose "
        "and noise (default: %(default)s, the scenes themselves)",
    )
    parser.add_argument(
        "--estimated-pose",
        action="store_true",
        help="estimate the camera pose from each video, as for real drives, instead of "
        "using the true pose",
    )
    parser.add_argument(
        "--speed",
        action="store_true",
        help="measure times on the committed project video",
    )
    parser.add_argument(
        "--workers",
        type=bounded(int, 1),
        default=1,
        metavar="N",
        help="number of processes (default: %(default)s)",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("."),
        metavar="FOLDER",
        help="output folder (default: the current one)",
    )

    labelled = parser.add_argument_group("hand-labelled stills")
    labelled.add_argument(
        "--labels",
        type=Path,
        metavar="LABELS",
        help="labels in TuSimple's format, raw_file is relative to this file; or a "
        "folder of labelme",
    )
    labelled.add_argument(
        "--each-folder",
        action="store_true",
        help="each top folder below the labels is another camera: its pose is "
        "estimated from its own labelled stills",
    )
    add_lens(labelled)


def run(options: argparse.Namespace) -> int:
    """Score, print the table and write the files."""
    if options.list:
        _print_scenes()
    elif options.speed:
        _print_speed()
    elif options.labels:
        _score_labelled(options)
    else:
        _score_drives(options)
    return 0


def _print_scenes() -> None:
    from benchmark.evaluation import list_drives

    for drive in list_drives().values():
        print(f"{drive.name:24}{drive.difficulty:9}{drive.description}")


def _print_speed() -> None:
    from benchmark.evaluation import PROJECT_ROOT
    from benchmark.speed import describe_speed

    print(describe_speed(PROJECT_ROOT / "test_videos" / "project_video.mp4"))


def _score_drives(options: argparse.Namespace) -> None:
    """Print the tables of the systems on drives with known truth; write the files."""
    from benchmark.evaluation import choose_drives, run_benchmark
    from benchmark.systems import SYSTEMS

    drives = choose_drives(options.scenes, seed=options.seed)
    markings = load_markings(options.markings) if options.markings else None
    results = run_benchmark(
        drives,
        options.system or SYSTEMS,
        workers=options.workers,
        estimated_pose=options.estimated_pose,
        markings=markings,
        progress=progress_line,
    )
    _report(results, options.output)


def _score_labelled(options: argparse.Namespace) -> None:
    """Print the scores of every system, and the consistency of the detector, on
    labelled stills.
    """
    from benchmark.real_roads import tables, ways
    from benchmark.systems import STILL_SYSTEMS
    from lanes.labels import labels_folder, read_labels

    # The stills of each camera; without --each-folder all are of one.
    cameras: dict[str, list] = {}
    for label in read_labels(options.labels):
        name = label.folder if options.each_folder else ""
        cameras.setdefault(name, []).append(label)

    every: dict[str, list] = {}
    for name, labels in cameras.items():
        folder = labels_folder(options.labels)
        options.files = [folder / label.name for label in labels]
        lens, settings = find_lens(options)
        scored, pose = ways.score_folder(
            labels,
            options.files,
            lens,
            options.system or STILL_SYSTEMS,
            markings=settings.markings,
        )
        for system, lanes in scored.items():
            every.setdefault(system, []).extend(lanes)

        if name:
            engine = ways.lanes_of_engine(scored)
            summary = tables.summarize_lanes(engine)
            print(f"{name}: {len(labels)} stills; {summary}")
        elif pose:
            print(pose.describe())
        else:
            print("camera pose: that of the camera file")

    print(tables.describe_labelled(every))
    engine = ways.lanes_of_engine(every)
    if engine:
        print(f"\n{tables.describe_lanes(engine)}\n")


def _report(results: list, folder: Path) -> None:
    """Print the tables of the results, and write their files into a folder."""
    from benchmark import consistency, tables
    from benchmark.scores import score_rows
    from benchmark.systems import TRACKER
    from lanes.files import write_telemetry

    rows = score_rows(results)
    print(tables.describe_scores(rows))
    print(tables.describe_run(rows))

    consistent = consistency.consistency_rows(results)
    if consistent:
        print(f"\n{consistency.consistency_table(consistent)}\n{consistency.LEGEND}")
        print(f"\n{consistency.describe_confidence(results)}")

    of_tracker = [result for result in results if result.system == TRACKER]
    if of_tracker:
        failures = tables.describe_failures(of_tracker)
        print(f"\nFailures of the tracker:\n{failures or 'none'}")

    written = [write_telemetry(folder / "benchmark.csv", rows)]
    if consistent:
        written.append(write_telemetry(folder / "consistency.csv", consistent))
    figure = consistency.save_reliability_figure(folder / "reliability.png", results)
    if figure:
        written.append(figure)
    print(f"wrote {', '.join(map(str, written))}")


def main(arguments: list[str] | None = None) -> int:
    """Run the command; return the exit status of `run_command`."""
    if arguments is None:
        arguments = sys.argv[1:]
    return run_command(sys.modules[__name__], "python -m benchmark", arguments)


if __name__ == "__main__":
    run_program(main)
