"""The command `python -m lanes explain`: success and misuse."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from lanes.camera import save_camera
from lanes.images import read_image, write_image
from tests.support.painted_roads import YELLOW, Road, dashcam
from tests.support.project import ROOT

CAMERA = dashcam(width=640)


def run(*arguments: object, cwd: Path) -> subprocess.CompletedProcess:
    command = [sys.executable, "-m", "lanes", "explain", *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, env={"PYTHONPATH": str(ROOT)}, capture_output=True, text=True, timeout=60)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("explain")
    save_camera(CAMERA, folder / "camera.yaml")
    road = Road(CAMERA).line(lambda x: 2.0 + 0 * x, colour=YELLOW).line(lambda x: -1.6 + 0 * x)
    write_image(folder / "road.jpg", road.image())
    write_image(folder / "grey.png", np.full((CAMERA.height, CAMERA.width, 3), 90, np.uint8))
    return folder


def test_picture_gives_a_figure(folder):
    done = run("road.jpg", "--camera", "camera.yaml", "-o", "new/explained.png", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "offset     0.2" in done.stdout
    assert "failed at" not in done.stdout
    assert done.stdout.endswith("wrote new/explained.png\n")
    assert read_image(folder / "new" / "explained.png").shape[1] > 1200


def test_camera_file_of_another_size(folder):
    """As of `annotate`: the picture was only resized."""
    write_image(folder / "half.png", cv2.resize(read_image(folder / "road.jpg"), (320, 180)))
    done = run("half.png", "--camera", "camera.yaml", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "offset     0.2" in done.stdout


def test_picture_without_pose_and_without_lines_names_the_failed_step(folder):
    done = run("grey.png", "--hfov", 60, cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "failed at  pose: grey.png: only 0 of 1 pictures show two or more parallel lane lines" in done.stdout
    assert "what to do Estimate the camera pose again" in done.stdout
    assert (folder / "explained.png").is_file()


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (["road.jpg", "--camera", "none.yaml"], 2, "none.yaml: there is no such camera file"),
        (["none.jpg", "--hfov", 60], 2, "none.jpg: there is no such picture file"),
        (["road.jpg", "--hfov", 60, "--at", 2], 2, "road.jpg: is a single picture, which has no frame at 2 s"),
        (["road.jpg", "--hfov", 60, "--at", "soon"], 2, "soon does not do; give a number, 0 or more"),
        (["camera.yaml", "--hfov", 60, "--at", 2], 2, "camera.yaml: cannot be read as a video"),
        (["road.jpg", "grey.png", "--hfov", 60], 2, "unrecognized arguments: grey.png"),
        (["road.jpg", "--camera", "camera.yaml", "-o", "out.gif"], 2, "out.gif: cannot write this kind of figure"),
        (["road.jpg", "--camera", "camera.yaml", "-o", "road.jpg/out.png"], 1, "out.png: cannot be written"),
    ],
)
def test_misuse_gives_a_message(folder, arguments, status, words):
    done = run(*arguments, cwd=folder)
    assert done.returncode == status
    assert words in done.stderr
    assert "Traceback" not in done.stderr
