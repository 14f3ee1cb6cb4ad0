"""What every command line here shares: checked number types, a progress line and exit statuses."""

from __future__ import annotations

import argparse
import math
import signal
import sys
from collections.abc import Callable
from types import ModuleType

INTERRUPTED = 130


def number(least: float, most: float = math.inf) -> Callable[[str], float]:
    """An argparse type: a number from `least` to `most`."""
    limits = f"{least:g} or more" if most == math.inf else f"{least:g} to {most:g}"

    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not (least <= value <= most and math.isfinite(value)):
            raise argparse.ArgumentTypeError(f"{text} does not do; give a number, {limits}")
        return value

    return parse


def count(text: str) -> int:
    """An argparse type: a whole number from 1."""
    if not (text.isdecimal() and int(text)):
        raise argparse.ArgumentTypeError(f"{text} does not do; give a whole number, 1 or more")
    return int(text)


def progress_line(name: str) -> Callable[[int, int], None]:
    """A callback (done, total) that keeps one line on stderr up to date."""

    def report(done: int, total: int) -> None:
        print(f"\r{name}: {done} of {total}", end="\n" if done == total else "", file=sys.stderr, flush=True)

    return report


def error_status(error: OSError | ValueError) -> int:
    """Exit status for an error: 2 if an input is missing or bad, 1 if the work could not be done with it."""
    cannot_write = isinstance(error, OSError) and not isinstance(error, FileNotFoundError)
    return getattr(error, "exit_status", 1 if cannot_write else 2)


def run_command(command: ModuleType, program: str, arguments: list[str]) -> int:
    """Run a command, a module with a docstring, EXAMPLES, `add_arguments(parser)` and `run(options)`.

    Returns
    -------
    int
        The exit status. 0: done; 1: could not be done, for instance because the output cannot be written or the
        pictures show no road; 2: wrong usage, or an input that is missing or bad; 130: interrupted.
    """
    parser = argparse.ArgumentParser(
        prog=program,
        description=command.__doc__,
        epilog=f"examples:\n{command.EXAMPLES}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    command.add_arguments(parser)
    options = parser.parse_args(arguments)
    try:
        return command.run(options)
    except (OSError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return error_status(error)
    except KeyboardInterrupt:
        print("\ninterrupted; nothing half-written was left behind", file=sys.stderr)
        return INTERRUPTED


def run_program(main: Callable[[], int]) -> None:
    """End this process with the exit status of `main()`; a process that is told to end (SIGTERM) has status 143."""
    # As an exception, so that half-written files are removed, as on Ctrl-C.
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
    # File names and signs such as ± must not stop a command where the terminal cannot show them.
    sys.stdout.reconfigure(errors="backslashreplace")
    sys.exit(main())
