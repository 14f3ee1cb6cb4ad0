"""Calibration: against the known lens, with every kind of unfit board among the good ones; report and command."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmark.evaluation import PROJECT_ROOT
from lanes.camera.calibration import (
    BoardDetections,
    calibrate,
    calibrate_boards,
    calibrate_detections,
    describe_calibration,
)
from lanes.camera.chessboard import Board
from lanes.camera.model import Camera, load_camera, save_camera
from lanes.canvas import LANE_COLOUR, LEFT_COLOUR
from lanes.errors import CameraError
from lanes.video.images import read_image, write_image
from lanes.video.writer import VideoWriter
from simulator.chessboards import BOARD_VIEWS, true_corners
from simulator.scenes.freeway import DASHCAM
from tests.video.sample_videos import set_rotation

SIZE = (1280, 720)


def true_board(number: int, noise_px: float = 0.05) -> Board:
    """The corners of rendered board `number` where they truly are, give or take a finder's noise."""
    noise = np.random.default_rng(number).normal(0, noise_px, (54, 2))
    return Board((true_corners(BOARD_VIEWS[number - 1]) + noise).astype(np.float32), 9, 6, SIZE)


@pytest.fixture
def boards() -> dict[str, Board]:
    return {f"board{number}.jpg": true_board(number) for number in (2, 3, 6, 8, 9, 10, 12, 13, 17, 19)}


def assert_is_the_dashcam(camera: Camera) -> None:
    np.testing.assert_allclose(np.diag(camera.matrix), np.diag(DASHCAM.matrix), rtol=0.002)
    np.testing.assert_allclose(camera.matrix[:2, 2], DASHCAM.matrix[:2, 2], atol=2)


@pytest.mark.slow
def test_rendered_boards_give_the_lens_they_were_taken_with():
    """All are used, also those that the image border cuts off."""
    camera = calibrate(PROJECT_ROOT / "camera_cal")
    assert_is_the_dashcam(camera)
    assert camera.size == SIZE
    u, v = np.meshgrid(np.linspace(0, 1279, 15), np.linspace(0, 719, 9))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    angle = np.linalg.norm(camera.rays(pixels) - DASHCAM.rays(pixels), axis=1)
    assert np.degrees(angle).max() < 0.05
    assert camera.report.rejected == {} and camera.report.rms_px < 0.1
    assert list(camera.report.board_rms_px) == [f"calibration{n}.jpg" for n in range(1, 21)]


def test_errors_are_those_of_the_corners_and_the_same_in_each_run(boards):
    """Noise of 0.05 px in each coordinate leaves an error of 0.05 * sqrt(2) px. OpenCV's threads are restored."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(2)
    try:
        first, second = calibrate_boards(boards), calibrate_boards(boards)
        assert cv2.getNumThreads() == 2
    finally:
        cv2.setNumThreads(threads)
    assert first.matrix.tobytes() == second.matrix.tobytes()
    assert first.distortion.tobytes() == second.distortion.tobytes()
    report = first.report
    assert list(report.board_rms_px) == list(boards) and report.rejected == {}
    assert report.rms_px == pytest.approx(0.05 * np.sqrt(2), rel=0.1)
    assert np.sqrt(np.mean(np.square(list(report.board_rms_px.values())))) == pytest.approx(report.rms_px)


def test_bad_boards_do_not_excuse_each_other():
    """Three of seven are bad: the mean error of all boards is nearly half as large as theirs, the median is not."""
    bad = {3, 9, 12}
    boards = {f"{n}": true_board(n, noise_px=2.0 if n in bad else 0.05) for n in (2, 3, 6, 8, 9, 12, 17)}
    camera = calibrate_boards(boards)
    assert set(map(int, camera.report.rejected)) == bad
    assert_is_the_dashcam(camera)


def detected(boards: dict[str, Board], **unused: str) -> BoardDetections:
    tiles = {name: np.full((225, 400, 3), 128, np.uint8) for name in [*boards, *unused]}
    return BoardDetections(tiles, (9, 6), boards, unused)


def test_the_use_of_each_image_is_described(boards):
    """One is seen in part, one cut a pixel later, one has another size, one is bent; one image shows a wall."""
    part = boards["board17.jpg"].corners_px.reshape(6, 9, 2)[1:, 3:]
    boards["board17.jpg"] = Board(part.reshape(-1, 2), 6, 5, SIZE)
    boards["board2.jpg"] = true_board(2, noise_px=0.1)  # its error is not that of all
    boards["board8.jpg"] = replace(boards["board8.jpg"], size=(1281, 721))
    boards["board10.jpg"] = replace(boards["board10.jpg"], size=(640, 480))
    bent = boards["board9.jpg"].corners_px.copy()
    bent[::7] += 6
    boards["board9.jpg"] = replace(boards["board9.jpg"], corners_px=bent)
    detections = detected(boards, wall="no chessboard")
    camera = calibrate_detections(detections, "here")
    text = describe_calibration(detections, camera)
    uses = {line.split()[0]: line for line in text.splitlines()}
    assert uses["board2.jpg"].endswith(f"{camera.report.board_rms_px['board2.jpg']:.2f}  used")
    assert uses["board17.jpg"].endswith("  used, 6x5 corners of the board")
    assert uses["board8.jpg"].endswith("  used, image of 1281x721")
    assert "  -  image is 640x480 pixels, the others 1280x720" in uses["board10.jpg"]
    assert re.search(r"  -  error \d\.\d\d px, more than 2.5 times", uses["board9.jpg"])
    assert uses["wall"].endswith("  -  no chessboard")
    assert "8 of 11 images used, error 0.0" in text and "focal length 115" in text


def wide_boards(fov_deg: float) -> tuple[Camera, dict[str, Board]]:
    """A fisheye lens, and fourteen boards all over its image, with a finder's noise."""
    rng, focal_px = np.random.default_rng(1), 640 / np.radians(fov_deg / 2)
    matrix = np.array([[focal_px, 0, 650], [0, focal_px, 350], [0, 0, 1]])
    camera, boards = Camera(*SIZE, matrix, np.array([0.02, -0.01, 0.003, -0.001])), {}
    while len(boards) < 14:
        direction = camera.rays(rng.uniform(0.1, 0.9, (1, 2)) * SIZE)
        turn, distance = rng.uniform(-0.7, 0.7, 3), rng.uniform(6, 16)
        points = Board(np.zeros((54, 2)), 9, 6, SIZE).object_points - [4, 2.5, 0]
        shift = distance * direction / np.linalg.norm(direction)
        corners = cv2.fisheye.projectPoints(points[None], turn, shift, matrix, camera.distortion)[0][0]
        if ((corners > 5) & (corners < np.subtract(SIZE, 6))).all():
            noisy = corners + rng.normal(0, 0.2, corners.shape)
            boards[f"{len(boards)}.jpg"] = Board(noisy.astype(np.float32), 9, 6, SIZE)
    return camera, boards


