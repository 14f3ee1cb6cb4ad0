"""Start the commands of `lanes`, and `benchmark` and `simulator`, by one function."""

from __future__ import annotations

import sys

import benchmark.__main__
import lanes.__main__
import simulator.__main__

PROGRAMS = {"benchmark": benchmark.__main__, "simulator": simulator.__main__}


def main(arguments: list[str]) -> int:
    """Run a command in this process and return its exit status."""
    program = PROGRAMS.get(arguments[0])
    return program.main(arguments[1:]) if program else lanes.__main__.main(arguments)


def process(*arguments: object, python: tuple[str, ...] = ()) -> list[str]:
    """The argument list that starts a command as a new process."""
    words = [str(argument) for argument in arguments]
    program = words if words and words[0] in PROGRAMS else ["lanes", *words]
    return [sys.executable, *python, "-m", *program]
