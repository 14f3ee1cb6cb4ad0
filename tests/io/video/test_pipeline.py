"""process_video: each frame once, in order and at its time; the same bytes for the same input."""

from __future__ import annotations

import io
import re
import sys
from fractions import Fraction

import av
import cv2
import numpy as np
import pytest

from lanes.files import read_telemetry
from lanes.video.process import process_video
from lanes.video.reader import inspect_video, read_timed_frames, read_video
from lanes.video.writer import VideoWriter
from tests.io.video.sample_videos import (
    NTSC,
    YELLOW,
    boxes,
    make_video,
    number_of,
    numbered,
    set_rotation,
    unchanged,
)
from tests.support.project import REAL_DATA


class StatefulProcess:
    """A process with a state that returns the same array every time: the worst case for threads."""

    def __init__(self) -> None:
        self.canvas = np.zeros((96, 256, 3), np.uint8)

    def __call__(self, frame: np.ndarray) -> tuple[np.ndarray, dict[str, float]]:
        self.canvas //= 2
        self.canvas += frame // 2
        frame[:] = 0
        return self.canvas, {"brightness": float(self.canvas.mean().round(3))}


class TestAnnotate:
    def test_each_frame_once_in_order_and_none_lost(self, video, tmp_path):
        seen = []

        def process(frame):
            seen.append(number_of(frame))
            return frame

        summary = process_video(video, tmp_path / "out.mp4", process, progress=False)
        assert seen == list(range(50))
        assert (summary.frames, summary.missing) == (50, 0)
        assert [number_of(frame) for frame in read_video(tmp_path / "out.mp4")] == seen

    @pytest.mark.parametrize("fps", [25, NTSC, Fraction(24000, 1001), Fraction(60000, 1001), 12])
    def test_rate_is_exact(self, tmp_path, fps):
        path = make_video(tmp_path / "drive.mp4", 20, fps=fps)
        summary = process_video(path, tmp_path / "out.mp4", unchanged, progress=False)
        with av.open(str(tmp_path / "out.mp4")) as container:
            assert container.streams.video[0].average_rate == fps
        assert summary.fps == float(fps)
        assert summary.frames == 20

    def test_browsers_can_play_it(self, video, tmp_path):
        target = tmp_path / "out.mp4"
        process_video(video, target, unchanged, progress=False)
        with av.open(str(target)) as container:
            codec = container.streams.video[0].codec_context
            assert (codec.name, codec.pix_fmt, codec.profile) == ("h264", "yuv420p", "High")
            assert container.streams.audio[0].codec_context.name == "aac"
        order = boxes(target)
        assert order.index("moov") < order.index("mdat")

    def test_odd_size_is_padded(self, tmp_path):
        path = make_video(tmp_path / "odd.mkv", 5, size=(161, 97))
        frames = []
        summary = process_video(path, tmp_path / "out.mp4", lambda f: frames.append(f) or f, progress=False)
        assert frames[0].shape == (97, 161, 3)
        assert (summary.width, summary.height) == (162, 98)
        written = next(read_video(tmp_path / "out.mp4"))
        np.testing.assert_allclose(written[:97, :161].astype(int), frames[0], atol=30)
        np.testing.assert_allclose(written[20, 161], YELLOW, atol=10)

    def test_single_frame(self, tmp_path):
        summary = process_video(make_video(tmp_path / "one.mp4", 1), tmp_path / "out.mp4", unchanged, progress=False)
        assert (summary.frames, summary.duration_s) == (1, 0.04)

    def test_variable_rate_keeps_its_times(self, tmp_path):
        times_s = [0, 0.04, 0.08, 0.3, 0.34, 0.75, 0.9, 1.0]
        with VideoWriter(tmp_path / "variable.mp4", fps=25) as writer:
            for number, time_s in enumerate(times_s):
                writer.write(numbered(number), time_s)
        target = tmp_path / "out.mp4"
        process_video(tmp_path / "variable.mp4", target, unchanged, progress=False)
        np.testing.assert_allclose([f.time_s for f in read_timed_frames(target)], times_s, atol=1e-3)

    def test_process_can_take_the_elapsed_time(self, tmp_path):
        with VideoWriter(tmp_path / "variable.mp4", fps=25) as writer:
            for number, time_s in enumerate([0, 0.04, 0.3, 0.75]):
                writer.write(numbered(number), time_s)
        told = []

        def process(frame: np.ndarray, *, elapsed_s: float | None = 9.0) -> np.ndarray:
            told.append(elapsed_s)
            return frame

        process_video(tmp_path / "variable.mp4", tmp_path / "out.mp4", process, start_s=0.04, progress=False)
        assert told[0] is None and told[1:] == pytest.approx([0.26, 0.45], abs=1e-3)
        # A function written in C has no signature; it gets the frame only.
        process_video(tmp_path / "variable.mp4", tmp_path / "out.mp4", cv2.bitwise_not, progress=False)
        assert next(read_video(tmp_path / "out.mp4"))[:8].mean() == pytest.approx(255 - numbered(0)[:8].mean(), abs=8)

    def test_telemetry(self, video, tmp_path):
        values = iter(range(100))
        process_video(
            video,
            tmp_path / "out.mp4",
            lambda frame: (frame, {"offset_m": next(values) / 10}),
            start_s=1.0,
            progress=False,
            telemetry=tmp_path / "out.csv",
        )
        lines = (tmp_path / "out.csv").read_text().splitlines()
        assert lines[0] == "frame,time_s,offset_m,latency_ms"
        assert lines[1].startswith("25,1,0,")
        assert lines[25].startswith("49,1.96,2.4,")
        assert len(lines) == 26

    def test_overlapping_changes_nothing(self, repeatable, tmp_path):
        """A loop without threads gives the same packets and the same telemetry."""
        plain, rows = StatefulProcess(), []
        with VideoWriter(tmp_path / "plain.mp4", fps=25) as writer:
            for frame in read_timed_frames(repeatable, start_s=0.4):
                picture, row = plain(frame.image)
                rows.append({"frame": frame.number, "time_s": frame.time_s} | row)
                writer.write(picture, frame.time_s)
        options = {"start_s": 0.4, "sound": False, "progress": False, "telemetry": tmp_path / "rows.csv"}
        process_video(repeatable, tmp_path / "overlapped.mp4", StatefulProcess(), **options)
        assert (tmp_path / "plain.mp4").read_bytes() == (tmp_path / "overlapped.mp4").read_bytes()
        table = read_telemetry(tmp_path / "rows.csv")
        del table["latency_ms"]
        assert [dict(zip(table, values, strict=True)) for values in zip(*table.values(), strict=True)] == rows
        assert len(rows) == 40

    def test_same_input_gives_the_same_bytes(self, repeatable, tmp_path):
        for name in ("a.mp4", "b.mp4"):
            process_video(repeatable, tmp_path / name, unchanged, progress=False, sound=False)
        assert (tmp_path / "a.mp4").read_bytes() == (tmp_path / "b.mp4").read_bytes()

    def test_same_input_gives_the_same_packets_of_picture_and_sound(self, repeatable, tmp_path):
        """The interleaving of packets with equal times may vary."""
        packets = []
        for name in ("a.mp4", "b.mp4"):
            process_video(repeatable, tmp_path / name, unchanged, progress=False)
            with av.open(str(tmp_path / name)) as container:
                found = [(p.stream.index, p.pts, bytes(p)) for p in container.demux() if p.pts is not None]
            packets.append(sorted(found))
        assert len({index for index, _, _ in packets[0]}) == 2
        assert packets[0] == packets[1]

    def test_quiet(self, video, tmp_path, capfd):
        process_video(video, tmp_path / "out.mp4", unchanged)
        assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("degrees", [90, 180, 270])
