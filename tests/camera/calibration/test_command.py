"""Table and sheet of a calibration, and the command `python -m lanes calibrate`."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from lanes.calibration import (
    BoardDetections,
    calibrate_detections,
    count_corners,
    describe_boards,
    describe_coverage,
    draw_contact_sheet,
    format_boards,
)
from lanes.camera import Camera, load_camera
from lanes.chessboard import Board
from lanes.images import read_image, write_image
from tests.support.project import ROOT

SIZE = (640, 360)
LENS = Camera(*SIZE, np.array([[580.0, 0, 322], [0, 580, 178], [0, 0, 1]]), np.array([-0.2, 0.03, 0, 0, 0]))
# Rotation about both axes (degrees) and position of the board centre (squares; the camera is 14 squares away).
POSES = {"a": (25, 0, 0, 0), "b": (-25, 10, -3, 1), "c": (5, 30, 3, -1), "d": (-10, -30, 0, 1), "e": (20, 20, -2, -1.5)}
PATTERN = (9, 6)


def pose(name: str) -> tuple[np.ndarray, np.ndarray]:
    across, along, x, y = POSES[name]
    turn = cv2.Rodrigues(np.radians([across, 0.0, 0]))[0] @ cv2.Rodrigues(np.radians([0.0, along, 0]))[0]
    return cv2.Rodrigues(turn)[0], np.array([x, y, 14.0]) - turn @ [4, 2.5, 0]


def seen_board(name: str, *, noise_px: float = 0.1) -> Board:
    grid = Board(np.empty((54, 2), np.float32), *PATTERN, SIZE).object_points
    corners, _ = cv2.projectPoints(grid, *pose(name), LENS.matrix, LENS.distortion)
    noise = np.random.default_rng(len(name) + ord(name[0])).normal(0, noise_px, (54, 2))
    return Board((corners.reshape(-1, 2) + noise).astype(np.float32), *PATTERN, SIZE)


def draw(name: str, *, width: int = SIZE[0]) -> np.ndarray:
    """A chessboard of 10 x 7 squares as the lens shows it."""
    scale = 4
    image = np.full((SIZE[1] * scale, SIZE[0] * scale, 3), 200, np.uint8)
    for row, column in np.ndindex(9, 12):
        corners = np.array([[column, row], [column + 1, row], [column + 1, row + 1], [column, row + 1]], float)
        edge = np.vstack([np.linspace(a, b, 8) for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)])
        inside = 0 < row < 8 and 0 < column < 11
        points = np.column_stack([edge - 2, np.zeros(len(edge))])
        pixels, _ = cv2.projectPoints(points, *pose(name), LENS.matrix, LENS.distortion)
        colour = (30,) * 3 if inside and (row + column) % 2 else (240,) * 3
        cv2.fillPoly(image, [np.round(((pixels + 0.5) * scale - 0.5) * 16).astype(np.int32)], colour, cv2.LINE_AA, 4)
    small = cv2.resize(image, (width, width * SIZE[1] // SIZE[0]), interpolation=cv2.INTER_AREA)
    return cv2.GaussianBlur(small, (0, 0), 0.6)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("boards")
    for name in POSES:
        write_image(folder / f"{name}.png", draw(name))
    write_image(folder / "wall.png", np.full((360, 640, 3), 128, np.uint8))
    write_image(folder / "square.png", draw("a")[:, 100:460])
    (folder / "broken.jpg").write_bytes(b"\xff\xd8 cut off")
    return folder


def run(*arguments: object, cwd: Path) -> subprocess.CompletedProcess:
    command = [sys.executable, "-m", "lanes", "calibrate", *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, env={"PYTHONPATH": str(ROOT)}, capture_output=True, text=True, timeout=60)


def test_folder_gives_camera_file_table_and_sheet(folder):
    done = run(".", "--sheet", "out/sheet.png", "-o", "out/lens.yaml", cwd=folder)
    assert done.returncode == 0, done.stderr
    camera = load_camera(folder / "out" / "lens.yaml")
    assert camera.matrix[0, 0] == pytest.approx(580, rel=0.01)
    table = {line.split()[0]: line for line in done.stdout.splitlines() if line}
    assert table["a.png"].endswith("  used")
    assert table["wall.png"].endswith("-  no chessboard of 9x6 inner corners, nor a part of one")
    assert "another aspect ratio, so another camera or a cropped picture" in table["square.png"]
    assert "broken.jpg: cannot be decoded as a picture, it is cut off or damaged" in table["broken.jpg"]
    assert "5 of 8 pictures used, error 0." in done.stdout
    assert "corners in the " in done.stdout and done.stdout.endswith("wrote out/lens.yaml\nwrote out/sheet.png\n")
    # Eight pictures and the map of the corners, five per row.
    assert read_image(folder / "out" / "sheet.png").shape == (2 * (225 + 44 + 12), 5 * (400 + 12), 3)


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (["none"], 2, "none: there is no such picture file"),
        (["a.png", "b.png"], 2, "calibration needs at least 3, better 15; take more pictures"),
        (["wall.png", "--pattern", "7x5"], 2, "no chessboard of 7x5 inner corners was found in any of the 1 pictures"),
        (["a.png", "--pattern", "9by6"], 2, "9by6 is not a chessboard pattern; write its inner corners like 9x6"),
        (["a.png", "--pattern", "2x6"], 2, "2x6 is not a chessboard pattern"),
        ([], 2, "the following arguments are required: PICTURE"),
        (["a.png", "b.png", "c.png", "d.png", "-o", "a.png/camera.yaml"], 1, "camera.yaml: cannot be written"),
    ],
)
def test_misuse_gives_a_message(folder, arguments, status, words):
    done = run(*arguments, cwd=folder)
    assert done.returncode == status
    assert words in done.stderr
    assert "Traceback" not in done.stderr


def detections_of(boards: dict[str, Board], **unused: str) -> BoardDetections:
    return BoardDetections({name: Path(f"{name}.png") for name in [*boards, *unused]}, PATTERN, boards, unused)


def test_use_of_each_board_is_described(monkeypatch):
    boards = {name: seen_board(name) for name in POSES}
    # Cut off by the left picture border: only columns 3 to 8 are visible.
    monkeypatch.setitem(POSES, "f", (10, 10, -6, 0))
    boards["f"] = Board(seen_board("f").corners_px.reshape(6, 9, 2)[:, 3:].reshape(-1, 2), 6, 6, SIZE)
    boards["a"] = Board(boards["a"].corners_px.reshape(6, 9, 2)[:5].reshape(-1, 2), 9, 5, SIZE)
    boards["e"] = Board(boards["e"].corners_px * 2 + 0.5, 9, 6, (1280, 720))
    moved = boards["d"].corners_px.copy()
    moved[::7] += 6
    boards["d"] = Board(moved, *PATTERN, SIZE)
    boards |= {f"{name}2": seen_board(name, noise_px=0.12) for name in "abce"}
    detections = detections_of(boards, wall="no chessboard")
    camera = calibrate_detections(detections, "here")
    uses = describe_boards(detections, camera)
    assert uses["f"] == "cut by the edge, 6x6 corners of it used"
    assert uses["a"] == "partly hidden, 9x5 corners of it used"
    assert uses["c"] == "used"
    assert uses["d"].startswith("error ")
    assert uses["e"] == "used, picture of 1280x720"
    assert uses["wall"] == "no chessboard"
    rows = format_boards(detections, camera).splitlines()
    assert len(rows) == 1 + len(detections.paths)
    assert f"{camera.report.board_rms_px['c']:.2f}  used" in rows[3]


def test_parts_of_the_picture_without_corners_are_named():
    u, v = np.meshgrid(np.linspace(0, 639, 40), np.linspace(0, 359, 30))
    everywhere = np.column_stack([u.ravel(), v.ravel()]).astype(np.float32)
    assert (
        describe_coverage({"x": Board(everywhere, 40, 30, SIZE)})
        == "corners were detected in all regions of the picture"
    )
    upper_left = (everywhere[:, 0] < 160) & (everywhere[:, 1] < 90)
    right = everywhere[:, 0] > 480
    few = np.flatnonzero(right & (everywhere[:, 1] > 270))[:5]
    kept = np.concatenate([everywhere[~upper_left & ~right], everywhere[few]])
    board = Board(kept, len(kept), 1, SIZE)
    assert count_corners({"x": board})[2, 2] == 5
    assert describe_coverage({"x": board}) == (
        "no corners in the upper left, upper right and right and few corners in the lower right: add boards there"
    )


def test_sheet_marks_used_and_unused_boards(tmp_path):
    boards = {name: seen_board(name) for name in POSES}
    for name in [*POSES, "wall"]:
        write_image(tmp_path / f"{name}.png", np.full((360, 640, 3), 128, np.uint8))
    detections = detections_of(boards, wall="no chessboard")
    detections = BoardDetections(
        {n: tmp_path / p for n, p in detections.paths.items()}, PATTERN, boards, detections.unused
    )
    sheet = draw_contact_sheet(detections, calibrate_detections(detections, "here"))
    # Green frames for the five boards used, a red one for the wall; the corners lie within their tiles.
    tile = (225 + 44 + 12, 400 + 12)
    assert (sheet[3, 3] == (0, 220, 90)).all()
    assert (sheet[tile[0] + 3, 3] == (255, 70, 60)).all()
    first = sheet[6 + 44 : 6 + 44 + 225, 6:406].astype(int)
    coloured = np.ptp(first, axis=2) > 60
    v, u = np.nonzero(coloured)
    corners = boards["a"].corners_px * 400 / 640
    assert u.min() == pytest.approx(corners[:, 0].min(), abs=6) and u.max() == pytest.approx(corners[:, 0].max(), abs=6)
    assert v.min() == pytest.approx(corners[:, 1].min(), abs=6) and v.max() == pytest.approx(corners[:, 1].max(), abs=6)
