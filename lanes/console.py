"""Shared parts of the command lines: checked number types, a progress line and exit
statuses.
"""

from __future__ import annotations

import argparse
import math
import signal
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from io import BufferedIOBase, BufferedWriter, RawIOBase, StringIO, TextIOWrapper
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any

from tqdm import tqdm

from lanes.errors import PoseError


def require_opencv() -> None:
    """Raise ImportError if the installed OpenCV is too old; a command ends with its
    sentence.
    """
    version = import_module("cv2").__version__
    if int(version.partition(".")[0]) >= 5:
        return
    sentence = (
        f"OpenCV {version} is installed, but lanes needs 5; run pip uninstall "
        "opencv-python opencv-python-headless and "
        'pip install "opencv-python-headless>=5,<6".'
    )
    if sys.argv[:1] == ["-m"] or Path(sys.argv[0]).stem == "lanes":  # python -m lanes, lanes
        sys.exit(f"error: {sentence}")
    raise ImportError(sentence)


def bounded(kind: type[float] | type[int], minimum: float, maximum: float = math.inf) -> Callable[[str], Any]:
    """An argparse type: a number of that kind from `minimum` to `maximum`."""
    what = "an integer" if kind is int else "a number"
    limits = f">= {minimum:g}" if maximum == math.inf else f"from {minimum:g} to {maximum:g}"

    def parse(text: str) -> float:
        try:
            value = kind(text)
        except ValueError:
            value = math.nan
        if not minimum <= value <= maximum or value == math.inf:
            raise argparse.ArgumentTypeError(f"invalid value {text}: expected {what} {limits}")
        return value

    return parse


def seconds(text: str) -> float:
    """An argparse type: a time as seconds, m:ss or h:mm:ss."""
    *before, last = text.split(":")
    if len(before) > 2 or not all(part.isdecimal() for part in before):
        raise argparse.ArgumentTypeError(f"invalid value {text}: expected seconds, or a time like 1:05.5")
    value: float = bounded(float, 0)(last)
    if before and value >= 60:
        raise argparse.ArgumentTypeError(f"invalid value {text}: expected less than 60 seconds after a colon")
    for place, part in enumerate(reversed(before), 1):
        value += int(part) * 60**place
    return value


def progress_bar(name: str | None, unit: str, total: int, *, shown: bool = True) -> tqdm:
    """A bar on stderr with rate and remaining time, if that is a terminal or a
    notebook.
    """
    # A notebook's stderr also handles the carriage return. Text needs no ipywidgets.
    interactive = sys.stderr.isatty() or type(sys.stderr).__module__.startswith("ipykernel")
    return tqdm(desc=name, unit=unit, total=total, disable=not (shown and interactive))


def progress_line(name: str) -> Callable[[int, int], None]:
    """A callback (done, total) that updates a `progress_bar`; in a log file only the
    last state is printed.
    """
    bar: tqdm | None = None

    def report(done: int, total: int) -> None:
        nonlocal bar
        if bar is None or done < bar.n:  # begins, or begins again
            bar = progress_bar(name, "step", total)
        bar.update(done - bar.n)
        if done == total and bar.disable:
            print(f"{name}: {done} of {total}", file=sys.stderr, flush=True)
        elif done == total:
            bar.close()

    return report


@contextmanager
def sigint_blocked() -> Iterator[None]:
    """Delay Ctrl-C; processes that are started meanwhile inherit the blocked signal."""
    # Python starts its resource tracker with the first process, and unblocks the signal
    # after that.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def plain_warnings() -> Iterator[None]:
    """Print warnings as errors are printed: one line, without the place in the code."""
    with warnings.catch_warnings():
        warnings.showwarning = lambda message, *_: print(f"warning: {message}", file=sys.stderr)
        yield


def error_status(error: Exception) -> int:
    """Exit status for an error: 2 for a missing or bad input, 1 if the work could not
    be done with good inputs.
    """
    cannot_write = isinstance(error, OSError) and not isinstance(error, FileNotFoundError)
    return 1 if cannot_write or isinstance(error, PoseError) else 2


def run_command(command: Any, program: str, arguments: list[str]) -> int:
    """Run a command, a module or object with a docstring, EXAMPLES,
    `add_arguments(parser)` and `run(options)`.

    In EXAMPLES, `{program}` stands for `program`, which is how the user starts this
    command. Returns the exit status: 0 done; 1 failed with good inputs, such as an
    unwritable output or images without a road; 2 wrong usage, or a missing or bad
    input; 130 interrupted.
    """
    parser = argparse.ArgumentParser(
        prog=program,
        description=command.__doc__,
        epilog=f"examples:\n{command.EXAMPLES.format(program=program)}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    command.add_arguments(parser)
    options = parser.parse_args(arguments)
    try:
        with plain_warnings():
            return command.run(options)
    except (OSError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return error_status(error)
    except KeyboardInterrupt:
        print("\ninterrupted; nothing half-written was left behind", file=sys.stderr)
        return 130


def run_program(main: Callable[[], int]) -> None:
    """Exit this process with the status of `main()`; SIGTERM gives status 143."""
    # SIGTERM raises an exception, as Ctrl-C does, so that half-written files are
    # removed.
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
    # A terminal that cannot show a file name or a sign such as ± must not stop the
    # command, nor one that is closed (`| head`) or a full disk behind it: the exit
    # status is that of the work.
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed before the start
            setattr(sys, name, StringIO())
        elif isinstance(stream, TextIOWrapper):
            output = BufferedWriter(_Unfailing(stream.detach()))
            setattr(sys, name, TextIOWrapper(output, stream.encoding, "backslashreplace", line_buffering=True))
    sys.exit(main())


class _Unfailing(RawIOBase):
    """An output stream that drops the text that cannot be written."""

    def __init__(self, output: BufferedIOBase) -> None:
        self._output = output

    def writable(self) -> bool:
        return True

    def isatty(self) -> bool:
        return self._output.isatty()

    def fileno(self) -> int:
        return self._output.fileno()

    def write(self, data: Any) -> int:
        with suppress(OSError):
            self._output.write(data)
            self._output.flush()
        return len(data)
