"""Camera files of other programs, ours in other programs, and the committed ones."""

from __future__ import annotations

import json
import re
import subprocess
from dataclasses import replace

import cv2
import numpy as np
import pytest
import yaml

from lanes.camera import Camera, CameraPose, camera_from_dict, load_camera, save_camera, undistort
from lanes.errors import CameraError
from tests.support.command_line import main
from tests.support.project import ROOT

LENS = Camera(
    1280,
    800,
    np.array([[910.5, 0, 655.25], [0, 905.0, 388.5], [0, 0, 1]]),
    np.array([-0.31, 0.09, 0.001, -0.0005, 0.0]),
    CameraPose(1.4, 0.02),
)
# What ROS's camera_calibration_parsers requires, with the shape of each matrix.
ROS_MATRICES = {"camera_matrix": (3, 3), "rectification_matrix": (3, 3), "projection_matrix": (3, 4)}


def committed() -> list[str]:
    """The committed camera files, and the JSON files with a camera in them."""
    listed = subprocess.run(["git", "ls-files", "*.yaml", "*.yml", "*.json"], cwd=ROOT, capture_output=True, text=True)
    paths = [path for path in listed.stdout.split() if (ROOT / path).is_file()]
    return [path for path in paths if re.search(r"camera_matrix", (ROOT / path).read_text(encoding="utf-8"))]


COMMITTED = committed()


@pytest.mark.parametrize("name", COMMITTED)
def test_a_committed_camera_file_has_what_the_parser_of_ros_requires(name):
    text = (ROOT / name).read_text()
    content = json.loads(text)["camera"] if name.endswith(".json") else yaml.safe_load(text)
    camera = camera_from_dict(content)
    assert isinstance(content["camera_name"], str) and isinstance(content["distortion_model"], str)
    for entry, shape in ROS_MATRICES.items():
        found = content[entry]
        assert (found["rows"], found["cols"], len(found["data"])) == (*shape, shape[0] * shape[1])
    np.testing.assert_array_equal(np.reshape(content["projection_matrix"]["data"], (3, 4))[:, :3], camera.matrix)
    np.testing.assert_array_equal(content["rectification_matrix"]["data"], np.eye(3).ravel())


@pytest.mark.parametrize(
    ("head", "names"),  # of OpenCV 4 and 5
    [("%YAML:1.0", ("camera_matrix", "distortion_coefficients")), ("%YAML 1.2", ("K", "D"))],
)
def test_what_opencv_writes_is_read(tmp_path, names, head):
    """And the other way around."""
    ours = cv2.FileStorage(str(save_camera(LENS, tmp_path / "camera.yaml")), cv2.FILE_STORAGE_READ)
    np.testing.assert_array_equal(ours.getNode("camera_matrix").mat(), LENS.matrix)
    assert ours.getNode("pose").getNode("height_m").real() == 1.4
    path = tmp_path / "opencv.yml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("calibration_time", "Thu 26 Nov 2026 10:00:00")
    storage.write("image_width", 1280)
    storage.write("image_height", 800)
    storage.write(names[0], LENS.matrix)
    storage.write(names[1], LENS.distortion.reshape(5, 1))
    storage.release()
    path.write_text(re.sub(r"\A%YAML[ :][\d.]+", head, path.read_text()))
    assert path.read_text().startswith(head) and "!!opencv-matrix" in path.read_text()
    camera = load_camera(path)
    assert camera.size == LENS.size and camera.pose is None and camera.calibrated
    np.testing.assert_array_equal(camera.matrix, LENS.matrix)
    np.testing.assert_array_equal(camera.distortion, LENS.distortion)


CAMCHAIN = """\
cam0:
  cam_overlaps: []
  camera_model: {camera}
  distortion_coeffs: [0.02, -0.01, 0.003, -0.001]
  distortion_model: {lens}
  intrinsics: [910.5, 905.0, 655.25, 388.5]
  resolution: [1280, 800]
  rostopic: /cam0/image_raw
"""


@pytest.mark.parametrize(("lens", "fisheye"), [("radtan", False), ("equidistant", True)])
def test_a_camchain_of_kalibr_is_read(tmp_path, lens, fisheye):
    (tmp_path / "camchain.yaml").write_text(CAMCHAIN.format(camera="pinhole", lens=lens))
    camera = load_camera(tmp_path / "camchain.yaml")
    assert camera.size == (1280, 800) and camera.is_fisheye == fisheye
    np.testing.assert_array_equal(camera.matrix, LENS.matrix)
    np.testing.assert_array_equal(camera.distortion[:4], [0.02, -0.01, 0.003, -0.001])


