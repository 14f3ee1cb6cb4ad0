"""The commands of `python -m lanes`, where installed also `lanes`: a class each, whose
docstring is its help.

Plots and Dask are imported when a command needs them, so that help and wrong usage are
answered at once.
"""

from __future__ import annotations

import argparse
import os
import shlex
import sys
from collections.abc import Iterable, Sequence
from contextlib import closing
from dataclasses import replace
from difflib import get_close_matches
from itertools import chain, islice
from pathlib import Path

from lanes import __version__
from lanes.annotation import Annotation, DriveSettings
from lanes.camera.calibration import (
    BoardDetections,
    calibrate,
    calibrate_detections,
    describe_calibration,
    draw_contact_sheet,
    find_boards,
)
from lanes.camera.field_of_view import (
    OTHER_VIEWS,
    FieldOfView,
    find_field_of_view,
    given_field_of_view,
)
from lanes.camera.model import (
    CAR_WIDTH_M,
    CAR_WIDTH_RANGE_M,
    LENSES,
    MAX_OFFSET_M,
    Camera,
    load_camera,
    save_camera,
)
from lanes.console import (
    bounded,
    error_status,
    progress_line,
    run_command,
    run_program,
    seconds,
)
from lanes.describe import format_table, number_cells
from lanes.detect.markings import Markings, load_markings, network_files
from lanes.detect.search import HEIGHT_RANGE_M, detect_still
from lanes.drive import annotate_sources, make_tracker, planned_outputs
from lanes.drive_camera import camera_for, pose_for
from lanes.errors import CameraError, LaneError, PoseError
from lanes.files import require_no_input_among, write_json_lines
from lanes.label import describe_proposals, pick_stills, write_proposals
from lanes.labels import (
    detect_in_sequence,
    detect_in_stills,
    detect_in_video,
    files_of_labels,
    find_picture,
    labels_folder,
    read_labels,
    read_predictions,
)
from lanes.many import annotate_many, parallel_outputs
from lanes.pose.estimate import (
    ESTIMATED,
    LANE_WIDTH_M,
    POSE_PICTURES,
    PoseEstimate,
    estimate_pose,
)
from lanes.ros.log_files import is_robot_log
from lanes.score import (
    describe_predictions,
    score_stills,
    score_tables,
    write_score_page,
)
from lanes.show.draw import STYLES
from lanes.show.explanation import Explanation, explain, explain_tracked
from lanes.video.images import kind_of_file, read_image, write_image
from lanes.video.reader import (
    STAMP_TOLERANCE_S,
    VideoInfo,
    count_lost,
    inspect_video,
    read_frames,
)
from lanes.video.sources import (
    Sources,
    files_of,
    find_sources,
    list_names,
    require_distinct_outputs,
    require_topic,
    sample_images,
)


class Calibrate:
    """Calibrate the lens from 10 to 20 pictures or a video of a chessboard, and write a
    camera file. Tilt the board in another direction for each picture, and cover all
    parts of the picture. The inner corners of the board, columns x rows, are one less
    than its squares. A table lists for each picture whether it was used, and its error.
    The sheet shows the corners found.
    """

    SUMMARY = "calibrate the lens from pictures of a chessboard"
    EXAMPLES = """\
  {program} my_boards -o lens.yaml
  {program} --pattern 8x5 --sheet sheet.png boards/*.jpg"""

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        words = "picture or video of a chessboard, or folder of them"
        parser.add_argument(
            "pictures", nargs="+", type=Path, metavar="PICTURE", help=words
        )
        words = "inner corners of the board (default: 9x6)"
        parser.add_argument(
            "--pattern", type=_pattern, default=(9, 6), metavar="CxR", help=words
        )
        _add_topic(parser)
        words = "also write a picture of all boards with their corners"
        parser.add_argument("--sheet", type=Path, metavar="FILE", help=words)
        _add_output(parser, "camera.yaml", "camera file to write")

    def run(self, options: argparse.Namespace) -> int:
        sources = find_sources(map(str, options.pictures))
        paths = sources.files
        _note_skipped(sources)
        outputs = [options.output]
        if options.sheet:
            outputs.append(options.sheet)
        _require_free(outputs, options, paths)

        require_topic(paths, options.topic)
        detections = find_boards(
            paths,
            options.pattern,
            topic=options.topic,
            progress=progress_line("calibrate"),
        )
        source = ", ".join(map(str, options.pictures[:3]))
        try:
            camera = calibrate_detections(detections, source)
        except CameraError:
            if options.sheet:
                _write_sheet(options.sheet, detections, None)
            raise

        print(describe_calibration(detections, camera))
        print(f"wrote {save_camera(camera, options.output)}")
        if options.sheet:
            _write_sheet(options.sheet, detections, camera)
        return 0


