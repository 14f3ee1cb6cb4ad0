"""Times of frames: AVI with dropped frames, late and early sound, two recordings on one
clock, outliers of time.

The table and the video that are written must have each frame at its own time, as those
of every command.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import partial
from pathlib import Path

import av
import numpy as np
import pytest

from lanes.files import read_telemetry
from lanes.video.reader import describe_jumps, inspect_video, read_timed_frames
from lanes.video.sources import sample_images
from lanes.video.writer import VideoWriter, process_video
from tests.support.clips import encode
from tests.video.sample_videos import (
    NTSC,
    make_video,
    number_of,
    numbered,
    sound_packets,
    tone_starts_s,
    unchanged,
)


@pytest.fixture
def process(tmp_path):
    """A function that writes a video again; returns frame numbers, times, missing
    frames, and the written video.
    """

    def run(
        video: Path, start_s: float = 0.0
    ) -> tuple[list[int], np.ndarray, int, Path]:
        out = tmp_path / "out" / f"{video.stem}.mp4"
        rows = tmp_path / "out" / f"{video.stem}.csv"
        info = process_video(
            video, out, unchanged, start_s=start_s, telemetry=rows, progress=False
        )
        table = read_telemetry(rows)
        return table["frame"].astype(int).tolist(), table["time_s"], info.missing, out

    return run


# --- AVI: the place of a chunk is its time

DROPPED = {*range(40, 46), *range(70, 78)}
KEPT = [number for number in range(120) if number not in DROPPED]
TONE_FRAME = 100
# How to encode, and how many frames the decoder gives a frame behind its place.
CODECS = {
    "MJPEG": ({"codec": "mjpeg", "pixels": "yuvj420p"}, 0),
    "MPEG-4": (
        {"codec": "mpeg4", "header": {"codec_tag": "FMP4"}, "options": {"g": "12"}},
        0,
    ),
    "XviD with B frames": (
        {
            "codec": "mpeg4",
            "header": {"codec_tag": "XVID"},
            "options": {"g": "12", "bf": "2"},
        },
        1,
    ),
    "H.264 with B frames": ({"codec": "libx264", "options": {"g": "12", "bf": "3"}}, 2),
}


def uncoded_frame(place: int) -> bytes:
    """A picture of MPEG-4 part 2 that repeats the one before (ISO 14496-2: vop_coded is
    0), at 25 ticks a second.
    """
    bits = f"0101{place % 25:05b}100" + "1111"
    return b"\0\0\1\xb6" + int(bits, 2).to_bytes(2, "big")


# What a recorder writes in the place of a frame that it drops.
FILLERS: dict[str, Callable[[int], bytes]] = {
    "empty": lambda _: b"",
    "one byte": lambda _: b"\x7f",
    "a JPEG without image": lambda _: b"\xff\xd8\xff\xd9",
    "not coded": uncoded_frame,
}


def fill_gaps(
    packets: list[av.Packet], filler: Callable[[int], bytes]
) -> list[av.Packet]:
    """Packets for all places in the order of decoding; FFmpeg writes an empty chunk for
    a place without one.
    """
    placed = {packet.dts - packets[0].dts: packet for packet in packets}
    for place in range(max(placed)):
        if place not in placed and filler(place):
            placed[place] = av.Packet(filler(place))
            placed[place].stream, placed[place].time_base = (
                packets[0].stream,
                packets[0].time_base,
            )
    for place, packet in placed.items():
        packet.pts = packet.dts = place
    return [placed[place] for place in sorted(placed)]


@pytest.mark.parametrize(
    ("codec", "filler"),
    [
        ("MJPEG", "empty"),
        ("MJPEG", "a JPEG without image"),
        ("MPEG-4", "not coded"),
        ("H.264 with B frames", "empty"),
    ]
    + [("XviD with B frames", "one byte"), ("MPEG-4", "one byte")],
)
def test_frames_of_avi_keep_their_times_beside_dropped_ones(
    tmp_path, process, codec, filler
):
    """A recorder that drops a frame writes an empty chunk, or one that completes no
    frame.
    """
    (settings, delay), images = CODECS[codec], map(numbered, KEPT)
    sound = {"sound": "pcm_s16le", "tone_s": (TONE_FRAME + delay) / 25}
    edit = partial(fill_gaps, filler=FILLERS[filler])
    video = encode(
        tmp_path / "drive.avi", images, numbers=KEPT, edit=edit, **sound, **settings
    )
    frames = list(read_timed_frames(video))
    assert (
        [number_of(frame.image) for frame in frames]
        == [frame.number for frame in frames]
        == KEPT
    )
    for start_s in (0.0, 2.0, 3.36):
        numbers, times_s, missing, out = process(video, start_s)
        assert numbers == [number for number in KEPT if number >= 25 * start_s]
        np.testing.assert_allclose(times_s, np.array(numbers) / 25, atol=1e-3)
        assert missing == sum(number > 25 * start_s for number in DROPPED)
        assert start_s + tone_starts_s(out) == pytest.approx(TONE_FRAME / 25, abs=0.03)


# --- sound that begins before or after the picture


@pytest.mark.parametrize(
    ("suffix", "codecs", "picture_s", "sound_s"),
    [
        # FFmpeg looks for the first frame in the first five seconds only
        ("mkv", ("libx264", "aac"), 6.0, 0.0),
        ("mkv", ("mjpeg", "pcm_s16le"), 7.0, 1.0),
        ("webm", ("libvpx-vp9", "libopus"), 6.0, 0.0),
        ("mkv", ("libx264", "flac"), 0.0, 1.0),
        ("mov", ("libx264", "aac"), 1.0, -0.5),
        ("ts", ("libx264", "aac"), 3.0, 2.0),
    ],
)
def test_sound_is_in_step_whenever_it_starts(
    tmp_path, process, suffix, codecs, picture_s, sound_s
):
    """The picture and the sound begin at these times of one clock; the tone is two
    seconds after the first frame.
    """
    codec, sound = codecs
    pixels = "yuvj420p" if codec == "mjpeg" else "yuv420p"
    options = {"bf": "2", "g": "12"} if codec == "libx264" else {}
    numbers = [round(25 * picture_s) + number for number in range(75)]
    times = {"numbers": numbers, "sound_s": sound_s, "tone_s": picture_s + 2 - 1e-6}
    video = tmp_path / f"drive.{suffix}"
    encode(
        video,
        map(numbered, range(75)),
        codec,
        pixels,
        options=options,
        sound=sound,
        **times,
    )
    for start_s in (0.0, 1.2):
        numbers, times_s, _, out = process(video, start_s)
        assert numbers == list(range(round(25 * start_s), 75))
        np.testing.assert_allclose(times_s, np.array(numbers) / 25, atol=2e-3)
        assert start_s + tone_starts_s(out) == pytest.approx(2.0, abs=0.03)
        before, after = (
            {data for _, data in sound_packets(file)} for file in (video, out)
        )
        assert after <= before or sound not in ("libopus", "flac")  # which are copied


# --- clocks that jump


def write_stamped(
    path: Path,
    times_s: Sequence[float],
    *,
    decoded_s: Sequence[float] | None = None,
    fps: float = 25,
) -> Path:
    """Numbered frames with these presentation times; `decoded_s` are the times of
    decoding, by default the same; `fps` is that of the header.
    """

    def stamp(packets: list[av.Packet]) -> list[av.Packet]:
        for packet, time_s, at_s in zip(
            packets, times_s, decoded_s or times_s, strict=True
        ):
            packet.time_base, packet.pts, packet.dts = (
                Fraction(1, 90_000),
                round(90_000 * time_s),
                round(90_000 * at_s),
            )
        return packets

    options = {"preset": "ultrafast", "g": "12"}
    images = map(numbered, range(len(times_s)))
    return encode(path, images, fps=fps, options=options, edit=stamp)


EVEN_S = [number / 25 for number in range(100)]


@pytest.mark.parametrize("suffix", ["mkv", "ts"])
def test_a_second_recording_on_the_same_clock_comes_after_a_gap(
    tmp_path, process, suffix
):
    """Two hours later: they are no missing frames, and the part after the gap can be
    named.
    """
    times_s = [time_s + (7200 if time_s >= 2 else 0) for time_s in EVEN_S]
    video = write_stamped(tmp_path / f"drive.{suffix}", times_s)
    info = inspect_video(video)
    assert (info.fps, info.frames, info.missing, info.duration_s) == (25, 100, 0, 7204)
    numbers, found_s, missing, out = process(video)
    np.testing.assert_allclose(found_s, times_s, atol=2e-3)
    assert (len(numbers), missing) == (100, 0)
    assert (
        "its clock jumps by 7200 s after 2.0 s: another recording begins there"
        in describe_jumps(found_s, info.fps)
    )
    np.testing.assert_allclose(
        [frame.time_s for frame in read_timed_frames(out)], times_s, atol=2e-3
    )
    frames = list(read_timed_frames(video, start_s=7202.4))
    assert [number_of(frame.image) for frame in frames] == list(range(60, 100))


@pytest.mark.parametrize(
    ("suffix", "wrong", "by_s"),
    [("ts", (40,), 7200.0), ("mkv", (40, 41, 42), 30.0), ("mkv", (50,), 9e4)],
)
def test_single_wrong_times_are_repaired(tmp_path, process, suffix, wrong, by_s):
    times_s = [
        time_s + (by_s if number in wrong else 0)
        for number, time_s in enumerate(EVEN_S)
    ]
    numbers, found_s, missing, _ = process(
        write_stamped(tmp_path / f"drive.{suffix}", times_s, decoded_s=EVEN_S)
    )
    assert (numbers, missing) == (list(range(100)), 0)
    np.testing.assert_allclose(found_s, EVEN_S, atol=2e-3)


@pytest.mark.parametrize("set_at", [1, 60])
def test_a_clock_that_is_set_to_the_time_of_day_goes_on(tmp_path, process, set_at):
    """NTP counts from 1900: a gap of that length cannot be written."""
    times_s = [
        time_s + (3.9e9 if number >= set_at else 0)
        for number, time_s in enumerate(EVEN_S)
    ]
    video = write_stamped(tmp_path / "drive.mkv", times_s)
    numbers, found_s, missing, _ = process(video)
    assert (numbers, missing, inspect_video(video).duration_s) == (
        list(range(100)),
        0,
        4,
    )
    np.testing.assert_allclose(found_s, EVEN_S, atol=2e-3)


class TestStampsAgainstTheHeader:
    """FFmpeg copies an mp4 into an avi of 600 frames a second; default durations in
    Matroska may be those of a field, or nonsense.
    """

    @pytest.fixture(
        params=["avi 600", "mkv 50", "mkv 1000", "mkv 2", "flv 1000", "nut 50"]
    )
    def video(self, request, tmp_path) -> Path:
        suffix, stated = request.param.split()
        return write_stamped(tmp_path / f"a.{suffix}", EVEN_S, fps=int(stated))

    def test_rate_and_length_are_those_of_the_stamps(self, video):
        info = inspect_video(video)
        assert info.fps == 25
        assert info.duration_s == 4
        assert (info.frames, info.missing) == (100, 0)

    @pytest.mark.parametrize(("start_s", "end_s"), [(0, None), (3, None), (0.4, 2)])
    def test_a_part_is_that_of_the_stamps(self, video, tmp_path, start_s, end_s):
        out = tmp_path / "out.mp4"
        first, end = round(25 * start_s), round(25 * (end_s or 4))

        written = process_video(
            video, out, unchanged, start_s=start_s, end_s=end_s, progress=False
        )

        assert (written.fps, written.missing) == (25, 0)
        frames = list(read_timed_frames(video, start_s=start_s, end_s=end_s))
        expected = list(range(first, end))
        assert [number_of(frame.image) for frame in frames] == expected
        assert [frame.number for frame in frames] == expected
        times_s = [frame.time_s for frame in frames]
        np.testing.assert_allclose(times_s, EVEN_S[first:end], atol=1e-3)
        written_s = [frame.time_s for frame in read_timed_frames(out)]
        np.testing.assert_allclose(np.diff(written_s), 1 / 25, atol=1e-3)

    def test_samples_cover_the_whole_video(self, video):
        seen = [number_of(image) for image in sample_images([video], 5)]
        assert seen == [0, 20, 40, 60, 80]

    @pytest.mark.parametrize(("rate", "suffix"), [(NTSC, "mkv"), (240, "flv")])
    def test_a_rate_rounded_to_milliseconds_is_exact(self, tmp_path, rate, suffix):
        times_s = [number / float(rate) for number in range(100)]
        video = write_stamped(tmp_path / f"a.{suffix}", times_s, fps=1000)
        assert inspect_video(video).fps == float(rate)

    def test_a_rate_that_changes_has_no_missing_frames(self, tmp_path):
        """A camera that takes 30 frames a second by day and 15 in tunnels."""
        times_s = [*np.arange(60) / 30, *(2 + np.arange(30) / 15)]
        info = inspect_video(write_stamped(tmp_path / "a.mkv", times_s, fps=30))
        assert (info.fps, info.frames, info.missing) == (30, 90, 0)
        assert info.duration_s == pytest.approx(4 - 1 / 15 + 1 / 30, abs=1e-3)


def test_a_part_of_a_variable_rate_has_the_true_frame_numbers(tmp_path, process):
    """30 frames a second for two seconds, then eight, then 24."""
    times_s = np.concatenate(
        [np.arange(60) / 30, 2 + np.arange(8) / 8, 3 + np.arange(30) / 24]
    )
    with VideoWriter(tmp_path / "drive.mp4", fps=24) as writer:
        for number, time_s in enumerate(times_s):
            writer.write(numbered(number), time_s)
    for start_s in (0.5, 2.1, 3.5):
        numbers, found_s, *_ = process(tmp_path / "drive.mp4", start_s)
        assert numbers == np.flatnonzero(times_s >= start_s).tolist()
        np.testing.assert_allclose(found_s, times_s[numbers], atol=1e-3)
        frames = read_timed_frames(tmp_path / "drive.mp4", start_s=start_s)
        assert [number_of(frame.image) for frame in frames] == numbers


def test_part_with_synchronous_sound(tmp_path):
    path = make_video(tmp_path / "drive.mp4", 100, sound="aac")
    assert tone_starts_s(path) == pytest.approx(2.0, abs=0.05)
    target = tmp_path / "out.mp4"
    info = process_video(
        path, target, unchanged, start_s=1.2, end_s=3.2, progress=False
    )
    assert (info.frames, info.duration_s) == (50, 2.0)
    # copied: encoding again would change the bytes
    before, after = (
        {data for _, data in sound_packets(file)} for file in (path, target)
    )
    assert after <= before
    assert len(after) > 50
    assert tone_starts_s(target) == pytest.approx(0.8, abs=0.05)
    with av.open(str(target)) as container:
        sound = container.streams.audio[0]
        assert float(sound.duration * sound.time_base) == pytest.approx(2.0, abs=0.05)


@pytest.mark.parametrize(
    ("suffix", "codec", "audio"),
    [
        ("ts", "aac", {}),
        # A tick of this avi is a whole frame of MP3, longer than one of AAC.
        ("avi", "libmp3lame", {"layout": "stereo", "rate": 44100}),
        # AAC has no such sampling rate.
        ("mov", "pcm_s16le", {"rate": 192_000}),
    ],
)
def test_sound_of_other_containers(tmp_path, suffix, codec, audio):
    path = make_video(tmp_path / f"drive.{suffix}", 40, sound=codec, **audio)
    info = process_video(path, tmp_path / "out.mp4", unchanged, progress=False)
    assert info.has_audio
    assert tone_starts_s(tmp_path / "out.mp4") == pytest.approx(40 / 25 / 2, abs=0.03)


class TestAllSoundIsKept:
    """Several tracks, and what was recorded after the last frame."""

    @pytest.fixture(
        params=[
            ("mov", ("aac", "pcm_s16le")),
            ("mkv", ("flac", "libopus", "aac")),
            ("avi", ("mp2", "mp2")),
        ],
        ids=lambda param: param[0],
    )
    def video(self, request, tmp_path) -> Path:
        suffix, codecs = request.param
        path = tmp_path / f"drive.{suffix}"
        times = {"tone_s": 1.5, "sound_end_s": 4.0}
        return make_video(path, 75, sound=codecs, **times)

    @pytest.mark.parametrize("start_s", [0.0, 1.2])
    def test_all_tracks_are_in_step(self, video, tmp_path, start_s):
        out = tmp_path / "out.mp4"
        written = process_video(video, out, unchanged, start_s=start_s, progress=False)
        assert written.sound_tracks == inspect_video(video).sound_tracks >= 2
        for track in range(written.sound_tracks):
            expected_s = 1.5 + track / 2 - start_s
            assert tone_starts_s(out, track) == pytest.approx(expected_s, abs=0.03)

    @pytest.mark.parametrize(("end_s", "ends_s"), [(None, 4.0), (3.5, 3.5), (2, 2)])
    def test_they_end_with_the_part(self, video, tmp_path, end_s, ends_s):
        out = tmp_path / "out.mp4"
        info = process_video(video, out, unchanged, end_s=end_s, progress=False)
        assert info.duration_s == min(ends_s, 3)
        with av.open(str(out)) as container:
            for sound in container.streams.audio:
                length_s = float(sound.duration * sound.time_base)
                assert length_s == pytest.approx(ends_s, abs=0.1)  # a frame of FLAC

    def test_languages_are_kept(self, tmp_path):
        first = make_video(tmp_path / "a.mkv", 10, sound=("aac", "flac"))
        path = tmp_path / "b.mkv"
        with av.open(str(first)) as source, av.open(str(path), "w") as target:
            outputs = [
                target.add_stream_from_template(stream) for stream in source.streams
            ]
            outputs[2].metadata["language"] = "deu"
            for packet in source.demux():
                if packet.size:
                    packet.stream = outputs[packet.stream_index]
                    target.mux(packet)
        process_video(path, tmp_path / "out.mp4", unchanged, progress=False)
        with av.open(str(tmp_path / "out.mp4")) as container:
            assert container.streams.audio[1].metadata["language"] == "deu"


@pytest.mark.parametrize(
    ("codec", "layout", "end_s"), [("aac", "mono", 2.8), ("mp2", "stereo", 1.6)]
)
def test_appended_recording(tmp_path, codec, layout, end_s):
    """The time stamps begin again.

    Sound with another number of channels is left out, its frames are not.
    """
    path = make_video(tmp_path / "drive.ts", 40, sound=codec)
    other = make_video(tmp_path / "other.ts", 30, sound=codec, layout=layout)
    path.write_bytes(path.read_bytes() + other.read_bytes())
    info = process_video(path, tmp_path / "out.mp4", unchanged, progress=False)
    assert (info.frames, info.has_audio) == (70, True)
    times_s = [frame.time_s for frame in read_timed_frames(path)]
    assert times_s == pytest.approx(np.arange(70) / 25, abs=0.1)
    assert (np.diff(times_s) > 0).all()
    assert sound_packets(tmp_path / "out.mp4")[-1][0] == pytest.approx(end_s, abs=0.1)


@pytest.mark.parametrize("start_s", [1.2, 1.6, 2.4])
def test_a_part_of_an_appended_recording_is_the_right_one(tmp_path, start_s):
    """A place on the second clock is also one on the first."""
    path = make_video(tmp_path / "drive.ts", 40, sound="aac", tone_s=1.3)
    path.write_bytes(2 * path.read_bytes())
    frames = list(read_timed_frames(path, start_s=start_s))
    expected = list(range(round(25 * start_s), 80))
    assert [frame.number for frame in frames] == expected
    assert [number_of(frame.image) for frame in frames] == [n % 40 for n in expected]
    out = tmp_path / "out.mp4"
    process_video(path, out, unchanged, start_s=start_s, progress=False)
    if start_s > 1.6:
        assert tone_starts_s(out) == pytest.approx(1.6 + 1.3 - start_s, abs=0.05)
