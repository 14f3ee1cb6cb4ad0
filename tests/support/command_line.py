"""Start the commands of `lanes`, and `benchmark` and `simulator`, by one function."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
from pathlib import Path

import benchmark.__main__
import lanes.__main__
import simulator.__main__
from tests.support.project import ROOT

# A process that hangs fails its test after this time, also on a loaded machine; no test measures time.
WAIT_S = 900
PROGRAMS = {"benchmark": benchmark.__main__, "simulator": simulator.__main__}


def main(arguments: list[str]) -> int:
    """Run a command in this process and return its exit status."""
    name, *rest = arguments
    if name in PROGRAMS:
        return PROGRAMS[name].main(rest)
    return lanes.__main__.main(arguments)


def process(*arguments: object, python: tuple[str, ...] = ()) -> list[str]:
    """The argument list that starts a command as a new process."""
    words = [str(argument) for argument in arguments]
    if not words or words[0] not in PROGRAMS:
        words = ["lanes", *words]
    return [sys.executable, *python, "-m", *words]


def popen(
    command: list[str],
    *,
    cwd: Path = ROOT,
    limit_bytes: int | None = None,
    new_session: bool = False,
) -> subprocess.Popen:
    """A process with captured output that reacts to signals as one started from a
    shell; it finds this project.

    It may write no file larger than `limit_bytes`.
    """

    def prepare() -> None:
        # The tests may run with signals ignored or blocked, which child processes
        # inherit.
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_SETMASK, set())
        if limit_bytes:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit_bytes, limit_bytes))

    # One thread each, because several wait for each other on a busy machine.
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    if limit_bytes:  # coverage writes a file too
        environment.pop("COVERAGE_PROCESS_START", None)
    return subprocess.Popen(
        command,
        env=environment,
        cwd=cwd,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=prepare,
        start_new_session=new_session,
    )


def start(
    *arguments: object, python: tuple[str, ...] = (), **options: object
) -> subprocess.Popen:
    """A command as a new process; options as for `popen`."""
    return popen(process(*arguments, python=python), **options)


def run(
    *arguments: object, python: tuple[str, ...] = (), **options: object
) -> tuple[int, str, str]:
    """Exit status, stdout and stderr of a command that runs as a new process."""
    with start(*arguments, python=python, **options) as child:
        out, err = child.communicate(timeout=WAIT_S)
    return child.returncode, out, err