def test_rotated_camera(tmp_path, degrees):
    path, turned = make_video(tmp_path / "upright.mp4", 2), tmp_path / "turned.mp4"
    set_rotation(path, turned, degrees)
    summary = process_video(turned, tmp_path / "out.mp4", unchanged, progress=False)
    expected, written = (next(read_video(p)).astype(int) for p in (turned, tmp_path / "out.mp4"))
    assert (summary.height, summary.width) == expected.shape[:2]
    assert np.abs(expected - written).mean() < 6


class TestProgress:
    @pytest.mark.parametrize(
        ("stream", "progress", "shown"),
        [("terminal", True, True), ("notebook", True, True), ("file", True, False), ("terminal", False, False)],
    )
    def test_shown_in_terminals_and_notebooks_only(self, video, tmp_path, monkeypatch, stream, progress, shown):
        kind = type("OutStream", (io.StringIO,), {"isatty": lambda _: stream == "terminal"})
        kind.__module__ = "ipykernel.iostream" if stream == "notebook" else "io"
        monkeypatch.setattr(sys, "stderr", kind())
        process_video(video, tmp_path / "out.mp4", unchanged, progress=progress, start_s=1.0)
        last = sys.stderr.getvalue().rpartition("\r")[2]
        assert bool(re.search(r"25/25 \[\d\d:\d\d<00:00, +[\d.]+frame/s", last)) == shown
        assert bool(last) == shown


REAL = REAL_DATA / "test_videos"


@pytest.mark.skipif(not (REAL / "project_video_0513.mp4").is_file(), reason="the real drives are not here")
def test_real_clip_that_was_cut_without_encoding(tmp_path):
    """It stores 91 frames; the first three are only references for the others."""
    source = REAL / "project_video_0513.mp4"
    summary = process_video(source, tmp_path / "out.mp4", lambda f: f[::4, ::4], end_s=1.0, progress=False)
    assert (inspect_video(source).frames, summary.frames, summary.fps) == (88, 25, 25.0)
    assert (summary.width, summary.height) == (320, 180)
