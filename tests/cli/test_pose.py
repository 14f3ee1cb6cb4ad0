"""The command `python -m lanes pose`."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from lanes.camera import Camera, CameraPose, load_camera, save_camera
from lanes.images import write_image
from lanes.sources import sample_images
from lanes.video.writer import VideoWriter
from tests.support.command_line import main
from tests.support.painted_roads import paint_motorway

POSE = CameraPose(1.3, np.radians(3.0), np.radians(1.5), np.radians(-0.6))
CAMERA = Camera.from_fov((960, 540), 66, POSE)


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """Two stills and a video of six frames, 2 a second."""
    folder = tmp_path_factory.mktemp("drive")
    for i in range(2):
        write_image(folder / f"still{i}.jpg", paint_motorway(CAMERA, offset_m=0.3 * i, phase_m=5 * i, seed=i))
    with VideoWriter(folder / "drive.mp4", fps=2) as video:
        for i in range(6):
            video.write(paint_motorway(CAMERA, offset_m=0.1 * i, phase_m=3 * i, seed=i), i / 2)
    return folder


def run(*arguments: object) -> int:
    return main(["pose", *map(str, arguments)])


def test_stills_with_a_calibrated_lens(drive, tmp_path, capsys):
    lens = save_camera(Camera(960, 540, CAMERA.matrix, CAMERA.distortion), tmp_path / "lens.yaml")
    assert run("--camera", lens, drive / "still0.jpg", drive / "still1.jpg", "-o", tmp_path / "camera.yaml") == 0
    found = load_camera(tmp_path / "camera.yaml")
    np.testing.assert_array_equal(found.matrix, CAMERA.matrix)
    assert np.degrees(found.pose.pitch_rad) == pytest.approx(3.0, abs=0.2)
    assert np.degrees(found.pose.yaw_rad) == pytest.approx(1.5, abs=0.4)
    assert found.pose.height_m == pytest.approx(1.3, abs=0.05)
    printed = capsys.readouterr().out
    assert "from 2 of 2 pictures" in printed and "looks left" in printed and "camera.yaml" in printed
    assert re.search(r"offset and lane width to be good to 3 cm and [34]% .*curvature twice as much", printed)


def test_video_with_a_field_of_view_alone(drive, tmp_path, capsys):
    assert not run("--hfov", 66, "--pictures", 3, "--height", 1.4, drive / "drive.mp4", "-o", tmp_path / "camera.yaml")
    found = load_camera(tmp_path / "camera.yaml")
    assert found.size == (960, 540)
    assert np.degrees(found.pose.pitch_rad) == pytest.approx(3.0, abs=0.2)
    assert found.pose.height_m == 1.4
    assert "from 3 of 3 pictures" in capsys.readouterr().out


def test_part_of_a_video_and_a_measured_height(drive, tmp_path, capsys):
    bent = replace(CAMERA, pose=None, distortion=np.array([-0.01, 0, 0, 0, 0]))
    lens = save_camera(bent, tmp_path / "lens.yaml")
    piece = ["--start", 1, "--end", 2.5, "--height", 1.3]
    assert run("--camera", lens, *piece, drive / "drive.mp4", "-o", tmp_path / "camera.yaml") == 0
    printed = capsys.readouterr().out
    assert "from 3 of 3 pictures" in printed
    assert "offset and lane width to be good to 1 cm, distances and curvature likewise" in printed
    pictures = list(sample_images([drive / "drive.mp4"], 40, start_s=1.0, end_s=2.5))
    for got, expected in zip(pictures, list(sample_images([drive / "drive.mp4"], 40))[2:5], strict=True):
        np.testing.assert_array_equal(got, expected)
    assert run("--camera", lens, "--start", 3, drive / "drive.mp4") == 2
    assert "drive.mp4: lasts 3 s; begin before that" in capsys.readouterr().err
    assert run("--camera", lens, "--start", 3, "--end", 2, drive / "drive.mp4") == 2
    assert "--end 2 is not after --start 3" in capsys.readouterr().err


def test_pictures_are_spread_over_stills_and_video(drive):
    files = [drive / "still0.jpg", drive / "drive.mp4", drive / "still1.jpg"]
    pictures = list(sample_images(files, 40))
    assert len(pictures) == 8
    # Four samples of the video are 0.75 s apart. At 0.75 s and 1.5 s it shows its third and fourth frame.
    few = list(sample_images(files, 4))
    assert len(few) == 4
    for got, expected in zip(few, (0, 3, 4, 7), strict=True):
        np.testing.assert_array_equal(got, pictures[expected])


def test_misuse_gives_a_message(drive, tmp_path, capsys):
    assert run("--hfov", 60, tmp_path / "nowhere.jpg") == 2
    assert "there is no such picture file" in capsys.readouterr().err
    sky = write_image(tmp_path / "sky.png", np.full((540, 960, 3), 200, np.uint8))
    assert run("--hfov", 60, sky, "-o", tmp_path / "camera.yaml") == 1
    assert "only 0 of 1 pictures" in capsys.readouterr().err
    assert not (tmp_path / "camera.yaml").exists()
    assert run("--hfov", 60, "--size", "1280x720", sky) == 2
    assert "sky.png: is 960x540 pixels" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        run("--hfov", 60, "--size", "big", sky)
    assert "write it like 1280x720" in capsys.readouterr().err
