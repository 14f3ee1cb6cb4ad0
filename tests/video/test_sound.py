"""Sound: copied where browsers play it, in time with the frames, and never at the cost of the video."""

from __future__ import annotations

import av
import numpy as np
import pytest

from lanes.video.reader import read_timed_frames
from lanes.video.writer import process_video
from tests.video.sample_videos import make_video, sound_packets, tone_starts_s, unchanged


def test_part_with_synchronous_sound(tmp_path):
    path = make_video(tmp_path / "drive.mp4", 100, sound="aac")
    assert tone_starts_s(path) == pytest.approx(2.0, abs=0.05)
    target = tmp_path / "out.mp4"
    info = process_video(path, target, unchanged, start_s=1.2, end_s=3.2, progress=False)
    assert (info.frames, info.duration_s) == (50, 2.0)
    # copied: encoding again would change the bytes
    before, after = ({data for _, data in sound_packets(file)} for file in (path, target))
    assert after <= before and len(after) > 50
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


@pytest.mark.parametrize(("codec", "layout", "end_s"), [("aac", "mono", 2.8), ("mp2", "stereo", 1.6)])
def test_appended_recording(tmp_path, codec, layout, end_s):
    """The time stamps begin again. Sound with another number of channels is left out, its frames are not."""
    path = make_video(tmp_path / "drive.ts", 40, sound=codec)
    other = make_video(tmp_path / "other.ts", 30, sound=codec, layout=layout)
    path.write_bytes(path.read_bytes() + other.read_bytes())
    info = process_video(path, tmp_path / "out.mp4", unchanged, progress=False)
    assert (info.frames, info.has_audio) == (70, True)
    times_s = [frame.time_s for frame in read_timed_frames(path)]
    assert times_s == pytest.approx(np.arange(70) / 25, abs=0.1) and (np.diff(times_s) > 0).all()
    assert sound_packets(tmp_path / "out.mp4")[-1][0] == pytest.approx(end_s, abs=0.1)
