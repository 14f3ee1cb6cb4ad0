"""Frames and properties of video files.

`read_timed_frames` is the one way that frames are read; damaged ones are skipped, and the others keep their times.
"""

from __future__ import annotations

import math
import sys
from collections import deque
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import chain, islice
from pathlib import Path

import av
import numpy as np
from av.video.reformatter import VideoReformatter
from tqdm import tqdm

from lanes.errors import ByValue, VideoError, require_number
from lanes.images import make_upright
from lanes.video.container import (
    CLOCK_RESET_S,
    CLOCK_SET_S,
    JUMP_FRAMES,
    VideoIndex,
    VideoInfo,
    decode_frames,
    frame_orientation,
    index_video,
    open_video,
    square_size,
)
from lanes.video.robot_log import index_log, is_robot_log, read_log

# Some containers round time stamps to a millisecond: a time stamp this close to a limit counts as equal.
STAMP_TOLERANCE_S = 1e-3
# Frames that wait between two threads. One would be enough if every step took constant time.
QUEUE_SIZE = 3
MIRRORED_WORDS = (
    "is shown mirrored, as its display matrix says: if the road is mirrored, too, left and right are exchanged; remove "
    "the flip then (ffmpeg -display_rotation 0 -i VIDEO -c copy NEW)"
)


@dataclass(frozen=True, eq=False)
class TimedFrame(ByValue):
    """One frame: its number, its time since the video's first frame, and the RGB image (height, width, 3), uint8."""

    number: int
    time_s: float
    image: np.ndarray = field(repr=False)
    # Seconds since the previous frame that was read, None for the first; they vary in videos of variable rate.
    elapsed_s: float | None = None
    # Time that a tracker took for it.
    latency_ms: float = 0.0


def inspect_video(path: str | Path, *, topic: str | None = None) -> VideoInfo:
    """Properties of a video file, with the frames counted; reads the whole file but decodes one frame.

    A file that was cut off has its frames up to there. `topic` is that of the images in a robot log, by default the
    only one. Raises FileNotFoundError, or VideoError if the file is empty, not a video, or without frames.
    """
    if not is_robot_log(path):
        return index_video(path).info
    log = index_log(path, topic)
    count, length_s = len(log.numbers), round(log.times_s[-1].item() + 1 / log.fps, 6)
    missing = int(log.numbers[-1]) + 1 - count
    return VideoInfo(*log.size, log.fps, count, length_s, False, missing, topic=log.topic, note=log.note)


def read_video(path: str | Path, *, start_s: float = 0.0, end_s: float | None = None) -> Generator[np.ndarray]:
    """Yield the RGB images (height, width, 3), uint8, of `read_timed_frames`; parameters and exceptions as there."""
    for frame in read_timed_frames(path, start_s=start_s, end_s=end_s):
        yield frame.image


def read_timed_frames(
    path: str | Path, *, start_s: float = 0.0, end_s: float | None = None, topic: str | None = None
) -> Generator[TimedFrame]:
    """Yield the frames with start_s <= time < end_s, seconds since the first frame, in order; None reads to the end.

    The images are turned and mirrored as the file's display matrix says, and the caller may write to them. Damaged
    frames are skipped; if the frame rate is constant, their numbers are skipped too. `topic` is as for `inspect_video`.
    Raises FileNotFoundError, or VideoError if the file is not a video, its frame size changes, or it ends before
    `start_s`.
    """
    start_s = require_number(start_s, "start_s")
    end_s = None if end_s is None else require_number(end_s, "end_s", finite=False)
    if not 0 <= start_s < (math.inf if end_s is None else end_s):
        raise VideoError(f"{path}: cannot read from {start_s} s to {end_s} s; give 0 <= start_s < end_s.")
    last_s = None
    read = _read_log(path, start_s, end_s, topic) if is_robot_log(path) else _read_frames(path, start_s, end_s)
    for number, time_s, image in read:
        yield TimedFrame(number, time_s, image, None if last_s is None else time_s - last_s)
        last_s = time_s
    if last_s is None:
        until = "" if end_s is None else f" and before {end_s:g} s"
        raise VideoError(f"{path}: has no frame at or after {start_s:g} s{until}; name another part of it.")


def read_frames(
    path: str | Path, info: VideoInfo, *, start_s: float = 0.0, end_s: float | None = None, progress: bool = False
) -> Generator[TimedFrame]:
    """The frames of `read_timed_frames`; another thread reads up to `QUEUE_SIZE` in advance.

    With `progress` a bar shows how far they are, if stderr is a terminal or a notebook.
    """
    expected = round((min(end_s or info.duration_s, info.duration_s) - start_s) * info.fps)
    # A notebook's stderr also handles the carriage return. Text needs no ipywidgets.
    interactive = sys.stderr.isatty() or type(sys.stderr).__module__.startswith("ipykernel")
    items = read_timed_frames(path, start_s=start_s, end_s=end_s, topic=info.topic)
    with (
        closing(items),
        ThreadPoolExecutor(1) as thread,
        tqdm(total=max(expected, 0), unit="frame", disable=not (progress and interactive)) as bar,
    ):
        waiting = deque(thread.submit(next, items, None) for _ in range(QUEUE_SIZE))
        while (frame := waiting.popleft().result()) is not None:
            waiting.append(thread.submit(next, items, None))
            yield frame
            bar.update()


def _read_log(
    path: str | Path, start_s: float, end_s: float | None, topic: str | None
) -> Iterator[tuple[int, float, np.ndarray]]:
    log, until_s = index_log(path, topic), math.inf if end_s is None else end_s
    first, end = np.searchsorted(log.times_s + STAMP_TOLERANCE_S, [start_s, until_s]).tolist()
    for index, image in read_log(path, log, first, end):
        yield log.numbers[index].item(), log.times_s[index].item(), image


