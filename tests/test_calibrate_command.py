"""The command `python -m lanes calibrate`: its table, sheet and messages."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from lanes.camera import load_camera
from lanes.images import read_image, write_image
from simulator.scenes.freeway import DASHCAM
from tests.support.project import ROOT


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Five boards, a wall, a board of another shape, and a damaged file."""
    folder = tmp_path_factory.mktemp("boards")
    for name, number in zip("abcde", (2, 9, 12, 13, 6), strict=True):
        board = read_image(ROOT / "camera_cal" / f"calibration{number}.jpg")
        write_image(folder / f"{name}.png", board)
    write_image(folder / "wall.png", np.full((360, 640, 3), 128, np.uint8))
    write_image(folder / "square.png", cv2.resize(board, (640, 480)))
    (folder / "broken.jpg").write_bytes(b"\xff\xd8 cut off")
    return folder


@pytest.fixture(autouse=True)
def in_the_folder(folder, monkeypatch) -> None:
    monkeypatch.chdir(folder)


def test_folder_gives_camera_file_table_and_sheet(folder, run):
    status, out, err = run("calibrate", ".", "--sheet", "out/sheet.png", "-o", "out/lens.yaml")
    assert status == 0, err
    camera = load_camera(folder / "out" / "lens.yaml")
    assert camera.matrix[0, 0] == pytest.approx(DASHCAM.matrix[0, 0], rel=0.01)
    table = {line.split()[0]: line for line in out.splitlines() if line}
    assert table["a.png"].endswith("  used")
    assert table["wall.png"].endswith("-  no chessboard of 9x6 inner corners, nor a part of one")
    assert "pixels, the others 1280x720; take all with one setting" in table["square.png"]
    assert "broken.jpg: cannot be decoded as an image" in table["broken.jpg"]
    assert "5 of 8 images used, error 0." in out
    assert "no corners in these regions" in out
    assert out.endswith("wrote out/lens.yaml\nwrote out/sheet.png\n")
    assert read_image(folder / "out" / "sheet.png").shape == (2 * (225 + 44 + 12), 5 * (400 + 12), 3)


def test_the_sheet_is_written_when_the_calibration_is_refused(folder, run):
    status, out, err = run(
        "calibrate", "a.png", "b.png", "wall.png", "--sheet", "refused/sheet.png", "-o", "refused/lens.yaml"
    )
    assert (status, out) == (2, "wrote refused/sheet.png\n") and "at least 3, better 15" in err
    assert [path.name for path in (folder / "refused").iterdir()] == ["sheet.png"]
    frames = read_image(folder / "refused" / "sheet.png")[3, 3 :: 400 + 12].tolist()
    assert frames[0] == frames[1] != frames[2]  # found, found, no board
