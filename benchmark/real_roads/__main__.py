"""Found Roads: labelled stills of other people's cameras for any lane finder.

`fetch` gets the stills from their repositories, `score` scores the lines of a program,
`run` those of the engine of this project. Choices are made on half A of the sets and
confirmed on half B.
"""

from __future__ import annotations

import argparse
import sys

from benchmark.real_roads import fetch, run, score
from lanes.console import run_command, run_program

COMMANDS = {"fetch": fetch, "score": score, "run": run}
PROGRAM = "python -m benchmark.real_roads"


def main(arguments: list[str] | None = None) -> int:
    """Run a command; returns the exit status of `run_command`."""
    if arguments is None:
        arguments = sys.argv[1:]
    parser = argparse.ArgumentParser(
        prog=PROGRAM, usage=f"{PROGRAM} [-h] COMMAND ...", description=__doc__
    )
    words = "COMMAND --help describes it"
    parser.add_argument("command", choices=COMMANDS, help=words)
    name = parser.parse_args(arguments[:1]).command
    return run_command(COMMANDS[name], f"{PROGRAM} {name}", arguments[1:])


if __name__ == "__main__":
    run_program(main)
