"""Images, calibration and the lens: files, boards cut off, points and images."""

from pathlib import Path
from shutil import copy

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pytest import approx

from helpers import (
    Lens,
    calibrate,
    distort_points,
    read_image,
    undistort,
    undistort_points,
    write_image,
)
from lanes.camera.model import load_camera
from lanes.camera.model import undistort as undistort_by_lanes
from tests.support.classic_lane import lens_of, needs_real_data
from tests.support.painted_roads import RECIPE_CAMERA as CAMERA
from tests.support.project import REAL_DATA, ROOT

parametrize = pytest.mark.parametrize

BOARDS = ROOT / "camera_cal"
LENS = lens_of(CAMERA)
ROAD = np.full((720, 1280, 3), 90, np.uint8)


@pytest.fixture(scope="module")
def lens():
    return calibrate(BOARDS)


@pytest.fixture
def red_and_green():
    image = np.zeros((40, 64, 3), np.uint8)
    image[:, :32] = (220, 30, 20)
    image[:, 32:] = (20, 200, 40)
    return image


@parametrize("suffix", [".png", ".JPG", ".bmp", ".tif"])
def test_an_image_is_written_and_read_in_rgb(tmp_path, red_and_green, suffix):
    path = tmp_path / "new" / f"image{suffix}"
    assert write_image(path, red_and_green) == path
    read = read_image(path).astype(int)
    some_pixels = np.s_[::20, 10::44]
    assert_allclose(read[some_pixels], red_and_green[some_pixels], atol=6)
    assert [file.name for file in path.parent.iterdir()] == [path.name]


@parametrize("kind", ["missing", "empty", "text", "cut"])
def test_a_file_that_is_no_image_is_named(tmp_path, kind):
    path = tmp_path / "photo.jpg"
    whole = (BOARDS / "calibration2.jpg").read_bytes()
    half = len(whole) // 2
    contents = {"empty": b"", "text": b"hello", "cut": whole[:half]}
    if kind != "missing":
        path.write_bytes(contents[kind])
    with pytest.raises(OSError, match=r"photo\.jpg"):
        read_image(path)


def test_a_name_without_a_known_suffix_is_refused(tmp_path, red_and_green):
    with pytest.raises(ValueError, match=r"image\.xyz: end the name in \.jpg or \.png"):
        write_image(tmp_path / "image.xyz", red_and_green)


def test_calibration_finds_the_true_lens(lens):
    """Of the rendered boards. Three are cut off by the border, two a pixel larger."""
    true = load_camera(ROOT / "test_videos" / "project_video.yaml")
    assert_allclose(lens.matrix, true.matrix, atol=1.0)
    assert lens.size == (1280, 720)
    assert lens.distortion.shape == (5,)
    assert lens.rms_px < 0.1
    assert len(lens.board_rms_px) == 20
    assert lens.not_used == {}

    corners = [
        (0, 0),
        (1279, 0),
        (640, 719),
        (0, 719),
        (1279, 719),
    ]
    expected = true.undistort_points(corners)
    assert_allclose(undistort_points(corners, lens), expected, atol=2.0)


def test_two_calibrations_give_the_same_numbers():
    files = [BOARDS / f"calibration{number}.jpg" for number in (2, 3, 6, 8, 10)]
    first = calibrate(files)
    again = calibrate(reversed(files))
    assert_array_equal(first.matrix, again.matrix)
    assert_array_equal(first.distortion, again.distortion)


def test_every_image_that_is_not_used_is_named_with_the_reason(tmp_path):
    """No board; another size; corners of a board that is bent."""
    for number in (2, 3, 6, 8, 9, 10, 11, 12):
        copy(BOARDS / f"calibration{number}.jpg", tmp_path)
    write_image(tmp_path / "road.png", ROAD)
    board = read_image(BOARDS / "calibration2.jpg")
    write_image(tmp_path / "large.png", cv2.resize(board, (1600, 900)))
    write_image(tmp_path / "bent.png", bend(board))

    lens = calibrate(tmp_path)
    assert set(lens.not_used) == {"road.png", "large.png", "bent.png"}
    assert "no board of 9x6 corners" in lens.not_used["road.png"]
    assert "is 1600x900, not 1280x720" in lens.not_used["large.png"]
    assert lens.not_used["bent.png"].startswith("error ")
    assert len(lens.board_rms_px) == 8


