"""The command line: python -m lanes <command>."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path


def main(arguments: list[str] | None = None) -> int:
    """Run a command; returns the exit status (0 done, 1 could not be done, 2 wrong usage)."""
    parser = argparse.ArgumentParser(prog="python -m lanes", description="Find the lane, measure it, draw it.")
    commands = parser.add_subparsers(dest="command", required=True)
    render = commands.add_parser("render", help="render the embedded pictures and video again, with their truth")
    render.add_argument("what", nargs="?", default="all", choices=("boards", "stills", "video", "all"))
    render.add_argument("--out", type=Path, default=Path("."), help="folder to write into (default: here)")
    render.set_defaults(run=run_render)
    options = parser.parse_args(arguments)
    try:
        return options.run(options)
    except (OSError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\ninterrupted; nothing half-written was left behind", file=sys.stderr)
        return 130


def run_render(options: argparse.Namespace) -> int:
    """Render boards, stills, video or all of them into `options.out`."""
    from lanes.scenes.boards import write_boards
    from lanes.scenes.produce import write_stills, write_video

    jobs = {
        "boards": lambda report: write_boards(options.out / "camera_cal", progress=report),
        "stills": lambda report: write_stills(options.out / "test_images", progress=report),
        "video": lambda report: write_video(options.out / "test_videos" / "project_video.mp4", progress=report),
    }
    for name, job in jobs.items():
        if options.what in (name, "all"):
            written = job(_progress_line(name))
            print(f"{name}: wrote {', '.join(str(path) for path in written[-3:])}, {len(written)} files in all")
    return 0


def _progress_line(name: str):
    """A callback (done, total) that keeps one line on the terminal up to date."""

    def report(done: int, total: int) -> None:
        print(f"\r{name}: {done} of {total}", end="\n" if done == total else "", file=sys.stderr, flush=True)

    return report


if __name__ == "__main__":
    sys.exit(main())