def _write_sheet(
    path: Path, detections: BoardDetections, camera: Camera | None
) -> None:
    """Write the contact sheet of a calibration, also of one that failed."""
    sheet = draw_contact_sheet(detections, camera)
    print(f"wrote {write_image(path, sheet)}")


class Pose:
    """Estimate the camera pose (height, pitch, yaw and roll) from stills or videos of
    one drive, and write it with the lens into a camera file. Use 20 or more pictures of
    a marked road by day. One picture is enough, but gives larger standard deviations.
    Heights are above the road. The default width of the lanes is that of US
    Interstates.
    """

    SUMMARY = (
        "estimate the camera pose (height, pitch, yaw, roll) from pictures of a drive"
    )
    EXAMPLES = """\
  {program} --hfov 60 drive.mp4 -o camera.yaml
  {program} --camera lens.yaml --lane-width 3.5 drive/*.jpg -o camera.yaml
  {program} --hfov 60 --start 60 --end 90 drive.mp4
  {program} --boards my_boards --height 1.35 drive.mp4"""

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        words = "stills or videos of one drive"
        parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help=words)
        _add_drive_options(parser)
        parser.add_argument(
            "--pictures",
            type=bounded(int, 1),
            default=POSE_PICTURES,
            metavar="N",
            help="use at most N pictures (default: %(default)s)",
        )
        _add_output(parser, "camera.yaml", "camera file to write")

    def run(self, options: argparse.Namespace) -> int:
        lens, settings = find_lens(options)
        estimate = estimate_pose(
            options.files,
            lens,
            lane_width_m=options.lane_width_m,
            height_m=options.height_m,
            max_pictures=options.pictures,
            start_s=options.start_s,
            end_s=options.end_s,
            topic=options.topic,
            progress=progress_line("pose"),
            markings=settings.markings,
        )
        if not estimate.frames_used:
            raise PoseError(
                f"{options.files[0]}: none of {estimate.frames_total} pictures shows a "
                "likely lane, so the pose is unknown and no file is written; give "
                f"pictures of a marked road by day, or another lens ({OTHER_VIEWS})."
            )
        print(estimate.describe())
        print(estimate.describe_accuracy())
        print(f"wrote {save_camera(estimate.camera, options.output)}")
        return 0


