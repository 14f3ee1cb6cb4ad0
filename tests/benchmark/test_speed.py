"""Speed: every system is timed, a transcode keeps all frames, ratios are those of the
times.
"""

from functools import partial
from itertools import islice

import numpy as np
import pytest

from benchmark import speed
from benchmark.speed import COLD, TRACKING, TRANSCODED, WARM_UP, time_files, time_frames
from helpers import RECIPES
from lanes.video.reader import inspect_video, read_video
from tests.support.clips import write_drive
from tests.support.painted_drive import BENDS


def test_the_tables_of_a_video_have_every_system_and_the_ratios_of_its_times(
    tmp_path, monkeypatch
):
    clip = write_drive(tmp_path / "bend.mp4", BENDS, WARM_UP + 4)
    measured = {}
    for name, measure in (("time_frames", time_frames), ("time_files", time_files)):
        once = partial(measure, rounds=1)
        monkeypatch.setattr(
            speed,
            name,
            lambda *given, once=once: measured.update(found := once(*given)) or found,
        )
    lines = speed.describe_speed(clip).splitlines()
    assert list(measured)[: 2 + len(RECIPES)] == [TRACKING, COLD, *RECIPES]
    assert all(min(times) > 0 for times in measured.values())
    annotated = measured["annotated"]
    bare = measured[TRANSCODED]
    assert bare[2:] == (1, 1)
    assert annotated.cpu_ratio == pytest.approx(annotated.cpu_ms / bare.cpu_ms)
    for name, times in measured.items():
        (line,) = (line for line in lines if line.startswith(f"{name} "))
        assert [
            float(cell) for cell in line.removeprefix(name).split()
        ] == pytest.approx(times, abs=0.051)
    assert lines[-1].startswith("Measured on ")
    assert max(map(len, lines)) <= 160


def test_a_transcode_keeps_all_frames(tmp_path):
    clip = write_drive(tmp_path / "bend.mp4", BENDS, 5)
    speed.transcode(clip, tmp_path / "out.mp4")
    assert inspect_video(tmp_path / "out.mp4") == inspect_video(clip)
    for was, now in islice(
        zip(read_video(clip), read_video(tmp_path / "out.mp4"), strict=True), 5
    ):
        assert np.abs(was.astype(int) - now).mean() < 4
