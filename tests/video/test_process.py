"""process_video: each frame once, in order and at its time; the same bytes for the same input."""

from __future__ import annotations

import io
import re
import sys
from collections.abc import Callable

import av
import cv2
import numpy as np
import pytest

from lanes.errors import VideoError
from lanes.files import read_telemetry
from lanes.video.reader import read_timed_frames, read_video
from lanes.video.writer import VideoWriter, process_video
from tests.video.sample_videos import NTSC, make_video, number_of, numbered, unchanged


def make_stateful() -> Callable:
    """A function with a state that returns the same array every time: the worst case for threads."""
    canvas = np.zeros((96, 256, 3), np.uint8)

    def function(image: np.ndarray) -> tuple[np.ndarray, dict[str, float]]:
        canvas[:] = canvas // 2 + image // 2
        image[:] = 0
        return canvas, {"brightness": float(canvas.mean().round(3))}

    return function


@pytest.mark.parametrize(("fps", "frames"), [(25, 1), (NTSC, 20), (12, 20)])
def test_rate_and_duration_are_exact(tmp_path, fps, frames):
    path = make_video(tmp_path / "drive.mp4", frames, fps=fps)
    info = process_video(path, tmp_path / "out.mp4", unchanged, progress=False)
    with av.open(str(tmp_path / "out.mp4")) as container:
        assert container.streams.video[0].average_rate == fps
    assert (info.fps, info.frames, info.duration_s) == (float(fps), frames, round(float(frames / fps), 6))


def test_each_frame_is_seen_once_in_order_and_browsers_can_play_the_output(video, tmp_path):
    seen, target = [], tmp_path / "out.mp4"
    info = process_video(video, target, lambda f: seen.append(number_of(f)) or f, progress=False)
    assert seen == [number_of(image) for image in read_video(target)] == list(range(50))
    assert (info.frames, info.missing) == (50, 0)
    with av.open(str(target)) as container:
        codec = container.streams.video[0].codec_context
        assert (codec.name, codec.pix_fmt, codec.profile) == ("h264", "yuv420p", "High")
        assert container.streams.audio[0].codec_context.name == "aac"
    # The index of the file stands before its frames.
    assert target.read_bytes().index(b"moov") < target.read_bytes().index(b"mdat")


def test_variable_rate_keeps_its_times_and_the_function_can_take_them(tmp_path):
    times_s, told = [0, 0.04, 0.08, 0.3, 0.34, 0.75, 0.9, 1.0], []
    path, target = tmp_path / "variable.mp4", tmp_path / "out.mp4"
    with VideoWriter(path, fps=25) as writer:
        for number, time_s in enumerate(times_s):
            writer.write(numbered(number), time_s)

    def function(image: np.ndarray, *, elapsed_s: float | None = 9.0) -> np.ndarray:
        told.append(elapsed_s)
        return image

    process_video(path, target, function, progress=False)
    np.testing.assert_allclose([f.time_s for f in read_timed_frames(target)], times_s, atol=1e-3)
    assert told[0] is None and told[1:] == pytest.approx(np.diff(times_s), abs=1e-3)
    process_video(path, target, function, start_s=0.3, progress=False)
    assert told[8] is None and told[9:] == pytest.approx(np.diff(times_s[3:]), abs=1e-3)
    # A function written in C has no signature; it gets the image only.
    process_video(path, target, cv2.bitwise_not, progress=False)
    assert next(read_video(target))[:8].mean() == pytest.approx(255 - numbered(0)[:8].mean(), abs=8)


def test_threads_change_nothing(repeatable, tmp_path):
    """A loop without threads gives the same bytes and the same telemetry."""
    plain, rows = make_stateful(), []
    with VideoWriter(tmp_path / "plain.mp4", fps=25, sound_from=repeatable) as writer:
        for frame in read_timed_frames(repeatable, start_s=0.4):
            image, row = plain(frame.image)
            rows.append({"frame": frame.number, "time_s": frame.time_s} | row)
            writer.write(image, frame.time_s)
    options = {"start_s": 0.4, "progress": False, "telemetry": tmp_path / "rows.csv"}
    process_video(repeatable, tmp_path / "out.mp4", make_stateful(), **options)
    assert (tmp_path / "plain.mp4").read_bytes() == (tmp_path / "out.mp4").read_bytes()
    table = read_telemetry(tmp_path / "rows.csv")
    name, latency_ms = table.popitem()
    assert name == "latency_ms" and (latency_ms > 0).all()
    assert [dict(zip(table, values, strict=True)) for values in zip(*table.values(), strict=True)] == rows
    assert len(rows) == 40


@pytest.mark.parametrize(
    ("stream", "progress", "shown"),
    [("notebook", True, True), ("file", True, False), ("terminal", False, False)],
)
def test_progress_is_shown_in_terminals_and_notebooks_only(video, tmp_path, monkeypatch, stream, progress, shown):
    kind = type("OutStream", (io.StringIO,), {"isatty": lambda _: stream == "terminal"})
    kind.__module__ = "ipykernel.iostream" if stream == "notebook" else "io"
    monkeypatch.setattr(sys, "stderr", kind())
    process_video(video, tmp_path / "out.mp4", unchanged, progress=progress, start_s=1.0)
    last = sys.stderr.getvalue().rpartition("\r")[2]
    assert bool(re.search(r"25/25 \[\d\d:\d\d<00:00, +[\d.]+frame/s", last)) == bool(last) == shown


def test_writer_without_frames(tmp_path):
    with pytest.raises(VideoError, match="no frame was written"), VideoWriter(tmp_path / "out.mp4", fps=25):
        pass
    assert not list(tmp_path.iterdir())
