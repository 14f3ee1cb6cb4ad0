"""Draw the lane with curvature, offset and confidence on videos and stills.

The output folder gets an annotated video with sound, the telemetry (CSV, one row per frame) and a
report (HTML, works offline) for each video, all named after it. Stills are processed independently.
If the camera has no pose, the pose is estimated from each drive and printed with its standard
deviations. All stills share one camera, unless --each gives every still a camera of its own.

With --workers or --scheduler, Dask annotates several videos in parallel. The next run skips finished
videos. A summary of all videos is written (docs/many_drives.md).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from lanes.cli.arguments import add_lens, add_output, add_piece, find_field, given_camera, require_piece
from lanes.console import bounded_int, error_status

if TYPE_CHECKING:
    from lanes.annotate import DriveResult, DriveSettings, StillsResult
    from lanes.sources import Sources

EXAMPLES = """\
  {program} --hfov 60 drive.mp4
  {program} --camera camera.yaml drives/ more/*.mp4 -o results
  {program} --boards my_boards --style mosaic --start 60 --end 90 drive.mp4
  {program} --each photos/
  {program} --camera camera.yaml "drives/**/*.mp4" -o results --workers 8"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this command."""
    parser.add_argument(
        "sources",
        nargs="+",
        metavar="SOURCE",
        help='video, still, folder, or pattern such as "drives/*.mp4"',
    )
    add_lens(parser)
    parser.add_argument(
        "--each", action="store_true", help="the stills are of different cameras: estimate the pose of each on its own"
    )
    add_output(parser, "annotated", "output folder")
    add_piece(parser)
    parser.add_argument(
        "--style",
        choices=("lane", "lines", "mosaic"),
        default="lane",
        help="lane: filled lane; lines: the two lines only; mosaic: with intermediate results (default: %(default)s)",
    )
    parser.add_argument("--no-report", action="store_true", help="write no HTML report")
    parser.add_argument("--quiet", action="store_true", help="print errors only")
    _add_many_drives(parser)


def _add_many_drives(parser: argparse.ArgumentParser) -> None:
    """Add the options for Dask."""
    many = parser.add_argument_group("many drives", "require Dask: pip install 'dask[distributed]' bokeh")
    where = many.add_mutually_exclusive_group()
    where.add_argument(
        "--workers", type=bounded_int(1), metavar="N", help="number of processes on this machine, with one thread each"
    )
    where.add_argument("--scheduler", metavar="ADDRESS", help="address of a Dask scheduler, like tcp://10.0.0.1:8786")


def run(options: argparse.Namespace) -> int:
    """Annotate all sources. A failed source does not stop the others; errors are printed at the end."""
    from lanes.annotate import output_path
    from lanes.sources import find_sources, require_distinct_outputs

    sources = find_sources(options.sources)
    require_distinct_outputs(sources.videos, [output_path(video, options.output) for video in sources.videos])
    settings = read_settings(options, sources)
    failures: list[Exception] = []
    done = 0
    if (options.workers or options.scheduler) and sources.videos:
        done, failures = annotate_on_dask(sources.videos, settings, options)
        sources = replace(sources, videos=())
    for job in list_jobs(sources, settings):
        try:
            result = job()
        except (OSError, ValueError) as error:
            failures.append(error)
        else:
            done += 1
            failures += getattr(result, "failures", ())  # of single stills
            if not options.quiet:
                print(result.describe(), flush=True)
    for failure in failures:
        print(f"error: {failure}", file=sys.stderr)
    if failures and not done:
        return max(map(error_status, failures))
    return 1 if failures else 0


def annotate_on_dask(
    videos: Sequence[Path], settings: DriveSettings, options: argparse.Namespace
) -> tuple[int, list[Exception]]:
    """Annotate videos with Dask; returns the number of finished videos, and the errors of the others."""
    from lanes.many import annotate_many

    finished, failures = annotate_many(
        videos,
        settings,
        workers=options.workers,
        scheduler=options.scheduler,
        log=lambda text: None if options.quiet else print(text, flush=True),
    )
    return len(finished), failures


def read_settings(options: argparse.Namespace, sources: Sources) -> DriveSettings:
    """The settings according to the options; --boards is calibrated here."""
    from lanes.annotate import DriveSettings

    require_piece(options)
    camera = given_camera(options)
    # With --each the EXIF entries of each still are read with the still.
    files, each = ([*sources.videos], sources.stills) if options.each else ([*sources.stills, *sources.videos], None)
    return DriveSettings(
        output=options.output,
        camera=camera,
        field=find_field(options, files, each=each) if camera is None else None,
        each=options.each,
        style=options.style,
        start_s=options.start,
        end_s=options.end,
        report=not options.no_report,
        progress=not options.quiet,
    )


def list_jobs(sources: Sources, settings: DriveSettings) -> Iterator[Callable[[], DriveResult | StillsResult]]:
    """One function per job: each video, all stills together."""
    from lanes.annotate import annotate_drive, annotate_stills

    for video in sources.videos:
        yield partial(annotate_drive, video, settings)
    if sources.stills:
        yield partial(annotate_stills, sources.stills, settings)