class Annotate:
    """Draw the lane with curvature, offset and confidence on videos and stills.

    The output folder gets an annotated video with sound, the telemetry (CSV, one row
    per frame) and a report (HTML, works offline) for each video, and messages (MCAP)
    for each robot log (ROS bag, MCAP). Stills are processed independently. If the
    camera has no pose, the pose is estimated from each drive and printed with its
    standard deviations. All stills share one camera, unless --each gives each its own.

    With --workers or --scheduler (Dask) several videos are annotated in parallel. The
    next run skips finished videos. A table of all videos is written
    (docs/many_drives.md).
    """

    SUMMARY = "draw the lane on videos and stills; write telemetry and a report"
    EXAMPLES = """\
  {program} --hfov 60 drive.mp4
  {program} --camera camera.yaml drives/ more/*.mp4 -o results
  {program} --boards my_boards --style mosaic --start 60 --end 90 drive.mp4
  {program} --each photos/
  {program} --topic /front/image_raw drive.mcap
  {program} --camera camera.yaml "drives/**/*.mp4" -o results --workers 8"""

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        words = 'video, still, folder, or pattern such as "drives/*.mp4"'
        parser.add_argument("files", nargs="+", metavar="SOURCE", help=words)
        _add_drive_options(parser, each=True)
        _add_output(parser, "annotated", "output folder")
        words = (
            "lane: filled lane; lines: the two lines only; inset: with a bird's-eye "
            "view; mosaic: with intermediate results (default: %(default)s)"
        )
        parser.add_argument(
            "--style", choices=tuple(STYLES), default="lane", help=words
        )
        words = "write no HTML report"
        parser.add_argument(
            "--no-report", dest="report", action="store_false", help=words
        )
        parser.add_argument("--quiet", action="store_true", help="print errors only")

        words = "--scheduler requires Dask: pip install 'dask[distributed]' bokeh"
        many = parser.add_argument_group("many drives", words)
        where = many.add_mutually_exclusive_group()
        words = "number of processes on this machine"
        where.add_argument("--workers", type=bounded(int, 1), metavar="N", help=words)
        words = "address of a Dask scheduler, like tcp://10.0.0.1:8786"
        where.add_argument("--scheduler", metavar="ADDRESS", help=words)

    def run(self, options: argparse.Namespace) -> int:
        """Annotate all sources. A failed source does not stop the others; errors are
        printed at the end.
        """
        sources = find_sources(options.files)
        in_parallel = bool(options.workers or options.scheduler)
        to_write = DriveSettings(output=options.output, report=options.report)
        planned = planned_outputs(sources, to_write)
        require_distinct_outputs(planned)
        outputs = [output for _, output in planned]
        if in_parallel:
            outputs += parallel_outputs(sources.videos, options.output)
        settings = _read_settings(options, sources, outputs)
        settings = replace(settings, style=options.style, report=options.report)

        def say(words: str) -> None:
            if not options.quiet:
                print(words, flush=True)

        failures: list[Exception] = []
        done = 0
        if in_parallel and sources.videos:
            finished, failures = annotate_many(
                sources.videos,
                settings,
                workers=options.workers,
                scheduler=options.scheduler,
                log=say,
            )
            done = len(finished)
            sources = replace(sources, videos=())
        for outcome in annotate_sources(sources, settings):
            if isinstance(outcome, Annotation):
                done += 1
                failures += outcome.failures  # of single stills
                say(outcome.description)
            else:
                failures.append(outcome)
        return _report_failures(failures, done)


class Detect:
    """Write the columns of the lane lines at given rows of the raw pictures, one JSON
    line per picture: raw_file, h_samples, lanes (left, right, then the far lines of
    adjacent lanes that are seen; -2 for no point), sides (the name of each line),
    run_time (ms), state, confidence, offset_m (> 0: car left of the lane centre),
    curvature_per_m (> 0: bends left). If no camera file with a camera pose is given,
    the pose is first estimated from each video and from the stills, with --each from
    each still alone.
    """

    SUMMARY = (
        "write the lines of the ego lane in stills and videos as TuSimple JSON lines"
    )
    EXAMPLES = """\
  {program} --camera camera.yaml drive.mp4 -o lanes.jsonl
  {program} --hfov 60 --rows 240:721:10 stills/*.jpg
  {program} --each photos/*.jpg
  {program} --boards my_boards --sequence --fps 20 clip/*.jpg"""

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        words = "stills or videos of one camera"
        parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help=words)
        _add_drive_options(parser, each=True)
        words = (
            "picture rows, TO excluded (default: by the height; of pictures 720 high "
            "420:701:10)"
        )
        parser.add_argument(
            "--rows", type=_row_range, metavar="FROM:TO:STEP", help=words
        )
        words = "the stills are consecutive frames in this order"
        parser.add_argument("--sequence", action="store_true", help=words)
        words = "frames per second of --sequence (default: %(default)s)"
        parser.add_argument("--fps", type=bounded(float, 1), default=25.0, help=words)
        _add_output(parser, "lanes.jsonl", "file to write")

    def run(self, options: argparse.Namespace) -> int:
        """Detect the lane in every picture, and write the detections; returns 1 if a
        still was left out.
        """
        sources = find_sources(map(str, options.files))
        if options.each and options.sequence:
            raise ValueError(
                "--sequence is for stills of one camera; omit it, or omit --each."
            )
        if options.each and sources.videos:
            raise ValueError(
                f"{sources.videos[0]}: is a video, and --each is for stills; omit one "
                "of them."
            )
        settings = _read_settings(options, sources, [options.output])

        found = []
        missing = 0
        for video in sources.videos:
            frames = list(detect_in_video(video, settings, options.rows))
            found += frames
            missing += _count_missing(video, settings, frames)
        failures: list[LaneError] = []
        stills = sources.stills
        if options.sequence and stills:
            found += detect_in_sequence(stills, settings, options.rows, fps=options.fps)
        elif stills:
            found += detect_in_stills(stills, settings, options.rows, failures)

        lost = sum(detection["state"] == "lost" for detection in found)
        counts = f"{len(found)} pictures, no lane in {lost}"
        if missing:
            counts += f"; {missing} more are damaged or missing in the videos"
        print(f"wrote {write_json_lines(options.output, found)}: {counts}")
        return _report_failures(failures, len(found))


