"""Speed: every function is timed once, in its stage; a transcode keeps all frames."""

from __future__ import annotations

import time
from contextlib import closing
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from benchmark.speed.speed import Speed
from benchmark.speed.stages import (
    CLASSIC_STAGES,
    COLD,
    REST,
    TRACKER_STAGES,
    TRACKING,
    WARM_UP,
    FrameTime,
    Stopwatch,
    time_frames,
)
from benchmark.speed.transcode import FileTime, peak_memory_mb, repeat_video, time_files, transcode
from classic.recipe import RECIPES
from lanes.detect import paint as markings
from lanes.video.reader import inspect_video, read_timed_frames, read_video
from simulator.rendering.drive import Motion
from tests.support.clips import write_drive
from tests.support.painted_drive import CAMERA, PaintedDrive, lane_lines, s_bend

SMALL = CAMERA.scaled((640, 360))
DRIVE = PaintedDrive(s_bend(), lane_lines(), motion=Motion(60.0, 25.0, offset_m=0.3, wander_m=0.2), camera=SMALL)


@pytest.fixture(scope="module")
def clip(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("drives") / "bend.mp4"
    write_drive(path, DRIVE, WARM_UP + 4)
    return path


class TestStopwatch:
    def test_time_of_an_inner_function_is_counted_once(self, monkeypatch):
        clock_s = [0.0]
        monkeypatch.setattr("time.process_time", lambda: sum(clock_s))
        watch = Stopwatch()
        inner = watch.timed("inner", lambda: clock_s.append(2.0))
        watch.timed("outer", lambda: (clock_s.append(1.0), inner(), inner()))()
        assert watch.spent_s == {"inner": 4.0, "outer": 1.0}

    def test_waiting_costs_little(self):
        """Threads of other tests may work for a few milliseconds."""
        watch = Stopwatch()
        watch.timed("asleep", lambda: time.sleep(0.2))()
        assert watch.spent_s["asleep"] < 0.1

    def test_results_and_errors_pass_and_functions_are_restored(self):
        before = markings.marking_response
        watch = Stopwatch()
        with pytest.raises(ZeroDivisionError), watch.watching(TRACKER_STAGES):
            assert markings.marking_response is not before
            watch.timed("division", lambda a, *, by: a / by)(1, by=0)
        assert markings.marking_response is before
        assert Stopwatch().timed("division", lambda a, *, by: a / by)(6, by=2) == 3


@pytest.fixture(scope="module")
def times(clip) -> dict[str, FrameTime]:
    with closing(read_video(clip)) as frames:
        return time_frames(list(frames), SMALL, rounds=2)


def test_every_system_is_timed(times):
    assert list(times) == [TRACKING, COLD, *RECIPES]
    assert all(found.ms > 0 and found.undistorts > 0 for found in times.values())


def test_every_stage_is_called(times):
    """A function that is no longer called under its name would add its time to REST."""
    unmet = {(name, stage) for name, t in times.items() for stage, share in t.stages.items() if not share}
    assert unmet <= {(TRACKING, "search"), (COLD, "update")}
    assert list(times[COLD].stages) == [*TRACKER_STAGES, REST]
    assert list(times["hls_sobel"].stages) == [*CLASSIC_STAGES, REST]


def test_stages_sum_up_to_the_mean(times):
    for found in times.values():
        assert sum(found.stages.values()) == pytest.approx(found.mean)


def test_a_search_costs_more_than_an_update(times):
    assert times[COLD].stages["search"] > 2 * times[TRACKING].stages["update"]


class TestTranscode:
    def test_all_frames_are_kept(self, clip, tmp_path):
        transcode(clip, tmp_path / "out.mp4")
        assert inspect_video(tmp_path / "out.mp4") == inspect_video(clip)
        for was, now in zip(read_video(clip), read_video(tmp_path / "out.mp4"), strict=True):
            assert np.abs(was.astype(int) - now).mean() < 4

    def test_repeated_video(self, clip, tmp_path):
        """At least as long as requested, evenly timed, and each repetition is the video."""
        count = inspect_video(clip).frames
        path = repeat_video(clip, tmp_path / "long.mp4", 2 * count + 1)
        assert inspect_video(path).frames == 3 * count
        with closing(read_timed_frames(path)) as frames:
            found = list(islice(frames, 2 * count))
        np.testing.assert_allclose([f.time_s for f in found], np.arange(2 * count) / inspect_video(clip).fps, atol=1e-3)
        for was, now in zip(found[:count], found[count:], strict=True):
            assert (was.image == now.image).all()

    def test_times_are_ratios_to_the_bare_transcode(self, clip):
        reports = []
        times = time_files(clip, SMALL, rounds=1, progress=lambda *done: reports.append(done))
        assert (times["bare transcode"].wall_ratio, times["bare transcode"].cpu_ratio) == (1, 1)
        annotated = times["annotated"]
        assert annotated.cpu_ratio == pytest.approx(annotated.cpu_ms / times["bare transcode"].cpu_ms)
        assert reports == [(1, 3), (2, 3), (3, 3)]

    def test_memory_is_that_of_a_separate_process(self, clip):
        """The memory of this process does not count."""
        ballast = np.ones(50_000_000)
        assert 50 < peak_memory_mb(clip, clip.with_suffix(".yaml"), 3) < ballast.nbytes / 1e6
        del ballast


def test_described_in_words():
    speed = Speed(
        {TRACKING: FrameTime(3.1, 0.45, 0.5, {"search": 0.125})},
        {"annotated": FileTime(20.0, 30.0, 1.1, 1.4)},
        {400: 250.4},
        "abacus",
    )
    lines = speed.describe().splitlines()
    assert lines[1].split() == ["tracker,", "tracking", "0.45", "0.50", "3.1"]
    assert lines[2].split() == ["search", "0.12"]
    assert ["annotated", "20.0", "30.0", "1.10", "1.40"] in [line.split() for line in lines]
    assert lines[-3:] == ["400 frames: at most 250 MB of memory", "", "Measured on abacus."]
    assert max(map(len, lines)) <= 120
