"""Video files of drives: independent of the number of processes, complete or absent."""

from __future__ import annotations

import multiprocessing
import re
from contextlib import closing

import imageio_ffmpeg
import numpy as np
import pytest

from lanes.camera import load_camera
from simulator.rendering.drive import Motion
from simulator.rendering.render import render_frame
from simulator.rendering.video import VIDEO_FPS, write_video
from tests.simulator.small_drive import POSE, TINY, small_drive
from tests.support.command_line import main


def test_video_and_its_truth_do_not_depend_on_the_number_of_processes(tmp_path):
    drive = small_drive(motion=Motion(60.0, 20.0), camera=TINY)
    calls = []
    for workers in (1, 2):
        video, csv_file, camera_file = write_video(
            tmp_path / f"{workers}.mp4",
            drive=drive,
            seconds=0.28,
            progress=lambda done, total: calls.append((done, total)),
            workers=workers,
        )
    assert calls == 2 * [(number, 7) for number in range(1, 8)]
    for suffix in (".mp4", ".csv", ".yaml"):
        assert (tmp_path / f"1{suffix}").read_bytes() == (tmp_path / f"2{suffix}").read_bytes()
    rows = csv_file.read_text().splitlines()[1:]
    assert [int(row.split(",")[0]) for row in rows] == list(range(7))
    assert load_camera(camera_file).pose == POSE
    with closing(imageio_ffmpeg.read_frames(str(video))) as frames:
        size = next(frames)["size"]
        pictures = [np.frombuffer(frame, np.uint8).reshape(*size[::-1], 3).astype(float) for frame in frames]
    assert len(pictures) == 7
    # Each image belongs to its own time, not to that of a neighbour.
    rendered = [render_frame(drive, number / VIDEO_FPS).image for number in range(7)]
    nearest = [np.argmin([np.abs(picture - other).mean() for other in rendered]) for picture in pictures]
    assert nearest == list(range(7))


@pytest.mark.parametrize("workers", [1, 2])
def test_interrupted_video_leaves_no_files(tmp_path, workers):
    def interrupt(done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_video(
            tmp_path / "a.mp4", drive=small_drive(camera=TINY), seconds=0.2, progress=interrupt, workers=workers
        )
    assert list(tmp_path.iterdir()) == []
    assert multiprocessing.active_children() == []


def test_message_names_an_unwritable_folder(tmp_path, capsys):
    (tmp_path / "file").write_text("in the way")
    assert main(["simulator", "--out", str(tmp_path / "file")]) == 1
    assert re.search(r"file: cannot be written .*; choose another folder", capsys.readouterr().err)
