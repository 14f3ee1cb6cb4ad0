"""Reading: all frames, once and in order, of every container; unusable files are refused."""

from __future__ import annotations

from fractions import Fraction

import av
import numpy as np
import pytest

from lanes.errors import VideoError
from lanes.video.process import process_video
from lanes.video.reader import inspect_video, read_timed_frames, read_video
from tests.io.video.sample_videos import (
    NTSC,
    SIZE,
    YELLOW,
    add_tone,
    make_video,
    number_of,
    set_rotation,
    unchanged,
)


class TestInspect:
    def test_size_rate_length_and_sound(self, video):
        info = inspect_video(video)
        assert (info.width, info.height, info.fps, info.frames) == (160, 96, 25.0, 50)
        assert (info.duration_s, info.has_audio) == (2.0, True)

    @pytest.mark.parametrize("suffix", ["mkv", "avi", "ts", "mov"])
    def test_counts_frames_of_every_container(self, tmp_path, suffix):
        path = make_video(tmp_path / f"drive.{suffix}", 31, fps=NTSC)
        info = inspect_video(path)
        assert info.frames == 31
        assert info.fps == pytest.approx(30000 / 1001, abs=1e-3)
        assert [number_of(frame) for frame in read_video(path)] == list(range(31))

    def test_frames_that_are_not_shown_do_not_count(self, video, tmp_path):
        """A clip cut between key frames without re-encoding stores frames that are only references for others."""
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
        assert [number_of(frame) for frame in read_video(path)] == list(range(5, 50))

    def test_missing_file(self, tmp_path):
        with pytest.raises(FileNotFoundError, match="nowhere.mp4: there is no such video"):
            inspect_video(tmp_path / "nowhere.mp4")

    @pytest.mark.parametrize(
        ("content", "sentence"),
        [(b"", "the file is empty"), (b"this is no video at all\n" * 50, "cannot be read as a video")],
    )
    def test_files_that_are_not_a_video(self, tmp_path, content, sentence):
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

    def test_cut_off_with_the_index_at_the_end(self, video, tmp_path):
        path = tmp_path / "cut.mp4"
        path.write_bytes(video.read_bytes()[: video.stat().st_size // 2])
        with pytest.raises(VideoError, match="cut off"):
            inspect_video(path)

    def test_cut_off_with_the_index_at_the_start(self, video, tmp_path):
        process_video(video, tmp_path / "whole.mp4", unchanged, progress=False)
        path = tmp_path / "cut.mp4"
        path.write_bytes((tmp_path / "whole.mp4").read_bytes()[:-3000])
        with pytest.raises(VideoError, match=r"cut\.mp4: .*(cut off after|damaged)"):
            inspect_video(path)


class TestRead:
    def test_frames_are_rgb_and_writable(self, video):
        frame = next(read_video(video))
        frame[0, 0] = 1
        np.testing.assert_allclose(frame[20, 80], YELLOW, atol=4)

    @pytest.mark.parametrize(
        ("start_s", "end_s", "first", "last"), [(0, None, 0, 49), (0.4, 1, 10, 24), (1.6, 9, 40, 49)]
    )
    def test_piece(self, video, start_s, end_s, first, last):
        frames = list(read_timed_frames(video, start_s=start_s, end_s=end_s))
        assert [number_of(f.image) for f in frames] == [f.number for f in frames] == list(range(first, last + 1))
        assert frames[0].time_s == pytest.approx(first / 25)

    def test_part_after_the_end(self, video):
        with pytest.raises(VideoError, match="no frame at or after 2.5 s"):
            next(read_video(video, start_s=2.5))

    def test_part_that_ends_before_it_starts(self, video):
        with pytest.raises(VideoError, match="start_s < end_s"):
            next(read_video(video, start_s=1.5, end_s=1.0))

    @pytest.mark.parametrize(("degrees", "corner"), [(90, (0, -1)), (180, (-1, -1)), (270, (-1, 0))])
    def test_rotated_camera(self, tmp_path, degrees, corner):
        """The top left corner of the stored frame lands where the display matrix puts it."""
        path = make_video(tmp_path / "upright.mp4", 2)
        turned = tmp_path / "turned.mp4"
        set_rotation(path, turned, degrees)
        marked = next(read_video(turned))
        assert marked.shape[:2] == ((160, 96) if degrees % 180 else (96, 160))
        info = inspect_video(turned)
        assert (info.height, info.width) == marked.shape[:2]
        # The stored top half is yellow, the bottom half dark: find where the top went.
        top = {90: marked[:, -20:], 180: marked[-20:], 270: marked[:, :20]}[degrees]
        np.testing.assert_allclose(top.mean(axis=(0, 1)), YELLOW, atol=6)
