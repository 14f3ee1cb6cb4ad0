"""Measurements as text, times of the command line, and the progress line on a terminal
and in a log file.
"""

from __future__ import annotations

import io
import re
import sys

import pytest

from lanes.console import progress_line, seconds
from lanes.describe import describe_bend, describe_heading, describe_offset


@pytest.mark.parametrize(
    ("describe", "numbers", "text"),
    [
        (describe_bend, (-1 / 644,), "bends right, R 640 m"),
        (describe_bend, (1 / 2990, 0.0), "bends left, R 2990 m"),
        (describe_bend, (1 / 54_000, 0.0), "straight (R > 3 km)"),
        (describe_bend, (-1 / 3001, 0.0), "straight (R > 3 km)"),
        (describe_bend, (0.0, 1e-4), "straight (R > 3 km)"),
        (describe_bend, (1 / 37.4, 1e-3), "bends left, R 37 m"),
        (describe_bend, (-5e-4, 4.8e-4), "bends right, R 2000 m"),
        (describe_bend, (5e-4, 5.2e-4), "straight (R > 1000 m)"),
        (describe_bend, (1 / 63, 0.02), "bend unknown"),
        (describe_bend, (None, 0.0), "bend unknown"),
        (describe_offset, (0.124, None), "0.12 m left of centre"),
        (describe_offset, (-0.3,), "0.30 m right of centre"),
        (describe_offset, (-0.004, None), "in the centre"),
        (describe_offset, (None, None), "offset unknown"),
        (describe_offset, (0.124, 0.023), "0.12 ± 0.02 m left of centre"),
        # no standard deviation is stated as zero
        (describe_offset, (-0.3, 0.004), "0.30 ± 0.01 m right of centre"),
        (describe_heading, (0.01,), "0.6 deg to the left"),
        (describe_heading, (-8e-4,), "straight ahead"),
    ],
)
def test_measurements_as_text(describe, numbers, text):
    assert describe(*numbers) == text


@pytest.mark.parametrize(
    ("text", "expected_s"), [("83.5", 83.5), ("1:23.5", 83.5), ("2:01:05", 7265.0)]
)
def test_times_with_minutes_and_hours(text, expected_s):
    assert seconds(text) == expected_s


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def report_two_searches(monkeypatch, stderr: io.StringIO) -> str:
    """What the progress line writes when a search begins again."""
    monkeypatch.setattr(sys, "stderr", stderr)
    report = progress_line("pose")
    for done in (1, 2, 3, 1, 2, 3):
        report(done, 3)
    return stderr.getvalue()


def test_a_terminal_gets_a_bar_for_each_search(monkeypatch):
    written = report_two_searches(monkeypatch, Terminal())
    complete = r"\rpose: 100%.* 3/3 \[\d\d:\d\d<00:00.*\n"
    assert len(re.findall(complete, written)) == 2


def test_a_log_file_gets_the_last_state_of_each_search(monkeypatch):
    written = report_two_searches(monkeypatch, io.StringIO())
    assert written == "pose: 3 of 3\npose: 3 of 3\n"
