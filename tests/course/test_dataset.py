"""Data folders, their truth, and the comparison with it."""

import json

import numpy as np
import pytest

from course.dataset import DatasetError, open_dataset
from lanes.images import write_image


@pytest.fixture
def folder(tmp_path):
    for part in ("camera_cal", "test_images"):
        (tmp_path / part).mkdir()
    for name in ("test10.jpg", "test2.jpg"):
        (tmp_path / "test_images" / name).write_bytes(b"")
    return tmp_path


def test_embedded_data_by_default_and_lanes_data_by_environment(folder, monkeypatch):
    monkeypatch.delenv("LANES_DATA", raising=False)
    assert open_dataset().output.name == "output_images"
    monkeypatch.setenv("LANES_DATA", str(folder))
    assert open_dataset().root == folder
    assert open_dataset().output.name == "output_real"
    with pytest.raises(DatasetError, match="test_images: has no camera_cal"):
        open_dataset(folder / "test_images")


def test_stills_come_in_natural_order_and_by_name(folder):
    data = open_dataset(folder)
    assert [path.name for path in data.stills] == ["test2.jpg", "test10.jpg"]
    assert data.still("test10").name == "test10.jpg"
    with pytest.raises(DatasetError, match="test7"):
        data.still("test7")


def test_videos_are_found_in_test_videos_or_in_the_data_folder(folder):
    data = open_dataset(folder)
    with pytest.raises(DatasetError, match="project_video.mp4"):
        data.video("project_video.mp4")
    (folder / "project_video.mp4").write_bytes(b"x")
    assert data.video("project_video.mp4").parent == folder
    (folder / "test_videos").mkdir()
    (folder / "test_videos" / "project_video.mp4").write_bytes(b"x")
    assert data.video("project_video.mp4").parent.name == "test_videos"


def write_truth(folder, truth):
    (folder / "test_images" / "truth.json").write_text(json.dumps(truth))


def test_without_truth_files_the_truth_is_none(folder):
    (folder / "clip.mp4").write_bytes(b"x")
    data = open_dataset(folder)
    assert data.true_camera() is None
    assert data.true_lane(data.still("test2")) is None
    assert data.true_drive(data.video("clip.mp4")) is None


def test_the_truth_of_a_still_is_found_by_its_name(folder):
    frame = {"raw_file": "test_images/test2.jpg", "offset_m": 0.25}
    write_truth(folder, {"camera": {}, "frames": [frame]})
    data = open_dataset(folder)
    assert data.true_lane(data.still("test2"))["offset_m"] == 0.25
    assert data.true_lane(data.still("test10")) is None


def test_the_truth_of_a_video_is_the_table_beside_it(folder):
    (folder / "clip.mp4").write_bytes(b"x")
    (folder / "clip.csv").write_text("frame,offset_m\n0,0.5\n1,-0.5\n")
    data = open_dataset(folder)
    drive = data.true_drive(data.video("clip.mp4"))
    assert drive["offset_m"].tolist() == [0.5, -0.5]


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"camera": 3, "frames": [{}]}', "[" * 99_999]
)
def test_a_damaged_truth_file_is_named(folder, text):
    (folder / "test_images" / "truth.json").write_text(text)
    data = open_dataset(folder)
    sentence = r"truth\.json: is not a truth file of images"
    with pytest.raises(DatasetError, match=sentence):
        data.true_camera()
    with pytest.raises(DatasetError, match=sentence):
        data.true_lane(data.still("test2"))


@pytest.fixture
def labelled(folder):
    """A folder with labels of test2, which is a real image."""
    image = np.zeros((720, 1280, 3), np.uint8)
    write_image(folder / "test_images" / "test2.jpg", image)
    label = {
        "raw_file": "test_images/test2.jpg",
        "h_samples": [500, 510],
        "lanes": [[100, 90], [600, 610]],
    }
    (folder / "labels.jsonl").write_text(json.dumps(label) + "\n")
    return folder


def test_without_truth_and_labels_the_columns_are_none(folder):
    data = open_dataset(folder)
    assert data.line_columns(data.still("test2")) is None


def test_without_truth_the_columns_are_those_of_the_labels(labelled):
    data = open_dataset(labelled)
    columns = data.line_columns(data.still("test2"))
    assert columns.rows.tolist() == [500, 510]
    assert columns.columns.tolist() == [[100, 90], [600, 610]]


def test_with_truth_the_columns_are_the_true_ones(labelled):
    frame = {
        "raw_file": "test_images/test2.jpg",
        "h_samples": [500],
        "lanes": [[101], [601]],
    }
    write_truth(labelled, {"frames": [frame]})
    data = open_dataset(labelled)
    columns = data.line_columns(data.still("test2"))
    assert columns.rows.tolist() == [500]
    assert columns.columns.tolist() == [[101], [601]]
