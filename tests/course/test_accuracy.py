"""The table of methods on stills with labels, and without; the notebook shows that with truth."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

from course.dataset import Dataset
from course.measures import TwoLines, accuracy_table, label_accuracy
from lanes.camera.model import Camera, CameraPose
from tests.support.classic_lane import lane_result
from tests.support.project import ROOT

CAMERA = Camera.from_fov((1280, 720), 60, CameraPose(1.4, pitch_rad=0.0))


def straight_lane(shift_m: float) -> TwoLines:
    """A straight lane, shifted to the left."""
    return TwoLines((0.0, shift_m + 1.83), (0.0, shift_m - 1.83))


@pytest.fixture
def labelled(tmp_path) -> Dataset:
    """One still with labels of a straight lane around the camera."""
    (tmp_path / "test_images").mkdir()
    shutil.copy(ROOT / "test_images" / "test1.jpg", tmp_path / "test_images" / "test1.jpg")
    rows, lanes = list(range(400, 700, 10)), []
    for y in (1.83, -1.83):
        u, v = CAMERA.road_to_pixels([[x, y] for x in 1 / np.linspace(1 / 4, 1 / 60, 500)]).T
        lanes.append(np.interp(rows, v[::-1], u[::-1]).round(1).tolist())
    entry = {"raw_file": "test_images/test1.jpg", "h_samples": rows, "lanes": lanes}
    (tmp_path / "labels.jsonl").write_text(json.dumps(entry) + "\n")
    return Dataset(tmp_path, tmp_path)


def test_with_labels_a_cell_is_the_share_of_points(labelled):
    text = accuracy_table(
        {"right": [straight_lane(0)], "beside": [straight_lane(0.8)], "none": [None]}, labelled, CAMERA
    )
    cells = text.splitlines()[1].split()
    assert cells[:2] == ["test1", "100%"]
    assert cells[3] == "0%"
    # 0.8 m are more than 20 px near the car and less far away
    assert 0 < int(cells[2].rstrip("%")) < 70
    (label,) = labelled.labels().values()
    assert label_accuracy(lane_result(None, None, "lost"), label, CAMERA) == 0


def test_without_truth_and_labels_methods_are_compared(labelled):
    (labelled.root / "labels.jsonl").unlink()
    text = accuracy_table({"a": [straight_lane(0)], "b": [straight_lane(0.3)]}, labelled, CAMERA)
    assert "0.30 m (median of 1 stills)" in text
    assert "no still" in accuracy_table({"a": [straight_lane(0)], "b": [None]}, labelled, CAMERA)
