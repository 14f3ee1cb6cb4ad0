"""Frames out of video files, through PyAV (FFmpeg inside this process)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from av.video.reformatter import VideoReformatter

# Some containers round time stamps to a millisecond, so that a stamp this close to a limit counts as on it.
STAMP_TOLERANCE_S = 1e-3


class VideoError(ValueError):
    """A video cannot be used; the message names the file, what is wrong and what to do."""


@dataclass(frozen=True)
class VideoInfo:
    """What a video file holds: size in pixels as shown (upright), frames per second, length, sound or not."""

    width: int
    height: int
    fps: float
    frames: int
    duration_s: float
    has_audio: bool


@dataclass(frozen=True, eq=False)
class TimedFrame:
    """One frame: its number and its time since the video's first frame, and the RGB picture (height, width, 3)."""

    number: int
    time_s: float
    image: np.ndarray


def inspect_video(path: str | Path) -> VideoInfo:
    """Look into a video file; only its first frame is decoded, but all are counted.

    Parameters
    ----------
    path : str or Path
        Any format that FFmpeg reads: mp4, mov, avi, mkv, webm, ts.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    VideoError
        If it is empty, no video, without frames, or cut off.
    """
    with open_video(path) as container:
        stream = container.streams.video[0]
        stored, shown, first = _count_packets(path, container)
        if first is None:
            raise VideoError(f"{path}: holds no frame that can be decoded; copy or export it again.")
        if stored < stream.frames:
            raise VideoError(
                f"{path}: is cut off after {stored} of the {stream.frames} frames that it announces; copy it again."
            )
        rate = _frame_rate(stream, path)
        height, width = _upright(first, VideoReformatter()).shape[:2]
        duration_s = round(float(shown / rate), 6)
        return VideoInfo(width, height, float(rate), shown, duration_s, bool(container.streams.audio))


def read_frames(path: str | Path, *, start_s: float = 0.0, end_s: float | None = None) -> Iterator[np.ndarray]:
    """Frames of a video in order, each once.

    Parameters
    ----------
    path : str or Path
    start_s, end_s : float
        The frames shown at or after `start_s` and before `end_s`, seconds since the first frame; None reads to the end.

    Yields
    ------
    ndarray of shape (height, width, 3), uint8
        RGB, upright where the file says that the camera was turned. Each is the receiver's own to write on.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    VideoError
        If it is no video, a frame is damaged, or it has ended before `start_s`.
    """
    for frame in read_timed_frames(path, start_s=start_s, end_s=end_s):
        yield frame.image


def read_timed_frames(
    path: str | Path, *, start_s: float = 0.0, end_s: float | None = None, threads: int = 0
) -> Iterator[TimedFrame]:
    """As `read_frames`, with the number and time of each frame; `threads` decode, 0 stands for one a core."""
    if not 0 <= start_s < (math.inf if end_s is None else end_s):
        raise VideoError(f"{path}: cannot read from {start_s} s to {end_s} s; give 0 <= start_s < end_s.")
    number = None
    with open_video(path) as container:
        stream = container.streams.video[0]
        stream.thread_type, stream.codec_context.thread_count = "AUTO", threads
        rate = _frame_rate(stream, path)
        converter = VideoReformatter()  # one for all frames: setting it up takes half as long as using it
        for frame in _decoded_from(path, container, start_s):
            # Only raw streams have no time stamps; they have no gaps either.
            time_s = _seconds_since_start(frame, stream) if frame.pts is not None else (number or 0) / rate
            if time_s < start_s - STAMP_TOLERANCE_S:
                continue
            if end_s is not None and time_s > end_s - STAMP_TOLERANCE_S:
                break
            number = round(time_s * rate) if number is None else number + 1
            yield TimedFrame(number, float(time_s), _upright(frame, converter))
    if number is None:
        raise VideoError(f"{path}: has no frame at or after {start_s} s; start earlier.")


def open_video(path: str | Path) -> av.container.InputContainer:
    """Open a file that must exist and hold a video stream."""
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path}: there is no such video file; check the name and the folder.")
    if path.stat().st_size == 0:
        raise VideoError(f"{path}: the file is empty; copy it again from its source.")
    try:
        container = av.open(str(path))
    except av.FFmpegError as error:
        raise VideoError(
            f"{path}: cannot be read as a video ({error.strerror}): it is none, or it was cut off; copy it again."
        ) from error
    if not container.streams.video:
        kinds = " and ".join(sorted({stream.type for stream in container.streams})) or "none"
        container.close()
        raise VideoError(f"{path}: holds no frame of a video (its streams: {kinds}); name a video file.")
    return container


def _count_packets(path: str | Path, container: av.container.InputContainer) -> tuple[int, int, av.VideoFrame | None]:
    """Stored frames, those of them that are shown, and the first one decoded (None if there is none)."""
    stored = shown = 0
    first = None
    for packet in guarded(container.demux(container.streams.video[0]), path):
        stored += packet.size > 0
        # A clip that was cut without encoding it again begins with frames that serve only to decode the others.
        shown += packet.size > 0 and not packet.is_discard
        if first is None:
            first = next(guarded(_decoded(packet), path), None)
    return stored, shown, first


def _decoded(packet: av.Packet) -> Iterator[av.VideoFrame]:
    """The frames of a packet; errors come when the first is asked for."""
    yield from packet.decode()


def _decoded_from(path: str | Path, container: av.container.InputContainer, start_s: float) -> Iterator[av.VideoFrame]:
    """Decoded frames from the last key frame before `start_s`, one second early for containers that seek coarsely."""
    stream = container.streams.video[0]
    if start_s > 1:
        container.seek(int((start_s - 1 + start_time(stream)) / stream.time_base), stream=stream)
    return guarded(container.decode(stream), path)


def guarded(items: Iterator, path: str | Path) -> Iterator:
    """The same items; FFmpeg's errors on the way become sentences."""
    try:
        yield from items
    except av.FFmpegError as error:
        raise VideoError(f"{path}: is damaged ({error.strerror}); copy or export it again.") from error


def _frame_rate(stream: av.VideoStream, path: str | Path) -> Fraction:
    rate = stream.average_rate or stream.guessed_rate
    if not rate:
        raise VideoError(f"{path}: does not say its frame rate; convert it to mp4 first.")
    return rate


def start_time(stream: av.VideoStream) -> Fraction:
    """When the first frame is shown, in the container's seconds: not 0 in transport streams."""
    return (stream.start_time or 0) * stream.time_base


def _seconds_since_start(frame: av.VideoFrame, stream: av.VideoStream) -> Fraction:
    return frame.pts * frame.time_base - start_time(stream)


def _upright(frame: av.VideoFrame, converter: VideoReformatter) -> np.ndarray:
    """RGB picture of a decoded frame, turned as its display matrix says, in quarter turns."""
    image = converter.reformat(frame, format="rgb24", threads=1).to_ndarray()
    turns = round(frame.rotation / 90) % 4
    return np.ascontiguousarray(np.rot90(image, turns)) if turns else image
