"""The tool that chooses the marking response of stills."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest

from tests.support.project import ROOT

STILL = ROOT / "test_images" / "straight_lines1.jpg"


def run(*arguments: object) -> subprocess.CompletedProcess:
    command = [sys.executable, "-m", "tools.still_response", *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True)


@pytest.mark.slow
def test_both_responses_find_the_lane_of_a_clear_road(tmp_path):
    """They find it a little elsewhere. The pose comes from the same picture, so `detect` alone uses the network."""
    columns = {}
    for response in ("network", "band"):
        output = tmp_path / f"{response}.jsonl"
        assert run(response, "lanes", "detect", "--each", STILL, "-o", output).returncode == 0
        columns[response] = np.array(json.loads(output.read_text(encoding="utf-8"))["lanes"])
    both = (columns["network"] >= 0) & (columns["band"] >= 0)
    assert both.mean() > 0.5
    assert 0 < np.abs(columns["network"] - columns["band"])[both].max() < 15
    plain = tmp_path / "plain.jsonl"
    command = [sys.executable, "-m", "lanes", "detect", "--each", str(STILL), "-o", str(plain)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    np.testing.assert_array_equal(json.loads(plain.read_text(encoding="utf-8"))["lanes"], columns["network"])


@pytest.mark.parametrize("options", [["motorway"], ["--labels", "x.jsonl", "--workers", "2"]])
def test_scenes_and_workers_are_refused(options):
    """The cache of the benchmark does not know the response, and other processes do not have it."""
    result = run("network", "benchmark", *options)
    assert result.returncode == 1 and "leave out --workers" in result.stderr
