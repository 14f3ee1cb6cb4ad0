"""Rendered frames and videos.

Determinism, bridge shadows, order of the processes; files are complete or absent.
"""

from __future__ import annotations

import multiprocessing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from benchmark.evaluation import PROJECT_ROOT
from lanes.camera.model import load_camera
from lanes.files import read_telemetry
from lanes.video.images import read_image
from lanes.video.reader import read_video
from simulator.light.lens import AutoExposure
from simulator.light.sunlight import BridgeShade
from simulator.rendering.drive import Motion
from simulator.rendering.render import VIDEO_FPS, render_frame, write_video
from simulator.road.truth import truth_row
from simulator.scenes.stills import still_scenes
from tests.simulator.small_drive import POSE, TINY, small_drive

FRAMES = 7
DRIVE = small_drive(
    motion=Motion(60.0, 20.0),
    camera=TINY,
    shades=(BridgeShade(66.0, 76.0),),
    exposure=AutoExposure(0.5, 0.8),
)


def test_committed_still_is_rendered_again():
    road = np.s_[470:660, 250:1050]
    path = PROJECT_ROOT / "test_images" / "test2.jpg"
    committed = read_image(path)[road].astype(int)
    again = render_frame(still_scenes()["test2"]).image[road].astype(int)
    # JPEG at quality 92 changes texture by a few levels, another scene by dozens.
    assert np.abs(committed - again).mean() < 2.5
    assert np.ptp(again) > 100


@dataclass(frozen=True)
class WrittenDrive:
    """Files of `DRIVE`, and the reports of progress."""

    video: Path
    table: Path
    camera: Path
    progress: list[tuple[int, int]]


def write_drive(folder: Path, *, workers: int) -> WrittenDrive:
    reports: list[tuple[int, int]] = []
    files = write_video(
        folder / f"{workers}.mp4",
        drive=DRIVE,
        seconds=0.28,
        workers=workers,
        progress=lambda *report: reports.append(report),
    )
    return WrittenDrive(*files, progress=reports)


@pytest.fixture(scope="module")
def one_process(tmp_path_factory) -> WrittenDrive:
    return write_drive(tmp_path_factory.mktemp("one"), workers=1)


@pytest.fixture(scope="module")
def two_processes(tmp_path_factory) -> WrittenDrive:
    return write_drive(tmp_path_factory.mktemp("two"), workers=2)


@pytest.mark.parametrize("kind", ["video", "table", "camera"])
def test_files_do_not_depend_on_the_number_of_processes(
    one_process, two_processes, kind
):
    one = getattr(one_process, kind)
    two = getattr(two_processes, kind)
    assert one.read_bytes() == two.read_bytes()


@pytest.mark.parametrize("written", ["one_process", "two_processes"])
def test_progress_counts_the_frames(request, written):
    reports = request.getfixturevalue(written).progress
    assert reports == [(number, FRAMES) for number in range(1, FRAMES + 1)]


def test_the_table_has_the_truth_of_each_frame(two_processes):
    table = read_telemetry(two_processes.table)
    for number in range(FRAMES):
        row = truth_row(DRIVE.truth(number / VIDEO_FPS), frame=number)
        written = {name: values[number] for name, values in table.items()}
        assert written == pytest.approx(row)


def test_the_camera_file_has_the_pose(two_processes):
    assert load_camera(two_processes.camera).pose == POSE


def test_each_image_belongs_to_its_own_time(two_processes):
    """Not to that of a neighbour."""
    images = [frame.astype(float) for frame in read_video(two_processes.video)]
    rendered = [render_frame(DRIVE, n / VIDEO_FPS).image for n in range(FRAMES)]
    nearest = []
    for image in images:
        differences = [np.abs(image - other).mean() for other in rendered]
        nearest.append(int(np.argmin(differences)))
    assert nearest == list(range(FRAMES))


def test_interrupted_video_leaves_no_files_and_no_processes(tmp_path):
    def interrupt(done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_video(
            tmp_path / "a.mp4",
            drive=small_drive(camera=TINY),
            seconds=0.2,
            workers=2,
            progress=interrupt,
        )
    assert list(tmp_path.iterdir()) == []
    assert multiprocessing.active_children() == []
