"""Rendered chessboards: their truth is checked against the images by other means."""

import json

import cv2
import numpy as np
import pytest

from benchmark.evaluation import PROJECT_ROOT
from lanes.camera.model import Camera, camera_from_dict
from lanes.video.images import read_image
from simulator import chessboards
from simulator.chessboards import BOARD_VIEWS, render_board, true_corners, write_boards
from simulator.scenes.freeway import DASHCAM

BOARDS = PROJECT_ROOT / "camera_cal"
# Corners nearer to the border of an image than this are left out.
MARGIN_PX = 12


@pytest.fixture(scope="module")
def truth() -> dict:
    return json.loads((BOARDS / "truth.json").read_text())


@pytest.fixture(scope="module")
def true_camera(truth) -> Camera:
    return camera_from_dict(truth["camera"])


def test_there_are_twenty_boards(truth):
    assert list(truth["boards"]) == [f"calibration{n}.jpg" for n in range(1, 21)]


def test_three_boards_are_cut_by_the_border_of_the_image(truth):
    boards = enumerate(truth["boards"].values(), 1)
    assert [n for n, board in boards if not all(board["inside"])] == [1, 4, 5]


def test_the_truth_has_the_sizes_of_the_images(truth):
    for name, board in truth["boards"].items():
        size = (board["height"], board["width"], 3)
        assert read_image(BOARDS / name).shape == size


def test_the_camera_matrix_is_that_of_the_course(true_camera):
    np.testing.assert_array_equal(true_camera.matrix, DASHCAM.matrix)


def test_the_distortion_is_that_of_the_course(true_camera):
    np.testing.assert_array_equal(true_camera.distortion, DASHCAM.distortion)


@pytest.mark.parametrize("number", [1, 5, 7, 13, 20])
def test_subpixel_refinement_that_starts_at_the_truth_stays_there(truth, number):
    board = truth["boards"][f"calibration{number}.jpg"]
    image = read_image(BOARDS / f"calibration{number}.jpg")
    corners = np.array(board["corners_px"], np.float32)
    highest = [board["width"] - MARGIN_PX, board["height"] - MARGIN_PX]
    inside = (corners > MARGIN_PX) & (corners < highest)
    corners = corners[inside.all(axis=1)]

    refined = cv2.cornerSubPix(
        cv2.cvtColor(image, cv2.COLOR_RGB2GRAY),
        corners.reshape(-1, 1, 2).copy(),
        winSize=(4, 4),
        zeroZone=(-1, -1),
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-4),
    )

    moved = refined.reshape(-1, 2) - corners
    rms_px = np.sqrt((moved**2).sum(axis=1).mean())
    assert rms_px < 0.25
    assert np.abs(moved.mean(axis=0)).max() < 0.05


def test_the_seed_of_the_committed_board_reproduces_it():
    board = render_board(BOARD_VIEWS[10], seed=11)
    committed = read_image(BOARDS / "calibration11.jpg")
    difference = np.abs(board.astype(int) - committed)
    assert difference.mean() < 3
    assert np.percentile(difference, 99.9) < 20


def test_another_seed_gives_another_picture():
    board = render_board(BOARD_VIEWS[10], seed=11)
    other = render_board(BOARD_VIEWS[10], seed=12)
    assert (board != other).mean() > 0.3


@pytest.fixture
def written(tmp_path, monkeypatch) -> tuple[list, list]:
    """Files of two boards, written into a new folder, and reports of progress."""
    monkeypatch.setattr(chessboards, "BOARD_VIEWS", BOARD_VIEWS[5:7])
    reports = []
    files = write_boards(
        tmp_path / "new",
        progress=lambda done, total: reports.append((done, total)),
        workers=1,
    )
    return files, reports


def test_writing_returns_the_names_and_reports_progress(written):
    files, reports = written
    names = [path.name for path in files]
    assert names == ["calibration1.jpg", "calibration2.jpg", "truth.json"]
    assert reports == [(1, 2), (2, 2)]


def test_the_written_truth_has_the_true_corners(written):
    files, _ = written
    boards = json.loads(files[-1].read_text())["boards"]
    corners = boards["calibration2.jpg"]["corners_px"]
    np.testing.assert_allclose(corners, true_corners(BOARD_VIEWS[6]), atol=1e-3)
