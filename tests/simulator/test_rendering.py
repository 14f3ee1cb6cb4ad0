"""Rendered frames and videos: determinism, bridge shadows, order of the processes; files are complete or absent."""

from __future__ import annotations

import multiprocessing

import numpy as np
import pytest

from benchmark.evaluation import PROJECT_ROOT
from lanes.camera import load_camera
from lanes.files import read_telemetry
from lanes.images import read_image
from lanes.video.reader import read_video
from simulator.light.lens import AutoExposure
from simulator.light.sunlight import BridgeShade
from simulator.rendering.drive import Motion
from simulator.rendering.render import VIDEO_FPS, render_frame, write_video
from simulator.road.truth import truth_row
from simulator.scenes.stills import still_scenes
from tests.simulator.small_drive import POSE, TINY, small_drive


def test_committed_still_is_rendered_again():
    road = np.s_[470:660, 250:1050]
    committed = read_image(PROJECT_ROOT / "test_images" / "test2.jpg")[road].astype(int)
    again = render_frame(still_scenes()["test2"]).image[road].astype(int)
    # JPEG at quality 92 changes texture by a few levels, another scene by dozens.
    assert np.abs(committed - again).mean() < 2.5 and np.ptp(again) > 100


def test_video_and_its_truth_do_not_depend_on_the_number_of_processes(tmp_path):
    shade = BridgeShade(66.0, 76.0)
    drive = small_drive(
        motion=Motion(60.0, 20.0),
        camera=TINY,
        shades=(shade,),
        exposure=AutoExposure(0.5, 0.8),
    )
    calls = []
    for workers in (1, 2):
        options = {
            "seconds": 0.28,
            "workers": workers,
            "progress": lambda *done: calls.append(done),
        }
        video, csv_file, camera_file = write_video(
            tmp_path / f"{workers}.mp4", drive=drive, **options
        )
    assert calls == 2 * [(number, 7) for number in range(1, 8)]
    for suffix in (".mp4", ".csv", ".yaml"):
        assert (tmp_path / f"1{suffix}").read_bytes() == (
            tmp_path / f"2{suffix}"
        ).read_bytes()
    table = read_telemetry(csv_file)
    for number in range(7):
        row = truth_row(drive.truth(number / VIDEO_FPS), frame=number)
        assert {
            name: values[number] for name, values in table.items()
        } == pytest.approx(row)
    assert load_camera(camera_file).pose == POSE
    pictures = [frame.astype(float) for frame in read_video(video)]
    # Each image belongs to its own time, not to that of a neighbour.
    rendered = [render_frame(drive, number / VIDEO_FPS).image for number in range(7)]
    nearest = [
        np.argmin([np.abs(picture - other).mean() for other in rendered])
        for picture in pictures
    ]
    assert nearest == list(range(7))


def test_interrupted_video_leaves_no_files(tmp_path):
    def interrupt(done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        options = {"seconds": 0.2, "workers": 2, "progress": interrupt}
        write_video(tmp_path / "a.mp4", drive=small_drive(camera=TINY), **options)
    assert list(tmp_path.iterdir()) == []
    assert multiprocessing.active_children() == []
