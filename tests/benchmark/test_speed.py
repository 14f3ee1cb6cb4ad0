"""Speed: every system is timed, a transcode keeps all frames, ratios are those of the
times.
"""

from itertools import islice

import numpy as np
import pytest

from benchmark import speed
from benchmark.speed import (
    COLD,
    TRACKING,
    TRANSCODED,
    WARM_UP,
    FileTime,
    FrameTime,
    all_systems,
    time_files,
    time_frames,
)
from helpers import RECIPES
from lanes.camera.model import load_camera
from lanes.tracking.tracker import LaneTracker
from lanes.video.reader import inspect_video, read_video
from tests.support.clips import write_drive
from tests.support.painted_drive import BENDS


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    folder = tmp_path_factory.mktemp("speed")
    return write_drive(folder / "bend.mp4", BENDS, WARM_UP + 4)


@pytest.fixture(scope="module")
def of_frames(clip) -> dict[str, FrameTime]:
    camera = load_camera(clip.with_suffix(".yaml"))
    frames = list(read_video(clip))
    return time_frames(frames, camera, all_systems(camera), rounds=1)


@pytest.fixture(scope="module")
def of_files(clip) -> dict[str, FileTime]:
    return time_files(clip, load_camera(clip.with_suffix(".yaml")), rounds=1)


def test_every_system_is_timed(of_frames):
    assert list(of_frames) == [TRACKING, COLD, *RECIPES]
    assert min(min(times) for times in of_frames.values()) > 0


def test_every_way_to_process_a_file_is_timed(of_files):
    assert list(of_files) == [TRANSCODED, "through RGB", "annotated"]
    assert min(min(times) for times in of_files.values()) > 0


def test_times_of_files_are_ratios_to_a_bare_transcode(of_files):
    bare = of_files[TRANSCODED]
    annotated = of_files["annotated"]
    assert bare.wall_ratio == 1
    assert bare.cpu_ratio == 1
    assert annotated.wall_ratio == pytest.approx(annotated.wall_ms / bare.wall_ms)
    assert annotated.cpu_ratio == pytest.approx(annotated.cpu_ms / bare.cpu_ms)


def test_the_tables_have_the_times(clip, monkeypatch):
    """With two decimals, and the machine in the last line."""
    of_frames = {"tracker, cold": FrameTime(undistorts=1.234, mean=2.0, ms=30.456)}
    of_files = {"annotated": FileTime(10.0, 20.128, 1.5, 2.5)}
    monkeypatch.setattr(speed, "time_frames", lambda *_: of_frames)
    monkeypatch.setattr(speed, "time_files", lambda *_: of_files)
    lines = speed.describe_speed(clip).splitlines()
    cells = {line[:13].strip(): line[13:].split() for line in lines}
    assert cells["tracker, cold"] == ["1.23", "2.00", "30.46"]
    assert cells["annotated"] == ["10.00", "20.13", "1.50", "2.50"]
    assert lines[-1].startswith(f"Measured on {speed.describe_machine()}; load ")
    assert max(map(len, lines)) <= 160


def test_every_system_has_a_line_of_the_tables(clip, monkeypatch):
    """All that is timed is asked for, with the frames of the video."""
    asked = []

    def of_frames(frames: list, camera: object, systems: dict) -> dict[str, FrameTime]:
        asked.append((len(frames), list(systems)))
        return dict.fromkeys(systems, FrameTime(1.0, 1.0, 1.0))

    monkeypatch.setattr(speed, "time_frames", of_frames)
    monkeypatch.setattr(speed, "time_files", lambda *_: {})
    lines = speed.describe_speed(clip).splitlines()
    systems = [TRACKING, COLD, *RECIPES]
    assert asked == [(WARM_UP + 4, systems)]
    for system in systems:
        assert any(line.startswith(system) for line in lines)


def test_a_cold_tracker_is_reset_before_each_frame(clip, monkeypatch):
    process = all_systems(load_camera(clip.with_suffix(".yaml")))[COLD]()
    reset = LaneTracker.reset
    before = []

    def note_and_reset(tracker: LaneTracker) -> None:
        before.append(tracker.lane)
        reset(tracker)

    monkeypatch.setattr(LaneTracker, "reset", note_and_reset)
    for frame in islice(read_video(clip), 3):
        process(frame)
    assert len(before) == 3
    assert before[0] is None
    assert None not in before[1:]


def test_a_transcode_keeps_all_frames(clip, tmp_path):
    speed.transcode(clip, tmp_path / "out.mp4")
    assert inspect_video(tmp_path / "out.mp4") == inspect_video(clip)
    frames = zip(read_video(clip), read_video(tmp_path / "out.mp4"), strict=True)
    for was, now in islice(frames, 5):
        assert np.abs(was.astype(int) - now).mean() < 4
