"""Videos: every frame once and in order, with sound; nothing unfinished is left."""

import csv

import numpy as np
import pytest
from moviepy.video.io.ffmpeg_writer import FFMPEG_VideoWriter
from pytest import approx

from helpers import process_video, read_video
from lanes.video.reader import inspect_video
from lanes.video.reader import read_video as read_video_by_lanes
from tests.support.clips import encode
from tests.support.project import names
from tests.video.sample_videos import sound_packets, tone_starts_s

parametrize = pytest.mark.parametrize

COUNT = 30


def shade(number):
    """A frame (48, 64, 3) whose gray level tells its number."""
    return np.full((48, 64, 3), 40 + 6 * number, np.uint8)


def number_of(frame):
    return round((float(frame.mean()) - 40) / 6)


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    frames = [shade(number) for number in range(COUNT)]
    return encode(tmp_path_factory.mktemp("clips") / "count.mp4", frames, sound="aac")


def numbers_in(path, **span):
    return [number_of(frame) for frame in read_video(path, **span)]


def test_frames_are_those_of_lanes_and_may_be_changed(clip):
    frames = list(read_video(clip))
    for frame, other in zip(frames, read_video_by_lanes(clip), strict=True):
        assert np.abs(frame.astype(int) - other).max() <= 2
        frame[:] = 0


@parametrize(
    ("start_s", "end_s", "expected"),
    [
        (0.0, None, range(COUNT)),
        (0.4, 0.8, range(10, 20)),
        # 1.9999...: the frame of that time is meant
        (0.0, 4.6 - 2.6 - 1.0, range(25)),
        (0.41, None, range(11, 30)),
        (1.16, 99.0, range(29, 30)),
    ],
)
def test_a_part_is_read_from_its_start_to_before_its_end(
    clip, start_s, end_s, expected
):
    assert numbers_in(clip, start_s=start_s, end_s=end_s) == list(expected)


@parametrize(
    ("start_s", "end_s", "sentence"),
    [
        (2.0, None, "has no frame at 2.0 s"),
        # the end of the last frame
        (1.2, None, "has no frame at 1.2 s"),
        (1.0, 1.0, "there is no time"),
        (-1.0, 1.0, "no time"),
    ],
)
def test_a_part_without_frames_is_refused(clip, start_s, end_s, sentence):
    with pytest.raises(ValueError, match=sentence):
        numbers_in(clip, start_s=start_s, end_s=end_s)


def test_files_that_are_no_videos_are_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"none\.mp4"):
        numbers_in(tmp_path / "none.mp4")
    (tmp_path / "text.mp4").write_text("hello")
    with pytest.raises(OSError, match=r"text\.mp4: cannot be read as a video"):
        numbers_in(tmp_path / "text.mp4")