def _count_missing(video: Path, settings: DriveSettings, frames: Sequence[dict]) -> int:
    """Number of frames of a video that are damaged or not there."""
    info = inspect_video(video, topic=settings.topic)
    numbers = [frame["frame"] for frame in frames]
    return count_lost(info, numbers, settings.start_s, settings.end_s)


class Explain:
    """Plot every step of the lane detection in one picture, with its numbers: horizon,
    bird's-eye view, marking response, stripes, votes, fit and result. If a step failed,
    the figure and the printed text say why, and what to do. A frame of a video is
    explained as `annotate` sees it: the lane is tracked from the start of the video, or
    of the part, up to this frame. If no camera file with a camera pose is given, the
    pose is first estimated from the picture, the video or the part.
    """

    SUMMARY = (
        "plot every step of the lane detection in one picture, and which step failed"
    )
    EXAMPLES = """\
  {program} --camera camera.yaml drive.mp4 --at 12.5 -o explained.png
  {program} --hfov 60 long_drive.mp4 --start 600 --end 660 --at 612.5
  {program} --hfov 60 still.jpg"""

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        words = "picture or video"
        parser.add_argument("files", nargs=1, type=Path, metavar="FILE", help=words)
        words = "time of the frame in a video, as 83.5 or 1:23.5 (default: first frame)"
        parser.add_argument("--at", type=seconds, metavar="TIME", help=words)
        _add_drive_options(parser)
        _add_output(parser, "explained.png", "figure to write")

    def run(self, options: argparse.Namespace) -> int:
        from lanes.show.figures import figure_kind, save_figure, show_explanation

        figure_kind(options.output)
        (file,) = options.files
        info = None
        if kind_of_file(file) != "image":
            info = inspect_video(file, topic=options.topic)
        _require_time(options, file, info)

        lens, settings = find_lens(options)
        camera, estimate = pose_for(
            settings,
            lens,
            options.files,
            progress=progress_line("pose"),
            start_s=options.start_s,
            end_s=options.end_s,
            topic=options.topic,
        )
        if estimate:
            print(estimate.describe())
        if estimate and options.start_s:
            part = f"--start {options.start_s:g}"
            print(
                f"note: pose and track are those of annotate {part}, not of the whole"
            )
        if info:
            explanation = _explain_frame(options, info, camera, settings, estimate)
        else:
            explanation = _explain_still(file, camera, settings, estimate)

        print(explanation.describe())
        figure, _ = show_explanation(explanation)
        print(f"wrote {save_figure(figure, options.output)}")
        return 0


def _require_time(
    options: argparse.Namespace, file: Path, info: VideoInfo | None
) -> None:
    """Raise ValueError if --at is not in the video, or not in the part of it."""
    at_s = options.at
    length_s = info.duration_s if info else 0.0
    end_s = min(length_s, options.end_s or length_s)
    if at_s is not None and not options.start_s <= at_s < end_s:
        raise ValueError(
            f"{file}: has no frame at {at_s:g} s, it lasts {length_s:g} s; give an "
            "--at in it, and in --start to --end, or none for a picture."
        )


def _pose_doubt(estimate: PoseEstimate | None) -> str | None:
    """Why an estimated pose is uncertain, or empty; None if the pose was given."""
    if estimate is None:
        return None
    return "" if estimate.state == ESTIMATED else estimate.notes[0]


