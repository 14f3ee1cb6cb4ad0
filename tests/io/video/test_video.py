"""Videos: every frame once and in order, a file that browsers play, nothing left behind by a failure."""

from __future__ import annotations

import io
import itertools
import os
import re
import signal
import struct
import subprocess
import sys
import threading
from contextlib import nullcontext
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from av.video.reformatter import Colorspace

from benchmark.speed.transcode import transcode
from lanes.camera.camera import Camera, undistort
from lanes.drawing import pictures as draw
from lanes.io.frames import PictureError, YuvFrame
from lanes.io.telemetry import read_telemetry
from lanes.io.video import pipeline as annotate
from lanes.io.video.container import VideoError
from lanes.io.video.pipeline import YuvProcess, annotate_video, open_clip
from lanes.io.video.reader import inspect_video, read_frames, read_timed_frames
from lanes.io.video.writer import VideoWriter

SIZE = (160, 96)
YELLOW, RED, BLUE = (255, 200, 0), (200, 30, 30), (20, 60, 220)
NTSC = Fraction(30000, 1001)


def numbered(number: int, size: tuple[int, int] = SIZE) -> np.ndarray:
    """A picture that says its number by ten bars, white for 1 and black for 0, on coloured ground."""
    width, height = size
    image = np.empty((height, width, 3), np.uint8)
    image[:] = YELLOW
    for bit in range(10):
        image[height // 2 :, bit * 16 : bit * 16 + 16] = 235 if number >> bit & 1 else 20
    return image


def number_of(image: np.ndarray) -> int:
    row = image[-10:-2].mean(axis=(0, 2))
    return sum(int(row[bit * 16 + 8] > 128) << bit for bit in range(10))


def make_video(path: Path, frames: int = 25, *, fps=25, size=SIZE, sound: str | None = None, seconds=None) -> Path:
    """A video written by another way than the tested one: straight through PyAV, in any container."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=Fraction(fps), options={"preset": "ultrafast", "g": "12"})
        stream.width, stream.height, stream.pix_fmt = *size, "yuv420p" if size[0] % 2 == 0 else "yuv444p"
        track = container.add_stream(sound, rate=48000, layout="mono") if sound else None
        for number in range(frames):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(numbered(number, size))))
        container.mux(stream.encode(None))
        if track:
            add_tone(container, track, seconds or frames / float(fps))
    return path


def add_tone(container, track, seconds: float) -> None:
    """A tone that is silent in its first half, so that a shift can be heard."""
    times = np.arange(int(48000 * seconds)) / 48000
    wave = 0.5 * np.sin(2 * np.pi * 440 * times) * (times > seconds / 2)
    frame = av.AudioFrame.from_ndarray((wave * 32767).astype(np.int16)[None], format="s16", layout="mono")
    frame.sample_rate, frame.pts = 48000, 0
    container.mux(track.encode(frame))
    container.mux(track.encode(None))


def tone_starts_s(path: Path) -> float:
    with av.open(str(path)) as container:
        stream = container.streams.audio[0]
        for frame in container.decode(stream):
            loud = np.flatnonzero(np.abs(frame.to_ndarray().astype(float)[0]) > 0.1)
            if len(loud):
                return frame.time + loud[0] / frame.sample_rate
    return np.nan


def sound_packets(path: Path) -> list[tuple[float, bytes]]:
    """Each with the time at which it is heard, to a tenth of a millisecond."""
    with av.open(str(path)) as container:
        packets = container.demux(container.streams.audio[0])
        return [(round(float(p.pts * p.time_base), 4), bytes(p)) for p in packets if p.size]


def unchanged(frame: np.ndarray) -> np.ndarray:
    return frame


class Accountant:
    """A process with a memory, which returns one and the same array each time: the worst case for threads."""

    def __init__(self) -> None:
        self.canvas = np.zeros((96, 256, 3), np.uint8)

    def __call__(self, frame: np.ndarray) -> tuple[np.ndarray, dict[str, float]]:
        self.canvas //= 2
        self.canvas += frame // 2
        frame[:] = 0
        return self.canvas, {"brightness": float(self.canvas.mean().round(3))}


def boxes(path: Path) -> list[str]:
    """Names of the top-level boxes of an mp4 file, in order (ISO 14496-12, 4.2)."""
    data, at, names = path.read_bytes(), 0, []
    while at < len(data):
        length, name = struct.unpack(">I4s", data[at : at + 8])
        names.append(name.decode())
        at += length
    return names


@pytest.fixture(scope="module")
def video(tmp_path_factory) -> Path:
    return make_video(tmp_path_factory.mktemp("video") / "drive.mp4", 50, sound="aac")


@pytest.fixture(scope="module")
def repeatable(tmp_path_factory) -> Path:
    """A video that x264 encodes to the same bytes each time.

    With AVX-512 it reads beyond its own data (in the macroblock tree) where the width is no multiple of 256 pixels: of
    60 runs of 160x96 some ten differed, of 256x96 and 1280x720 none.
    """
    return make_video(tmp_path_factory.mktemp("video") / "wide.mp4", 50, size=(256, 96), sound="aac")


class TestInspect:
    def test_tells_size_rate_length_and_sound(self, video):
        info = inspect_video(video)
        assert (info.width, info.height, info.fps, info.frames) == (160, 96, 25.0, 50)
        assert (info.duration_s, info.has_audio) == (2.0, True)

    @pytest.mark.parametrize("suffix", ["mkv", "avi", "ts", "mov"])
    def test_counts_frames_of_every_container(self, tmp_path, suffix):
        path = make_video(tmp_path / f"drive.{suffix}", 31, fps=NTSC)
        info = inspect_video(path)
        assert info.frames == 31
        assert info.fps == pytest.approx(30000 / 1001, abs=1e-3)
        assert [number_of(frame) for frame in read_frames(path)] == list(range(31))

    def test_frames_that_are_not_shown_do_not_count(self, video, tmp_path):
        """A clip cut between key frames without encoding again stores frames that only help to decode the others."""
        path = tmp_path / "clip.mp4"
        with av.open(str(video)) as source, av.open(str(path), "w") as target:
            output = target.add_stream_from_template(source.streams.video[0])
            for packet in source.demux(source.streams.video[0]):
                if packet.size:
                    packet.stream = output
                    packet.pts -= round(Fraction(5, 25) / packet.time_base)
                    packet.dts -= round(Fraction(5, 25) / packet.time_base)
                    target.mux(packet)
        assert inspect_video(path).frames == 45
        assert [number_of(frame) for frame in read_frames(path)] == list(range(5, 50))

    def test_missing_file(self, tmp_path):
        with pytest.raises(FileNotFoundError, match="nowhere.mp4: there is no such video"):
            inspect_video(tmp_path / "nowhere.mp4")

    @pytest.mark.parametrize(
        ("content", "sentence"),
        [(b"", "the file is empty"), (b"this is no video at all\n" * 50, "cannot be read as a video")],
    )
    def test_files_that_are_no_video(self, tmp_path, content, sentence):
        path = tmp_path / "drive.mp4"
        path.write_bytes(content)
        with pytest.raises(VideoError, match=f"drive.mp4: .*{sentence}"):
            inspect_video(path)

    def test_sound_without_pictures(self, tmp_path):
        path = tmp_path / "song.mp4"
        with av.open(str(path), "w") as container:
            add_tone(container, container.add_stream("aac", rate=48000, layout="mono"), 0.2)
        with pytest.raises(VideoError, match="holds no frame of a video .its streams: audio"):
            inspect_video(path)

    @pytest.mark.parametrize("suffix", ["mp4", "avi"])
    def test_video_without_frames(self, tmp_path, suffix):
        path = tmp_path / f"hollow.{suffix}"
        with av.open(str(path), "w") as container:
            stream = container.add_stream("libx264", rate=25)
            stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
            container.start_encoding()
        with pytest.raises(VideoError, match=r"hollow\..*holds no frame"):
            inspect_video(path)

    def test_cut_off_with_the_index_behind(self, video, tmp_path):
        path = tmp_path / "cut.mp4"
        path.write_bytes(video.read_bytes()[: video.stat().st_size // 2])
        with pytest.raises(VideoError, match="cut off"):
            inspect_video(path)

    def test_cut_off_with_the_index_in_front(self, video, tmp_path):
        annotate_video(video, tmp_path / "whole.mp4", unchanged, progress=False)
        path = tmp_path / "cut.mp4"
        path.write_bytes((tmp_path / "whole.mp4").read_bytes()[:-3000])
        with pytest.raises(VideoError, match=r"cut\.mp4: .*(cut off after|damaged)"):
            inspect_video(path)


class TestRead:
    def test_frames_are_rgb_and_writable(self, video):
        frame = next(read_frames(video))
        frame[0, 0] = 1
        np.testing.assert_allclose(frame[20, 80], YELLOW, atol=4)

    @pytest.mark.parametrize(
        ("start_s", "end_s", "first", "last"), [(0, None, 0, 49), (0.4, 1, 10, 24), (1.6, 9, 40, 49)]
    )
    def test_piece(self, video, start_s, end_s, first, last):
        frames = list(read_timed_frames(video, start_s=start_s, end_s=end_s))
        assert [number_of(f.image) for f in frames] == [f.number for f in frames] == list(range(first, last + 1))
        assert frames[0].time_s == pytest.approx(first / 25)

    def test_piece_behind_the_end(self, video):
        with pytest.raises(VideoError, match="no frame at or after 2.5 s"):
            next(read_frames(video, start_s=2.5))

    def test_piece_that_ends_before_it_starts(self, video):
        with pytest.raises(VideoError, match="start_s < end_s"):
            next(read_frames(video, start_s=1.5, end_s=1.0))

    @pytest.mark.parametrize(("degrees", "corner"), [(90, (0, -1)), (180, (-1, -1)), (270, (-1, 0))])
    def test_turned_camera(self, tmp_path, degrees, corner):
        """The top left corner of what was stored lands where players that obey the display matrix show it."""
        path = make_video(tmp_path / "upright.mp4", 2)
        turned = tmp_path / "turned.mp4"
        set_rotation(path, turned, degrees)
        marked = next(read_frames(turned))
        assert marked.shape[:2] == ((160, 96) if degrees % 180 else (96, 160))
        info = inspect_video(turned)
        assert (info.height, info.width) == marked.shape[:2]
        # The stored top half is yellow, the bottom half dark: find where the top went.
        top = {90: marked[:, -20:], 180: marked[-20:], 270: marked[:, :20]}[degrees]
        np.testing.assert_allclose(top.mean(axis=(0, 1)), YELLOW, atol=6)


def set_rotation(source: Path, target: Path, degrees: int) -> None:
    """Write the matrix of a clockwise turn into the track header of an mp4 (ISO 14496-12, 8.3.2)."""
    data = bytearray(source.read_bytes())
    at = data.index(b"tkhd") + 4 + 4 + 20 + 16
    cos, sin = {90: (0, 1), 180: (-1, 0), 270: (0, -1)}[degrees]
    data[at : at + 36] = struct.pack(">9i", cos << 16, sin << 16, 0, -sin << 16, cos << 16, 0, 0, 0, 1 << 30)
    target.write_bytes(data)


class TestAnnotate:
    def test_each_frame_once_in_order_and_none_lost(self, video, tmp_path):
        seen = []

        def process(frame):
            seen.append(number_of(frame))
            return frame

        summary = annotate_video(video, tmp_path / "out.mp4", process, progress=False)
        assert seen == list(range(50))
        assert (summary.frames_in, summary.frames_out) == (50, 50)
        assert [number_of(frame) for frame in read_frames(tmp_path / "out.mp4")] == seen

    @pytest.mark.parametrize("fps", [25, NTSC, Fraction(24000, 1001), Fraction(60000, 1001), 12])
    def test_rate_is_exact(self, tmp_path, fps):
        path = make_video(tmp_path / "drive.mp4", 20, fps=fps)
        summary = annotate_video(path, tmp_path / "out.mp4", unchanged, progress=False)
        with av.open(str(tmp_path / "out.mp4")) as container:
            assert container.streams.video[0].average_rate == fps
        assert summary.fps == float(fps)
        assert summary.frames_out == 20

    def test_browsers_can_play_it(self, video, tmp_path):
        target = tmp_path / "out.mp4"
        annotate_video(video, target, unchanged, progress=False)
        with av.open(str(target)) as container:
            codec = container.streams.video[0].codec_context
            assert (codec.name, codec.pix_fmt, codec.profile) == ("h264", "yuv420p", "High")
            # BT.601's colour matrix and 16..235, by their numbers in ITU-T H.273
            assert (codec.colorspace, codec.color_range) == (6, 1)
            assert container.streams.audio[0].codec_context.name == "aac"
        order = boxes(target)
        assert order.index("moov") < order.index("mdat")

    @pytest.mark.parametrize("height", [96, 98])
    def test_colours_arrive(self, tmp_path, height):
        image = numbered(0, (160, height))
        image[:30, :60], image[:30, 60:120] = RED, BLUE
        with VideoWriter(tmp_path / "colours.mp4", fps=25, crf=10) as writer:
            for _ in range(5):
                writer.write(image)
        frame = list(read_frames(tmp_path / "colours.mp4"))[3]
        for place, colour in (((15, 30), RED), ((15, 90), BLUE), ((15, 140), YELLOW)):
            np.testing.assert_allclose(frame[place], colour, atol=6)

    def test_odd_size_is_padded(self, tmp_path):
        path = make_video(tmp_path / "odd.mkv", 5, size=(161, 97))
        frames = []
        summary = annotate_video(path, tmp_path / "out.mp4", lambda f: frames.append(f) or f, progress=False)
        assert frames[0].shape == (97, 161, 3)
        assert (summary.width, summary.height) == (162, 98)
        written = next(read_frames(tmp_path / "out.mp4"))
        np.testing.assert_allclose(written[:97, :161].astype(int), frames[0], atol=30)
        np.testing.assert_allclose(written[20, 161], YELLOW, atol=10)

    def test_single_frame(self, tmp_path):
        summary = annotate_video(make_video(tmp_path / "one.mp4", 1), tmp_path / "out.mp4", unchanged, progress=False)
        assert (summary.frames_in, summary.frames_out, summary.duration_s) == (1, 1, 0.04)

    def test_piece_with_sound_beside_its_frames(self, tmp_path):
        path = make_video(tmp_path / "drive.mp4", 100, sound="aac")
        assert tone_starts_s(path) == pytest.approx(2.0, abs=0.05)
        target = tmp_path / "out.mp4"
        summary = annotate_video(path, target, unchanged, start_s=1.2, end_s=3.2, progress=False)
        assert (summary.frames_out, summary.duration_s) == (50, 2.0)
        assert tone_starts_s(target) == pytest.approx(0.8, abs=0.05)
        with av.open(str(target)) as container:
            sound = container.streams.audio[0]
            assert float(sound.duration * sound.time_base) == pytest.approx(2.0, abs=0.05)

    @pytest.mark.parametrize(("suffix", "codec"), [("ts", "aac"), ("avi", "pcm_s16le"), ("mov", "pcm_s16le")])
    def test_sound_of_other_containers(self, tmp_path, suffix, codec):
        path = make_video(tmp_path / f"drive.{suffix}", 40, sound=codec)
        summary = annotate_video(path, tmp_path / "out.mp4", unchanged, progress=False)
        assert summary.has_audio
        assert tone_starts_s(tmp_path / "out.mp4") == pytest.approx(0.8, abs=0.05)

    def test_sound_that_browsers_play_is_copied(self, video, tmp_path):
        """Byte for byte and at its times; encoding it again would make other bytes."""
        annotate_video(video, tmp_path / "out.mp4", unchanged, progress=False)
        before, after = sound_packets(video), sound_packets(tmp_path / "out.mp4")
        # what the encoder put before the first frame stays behind
        assert set(after) <= set(before)
        assert len(after) >= len(before) - 2 > 80

    def test_variable_rate_with_sound(self, tmp_path):
        """Frames that are dropped for a second: picture and sound stay beside each other."""
        times_s = [*np.arange(10) / 25, *(1.4 + np.arange(20) / 25)]
        path = tmp_path / "variable.mkv"
        with av.open(str(path), "w") as container:
            stream = container.add_stream("libx264", rate=25, options={"preset": "ultrafast"})
            stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
            stream.codec_context.time_base = Fraction(1, 1000)
            track = container.add_stream("aac", rate=48000, layout="mono")
            for number, time_s in enumerate(times_s):
                frame = av.VideoFrame.from_ndarray(numbered(number))
                frame.pts, frame.time_base = round(1000 * time_s), Fraction(1, 1000)
                container.mux(stream.encode(frame))
            container.mux(stream.encode(None))
            add_tone(container, track, 2.2)
        summary = annotate_video(path, tmp_path / "out.mp4", YuvProcess(lambda f: f), progress=False)
        found = list(read_timed_frames(tmp_path / "out.mp4"))
        assert summary.frames_out == 30 and [number_of(f.image) for f in found] == list(range(30))
        np.testing.assert_allclose([f.time_s for f in found], times_s, atol=1e-3)
        assert tone_starts_s(tmp_path / "out.mp4") == pytest.approx(tone_starts_s(path), abs=1e-3)

    def test_without_sound(self, video, tmp_path):
        assert not annotate_video(video, tmp_path / "out.mp4", unchanged, sound=False, progress=False).has_audio

    def test_variable_rate_keeps_its_times(self, tmp_path):
        times_s = [0, 0.04, 0.08, 0.3, 0.34, 0.75, 0.9, 1.0]
        with VideoWriter(tmp_path / "variable.mp4", fps=25) as writer:
            for number, time_s in enumerate(times_s):
                writer.write(numbered(number), time_s)
        target = tmp_path / "out.mp4"
        annotate_video(tmp_path / "variable.mp4", target, unchanged, progress=False)
        np.testing.assert_allclose([f.time_s for f in read_timed_frames(target)], times_s, atol=1e-3)

    def test_who_asks_is_told_the_time_since_the_frame_before(self, tmp_path):
        with VideoWriter(tmp_path / "variable.mp4", fps=25) as writer:
            for number, time_s in enumerate([0, 0.04, 0.3, 0.75]):
                writer.write(numbered(number), time_s)
        told = []

        def process(frame: np.ndarray, *, elapsed_s: float | None = 9.0) -> np.ndarray:
            told.append(elapsed_s)
            return frame

        annotate_video(tmp_path / "variable.mp4", tmp_path / "out.mp4", process, start_s=0.04, progress=False)
        assert told[0] is None and told[1:] == pytest.approx([0.26, 0.45], abs=1e-3)
        # A function written in C does not tell its parameters; it gets the frame alone.
        annotate_video(tmp_path / "variable.mp4", tmp_path / "out.mp4", cv2.bitwise_not, progress=False)
        assert next(read_frames(tmp_path / "out.mp4"))[:8].mean() == pytest.approx(255 - numbered(0)[:8].mean(), abs=8)

    def test_telemetry(self, video, tmp_path):
        values = iter(range(100))
        annotate_video(
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
        """The loop without threads, a frame at a time, gives the same picture packets and the same telemetry."""
        plain, rows = Accountant(), []
        with VideoWriter(tmp_path / "plain.mp4", fps=25) as writer:
            for frame in read_timed_frames(repeatable, start_s=0.4):
                picture, row = plain(frame.image)
                rows.append({"frame": frame.number, "time_s": frame.time_s} | row)
                writer.write(picture, frame.time_s)
        options = {"start_s": 0.4, "sound": False, "progress": False, "telemetry": tmp_path / "rows.csv"}
        annotate_video(repeatable, tmp_path / "overlapped.mp4", Accountant(), **options)
        assert (tmp_path / "plain.mp4").read_bytes() == (tmp_path / "overlapped.mp4").read_bytes()
        table = read_telemetry(tmp_path / "rows.csv")
        del table["latency_ms"]
        assert [dict(zip(table, values, strict=True)) for values in zip(*table.values(), strict=True)] == rows
        assert len(rows) == 40

    def test_same_input_gives_the_same_bytes(self, repeatable, tmp_path):
        for name in ("a.mp4", "b.mp4"):
            annotate_video(repeatable, tmp_path / name, unchanged, progress=False, sound=False)
        assert (tmp_path / "a.mp4").read_bytes() == (tmp_path / "b.mp4").read_bytes()

    def test_same_input_gives_the_same_packets_of_picture_and_sound(self, repeatable, tmp_path):
        """How they are interleaved may depend on which arrives first, where both belong to the same moment."""
        packets = []
        for name in ("a.mp4", "b.mp4"):
            annotate_video(repeatable, tmp_path / name, unchanged, progress=False)
            with av.open(str(tmp_path / name)) as container:
                found = [(p.stream.index, p.pts, bytes(p)) for p in container.demux() if p.pts is not None]
            packets.append(sorted(found))
        assert len({index for index, _, _ in packets[0]}) == 2
        assert packets[0] == packets[1]

    def test_quiet(self, video, tmp_path, capfd):
        annotate_video(video, tmp_path / "out.mp4", unchanged)
        assert capfd.readouterr() == ("", "")


def packets_of(path: Path) -> list[bytes]:
    with av.open(str(path)) as container:
        return [bytes(packet) for packet in container.demux(container.streams.video[0]) if packet.size]


class TestAsStored:
    """Frames that keep the planes of their video."""

    def test_what_is_not_drawn_on_is_as_in_a_bare_transcode(self, repeatable, tmp_path):
        transcode(repeatable, tmp_path / "bare.mp4")
        annotate_video(repeatable, tmp_path / "out.mp4", YuvProcess(unchanged), progress=False, sound=False)
        assert packets_of(tmp_path / "out.mp4") == packets_of(tmp_path / "bare.mp4")

    def test_its_own_to_draw_on_and_in_order(self, video, tmp_path):
        """Brightness is inverted in place; were these the decoder's planes, later frames would be built on them."""

        def invert(frame: YuvFrame) -> tuple[YuvFrame, dict[str, int]]:
            number = number_of(frame.to_rgb())
            frame.planes[0][:] = 251 - frame.planes[0]
            return frame, {"number": number}

        annotate_video(video, tmp_path / "out.mp4", YuvProcess(invert), progress=False, telemetry=tmp_path / "out.csv")
        np.testing.assert_array_equal(read_telemetry(tmp_path / "out.csv")["number"], np.arange(50))
        assert [1023 - number_of(frame) for frame in read_frames(tmp_path / "out.mp4")] == list(range(50))

    @pytest.mark.parametrize(
        ("tags", "form"),
        [
            ((1, 1, 1, 1), "yuv420p"),
            ((1, 2, 1, 1), "yuv420p"),
            ((6, 1, 6, 6), "yuv420p"),
            ((9, 1, 9, 14), "yuv420p10le"),
            ((1, 1, 1, 13), "yuv422p"),
        ],
    )
    def test_colours_stay_what_the_file_says(self, tmp_path, tags, form):
        """Matrix, range, primaries and transfer by their numbers; the colours that they stand for stay the same."""
        matrix, span, primaries, transfer = tags
        path = tmp_path / "source.mkv"
        image = numbered(5)
        with av.open(str(path), "w") as container:
            stream = container.add_stream("libx264", rate=25, options={"crf": "10"})
            stream.width, stream.height, stream.pix_fmt = *SIZE, form
            codec = stream.codec_context
            codec.colorspace, codec.color_range, codec.color_primaries, codec.color_trc = tags
            for _ in range(5):
                frame = av.VideoFrame.from_ndarray(image)
                to = {1: Colorspace.ITU709, 6: Colorspace.ITU601, 9: Colorspace.BT2020}[matrix]
                stored = frame.reformat(format=form, dst_colorspace=to, src_color_range=2, dst_color_range=span)
                container.mux(stream.encode(stored))
            container.mux(stream.encode(None))
        annotate_video(path, tmp_path / "out.mp4", YuvProcess(unchanged), progress=False)
        with av.open(str(tmp_path / "out.mp4")) as container:
            codec = container.streams.video[0].codec_context
            assert (codec.colorspace, codec.color_range, codec.color_primaries, codec.color_trc) == tags
        before, after = (list(read_frames(p))[3] for p in (path, tmp_path / "out.mp4"))
        np.testing.assert_allclose(before[20, 40:120], np.broadcast_to(YELLOW, (80, 3)), atol=6)
        np.testing.assert_allclose(after[20, 40:120], np.broadcast_to(YELLOW, (80, 3)), atol=9)

    @pytest.mark.parametrize("degrees", [90, 180, 270])
    def test_turned_camera(self, tmp_path, degrees):
        path, turned = make_video(tmp_path / "upright.mp4", 2), tmp_path / "turned.mp4"
        set_rotation(path, turned, degrees)
        summary = annotate_video(turned, tmp_path / "out.mp4", YuvProcess(unchanged), progress=False)
        expected, written = (next(read_frames(p)).astype(int) for p in (turned, tmp_path / "out.mp4"))
        assert (summary.height, summary.width) == expected.shape[:2]
        assert np.abs(expected - written).mean() < 6

    def test_odd_size_keeps_its_pixels_where_they_are(self, tmp_path):
        path = make_video(tmp_path / "odd.mkv", 3, size=(161, 97))
        shapes = []
        summary = annotate_video(
            path, tmp_path / "out.mp4", YuvProcess(lambda f: shapes.append(f.shape) or f), progress=False
        )
        assert shapes == [(97, 161, 3)] * 3
        assert (summary.width, summary.height) == (162, 98)
        assert number_of(list(read_frames(tmp_path / "out.mp4"))[2][:97]) == 2


class TestFailure:
    @pytest.fixture
    def target(self, tmp_path) -> Path:
        """An earlier result, which a failed run must leave as it was."""
        path = tmp_path / "out" / "drive.mp4"
        path.parent.mkdir()
        path.write_bytes(b"earlier")
        return path

    @staticmethod
    def assert_untouched(target: Path) -> None:
        assert [p.name for p in target.parent.iterdir()] == ["drive.mp4"]
        assert target.read_bytes() == b"earlier"

    @pytest.mark.parametrize("error", [ZeroDivisionError("radius"), KeyboardInterrupt(), SystemExit(1)])
    def test_exception_in_process(self, video, target, error):
        calls = []

        def process(frame):
            calls.append(frame)
            if len(calls) == 20:
                raise error
            return frame

        with pytest.raises(type(error)) as caught:
            annotate_video(video, target, process, progress=False)
        self.assert_untouched(target)
        if isinstance(error, ZeroDivisionError):
            assert f"frame 19 of {video}" in caught.value.__notes__[0]

    def test_a_refused_frame_is_named(self, video, target):
        camera = Camera.from_fov((640, 360), 60)
        with pytest.raises(PictureError, match=r"^frame 5 of .*drive\.mp4: is 160x96 .* calibrated for 640x360"):
            annotate_video(video, target, lambda frame: undistort(frame, camera), progress=False, start_s=0.2)
        self.assert_untouched(target)

    @pytest.mark.parametrize("result", [None, np.zeros((96, 160), np.uint8), np.zeros((96, 160, 3))])
    def test_process_that_returns_no_picture(self, video, target, result):
        with pytest.raises(VideoError, match="frame 0 of .*process returned"):
            annotate_video(video, target, lambda frame: result, progress=False)
        self.assert_untouched(target)

    def test_process_that_changes_its_size(self, video, target):
        sizes = iter(range(100, 10, -1))
        with pytest.raises(VideoError, match="frame 1 is .*99 pixels, the first one was 160x100"):
            annotate_video(video, target, lambda f: np.zeros((next(sizes), 160, 3), np.uint8), progress=False)
        self.assert_untouched(target)

    @pytest.mark.parametrize(
        ("number", "status"), [(signal.SIGTERM, 128 + signal.SIGTERM), (signal.SIGINT, -signal.SIGINT)]
    )
    def test_stopped_from_outside(self, video, target, number, status):
        """A real process gets a real signal in the middle of its work."""
        code = (
            "import sys, time\n"
            "from lanes.io.video.pipeline import annotate_video\n"
            "def slow(frame):\n"
            "    print('frame', flush=True)\n"
            "    time.sleep(0.05)\n"
            "    return frame\n"
            "annotate_video(sys.argv[1], sys.argv[2], slow)\n"
        )
        root = Path(__file__).parents[3]
        command = [sys.executable, "-c", code, str(video), str(target)]
        with subprocess.Popen(command, cwd=root, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as run:
            for _ in range(5):
                assert run.stdout.readline() == "frame\n"
            assert len(list(target.parent.iterdir())) == 2
            run.send_signal(number)
            assert run.wait(timeout=10) == status
            assert ("Traceback" in run.stderr.read()) == (number == signal.SIGINT)
        self.assert_untouched(target)

    def test_no_handler_is_left(self, video, tmp_path):
        before = signal.getsignal(signal.SIGTERM)
        annotate_video(video, tmp_path / "out.mp4", unchanged, progress=False, end_s=0.2)
        assert signal.getsignal(signal.SIGTERM) == before

    def test_damaged_middle(self, video, target, tmp_path):
        data = bytearray(video.read_bytes())
        start = data.index(b"mdat")
        middle = start + (len(data) - start) // 4
        data[middle : middle + 600] = b"\xff" * 600
        broken = tmp_path / "broken.mp4"
        broken.write_bytes(data)
        rows = tmp_path / "rows.csv"
        summary = annotate_video(broken, target, unchanged, progress=False, telemetry=rows)
        assert 1 <= summary.missing == 50 - summary.frames_out <= 25
        # What is left keeps its number and its time. What builds on a damaged frame may show an older picture, until
        # the next key frame (each twelfth here).
        table = read_telemetry(rows)
        np.testing.assert_allclose(table["time_s"], table["frame"] / 25, atol=1e-3)
        shown = np.array([number_of(frame) for frame in read_frames(target)])
        lost = sorted({*range(50)} - {*table["frame"]})
        sound = (table["frame"] < lost[0]) | (table["frame"] > lost[-1] + 12)
        assert sound.sum() >= 10 and (shown <= table["frame"]).all()
        np.testing.assert_array_equal(shown[sound], table["frame"][sound])

    def test_error_while_reading(self, video, target, monkeypatch):
        """The frames before it are processed, those after it are not, and the error comes as it was raised."""
        monkeypatch.setattr(annotate, "read_timed_frames", lambda *_, **__: broken_frames(video, 20))
        seen = []
        with pytest.raises(VideoError, match="frame 20 is damaged"):
            annotate_video(video, target, lambda frame: seen.append(number_of(frame)) or frame, progress=False)
        assert seen == list(range(20))
        self.assert_untouched(target)

    def test_error_while_writing(self, video, target, monkeypatch):
        """It stops the run soon, not at its end."""
        monkeypatch.setattr(VideoWriter, "encode", broken_encode)
        seen = []
        with pytest.raises(OSError, match=r"drive\.mp4: cannot be written \(No space left"):
            annotate_video(video, target, lambda frame: seen.append(0) or frame, progress=False)
        assert 10 <= len(seen) <= 15
        self.assert_untouched(target)

    def test_error_while_writing_the_last_frames(self, video, target, monkeypatch):
        monkeypatch.setattr(VideoWriter, "encode", broken_encode)
        with pytest.raises(OSError, match="No space left"):
            annotate_video(video, target, unchanged, progress=False, end_s=0.4)
        self.assert_untouched(target)

    @pytest.mark.parametrize("fails", [True, False])
    def test_no_thread_is_left(self, video, tmp_path, fails):
        before = threading.active_count()
        with pytest.raises(ZeroDivisionError) if fails else nullcontext():
            annotate_video(video, tmp_path / "out.mp4", (lambda frame: 1 / 0) if fails else unchanged, progress=False)
        assert threading.active_count() == before

    def test_other_suffix(self, video, tmp_path):
        with pytest.raises(VideoError, match=r"out\.avi: .*\.mp4"):
            annotate_video(video, tmp_path / "out.avi", unchanged, progress=False)

    def test_onto_itself(self, video):
        before = video.read_bytes()
        with pytest.raises(VideoError, match="is the source itself"):
            annotate_video(video, video, unchanged, progress=False)
        assert video.read_bytes() == before

    @pytest.mark.parametrize("name", ["file/out.mp4", "long" * 62 + "out.mp4"])
    def test_unwritable_target_is_known_before_the_work(self, video, tmp_path, name):
        (tmp_path / "file").write_text("not a folder")
        calls = []
        with pytest.raises(OSError, match=r"out\.mp4: cannot be written"):
            annotate_video(video, tmp_path / name, calls.append, progress=False)
        assert not calls
        assert [path.name for path in tmp_path.iterdir()] == ["file"]

    def test_unwritable_telemetry_is_known_before_the_work(self, video, target, tmp_path):
        (tmp_path / "file").write_text("not a folder")
        calls = []
        with pytest.raises(OSError, match=r"rows\.csv: cannot be written"):
            annotate_video(video, target, calls.append, progress=False, telemetry=tmp_path / "file" / "rows.csv")
        assert not calls
        self.assert_untouched(target)

    def test_missing_source_makes_no_folder(self, tmp_path):
        with pytest.raises(FileNotFoundError, match="nowhere.mp4"):
            annotate_video(tmp_path / "nowhere.mp4", tmp_path / "new" / "out.mp4", unchanged, progress=False)
        assert not (tmp_path / "new").exists()

    def test_writer_without_frames(self, tmp_path):
        with pytest.raises(VideoError, match="no frame was written"), VideoWriter(tmp_path / "out.mp4", fps=25):
            pass
        assert not list(tmp_path.iterdir())


def broken_frames(video: Path, number: int):
    yield from itertools.islice(read_timed_frames(video), number)
    raise VideoError(f"{video}: frame {number} is damaged")


def broken_encode(writer: VideoWriter, frame: av.VideoFrame) -> None:
    """A disk that is full from the tenth frame on."""
    if frame.time >= 9 / 25:
        raise OSError(f"{writer.path}: cannot be written (No space left on device)")


class TestProgress:
    @pytest.mark.parametrize(
        ("stream", "progress", "shown"),
        [("terminal", True, True), ("notebook", True, True), ("file", True, False), ("terminal", False, False)],
    )
    def test_shown_only_where_somebody_watches(self, video, tmp_path, monkeypatch, stream, progress, shown):
        kind = type("OutStream", (io.StringIO,), {"isatty": lambda _: stream == "terminal"})
        kind.__module__ = "ipykernel.iostream" if stream == "notebook" else "io"
        monkeypatch.setattr(sys, "stderr", kind())
        annotate_video(video, tmp_path / "out.mp4", unchanged, progress=progress, start_s=1.0)
        last = sys.stderr.getvalue().rpartition("\r")[2]
        assert bool(re.search(r"25/25 \[\d\d:\d\d<00:00, +[\d.]+frame/s", last)) == shown
        assert bool(last) == shown


class TestClip:
    """What the course does with moviepy; the numbers are those that it tells."""

    def test_moviepy_with_a_drawing_function(self, video, tmp_path):
        def process(frame):
            assert not frame.flags.writeable
            return draw.write_text(frame, "hello")

        with open_clip(video, start_s=0.4, end_s=0.8) as clip:
            clip.image_transform(process).write_videofile(str(tmp_path / "out.mp4"), audio=False, logger=None)
        info = inspect_video(tmp_path / "out.mp4")
        assert (info.frames, info.width, info.height) == (10, *SIZE)

    def test_moviepy_calls_once_too_often(self, video):
        calls = []
        with open_clip(video, end_s=0.6) as clip:
            frames = list(clip.image_transform(lambda frame: calls.append(0) or frame).iter_frames())
        assert (len(frames), len(calls)) == (15, 16)

    def test_piece_behind_the_end(self, video):
        with pytest.raises(VideoError, match="lasts 2.0 s"):
            open_clip(video, start_s=3)

    def test_bad_file(self, tmp_path):
        (tmp_path / "drive.mp4").write_text("no video")
        with pytest.raises(VideoError, match="cannot be read as a video"):
            open_clip(tmp_path / "drive.mp4")


REAL = Path(os.environ.get("LANES_DATA", Path(__file__).parents[4] / "shared" / "real")) / "test_videos"


@pytest.mark.skipif(not (REAL / "project_video_0513.mp4").is_file(), reason="the real drives are not here")
def test_real_clip_that_was_cut_without_encoding(tmp_path):
    """It stores 91 frames, of which the first three serve only to decode the others."""
    source = REAL / "project_video_0513.mp4"
    summary = annotate_video(source, tmp_path / "out.mp4", lambda f: f[::4, ::4], end_s=1.0, progress=False)
    assert (inspect_video(source).frames, summary.frames_out, summary.fps) == (88, 25, 25.0)
    assert (summary.width, summary.height) == (320, 180)
