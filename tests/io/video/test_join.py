"""Joined pieces have the frames, times and sound of the video processed in one run."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from lanes.errors import VideoError
from lanes.files import read_telemetry
from lanes.video.join import join_videos
from lanes.video.process import annotate_video
from lanes.video.reader import inspect_video, read_timed_frames
from lanes.video.writer import VideoWriter
from tests.io.video.sample_videos import NTSC, make_video, number_of, numbered, tone_starts_s, unchanged


def in_pieces(source: Path, cuts_s: list[float], folder: Path) -> tuple[list[Path], list[float]]:
    """Pieces of a video between the cuts, and the time of the first frame of each."""
    pieces, starts_s = [], []
    for start_s, end_s in zip(cuts_s[:-1], cuts_s[1:], strict=True):
        pieces.append(folder / f"{len(pieces)}.mp4")
        table = pieces[-1].with_suffix(".csv")
        options = {"start_s": start_s, "end_s": end_s, "telemetry": table, "progress": False, "overlapped": False}
        annotate_video(source, pieces[-1], unchanged, sound=False, **options)
        starts_s.append(read_telemetry(table)["time_s"][0])
    return pieces, starts_s


def packets(path: Path, kind: str) -> list[tuple[float, bool, bytes]]:
    """Times, key frame flag and content of the packets in decoding order."""
    with av.open(str(path)) as container:
        found = [p for p in container.demux(getattr(container.streams, kind)[0]) if p.size]
        return [(float(p.pts * p.time_base), p.is_keyframe, bytes(p)) for p in found]


@pytest.mark.parametrize("fps", [25, NTSC], ids=["25", "ntsc"])
def test_joined_pieces_are_the_video(tmp_path, fps):
    source = make_video(tmp_path / "drive.mp4", 60, fps=fps, sound="aac")
    whole, joined = tmp_path / "whole.mp4", tmp_path / "joined.mp4"
    annotate_video(source, whole, unchanged, progress=False)
    pieces, starts_s = in_pieces(
        source,
        [0, *(float(frame / fps) for frame in (Fraction(41, 2), Fraction(43, 2), Fraction(87, 2))), None],
        tmp_path,
    )
    assert join_videos(pieces, starts_s, joined, sound_from=source) == 60
    assert inspect_video(joined) == inspect_video(whole)
    frames = list(read_timed_frames(joined))
    assert [number_of(frame.image) for frame in frames] == list(range(60))
    np.testing.assert_allclose([f.time_s for f in frames], [f.time_s for f in read_timed_frames(whole)], atol=1e-6)
    # No frame may refer to another piece.
    keys = [round(time_s * fps) for time_s, key, _ in packets(joined, "video") if key]
    assert keys == [0, 21, 22, 44]
    assert packets(joined, "audio") == packets(whole, "audio")
    assert {path.name for path in tmp_path.iterdir() if ".partial." in path.name} == set()


def test_nothing_is_re_encoded(tmp_path):
    source = make_video(tmp_path / "drive.mp4", 40)
    pieces, starts_s = in_pieces(source, [0, 0.78, None], tmp_path)
    join_videos(pieces, starts_s, tmp_path / "joined.mp4")
    pictures = [packet[2] for piece in pieces for packet in packets(piece, "video")]
    assert [packet[2] for packet in packets(tmp_path / "joined.mp4", "video")] == pictures


def test_a_part_of_a_video_with_sound(tmp_path):
    source = make_video(tmp_path / "drive.mp4", 100, sound="aac")
    pieces, starts_s = in_pieces(source, [1.0, 1.98, 3.0], tmp_path)
    assert join_videos(pieces, starts_s, tmp_path / "joined.mp4", sound_from=source) == 50
    assert tone_starts_s(tmp_path / "joined.mp4") == pytest.approx(1.0, abs=0.05)
    assert number_of(next(read_timed_frames(tmp_path / "joined.mp4")).image) == 25


def test_variable_rate_across_the_cuts(tmp_path):
    """With long frames after short ones at a joint, decoding times would decrease."""
    times_s = np.cumsum([0, *[0.01] * 12, *[0.3] * 12, *[0.01] * 12])
    with VideoWriter(tmp_path / "variable.mp4", fps=25) as writer:
        for number, time_s in enumerate(times_s):
            writer.write(numbered(number), time_s)
    cuts_s = [0, *(times_s[[12, 24, 30]] - 0.003), None]
    pieces, starts_s = in_pieces(tmp_path / "variable.mp4", cuts_s, tmp_path)
    assert join_videos(pieces, starts_s, tmp_path / "joined.mp4") == len(times_s)
    frames = list(read_timed_frames(tmp_path / "joined.mp4"))
    assert [number_of(frame.image) for frame in frames] == list(range(len(times_s)))
    np.testing.assert_allclose([frame.time_s for frame in frames], times_s, atol=1e-3)


def test_pieces_of_different_kinds_are_refused(tmp_path):
    for number, size in enumerate([(160, 96), (176, 96)]):
        with VideoWriter(tmp_path / f"{number}.mp4", fps=25) as writer:
            writer.write(numbered(0, size))
    with pytest.raises(VideoError, match=r"1\.mp4: was encoded with other settings"):
        join_videos([tmp_path / "0.mp4", tmp_path / "1.mp4"], [0.0, 0.04], tmp_path / "joined.mp4")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["0.mp4", "1.mp4"]


def test_a_damaged_piece_leaves_an_earlier_file(tmp_path):
    source = make_video(tmp_path / "drive.mp4", 40)
    pieces, starts_s = in_pieces(source, [0, 0.78, None], tmp_path)
    (tmp_path / "joined.mp4").write_text("earlier")
    pieces[1].write_bytes(pieces[1].read_bytes()[:2000])
    with pytest.raises(VideoError, match=r"1\.mp4"):
        join_videos(pieces, starts_s, tmp_path / "joined.mp4")
    assert (tmp_path / "joined.mp4").read_text() == "earlier"


@pytest.mark.parametrize("overlapped", [True, False])
def test_warm_up_frames_are_processed_but_not_written(tmp_path, overlapped):
    source = make_video(tmp_path / "drive.mp4", 50, sound="aac")
    seen = []
    options = {"start_s": 1.0, "end_s": 1.4, "warm_up_s": 0.2, "progress": False, "overlapped": overlapped}
    summary = annotate_video(
        source,
        tmp_path / "out.mp4",
        lambda frame: (frame, {"seen": seen.append(number_of(frame)) or len(seen)}),
        telemetry=tmp_path / "out.csv",
        **options,
    )
    assert seen == list(range(20, 35)) and summary.frames_out == 10
    table = read_telemetry(tmp_path / "out.csv")
    np.testing.assert_array_equal(table["frame"], np.arange(25, 35))
    np.testing.assert_array_equal(table["seen"], np.arange(6, 16))
    assert [number_of(f.image) for f in read_timed_frames(tmp_path / "out.mp4")] == list(range(25, 35))
    assert tone_starts_s(tmp_path / "out.mp4") == pytest.approx(0.0, abs=0.05)
