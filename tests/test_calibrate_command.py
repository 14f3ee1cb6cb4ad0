"""The command `python -m lanes calibrate`: its table, sheet and messages."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from lanes.camera import Camera, load_camera
from lanes.images import read_image, write_image
from tests.support.command_line import main

SIZE = (640, 360)
LENS = Camera(*SIZE, np.array([[580.0, 0, 322], [0, 580, 178], [0, 0, 1]]), np.array([-0.2, 0.03, 0, 0, 0]))
# Rotation about both axes (degrees) and position of the board centre (squares; the camera is 14 squares away).
POSES = {"a": (25, 0, 0, 0), "b": (-25, 10, -3, 1), "c": (5, 30, 3, -1), "d": (-10, -30, 0, 1), "e": (20, 20, -2, -1.5)}
PATTERN = (9, 6)


def pose(name: str) -> tuple[np.ndarray, np.ndarray]:
    across, along, x, y = POSES[name]
    turn = cv2.Rodrigues(np.radians([across, 0.0, 0]))[0] @ cv2.Rodrigues(np.radians([0.0, along, 0]))[0]
    return cv2.Rodrigues(turn)[0], np.array([x, y, 14.0]) - turn @ [4, 2.5, 0]


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


@pytest.fixture
def run(folder, monkeypatch, capsys):
    """A function that runs the command in the folder; returns its status, stdout and stderr."""
    monkeypatch.chdir(folder)
    return lambda *arguments: (main(["calibrate", *arguments]), *capsys.readouterr())


def test_folder_gives_camera_file_table_and_sheet(folder, run):
    status, out, err = run(".", "--sheet", "out/sheet.png", "-o", "out/lens.yaml")
    assert status == 0, err
    camera = load_camera(folder / "out" / "lens.yaml")
    assert camera.matrix[0, 0] == pytest.approx(580, rel=0.01)
    table = {line.split()[0]: line for line in out.splitlines() if line}
    assert table["a.png"].endswith("  used")
    assert table["wall.png"].endswith("-  no chessboard of 9x6 inner corners, nor a part of one")
    assert "another aspect ratio, so another camera or a cropped picture" in table["square.png"]
    assert "broken.jpg: cannot be decoded as a picture, it is cut off or damaged" in table["broken.jpg"]
    assert "5 of 8 pictures used, error 0." in out
    assert "no corners in these regions" in out
    assert out.endswith("wrote out/lens.yaml\nwrote out/sheet.png\n")
    assert read_image(folder / "out" / "sheet.png").shape == (2 * (225 + 44 + 12), 5 * (400 + 12), 3)


def test_misuse_gives_a_message(run):
    """See also the table in tests/test_cli.py."""
    status, _, err = run("a.png", "b.png", "-o", "no.yaml")
    assert status == 2 and "calibration needs at least 3, better 15; take more pictures" in err
    status, _, err = run("a.png", "b.png", "c.png", "d.png", "-o", "a.png/camera.yaml")
    assert status == 1 and "camera.yaml: cannot be written" in err