def test_a_video_that_is_cut_off_is_not_read_in_silence(tmp_path):
    frames = [shade(number) for number in range(COUNT)]
    whole = encode(tmp_path / "whole.avi", frames, codec="mjpeg", pixels="yuvj420p")
    data = whole.read_bytes()
    cut = tmp_path / "cut.avi"
    cut.write_bytes(data[: len(data) // 2])
    with pytest.warns(UserWarning, match=r"cut\.avi: only \d+ of 30 frames"):
        assert numbers_in(cut) == list(range(len(numbers_in_silence(cut))))


@pytest.mark.filterwarnings("ignore::UserWarning")
def numbers_in_silence(path):
    return numbers_in(path)


def test_every_frame_is_processed_once_and_written_once(clip, tmp_path):
    seen = []

    def darken(frame):
        seen.append(number_of(frame))
        frame -= 20
        return frame

    target = tmp_path / "new" / "dark.mp4"
    assert process_video(clip, target, darken) == COUNT
    assert seen == list(range(COUNT))
    written = list(read_video(target))
    assert [number_of(frame + 20) for frame in written] == seen
    assert names(target.parent) == {"dark.mp4"}


@parametrize(("start_s", "end_s"), [(0.0, None), (0.4, None), (0.2, 0.8)])
def test_rate_and_sound_are_those_of_the_source(clip, tmp_path, start_s, end_s):
    """The tone of the clip starts at 0.6 s."""
    target = tmp_path / "copy.mp4"
    count = process_video(clip, target, np.copy, start_s=start_s, end_s=end_s)
    info = inspect_video(target)
    assert (info.frames, info.fps, info.has_audio) == (count, 25, True)
    assert info.duration_s == approx(count / 25, abs=0.03)
    assert start_s + tone_starts_s(target) == approx(0.6, abs=0.03)
    last_packet_s, _ = sound_packets(target)[-1]
    assert last_packet_s == approx(count / 25, abs=0.03)


def test_a_source_without_sound_gives_a_video_without_sound(tmp_path):
    silent = encode(tmp_path / "silent.mp4", [shade(number) for number in range(5)])
    process_video(silent, tmp_path / "copy.mp4", np.copy)
    assert not inspect_video(tmp_path / "copy.mp4").has_audio


def test_odd_sizes_are_padded_for_players(clip, tmp_path):
    def cut(frame):
        return frame[:47, :63]

    process_video(clip, tmp_path / "odd.mp4", cut, end_s=0.2)
    frame = next(read_video(tmp_path / "odd.mp4"))
    assert frame.shape == (48, 64, 3)
    # the last row and column are repeated
    assert np.ptp(frame) <= 2


def test_telemetry_has_a_row_for_each_frame(clip, tmp_path):
    def measure(frame):
        number = number_of(frame)
        offset_m = None if number == 12 else number / 7
        return frame, {"state": "found", "offset_m": offset_m}

    table = tmp_path / "rows.csv"
    process_video(clip, tmp_path / "a.mp4", measure, start_s=0.4, telemetry=table)
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["frame"]) for row in rows] == list(range(10, 30))
    assert rows[1]["time_s"] == "0.44"
    assert rows[0]["state"] == "found"
    assert rows[2]["offset_m"] == ""
    assert float(rows[3]["offset_m"]) == approx(13 / 7, rel=1e-8)


def stop_at_ten(frame):
    if number_of(frame) == 10:
        raise RuntimeError("stopped")
    return frame


def test_a_function_that_fails_leaves_the_earlier_video_and_nothing_else(
    clip, tmp_path
):
    target = tmp_path / "a.mp4"
    target.write_bytes(b"earlier")
    with pytest.raises(RuntimeError, match="stopped"):
        process_video(clip, target, stop_at_ten, telemetry=tmp_path / "a.csv")
    assert target.read_bytes() == b"earlier"
    assert names(tmp_path) == {"a.mp4"}


def test_a_video_that_is_not_written_whole_is_not_kept(clip, tmp_path, monkeypatch):
    """As on a full disk."""
    write_frame = FFMPEG_VideoWriter.write_frame

    def write_bright_frames(writer, image):
        if number_of(image) >= 10:
            write_frame(writer, image)

    monkeypatch.setattr(FFMPEG_VideoWriter, "write_frame", write_bright_frames)
    with pytest.raises(OSError, match=r"a\.mp4: only 20 of 30 frames"):
        process_video(clip, tmp_path / "a.mp4", np.copy)
    assert names(tmp_path) == set()


def return_floats(frame):
    return frame / 255


def return_two_sizes(frame):
    return frame if number_of(frame) < 5 else frame[:20].copy()


@parametrize(
    ("function", "sentence"),
    [
        (return_floats, "expected an RGB image .* float64"),
        (return_two_sizes, "64x20 pixels, but this video is for 64x48"),
    ],
)
def test_a_function_that_returns_no_frame_is_told(clip, tmp_path, function, sentence):
    with pytest.raises(ValueError, match=sentence):
        process_video(clip, tmp_path / "a.mp4", function)
    assert names(tmp_path) == set()


def test_a_folder_that_cannot_be_written_is_reported_before_the_work(clip, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="file"):
        process_video(clip, tmp_path / "file" / "a.mp4", stop_at_ten)


def test_the_source_is_not_overwritten(clip, tmp_path):
    with pytest.raises(ValueError, match="is the source itself"):
        process_video(clip, clip, np.copy)
    with pytest.raises(ValueError, match=r"must end in \.mp4"):
        process_video(clip, tmp_path / "a.avi", np.copy)
    assert numbers_in(clip) == list(range(COUNT))
