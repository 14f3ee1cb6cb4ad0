"""Write the columns of the two ego lane lines at given rows of the raw pictures, one JSON line per
picture: raw_file, h_samples, lanes (left, right; -2 for no point), run_time (ms), state, confidence,
offset_m (> 0: car left of the lane centre), curvature_per_m (> 0: bends left). If no camera file with
a camera pose is given, the pose is first estimated from the files, with --each from each still alone.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from lanes.cli.arguments import add_footage, add_lens, add_output, find_field, find_lens, given_camera
from lanes.console import bounded_float, progress_line

EXAMPLES = """\
  {program} --camera camera.yaml drive.mp4 -o lanes.jsonl
  {program} --hfov 60 --rows 240:721:10 stills/*.jpg
  {program} --each photos/*.jpg
  {program} --boards my_boards --sequence --fps 20 clip/*.jpg"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this command."""
    add_footage(parser, files="stills or videos of one camera")
    add_lens(parser)
    parser.add_argument(
        "--each", action="store_true", help="the stills are of different cameras: estimate the pose of each on its own"
    )
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
    """Detect the lane in every picture, and write the detections; with --each returns 1 if a still was left out."""
    from lanes.detections import count_missing_frames, write_detections
    from lanes.files import require_no_input_among

    require_no_input_among([options.output], options.files)
    found, failures = _detect_each(options) if options.each else (_detect_together(options), [])
    lost = sum(detection["state"] == "lost" for detection in found)
    missing = count_missing_frames(found)
    damaged = f"; {missing} more are damaged or missing in the videos" if missing else ""
    print(f"wrote {write_detections(options.output, found)}: {len(found)} pictures, no lane in {lost}{damaged}")
    for failure in failures:
        print(f"error: {failure}", file=sys.stderr)
    return 1 if failures else 0


def _detect_together(options: argparse.Namespace) -> list[dict]:
    """The detections in stills and videos of one camera; prints its pose if that was estimated."""
    from lanes.detections import detect_files
    from lanes.pose import ensure_pose

    camera, estimate = ensure_pose(find_lens(options), options.files, progress=progress_line("pose"))
    if estimate:
        print(estimate.describe())
    return detect_files(
        options.files,
        camera,
        options.rows,
        sequence=options.sequence,
        fps=options.fps,
        progress=progress_line("detect"),
    )


def _detect_each(options: argparse.Namespace) -> tuple[list[dict], Sequence[ValueError]]:
    """The detections in stills of a camera each, and the errors of the stills that cannot be used."""
    from lanes.annotate import DriveSettings, detect_stills
    from lanes.detections import as_detection
    from lanes.errors import LaneError
    from lanes.track.tracker import TrackedLane

    if options.sequence or options.size:
        raise ValueError("--sequence and --size are for stills of one camera; omit them, or omit --each.")
    camera = given_camera(options)
    field = find_field(options, [], each=options.files) if camera is None else None
    settings = DriveSettings(output=options.output, camera=camera, field=field, each=True)
    found: list[dict] = []
    failures: list[LaneError] = []
    for still in detect_stills(options.files, settings, failures):
        tracked, camera = TrackedLane.from_still(still.detection.lane), still.detection.camera
        found.append({"raw_file": str(still.path)} | as_detection(tracked, camera, options.rows, still.run_time_s))
        if still.pose:
            print(f"{still.path}: {still.pose.summary_line()}{settings.lens_of_still(still.path)}")
    return found, failures


def rows(text: str) -> range:
    """An argparse type: picture rows, written like 420:701:10."""
    try:
        wanted = range(*(int(part) for part in text.split(":")))
    except (TypeError, ValueError) as error:
        raise argparse.ArgumentTypeError(f"{text} is not a row range; write it like 420:701:10") from error
    if ":" not in text or not wanted or min(wanted) < 0:
        raise argparse.ArgumentTypeError(f"{text} contains no rows of a picture; write it like 420:701:10")
    return wanted
