"""Reading: all frames, once and in order, of every format; damaged, dangerous and
unusable files.
"""

from __future__ import annotations

import struct
from fractions import Fraction

import av
import numpy as np
import pytest

from lanes.errors import VideoError
from lanes.recording import MAX_PIXELS
from lanes.video import reader
from lanes.video.images import as_stored, make_upright
from lanes.video.reader import inspect_video, open_video, read_timed_frames, read_video
from lanes.video.writer import process_video
from tests.support.clips import add_tone, encode
from tests.video.sample_videos import (
    NTSC,
    SIZE,
    make_video,
    number_of,
    numbered,
    set_matrix,
    set_rotation,
    unchanged,
)

FRAMES = 6


# Suffix of a file, and how to encode it.
FORMATS = {
    "HEVC 10 bit": (
        "mp4",
        "libx265",
        "yuv420p10le",
        {"preset": "ultrafast", "x265-params": "log-level=none"},
    ),
    "VP9": ("webm", "libvpx-vp9", "yuv420p", {"deadline": "realtime", "cpu-used": "8"}),
    "AV1": ("mp4", "libsvtav1", "yuv420p", {"preset": "12"}),
    "MJPEG": ("avi", "mjpeg", "yuvj420p", {}),
    "interlaced": ("mp4", "libx264", "yuv420p", {"x264-params": "tff=1"}),
    "4:4:4": ("mp4", "libx264", "yuv444p", {}),
    "gray 16 bit": ("mkv", "ffv1", "gray16le", {}),
    "alpha": ("mov", "png", "rgba", {}),
    "240 fps": ("mp4", "libx264", "yuv420p", {}),
    "portrait": ("mp4", "libx264", "yuv420p", {}),
    "letterbox": ("mp4", "libx264", "yuv420p", {}),
}


@pytest.mark.parametrize("name", FORMATS)
def test_formats_of_phones_and_dashcams(tmp_path, name):
    """Every frame once and in order, at the rate and in the size of the source."""
    suffix, codec, pixels, options = FORMATS[name]
    if codec not in av.codecs_available:
        pytest.skip(f"this build of PyAV has no encoder {codec}")
    fps = 240 if "fps" in name else 30
    bars_px = 16 if name == "letterbox" else 0  # above and below the image
    size = (160, 284) if name == "portrait" else SIZE
    images = [
        np.pad(numbered(number, size), ((bars_px, bars_px), (0, 0), (0, 0)))
        for number in range(FRAMES)
    ]
    path = encode(
        tmp_path / f"drive.{suffix}", images, codec, pixels, fps=fps, options=options
    )
    process_video(path, tmp_path / "out.mp4", unchanged, progress=False)
    for file in (path, tmp_path / "out.mp4"):
        info = inspect_video(file)
        frames = list(read_video(file))
        assert (info.frames, info.missing, info.fps) == (FRAMES, 0, fps)
        assert (frames[0].shape, frames[0].dtype) == (images[0].shape, np.uint8)
        assert [number_of(frame[: len(frame) - bars_px]) for frame in frames] == list(
            range(FRAMES)
        )
        assert bars_px == 0 or frames[3][: bars_px - 2].max() < 30
        assert "gray" not in name or np.ptp(frames[0].astype(int), axis=2).max() <= 2


@pytest.mark.parametrize(
    ("suffix", "hollow"), [("mp4", True), ("avi", True), ("mp4", False)]
)
def test_videos_without_frames_and_sound_without_video(tmp_path, suffix, hollow):
    path = tmp_path / f"hollow.{suffix}"
    with av.open(str(path), "w") as container:
        if hollow:
            stream = container.add_stream("libx264", rate=25)
            stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
            container.start_encoding()
        else:
            add_tone(
                container,
                container.add_stream("aac", rate=48000, layout="mono"),
                0.0,
                0.2,
            )
    sentence = (
        r"hollow\..*holds no frame"
        if hollow
        else "holds no frame of a video .its streams: audio"
    )
    with pytest.raises(VideoError, match=sentence):
        inspect_video(path)


