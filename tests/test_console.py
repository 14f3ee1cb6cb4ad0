"""The progress line on a terminal and in a log file."""

from __future__ import annotations

import io
import sys

import pytest

from lanes.console import progress_line


@pytest.mark.parametrize(
    "terminal, printed",
    [(True, "\rpose: 1 of 3\rpose: 2 of 3\rpose: 3 of 3\n"), (False, "pose: 3 of 3\n")],
    ids=["terminal", "log file"],
)
def test_a_log_file_gets_the_last_state_only(monkeypatch, terminal, printed):
    stream = io.StringIO()
    stream.isatty = lambda: terminal
    monkeypatch.setattr(sys, "stderr", stream)
    report = progress_line("pose")
    for done in (1, 2, 3):
        report(done, 3)
    assert stream.getvalue() == printed
