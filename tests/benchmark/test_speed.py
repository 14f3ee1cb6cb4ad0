"""Speed: every system is timed, a transcode keeps all frames, ratios are those of the times."""

from contextlib import closing

import numpy as np
import pytest

from benchmark import speed
from benchmark.speed import COLD, TRACKING, TRANSCODED, WARM_UP, FileTime, FrameTime, Speed, time_files, time_frames
from helpers import RECIPES
from lanes.video.reader import inspect_video, read_video
from tests.support.clips import write_drive
from tests.support.painted_drive import BENDS, SMALL


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    return write_drive(tmp_path_factory.mktemp("drives") / "bend.mp4", BENDS, WARM_UP + 4)


def test_every_system_is_timed_and_a_search_costs_more_than_tracking(clip):
    with closing(read_video(clip)) as frames:
        times = time_frames(list(frames), SMALL, rounds=2)
    assert list(times) == [TRACKING, COLD, *RECIPES]
    assert all(found.ms > 0 and found.mean > 0 for found in times.values())
    assert times[COLD].undistorts > 1.3 * times[TRACKING].undistorts


def test_a_transcode_keeps_all_frames(clip, tmp_path):
    speed.transcode(clip, tmp_path / "out.mp4")
    assert inspect_video(tmp_path / "out.mp4") == inspect_video(clip)
    for was, now in zip(read_video(clip), read_video(tmp_path / "out.mp4"), strict=True):
        assert np.abs(was.astype(int) - now).mean() < 4


def test_times_are_ratios_to_the_bare_transcode(clip):
    reports = []
    times = time_files(clip, SMALL, rounds=1, progress=lambda *done: reports.append(done))
    assert (times[TRANSCODED].wall_ratio, times[TRANSCODED].cpu_ratio) == (1, 1)
    annotated = times["annotated"]
    assert annotated.cpu_ratio == pytest.approx(annotated.cpu_ms / times[TRANSCODED].cpu_ms)
    assert reports == [(1, 3), (2, 3), (3, 3)]


def test_described_in_words():
    times = {TRACKING: FrameTime(3.1, 0.45, 0.5)}, {"annotated": FileTime(20.0, 30.0, 1.1, 1.4)}
    lines = Speed(*times, "abacus").describe().splitlines()
    cells = [line.split() for line in lines]
    assert ["tracker,", "tracking", "0.45", "0.50", "3.1"] in cells
    assert ["annotated", "20.0", "30.0", "1.10", "1.40"] in cells
    assert lines[-1] == "Measured on abacus."
    assert max(map(len, lines)) <= 120
