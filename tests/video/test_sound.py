"""Sound: copied where browsers play it, in time with the frames, and never at the cost of the video."""

from __future__ import annotations

from functools import partial

import av
import pytest

from lanes.video.process import process_video
from lanes.video.reader import inspect_video
from tests.video.sample_videos import (
    make_video,
    make_video_with_unknown_sound,
    sound_packets,
    tone_starts_s,
    unchanged,
)


def test_part_with_synchronous_sound(tmp_path):
    path = make_video(tmp_path / "drive.mp4", 100, sound="aac")
    assert tone_starts_s(path) == pytest.approx(2.0, abs=0.05)
    target = tmp_path / "out.mp4"
    info = process_video(path, target, unchanged, start_s=1.2, end_s=3.2, progress=False)
    assert (info.frames, info.duration_s) == (50, 2.0)
    assert tone_starts_s(target) == pytest.approx(0.8, abs=0.05)
    with av.open(str(target)) as container:
        sound = container.streams.audio[0]
        assert float(sound.duration * sound.time_base) == pytest.approx(2.0, abs=0.05)


def test_sound_of_a_transport_stream(tmp_path):
    """Its clock does not begin at 0, and its packets have headers of their own."""
    path = make_video(tmp_path / "drive.ts", 40, sound="aac")
    assert process_video(path, tmp_path / "out.mp4", unchanged, progress=False).has_audio
    with av.open(str(path)) as container:
        first_s = next(container.decode(video=0)).time
    assert tone_starts_s(tmp_path / "out.mp4") == pytest.approx(tone_starts_s(path) - first_s, abs=0.03)


def test_sound_that_browsers_play_is_copied(video, tmp_path):
    """Packets keep their bytes and times; re-encoding would change the bytes."""
    process_video(video, tmp_path / "out.mp4", unchanged, progress=False)
    before, after = sound_packets(video), sound_packets(tmp_path / "out.mp4")
    # the encoder's packets before the first frame are left out
    assert set(after) <= set(before)
    assert len(after) >= len(before) - 2 > 80


def test_appended_recording(tmp_path):
    """The time stamps begin again."""
    path = make_video(tmp_path / "drive.ts", 40, sound="aac")
    path.write_bytes(path.read_bytes() + make_video(tmp_path / "other.ts", 30, sound="aac").read_bytes())
    info = process_video(path, tmp_path / "out.mp4", unchanged, progress=False)
    assert (info.frames, info.has_audio) == (70, True)
    assert sound_packets(tmp_path / "out.mp4")[-1][0] == pytest.approx(2.8, abs=0.1)


@pytest.mark.parametrize("make", [make_video_with_unknown_sound, partial(make_video, sound="pcm_s16le")])
def test_other_sound_is_left_out(tmp_path, make):
    path = make(tmp_path / "drive.avi", 10)
    info = process_video(path, tmp_path / "out.mp4", unchanged, progress=False)
    assert inspect_video(path).has_audio and (info.frames, info.has_audio) == (10, False)
