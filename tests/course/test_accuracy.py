"""The table of methods on stills: with truth, with labels, and with neither."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

from course.dataset import Dataset
from course.measures import TwoLines, accuracy_table, label_accuracy
from helpers import Lens, distort_points, road_homography, road_to_pixels
from tests.support.project import ROOT

MATRIX = np.array([[1100.0, 0, 640], [0, 1100, 360], [0, 0, 1]])
LENS = Lens(MATRIX, np.array([-0.2, 0, 0, 0, 0]), (1280, 720))
IMAGE_TO_ROAD = road_homography(LENS, height_m=1.4, pitch_rad=0.0)


def straight_lane(shift_m: float) -> TwoLines:
    """A straight lane, shifted to the left."""
    return TwoLines((0.0, shift_m + 1.83), (0.0, shift_m - 1.83))


def shift_of(result, truth) -> float:
    """An error function: the shift of a straight lane; infinite without one."""
    return np.inf if result is None else abs(result.left[1] - truth["left_m"])


def still_folder(path) -> Dataset:
    """One still, without truth and labels."""
    folder = path / "test_images"
    folder.mkdir()
    shutil.copy(ROOT / "test_images" / "test1.jpg", folder / "test1.jpg")
    return Dataset(path, path)


@pytest.fixture
def labelled(tmp_path) -> Dataset:
    """One still with labels of a straight lane around the camera."""
    data = still_folder(tmp_path)
    rows = list(range(400, 700, 10))
    x_m = 1 / np.linspace(1 / 60, 1 / 4, 500)  # far to near: down in the image
    lanes = []
    for y_m in (1.83, -1.83):
        line_m = np.column_stack([x_m, np.full(500, y_m)])
        u, v = distort_points(road_to_pixels(line_m, IMAGE_TO_ROAD), LENS).T
        lanes.append(np.interp(rows, v, u).round(1).tolist())
    label = {"raw_file": "test_images/test1.jpg", "h_samples": rows, "lanes": lanes}
    (tmp_path / "labels.jsonl").write_text(json.dumps(label) + "\n")
    return data


def test_with_labels_a_cell_is_the_share_of_points(labelled):
    found = {
        "right": [straight_lane(0)],
        "beside": [straight_lane(0.8)],
        "none": [None],
    }
    text = accuracy_table(found, labelled, shift_of, LENS, IMAGE_TO_ROAD)

    still, right, beside, none = text.splitlines()[1].split()
    assert (still, right, none) == ("test1", "100%", "0%")
    # 0.8 m are more than 20 px near the car and less far away
    assert 0 < int(beside.rstrip("%")) < 70


def test_a_line_that_is_not_seen_meets_no_label(labelled):
    (label,) = labelled.labels().values()
    far_aside = straight_lane(900.0)
    assert label_accuracy(far_aside, label, LENS, IMAGE_TO_ROAD) == 0


def test_with_truth_a_cell_is_what_the_error_function_says(tmp_path):
    data = still_folder(tmp_path)
    truth = {"raw_file": "test1.jpg", "left_m": 1.83}
    text = json.dumps({"frames": [truth]})
    (tmp_path / "test_images" / "truth.json").write_text(text)

    found = {"beside": [straight_lane(0.25)], "none": [None]}
    table = accuracy_table(found, data, shift_of, LENS, IMAGE_TO_ROAD)

    assert table.splitlines()[1].split() == ["test1", "0.25", "m", "lost"]


def test_without_truth_and_labels_methods_are_compared(tmp_path):
    data = still_folder(tmp_path)
    found = {"a": [straight_lane(0)], "b": [straight_lane(0.3)]}
    text = accuracy_table(found, data, shift_of, LENS, IMAGE_TO_ROAD)
    assert "0.30 m (median of 1 stills)" in text


def test_the_largest_difference_is_that_of_all_stills(tmp_path):
    data = still_folder(tmp_path)
    first = data.stills[0]
    for number in (2, 3):
        shutil.copy(first, first.with_name(f"test{number}.jpg"))
    others = [straight_lane(shift_m) for shift_m in (0.1, 0.7, 0.2)]
    found = {"a": [straight_lane(0)] * 3, "b": others}
    text = accuracy_table(found, data, shift_of, LENS, IMAGE_TO_ROAD)
    assert "0.20 m (median of 3 stills), at most 0.70 m" in text


def test_without_truth_and_two_lanes_nothing_is_compared(tmp_path):
    data = still_folder(tmp_path)
    found = {"a": [straight_lane(0)], "b": [None]}
    text = accuracy_table(found, data, shift_of, LENS, IMAGE_TO_ROAD)
    assert "no still" in text
