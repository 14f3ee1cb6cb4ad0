"""The camera: pose, projection, lens distortion, sizes, and camera files, also those of other programs."""

from __future__ import annotations

import json
import re
import subprocess
from dataclasses import replace

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import assume, example, given
from hypothesis import strategies as st
from PIL import Image

from lanes.camera.model import (
    CalibrationReport,
    Camera,
    CameraPose,
    camera_from_dict,
    camera_to_dict,
    load_camera,
    save_camera,
    undistort,
)
from lanes.errors import CameraError
from lanes.video.images import read_image
from simulator.scenes.freeway import DASHCAM
from tests.support.examples import examples
from tests.support.project import ROOT

FOCAL_PX = 640 / np.tan(np.radians(30))
poses = st.builds(CameraPose, st.floats(0.8, 3), st.floats(-0.1, 0.3), st.floats(-0.3, 0.3), st.floats(-0.2, 0.2))
SLOPE, COS, SIN = np.tan(0.05), np.cos(0.05), np.sin(0.05)
# Poses, a point of the road frame, and how far right of the centre and below it the point is seen, in focal lengths.
SEEN = {
    "ahead at the camera's height": (CameraPose(1.5), (20, 0, 1.5), (0, 0)),
    "on the road, on the left": (CameraPose(1.5), (20, 2, 0), (-0.1, 0.075)),
    "positive pitch looks down, so the horizon rises": (CameraPose(1.5, pitch_rad=0.05), (20, 0, 1.5), (0, -SLOPE)),
    "positive yaw looks left": (CameraPose(1.5, yaw_rad=0.05), (20, 0, 1.5), (SLOPE, 0)),
    "positive roll: right side down": (CameraPose(1.5, roll_rad=0.05), (20, 5, 1.5), (-0.25 * COS, 0.25 * SIN)),
}


@pytest.mark.parametrize("name", SEEN)
def test_signs_of_the_pose(name):
    pose, point_m, slopes = SEEN[name]
    pixel = Camera.from_fov((1280, 720), 60, pose).road_to_pixels(np.array([point_m]))[0]
    np.testing.assert_allclose(pixel, (639.5, 359.5) + FOCAL_PX * np.array(slopes), atol=1e-9)


@given(poses, st.floats(4, 60), st.floats(-6, 6))
def test_road_to_pixels_and_back(pose, x_m, y_m):
    camera = DASHCAM.with_pose(pose)
    pixel = camera.road_to_pixels(np.array([[x_m, y_m]]))
    assume(((pixel >= 0) & (pixel <= [1279, 719])).all())
    np.testing.assert_allclose(camera.pixels_to_road(pixel)[0], (x_m, y_m), rtol=1e-4, atol=1e-4)


def test_sky_and_points_behind_the_camera_give_nan():
    assert np.isnan(DASHCAM.pixels_to_road(np.array([[640.0, 20.0]]))).all()
    pixels = DASHCAM.road_to_pixels(np.array([[-5.0, 0.0], [20.0, 0.0], [0.0, 0.0]]))
    assert np.isnan(pixels[[0, 2]]).all() and np.isfinite(pixels[1]).all()


@st.composite
def lenses(draw: st.DrawFn) -> Camera:
    """Lens whose distortion is monotonic up to the corners of the image."""
    width = draw(st.integers(100, 4000))
    height = round(width * draw(st.floats(0.4, 1.0)))
    focal_px = width / 2 / np.tan(np.radians(draw(st.floats(30, 100))) / 2)
    k1, k2, k3 = draw(st.floats(-0.35, 0.2)), draw(st.floats(-0.1, 0.15)), draw(st.floats(-0.02, 0.02))
    p1, p2 = draw(st.floats(-0.002, 0.002)), draw(st.floats(-0.002, 0.002))
    middle = [size / 2 + draw(st.floats(-0.02, 0.02)) * width for size in (width, height)]
    matrix = np.array([[focal_px, 0, middle[0]], [0, focal_px * draw(st.floats(0.98, 1.02)), middle[1]], [0, 0, 1]])
    camera = Camera(width, height, matrix, np.array([k1, k2, p1, p2, k3]))
    # the undistorted corners must be inside the monotonic range of the distortion
    r = np.linspace(0, 0.9 * min(camera.largest_ray, 5.0), 500)
    assume((r * (1 + k1 * r**2 + k2 * r**4 + k3 * r**6)).max() > 1.1 * np.hypot(width, height) / 2 / focal_px)
    return camera


# At its corners 50 steps of the iteration leave 6 px.
STRONG = Camera(1280, 720, [[607.2, 0, 639.5], [0, 607.2, 359.5], [0, 0, 1]], [-0.247, 0.026, 0.001, -0.001, 0.017])


@examples(60)
@given(lenses(), st.integers(0, 2**32 - 1))
@example(STRONG, 0)
def test_undistorting_and_distorting_points_is_the_identity(camera, seed):
    pixels = np.random.default_rng(seed).uniform(0, 1, (40, 2)) * camera.size
    pixels = np.vstack([pixels, [[0, 0], [camera.width - 1, 0], [0, camera.height - 1]]])
    np.testing.assert_allclose(camera.distort_points(camera.undistort_points(pixels)), pixels, atol=1e-6)