@pytest.mark.parametrize("fov_deg", [60, 100, 140])
def test_wide_lenses_get_the_model_that_fits(fov_deg):
    true, boards = wide_boards(fov_deg)
    camera = calibrate_boards(boards)
    assert camera.matrix[0, 0] == pytest.approx(true.matrix[0, 0], rel=0.005)
    assert camera.is_fisheye == (fov_deg >= 140)
    assert camera.report.rejected == {} and camera.report.rms_px < 0.4
    if camera.is_fisheye:
        assert camera.hfov_deg == pytest.approx(true.hfov_deg, abs=1)


def test_doubtful_boards_are_used_if_a_fisheye_lens_explains_them():
    true, boards = wide_boards(175)
    boards = {name: replace(board, doubtful=int(name[:-4]) % 2 == 0) for name, board in boards.items()}
    skipped = boards["4.jpg"].corners_px.reshape(6, 9, 2)[[0, 1, 2, 4, 5, 5]] + np.float32([[[0, 0]]] * 5 + [[[0, 9]]])
    boards["skipped.jpg"] = replace(boards["4.jpg"], corners_px=skipped.reshape(-1, 2))
    camera = calibrate_boards(boards)
    assert camera.is_fisheye and camera.matrix[0, 0] == pytest.approx(true.matrix[0, 0], rel=0.005)
    assert set(camera.report.rejected) == {"skipped.jpg"} and "it is no board" in camera.report.rejected["skipped.jpg"]
    few = {name: board for name, board in boards.items() if board.doubtful or name in ("1.jpg", "3.jpg")}
    assert len(calibrate_boards(few).report.board_rms_px) == 9  # two sure boards alone do not determine a lens


def test_an_uncertain_focal_length_is_written_as_such(tmp_path):
    """Three boards, of which two are hardly tilted."""
    boards = {f"{n}.jpg": true_board(n, noise_px=0.25) for n in (1, 6, 17)}
    camera = calibrate_boards(boards)
    share = load_camera(save_camera(camera, tmp_path / "camera.yaml")).report.focal_std_share
    assert 0.02 < share < 0.04 and abs(camera.matrix[0, 0] / DASHCAM.matrix[0, 0] - 1) < 3 * share
    text = describe_calibration(detected(boards), camera)
    assert f"warning: the focal length is uncertain by {share:.1%}" in text
    sure = calibrate_boards({name: true_board(int(name[:-4])) for name in boards})
    assert "warning" not in describe_calibration(detected(boards), sure)


def crumpled() -> dict[str, Board]:
    """Each board bends in another way."""
    noise, boards = np.random.default_rng(0), wide_boards(100)[1].items()
    bent = {name: board.corners_px + noise.normal(0, 4, (54, 2)) for name, board in boards}
    return {name: Board(corners.astype(np.float32), 9, 6, SIZE) for name, corners in bent.items()}


