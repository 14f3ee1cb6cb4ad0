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
from typing import TYPE_CHECKING, Any

from lanes.errors import PoseError

if TYPE_CHECKING:
    from tqdm import tqdm


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
    # python -m lanes, lanes
    if sys.argv[:1] == ["-m"] or Path(sys.argv[0]).stem == "lanes":
        sys.exit(f"error: {sentence}")
    raise ImportError(sentence)


def split_names(text: str) -> list[str]:
    """The names in "a,b,c", for argparse."""
    return text.split(",")


def bounded(
    kind: type[float] | type[int], minimum: float, maximum: float = math.inf
) -> Callable[[str], Any]:
    """An argparse type: a number of that kind from `minimum` to `maximum`."""
    what = "an integer" if kind is int else "a number"
    limits = f"from {minimum:g} to {maximum:g}"
    if maximum == math.inf:
        limits = f">= {minimum:g}"

    def parse(text: str) -> float:
        try:
            value = kind(text)
        except ValueError:
            value = math.nan
        if not minimum <= value <= maximum or value == math.inf:
            raise argparse.ArgumentTypeError(
                f"invalid value {text}: expected {what} {limits}"
            )
        return value

    return parse


def seconds(text: str) -> float:
    """An argparse type: a time as seconds, m:ss or h:mm:ss."""
    *before, last = text.split(":")
    if len(before) > 2 or not all(part.isdecimal() for part in before):
        raise argparse.ArgumentTypeError(
            f"invalid value {text}: expected seconds, or a time like 1:05.5"
        )
    value: float = bounded(float, 0)(last)
    if before and value >= 60:
        raise argparse.ArgumentTypeError(
            f"invalid value {text}: expected less than 60 seconds after a colon"
        )
    for place, part in enumerate(reversed(before), 1):
        value += int(part) * 60**place
    return value


def progress_bar(
    name: str | None, unit: str, total: int, *, shown: bool = True
) -> tqdm:
    """A bar on stderr with rate and remaining time, if that is a terminal or a
    notebook.
    """
    from tqdm import tqdm  # late: help and wrong usage need no bar

    # A notebook's stderr also handles the carriage return. Text needs no ipywidgets.
    in_notebook = type(sys.stderr).__module__.startswith("ipykernel")
    interactive = sys.stderr.isatty() or in_notebook
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

    def show(message: Warning | str, *_: Any, **__: Any) -> None:
        print(f"warning: {message}", file=sys.stderr)

    with warnings.catch_warnings():
        warnings.showwarning = show
        yield


def error_status(error: Exception) -> int:
    """Exit status for an error: 2 for a missing or bad input, 1 if the work could not
    be done with good inputs.
    """
    if isinstance(error, FileNotFoundError):
        return 2
    return 1 if isinstance(error, OSError | PoseError) else 2


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
    signal.signal(signal.SIGTERM, _exit_on_signal)
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    # A terminal that cannot show a file name or a sign such as ± must not stop the
    # command, nor one that is closed (`| head`) or a full disk behind it: the exit
    # status is that of the work.
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed before the start
            setattr(sys, name, StringIO())
        elif isinstance(stream, TextIOWrapper):
            encoding = stream.encoding
            output = TextIOWrapper(
                BufferedWriter(_Unfailing(stream.detach())),
                encoding,
                errors="backslashreplace",
                line_buffering=True,
            )
            setattr(sys, name, output)
    sys.exit(main())


def _exit_on_signal(number: int, _: object) -> None:
    # An exception, as Ctrl-C raises one, so that half-written files are removed.
    sys.exit(128 + number)


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
