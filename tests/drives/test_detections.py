"""The command `python -m lanes detect`, and the detections."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import ExifTags, Image

from lanes.camera import Camera, CameraPose, save_camera
from lanes.detections import count_missing_frames, detect_files
from lanes.errors import CameraError
from lanes.images import write_image
from simulator.rendering.drive import Motion
from tests.support.clips import write_clip
from tests.support.painted_drive import CAMERA, PaintedDrive, lane_lines, s_bend
from tests.support.painted_roads import paint_motorway
from tests.support.project import ROOT

SMALL = CAMERA.scaled((640, 360))
DRIVE = PaintedDrive(s_bend(), lane_lines(), motion=Motion(60.0, 25.0, offset_m=0.3, wander_m=0.2), camera=SMALL)
ROWS = range(230, 351, 10)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("drive")
    for frame in range(4):
        write_image(folder / f"frame{frame}.png", DRIVE.frame(frame / 25))
    write_image(folder / "black.png", np.zeros((360, 640, 3), np.uint8))
    save_camera(SMALL, folder / "camera.yaml")
    save_camera(SMALL.with_pose(None), folder / "lens.yaml")
    return folder


def run(*arguments: object) -> subprocess.CompletedProcess:
    command = [sys.executable, "-m", "lanes", "detect", *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120)


def true_columns(frame: int) -> np.ndarray:
    truth = DRIVE.truth(frame / 25)
    x = np.geomspace(2, 100, 400)
    columns = []
    for side in (0, 1):
        u, v = SMALL.road_to_pixels(np.column_stack([x, truth.line_y(side, x)])).T
        columns.append(np.interp(ROWS, v[::-1], u[::-1]))
    return np.array(columns)


@pytest.mark.parametrize("sequence", [False, True])
def test_command_writes_detections(folder, tmp_path, sequence):
    frames = [folder / f"frame{n}.png" for n in range(4)]
    output = tmp_path / "lanes.jsonl"
    rows = f"{ROWS.start}:{ROWS.stop}:{ROWS.step}"
    options = ["--sequence"] if sequence else []
    done = run("--camera", folder / "camera.yaml", *frames, "--rows", rows, "-o", output, *options)
    assert done.returncode == 0, done.stderr
    assert "4 pictures, no lane in 0" in done.stdout
    found = [json.loads(line) for line in output.read_text().splitlines()]
    assert [row["raw_file"] for row in found] == [str(frame) for frame in frames]
    for n, row in enumerate(found):
        assert row["h_samples"] == list(ROWS)
        columns, true = np.array(row["lanes"]), true_columns(n)
        inside = (true > 5) & (true < 635)
        assert np.abs(columns - true)[inside].max() < 3
        assert row["run_time"] > 0
        assert row["offset_m"] == pytest.approx(DRIVE.truth(n / 25).offset_m, abs=0.05)
        assert row["curvature_per_m"] == pytest.approx(DRIVE.truth(n / 25).curvature_per_m, abs=5e-4)
    states = [row["state"] for row in found]
    assert states == (["searching", "searching", "tracking", "tracking"] if sequence else ["found"] * 4)


def test_videos_are_tracked_frame_by_frame(tmp_path):
    video = write_clip(tmp_path / "drive.mp4", [DRIVE.frame(frame / 25) for frame in range(6)])
    progress: list[tuple[int, int]] = []
    found = detect_files([video], SMALL, np.array(ROWS), progress=lambda *done: progress.append(done))
    assert [row["raw_file"] for row in found] == [f"{video}#{frame}" for frame in range(6)]
    assert [row["frame"] for row in found] == list(range(6))
    assert found[-1]["state"] == "tracking"
    assert found[-1]["offset_m"] == pytest.approx(DRIVE.truth(0.2).offset_m, abs=0.05)
    assert progress == [(done, 6) for done in range(1, 7)]
    twice = detect_files([video, video], SMALL, np.array(ROWS))
    assert len(twice) == 6 and count_missing_frames(twice) == 0


def test_picture_without_a_lane(folder):
    (row,) = detect_files([folder / "black.png"], SMALL, np.array(ROWS))
    assert (row["state"], row["confidence"], row["offset_m"]) == ("lost", 0.0, None)
    assert row["lanes"] == [[-2.0] * len(ROWS)] * 2
    json.dumps(row)


def test_camera_is_rescaled_to_pictures_of_the_same_aspect_ratio(folder):
    (row,) = detect_files([folder / "frame0.png"], CAMERA, np.array(ROWS))
    columns, true = np.array(row["lanes"]), true_columns(0)
    inside = (true > 5) & (true < 635)
    assert np.abs(columns - true)[inside].max() < 3
    with pytest.raises(CameraError, match=r"frame0\.png: .*cropped"):
        detect_files([folder / "frame0.png"], CAMERA.scaled((1280, 720)).from_fov((640, 480), 60, CAMERA.pose), ROWS)


def test_stills_of_different_cameras_have_a_pose_each(folder, tmp_path):
    camera = Camera.from_fov((960, 540), 60, CameraPose(1.3, np.radians(3.0)))
    other = write_image(tmp_path / "other.png", paint_motorway(camera))
    files = [folder / "frame0.png", other, folder / "black.png"]
    done = run("--each", *files, "--rows", "230:351:10", "-o", tmp_path / "lanes.jsonl")
    assert done.returncode == 1, done.stderr
    assert re.search(r"frame0.png: pose from lane lines: .*\n.*other.png: .*pitch 3.0\d ±", done.stdout)
    assert "field of view 60.0 deg, assumed" in done.stdout and "warning: field of view 60.0 deg" in done.stderr
    assert re.search(r"error: .*black.png: .*so no road is recognised", done.stderr)
    found = [json.loads(line) for line in (tmp_path / "lanes.jsonl").read_text().splitlines()]
    assert [(row["raw_file"], row["state"]) for row in found] == [(str(file), "found") for file in files[:2]]
    # The true field of view of the first camera is not the assumed one, which hardly matters in the picture.
    columns, true = np.array(found[0]["lanes"]), true_columns(0)
    inside = (true > 5) & (true < 635)
    assert np.abs(columns - true)[inside].max() < 4


def test_the_field_of_view_of_each_still_is_that_of_its_exif_entries(tmp_path):
    camera = Camera.from_fov((960, 540), 62.6, CameraPose(1.3, np.radians(3.0)))
    exif = Image.Exif()
    exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.FocalLengthIn35mmFilm.value] = 31
    Image.fromarray(paint_motorway(camera)).save(tmp_path / "still.jpg", exif=exif)
    done = run("--each", tmp_path / "still.jpg", "--rows", "300:541:10", "-o", tmp_path / "lanes.jsonl")
    assert done.returncode == 0 and "warning" not in done.stderr, done.stderr
    assert "field of view 62.6 deg, as still.jpg says (EXIF)" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (["missing.png", "--camera", "camera.yaml"], 2, "missing.png"),
        (["frame0.png", "--camera", "nowhere.yaml"], 2, "nowhere.yaml"),
        (["frame0.png", "--camera", "camera.yaml", "--rows", "700"], 2, "700 contains no rows"),
        (["frame0.png", "--camera", "camera.yaml", "--rows", "a:b"], 2, "a:b is not a row range"),
        (["black.png", "--camera", "lens.yaml"], 1, "parallel lane lines"),
        (["black.png", "--hfov", "5"], 2, "give a number, 10 to 150"),
        (["black.png", "--each"], 1, "no road is recognised"),
        (["frame0.png", "--each", "--sequence"], 2, "omit --each"),
    ],
)
def test_misuse_gives_a_message_and_writes_nothing(folder, tmp_path, arguments, status, words):
    files = [folder / a if a.endswith((".png", ".yaml")) else a for a in arguments]
    output = tmp_path / "lanes.jsonl"
    done = run(*files, "-o", output)
    assert done.returncode == status
    assert words in done.stderr
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []
