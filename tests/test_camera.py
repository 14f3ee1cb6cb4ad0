"""The camera: pose, projection, lens distortion, sizes, and camera files, also those of
other programs.
"""

from __future__ import annotations

import json
import pickle
import subprocess
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import assume, example, given
from hypothesis import strategies as st
from PIL import Image

from lanes.camera.field_of_view import ASSUMED_LENS_STD_M
from lanes.camera.model import (
    CalibrationReport,
    Camera,
    CameraPose,
    PoseStd,
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
from tests.support.shapes import intrinsics

FOCAL_PX = 640 / np.tan(np.radians(30))
POSES = st.builds(
    CameraPose,
    height_m=st.floats(0.8, 3),
    pitch_rad=st.floats(-0.1, 0.3),
    yaw_rad=st.floats(-0.3, 0.3),
    roll_rad=st.floats(-0.2, 0.2),
)

# Pose and projection.

SLOPE = np.tan(0.05)
COS = np.cos(0.05)
SIN = np.sin(0.05)


@pytest.mark.parametrize(
    ("pose", "point_m", "slopes"),
    [
        pytest.param({}, (20, 0, 1.5), (0, 0), id="ahead at the camera's height"),
        pytest.param({}, (20, 2, 0), (-0.1, 0.075), id="on the road, on the left"),
        pytest.param(
            {"pitch_rad": 0.05},
            (20, 0, 1.5),
            (0, -SLOPE),
            id="positive pitch looks down, so the horizon rises",
        ),
        pytest.param(
            {"yaw_rad": 0.05}, (20, 0, 1.5), (SLOPE, 0), id="positive yaw looks left"
        ),
        pytest.param(
            {"roll_rad": 0.05},
            (20, 5, 1.5),
            (-0.25 * COS, 0.25 * SIN),
            id="positive roll: right side down",
        ),
    ],
)
def test_signs_of_the_pose(pose, point_m, slopes):
    """Slopes are how far right of the centre and below it a point is seen, in focal
    lengths.
    """
    camera = Camera.from_fov((1280, 720), 60, CameraPose(1.5, **pose))

    pixels = camera.road_to_pixels(np.array([point_m]))

    expected = (639.5, 359.5) + FOCAL_PX * np.array(slopes)
    np.testing.assert_allclose(pixels[0], expected, atol=1e-9)


@given(POSES, st.floats(4, 60), st.floats(-6, 6))
def test_road_to_pixels_and_back(pose, x_m, y_m):
    camera = DASHCAM.with_pose(pose)
    road_m = np.array([[x_m, y_m]])
    pixel = camera.road_to_pixels(road_m)
    assume((pixel >= 0).all())
    assume((pixel <= [1279, 719]).all())

    found_m = camera.pixels_to_road(pixel)

    np.testing.assert_allclose(found_m, road_m, rtol=1e-4, atol=1e-4)


def test_a_pixel_of_the_sky_gives_nan():
    road_m = DASHCAM.pixels_to_road(np.array([[640.0, 20.0]]))
    assert np.isnan(road_m).all()


@pytest.mark.parametrize(
    ("x_m", "is_seen"), [(-5.0, False), (0.0, False), (20.0, True)]
)
def test_points_behind_the_camera_give_nan(x_m, is_seen):
    pixel = DASHCAM.road_to_pixels(np.array([[x_m, 0.0]]))
    assert (np.isfinite(pixel) == is_seen).all()


# Lenses.


@st.composite
def lenses(draw: st.DrawFn) -> Camera:
    """Lens whose distortion is monotonic up to the corners of the image."""
    width = draw(st.integers(100, 4000))
    height = round(width * draw(st.floats(0.4, 1.0)))
    half_rad = np.radians(draw(st.floats(30, 100))) / 2
    focal_px = width / 2 / np.tan(half_rad)
    aspect = draw(st.floats(0.98, 1.02))
    shift = st.floats(-0.02, 0.02)
    k1 = draw(st.floats(-0.35, 0.2))
    k2 = draw(st.floats(-0.1, 0.15))
    k3 = draw(st.floats(-0.02, 0.02))
    p1 = draw(st.floats(-0.002, 0.002))
    p2 = draw(st.floats(-0.002, 0.002))
    u_px = width / 2 + draw(shift) * width
    v_px = height / 2 + draw(shift) * width
    matrix = intrinsics(focal_px, aspect * focal_px, u_px, v_px)
    camera = Camera(width, height, matrix, np.array([k1, k2, p1, p2, k3]))

    # the undistorted corners must be inside the monotonic range of the distortion
    r = np.linspace(0, 0.9 * min(camera.largest_ray, 5.0), 500)
    r2 = r**2
    distorted = r * (1 + r2 * (k1 + r2 * (k2 + r2 * k3)))
    corner = np.hypot(width, height) / 2 / focal_px
    assume(distorted.max() > 1.1 * corner)
    return camera


# At its corners 50 steps of the iteration leave 6 px.
STRONG = Camera(
    1280,
    720,
    intrinsics(607.2, 607.2, 639.5, 359.5),
    np.array([-0.247, 0.026, 0.001, -0.001, 0.017]),
)


@examples(60)
@given(lenses(), st.integers(0, 2**32 - 1))
@example(STRONG, 0)
def test_undistorting_and_distorting_points_is_the_identity(camera, seed):
    shares = np.random.default_rng(seed).uniform(0, 1, (40, 2))
    inside = shares * camera.size
    top_right = [camera.width - 1, 0]
    bottom_left = [0, camera.height - 1]
    pixels = np.vstack([inside, [0, 0], top_right, bottom_left])

    undistorted = camera.undistort_points(pixels)
    distorted = camera.distort_points(undistorted)

    np.testing.assert_allclose(distorted, pixels, atol=1e-6)


# tiny further coefficients must not divide by zero
@pytest.mark.parametrize("tiny", [0.0, 5e-324, -1e-310])
class TestTheMonotonicRange:
    # the polynomial has its maximum where 1 + 3 k1 r^2 = 0

    def test_ends_at_the_maximum_of_a_barrel(self, tiny):
        barrel = replace(DASHCAM, distortion=[-0.3, tiny, 0, 0, tiny])
        assert barrel.largest_ray == pytest.approx(np.sqrt(1 / 0.9))

    def test_has_no_end_for_a_pincushion(self, tiny):
        pincushion = replace(DASHCAM, distortion=[0.3, tiny, 0, 0, tiny])
        assert pincushion.largest_ray > 1e6

    def test_ends_where_a_denominator_grows_faster(self, tiny):
        rational = replace(DASHCAM, distortion=[0, 0, 0, 0, 0, 0.5, tiny, tiny])
        assert rational.largest_ray == pytest.approx(np.sqrt(2))

    def test_ends_where_a_denominator_is_zero(self, tiny):
        pole = replace(DASHCAM, distortion=[0, 0, 0, 0, 0, -0.5, tiny, tiny])
        assert pole.largest_ray == pytest.approx(np.sqrt(2))

    def test_is_one_of_angles_for_a_fisheye_lens(self, tiny):
        fisheye = replace(DASHCAM, distortion=[-0.3, tiny, 0, 0])
        assert fisheye.largest_ray == pytest.approx(np.tan(np.sqrt(1 / 0.9)))

    def test_gives_nan_beyond(self, tiny):
        barrel = replace(
            DASHCAM, distortion=[-0.3, tiny, 0, 0, tiny], pose=CameraPose(1.3)
        )
        pixels = barrel.road_to_pixels(np.array([[2.0, 8.0]]))
        assert np.isnan(pixels).all()


LENSES = [
    [0.1, 0.02, 0.003, 0.004, 0.005],
    [-0.35, 0.15, 0.002, -0.002, -0.02],  # a strong barrel
    [0.1, 0.02, 0.0, 0.0, 0.01, 0.3, 0.1, 0.02],
    [0.02, -0.01, 0.003, -0.001],
]
UNEVEN = intrinsics(3400 / 3, 3420 / 3.01, 1280 / 1.99, 370 / 1.01)


@pytest.mark.parametrize("distortion", LENSES)
class TestEachLensModel:
    def test_is_that_of_opencv(self, distortion):
        camera = replace(DASHCAM, matrix=UNEVEN, distortion=distortion)
        rays = np.random.default_rng(0).uniform((-0.6, -0.4, 1), (0.6, 0.4, 1), (50, 3))
        opencv = cv2.fisheye if len(distortion) == 4 else cv2
        zero = np.zeros(3)
        expected, _ = opencv.projectPoints(
            rays[None], zero, zero, UNEVEN, camera.distortion
        )

        undistorted = rays @ UNEVEN.T
        pixels = camera.distort_points(undistorted[:, :2])

        np.testing.assert_allclose(pixels, expected.reshape(-1, 2), atol=1e-6)
        np.testing.assert_allclose(camera.rays(pixels), rays, atol=1e-6)

    def test_stays_in_the_file_to_the_last_bit(self, tmp_path, distortion):
        camera = replace(DASHCAM, matrix=UNEVEN, distortion=distortion)
        path = save_camera(camera, tmp_path / "new" / "camera.yaml")
        assert load_camera(path) == camera


class TestAFisheyeLens:
    @pytest.fixture(params=[100, 175])
    def camera(self, request) -> Camera:
        focal_px = 640 / np.radians(request.param / 2)
        matrix = intrinsics(focal_px, focal_px, 639.5, 359.5)
        camera = Camera(1280, 720, matrix, np.zeros(4), CameraPose(1.3, 0.05))
        assert camera.hfov_deg == pytest.approx(request.param, abs=0.1)
        return camera

    def test_sees_points_up_to_its_border(self, camera):
        road_m = np.array([[1.0, 2.0], [4.0, -3.0], [30.0, 1.8]])
        pixels = camera.road_to_pixels(road_m)
        np.testing.assert_allclose(camera.pixels_to_road(pixels), road_m, rtol=1e-6)

    def test_shows_a_straight_line_after_undistortion(self, camera):
        image = np.zeros((720, 1280, 3), np.uint8)
        straight = np.linspace((400, 300), (900, 500), 60)
        line = camera.distort_points(straight).round().astype(np.int32)
        cv2.polylines(image, [line], False, (255, 255, 255), 3)

        undistorted = undistort(image, camera)

        v, u = undistorted[..., 0].nonzero()
        fitted = np.polynomial.Polynomial.fit(u, v, deg=1)
        assert np.abs(v - fitted(u)).max() < 5  # half its width, rounded


LENS = Camera(
    1280,
    800,
    intrinsics(910.5, 905.0, 655.25, 388.5),
    np.array([-0.31, 0.09, 0.001, -0.0005, 0.0]),
    CameraPose(1.4, 0.02),
)


class TestASkew:
    """The pixel is K times the distorted direction, with all entries of K."""

    matrix = LENS.matrix.copy()
    matrix[0, 1] = 4.5
    camera = replace(LENS, matrix=matrix)

    def test_is_that_of_the_projection(self):
        road_m = np.array([[6.0, 2.0], [15.0, -1.5], [40.0, 3.0]])
        unscaled = replace(LENS, matrix=np.diag([1000.0, 1000, 1]))
        distorted = unscaled.road_to_pixels(road_m) / 1000
        expected = np.column_stack([distorted, np.ones(3)]) @ self.camera.matrix.T

        pixels = self.camera.road_to_pixels(road_m)

        np.testing.assert_allclose(pixels, expected[:, :2], atol=1e-9)
        np.testing.assert_allclose(
            self.camera.pixels_to_road(pixels), road_m, rtol=1e-6
        )

    def test_is_that_of_the_undistorted_image(self):
        image = np.zeros((800, 1280, 3), np.uint8)
        centre = self.camera.distort_points(np.array([[150.0, 120.0]]))[0]
        assert np.linalg.norm(centre - (150, 120)) > 30
        u, v = centre.round().astype(int).tolist()
        cv2.circle(image, (u, v), 6, (255, 255, 255), -1)

        undistorted = undistort(image, self.camera)[..., 0]

        assert len(np.unique(undistorted)) > 2  # interpolated
        rows, columns = undistorted.nonzero()
        middle = (columns.mean(), rows.mean())
        assert middle == pytest.approx((150, 120), abs=0.9)

    def test_is_not_turned(self):
        with pytest.raises(CameraError, match="skew"):
            replace(self.camera, pose=None).turned(6)


# Field of view, other sizes and turned images.


@pytest.mark.parametrize(
    ("hfov_deg", "lens", "is_fisheye"),
    [
        # above 95 degrees without a word the lens is equidistant
        (94.0, None, False),
        (96.0, None, True),
        (120.0, "pinhole", False),
        (30, "equidistant", True),
    ],
)
def test_the_field_of_view_is_the_one_asked_for(hfov_deg, lens, is_fisheye):
    camera = Camera.from_fov((1920, 1080), hfov_deg, lens=lens)

    assert camera.is_fisheye == is_fisheye
    assert not camera.calibrated
    assert camera.largest_ray == np.inf
    assert camera.hfov_deg == pytest.approx(hfov_deg)
    borders = np.array([[-0.5, 539.5], [1919.5, 539.5]])
    rays = camera.rays(borders)
    left_deg, right_deg = np.degrees(np.arctan(rays[:, 0]))
    assert right_deg - left_deg == pytest.approx(hfov_deg)


@pytest.mark.parametrize("hfov_deg", [9.0, 151.0])
def test_a_field_of_view_that_no_dashcam_has_is_refused(hfov_deg):
    words = f"{hfov_deg:g} degrees is not plausible for a dashcam; give 10 to 150"
    with pytest.raises(CameraError, match=words):
        Camera.from_fov((1920, 1080), hfov_deg)


@pytest.mark.parametrize("size", [(640, 360), (2560, 1440)])
def test_scaled_camera_has_the_same_ray_at_the_same_share_of_the_image(size):
    """An image begins at -0.5: pixel centres are at integers."""
    pixels = np.array([[-0.5, -0.5], [100.0, 50.0], [1279.5, 719.5]])
    shares = (pixels + 0.5) / DASHCAM.size

    scaled = DASHCAM.scaled(size)

    rays = scaled.rays(shares * size - 0.5)
    np.testing.assert_allclose(rays, DASHCAM.rays(pixels), atol=1e-9)
    assert scaled.size == size
    assert scaled.pose == DASHCAM.pose


def test_a_camera_is_not_scaled_to_another_aspect_ratio():
    words = "640x480 image has another aspect ratio than the calibrated 1280x720"
    with pytest.raises(CameraError, match=words):
        DASHCAM.scaled((640, 480))


UPRIGHT_OF = {
    1: np.array,
    3: lambda stored: np.rot90(stored, 2),
    6: lambda stored: np.rot90(stored, -1),
    7: lambda stored: np.rot90(stored.transpose(1, 0, 2), 2),
}


@pytest.mark.parametrize("orientation", UPRIGHT_OF)
class TestAnOrientation:
    """Each pixel has its row and column on the sensor as its colour."""

    stored = np.zeros((72, 128, 3), np.uint8)
    stored[..., 0] = np.arange(72)[:, None]
    stored[..., 1] = np.arange(128)

    @pytest.fixture
    def path(self, tmp_path, orientation) -> Path:
        exif = Image.Exif()
        exif[0x0112] = orientation
        Image.fromarray(self.stored).save(tmp_path / "a.png", exif=exif)
        return tmp_path / "a.png"

    def test_is_that_of_the_image_read(self, path, orientation):
        upright = UPRIGHT_OF[orientation](self.stored)
        np.testing.assert_array_equal(read_image(path), upright)

    def test_is_ignored_if_that_is_asked_for(self, path, orientation):
        stored = read_image(path, upright=False)
        np.testing.assert_array_equal(stored, self.stored)

    def test_turns_the_camera_as_the_image(self, path, orientation):
        """The ray of a pixel of the upright image is that of the sensor's pixel, seen
        along the turned axes.
        """
        matrix = intrinsics(90, 80, 50, 30)
        camera = replace(DASHCAM, width=128, height=72, matrix=matrix, pose=None)
        image = read_image(path)
        on_sensor = image[..., 1::-1].astype(float)
        # the axes of the upright image, along its borders, in those of the sensor
        first = on_sensor[0, 0]
        right = on_sensor[0, -1] - first
        down = on_sensor[-1, 0] - first
        axes = np.sign([right, down])
        sensor_rays = camera.rays(on_sensor.reshape(-1, 2))
        expected = sensor_rays[:, :2] @ axes.T

        turned = camera.turned(orientation)

        assert turned.size == image.shape[1::-1]
        v, u = np.indices(image.shape[:2]).reshape(2, -1)
        rays = turned.rays(np.column_stack([u, v]))
        np.testing.assert_allclose(rays[:, :2], expected, atol=1e-9)

    def test_does_not_turn_a_camera_with_a_pose(self, orientation):
        with pytest.raises(CameraError, match="with a pose cannot be turned"):
            DASHCAM.turned(orientation)


# Our camera files.

REPORT = CalibrationReport(
    rms_px=0.5,
    board_rms_px={"a.jpg": 0.4, "b.jpg": 0.6},
    rejected={"c.jpg": "no chessboard"},
    date="2020-01-02",
)


def write_entries(path: Path, **changes: object) -> Path:
    """A camera file with a report, some of whose entries are others."""
    content = camera_to_dict(replace(DASHCAM, report=REPORT))
    path.write_text(yaml.safe_dump(content | changes))
    return path


def test_the_report_stays_in_the_file(tmp_path):
    assert load_camera(write_entries(tmp_path / "camera.yaml")).report == REPORT


@pytest.mark.parametrize(
    ("entry", "value"),
    [
        ("image_width", None),
        ("distortion_coefficients", None),
        ("pose", None),
        ("distortion_model", "spherical"),
        ("camera_matrix", {"data": [-1000.0, 0, 640, 0, 1000.0, 360, 0, 0, 1]}),
        ("camera_matrix", {"data": [1.0, 2.0]}),
        ("camera_matrix", {"data": [1000.0, 30, 640, 0, 1000, 360, 0, 0, 1]}),
        ("distortion_coefficients", {"data": [6e307, 0.02, 0.0005, -0.0003, 0.0]}),
        ("distortion_coefficients", {"data": [0.1] * 3}),
        ("pose", {"height_m": 1.3, "pitch_rad": 3.0}),
        ("pose", {"height_m": 25.0}),
        ("pose", {"height_m": 1.3, "tilt_rad": 0.1}),
        (
            "calibration",
            {"rms_px": 0.3, "board_rms_px": {"a.jpg": "good"}, "date": 1},
        ),
    ],
)
def test_bad_entry_is_refused(tmp_path, entry, value):
    path = write_entries(tmp_path / "camera.yaml", **{entry: value})
    with pytest.raises(CameraError, match=r"camera\.yaml: is not a usable camera file"):
        load_camera(path)


def test_offset_and_width_of_the_car_stay_in_the_file(tmp_path):
    camera = replace(LENS, offset_m=-0.65, car_width_m=2.5)
    loaded = load_camera(save_camera(camera, tmp_path / "camera.yaml"))
    assert loaded.offset_m == -0.65
    assert loaded.car_width_m == 2.5


def test_the_uncertainty_of_pose_and_lens_stays_in_the_file(tmp_path):
    uncertain = replace(
        DASHCAM, pose_std=PoseStd(0.03, 0.015), lens_std_m=ASSUMED_LENS_STD_M
    )
    found = load_camera(save_camera(uncertain, tmp_path / "camera.yaml"))
    assert found == uncertain


def test_without_an_offset_the_file_has_none(tmp_path):
    path = save_camera(LENS, tmp_path / "camera.yaml")
    assert "offset" not in path.read_text()
    assert load_camera(path).offset_m == 0


@pytest.mark.parametrize("camera", [LENS, Camera.from_fov((640, 360), 60)])
def test_whether_a_lens_was_calibrated_stays_in_the_file(tmp_path, camera):
    loaded = load_camera(save_camera(camera, tmp_path / "camera.yaml"))
    assert loaded.calibrated == camera.calibrated


@pytest.mark.parametrize(
    ("entry", "named"),
    [
        ("camera_offset_m: 65", "65 m beside"),
        ("car_width_m: 9", "9 m wide is not plausible"),
    ],
)
def test_an_implausible_car_is_refused(tmp_path, entry, named):
    path = save_camera(LENS, tmp_path / "camera.yaml")
    path.write_text(f"{path.read_text()}{entry}\n")
    with pytest.raises(CameraError, match=named):
        load_camera(path)


# Camera files of other programs, ours in other programs, and the committed ones.


def committed() -> list[str]:
    """The committed camera files, and the JSON files with a camera in them."""
    listed = subprocess.run(
        ["git", "grep", "-l", "camera_matrix", "--", "*.yaml", "*.yml", "*.json"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    return listed.stdout.splitlines()


@pytest.fixture(params=committed())
def entries(request) -> dict:
    """The entries of a committed camera file."""
    path = ROOT / request.param
    text = path.read_text()
    return (
        json.loads(text)["camera"] if path.suffix == ".json" else yaml.safe_load(text)
    )


class TestACommittedFile:
    """It has what ROS's camera_calibration_parsers requires."""

    @pytest.mark.parametrize("name", ["camera_name", "distortion_model"])
    def test_has_each_name(self, entries, name):
        assert isinstance(entries[name], str)

    @pytest.mark.parametrize(
        ("name", "columns"),
        [("camera_matrix", 3), ("rectification_matrix", 3), ("projection_matrix", 4)],
    )
    def test_a_committed_camera_file_has_what_the_parser_of_ros_requires(
        self, entries, name, columns
    ):
        matrix = entries[name]
        assert (matrix["rows"], matrix["cols"]) == (3, columns)
        assert len(matrix["data"]) == 3 * columns

    def test_projects_as_the_camera_does(self, entries):
        projection = np.reshape(entries["projection_matrix"]["data"], (3, 4))
        camera = camera_from_dict(entries)
        np.testing.assert_array_equal(projection[:, :3], camera.matrix)

    def test_is_not_rectified(self, entries):
        rectification = np.reshape(entries["rectification_matrix"]["data"], (3, 3))
        np.testing.assert_array_equal(rectification, np.eye(3))


def test_opencv_reads_what_is_written(tmp_path):
    path = save_camera(LENS, tmp_path / "camera.yaml")

    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)

    matrix = storage.getNode("camera_matrix").mat()
    np.testing.assert_array_equal(matrix, LENS.matrix)
    assert storage.getNode("pose").getNode("height_m").real() == 1.4


@pytest.mark.parametrize(
    ("head", "matrix", "distortion"),
    [
        pytest.param(
            "%YAML:1.0", "camera_matrix", "distortion_coefficients", id="OpenCV 4"
        ),
        pytest.param("%YAML 1.2", "K", "D", id="OpenCV 5"),
    ],
)
def test_what_opencv_writes_is_read(tmp_path, head, matrix, distortion):
    path = tmp_path / "opencv.yml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("calibration_time", "Thu 26 Nov 2026 10:00:00")
    storage.write("image_width", 1280)
    storage.write("image_height", 800)
    storage.write(matrix, LENS.matrix)
    storage.write(distortion, LENS.distortion.reshape(5, 1))
    storage.release()
    _, *lines = path.read_text().splitlines()
    path.write_text("\n".join([head, *lines]))
    assert "!!opencv-matrix" in path.read_text()

    camera = load_camera(path)

    assert camera == replace(LENS, pose=None)


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


@pytest.mark.parametrize(
    ("lens", "is_fisheye"), [("radtan", False), ("equidistant", True)]
)
def test_a_camchain_of_kalibr_is_read(tmp_path, lens, is_fisheye):
    path = tmp_path / "camchain.yaml"
    path.write_text(CAMCHAIN.format(camera="pinhole", lens=lens))

    camera = load_camera(path)

    assert camera.size == (1280, 800)
    assert camera.is_fisheye == is_fisheye
    np.testing.assert_array_equal(camera.matrix, LENS.matrix)
    np.testing.assert_array_equal(camera.distortion[:4], [0.02, -0.01, 0.003, -0.001])


@pytest.mark.parametrize(
    ("text", "named"),
    [
        (CAMCHAIN.format(camera="omni", lens="radtan"), "camera model 'omni'"),
        (CAMCHAIN.format(camera="pinhole", lens="fov"), "distortion model 'fov'"),
        (
            CAMCHAIN.format(camera="pinhole", lens="radtan") + "cam1: {}\n",
            "2 cameras, cam0, cam1",
        ),
        ("<?xml version='1.0'?>\n<opencv_storage/>\n", "it is XML"),
        ("%YAML:1.0\n---\nM1: 3\n", "'camera_matrix' is missing"),
    ],
)
def test_what_cannot_be_read_is_named(tmp_path, run, text, named):
    path = tmp_path / "other.yaml"
    path.write_text(text)

    status, _, err = run("annotate", "--camera", path, path)

    assert status == 2
    assert named in err


MESSAGE_OF_ROS = """\
header:
  stamp:
    sec: {second}
    nanosec: 0
  frame_id: camera
height: 800
width: 1280
distortion_model: plumb_bob
d: [-0.31, 0.09, 0.001, -0.0005, 0.0]
k:
- 910.5
- 0.0
- 655.25
- 0.0
- 905.0
- 388.5
- 0.0
- 0.0
- 1.0
r: [1, 0, 0, 0, 1, 0, 0, 0, 1]
p: [880, 0, 655.25, 0, 0, 880, 388.5, 0, 0, 0, 1, 0]
binning_x: 0
binning_y: 0
roi:
  x_offset: 0
  y_offset: 0
  height: 0
  width: 0
  do_rectify: false
---
"""
# of ROS 1, as Apollo has them
MESSAGE_OF_ROS_1 = (
    MESSAGE_OF_ROS.replace("d: [", "D: [").replace("k:", "K:").replace("p: [", "P: [")
)
NESTED = """\
image_size: [1280, 800]
camera_matrix: [[910.5, 0, 655.25], [0, 905, 388.5], [0, 0, 1]]
dist_coeff:
- - -0.31
  - 0.09
  - 0.001
  - -0.0005
  - 0.0
"""
OF_OPENCV_5 = """\
%YAML 1.2
---
image_width: 1280
image_height: 800
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 910.5, 0., 655.25, 0., 905., 388.5, 0., 0., 1. ]
distortion_coefficients: !!opencv-nd-matrix
   sizes: [ 5 ]
   dt: d
   data: [ -0.31, 0.09, 0.001, -0.0005, 0. ]
"""
# A rectified image and a part of an image need what a file does not say.
READ = {
    "a message of ROS 2": MESSAGE_OF_ROS.format(second=1),
    "several messages": MESSAGE_OF_ROS.format(second=1)
    + MESSAGE_OF_ROS.format(second=2),
    "a message of ROS 1": MESSAGE_OF_ROS_1.format(second=1),
    "nested lists": NESTED,
    "a flat array of OpenCV 5": OF_OPENCV_5,
    "JSON": json.dumps(yaml.safe_load(NESTED), indent=1),
}


@pytest.mark.parametrize("name", READ)
def test_printed_messages_and_lists_are_read(tmp_path, name):
    path = tmp_path / "other.yaml"
    path.write_text(READ[name])
    assert load_camera(path) == replace(LENS, pose=None)


REFUSED = {
    "COLMAP": (
        "# Camera list with one line of data per camera:\n"
        "1 OPENCV 1280 800 910 905 655 388 -0.3 0.1 0 0\n",
        "is a cameras.txt of COLMAP.* its width, height, fx, fy, cx, cy",
    ),
    "nerfstudio": ('{"w": 1280, "fl_x": 910.5}', "nerfstudio.* its w, h, fl_x"),
    "EuRoC": (
        "sensor_type: camera\nintrinsics: [1, 2, 3, 4]\n",
        "sensor.yaml of EuRoC.* its resolution, intrinsics",
    ),
    "VINS": (
        "%YAML:1.0\n---\nmodel_type: PINHOLE\nprojection_parameters:\n   fx: 1\n",
        "a camera of VINS.*of its blocks",
    ),
    "Gyroflow": (
        '{"calib_dimension": {"w": 1280}, "fisheye_params": {"camera_matrix": []}}',
        "Gyroflow.* its calib_dimension.*equidistant",
    ),
    "ost.txt": ("# oST version 5.0 parameters\n\n[image]\n", "or use its ost.yaml"),
    "two cameras": (
        MESSAGE_OF_ROS.format(second=1)
        + MESSAGE_OF_ROS.format(second=1).replace("910.5", "700"),
        "2 different cameras",
    ),
    "no calibration": (
        MESSAGE_OF_ROS.format(second=1)
        .replace("910.5", "0")
        .replace("655.25", "0")
        .replace("905.0", "0")
        .replace("388.5", "0")
        .replace("1.0", "0"),
        "its K is zero: the driver has no calibration",
    ),
    "binning": (
        MESSAGE_OF_ROS.format(second=1).replace("binning_x: 0", "binning_x: 2"),
        "region of interest or binning; give the log",
    ),
    "part": (
        MESSAGE_OF_ROS.format(second=1).replace("  width: 0", "  width: 640"),
        "region of interest or binning; give the log",
    ),
    "no size": (
        NESTED.replace("image_size", "comment"),
        "entry 'image_width' is missing",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_to_copy_from_another_file_is_said(tmp_path, name):
    text, words = REFUSED[name]
    path = tmp_path / "other.yaml"
    path.write_text(text)
    with pytest.raises(CameraError, match=words) as raised:
        load_camera(path)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("protocol", range(6))
def test_a_pickle_is_never_opened(tmp_path, protocol):
    path = tmp_path / "wide_dist_pickle.p"
    path.write_bytes(pickle.dumps({"mtx": LENS.matrix}, protocol))
    with pytest.raises(CameraError, match="is a pickle, which is not opened"):
        load_camera(path)


def test_an_archive_of_numpy_is_named(tmp_path):
    np.savez(tmp_path / "lens.npz", mtx=LENS.matrix, dist=LENS.distortion)
    with pytest.raises(CameraError, match=r"an archive of NumPy.*np\.load reads"):
        load_camera(tmp_path / "lens.npz")


RATIONAL = [0.3, 0.1, 0.001, 0.002, 0.01, 0.6, 0.2, 0.03]


@pytest.mark.parametrize(
    ("model", "given", "expected"),
    [
        ("none", [], [0] * 5),
        ("", [], [0] * 5),
        (None, [0.1, 0.02, 0.003, 0.004], [0.1, 0.02, 0.003, 0.004, 0]),
        (None, RATIONAL, RATIONAL),
        ("plumb_bob", [*RATIONAL[:5], 0, 0, 0], RATIONAL[:5]),
        ("radtan", [-0.3, 0.1, 0.001, 0.002], [-0.3, 0.1, 0.001, 0.002, 0]),
        ("fisheye", [0.02, -0.01, 0.003, -0.001], [0.02, -0.01, 0.003, -0.001]),
        ("plumb_bob", RATIONAL, RATIONAL),
        ("rational_polynomial", RATIONAL + [0] * 6, RATIONAL),
    ],
)
def test_models_by_their_other_names_and_lengths(tmp_path, model, given, expected):
    path = write_entries(
        tmp_path / "camera.yaml",
        distortion_model=model,
        distortion_coefficients={"data": given},
    )
    np.testing.assert_array_equal(load_camera(path).distortion, expected)
