"""Rendered chessboards: their ground truth is checked against the images by independent means."""

import json

import cv2
import numpy as np
import pytest

from benchmark.evaluation import PROJECT_ROOT
from lanes.camera import camera_from_dict
from lanes.images import read_image
from simulator import chessboards as scene
from simulator.chessboards import BOARD_VIEWS, render_board, true_corners, write_boards
from simulator.scenes.freeway import DASHCAM

BOARDS = PROJECT_ROOT / "camera_cal"


@pytest.fixture(scope="module")
def truth() -> dict:
    return json.loads((BOARDS / "truth.json").read_text())


def test_three_of_the_twenty_boards_are_cut_and_the_camera_is_that_of_the_course(truth):
    boards = truth["boards"]
    assert list(boards) == [f"calibration{n}.jpg" for n in range(1, 21)]
    assert [
        n for n, board in enumerate(boards.values(), 1) if not all(board["inside"])
    ] == [1, 4, 5]
    for name, board in boards.items():
        assert read_image(BOARDS / name).shape == (board["height"], board["width"], 3)
    camera = camera_from_dict(truth["camera"])
    np.testing.assert_array_equal(camera.matrix, DASHCAM.matrix)
    np.testing.assert_array_equal(camera.distortion, DASHCAM.distortion)


@pytest.mark.parametrize("number", [1, 5, 7, 13, 20])
def test_true_corners_are_at_the_corners_of_the_picture(truth, number):
    """Sub-pixel refinement that starts at the truth stays there."""
    board = truth["boards"][f"calibration{number}.jpg"]
    gray = cv2.cvtColor(
        read_image(BOARDS / f"calibration{number}.jpg"), cv2.COLOR_RGB2GRAY
    )
    corners = np.array(board["corners_px"], np.float32)
    well_inside = (
        (corners > 12) & (corners < [board["width"] - 12, board["height"] - 12])
    ).all(axis=1)
    corners = corners[well_inside]
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-4)
    moved = (
        cv2.cornerSubPix(
            gray, corners.reshape(-1, 1, 2).copy(), (4, 4), (-1, -1), stop
        ).reshape(-1, 2)
        - corners
    )
    assert np.sqrt((moved**2).sum(axis=1).mean()) < 0.25
    assert np.abs(moved.mean(axis=0)).max() < 0.05


def test_a_picture_depends_on_the_seed_only_and_that_of_the_committed_one_reproduces_it():
    first, other = (render_board(BOARD_VIEWS[10], seed=seed) for seed in (11, 12))
    assert (first != other).mean() > 0.3
    difference = np.abs(first.astype(int) - read_image(BOARDS / "calibration11.jpg"))
    assert difference.mean() < 3 and np.percentile(difference, 99.9) < 20


def test_writing_reports_progress_and_writes_the_truth(tmp_path, monkeypatch):
    monkeypatch.setattr(scene, "BOARD_VIEWS", BOARD_VIEWS[5:7])
    seen = []
    written = write_boards(
        tmp_path / "new",
        progress=lambda done, total: seen.append((done, total)),
        workers=1,
    )
    assert [p.name for p in written] == [
        "calibration1.jpg",
        "calibration2.jpg",
        "truth.json",
    ]
    assert seen == [(1, 2), (2, 2)]
    boards = json.loads(written[-1].read_text())["boards"]
    np.testing.assert_allclose(
        boards["calibration2.jpg"]["corners_px"],
        true_corners(BOARD_VIEWS[6]),
        atol=1e-3,
    )
