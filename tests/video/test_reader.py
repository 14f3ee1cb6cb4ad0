"""Reading: all frames, once and in order, of every format; damaged, dangerous and
unusable files.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from av.bitstream import BitStreamFilterContext

from lanes.errors import VideoError
from lanes.recording import MAX_PIXELS
from lanes.video import reader
from lanes.video.images import as_stored, make_upright
from lanes.video.reader import (
    inspect_video,
    open_video,
    read_timed_frames,
    read_video,
)
from lanes.video.sources import sample_images
from lanes.video.writer import process_video
from tests.support.clips import add_tone, encode
from tests.video.sample_videos import (
    NTSC,
    SIZE,
    make_video,
    number_of,
    numbered,
    set_matrix,
    state_turns,
    unchanged,
)


def numbers_in(path: Path, **part: float) -> list[int]:
    """The numbers that the frames of a video show."""
    return [number_of(image) for image in read_video(path, **part)]


@dataclass(frozen=True)
class Format:
    """How to encode six frames; `bars_px` are black rows above and below the image."""

    suffix: str = "mp4"
    codec: str = "libx264"
    pixels: str = "yuv420p"
    options: dict[str, str] = field(default_factory=dict)
    fps: int = 30
    size: tuple[int, int] = SIZE
    bars_px: int = 0

    def image(self, number: int) -> np.ndarray:
        bars = (self.bars_px, self.bars_px)
        return np.pad(numbered(number, self.size), (bars, (0, 0), (0, 0)))

    def encode(self, folder: Path) -> Path:
        if self.codec not in av.codecs_available:
            pytest.skip(f"this build of PyAV has no encoder {self.codec}")
        return encode(
            folder / f"drive.{self.suffix}",
            map(self.image, range(6)),
            self.codec,
            self.pixels,
            fps=self.fps,
            options=self.options,
        )


HEVC_OPTIONS = {"preset": "ultrafast", "x265-params": "log-level=none"}
VP9_OPTIONS = {"deadline": "realtime", "cpu-used": "8"}
FORMATS = {
    "HEVC 10 bit": Format("mp4", "libx265", "yuv420p10le", HEVC_OPTIONS),
    "VP9": Format("webm", "libvpx-vp9", options=VP9_OPTIONS),
    "AV1": Format("mp4", "libsvtav1", options={"preset": "12"}),
    "MJPEG": Format("avi", "mjpeg", "yuvj420p"),
    "interlaced": Format(options={"x264-params": "tff=1"}),
    "4:4:4": Format(pixels="yuv444p"),
    "gray 16 bit": Format("mkv", "ffv1", "gray16le"),
    "alpha": Format("mov", "png", "rgba"),
    "240 fps": Format(fps=240),
    "portrait": Format(size=(160, 284)),
    "letterbox": Format(bars_px=16),
}


@pytest.fixture(params=["read", "written"])
def recoded(request, tmp_path, name) -> Path:
    """A video of a format, or the one that is made from it."""
    path = FORMATS[name].encode(tmp_path)
    if request.param == "read":
        return path
    process_video(path, tmp_path / "out.mp4", unchanged, progress=False)
    return tmp_path / "out.mp4"


class TestFormatsOfPhonesAndDashcams:
    @pytest.mark.parametrize("name", FORMATS)
    def test_frames_and_rate_are_known(self, recoded, name):
        info = inspect_video(recoded)
        assert (info.frames, info.missing) == (6, 0)
        assert info.fps == FORMATS[name].fps

    @pytest.mark.parametrize("name", FORMATS)
    def test_every_frame_comes_once_and_in_order(self, recoded, name):
        bars_px = FORMATS[name].bars_px
        frames = [image[: len(image) - bars_px] for image in read_video(recoded)]
        assert [number_of(frame) for frame in frames] == list(range(6))

    @pytest.mark.parametrize("name", FORMATS)
    def test_images_have_the_size_of_the_source(self, recoded, name):
        image = next(read_video(recoded))
        assert image.shape == FORMATS[name].image(0).shape
        assert image.dtype == np.uint8

    @pytest.mark.parametrize("name", ["letterbox"])
    def test_bars_are_black(self, recoded):
        *_, fourth, _, _ = read_video(recoded)
        assert fourth[:14].max() < 30

    @pytest.mark.parametrize("name", ["gray 16 bit"])
    def test_gray_is_without_colour(self, recoded):
        image = next(read_video(recoded)).astype(int)
        assert np.ptp(image, axis=2).max() <= 2


@pytest.mark.parametrize("suffix", ["mp4", "avi"])
def test_a_video_without_frames_is_refused(tmp_path, suffix):
    path = tmp_path / f"hollow.{suffix}"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height = SIZE
        stream.pix_fmt = "yuv420p"
        container.start_encoding()
    with pytest.raises(VideoError, match=r"hollow\..*holds no frame"):
        inspect_video(path)


def test_sound_without_video_is_refused(tmp_path):
    path = tmp_path / "sound.mp4"
    with av.open(str(path), "w") as container:
        track = container.add_stream("aac", rate=48000, layout="mono")
        add_tone(container, track, 0.0, 0.2)
    words = "holds no frame of a video .its streams: audio"
    with pytest.raises(VideoError, match=words):
        inspect_video(path)


class TestParts:
    def test_frames_keep_their_numbers(self, video):
        frames = read_timed_frames(video, start_s=1.6, end_s=9)
        assert [frame.number for frame in frames] == list(range(40, 50))

    def test_the_end_is_left_out(self, video):
        assert numbers_in(video, start_s=1.0, end_s=1.2) == list(range(25, 30))

    @pytest.mark.parametrize(
        ("part", "words"),
        [
            ({"start_s": 2.5}, "no frame at or after 2.5 s"),
            ({"start_s": 1.5, "end_s": 1.0}, "start_s < end_s"),
        ],
    )
    def test_one_that_does_not_exist_is_refused(self, video, part, words):
        with pytest.raises(VideoError, match=words):
            next(read_video(video, **part))


CORNERS = np.zeros((96, 160, 3), np.uint8)
CORNERS[:48, :80] = (250, 0, 0)
CORNERS[:48, 80:] = (0, 250, 0)
CORNERS[48:, :80] = (0, 0, 250)
# Display matrix by EXIF orientation: to the right on screen for a step to the right and
# one down in the image, then down on screen.
MATRICES = {
    1: (1, 0, 0, 1),
    2: (-1, 0, 0, 1),
    3: (-1, 0, 0, -1),
    4: (1, 0, 0, -1),
    5: (0, 1, 1, 0),
    6: (0, 1, -1, 0),
    7: (0, -1, -1, 0),
    8: (0, -1, 1, 0),
}


class TestDisplayMatrix:
    """It maps (column, row) in the image to that on screen, as players do."""

    @pytest.fixture
    def shown(self, tmp_path, orientation) -> Path:
        stored = encode(tmp_path / "stored.mp4", [CORNERS] * 2)
        set_matrix(stored, tmp_path / "shown.mp4", *MATRICES[orientation])
        return tmp_path / "shown.mp4"

    @pytest.mark.parametrize("orientation", MATRICES)
    def test_each_corner_lands_where_it_says(self, shown, orientation):
        a, b, c, d = MATRICES[orientation]
        image = next(read_video(shown))
        for y in (-1, 1):  # from the centre
            for x in (-1, 1):
                right = a * x + c * y
                down = b * x + d * y
                seen = image[-(down > 0), -(right > 0)]
                np.testing.assert_allclose(seen, CORNERS[-(y > 0), -(x > 0)], atol=12)

    @pytest.mark.parametrize("orientation", MATRICES)
    def test_the_size_is_that_on_screen(self, shown, orientation):
        size = (96, 160) if orientation >= 5 else (160, 96)
        info = inspect_video(shown)
        assert (info.width, info.height) == size
        assert next(read_video(shown)).shape[1::-1] == size

    @pytest.mark.parametrize("orientation", MATRICES)
    def test_orientation_and_mirroring_are_known(self, shown, orientation):
        a, b, c, d = MATRICES[orientation]
        info = inspect_video(shown)
        assert info.orientation == orientation
        assert info.mirrored == (a * d - b * c < 0)

    @pytest.mark.parametrize("orientation", MATRICES)
    def test_turning_has_an_inverse(self, orientation):
        upright = make_upright(CORNERS, orientation)
        np.testing.assert_array_equal(as_stored(upright, orientation), CORNERS)


class TestTurnsInTheStream:
    """A message of display orientation holds for the stream until the next one."""

    @pytest.fixture(params=["ts", "mp4", "avi", "h264", "hevc in ts"])
    def encode_turned(self, request, tmp_path) -> Callable[[dict[int, int]], Path]:
        """A function that encodes 75 frames with these turns in degrees."""
        suffix = request.param.split()[-1]
        codec = "libx265" if "hevc" in request.param else "libx264"
        options = {"preset": "ultrafast", "g": "12"}
        if codec == "libx265":
            options["x265-params"] = "log-level=none:bframes=0:keyint=12"

        def run(turns: dict[int, int]) -> Path:
            images = map(numbered, range(75))
            edit = state_turns(codec, turns)
            path = tmp_path / f"turned.{suffix}"
            return encode(path, images, codec, options=options, edit=edit)

        return run

    @pytest.mark.parametrize("start_s", [0.0, 2.0])
    @pytest.mark.parametrize(("degrees", "orientation"), [(90, 8), (180, 3), (270, 6)])
    def test_one_holds_for_all_frames(
        self, encode_turned, degrees, orientation, start_s
    ):
        path = encode_turned({0: degrees})
        info = inspect_video(path)
        images = list(read_video(path, start_s=start_s))
        assert info.orientation == orientation
        assert {image.shape[1::-1] for image in images} == {(info.width, info.height)}
        stored = [np.rot90(image, -degrees // 90) for image in images]
        assert [*map(number_of, stored)] == list(range(round(25 * start_s), 75))

    @pytest.mark.parametrize("start_s", [0.0, 2.0])
    @pytest.mark.parametrize("turns", [{30: 180}, {0: 180, 30: 0}, {0: 180, 30: None}])
    def test_another_one_holds_from_its_frame_on(self, encode_turned, turns, start_s):
        for frame in read_timed_frames(encode_turned(turns), start_s=start_s):
            is_turned = (frame.number >= 30) == (turns[30] == 180)
            image = np.rot90(frame.image, 2) if is_turned else frame.image
            assert number_of(image) == frame.number

    @pytest.mark.parametrize(
        ("stated", "orientation"),
        [("rotate=90", 8), ("flip=horizontal", 2), ("rotate=90:flip=horizontal", 5)],
    )
    def test_messages_of_ffmpeg_are_understood(self, tmp_path, stated, orientation):
        """It writes one before the first frame, and others behind key frames."""
        source = make_video(tmp_path / "source.mp4", 30)
        path = tmp_path / "turned.mp4"
        name = f"h264_metadata=display_orientation=insert:{stated}"
        with av.open(str(source)) as plain, av.open(str(path), "w") as turned:
            stream = plain.streams.video[0]
            output = turned.add_stream_from_template(stream)
            added = BitStreamFilterContext(name, stream, output)
            for packet in plain.demux(stream):
                for changed in added.filter(packet) if packet.size else []:
                    changed.stream = output
                    turned.mux(changed)

        stored = [as_stored(image, orientation) for image in read_video(path)]
        assert [*map(number_of, stored)] == list(range(30))

    def test_a_quarter_turn_is_reported_with_its_time(self, encode_turned):
        path = encode_turned({0: 0, 30: 90})
        change = r"changes from 160x96 to 96x160 pixels at 1\.20 s; cut it there"
        with pytest.raises(VideoError, match=change):
            list(read_video(path))
        assert len(list(read_video(path, end_s=1.2))) == 30
        assert len(list(read_video(path, start_s=1.2))) == 45


class TestSquarePixels:
    """Anamorphic video of DV and HDV cameras: a square in the world is one in the
    image. 9:1 is nonsense.
    """

    SIZES = pytest.mark.parametrize(
        ("aspect", "orientation", "size"),
        [
            ((16, 11), 1, (233, 96)),
            ((8, 9), 1, (160, 108)),
            ((4, 3), 6, (96, 213)),
            ((9, 1), 1, SIZE),
        ],
    )

    @pytest.fixture
    def anamorphic(self, tmp_path, aspect, orientation) -> Path:
        header = {"sample_aspect_ratio": Fraction(*aspect)}
        path = make_video(tmp_path / "a.mp4", 5, header=header)
        if orientation == 1:
            return path
        set_matrix(path, tmp_path / "b.mp4", *MATRICES[orientation])
        return tmp_path / "b.mp4"

    @SIZES
    def test_images_have_them(self, anamorphic, size):
        info = inspect_video(anamorphic)
        assert (info.width, info.height) == size
        assert {image.shape[1::-1] for image in read_video(anamorphic)} == {size}

    @SIZES
    def test_the_written_video_has_them_and_an_even_size(
        self, anamorphic, size, tmp_path
    ):
        out = tmp_path / "out.mp4"
        width, height = size
        padding = ((0, height % 2), (0, width % 2), (0, 0))

        written = process_video(anamorphic, out, unchanged, progress=False)

        assert written.width == width + width % 2
        assert written.height == height + height % 2
        *_, image = read_video(anamorphic)
        *_, shown = read_video(out)
        padded = np.pad(image.astype(int), padding, "edge")
        assert np.abs(shown - padded).max() < 100


@pytest.mark.parametrize(
    ("matrix", "name"), [(8, "YCgCo"), (10, "bt2020c"), (14, "ICtCp")]
)
def test_colours_that_cannot_be_converted_are_named(tmp_path, matrix, name):
    """YCgCo, BT.2020 with constant luminance, ICtCp: converted, or refused with file,
    fault and remedy.
    """
    path = tmp_path / "a.mp4"
    options = {"x264-params": f"colormatrix={name}"}
    encode(path, map(numbered, range(5)), options=options)
    assert inspect_video(path).frames == 5
    try:
        assert numbers_in(path) == list(range(5))
    except VideoError as error:
        fault = f"its colours cannot be converted to RGB (matrix {matrix} of "
        assert str(error).startswith(f"{path}: {fault}")
        assert str(error).endswith("export it with the colours of BT.709.")


class TestContainers:
    """Also those where a seek ends too late or is not possible, and those without
    presentation times.
    """

    OF_EACH = pytest.mark.parametrize(
        ("suffix", "fps"),
        [("mp4", 25), ("mkv", NTSC), ("ts", 25), ("mpg", 25), ("h264", 25)],
    )

    @pytest.fixture
    def path(self, tmp_path, suffix, fps) -> Path:
        """100 frames; that in Matroska has sound."""
        codec = "libx264"
        options = {"preset": "veryfast", "g": "100", "bf": "2"}
        if suffix == "mpg":
            codec = "mpeg2video"
            options = {}
        return encode(
            tmp_path / f"a.{suffix}",
            map(numbered, range(100)),
            codec,
            options=options,
            fps=fps,
            sound="aac" if suffix == "mkv" else (),
        )

    @OF_EACH
    def test_the_properties_are_known(self, path, suffix, fps):
        info = inspect_video(path)
        assert (info.width, info.height) == (160, 96)
        assert (info.frames, info.missing) == (100, 0)
        assert info.has_audio == (suffix == "mkv")
        assert info.fps == pytest.approx(float(fps), abs=1e-3)
        assert info.duration_s == pytest.approx(100 / float(fps), abs=1e-3)

    @OF_EACH
    @pytest.mark.parametrize(("first", "end"), [(0, 25), (33, 100), (88, 100)])
    def test_a_part_begins_where_it_should(self, path, fps, first, end):
        start_s = max(first - 0.5, 0) / float(fps)
        end_s = (end - 0.5) / float(fps)
        found = list(read_timed_frames(path, start_s=start_s, end_s=end_s))
        expected = list(range(first, end))
        assert [number_of(frame.image) for frame in found] == expected
        assert [frame.number for frame in found] == expected
        times_s = [frame.time_s for frame in found]
        np.testing.assert_allclose(times_s, np.array(expected) / float(fps), atol=1e-3)


@pytest.mark.parametrize(
    ("name", "shift_s", "first"),
    [("clip.mp4", Fraction(-5, 25), 5), ("late.mkv", Fraction(5), 0)],
)
def test_a_cut_without_encoding_lacks_nothing(video, tmp_path, name, shift_s, first):
    """It keeps the frames from the key frame before, which are not shown; nor does a
    late begin mean a loss.
    """
    path = tmp_path / name
    with av.open(str(video)) as source, av.open(str(path), "w") as target:
        output = target.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(video=0):
            if packet.size:
                ticks = round(shift_s / packet.time_base)
                packet.pts += ticks
                packet.dts += ticks
                packet.stream = output
                target.mux(packet)
    info = inspect_video(path)
    assert (info.frames, info.missing) == (50 - first, 0)
    assert numbers_in(path) == list(range(first, 50))


# Playlists, huge sizes, cut off files, changing sizes.

PLAYLISTS = {
    "dash": '<MPD xmlns="urn:mpeg:dash:schema:mpd:2011"><Period>'
    "<BaseURL>drive.mp4</BaseURL></Period></MPD>",
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
    words = r"list\.mp4: cannot be read as a video .*playlist"
    with pytest.raises(VideoError, match=words):
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


def test_a_huge_size_in_the_header_is_refused(video, monkeypatch):
    monkeypatch.setattr(reader, "MAX_PIXELS", 160 * 96 - 1)
    words = r"drive\.mp4: .*(cannot be read as a video|can be decoded)"
    with pytest.raises(VideoError, match=words):
        inspect_video(video)


def test_the_largest_size_is_that_of_the_documentation():
    """docs/robustness.md."""
    assert 7680 * 4320 < MAX_PIXELS <= 128_000_000


class TestDamagedFrames:
    """Packets are damaged or missing."""

    @pytest.fixture(params=["mp4", "mkv"])
    def damaged(self, request, tmp_path) -> Path:
        path = make_video(tmp_path / f"drive.{request.param}", 100, size=(320, 192))
        data = bytearray(path.read_bytes())
        noise = np.random.default_rng(1)
        shares = (0.3, 0.45, 0.55, 0.7)
        if request.param == "mkv":  # finds no way back in after the second time
            shares = (0.4,)
        for share in shares:
            at = int(share * len(data))
            data[at : at + 1500] = noise.integers(0, 256, 1500, np.uint8).tobytes()
        path.write_bytes(data)
        return path

    def test_are_counted_by_time_stamps(self, damaged):
        info = inspect_video(damaged)
        assert info.frames + info.missing == 100
        assert info.duration_s == pytest.approx(4, abs=0.05)

    def test_the_others_are_read_once_and_in_order(self, damaged):
        numbers = [frame.number for frame in read_timed_frames(damaged)]
        assert 30 <= len(numbers) <= 96
        assert numbers == sorted(set(numbers))

    def test_the_others_keep_their_numbers_and_times(self, damaged):
        frames = list(read_timed_frames(damaged))
        assert number_of(frames[5].image) == 5
        times_s = [frame.time_s for frame in frames]
        expected_s = [frame.number / 25 for frame in frames]
        np.testing.assert_allclose(times_s, expected_s, atol=1e-3)


def cut(path: Path, share: float, target: Path) -> Path:
    data = path.read_bytes()
    target.write_bytes(data[: int(share * len(data))])
    return target


class TestCutOff:
    """Only these store their length, so that the missing frames are counted; of an mp4
    the index must come first.
    """

    @pytest.fixture(params=["mkv", "avi", "mp4"])
    def cut_off(self, request, tmp_path) -> Path:
        path = make_video(tmp_path / f"drive.{request.param}", 250)
        if request.param == "mp4":
            process_video(path, tmp_path / "fast.mp4", unchanged, progress=False)
            path = tmp_path / "fast.mp4"
        return cut(path, 0.6, tmp_path / f"cut.{request.param}")

    def test_frames_are_read_up_to_there(self, cut_off):
        """The packet at the cut, and those that refer to it, may be incomplete."""
        numbers = numbers_in(cut_off)
        frames = inspect_video(cut_off).frames
        assert numbers == list(range(len(numbers)))
        assert frames - 4 <= len(numbers) <= frames
        assert 0.3 < len(numbers) / 250 < 0.72

    def test_the_others_are_counted(self, cut_off):
        info = inspect_video(cut_off)
        assert info.frames + info.missing == 250
        assert info.duration_s == pytest.approx(info.frames / 25, abs=0.2)

    def test_a_clock_that_begins_later_changes_no_count(self, tmp_path):
        """An flv states its length, not the end on its clock."""
        numbers = range(50, 300)
        path = make_video(tmp_path / "drive.flv", 250, numbers=numbers)
        info = inspect_video(cut(path, 0.6, tmp_path / "cut.flv"))
        assert info.frames < 200
        assert info.frames + info.missing == 250

    @pytest.mark.parametrize("end_s", [None, 99.0])
    def test_the_written_video_counts_them_too(self, cut_off, tmp_path, end_s):
        out = tmp_path / "out.mp4"
        written = process_video(cut_off, out, unchanged, end_s=end_s, progress=False)
        assert written.missing == 250 - len(numbers_in(cut_off))

    def test_an_mp4_without_its_index_is_refused(self, tmp_path):
        path = make_video(tmp_path / "drive.mp4", 250)
        half = cut(path, 0.5, tmp_path / "half.mp4")
        with pytest.raises(VideoError, match=r"half\.mp4: .*(cut off|no frame)"):
            inspect_video(half)


class TestAChangeOfSize:
    """Three seconds of 160x96 pixels, then three of 320x192."""

    CHANGE = r"both\.ts: changes from 160x96 to 320x192 pixels at 3\.00 s; cut it there"

    @pytest.fixture
    def both(self, tmp_path) -> Path:
        small = make_video(tmp_path / "small.ts", 75, size=(160, 96))
        large = make_video(tmp_path / "large.ts", 75, size=(320, 192))
        path = tmp_path / "both.ts"
        path.write_bytes(small.read_bytes() + large.read_bytes())
        return path

    @pytest.mark.parametrize("start_s", [0.0, 1.0, 2.6])
    def test_is_reported_with_its_time(self, both, start_s):
        seen = []
        with pytest.raises(VideoError, match=self.CHANGE):
            seen.extend(read_video(both, start_s=start_s))
        assert numbers_in(both, start_s=start_s, end_s=3.0)[-1] == 74

    @pytest.mark.parametrize("start_s", [3.0, 3.4, 5.0])
    def test_a_part_behind_it_has_the_other_size(self, both, start_s):
        info = inspect_video(both, start_s=start_s)
        images = list(read_video(both, start_s=start_s))
        assert (info.width, info.height) == (320, 192)
        assert {image.shape for image in images} == {(192, 320, 3)}
        assert number_of(images[0]) == round(25 * start_s) - 75

    def test_samples_of_both_sizes_are_refused_with_its_time(self, both):
        """They are so far apart that the frames between them are not read."""
        with pytest.raises(VideoError, match=self.CHANGE):
            list(sample_images([both], 2))


@pytest.mark.parametrize("fps", [Fraction(1, 50), 5000])
def test_impossible_frame_rates_are_refused(tmp_path, fps):
    path = make_video(tmp_path / "odd.mp4", 3, fps=fps)
    words = r"odd\.mp4: has an implausible .* frames per second"
    with pytest.raises(VideoError, match=words):
        inspect_video(path)