def without_tilt() -> dict[str, Board]:
    grid = true_board(6).object_points[:, :2]
    return {f"{n}.jpg": Board(grid * 30 + np.float32([100 + 300 * n, 200]), 9, 6, SIZE) for n in range(4)}


REFUSED = {
    r"1 different view\(s\)": lambda: {f"{n}.jpg": true_board(6, noise_px=0.05 + 0.01 * n) for n in range(4)},
    "tilted": without_tilt,
    r"neither a normal nor a fisheye lens \(error \d\.\d\d px, at most 3\.2\)": crumpled,
    r"do not determine the focal length \(\d+ \+- \d+ px\)": lambda: {
        f"{n}.jpg": true_board(n, noise_px=0.8) for n in (1, 6, 17)
    },
}


@pytest.mark.parametrize("words", REFUSED)
def test_boards_that_determine_no_lens_are_refused(words):
    with pytest.raises(CameraError, match=words):
        calibrate_boards(REFUSED[words]())


@pytest.mark.slow
def test_a_video_of_a_board_is_used(tmp_path):
    """Its frames that differ most; a phone films it turned."""
    path, shown = tmp_path / "upright.mp4", np.repeat([2, 9, 12, 13, 6], [3, 1, 3, 1, 2]).tolist()
    with VideoWriter(path, fps=25) as writer:
        for number in shown:
            writer.write(read_image(PROJECT_ROOT / "camera_cal" / f"calibration{number}.jpg"))
    set_rotation(path, tmp_path / "turned.mp4", 90)
    camera = calibrate(tmp_path / "turned.mp4")
    assert_is_the_dashcam(camera)
    times_s = [float(re.fullmatch(r"turned\.mp4 at (.*) s", name)[1]) for name in camera.report.board_rms_px]
    assert [shown[round(25 * time_s)] for time_s in times_s] == [2, 9, 12, 13, 6]


# The command.


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Five boards, a wall, a board of another shape, and a damaged file."""
    folder = tmp_path_factory.mktemp("boards")
    for name, number in zip("abcde", (2, 9, 12, 13, 6), strict=True):
        board = read_image(PROJECT_ROOT / "camera_cal" / f"calibration{number}.jpg")
        write_image(folder / f"{name}.png", board)
    for name in ("wall.png", "more/wall.png"):
        write_image(folder / name, np.full((360, 640, 3), 128, np.uint8))
    write_image(folder / "square.png", cv2.resize(board, (640, 480)))
    (folder / "broken.jpg").write_bytes(b"\xff\xd8 cut off")
    return folder


def test_folder_gives_camera_file_table_and_sheet(folder, run, monkeypatch):
    monkeypatch.chdir(folder)
    status, out, err = run("calibrate", ".", "more", "--sheet", "out/sheet.png", "-o", "out/lens.yaml")
    assert status == 0, err
    camera = load_camera(folder / "out" / "lens.yaml")
    assert camera.matrix[0, 0] == pytest.approx(DASHCAM.matrix[0, 0], rel=0.01)
    table = {line.split()[0]: line for line in out.splitlines() if line}
    assert table["a.png"].endswith("  used")
    for name in ("wall.png", "more/wall.png"):
        assert table[name].endswith("-  no chessboard of 9x6 inner corners, nor a part of one")
    assert "pixels, the others 1280x720; take all with one setting" in table["square.png"]
    assert "broken.jpg: cannot be decoded as an image" in table["broken.jpg"]
    assert "5 of 9 images used, error 0." in out
    assert "no corners in these regions of the image: upper left, upper right, left, lower left, bottom, lower r" in out
    assert out.endswith("wrote out/lens.yaml\nwrote out/sheet.png\n")
    sheet = read_image(folder / "out" / "sheet.png")
    assert sheet.shape == (2 * (225 + 44 + 12), 5 * (400 + 12), 3)
    assert (sheet[3, 3 :: 400 + 12] == [LANE_COLOUR, LANE_COLOUR, LEFT_COLOUR, LANE_COLOUR, LANE_COLOUR]).all()


def test_the_sheet_is_written_when_the_calibration_is_refused(folder, run, monkeypatch):
    monkeypatch.chdir(folder)
    outputs = "--sheet", "refused/sheet.png", "-o", "refused/lens.yaml"
    status, out, err = run("calibrate", "a.png", "b.png", "wall.png", *outputs)
    assert (status, out) == (2, "wrote refused/sheet.png\n") and "at least 3, better 15" in err
    assert [path.name for path in (folder / "refused").iterdir()] == ["sheet.png"]
    frames = read_image(folder / "refused" / "sheet.png")[3, 3 :: 400 + 12].tolist()
    assert frames[0] == frames[1] != frames[2]  # found, found, no board
