"""The command line: `python -m lanes COMMAND`, where installed also `lanes COMMAND`; commands are in lanes/cli/."""

from __future__ import annotations

import argparse
import sys
from importlib import import_module
from pathlib import Path

from lanes import __version__
from lanes.console import run_command, run_program

COMMANDS = {
    "calibrate": "calibrate the lens from pictures of a chessboard",
    "pose": "estimate the camera pose (height, pitch, yaw, roll) from pictures of a drive",
    "annotate": "draw the lane on videos and stills; write telemetry and a report",
    "detect": "write the lines of the ego lane in stills and videos as TuSimple JSON lines",
    "explain": "plot every step of the lane detection in one picture, and which step failed",
}


def main(arguments: list[str] | None = None) -> int:
    """Run a command; returns its exit status, see `run_command`."""
    arguments = sys.argv[1:] if arguments is None else arguments
    program = "lanes" if Path(sys.argv[0]).stem == "lanes" else "python -m lanes"
    name = _command_parser(program).parse_args(arguments[:1]).command
    return run_command(import_module(f"lanes.cli.{name}"), f"{program} {name}", arguments[1:])


def installed_command() -> None:
    """The command `lanes` of an installation."""
    run_program(main)


def _command_parser(program: str) -> argparse.ArgumentParser:
    width = max(map(len, COMMANDS))
    parser = argparse.ArgumentParser(
        prog=program,
        usage=f"{program} [-h] COMMAND ...",
        description="Find the ego lane in pictures and videos, measure it in metres, and draw it.",
        epilog="commands:\n"
        + "\n".join(f"  {name:<{width}}  {text}" for name, text in COMMANDS.items())
        + "\n\nIn a clone of the project, python -m simulator renders roads with ground truth and\n"
        "python -m benchmark scores lane finders.\n\n"
        "examples:\n"
        f"  {program} annotate --hfov 60 drive.mp4\n  {program} annotate --help",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "command", choices=COMMANDS, metavar="COMMAND", help="one of the commands below; COMMAND --help describes it"
    )
    parser.add_argument("--version", action="version", version=f"lanes {__version__}")
    return parser


if __name__ == "__main__":
    installed_command()
