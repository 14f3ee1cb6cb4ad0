"""Render the course's chessboards, stills and videos, or a scene of the suite, with their ground truth."""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path

from lanes.console import bounded, progress_line, run_command, run_program

EXAMPLES = """\
  {program}
  {program} stills --out renders
  {program} video --seconds 2 --out renders
  {program} --scene hairpin-left"""


EMBEDDED = ("boards", "stills", "video", "challenge", "harder")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of this command."""
    parser.add_argument(
        "what",
        nargs="?",
        default="all",
        choices=(*EMBEDDED, "all"),
        help="what to render: chessboards into camera_cal/, stills into test_images/, the videos into test_videos/ "
        "(default: all)",
    )
    scene = "render this scene of the suite into the cache folder (LANES_CACHE) instead, if it is not there yet"
    parser.add_argument("--scene", metavar="NAME", help=scene)
    out = "folder that holds these folders (default: the current one)"
    parser.add_argument("--out", type=Path, default=Path("."), help=out)
    longest = "maximum length of a video in seconds (default: %(default)s)"
    parser.add_argument(
        "--seconds",
        type=bounded(float, 0.04, 10),
        default=10.0,
        metavar="S",
        help=longest,
    )


def run(options: argparse.Namespace) -> int:
    """Render the selected files; returns the exit status."""
    from lanes.files import translate_write_errors
    from simulator.chessboards import write_boards
    from simulator.scenes.suite import render_scene, write_course_video, write_stills

    if options.scene:
        print(
            f"{options.scene}: {render_scene(options.scene, progress=progress_line(options.scene))}"
        )
        return 0
    with translate_write_errors(options.out):
        options.out.mkdir(parents=True, exist_ok=True)
    videos = options.out / "test_videos"
    jobs = {
        "boards": partial(write_boards, options.out / "camera_cal"),
        "stills": partial(write_stills, options.out / "test_images"),
        "video": partial(
            write_course_video, videos, "project_video", seconds=options.seconds
        ),
        "challenge": partial(
            write_course_video, videos, "challenge_video", seconds=options.seconds
        ),
        "harder": partial(
            write_course_video,
            videos,
            "harder_challenge_video",
            seconds=options.seconds,
        ),
    }
    for name, job in jobs.items():
        if options.what in (name, "all"):
            written = job(progress=progress_line(name))
            print(
                f"{name}: wrote {', '.join(str(path) for path in written[-3:])}, {len(written)} files in total"
            )
    return 0


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit status, see `run_command`."""
    arguments = sys.argv[1:] if arguments is None else arguments
    return run_command(sys.modules[__name__], "python -m simulator", arguments)


if __name__ == "__main__":
    run_program(main)
