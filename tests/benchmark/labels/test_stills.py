"""`python -m benchmark --labels ... --each-folder`: stills of several cameras."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmark.labels.stills import split_folders
from benchmark.labels.tusimple import read_labels
from lanes.images import write_image
from simulator.rendering.drive import Motion
from tests.support.command_line import main
from tests.support.painted_drive import CAMERA, PaintedDrive, lane_lines, s_bend

ROWS, X_M = np.arange(230, 311, 5), np.geomspace(2, 100, 400)
SMALL = CAMERA.scaled((640, 360))
POSES = {"low": SMALL.pose, "high": replace(SMALL.pose, height_m=1.6, pitch_rad=SMALL.pose.pitch_rad + 0.05)}


@pytest.fixture(scope="module")
def labels(tmp_path_factory) -> Path:
    """Labelled stills of two cameras with different poses, and black ones of a third one."""
    folder = tmp_path_factory.mktemp("cameras")
    entries = []
    for name, pose in POSES.items():
        motion = Motion(60.0, 25.0, offset_m=0.3, wander_m=0.2)
        drive = PaintedDrive(s_bend(), lane_lines(), motion=motion, camera=SMALL.with_pose(pose))
        for k in range(4):
            entries.append({"raw_file": f"{name}/{k}.png", "h_samples": ROWS.tolist(), "lanes": []})
            write_image(folder / entries[-1]["raw_file"], drive.frame(k / 5))
            for side in (0, 1):
                u, v = drive.camera.road_to_pixels(np.column_stack([X_M, drive.truth(k / 5).line_y(side, X_M)])).T
                columns = np.interp(ROWS, v[::-1], u[::-1])
                entries[-1]["lanes"].append(np.where((columns >= 0) & (columns < 640), columns, -2).tolist())
    entries.append(entries[0] | {"raw_file": "black/0.png"})
    write_image(folder / "black" / "0.png", np.zeros((360, 640, 3), np.uint8))
    (folder / "labels.jsonl").write_text("".join(json.dumps(entry) + "\n" for entry in entries))
    return folder / "labels.jsonl"


def test_each_folder_has_its_own_pose(labels, capsys):
    hfov = np.degrees(2 * np.arctan(SMALL.width / 2 / SMALL.matrix[0, 0]))
    options = ["benchmark", "--labels", str(labels), "--hfov", f"{hfov:.3f}", "--system", "tracker"]
    assert main([*options, "--each-folder"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("low: 4 stills; z at 8/15/25 m: ")
    assert lines[1].startswith("high: 4 stills; z at 8/15/25 m: ")
    assert lines[2].startswith("black: left out, 1 stills (")
    (scores,) = (line.split() for line in lines if line.startswith("tracker "))
    assert scores[1:3] == ["16", "1.000"]
    (confident,) = (line.split() for line in lines if line.startswith("right lanes with 0.9"))
    assert confident[-1] == "8"


def test_folders_are_the_first_part_of_the_path(tmp_path):
    entries = [{"raw_file": name, "h_samples": [], "lanes": []} for name in ("a/x/1.jpg", "b/2.jpg", "a\\3.jpg")]
    (tmp_path / "labels.jsonl").write_text("".join(json.dumps(entry) + "\n" for entry in entries))
    folders = split_folders(read_labels(tmp_path / "labels.jsonl"))
    assert {name: [label.name for label in some] for name, some in folders.items()} == {
        "a": ["a/x/1.jpg", "a/3.jpg"],
        "b": ["b/2.jpg"],
    }
