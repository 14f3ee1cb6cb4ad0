"""Render the course's chessboards, stills and videos, or a scene of the suite,
with their ground truth."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from lanes.console import bounded, progress_line, run_command, run_program

EXAMPLES = """\
  {program}
  {program} stills --out renders
  {program} video --seconds 2 --out renders
  {program} --scene hairpin-left"""


COURSE_VIDEOS = {
    "video": "project_video",
    "challenge": "challenge_video",
    "harder": "harder_challenge_video",
}
EMBEDDED = ("boards", "stills", *COURSE_VIDEOS)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of this command."""
    parser.add_argument(
        "what",
        nargs="?",
        default="all",
        choices=(*EMBEDDED, "all"),
        help="what to render: chessboards into camera_cal/, stills into test_images/, "
        "the videos into test_videos/ (default: all)",
    )
    parser.add_argument(
        "--scene",
        metavar="NAME",
        help="render this scene of the suite into the cache folder (LANES_CACHE) "
        "instead, if it is not there yet",
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("."),
        help="folder that holds these folders (default: the current one)",
    )
    parser.add_argument(
        "--seconds",
        type=bounded(float, 0.04, 10),
        default=10.0,
        metavar="S",
        help="maximum length of a video in seconds (default: %(default)s)",
    )


def run(options: argparse.Namespace) -> int:
    """Render the selected files; returns the exit status."""
    from lanes.files import translate_write_errors
    from simulator.scenes.suite import render_scene

    if options.scene:
        progress = progress_line(options.scene)
        path = render_scene(options.scene, progress=progress)
        print(f"{options.scene}: {path}")
        return 0

    with translate_write_errors(options.out):
        options.out.mkdir(parents=True, exist_ok=True)
    selected = EMBEDDED if options.what == "all" else (options.what,)
    for name in selected:
        written = _render(name, options)
        last = ", ".join(str(path) for path in written[-3:])
        print(f"{name}: wrote {last}, {len(written)} files in total")
    return 0


def _render(
    name: str,
    options: argparse.Namespace,
) -> list[Path]:
    """Files written for one of EMBEDDED."""
    from simulator.chessboards import write_boards
    from simulator.scenes.suite import write_course_video, write_stills

    progress = progress_line(name)
    if name == "boards":
        return write_boards(options.out / "camera_cal", progress=progress)
    if name == "stills":
        return write_stills(options.out / "test_images", progress=progress)
    return write_course_video(
        options.out / "test_videos",
        COURSE_VIDEOS[name],
        seconds=options.seconds,
        progress=progress,
    )


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit status, see `run_command`."""
    arguments = sys.argv[1:] if arguments is None else arguments
    return run_command(sys.modules[__name__], "python -m simulator", arguments)


if __name__ == "__main__":
    run_program(main)
