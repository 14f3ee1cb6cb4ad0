"""Sound: copied where browsers play it, and in time with the frames."""

from __future__ import annotations

from fractions import Fraction

import av
import numpy as np
import pytest

from lanes.io.video.pipeline import annotate_video
from lanes.io.video.reader import read_timed_frames
from tests.io.video.sample_videos import (
    SIZE,
    add_tone,
    make_video,
    number_of,
    numbered,
    sound_packets,
    tone_starts_s,
    unchanged,
)


def test_part_with_synchronous_sound(tmp_path):
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
def test_sound_of_other_containers(tmp_path, suffix, codec):
    path = make_video(tmp_path / f"drive.{suffix}", 40, sound=codec)
    summary = annotate_video(path, tmp_path / "out.mp4", unchanged, progress=False)
    assert summary.has_audio
    assert tone_starts_s(tmp_path / "out.mp4") == pytest.approx(0.8, abs=0.05)


def test_sound_that_browsers_play_is_copied(video, tmp_path):
    """Packets keep their bytes and times; re-encoding would change the bytes."""
    annotate_video(video, tmp_path / "out.mp4", unchanged, progress=False)
    before, after = sound_packets(video), sound_packets(tmp_path / "out.mp4")
    # the encoder's packets before the first frame are left out
    assert set(after) <= set(before)
    assert len(after) >= len(before) - 2 > 80


def test_variable_rate_with_sound(tmp_path):
    """Frames are missing for a second: picture and sound stay synchronous."""
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
    summary = annotate_video(path, tmp_path / "out.mp4", lambda f: f, yuv=True, progress=False)
    found = list(read_timed_frames(tmp_path / "out.mp4"))
    assert summary.frames_out == 30 and [number_of(f.image) for f in found] == list(range(30))
    np.testing.assert_allclose([f.time_s for f in found], times_s, atol=1e-3)
    assert tone_starts_s(tmp_path / "out.mp4") == pytest.approx(tone_starts_s(path), abs=1e-3)


def test_without_sound(video, tmp_path):
    assert not annotate_video(video, tmp_path / "out.mp4", unchanged, sound=False, progress=False).has_audio