@pytest.mark.parametrize("least", [0.0, 5e-324, -1e-310])
def test_rays_beyond_the_monotonic_range_give_nan(least):
    """The polynomial has its maximum where 1 + 3 k1 r^2 = 0; tiny further coefficients must not divide by zero."""
    folding = Camera(1280, 720, DASHCAM.matrix, np.array([-0.3, least, 0, 0, least]), CameraPose(1.3))
    assert folding.largest_ray == pytest.approx(np.sqrt(1 / 0.9))
    assert np.isnan(folding.road_to_pixels(np.array([[2.0, 8.0]]))).all()
    assert replace(folding, distortion=np.array([0.3, least, 0, 0, least])).largest_ray > 1e6
    rational, fisheye = np.array([0, 0, 0, 0, 0, 0.5, least, least]), np.array([-0.3, least, 0, 0])
    assert replace(folding, distortion=rational).largest_ray == pytest.approx(np.sqrt(2))
    assert replace(folding, distortion=fisheye).largest_ray == pytest.approx(np.tan(np.sqrt(1 / 0.9)))


@pytest.mark.parametrize("size", [(640, 360), (2560, 1440)])
def test_scaled_camera_has_the_same_ray_at_the_same_share_of_the_image(size):
    """An image begins at -0.5: pixel centres are at integers."""
    pixels = np.array([[-0.5, -0.5], [100.0, 50.0], [1279.5, 719.5]])
    shares = (pixels + 0.5) / DASHCAM.size
    scaled = DASHCAM.scaled(size)
    np.testing.assert_allclose(scaled.rays(shares * size - 0.5), DASHCAM.rays(pixels), atol=1e-9)
    assert scaled.size == size and scaled.pose == DASHCAM.pose
    with pytest.raises(CameraError, match="640x480 image has another aspect ratio than the calibrated 1280x720"):
        DASHCAM.scaled((640, 480))


@pytest.mark.parametrize(("hfov_deg", "lens"), [(94.0, None), (96.0, None), (120.0, "pinhole"), (30, "equidistant")])
def test_the_field_of_view_is_the_one_asked_for(hfov_deg, lens):
    """Above 95 degrees without a word the lens is equidistant."""
    camera = Camera.from_fov((1920, 1080), hfov_deg, lens=lens)
    assert camera.is_fisheye == (lens == "equidistant" if lens else hfov_deg > 95) and not camera.calibrated
    assert camera.hfov_deg == pytest.approx(hfov_deg) and camera.largest_ray == np.inf
    left, right = np.degrees(np.arctan(camera.rays(np.array([[-0.5, 539.5], [1919.5, 539.5]]))[:, 0]))
    assert right - left == pytest.approx(hfov_deg)


@pytest.mark.parametrize("hfov_deg", [9.0, 151.0])
def test_a_field_of_view_that_no_dashcam_has_is_refused(hfov_deg):
    with pytest.raises(CameraError, match=f"{hfov_deg:g} degrees is not plausible for a dashcam; give 10 to 150"):
        Camera.from_fov((1920, 1080), hfov_deg)


@pytest.mark.parametrize(
    "distortion",
    [
        [0.1, 0.02, 0.003, 0.004, 0.005],
        [-0.35, 0.15, 0.002, -0.002, -0.02],  # a strong barrel
        [0.1, 0.02, 0.0, 0.0, 0.01, 0.3, 0.1, 0.02],
        [0.02, -0.01, 0.003, -0.001],
    ],
)
def test_each_lens_model_is_that_of_opencv_and_stays_in_the_file(tmp_path, distortion):
    matrix = np.array([[3400 / 3, 0, 1280 / 1.99], [0, 3420 / 3.01, 370 / 1.01], [0, 0, 1]])
    camera = replace(DASHCAM, matrix=matrix, distortion=distortion)
    rays = np.random.default_rng(0).uniform((-0.6, -0.4, 1), (0.6, 0.4, 1), (50, 3))
    project = cv2.fisheye.projectPoints if len(distortion) == 4 else cv2.projectPoints
    expected, _ = project(rays[None], np.zeros(3), np.zeros(3), camera.matrix, camera.distortion)
    pixels = camera.distort_points(rays[:, :2] @ camera.matrix[:2, :2].T + camera.matrix[:2, 2])
    np.testing.assert_allclose(pixels, expected.reshape(-1, 2), atol=1e-6)
    np.testing.assert_allclose(camera.rays(pixels), rays, atol=1e-6)
    assert load_camera(save_camera(camera, tmp_path / "new" / "camera.yaml")) == camera  # to the last bit


