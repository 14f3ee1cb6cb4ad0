"""The command line: python -m lanes <command>. What each does is in the module of its name in lanes/commands/."""

from __future__ import annotations

import argparse
import signal
import sys
from importlib import import_module

from lanes.commands.arguments import error_status

COMMANDS = {
    "calibrate": "find the lens from pictures of a chessboard",
    "mount": "estimate how the camera sits on the car, from its own pictures",
    "annotate": "draw the lane on videos, stills or a live camera; telemetry and a report beside each video",
    "detect": "find the lines of the own lane in pictures and videos, as TuSimple JSON lines",
    "explain": "show every step from one picture to its lane, and where it failed",
    "benchmark": "score every lane finder on roads whose truth is known",
    "render": "render the embedded pictures and video again, with their truth",
}
PROGRAM = "python -m lanes"
INTERRUPTED = 130


def main(arguments: list[str] | None = None) -> int:
    """Run a command; returns the exit status.

    0: done; 1: could not be done, for instance because the output cannot be written or the pictures show no road;
    2: wrong usage, or an input that is missing or bad; 130: interrupted. A process that is told to end (SIGTERM)
    removes what is half-written, and then has status 143.
    """
    arguments = sys.argv[1:] if arguments is None else arguments
    name = _command_parser().parse_args(arguments[:1]).command
    command = import_module(f"lanes.commands.{name}")
    parser = argparse.ArgumentParser(
        prog=f"{PROGRAM} {name}",
        description=command.__doc__,
        epilog=f"examples:\n{command.EXAMPLES}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    command.add_arguments(parser)
    options = parser.parse_args(arguments[1:])
    try:
        return command.run(options)
    except (OSError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return error_status(error)
    except KeyboardInterrupt:
        print("\ninterrupted; nothing half-written was left behind", file=sys.stderr)
        return INTERRUPTED


def _command_parser() -> argparse.ArgumentParser:
    width = max(map(len, COMMANDS))
    parser = argparse.ArgumentParser(
        prog=PROGRAM,
        usage=f"{PROGRAM} [-h] COMMAND ...",
        description="Find the lane, measure it, draw it.",
        epilog="commands:\n"
        + "\n".join(f"  {name:<{width}}  {text}" for name, text in COMMANDS.items())
        + f"\n\nexamples:\n  {PROGRAM} annotate --hfov 60 drive.mp4\n  {PROGRAM} annotate --help",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("command", choices=COMMANDS, metavar="COMMAND", help="one of those below; --help tells more")
    return parser


if __name__ == "__main__":
    # As an exception, which takes back what is half-written, like Ctrl-C.
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
    # File names and signs such as ± must not stop a command where the terminal cannot show them.
    sys.stdout.reconfigure(errors="backslashreplace")
    sys.exit(main())
