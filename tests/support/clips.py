"""Short videos for tests, written with PyAV instead of the tested code."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from av.container import OutputContainer

from lanes.camera.model import save_camera
from simulator.road.truth import truth_row, write_truth_csv
from tests.support.painted_drive import PaintedDrive

FPS = 25
SOUND_HZ = 48000


def encode(
    path: Path,
    images: Iterable[np.ndarray | av.VideoFrame],
    codec: str = "libx264",
    pixels: str = "yuv420p",
    *,
    fps: float | Fraction = FPS,
    numbers: Sequence[int] | None = None,
    container: str | None = None,
    options: dict[str, str] | None = None,
    header: Mapping[str, object] | None = None,
    edit: Callable[[list[av.Packet]], list[av.Packet]] | None = None,
    sound: str | None = None,
    sound_s: float = 0.0,
    tone_s: float | None = None,
    **audio: object,
) -> Path:
    """Write RGB images, or frames of the pixel format, as a video; returns its path.

    The `container` is that of the suffix, if it is not named. `numbers` are the places of the frames on the clock, by
    default 0, 1, 2, ... `header` are attributes of the codec. `edit` is given the packets and returns those to write.
    `sound` is the codec of a sound track from `sound_s` to the end of the last frame, with the tone of `add_tone`;
    `audio` may have a rate and a layout.
    """
    frames = [
        image if isinstance(image, av.VideoFrame) else av.VideoFrame.from_ndarray(image).reformat(format=pixels)
        for image in images
    ]
    numbers = range(len(frames)) if numbers is None else numbers
    # The clock of a transport stream of a recorder does not begin at 0.
    clock = {"output_ts_offset": "5"} if path.suffix == ".ts" else {}
    with av.open(str(path), "w", format=container, options=clock) as file:
        stream = file.add_stream(codec, rate=Fraction(fps), options=options or {})
        stream.width, stream.height, stream.pix_fmt = frames[0].width, frames[0].height, pixels
        full_range = {"color_range": 2} if pixels == "yuvj420p" else {}
        for name, value in {**full_range, **(header or {})}.items():
            setattr(stream.codec_context, name, value)
        track = file.add_stream(sound, **{"rate": SOUND_HZ, "layout": "mono"} | audio) if sound else None
        packets = []
        for number, frame in zip(numbers, frames, strict=True):
            frame.pts, frame.time_base = number, 1 / Fraction(fps)
            packets += stream.encode(frame)
        packets += stream.encode(None)
        file.mux(edit(packets) if edit else packets)
        if track:
            add_tone(file, track, sound_s, (numbers[-1] + 1) / float(fps), tone_s)
    return path


def add_tone(
    file: OutputContainer, track: av.AudioStream, begin_s: float, end_s: float, tone_s: float | None = None
) -> None:
    """Sound with a tone from `tone_s` on, by default in its second half, so that a shift is noticed."""
    tone_s = (begin_s + end_s) / 2 if tone_s is None else tone_s
    piece = SOUND_HZ // 50
    for first in range(round(SOUND_HZ * begin_s), round(SOUND_HZ * end_s), piece):
        times_s = np.arange(first, first + piece) / SOUND_HZ
        wave = 0.5 * np.sin(2 * np.pi * 440 * times_s) * (times_s > tone_s)
        frame = av.AudioFrame.from_ndarray((wave * 32767).astype(np.int16)[None], format="s16", layout="mono")
        frame.sample_rate, frame.pts, frame.time_base = SOUND_HZ, first, Fraction(1, SOUND_HZ)
        file.mux(track.encode(frame))
    file.mux(track.encode(None))


def write_clip(path: Path, frames: Iterable[np.ndarray]) -> Path:
    """Encode frames (height, width, 3) as H.264 at 25 frames/s with little loss."""
    return encode(path, frames, options={"crf": "12", "preset": "ultrafast"})


def write_drive(path: Path, drive: PaintedDrive, count: int) -> Path:
    """Encode the first frames of a drive, and write its truth (.csv) and camera (.yaml) next to the video."""
    times_s = [number / FPS for number in range(count)]
    write_clip(path, map(drive.frame, times_s))
    write_truth_csv(path.with_suffix(".csv"), [truth_row(drive.truth(t), frame=n) for n, t in enumerate(times_s)])
    save_camera(drive.camera, path.with_suffix(".yaml"))
    return path
