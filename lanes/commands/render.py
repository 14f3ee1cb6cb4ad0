"""Render the embedded chessboards, stills and videos again, or a scene of the suite, each with its truth file."""

from __future__ import annotations

import argparse
from pathlib import Path

from lanes.commands.arguments import number, progress_line

EXAMPLES = """\
  python -m lanes render
  python -m lanes render stills --out elsewhere
  python -m lanes render video --seconds 2 --out elsewhere
  python -m lanes render --scene hairpin-left"""


EMBEDDED = ("boards", "stills", "video", "challenge", "harder")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this command."""
    parser.add_argument("what", nargs="?", default="all", choices=(*EMBEDDED, "all"))
    parser.add_argument(
        "--scene", metavar="NAME", help="a scene of the suite instead, into the cache (LANES_CACHE) unless it is there"
    )
    parser.add_argument("--out", type=Path, default=Path("."), help="folder to write into (default: here)")
    parser.add_argument(
        "--seconds",
        type=number(0.04, 10),
        default=10.0,
        metavar="S",
        help="greatest length of a video (default: %(default)s)",
    )


def run(options: argparse.Namespace) -> int:
    """Render what is asked for."""
    from lanes.files import writing_to
    from lanes.scenes.boards import write_boards
    from lanes.scenes.produce import write_stills, write_video
    from lanes.scenes.suite import render_scene
    from lanes.scenes.suite_famous import write_challenge_video, write_harder_video

    if options.scene:
        print(f"{options.scene}: {render_scene(options.scene, progress=progress_line(options.scene))}")
        return 0
    with writing_to(options.out):
        options.out.mkdir(parents=True, exist_ok=True)
    videos = options.out / "test_videos"
    jobs = {
        "boards": lambda report: write_boards(options.out / "camera_cal", progress=report),
        "stills": lambda report: write_stills(options.out / "test_images", progress=report),
        "video": lambda report: write_video(videos / "project_video.mp4", seconds=options.seconds, progress=report),
        "challenge": lambda report: write_challenge_video(videos, seconds=options.seconds, progress=report),
        "harder": lambda report: write_harder_video(videos, seconds=options.seconds, progress=report),
    }
    for name, job in jobs.items():
        if options.what in (name, "all"):
            written = job(progress_line(name))
            print(f"{name}: wrote {', '.join(str(path) for path in written[-3:])}, {len(written)} files in all")
    return 0
