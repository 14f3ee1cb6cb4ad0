"""Measurements as text, times of the command line, and the progress line on a terminal and in a log file."""

from __future__ import annotations

import io
import re
import sys

import pytest

from lanes.console import progress_line, seconds
from lanes.describe import describe_bend, describe_offset


@pytest.mark.parametrize(
    ("curvature_per_m", "std_per_m", "text"),
    [
        (-1 / 644, 0.0, "bends right, R 640 m"),
        (1 / 2990, 0.0, "bends left, R 2990 m"),
        (1 / 54_000, 0.0, "straight (R > 3 km)"),
        (-1 / 3001, 0.0, "straight (R > 3 km)"),
        (0.0, 1e-4, "straight (R > 3 km)"),
        (1 / 37.4, 1e-3, "bends left, R 37 m"),
        (-5e-4, 4.8e-4, "bends right, R 2000 m"),
        (5e-4, 5.2e-4, "straight (R > 1000 m)"),
        (1 / 63, 0.02, "bend unknown"),
        (None, 0.0, "bend unknown"),
    ],
)
def test_bend(curvature_per_m, std_per_m, text):
    assert describe_bend(curvature_per_m, std_per_m) == text


@pytest.mark.parametrize(
    ("offset_m", "std_m", "text"),
    [
        (0.124, None, "0.12 m left of centre"),
        (-0.3, None, "0.30 m right of centre"),
        (-0.004, None, "in the centre"),
        (None, None, "offset unknown"),
        (0.124, 0.023, "0.12 ± 0.02 m left of centre"),
        # no standard deviation is stated as zero
        (-0.3, 0.004, "0.30 ± 0.01 m right of centre"),
    ],
)
def test_offset(offset_m, std_m, text):
    assert describe_offset(offset_m, std_m) == text


@pytest.mark.parametrize(("text", "time_s"), [("83.5", 83.5), ("1:23.5", 83.5), ("2:01:05", 7265.0)])
def test_times_have_minutes_and_hours(text, time_s):
    assert seconds(text) == time_s


@pytest.mark.parametrize("terminal", [True, False], ids=["terminal", "log file"])
def test_a_terminal_gets_a_bar_and_a_log_file_the_last_state(monkeypatch, terminal):
    stream = io.StringIO()
    stream.isatty = lambda: terminal
    monkeypatch.setattr(sys, "stderr", stream)
    report = progress_line("pose")
    for done in (1, 2, 3, 1, 2, 3):  # the second time, a search begins again
        report(done, 3)
    if terminal:
        assert len(re.findall(r"\rpose: 100%.* 3/3 \[\d\d:\d\d<00:00.*\n", stream.getvalue())) == 2
    else:
        assert stream.getvalue() == "pose: 3 of 3\npose: 3 of 3\n"