def _explain_frame(
    options: argparse.Namespace,
    info: VideoInfo,
    camera: Camera,
    settings: DriveSettings,
    estimate: PoseEstimate | None,
) -> Explanation:
    """Explain the frame at --at of a video, or its first one."""
    tracker = make_tracker(info.fps, camera, estimate, settings.markings)
    until_s = None
    count: int | None = 1
    if options.at is not None:
        until_s = options.at + 2 * STAMP_TOLERANCE_S
        count = None
    frames = read_frames(
        options.files[0], info, start_s=options.start_s, end_s=until_s, progress=True
    )
    with closing(frames):
        shown = islice(frames, count)
        return explain_tracked(shown, tracker, pose_doubt=_pose_doubt(estimate))


def _explain_still(
    file: Path, camera: Camera, settings: DriveSettings, estimate: PoseEstimate | None
) -> Explanation:
    """Explain a still, with the detection that its pose was estimated from."""
    image = read_image(file)
    detection = estimate.still if estimate else None
    if detection is None and settings.markings:
        detection = detect_still(image, camera, markings=settings.markings)
    pose_doubt = _pose_doubt(estimate)
    return explain(image, camera, detection=detection, pose_doubt=pose_doubt)


class Label:
    """Prepare stills for labelme, the program to mark the lines with: beside each
    still, a JSON file of the same name with the lines that are found in it. Files that
    are there stay. Of a video, stills are taken first. The lines are line strips called
    left, right, far left and far right. After the lines of a still are corrected, tick
    the flag `checked`: `score` leaves out the others (docs/own_camera.md).
    """

    SUMMARY = (
        "prepare stills to mark their lines in labelme, as labels to score against"
    )
    EXAMPLES = (
        "  {program} --hfov 60 stills/\n"
        "  {program} --each photos/*.jpg\n"
        "  {program} --hfov 60 drive.mp4 --stills 50 -o my_stills"
    )

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        words = "stills, folder of stills, or video"
        parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help=words)
        _add_drive_options(parser, each=True)
        words = "number of stills to take from each video (default: %(default)s)"
        parser.add_argument(
            "--stills", type=bounded(int, 1), default=20, metavar="N", help=words
        )
        _add_output(parser, "labels", "folder for the stills of videos")

    def run(self, options: argparse.Namespace) -> int:
        """Write the label files; returns 1 if a still was left out."""
        sources = find_sources(map(str, options.files))
        settings = _read_settings(options, sources)
        stills = list(sources.stills)
        for video in sources.videos:
            stills += pick_stills(video, settings, options.stills)

        failures: list[LaneError] = []
        written = write_proposals(stills, settings, failures)
        print(describe_proposals(stills, written))
        return _report_failures(failures, len(stills) - len(failures))


class Score:
    """Score the lines that `detect` or any other program predicts in labelled stills,
    and write a page with the worst stills. Labels and predictions are TuSimple JSON
    lines: raw_file, h_samples (rows; predictions may lack them), lanes (columns, -2 for
    no point), optionally sides and confidence. Or they are line strips of labelme: a
    file, or a folder with its subfolders. A flat road is assumed for metres.
    """

    SUMMARY = "score predicted lines on labelled stills, and show the worst of them"
    EXAMPLES = (
        "  {program} stills/ lanes.jsonl\n"
        "  {program} --camera camera.yaml labels.jsonl lanes.jsonl"
    )

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        words = (
            "labels: a file, to which the names of the stills are relative, or a "
            "folder of labelme"
        )
        parser.add_argument("labels", type=Path, metavar="LABELS", help=words)
        words = "lines that a program predicts, in the same forms"
        parser.add_argument("predictions", type=Path, metavar="PREDICTIONS", help=words)
        words = "camera file with a pose, for errors in metres"
        parser.add_argument("--camera", type=Path, metavar="YAML", help=words)
        _add_output(parser, "score.html", "page to write")

    def run(self, options: argparse.Namespace) -> int:
        labels = read_labels(options.labels)
        predictions = read_predictions(options.predictions, labels)
        camera = load_camera(options.camera) if options.camera else None
        if camera and not camera.pose:
            raise CameraError(
                f"{options.camera}: holds no camera pose; use the file that `pose` "
                "writes."
            )

        folder = labels_folder(options.labels)
        pictures = [find_picture(folder, label.name) for label in labels]
        inputs = [*files_of_labels(options.labels), *pictures]
        inputs += files_of_labels(options.predictions)
        _require_free([options.output], options, inputs)

        scores = score_stills(labels, predictions, pictures, camera)
        tables = score_tables(scores)
        for title, table in tables.items():
            print(f"{title}:\n{format_table(*number_cells(table))}\n")
        notes = ""
        for what, some in describe_predictions(labels, predictions, pictures):
            if some:
                count = f"{len(some)} of {len(labels)}"
                notes += f"note: {count} {what}: {list_names(some)}\n"
        page = write_score_page(
            options.output,
            scores,
            pictures,
            tables,
            title=f"{options.predictions} on {options.labels}",
            notes=notes,
        )
        print(f"{notes}wrote {page}")
        return 0