def bend(image):
    """The image of a board whose paper is wavy."""
    v, u = np.indices(image.shape[:2], np.float32)
    wavy_u = u + 4 * np.sin(v / 40)
    return cv2.remap(image, wavy_u, v, cv2.INTER_LINEAR)


def test_too_few_boards_are_refused_with_reasons(tmp_path):
    copy(BOARDS / "calibration2.jpg", tmp_path)
    write_image(tmp_path / "road.png", ROAD)
    with pytest.raises(
        ValueError, match=r"only 1 images show a board(?s:.)*road\.png: no"
    ):
        calibrate(tmp_path)


def test_boards_that_do_not_determine_the_lens_are_refused(tmp_path):
    """Three copies of one image, to which many lenses fit."""
    for number in range(3):
        copy(BOARDS / "calibration3.jpg", tmp_path / f"{number}.jpg")
    with pytest.raises(ValueError, match="these boards do not determine the lens"):
        calibrate(tmp_path)


def test_two_boards_of_one_name_are_refused():
    board = BOARDS / "calibration2.jpg"
    with pytest.raises(ValueError, match=r"two boards are called calibration2\.jpg"):
        calibrate([board, board])


def test_a_board_file_that_does_not_exist_is_named():
    with pytest.raises(FileNotFoundError, match="nowhere"):
        calibrate([Path("nowhere.jpg")])


@needs_real_data
def test_the_real_boards_are_all_used():
    """Three are cut off by the border, two are of 1281x721."""
    lens = calibrate(REAL_DATA / "camera_cal")
    assert len(lens.board_rms_px) == 20
    assert lens.not_used == {}
    assert lens.rms_px < 1.003  # of 17 complete boards with sub-pixel corners
    assert lens.matrix[0, 0] == approx(1158, abs=6)


@parametrize(
    ("matrix", "distortion"),
    [
        (np.eye(2), np.zeros(5)),
        (np.eye(3), np.zeros(4)),
        (np.eye(3), np.zeros(9)),
    ],
)
def test_a_lens_with_other_numbers_is_refused(matrix, distortion):
    with pytest.raises(ValueError, match="take those of cv2.calibrateCamera"):
        Lens(matrix, distortion, (1280, 720))


def test_undistort_is_that_of_opencv_and_of_lanes():
    random = np.random.default_rng(0)
    image = random.integers(0, 256, (720, 1280, 3), np.uint8)
    image = cv2.GaussianBlur(image, (0, 0), 3)
    flat = undistort(image, LENS).astype(int)
    by_opencv = cv2.undistort(image, LENS.matrix, LENS.distortion)
    assert np.abs(flat - by_opencv).max() <= 2
    assert_array_equal(flat, undistort_by_lanes(image, CAMERA))


def test_points_go_through_the_lens_and_back():
    random = np.random.default_rng(2)
    raw = random.uniform([0, 0], [1279, 719], (200, 2))
    flat = undistort_points(raw, LENS)
    assert_allclose(flat, CAMERA.undistort_points(raw), atol=1e-6)
    assert_allclose(distort_points(flat, LENS), raw, atol=1e-6)
    assert np.abs(flat - raw).max() > 20
    assert undistort_points([], LENS).shape == (0, 2)
    assert distort_points([], LENS).shape == (0, 2)


def test_no_point_outside_is_placed_inside_the_image():
    """Far outside, the polynomial of a lens can turn back: those points are NaN."""
    distortion = np.array([-0.25, 0, 0, 0, 0])
    barrel = Lens(LENS.matrix, distortion, LENS.size)
    u = np.linspace(1400, 4000, 100)
    v = np.full(100, 400.0)
    raw = distort_points(np.column_stack([u, v]), barrel)
    is_nan = np.isnan(raw).all(axis=1)
    assert is_nan.any()
    assert not is_nan.all()
    assert (raw[~is_nan, 0] > 1279).all()
