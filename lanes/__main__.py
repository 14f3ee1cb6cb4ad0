"""The command line: python -m lanes <command>. What each does is in the module of its name in lanes/cli/."""

from __future__ import annotations

import argparse
import sys
from importlib import import_module

from lanes.io.console import run_command, run_program

COMMANDS = {
    "calibrate": "find the lens from pictures of a chessboard",
    "pose": "estimate how the camera sits on the car, from its own pictures",
    "annotate": "draw the lane on videos, stills or a live camera; telemetry and a report beside each video",
    "detect": "find the lines of the own lane in pictures and videos, as TuSimple JSON lines",
    "explain": "show every step from one picture to its lane, and where it failed",
}
PROGRAM = "python -m lanes"


def main(arguments: list[str] | None = None) -> int:
    """Run a command; returns the exit status, see `run_command`."""
    arguments = sys.argv[1:] if arguments is None else arguments
    name = _command_parser().parse_args(arguments[:1]).command
    return run_command(import_module(f"lanes.cli.{name}"), f"{PROGRAM} {name}", arguments[1:])


def _command_parser() -> argparse.ArgumentParser:
    width = max(map(len, COMMANDS))
    parser = argparse.ArgumentParser(
        prog=PROGRAM,
        usage=f"{PROGRAM} [-h] COMMAND ...",
        description="Find the lane, measure it, draw it.",
        epilog="commands:\n"
        + "\n".join(f"  {name:<{width}}  {text}" for name, text in COMMANDS.items())
        + f"\n\npython -m simulator renders roads with their truth; "
        f"python -m benchmark scores lane finders.\n\nexamples:\n"
        f"  {PROGRAM} annotate --hfov 60 drive.mp4\n  {PROGRAM} annotate --help",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("command", choices=COMMANDS, metavar="COMMAND", help="one of those below; --help tells more")
    return parser


if __name__ == "__main__":
    run_program(main)