_CLASSES = (Calibrate, Pose, Annotate, Detect, Explain, Label, Score)
COMMANDS = {command.__name__.lower(): command() for command in _CLASSES}
_SUMMARIES = [f"  {name:<9}  {command.SUMMARY}" for name, command in COMMANDS.items()]
_EPILOG = "\n".join(["commands:", *_SUMMARIES])
_EPILOG += """

In a clone of the project, python -m simulator renders roads with ground truth and
python -m benchmark scores lane finders.

examples:
  {program} annotate --hfov 60 drive.mp4
  {program} annotate --help"""


def main(arguments: list[str] | None = None) -> int:
    """Run a command; returns its exit status, see `run_command`."""
    if arguments is None:
        arguments = sys.argv[1:]
    program = "lanes" if Path(sys.argv[0]).stem == "lanes" else "python -m lanes"
    parser = argparse.ArgumentParser(
        prog=program,
        usage=f"{program} [-h] COMMAND ...",
        description="Find the ego lane in pictures and videos, measure it in metres, "
        "and draw it.",
        epilog=_EPILOG.format(program=program),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    words = "one of the commands below; COMMAND --help describes it"
    parser.add_argument("command", type=_command_name, metavar="COMMAND", help=words)
    version = f"lanes {__version__}"
    parser.add_argument("--version", action="version", version=version)
    name = parser.parse_args(arguments[:1]).command
    return run_command(COMMANDS[name], f"{program} {name}", arguments[1:])


def installed_command() -> None:
    """The command `lanes` of an installation."""
    run_program(main)


def _command_name(text: str) -> str:
    """An argparse type: the name of a command; for another word the error proposes the
    nearest one.
    """
    if text in COMMANDS:
        return text
    nearest = get_close_matches(text, COMMANDS, 1, cutoff=0.4)
    hint = f"did you mean {nearest[0]}? The" if nearest else "the"
    raise argparse.ArgumentTypeError(
        f"there is no command {text}; {hint} commands are {', '.join(COMMANDS)}"
    )


# Options that several commands share.


def _add_drive_options(parser: argparse.ArgumentParser, *, each: bool = False) -> None:
    """Add the options of `add_lens`, for the scale of a pose, for a part of the videos,
    and maybe --each.
    """
    if each:
        words = (
            "the stills are of different cameras: estimate the pose of each on its own"
        )
        parser.add_argument("--each", action="store_true", help=words)
    add_lens(parser)
    parser.add_argument(
        "--lane-width",
        dest="lane_width_m",
        type=bounded(float, 2, 6),
        metavar="M",
        help="true width of the lanes, metres, for a pose that is estimated "
        f"(default: {LANE_WIDTH_M})",
    )
    parser.add_argument(
        "--height",
        dest="height_m",
        type=bounded(float, *HEIGHT_RANGE_M),
        metavar="M",
        help="measured height of the camera, metres, for a pose that is estimated",
    )
    parser.add_argument(
        "--start",
        dest="start_s",
        type=seconds,
        default=0.0,
        metavar="TIME",
        help="start at this time of each video, as 83.5 or 1:23.5",
    )
    parser.add_argument(
        "--end",
        dest="end_s",
        type=seconds,
        metavar="TIME",
        help="stop at this time of each video",
    )


def add_lens(parser: argparse._ActionsContainer) -> None:
    """Add the options for lens and place of the camera, --topic and --markings.

    Options that the command does not have, and that the settings depend on, get their
    defaults.
    """
    parser.set_defaults(
        quiet=False,
        each=False,
        start_s=0.0,
        end_s=None,
        lane_width_m=None,
        height_m=None,
    )
    lens = parser.add_mutually_exclusive_group()
    words = "camera file written by `calibrate` or `pose`"
    lens.add_argument("--camera", type=Path, metavar="YAML", help=words)
    words = (
        "horizontal field of view of an uncalibrated lens, degrees (default: from the "
        "EXIF of the stills, else 60)"
    )
    lens.add_argument("--hfov", type=bounded(float, 10, 150), metavar="DEG", help=words)
    words = (
        "folder of pictures, or video, of a chessboard with 9 x 6 inner corners, to "
        "calibrate the lens from"
    )
    lens.add_argument("--boards", type=Path, metavar="PATH", help=words)
    words = (
        "lens of --hfov (default: equidistant, as of action cameras, for more than 95 "
        "degrees, else pinhole)"
    )
    parser.add_argument("--lens", choices=LENSES, help=words)
    parser.add_argument(
        "--camera-offset",
        dest="camera_offset_m",
        type=bounded(float, -MAX_OFFSET_M, MAX_OFFSET_M),
        metavar="M",
        help="how far the camera is left of the middle of the car, metres, as it looks "
        "(of a rear camera: on the car's right); < 0: right (default: that of the "
        "camera file)",
    )
    parser.add_argument(
        "--car-width",
        dest="car_width_m",
        type=bounded(float, *CAR_WIDTH_RANGE_M),
        metavar="M",
        help="width of the car over its tyres, metres, for departure warnings "
        f"(default: {CAR_WIDTH_M})",
    )
    _add_topic(parser)
    words = (
        "network that finds the lane markings (docs/own_network.md); MODEL.onnx,own: "
        "together with our filters"
    )
    parser.add_argument("--markings", metavar="MODEL.onnx", help=words)


def _add_topic(parser: argparse._ActionsContainer) -> None:
    words = "topic of the images in a robot log (default: the only one)"
    parser.add_argument("--topic", metavar="NAME", help=words)


def _add_output(parser: argparse.ArgumentParser, default: str, what: str) -> None:
    """Add --output, with `what` as its help text."""
    words = f"{what} (default: %(default)s)"
    parser.add_argument("-o", "--output", type=Path, default=Path(default), help=words)


def find_lens(options: argparse.Namespace) -> tuple[Camera, DriveSettings]:
    """Camera, for images of the size of the first file, and settings according to the
    options of `add_lens`.
    """
    sources = find_sources(map(str, options.files))
    settings = _read_settings(options, sources, [options.output])
    start_s = options.start_s
    image = next(sample_images(sources.files, 1, start_s=start_s, topic=options.topic))
    height, width = image.shape[:2]
    return camera_for(settings, (width, height), sources.files[0]), settings


def _require_free(
    outputs: Sequence[Path],
    options: argparse.Namespace,
    sources: Iterable[Path],
    markings: Markings | None = None,
) -> None:
    """Raise ValueError if an output of a command is a file that it reads, or another
    output.

    It reads the sources, and the files that its options name.
    """
    names = vars(options)
    inputs = list(chain.from_iterable(map(files_of, sources)))
    if names.get("camera"):
        inputs.append(options.camera)
    if names.get("boards"):
        inputs += find_sources([str(options.boards)]).files
    if markings:
        inputs += network_files(markings)
    require_no_input_among(outputs, inputs)

    if len(set(map(os.path.realpath, outputs))) < len(outputs):
        raise ValueError(f"{outputs[-1]}: is to be written twice; name another file.")


def _read_settings(
    options: argparse.Namespace, sources: Sources, outputs: Sequence[Path] = ()
) -> DriveSettings:
    """The settings according to the options; --boards is calibrated here.

    Raises ValueError if one of the outputs is a file that the command reads.

    Prints which files were skipped, and what `_find_field` prints.
    """
    _note_skipped(sources)
    if options.lens and options.hfov is None:
        raise ValueError(
            "--lens needs a field of view; give --hfov as well, or omit --lens."
        )
    boards: tuple[Path, ...] = ()
    if options.boards:
        boards = find_sources([str(options.boards)]).files
    require_topic([*sources.files, *boards], options.topic)
    markings = load_markings(options.markings) if options.markings else None
    _require_free(outputs, options, sources.files, markings)

    camera = None
    field = None
    if options.camera:
        camera = load_camera(options.camera)
    elif options.boards:
        progress = None if options.quiet else progress_line("boards")
        has_topic = any(map(is_robot_log, boards))
        camera = calibrate(
            options.boards,
            topic=options.topic if has_topic else None,
            progress=progress,
        )
    else:
        field = _find_field(options, sources)
    if options.end_s is not None and options.end_s <= options.start_s:
        raise ValueError(
            f"--end {options.end_s:g} is not after --start {options.start_s:g}; give a "
            "later end."
        )
    return DriveSettings(
        output=options.output,
        camera=camera,
        field=field,
        camera_options=_camera_options(options),
        each=options.each,
        start_s=options.start_s,
        end_s=options.end_s,
        progress=not options.quiet,
        topic=options.topic,
        markings=markings,
        camera_offset_m=options.camera_offset_m,
        car_width_m=options.car_width_m,
        lane_width_m=options.lane_width_m,
        height_m=options.height_m,
    )


def _note_skipped(sources: Sources) -> None:
    """Print which files are no input."""
    for note in sources.notes():
        print(f"note: {note}", file=sys.stderr)


def _find_field(options: argparse.Namespace, sources: Sources) -> FieldOfView:
    """The field of view of an uncalibrated lens.

    It is printed, unless --hfov gives a usual one, or with --each all stills name
    theirs.
    """
    if options.hfov is not None:
        field = given_field_of_view(options.hfov, options.lens)
        if field.doubtful and not options.lens:
            _print_fields([field])
        return field
    if not options.each:
        field = find_field_of_view(sources.files, options.topic)
        _print_fields([field])
        return field

    field = find_field_of_view((), options.topic)
    of_stills = [find_field_of_view([still]) for still in sources.stills]
    if sources.videos or any(of_still.assumed for of_still in of_stills):
        _print_fields([field])
    named = [of_still for of_still in of_stills if not of_still.assumed]
    doubtful = [of_still for of_still in named if of_still.doubtful]
    _print_fields(doubtful[:1])
    return field


def _print_fields(fields: Iterable[FieldOfView]) -> None:
    for field in fields:
        warning = "warning: " if field.doubtful else ""
        print(f"{warning}{field.describe()}", file=sys.stderr)


def _camera_options(options: argparse.Namespace) -> str:
    """The options of camera and pose that were given, for another command line."""
    given = {
        "camera": options.camera,
        "hfov": options.hfov,
        "boards": options.boards,
        "lens": options.lens,
        "camera-offset": options.camera_offset_m,
        "car-width": options.car_width_m,
        "topic": options.topic,
        "markings": options.markings,
        "lane-width": options.lane_width_m,
        "height": options.height_m,
    }
    words = []
    for name, value in given.items():
        if value is not None:
            words.append(f"--{name} {shlex.quote(str(value))}")
    return " ".join(words)


def _report_failures(failures: Sequence[Exception], done: int) -> int:
    """Print errors; returns the exit status: 1 if something was done nevertheless, else
    that of the errors.
    """
    for failure in failures:
        print(f"error: {failure}", file=sys.stderr)
    if failures and not done:
        return max(map(error_status, failures))
    return 1 if failures else 0


def _pattern(text: str) -> tuple[int, int]:
    """An argparse type: inner corners of a chessboard, columns and rows, written like
    9x6.
    """
    columns, _, rows = text.lower().partition("x")
    are_numbers = columns.isdecimal() and rows.isdecimal()
    if not are_numbers or min(int(columns), int(rows)) < 3:
        raise argparse.ArgumentTypeError(
            f"{text} is not a chessboard pattern; write its inner corners like 9x6, at "
            "least 3x3"
        )
    return int(columns), int(rows)


def _row_range(text: str) -> range:
    """An argparse type: image rows, written like 420:701:10."""
    try:
        wanted = range(*map(int, text.split(":")))
    except (TypeError, ValueError) as error:
        raise argparse.ArgumentTypeError(
            f"{text} is not a row range; write it like 420:701:10"
        ) from error
    if ":" not in text or not wanted or min(wanted) < 0:
        raise argparse.ArgumentTypeError(
            f"{text} contains no rows of a picture; write it like 420:701:10"
        )
    return wanted


if __name__ == "__main__":
    installed_command()
