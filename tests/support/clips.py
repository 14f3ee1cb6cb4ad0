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


def encode(  # noqa: PLR0913 (options, called by name)
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
    sound: str | Sequence[str] = (),
    sound_s: float = 0.0,
    sound_end_s: float | None = None,
    tone_s: float | None = None,
    **audio: object,
) -> Path:
    """Write RGB images, or frames of the pixel format, as a video; returns its path.

    The `container` is that of the suffix, if it is not named. `numbers` are the places
    of the frames on the clock, by default 0, 1, 2, ... `header` are attributes of the
    codec. `edit` is given the packets and returns those to write. `sound` is the codec
    of a sound track, or of several, from `sound_s` to `sound_end_s`, by default the end
    of the last frame, with the tone of `add_tone`, half a second later in each track;
    `audio` may have a rate and a layout.
    """
    frames = [_as_frame(image, pixels) for image in images]
    if numbers is None:
        numbers = range(len(frames))
    # The clock of a transport stream of a recorder does not begin at 0.
    clock = {"output_ts_offset": "5"} if path.suffix == ".ts" else {}
    with av.open(str(path), "w", format=container, options=clock) as file:
        stream = file.add_stream(codec, rate=Fraction(fps), options=options or {})
        stream.width = frames[0].width
        stream.height = frames[0].height
        stream.pix_fmt = pixels
        if pixels == "yuvj420p":  # full range
            stream.codec_context.color_range = 2
        for name, value in (header or {}).items():
            setattr(stream.codec_context, name, value)
        audio = {"rate": SOUND_HZ, "layout": "mono"} | audio
        codecs = [sound] if isinstance(sound, str) else sound
        tracks = [file.add_stream(name, **audio) for name in codecs]

        packets = []
        for number, frame in zip(numbers, frames, strict=True):
            frame.pts = number
            frame.time_base = 1 / Fraction(fps)
            packets += stream.encode(frame)
        packets += stream.encode(None)
        file.mux(edit(packets) if edit else packets)
        end_s = sound_end_s or (numbers[-1] + 1) / float(fps)
        for number, track in enumerate(tracks):
            begins_s = None if tone_s is None else tone_s + number / 2
            add_tone(file, track, sound_s, end_s, begins_s)
    return path


def _as_frame(image: np.ndarray | av.VideoFrame, pixels: str) -> av.VideoFrame:
    if isinstance(image, av.VideoFrame):
        return image
    return av.VideoFrame.from_ndarray(image).reformat(format=pixels)


def add_tone(
    file: OutputContainer,
    track: av.AudioStream,
    begin_s: float,
    end_s: float,
    tone_s: float | None = None,
) -> None:
    """Sound with a tone from `tone_s` on, by default in its second half, so that a
    shift is noticed.
    """
    if tone_s is None:
        tone_s = (begin_s + end_s) / 2
    first = round(SOUND_HZ * begin_s)
    last = round(SOUND_HZ * end_s)
    piece = SOUND_HZ // 50
    for start in range(first, last, piece):
        times_s = np.arange(start, start + piece) / SOUND_HZ
        wave = 0.5 * np.sin(2 * np.pi * 440 * times_s) * (times_s > tone_s)
        samples = (wave * 32767).astype(np.int16)[None]
        frame = av.AudioFrame.from_ndarray(samples, format="s16", layout="mono")
        frame.sample_rate = SOUND_HZ
        frame.pts = start
        frame.time_base = Fraction(1, SOUND_HZ)
        file.mux(track.encode(frame))
    file.mux(track.encode(None))


def write_clip(path: Path, frames: Iterable[np.ndarray]) -> Path:
    """Encode frames (height, width, 3) as H.264 at 25 frames/s with little loss."""
    return encode(path, frames, options={"crf": "12", "preset": "ultrafast"})


def write_drive(path: Path, drive: PaintedDrive, count: int) -> Path:
    """Encode the first frames of a drive, and write its truth (.csv) and camera (.yaml)
    next to the video.
    """
    times_s = np.arange(count) / FPS
    write_clip(path, map(drive.frame, times_s))
    truths = map(drive.truth, times_s)
    rows = [truth_row(truth, frame=number) for number, truth in enumerate(truths)]
    write_truth_csv(path.with_suffix(".csv"), rows)
    save_camera(drive.camera, path.with_suffix(".yaml"))
    return path
