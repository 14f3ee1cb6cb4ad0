"""Camera files: writing and reading them back, and the errors for invalid files."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

from lanes.camera import CalibrationReport, Camera, camera_from_dict, camera_to_dict, load_camera, save_camera
from lanes.errors import CameraError
from simulator.scenes.dashcam import DASHCAM


@pytest.fixture
def content() -> dict:
    report = CalibrationReport(0.5, {"a.jpg": 0.4, "b.jpg": 0.6}, {"c.jpg": "no chessboard"}, "2020-01-02")
    return camera_to_dict(replace(DASHCAM, report=report))


def write(path, content):
    path.write_text(content if isinstance(content, str) else yaml.safe_dump(content))
    return path


def test_camera_file_round_trip(tmp_path, content):
    camera = camera_from_dict(content)
    loaded = load_camera(save_camera(camera, tmp_path / "new" / "camera.yaml"))
    assert loaded.size == (1280, 720)
    np.testing.assert_array_equal(loaded.matrix, DASHCAM.matrix)
    np.testing.assert_array_equal(loaded.distortion, DASHCAM.distortion)
    assert loaded.pose == DASHCAM.pose
    assert loaded.report == camera.report


def test_camera_file_without_pose_and_report(tmp_path):
    loaded = load_camera(save_camera(Camera.from_fov((640, 480), 60), tmp_path / "camera.yaml"))
    assert loaded.pose is None and loaded.report is None


def test_block_of_the_pose_is_called_pose_and_the_older_name_mount_is_read(tmp_path, content):
    assert content["pose"]["height_m"] == DASHCAM.pose.height_m and "mount" not in content
    older = content | {"mount": content["pose"]}
    del older["pose"]
    assert load_camera(write(tmp_path / "older.yaml", older)).pose == DASHCAM.pose
    older["mount"]["same_lane_share"] = 0.4  # of a pose from one still
    assert load_camera(write(tmp_path / "still.yaml", older)).pose == DASHCAM.pose
    both = content | {"mount": {"height_m": 9.0}}
    assert load_camera(write(tmp_path / "both.yaml", both)).pose == DASHCAM.pose


def test_camera_file_has_the_layout_of_ros(content):
    assert content["camera_matrix"] == {"rows": 3, "cols": 3, "data": [1157.8, 0, 667.4, 0, 1153.2, 386.1, 0, 0, 1]}
    assert content["distortion_model"] == "plumb_bob"
    assert content["calibration"]["boards_used"] == 2


@pytest.mark.parametrize(
    "entry", ["image_width", "image_height", "camera_matrix", "distortion_model", "distortion_coefficients"]
)
def test_missing_entry_is_named(tmp_path, content, entry):
    del content[entry]
    with pytest.raises(CameraError, match=rf"camera\.yaml.*'{entry}' is missing"):
        load_camera(write(tmp_path / "camera.yaml", content))


@pytest.mark.parametrize(
    ("entry", "value"),
    [
        ("image_width", 0),
        ("image_width", float("nan")),
        ("image_height", float("inf")),
        ("image_height", "tall"),
        ("distortion_model", "fisheye"),
        ("camera_matrix", {"data": [float("nan")] * 9}),
        ("camera_matrix", {"data": [-1000.0, 0, 640, 0, 1000.0, 360, 0, 0, 1]}),
        ("camera_matrix", {"data": [1.0, 2.0]}),
        ("camera_matrix", {"data": [1e9, 0, 640, 0, 1e9, 360, 0, 0, 1]}),
        ("camera_matrix", {"data": [1000.0, 3, 640, 0, 1000, 360, 0, 0, 1]}),
        ("camera_matrix", {"data": [1000.0, 0, 640, 0, 1000, 360, 0, 0, 0]}),
        ("camera_matrix", {"data": [1000.0, 0, -9, 0, 1000, 360, 0, 0, 1]}),
        ("distortion_coefficients", {"data": [6e307, 0.02, 0.0005, -0.0003, 0.0]}),
        ("image_height", 10**9),
        ("distortion_coefficients", {"data": [0.1] * 4}),
        ("distortion_coefficients", None),
        ("pose", None),
        ("pose", {"height_m": float("nan")}),
        ("pose", {"height": 1.3}),
        ("pose", {"height_m": 1.3, "pitch_rad": 3.0}),
        ("pose", {"height_m": 1300}),
        ("pose", {"height_m": 1.3, "tilt_rad": 0.1}),
        ("calibration", {"rms_px": 0.3, "board_rms_px": {"a.jpg": "good"}, "date": 1}),
        ("calibration", 3),
    ],
)
def test_bad_entry_is_refused(tmp_path, content, entry, value):
    content[entry] = value
    with pytest.raises(CameraError, match=r"camera\.yaml: is not a usable camera file"):
        load_camera(write(tmp_path / "camera.yaml", content))


@pytest.mark.parametrize(
    "text",
    ["#", "just words", "- a\n- list", "a: [1, 2", "!!python/object/apply:os.getcwd []", "\0", "[" * 9999],
    ids=["empty", "words", "list", "broken", "python tag", "binary", "deep"],
)
def test_a_file_of_another_kind_is_refused(tmp_path, text):
    with pytest.raises(CameraError, match=r"camera\.yaml: is not a usable camera file"):
        load_camera(write(tmp_path / "camera.yaml", text))


def test_missing_and_unwritable_camera_files_are_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"camera\.yaml: there is no such camera file"):
        load_camera(tmp_path / "camera.yaml")
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match="cannot be written"):
        save_camera(DASHCAM, tmp_path / "file" / "camera.yaml")


def test_aliases_are_refused_before_they_are_expanded(tmp_path):
    """Nine lines that expand to 10^9 numbers."""
    lines = ["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, 9)]
    text = "\n".join(lines) + "\ncamera_matrix: {data: *a8}\n"
    with pytest.raises(CameraError, match=r"camera\.yaml: .* \(line 2 has an alias"):
        load_camera(write(tmp_path / "camera.yaml", text))


def test_names_that_are_not_valid_text_are_written(tmp_path):
    report = CalibrationReport(0.5, {"\udcff.jpg": 0.4})
    written = save_camera(replace(DASHCAM, report=report), tmp_path / "camera.yaml")
    assert load_camera(written).report.board_rms_px == report.board_rms_px
