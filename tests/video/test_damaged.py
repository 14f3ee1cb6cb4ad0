"""Dangerous and damaged video files: playlists, huge sizes, cut off files, clock resets, changing sizes."""

from __future__ import annotations

import struct
from fractions import Fraction

import numpy as np
import pytest

from lanes.errors import VideoError
from lanes.images import MAX_PIXELS
from lanes.video import reader
from lanes.video.reader import inspect_video, open_video, read_timed_frames, read_video
from lanes.video.writer import process_video
from tests.support.clips import encode
from tests.video.sample_videos import make_video, number_of, numbered, unchanged

PLAYLISTS = {
    "dash": '<MPD xmlns="urn:mpeg:dash:schema:mpd:2011"><Period><BaseURL>drive.mp4</BaseURL></Period></MPD>',
    "sdp": "v=0\nc=IN IP4 127.0.0.1\nm=video 5004 RTP/AVP 96\na=rtpmap:96 H264/90000\n",
    "concat": "ffconcat version 1.0\nfile drive.mp4\n",
    "hls": "#EXTM3U\n#EXT-X-TARGETDURATION:2\n#EXTINF:2,\ndrive.mp4\n#EXT-X-ENDLIST\n",
}


@pytest.mark.parametrize("kind", PLAYLISTS)
def test_playlists_are_refused(video, tmp_path, kind):
    """Also if the video that they name is beside them."""
    (tmp_path / "drive.mp4").write_bytes(video.read_bytes())
    path = tmp_path / "list.mp4"
    path.write_text(PLAYLISTS[kind])
    with pytest.raises(VideoError, match=r"list\.mp4: cannot be read as a video .*playlist"):
        open_video(path)


def test_a_huge_size_inside_a_video_is_damage(tmp_path):
    """In the headers of all but the first four JPEG images."""
    path = encode(tmp_path / "bomb.avi", map(numbered, range(10)), "mjpeg", "yuvj420p")
    data, at = bytearray(path.read_bytes()), 0
    for number in range(10):
        at = data.index(b"\xff\xc0", at + 1)
        if number >= 4:
            struct.pack_into(">HH", data, at + 5, 65500, 65500)
    path.write_bytes(data)
    assert [frame.number for frame in read_timed_frames(path)] == [0, 1, 2, 3]
    assert inspect_video(path).frames == 10


def test_a_huge_size_in_the_header_is_refused(video, tmp_path, monkeypatch):
    monkeypatch.setattr(reader, "MAX_PIXELS", 160 * 96 - 1)
    with pytest.raises(VideoError, match=r"drive\.mp4: .*(cannot be read as a video|can be decoded)"):
        inspect_video(video)
    assert 7680 * 4320 < MAX_PIXELS <= 128_000_000  # as docs/robustness.md says


@pytest.mark.parametrize("suffix", ["mp4", "mkv"])
def test_damaged_frames_are_counted_by_time_stamps(tmp_path, suffix):
    """The remaining frames keep their numbers and times, whether packets are damaged or missing."""
    path = make_video(tmp_path / f"drive.{suffix}", 100, size=(320, 192))
    data = bytearray(path.read_bytes())
    noise = np.random.default_rng(1)
    # Matroska finds no way back in after the second time.
    for share in (0.4,) if suffix == "mkv" else (0.3, 0.45, 0.55, 0.7):
        at = int(share * len(data))
        data[at : at + 1500] = noise.integers(0, 256, 1500, np.uint8).tobytes()
    path.write_bytes(data)
    info = inspect_video(path)
    frames = list(read_timed_frames(path))
    assert 30 <= len(frames) <= 96
    assert info.frames + info.missing == 100
    assert [frame.number for frame in frames] == sorted({frame.number for frame in frames})
    np.testing.assert_allclose([f.time_s for f in frames], [f.number / 25 for f in frames], atol=1e-3)
    assert info.duration_s == pytest.approx(4, abs=0.05)
    assert number_of(frames[5].image) == 5


@pytest.mark.parametrize("suffix", ["mkv", "avi", "mp4"])
def test_cut_off_files_are_read_up_to_there(tmp_path, suffix):
    """Only these store their length, so that the missing frames are counted; of an mp4 the index must come first."""
    path = make_video(tmp_path / f"drive.{suffix}", 250)
    if suffix == "mp4":
        with pytest.raises(VideoError, match=r"half\.mp4: .*(cut off|no frame)"):
            inspect_video(cut(path, 0.5, tmp_path / "half.mp4"))
        process_video(path, tmp_path / "fast.mp4", unchanged, progress=False)
        path = tmp_path / "fast.mp4"
    half = cut(path, 0.6, tmp_path / f"cut.{suffix}")
    info, numbers = inspect_video(half), [number_of(image) for image in read_video(half)]
    # The packet at the cut, and those that refer to it, may be incomplete.
    assert info.frames - 4 <= len(numbers) <= info.frames and numbers == list(range(len(numbers)))
    assert info.frames + info.missing == 250 and 0.3 < len(numbers) / 250 < 0.72
    assert info.duration_s == pytest.approx(info.frames / 25, abs=0.2)
    assert process_video(half, tmp_path / "out.mp4", unchanged, progress=False).missing == 250 - len(numbers)


def cut(path, share: float, target):
    data = path.read_bytes()
    target.write_bytes(data[: int(share * len(data))])
    return target


def test_a_change_of_size_is_reported_with_its_time(tmp_path):
    parts = [make_video(tmp_path / f"{n}.ts", 25, size=size) for n, size in enumerate([(160, 96), (320, 192)])]
    path = tmp_path / "both.ts"
    path.write_bytes(b"".join(part.read_bytes() for part in parts))
    seen = []
    with pytest.raises(VideoError, match=r"both\.ts: changes from 160x96 to 320x192 pixels at 0\.96 s; cut it there"):
        process_video(path, tmp_path / "out.mp4", lambda f: seen.append(number_of(f)) or f, progress=False)
    assert seen == list(range(25))


@pytest.mark.parametrize("fps", [Fraction(1, 50), 5000])
def test_impossible_frame_rates_are_refused(tmp_path, fps):
    path = tmp_path / "odd.mp4"
    make_video(path, 3, fps=fps)
    with pytest.raises(VideoError, match=r"odd\.mp4: states an implausible .* frames per second"):
        inspect_video(path)
