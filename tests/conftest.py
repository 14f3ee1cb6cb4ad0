"""Settings of all tests."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator

import pytest
from hypothesis import settings

from tests.support.command_line import main

# The same examples in every run, without a time limit for each, because the machine may
# be busy.
settings.register_profile("course", derandomize=True, deadline=None)
settings.load_profile("course")


@pytest.fixture
def sigint() -> Iterator[None]:
    """Ctrl-C is not ignored here and in started processes, as it would be if a script
    had started pytest with ``&``.
    """
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def run(capsys) -> Callable[..., tuple[int, str, str]]:
    """A function that runs a command in this process; returns its exit status, stdout
    and stderr.
    """

    def run(*arguments: object) -> tuple[int, str, str]:
        try:
            status = main([str(argument) for argument in arguments])
        except SystemExit as stop:  # wrong usage
            status = stop.code
        return status, *capsys.readouterr()

    return run
