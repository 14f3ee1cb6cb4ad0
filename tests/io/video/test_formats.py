"""Formats of phones and dashcams; rotation, variable rate, HLG and odd sizes are in test_pipeline.py."""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction

import av
import numpy as np
import pytest

from lanes.video.process import process_video
from lanes.video.reader import inspect_video, read_video
from tests.io.video.sample_videos import SIZE, number_of, numbered, unchanged

FRAMES = 6


@dataclass(frozen=True)
class Format:
    """How to encode a video; `bars_px` is the height of the black bars above and below the picture."""

    suffix: str
    codec: str
    pixels: str = "yuv420p"
    options: dict[str, str] = field(default_factory=dict)
    fps: int = 30
    size: tuple[int, int] = SIZE
    bars_px: int = 0


FORMATS = {
    "HEVC 10 bit": Format("mp4", "libx265", "yuv420p10le", {"preset": "ultrafast", "x265-params": "log-level=none"}),
    "VP9": Format("webm", "libvpx-vp9", options={"deadline": "realtime", "cpu-used": "8"}),
    "AV1": Format("mp4", "libsvtav1", options={"preset": "12"}),
    "MJPEG": Format("avi", "mjpeg", "yuvj420p"),
    "MPEG-4 part 2": Format("avi", "mpeg4"),
    "interlaced": Format("mp4", "libx264", options={"x264-params": "tff=1"}),
    "4:2:2": Format("mov", "libx264", "yuv422p"),
    "4:4:4": Format("mp4", "libx264", "yuv444p"),
    "240 fps": Format("mp4", "libx264", fps=240),
    "portrait": Format("mp4", "libx264", size=(160, 284)),
    "letterbox": Format("mp4", "libx264", bars_px=16),
}


@pytest.mark.parametrize("name", FORMATS)
def test_formats_of_phones_and_dashcams(tmp_path, name):
    """Every frame once and in order, at the rate and in the size of the source."""
    made, path = FORMATS[name], tmp_path / f"drive.{FORMATS[name].suffix}"
    if made.codec not in av.codecs_available:
        pytest.skip(f"this build of PyAV has no encoder {made.codec}")
    bars = ((made.bars_px, made.bars_px), (0, 0), (0, 0))
    with av.open(str(path), "w") as container:
        stream = container.add_stream(made.codec, rate=Fraction(made.fps), options=made.options)
        stream.width, stream.height, stream.pix_fmt = made.size[0], made.size[1] + 2 * made.bars_px, made.pixels
        if made.pixels == "yuvj420p":
            stream.codec_context.color_range = 2
        for number in range(FRAMES):
            image = np.pad(numbered(number, made.size), bars)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image)))
        container.mux(stream.encode(None))
    process_video(path, tmp_path / "out.mp4", unchanged, progress=False)
    for file in (path, tmp_path / "out.mp4"):
        info, frames = inspect_video(file), list(read_video(file))
        assert (info.frames, info.missing, info.fps) == (FRAMES, 0, made.fps)
        assert frames[0].shape == (made.size[1] + 2 * made.bars_px, made.size[0], 3)
        assert [number_of(frame[: len(frame) - made.bars_px]) for frame in frames] == list(range(FRAMES))
        assert made.bars_px == 0 or frames[3][: made.bars_px - 2].max() < 30
