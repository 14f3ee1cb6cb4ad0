"""Draw the lane on videos, stills or a live camera's pictures, with bend, offset and how sure that is.

Each video gets a new one, its telemetry (CSV, a row a frame) and a report (HTML, works offline) of
the same name in the output folder; the sound is kept. Stills are looked at one by one. A number
is a camera of this computer: it is followed until Ctrl-C. Where the camera file has no pose, each
drive's own pictures tell how the camera sits on the car; that is then printed, with how sure it is.

With --workers or --scheduler videos are annotated at the same time, by Dask; finished ones are
skipped the next time, and a summary of all is written (docs/many_drives.md).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from lanes.cli.arguments import add_lens, add_piece, find_field, require_piece
from lanes.io.console import bounded_float, error_status, positive_int, progress_line

if TYPE_CHECKING:
    from lanes.drives.settings import DriveSettings
    from lanes.drives.sources import Sources

# What a job that was done tells, and what was wrong with single stills of it.
Told = tuple[str, "Sequence[Exception]"]

EXAMPLES = """\
  python -m lanes annotate --hfov 60 drive.mp4
  python -m lanes annotate --camera camera.yaml drives/ more/*.mp4 -o results
  python -m lanes annotate --boards my_boards --style mosaic --start 60 --end 90 drive.mp4
  python -m lanes annotate --camera camera.yaml 0
  python -m lanes annotate --camera camera.yaml "drives/**/*.mp4" -o results --workers 8"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this command."""
    parser.add_argument(
        "sources", nargs="+", metavar="SOURCE", help="video, still, folder or pattern of them, or a camera's number"
    )
    add_lens(parser)
    parser.add_argument("-o", "--output", type=Path, default=Path("annotated"), help="folder (default: %(default)s)")
    add_piece(parser)
    parser.add_argument(
        "--style",
        choices=("lane", "lines", "mosaic"),
        default="lane",
        help="lane: filled; lines: only its two lines; mosaic: with the steps beside it (default: %(default)s)",
    )
    parser.add_argument("--no-report", action="store_true", help="write no HTML report")
    parser.add_argument("--quiet", action="store_true", help="print errors only")
    many = parser.add_argument_group("many drives", "these need Dask: pip install -r requirements-cluster.txt")
    where = many.add_mutually_exclusive_group()
    where.add_argument(
        "--workers", type=positive_int, metavar="N", help="processes on this machine, each with one thread"
    )
    where.add_argument("--scheduler", metavar="ADDRESS", help="of a Dask cluster, like tcp://10.0.0.1:8786")
    many.add_argument(
        "--piece",
        type=bounded_float(10),
        default=300.0,
        metavar="S",
        help="drives longer than one and a half times this are cut into pieces of about this length, which are "
        "worked on at the same time and joined (default: %(default)g)",
    )
    many.add_argument(
        "--retries",
        type=int,
        choices=range(11),
        default=2,
        metavar="N",
        help="try a drive so often again, up to 10, when a worker dies or a disk fails (default: %(default)s)",
    )


def run(options: argparse.Namespace) -> int:
    """Annotate all sources; those that fail do not stop the others and are named at the end."""
    from lanes.drives.annotation import output_path
    from lanes.drives.sources import find_sources, require_distinct_outputs

    sources = find_sources(options.sources)
    require_distinct_outputs(sources.videos, [output_path(video, options.output) for video in sources.videos])
    settings = read_settings(options, sources)
    failures, done = [], 0
    if (options.workers or options.scheduler) and sources.videos:
        done, failures = annotate_apart(sources.videos, settings, options)
        sources = replace(sources, videos=())
    for job in list_jobs(sources, settings):
        try:
            told, left_out = job()
        except (OSError, ValueError) as error:
            failures.append(error)
        else:
            done += 1
            failures += left_out
            if not options.quiet:
                print(told, flush=True)
    for error in failures:
        print(f"error: {error}", file=sys.stderr)
    if failures and not done:
        return max(map(error_status, failures))
    return 1 if failures else 0


def annotate_apart(
    videos: Sequence[Path], settings: DriveSettings, options: argparse.Namespace
) -> tuple[int, list[OSError | ValueError]]:
    """Annotate videos with Dask; how many are finished now, and why the others failed."""
    from lanes.cluster.scheduler import ClusterSettings, annotate_many

    cluster = ClusterSettings(
        scheduler=options.scheduler, workers=options.workers, piece_s=options.piece, retries=options.retries
    )
    finished, failures = annotate_many(
        videos, settings, cluster, log=lambda text: None if options.quiet else print(text, flush=True)
    )
    return len(finished), failures


def read_settings(options: argparse.Namespace, sources: Sources) -> DriveSettings:
    """The settings that the options ask for; boards are calibrated here."""
    from lanes.camera.calibration.boards import calibrate_folder
    from lanes.camera.camera_file import load_camera
    from lanes.drives.settings import DriveSettings

    require_piece(options)
    camera = field = None
    if options.camera:
        camera = load_camera(options.camera)
    elif options.boards:
        camera = calibrate_folder(options.boards, progress=None if options.quiet else progress_line("boards"))
    else:
        field = find_field(options, [*sources.stills, *sources.videos])
    return DriveSettings(
        output=options.output,
        camera=camera,
        field=field,
        style=options.style,
        start_s=options.start,
        end_s=options.end,
        report=not options.no_report,
        progress=not options.quiet,
    )


def list_jobs(sources: Sources, settings: DriveSettings) -> Iterator[Callable[[], Told]]:
    """What there is to do, each a function that does it."""
    from lanes.drives.annotation import annotate_drive, annotate_stills
    from lanes.drives.live import annotate_live

    def follow_video(video: Path) -> Told:
        return annotate_drive(video, settings).describe(), ()

    def find_in_stills() -> Told:
        result = annotate_stills(sources.stills, settings)
        return result.describe(), result.failures

    def follow_camera(index: int) -> Told:
        if settings.progress:
            print(f"camera {index}: annotating until Ctrl-C", file=sys.stderr)
        return annotate_live(index, settings).describe(), ()

    for video in sources.videos:
        yield partial(follow_video, video)
    if sources.stills:
        yield find_in_stills
    for index in sources.cameras:
        yield partial(follow_camera, index)
