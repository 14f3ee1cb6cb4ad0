"""Write the columns of the two ego lane lines at given rows of the raw pictures, one JSON line per
picture: raw_file, h_samples, lanes (left, right; -2 for no point), run_time (ms), state, confidence,
offset_m (> 0: car left of the lane centre), curvature_per_m (> 0: bends left). If no camera file with
a camera pose is given, the pose is first estimated from the files.
"""

from __future__ import annotations

import argparse

from lanes.cli.arguments import add_footage, add_lens, add_output, find_lens
from lanes.io.console import bounded_float, progress_line

EXAMPLES = """\
  {program} --camera camera.yaml drive.mp4 -o lanes.jsonl
  {program} --hfov 60 --rows 240:721:10 stills/*.jpg
  {program} --boards my_boards --sequence --fps 20 clip/*.jpg"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this command."""
    add_footage(parser, files="stills or videos of one camera")
    add_lens(parser)
    parser.add_argument(
        "--rows",
        type=rows,
        default="420:701:10",
        metavar="FROM:TO:STEP",
        help="picture rows, TO excluded (default: %(default)s)",
    )
    parser.add_argument("--sequence", action="store_true", help="the stills are consecutive frames in this order")
    parser.add_argument(
        "--fps", type=bounded_float(1), default=25.0, help="frames per second of --sequence (default: %(default)s)"
    )
    add_output(parser, "lanes.jsonl", "file to write")


def run(options: argparse.Namespace) -> int:
    """Detect the lane in every picture, and write the detections."""
    from lanes.camera.pose_from_lanes.estimator import pose_from_drive
    from lanes.drives.detections import count_missing_frames, detect_files, write_detections

    camera, estimate = pose_from_drive(find_lens(options), options.files, progress=progress_line("pose"))
    if estimate:
        print(estimate.describe())
    found = detect_files(
        options.files,
        camera,
        options.rows,
        sequence=options.sequence,
        fps=options.fps,
        progress=progress_line("detect"),
    )
    lost = sum(detection["state"] == "lost" for detection in found)
    missing = count_missing_frames(found)
    damaged = f"; {missing} more are damaged or missing in the videos" if missing else ""
    print(f"wrote {write_detections(options.output, found)}: {len(found)} pictures, no lane in {lost}{damaged}")
    return 0


def rows(text: str) -> range:
    """An argparse type: picture rows, written like 420:701:10."""
    try:
        wanted = range(*(int(part) for part in text.split(":")))
    except (TypeError, ValueError) as error:
        raise argparse.ArgumentTypeError(f"{text} is not a row range; write it like 420:701:10") from error
    if ":" not in text or not wanted or min(wanted) < 0:
        raise argparse.ArgumentTypeError(f"{text} contains no rows of a picture; write it like 420:701:10")
    return wanted
