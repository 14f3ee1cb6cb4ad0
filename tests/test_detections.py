"""The command `python -m lanes detect`: TuSimple JSON lines of stills, sequences and
videos.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import ExifTags, Image

from lanes.camera.model import Camera, CameraPose, save_camera
from lanes.labels import usual_rows
from lanes.video.images import write_image
from tests.support.clips import write_clip
from tests.support.painted_drive import BENDS, CAMERA, SMALL
from tests.support.painted_roads import paint_motorway

DRIVE = replace(BENDS, motion=replace(BENDS.motion, wander_m=0.2))
ROWS = range(230, 351, 10)
BLACK = np.zeros((360, 640, 3), np.uint8)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("drive")
    for number in range(4):
        write_image(folder / f"frame{number}.png", DRIVE.frame(number / 25))
    write_image(folder / "black.png", BLACK)
    save_camera(SMALL, folder / "camera.yaml")
    save_camera(CAMERA, folder / "large.yaml")
    return folder


@pytest.fixture
def detect(tmp_path, run):
    """A function that runs the command; returns its status, the detections, and what it
    printed.
    """

    def detect(
        *arguments: object, rows: Sequence[str] = ("--rows", "230:351:10")
    ) -> tuple[int, list[dict], str, str]:
        output = tmp_path / "lanes.jsonl"
        status, out, err = run("detect", *arguments, *rows, "-o", output)
        return (
            status,
            [json.loads(line) for line in output.read_text().splitlines()],
            out,
            err,
        )

    return detect


def require_true_columns(detection: dict, frame: int, tolerance_px: float = 3) -> None:
    truth = DRIVE.truth(frame / 25)
    x = np.geomspace(2, 100, 400)
    for side, columns in enumerate(detection["lanes"][:2]):
        u, v = SMALL.road_to_pixels(np.column_stack([x, truth.line_y(side, x)])).T
        true = np.interp(ROWS, v[::-1], u[::-1])
        inside = (true > 5) & (true < 635)
        assert np.abs(np.array(columns) - true)[inside].max() < tolerance_px


@pytest.mark.parametrize("sequence", [False, True])
def test_stills_are_independent_or_a_sequence(folder, detect, sequence):
    frames = [folder / f"frame{n}.png" for n in range(4)]
    options = ["--sequence"] if sequence else []
    status, found, out, _ = detect(
        "--camera", folder / "camera.yaml", *frames, *options
    )
    assert status == 0
    assert "4 pictures, no lane in 0" in out
    assert [row["raw_file"] for row in found] == [str(frame) for frame in frames]
    for number, row in enumerate(found):
        assert row["h_samples"] == list(ROWS)
        assert 1 < row["run_time"] < 10_000  # milliseconds
        require_true_columns(row, number)
        truth = DRIVE.truth(number / 25)
        assert row["offset_m"] == pytest.approx(truth.offset_m, abs=0.05)
        assert row["curvature_per_m"] == pytest.approx(truth.curvature_per_m, abs=5e-4)
    states = [row["state"] for row in found]
    assert states == (["tracking"] * 4 if sequence else ["found"] * 4)
    assert (
        sequence
        or found[0]["sides"] == ["left", "right", "far right"]
        and max(found[0]["lanes"][2]) > 500
    )


def test_videos_are_tracked_frame_by_frame(folder, detect, tmp_path):
    """By default at the rows of their height. A file that is named twice
    counts once.
    """
    video = write_clip(tmp_path / "drive.mp4", map(DRIVE.frame, np.arange(10) / 25))
    part = "--start", 0.2, "--end", 0.3
    status, found, out, _ = detect(
        "--camera",
        folder / "camera.yaml",
        video,
        video,
        folder / "frame0.png",
        *part,
        rows=(),
    )
    assert status == 0
    assert "4 pictures" in out
    assert "missing" not in out
    assert [row["raw_file"] for row in found] == [f"{video}#{n}" for n in (5, 6, 7)] + [
        str(folder / "frame0.png")
    ]
    assert [row.get("frame") for row in found] == [5, 6, 7, None]
    assert [row["state"] for row in found[2:]] == ["tracking", "found"]
    assert found[2]["offset_m"] == pytest.approx(DRIVE.truth(0.28).offset_m, abs=0.05)
    assert found[0]["h_samples"] == list(range(210, 355, 5))
    assert min(found[2]["lanes"][0]) > 0
    assert list(usual_rows(720)) == list(range(420, 701, 10))
    assert max(usual_rows(540)) < 540


def test_the_time_between_the_frames_of_a_sequence_is_that_of_its_rate(
    folder, detect, tmp_path
):
    """After eight frames of the lane it is black.

    The tracker coasts for one second, however many frames that are.
    """
    images = [DRIVE.frame(number / 25) for number in range(8)] + [BLACK] * 3
    stills = [
        write_image(tmp_path / f"{number}.png", image)
        for number, image in enumerate(images)
    ]
    for fps, last in ((25, "coasting"), (2, "lost")):
        _, found, *_ = detect(
            "--camera", folder / "camera.yaml", "--sequence", "--fps", fps, *stills
        )
        assert [row["state"] for row in found[-4::3]] == ["tracking", last], fps


def test_a_rescaled_camera_a_still_without_a_lane_and_an_unusable_one(
    folder, detect, tmp_path
):
    cut = tmp_path / "cut.png"
    cut.write_bytes((folder / "frame0.png").read_bytes()[:2000])
    stills = [folder / "frame0.png", folder / "black.png", cut]
    status, (first, black), _, err = detect("--camera", folder / "large.yaml", *stills)
    assert status == 1
    assert re.search(r"error: .*cut\.png: cannot be decoded", err)
    require_true_columns(first, 0)
    assert (black["state"], black["confidence"], black["offset_m"]) == (
        "lost",
        0.0,
        None,
    )
    assert black["lanes"] == [[-2.0] * len(ROWS)] * 2
    assert black["sides"] == ["left", "right"]


def test_stills_of_different_cameras_have_a_pose_each(folder, detect, tmp_path):
    camera = Camera.from_fov((960, 540), 62.6, CameraPose(1.3, np.radians(3.0)))
    other = tmp_path / "other.jpg"
    exif = Image.Exif()
    exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.FocalLengthIn35mmFilm.value] = 31
    Image.fromarray(paint_motorway(camera)).save(other, exif=exif)
    files = [folder / "frame0.png", other, folder / "black.png"]
    status, found, out, err = detect("--each", *files)
    assert status == 0, err
    assert re.search(r"frame0.png: pose: .*\n.*other.jpg: .*pitch 3.0\d ±", out)
    assert "field of view 60.0 deg, assumed" in out
    assert "warning: field of view 60.0 deg" in err
    # A still without a road is not refused: no lane is found in it.
    assert "black.png: pose: height 1.35 ± 0.34 m (assumed)" in out
    states = ("found", "found", "lost")
    assert [(row["raw_file"], row["state"]) for row in found] == list(
        zip(map(str, files), states, strict=True)
    )
    # The true field of view of the first camera is not the assumed one, which hardly
    # matters in the picture.
    require_true_columns(found[0], 0, tolerance_px=4)
    # No warning if every still names its field of view.
    status, _, out, err = detect("--each", other)
    assert status == 0
    assert "warning" not in err
    assert "field of view 62.6 deg, as other.jpg says (EXIF)" in out