@pytest.mark.parametrize(
    ("entry", "value"),
    [
        *((entry, None) for entry in ("image_width", "distortion_coefficients", "pose")),
        ("distortion_model", "spherical"),
        ("camera_matrix", {"data": [-1000.0, 0, 640, 0, 1000.0, 360, 0, 0, 1]}),
        ("camera_matrix", {"data": [1.0, 2.0]}),
        ("camera_matrix", {"data": [1000.0, 30, 640, 0, 1000, 360, 0, 0, 1]}),
        ("distortion_coefficients", {"data": [6e307, 0.02, 0.0005, -0.0003, 0.0]}),
        ("distortion_coefficients", {"data": [0.1] * 3}),
        ("pose", {"height_m": 1.3, "pitch_rad": 3.0}),
        ("pose", {"height_m": 25.0}),
        ("pose", {"height_m": 1.3, "tilt_rad": 0.1}),
        ("calibration", {"rms_px": 0.3, "board_rms_px": {"a.jpg": "good"}, "date": 1}),
    ],
)
def test_bad_entry_is_refused(tmp_path, entry, value):
    report = CalibrationReport(0.5, {"a.jpg": 0.4, "b.jpg": 0.6}, {"c.jpg": "no chessboard"}, "2020-01-02")
    path, content = tmp_path / "camera.yaml", camera_to_dict(replace(DASHCAM, report=report))
    path.write_text(yaml.safe_dump(content))
    assert load_camera(path).report == report
    path.write_text(yaml.safe_dump(content | {entry: value}))
    with pytest.raises(CameraError, match=r"camera\.yaml: is not a usable camera file"):
        load_camera(path)


UPRIGHT_OF = {1: np.array, 3: lambda a: np.rot90(a, 2), 6: lambda a: np.rot90(a, -1)}
UPRIGHT_OF[7] = lambda a: np.rot90(a.transpose(1, 0, 2), 2)


@pytest.mark.parametrize("orientation", UPRIGHT_OF)
def test_a_camera_is_turned_as_the_images_are(tmp_path, orientation):
    """The ray of a pixel of the upright image is that of the sensor's pixel, seen along the turned axes."""
    camera = replace(DASHCAM, width=128, height=72, matrix=np.array([[90.0, 0, 50], [0, 80, 30], [0, 0, 1]]), pose=None)
    turned = camera.turned(orientation)
    # each pixel has its row and column on the sensor as its colour
    stored = np.dstack([*np.mgrid[:72, :128], np.zeros((72, 128))]).astype(np.uint8)
    exif = Image.Exif()
    exif[0x0112] = orientation
    Image.fromarray(stored).save(tmp_path / "a.png", exif=exif)
    image = read_image(tmp_path / "a.png")
    np.testing.assert_array_equal(image, UPRIGHT_OF[orientation](stored))
    np.testing.assert_array_equal(read_image(tmp_path / "a.png", upright=False), stored)
    assert turned.size == image.shape[1::-1]
    on_sensor = image[..., 1::-1].astype(float)
    # the axes of the upright image, along its borders, in those of the sensor
    axes = np.sign([on_sensor[0, -1] - on_sensor[0, 0], on_sensor[-1, 0] - on_sensor[0, 0]])
    pixels = np.indices(image.shape[:2])[::-1].reshape(2, -1).T
    expected = camera.rays(on_sensor.reshape(-1, 2))[:, :2] @ axes.T
    np.testing.assert_allclose(turned.rays(pixels)[:, :2], expected, atol=1e-9)
    with pytest.raises(CameraError, match="with a pose cannot be turned"):
        DASHCAM.turned(orientation)


@pytest.mark.parametrize("fov_deg", [100, 175])
def test_a_fisheye_lens_sees_points_up_to_its_border(fov_deg):
    focal_px = 640 / np.radians(fov_deg / 2)
    matrix = np.array([[focal_px, 0, 639.5], [0, focal_px, 359.5], [0, 0, 1]])
    camera = Camera(1280, 720, matrix, np.zeros(4), CameraPose(1.3, pitch_rad=0.05))
    assert camera.hfov_deg == pytest.approx(fov_deg, abs=0.1)
    road_m = np.array([[1.0, 2.0], [4.0, -3.0], [30.0, 1.8]])
    np.testing.assert_allclose(camera.pixels_to_road(camera.road_to_pixels(road_m)), road_m, rtol=1e-6)
    image = np.zeros((720, 1280, 3), np.uint8)
    line = camera.distort_points(np.column_stack([np.linspace(400, 900, 60), np.linspace(300, 500, 60)]))
    cv2.polylines(image, [line.round().astype(np.int32)], False, (255, 255, 255), 3)
    v, u = undistort(image, camera)[..., 0].nonzero()
    assert np.abs(v - np.polyval(np.polyfit(u, v, 1), u)).max() < 5  # half its width, rounded


# Camera files of other programs, ours in other programs, and the committed ones.

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
    entries = {"calibration_time": "Thu 26 Nov 2026 10:00:00", "image_width": 1280, "image_height": 800}
    for name, value in (entries | {names[0]: LENS.matrix, names[1]: LENS.distortion.reshape(5, 1)}).items():
        storage.write(name, value)
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
def test_what_cannot_be_read_is_named(tmp_path, run, text, named):
    path = tmp_path / "other.yaml"
    path.write_text(text)
    status, _, err = run("annotate", "--camera", path, path)
    assert status == 2 and named in err


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