@pytest.mark.parametrize(
    ("text", "named"),
    [
        (CAMCHAIN.format(camera="omni", lens="radtan"), "camera model 'omni'"),
        (CAMCHAIN.format(camera="pinhole", lens="fov"), "distortion model 'fov'"),
        (CAMCHAIN.format(camera="pinhole", lens="radtan") + "cam1: {}\n", "2 cameras, cam0, cam1"),
        ("<?xml version='1.0'?>\n<opencv_storage/>\n", "it is XML"),
        ("%YAML:1.0\n---\nM1: 3\n", "'camera_matrix' is missing"),
    ],
)
def test_what_cannot_be_read_is_named(tmp_path, capsys, text, named):
    path = tmp_path / "other.yaml"
    path.write_text(text)
    assert main(["annotate", "--camera", str(path), str(path)]) == 2
    assert named in capsys.readouterr().err


@pytest.mark.parametrize(
    ("model", "given", "expected"),
    [
        ("none", [], [0] * 5),
        ("", [], [0] * 5),
        (None, [0.1, 0.02, 0.003, 0.004], [0.1, 0.02, 0.003, 0.004, 0]),
        (None, [0.1, 0.02, 0, 0, 0.01, 0.3, 0.1, 0.02], [0.1, 0.02, 0, 0, 0.01, 0.3, 0.1, 0.02]),
        ("plumb_bob", [0.1, 0.02, 0.003, 0.004, 0.005, 0, 0, 0], [0.1, 0.02, 0.003, 0.004, 0.005]),
        ("radtan", [-0.3, 0.1, 0.001, 0.002], [-0.3, 0.1, 0.001, 0.002, 0]),
        ("fisheye", [0.02, -0.01, 0.003, -0.001], [0.02, -0.01, 0.003, -0.001]),
        ("plumb_bob", [0.3, 0.1, 0.001, 0.002, 0.01, 0.6, 0.2, 0.03], [0.3, 0.1, 0.001, 0.002, 0.01, 0.6, 0.2, 0.03]),
        ("rational_polynomial", [0.3, 0.1, 0, 0, 0, 0.6, 0.2, 0.03] + [0] * 6, [0.3, 0.1, 0, 0, 0, 0.6, 0.2, 0.03]),
    ],
)
def test_models_by_their_other_names_and_lengths(tmp_path, model, given, expected):
    lens = {"image_width": 1280, "image_height": 800, "camera_matrix": {"data": LENS.matrix.ravel().tolist()}}
    path = tmp_path / "camera.yaml"
    path.write_text(yaml.safe_dump(lens | {"distortion_model": model, "distortion_coefficients": {"data": given}}))
    np.testing.assert_array_equal(load_camera(path).distortion, expected)


def test_a_skew_is_that_of_the_projection_and_of_the_undistorted_image():
    """The pixel is K times the distorted direction, with all entries of K."""
    matrix = LENS.matrix + [[0, 4.5, 0], [0, 0, 0], [0, 0, 0]]
    camera = replace(LENS, matrix=matrix)
    road_m = np.array([[6.0, 2.0], [15.0, -1.5], [40.0, 3.0]])
    flat = replace(LENS, matrix=np.diag([1000.0, 1000, 1])).road_to_pixels(road_m) / 1000
    expected = np.column_stack([flat, np.ones(3)]) @ matrix.T
    np.testing.assert_allclose(camera.road_to_pixels(road_m), expected[:, :2], atol=1e-9)
    np.testing.assert_allclose(camera.pixels_to_road(expected[:, :2]), road_m, rtol=1e-6)
    image = np.zeros((800, 1280, 3), np.uint8)
    u, v = camera.distort_points(np.array([[150.0, 120.0]]))[0]
    assert np.hypot(u - 150, v - 120) > 30
    cv2.circle(image, (round(u), round(v)), 6, (255, 255, 255), -1)
    undistorted = undistort(image, camera)[..., 0]
    rows, columns = undistorted.nonzero()
    assert len(np.unique(undistorted)) > 2  # interpolated
    assert (columns.mean(), rows.mean()) == pytest.approx((150, 120), abs=0.9)
    with pytest.raises(CameraError, match="skew"):
        replace(camera, pose=None).turned(6)


def test_offset_and_source_of_the_lens_stay_in_the_file(tmp_path):
    path = tmp_path / "camera.yaml"
    camera = replace(Camera.from_fov((640, 360), 60), offset_m=-0.65, car_width_m=2.5)
    loaded = load_camera(save_camera(camera, path))
    assert (loaded.offset_m, loaded.car_width_m) == (-0.65, 2.5) and not loaded.calibrated
    plain = load_camera(save_camera(LENS, path))
    assert plain.offset_m == 0 and plain.calibrated and "offset" not in path.read_text()
    for entry, named in (("camera_offset_m: 65", "65 m beside"), ("car_width_m: 9", "9 m wide is not plausible")):
        path.write_text(f"{save_camera(LENS, path).read_text()}{entry}\n")
        with pytest.raises(CameraError, match=named):
            load_camera(path)