def test_part_that_does_not_exist(video):
    assert [
        frame.number for frame in read_timed_frames(video, start_s=1.6, end_s=9)
    ] == list(range(40, 50))
    assert [
        number_of(image) for image in read_video(video, start_s=1.0, end_s=1.2)
    ] == list(range(25, 30))
    with pytest.raises(VideoError, match="no frame at or after 2.5 s"):
        next(read_video(video, start_s=2.5))
    with pytest.raises(VideoError, match="start_s < end_s"):
        next(read_video(video, start_s=1.5, end_s=1.0))


@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_display_matrix_turns_and_mirrors_as_players_do(tmp_path, orientation):
    """Each corner of the stored image lands where the matrix puts it: (column, row) in
    the image to that on screen.
    """
    path = tmp_path / "stored.mp4"
    target = tmp_path / "shown.mp4"
    corners = np.zeros((96, 160, 3), np.uint8)
    corners[:48, :80], corners[:48, 80:], corners[48:, :80] = (
        (250, 0, 0),
        (0, 250, 0),
        (0, 0, 250),
    )
    encode(path, [corners] * 2)
    # to the right on screen for a step to the right and one down in the image, then
    # down on screen
    matrix = {1: (1, 0, 0, 1), 2: (-1, 0, 0, 1), 3: (-1, 0, 0, -1), 4: (1, 0, 0, -1)}
    matrix |= {5: (0, 1, 1, 0), 6: (0, 1, -1, 0), 7: (0, -1, -1, 0), 8: (0, -1, 1, 0)}
    a, b, c, d = matrix[orientation]
    set_matrix(path, target, a, b, c, d)
    image = next(read_video(target))
    info = inspect_video(target)
    assert (
        image.shape[1::-1]
        == (info.width, info.height)
        == ((160, 96) if b == 0 else (96, 160))
    )
    assert info.mirrored == (a * d - b * c < 0)
    for row, column in ((0, 0), (0, 1), (1, 0), (1, 1)):
        x = 2 * column - 1
        y = 2 * row - 1  # from the centre
        right = a * x + c * y
        down = b * x + d * y
        at = image[(1 + down) // 2 * -1 or 0, (1 + right) // 2 * -1 or 0]
        np.testing.assert_allclose(at, corners[row * -1, column * -1], atol=12)
    assert info.orientation == orientation
    assert (as_stored(make_upright(corners, orientation), orientation) == corners).all()


@pytest.mark.parametrize(
    ("aspect", "degrees", "size"),
    [
        ((16, 11), None, (233, 96)),
        ((8, 9), None, (160, 108)),
        ((4, 3), 90, (96, 213)),
        ((9, 1), None, SIZE),
    ],
)
def test_pixels_are_square(tmp_path, aspect, degrees, size):
    """Anamorphic video of DV and HDV cameras: a square in the world is one in the
    image. 9:1 is nonsense.
    """
    path = make_video(
        tmp_path / "a.mp4", 5, header={"sample_aspect_ratio": Fraction(*aspect)}
    )
    if degrees:
        set_rotation(path, tmp_path / "b.mp4", degrees)
        path = tmp_path / "b.mp4"
    info = inspect_video(path)
    assert (info.width, info.height) == size
    assert {image.shape[1::-1] for image in read_video(path)} == {size}
    written = process_video(path, tmp_path / "out.mp4", unchanged, progress=False)
    assert (written.width, written.height) == (
        size[0] + size[0] % 2,
        size[1] + size[1] % 2,
    )
    image, shown = (
        [*read_video(file)][-1].astype(int) for file in (path, tmp_path / "out.mp4")
    )
    repeated = np.pad(image, ((0, size[1] % 2), (0, size[0] % 2), (0, 0)), "edge")
    assert np.abs(shown - repeated).max() < 100


@pytest.mark.parametrize(
    ("matrix", "name"), [(8, "YCgCo"), (10, "bt2020c"), (14, "ICtCp")]
)
def test_colours_that_cannot_be_converted_are_named(tmp_path, matrix, name):
    """YCgCo, BT.2020 with constant luminance, ICtCp: converted, or refused with file,
    fault and remedy.
    """
    path = tmp_path / "a.mp4"
    encode(
        path, map(numbered, range(5)), options={"x264-params": f"colormatrix={name}"}
    )
    assert inspect_video(path).frames == 5
    try:
        assert [number_of(image) for image in read_video(path)] == list(range(5))
    except VideoError as error:
        assert str(error).startswith(
            f"{path}: its colours cannot be converted to RGB (matrix {matrix} of "
        )
        assert str(error).endswith("export it with the colours of BT.709.")


@pytest.mark.parametrize(
    ("suffix", "fps"),
    [("mp4", 25), ("mkv", NTSC), ("ts", 25), ("mpg", 25), ("h264", 25)],
)
def test_a_part_begins_where_it_should(tmp_path, suffix, fps):
    """Also where a seek ends too late or is not possible, and where the container has
    no presentation times.
    """
    options = {} if suffix == "mpg" else {"preset": "veryfast", "g": "100", "bf": "2"}
    codec = "mpeg2video" if suffix == "mpg" else "libx264"
    sound = "aac" if suffix == "mkv" else None
    path = encode(
        tmp_path / f"a.{suffix}",
        map(numbered, range(100)),
        codec,
        options=options,
        fps=fps,
        sound=sound,
    )
    info = inspect_video(path)
    assert (info.width, info.height, info.frames, info.missing) == (160, 96, 100, 0)
    assert info.has_audio == bool(sound)
    assert info.fps == pytest.approx(float(fps), abs=1e-3)
    assert info.duration_s == pytest.approx(100 / float(fps), abs=1e-3)
    for first, end in ((0, 25), (33, 100), (88, 100)):
        start_s = (first - 0.5) / float(fps) if first else 0.0
        end_s = (end - 0.5) / float(fps)
        found = list(read_timed_frames(path, start_s=start_s, end_s=end_s))
        assert (
            [number_of(f.image) for f in found]
            == [f.number for f in found]
            == list(range(first, end))
        )
        np.testing.assert_allclose(
            [f.time_s for f in found], np.arange(first, end) / float(fps), atol=1e-3
        )


@pytest.mark.parametrize("shift", ["earlier", "later"])
def test_a_cut_without_encoding_lacks_nothing(video, tmp_path, shift):
    """It keeps the frames from the key frame before, which are not shown; nor does a
    late begin mean a loss.
    """
    path = tmp_path / ("clip.mp4" if shift == "earlier" else "late.mkv")
    with av.open(str(video)) as source, av.open(str(path), "w") as target:
        output = target.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(video=0):
            if packet.size:
                ticks = round(
                    (Fraction(-5, 25) if shift == "earlier" else 5) / packet.time_base
                )
                packet.pts, packet.dts, packet.stream = (
                    packet.pts + ticks,
                    packet.dts + ticks,
                    output,
                )
                target.mux(packet)
    first = 5 if shift == "earlier" else 0
    info = inspect_video(path)
    assert (info.frames, info.missing) == (50 - first, 0)
    assert [number_of(frame) for frame in read_video(path)] == list(range(first, 50))


# Playlists, huge sizes, cut off files, changing sizes.

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
    with pytest.raises(
        VideoError, match=r"list\.mp4: cannot be read as a video .*playlist"
    ):
        open_video(path)


def test_a_huge_size_inside_a_video_is_damage(tmp_path):
    """In the headers of all but the first four JPEG images."""
    path = encode(tmp_path / "bomb.avi", map(numbered, range(10)), "mjpeg", "yuvj420p")
    data = bytearray(path.read_bytes())
    at = 0
    for number in range(10):
        at = data.index(b"\xff\xc0", at + 1)
        if number >= 4:
            struct.pack_into(">HH", data, at + 5, 65500, 65500)
    path.write_bytes(data)
    assert [frame.number for frame in read_timed_frames(path)] == [0, 1, 2, 3]
    assert inspect_video(path).frames == 10


def test_a_huge_size_in_the_header_is_refused(video, tmp_path, monkeypatch):
    monkeypatch.setattr(reader, "MAX_PIXELS", 160 * 96 - 1)
    with pytest.raises(
        VideoError, match=r"drive\.mp4: .*(cannot be read as a video|can be decoded)"
    ):
        inspect_video(video)
    assert 7680 * 4320 < MAX_PIXELS <= 128_000_000  # as docs/robustness.md says


@pytest.mark.parametrize("suffix", ["mp4", "mkv"])
def test_damaged_frames_are_counted_by_time_stamps(tmp_path, suffix):
    """The remaining frames keep their numbers and times, whether packets are damaged or
    missing.
    """
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
    assert [frame.number for frame in frames] == sorted(
        {frame.number for frame in frames}
    )
    np.testing.assert_allclose(
        [f.time_s for f in frames], [f.number / 25 for f in frames], atol=1e-3
    )
    assert info.duration_s == pytest.approx(4, abs=0.05)
    assert number_of(frames[5].image) == 5


@pytest.mark.parametrize("suffix", ["mkv", "avi", "mp4"])
def test_cut_off_files_are_read_up_to_there(tmp_path, suffix):
    """Only these store their length, so that the missing frames are counted; of an mp4
    the index must come first.
    """
    path = make_video(tmp_path / f"drive.{suffix}", 250)
    if suffix == "mp4":
        with pytest.raises(VideoError, match=r"half\.mp4: .*(cut off|no frame)"):
            inspect_video(cut(path, 0.5, tmp_path / "half.mp4"))
        process_video(path, tmp_path / "fast.mp4", unchanged, progress=False)
        path = tmp_path / "fast.mp4"
    half = cut(path, 0.6, tmp_path / f"cut.{suffix}")
    info = inspect_video(half)
    numbers = [number_of(image) for image in read_video(half)]
    # The packet at the cut, and those that refer to it, may be incomplete.
    assert info.frames - 4 <= len(numbers) <= info.frames
    assert numbers == list(range(len(numbers)))
    assert info.frames + info.missing == 250
    assert 0.3 < len(numbers) / 250 < 0.72
    assert info.duration_s == pytest.approx(info.frames / 25, abs=0.2)
    for end_s in (None, 99.0):
        written = process_video(
            half, tmp_path / "out.mp4", unchanged, end_s=end_s, progress=False
        )
        assert written.missing == 250 - len(numbers)


def cut(path, share: float, target):
    data = path.read_bytes()
    target.write_bytes(data[: int(share * len(data))])
    return target


def test_a_change_of_size_is_reported_with_its_time(tmp_path):
    parts = [
        make_video(tmp_path / f"{n}.ts", 25, size=size)
        for n, size in enumerate([(160, 96), (320, 192)])
    ]
    path = tmp_path / "both.ts"
    path.write_bytes(b"".join(part.read_bytes() for part in parts))
    seen = []
    with pytest.raises(
        VideoError,
        match=r"both\.ts: changes from 160x96 to 320x192 pixels at 0\.96 s; cut it there",
    ):
        process_video(
            path,
            tmp_path / "out.mp4",
            lambda f: seen.append(number_of(f)) or f,
            progress=False,
        )
    assert seen == list(range(25))


@pytest.mark.parametrize("fps", [Fraction(1, 50), 5000])
def test_impossible_frame_rates_are_refused(tmp_path, fps):
    path = tmp_path / "odd.mp4"
    make_video(path, 3, fps=fps)
    with pytest.raises(
        VideoError, match=r"odd\.mp4: states an implausible .* frames per second"
    ):
        inspect_video(path)