def _read_frames(path: str | Path, start_s: float, end_s: float | None) -> Iterator[tuple[int, float, np.ndarray]]:
    index, number = index_video(path, whole=False), None
    converter = VideoReformatter()  # shared: its setup takes half as long as one conversion
    with closing(_frames_from(path, index, start_s)) as frames:
        for frame, time_s, stream in frames:
            if time_s < start_s - STAMP_TOLERANCE_S:
                continue
            if end_s is not None and time_s > end_s - STAMP_TOLERANCE_S:
                break
            place = round(time_s * index.rate)
            if number is not None:
                number = max(number + 1, place if index.constant_rate else 0)
            else:
                number, size = place, square_size(frame, stream)
                if not index.constant_rate and start_s > 0 and frame.pts is not None:
                    number = int(np.searchsorted(index_video(path).stamps, frame.pts))
            yield number, float(time_s), _upright_rgb(frame, size, converter, path)


def _frames_from(
    path: str | Path, index: VideoIndex, start_s: float
) -> Generator[tuple[av.VideoFrame, Fraction, av.VideoStream]]:
    """Frames with their times and their stream, from a key frame before `start_s` on.

    Where a seek is not possible, or ends behind `start_s`, as in transport streams with few key frames, they are from
    the first one on.
    """
    for seek in (True, False) if start_s > 1 else (False,):
        with open_video(path) as container:
            stream = container.streams.video[0]
            stream.thread_type = "AUTO"
            if seek:
                try:
                    # one second early, because some containers seek coarsely
                    at_s = start_s - 1 + index.start_s
                    container.seek(int(at_s / (stream.time_base or Fraction(1))), stream=stream)
                except av.FFmpegError:  # a raw stream
                    continue
            frames = _timed(decode_frames(container, stream), index, path)
            first = next(frames, None)
            if first is None or (seek and first[1] > start_s - STAMP_TOLERANCE_S):
                continue
            yield from ((frame, time_s, stream) for frame, time_s in chain([first], frames))
            return


def _timed(
    frames: Iterator[av.VideoFrame], index: VideoIndex, path: str | Path
) -> Iterator[tuple[av.VideoFrame, Fraction]]:
    """Frames with their times in seconds since the first one, monotonic; VideoError if the size changes."""
    size: tuple[int, int] | None = None
    last_s: Fraction | None = None
    zero_s = index.start_s
    ahead: deque[av.VideoFrame] = deque()  # looked at where the time stamps leave their order
    while frame := ahead.popleft() if ahead else next(frames, None):
        size = size or (frame.width, frame.height)
        if (frame.width, frame.height) != size:
            raise VideoError(
                f"{path}: changes from {size[0]}x{size[1]} to {frame.width}x{frame.height} pixels at "
                f"{float(last_s or 0):.2f} s; cut it there, or convert it to one size."
            )
        # Only raw streams have no time stamps, and they have no gaps.
        after_s = Fraction(0) if last_s is None else last_s + 1 / index.rate
        time_s = _stamp_s(frame, zero_s, after_s)
        if last_s is not None and not 0 <= time_s - last_s <= CLOCK_RESET_S:
            ahead.extend(islice(frames, 4 - len(ahead)))  # up to four frames in a row are outliers
            time_s = _without_outlier(last_s, time_s, [_stamp_s(f, zero_s, after_s) for f in ahead])
            if not last_s - CLOCK_RESET_S <= time_s <= last_s + CLOCK_SET_S:
                zero_s -= after_s - time_s
                time_s = after_s
        last_s = time_s if last_s is None else max(time_s, last_s)
        yield frame, last_s


def _stamp_s(frame: av.VideoFrame, zero_s: Fraction, otherwise_s: Fraction) -> Fraction:
    """Seconds from `zero_s` to the time stamp of a frame; `otherwise_s` without one."""
    return otherwise_s if frame.pts is None or frame.time_base is None else frame.pts * frame.time_base - zero_s


def _without_outlier(last_s: Fraction, time_s: Fraction, later: Sequence[Fraction]) -> Fraction:
    """A time stamp after `last_s`, or one between it and a later stamp that follows it, if the first does not."""
    for steps, later_s in enumerate(later, 2):
        follows = last_s < later_s <= last_s + CLOCK_SET_S
        if follows and not last_s - CLOCK_RESET_S <= time_s <= later_s + CLOCK_RESET_S:
            return last_s + (later_s - last_s) / steps
    return time_s


def _upright_rgb(
    frame: av.VideoFrame, size: tuple[int, int], converter: VideoReformatter, path: str | Path
) -> np.ndarray:
    """The RGB image of a frame of `size` (width, height) before rotation."""
    try:
        image = converter.reformat(frame, *size, format="rgb24", threads=1).to_ndarray()
    except av.FFmpegError as error:
        raise VideoError(
            f"{path}: its colours cannot be converted to RGB (matrix {frame.colorspace} of Recommendation H.273, "
            f"{frame.format.name}); export it with the colours of BT.709."
        ) from error
    return make_upright(image, frame_orientation(frame))


def describe_jumps(time_s: np.ndarray, fps: float) -> str:
    """What jumps in the times (N,) of frames mean, in words; empty without any."""
    jumps = np.flatnonzero(np.diff(time_s) * fps > JUMP_FRAMES)
    where = ", ".join(f"by {time_s[k + 1] - time_s[k]:.0f} s after {time_s[k]:.1f} s" for k in jumps[:5])
    return f"its clock jumps {where}: another recording begins there, and the tracker starts again" if where else ""
