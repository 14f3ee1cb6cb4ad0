"""Score the three recipes, the tracker and its detector on drives with known truth.

A recipe warps with its published points, or with points from the camera pose (NAME_pose).
The drives are the scenes of the suite, which are rendered once and cached, or your own videos.
Writes benchmark.csv, consistency.csv and reliability.png. Finished scores are cached, so an
interrupted run continues where it stopped.
--speed measures times instead (some minutes).
--labels scores the systems on hand-labelled stills instead, as `lanes score` does with a file of predictions.
--markings scores tracker and detector with the markings of a network (docs/own_network.md).
--seed scores another variant of each scene: the systems were tuned on numbers 0, 1, 2 and 7.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from lanes.__main__ import add_lens, find_lens
from lanes.console import bounded, progress_line, run_command, run_program
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
    scenes = "scene of the suite (default: all), or video with its truth (.csv) and camera (.yaml) next to it"
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help=scenes)
    parser.add_argument("--list", action="store_true", help="list the scenes and exit")
    parser.add_argument(
        "--system",
        type=lambda text: text.split(","),
        action="extend",
        metavar="NAME,...",
        help="hls_sobel, equalized_hsv, best_channel, each also with points from the camera pose (hls_sobel_pose, "
        "equalized_hsv_pose, best_channel_pose), tracker, detector (each frame alone; default: all of these), or "
        "file.py:function for your own",
    )
    seed = "score variant number N of each scene: other radii, speeds, camera pose and noise (default: %(default)s, "
    parser.add_argument("--seed", type=bounded(int, 0), default=0, metavar="N", help=f"{seed}the scenes themselves)")
    estimated = "estimate the camera pose from each video, as for real drives, instead of using the true pose"
    parser.add_argument("--estimated-pose", action="store_true", help=estimated)
    parser.add_argument("--speed", action="store_true", help="measure times on the committed project video")
    workers = "number of processes (default: %(default)s)"
    parser.add_argument("--workers", type=bounded(int, 1), default=1, metavar="N", help=workers)
    output = "output folder (default: the current one)"
    parser.add_argument("-o", "--output", type=Path, default=Path("."), metavar="FOLDER", help=output)
    labelled = parser.add_argument_group("hand-labelled stills")
    labels = "labels in TuSimple's format, raw_file is relative to this file; or a folder of labelme"
    labelled.add_argument("--labels", type=Path, metavar="LABELS", help=labels)
    folders = "each top folder below the labels is another camera: its pose is estimated from its own labelled stills"
    labelled.add_argument("--each-folder", action="store_true", help=folders)
    add_lens(labelled)


def run(options: argparse.Namespace) -> int:
    """Score, print the table and write the files."""
    from benchmark.evaluation import PROJECT_ROOT, choose_drives, list_drives, run_benchmark
    from benchmark.speed import describe_speed
    from benchmark.systems import SYSTEMS

    if options.list:
        for drive in list_drives().values():
            print(f"{drive.name:24}{drive.difficulty:9}{drive.description}")
    elif options.speed:
        print(describe_speed(PROJECT_ROOT / "test_videos" / "project_video.mp4"))
    elif options.labels:
        _score_labelled(options)
    else:
        results = run_benchmark(
            choose_drives(options.scenes, seed=options.seed),
            options.system or SYSTEMS,
            workers=options.workers,
            estimated_pose=options.estimated_pose,
            markings=options.markings and load_markings(options.markings),
            progress=progress_line,
        )
        _report(results, options.output)
    return 0


def _score_labelled(options: argparse.Namespace) -> None:
    """Print the scores of every system, and the consistency of the detector, on labelled stills."""
    from benchmark import real_roads as stills
    from benchmark.systems import STILL_SYSTEMS
    from lanes.labels import labels_folder, read_labels

    labels, every = read_labels(options.labels), dict[str, list]()
    for name in dict.fromkeys(label.folder if options.each_folder else "" for label in labels):
        some = [label for label in labels if name in ("", label.folder)]
        options.files = [labels_folder(options.labels) / label.name for label in some]
        lens, settings = find_lens(options)
        systems = options.system or STILL_SYSTEMS
        scored, pose = stills.score_folder(some, options.files, lens, systems, markings=settings.markings)
        for system, lanes in scored.items():
            every.setdefault(system, []).extend(lanes)
        said = pose.describe() if pose else "camera pose: that of the camera file"
        summary = stills.summarize_lanes(stills.lanes_of_engine(scored))
        print(f"{name}: {len(some)} stills; {summary}" if name else said)
    print(stills.describe_labelled(every))
    if of_engine := stills.lanes_of_engine(every):
        print(f"\n{stills.describe_lanes(of_engine)}\n")


def _report(results: list, folder: Path) -> None:
    from benchmark import consistency, tables
    from benchmark.scores import score_rows
    from benchmark.systems import TRACKER
    from lanes.files import write_telemetry

    rows, stated = score_rows(results), consistency.consistency_rows(results)
    print(f"{tables.describe_scores(rows)}\n{tables.describe_run(rows)}")
    if stated:
        print(f"\n{consistency.consistency_table(stated)}\n{consistency.LEGEND}")
        print(f"\n{consistency.describe_confidence(results)}")
    if of_tracker := [result for result in results if result.system == TRACKER]:
        print(f"\nFailures of the tracker:\n{tables.describe_failures(of_tracker) or 'none'}")
    written = [
        write_telemetry(folder / "benchmark.csv", rows),
        write_telemetry(folder / "consistency.csv", stated) if stated else None,
        consistency.save_reliability_figure(folder / "reliability.png", results),
    ]
    print(f"wrote {', '.join(str(path) for path in written if path)}")


def main(arguments: list[str] | None = None) -> int:
    """Run the command; return the exit status of `run_command`."""
    arguments = sys.argv[1:] if arguments is None else arguments
    return run_command(sys.modules[__name__], "python -m benchmark", arguments)


if __name__ == "__main__":
    run_program(main)
