"""The functions of the soak test; the hour-long run itself is not part of the tests."""

from __future__ import annotations

import numpy as np
import pytest

from lanes.files import write_telemetry
from lanes.video.reader import inspect_video, read_video
from simulator.rendering.drive import Motion
from tests.support.clips import write_drive
from tests.support.painted_drive import SMALL, PaintedDrive, lane_lines, s_bend
from tools.soak import describe_memory, largest_differences, packet_times, repeat_drive

FRAMES, TURNS = 12, 4


def test_a_repeated_drive_has_every_frame_and_its_sound(tmp_path):
    drive = PaintedDrive(s_bend(), lane_lines(), motion=Motion(60.0, 25.0), camera=SMALL)
    source, long = write_drive(tmp_path / "short.mp4", drive, FRAMES), tmp_path / "long.mp4"
    repeat_drive(source, long, TURNS)
    assert inspect_video(long).frames == FRAMES * TURNS
    np.testing.assert_allclose(packet_times(long, "video"), np.arange(FRAMES * TURNS) / 25, atol=1e-3)
    heard_s = packet_times(long, "audio")
    assert heard_s[-1] == pytest.approx(FRAMES * TURNS / 25, abs=0.1)
    frames = np.array([frame[::8, ::8] for frame in read_video(long)]).reshape(TURNS, FRAMES, -1)
    assert (frames == frames[0]).all()


@pytest.mark.parametrize(("drift", "last"), [(0.0, 0.01), (0.002, 0.048)])
def test_drift_grows_the_differences(tmp_path, drift, last):
    """The first repetition is ignored; the others are compared with the second one."""
    rng = np.random.default_rng(2)
    rows = [
        {"frame": n, "offset_m": 0.3 + rng.choice([-1, 1]) * 0.005 + drift * turn + (turn == 0), "state": "tracking"}
        for turn in range(22)
        for n in range(FRAMES)
    ]
    rows[-1]["state"] = "lost"
    found = largest_differences(write_telemetry(tmp_path / "long.csv", rows), FRAMES)
    assert found["offset_m"][0] == pytest.approx(0.01 + 2 * drift, abs=1e-6)
    assert found["offset_m"][1] == pytest.approx(last, abs=0.003)
    assert found["state"] == (0, pytest.approx(1 / FRAMES))


def test_growing_memory_is_shown():
    seconds = np.arange(0, 3600, 5.0)
    text = describe_memory(np.column_stack([seconds, 200 + seconds / 36]))
    assert "+100.0 MB an hour" in text
    assert len(text.splitlines()) == 12
