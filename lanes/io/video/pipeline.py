"""Videos: read frames, process them in order, write them so that every browser plays the result.

The course teaches moviepy (`open_clip` gives its clip; `image_transform` and `write_videofile` follow), because three
lines of it show the idea. `annotate_video` does the same job frame by frame with PyAV, which is FFmpeg inside this
process. What decided it, measured with moviepy 2.2.1 and PyAV 18.1:

- moviepy calls the function once before the first frame, so that a tracker sees that frame twice, and derives the
  number of frames from a rounded duration: 251 frames at 25 a second come out as 250. Here each frame comes once, and
  what was written is counted;
- it hands the frame rate on with two decimals: 24000/1001 becomes 1199/50. Here the rate is exact, and a video of
  variable rate keeps its time stamps;
- it encodes the sound again, by way of a file in the working directory. Here its packets are copied;
- pictures of odd size come out in the profile High 4:4:4, which not every browser plays. Here they are padded;
- it ignores FFmpeg's exit code, and after an exception leaves a playable half under the final name. Here a file gets
  its name when it is whole;
- it takes 32 ms of processor time for each frame of 1280x720, reading and writing; this takes 24 ms (both with x264's
  veryfast), and reads, processes and writes at the same time (see `overlap`).
"""

from __future__ import annotations

import inspect
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from tqdm import tqdm

from lanes.io.frames import Frame, PictureError, YuvFrame
from lanes.io.telemetry import TelemetryWriter
from lanes.io.video.container import VideoError
from lanes.io.video.overlap import read_ahead, write_behind
from lanes.io.video.reader import (
    STAMP_TOLERANCE_S,
    VideoInfo,
    inspect_video,
    read_timed_frames,
    to_upright_rgb,
    to_upright_yuv,
)
from lanes.io.video.writer import ENCODER_THREADS, VideoWriter

if TYPE_CHECKING:
    from moviepy import VideoFileClip

Row = Mapping[str, object]
Process = Callable[..., "Frame | tuple[Frame, Row]"]


@dataclass(frozen=True)
class YuvProcess:
    """A function for `annotate_video` that takes frames as the video stores them, `YuvFrame`, instead of RGB.

    That saves two conversions of each frame, and all that the function does not draw on comes out as it was decoded.
    """

    process: Process


@dataclass(frozen=True)
class VideoSummary:
    """What `annotate_video` did: frames read and written, frames per second, size written, sound or not.

    `missing` frames are damaged in the source or not there; they are left out, and those around them keep their times.
    `elapsed_s` is the time that it took; it is left out when printed, so that two runs print the same.
    """

    path: Path
    frames_in: int
    frames_out: int
    fps: float
    width: int
    height: int
    duration_s: float
    has_audio: bool
    missing: int
    elapsed_s: float = field(repr=False, compare=False)


def open_clip(path: str | Path, *, start_s: float = 0.0, end_s: float | None = None) -> VideoFileClip:
    """A moviepy clip of a video that has been looked into, so that a bad file gives a sentence.

    Close it after use, best by `with open_clip(...) as clip`. Its frames are read-only; the functions of `draw` accept
    them. The sound is left out.

    Raises
    ------
    FileNotFoundError, VideoError
        As `inspect_video`; also if the piece does not lie within the video.
    """
    info = inspect_video(path)
    if not 0 <= start_s < (info.duration_s if end_s is None else min(end_s, info.duration_s)):
        raise VideoError(f"{path}: lasts {info.duration_s} s; there is no piece from {start_s} s to {end_s} s.")
    # Imported here: it takes longer than all the rest together, and only the course's chapter on it needs it.
    from moviepy import VideoFileClip

    clip = VideoFileClip(str(path), audio=False)
    return clip.subclipped(start_s, None if end_s is None else min(end_s, clip.duration))


def annotate_video(
    source: str | Path,
    target: str | Path,
    process: Process | YuvProcess,
    *,
    start_s: float = 0.0,
    end_s: float | None = None,
    progress: bool = True,
    telemetry: str | Path | None = None,
    sound: bool = True,
    warm_up_s: float = 0.0,
    overlapped: bool = True,
    info: VideoInfo | None = None,
) -> VideoSummary:
    """Run every frame of a video through `process` and write the result as an mp4 that browsers play.

    Parameters
    ----------
    source, target : str or Path
        `target` ends in .mp4 and appears only when it is whole; whatever stops the run, Ctrl-C and SIGTERM included,
        leaves an earlier file of that name as it was and no other file behind.
    process : callable or YuvProcess
        Takes a frame, ndarray of shape (height, width, 3), uint8, RGB, its own to write on, and returns the annotated
        one, or that and a mapping with the frame's telemetry. Called once a frame, in order, by the caller's thread;
        others read ahead and write behind meanwhile. All pictures that it returns must have one size. If it has a
        parameter `elapsed_s`, it is told the seconds since the frame before, None for the first: they differ from
        frame to frame in videos of variable rate. `YuvProcess` holds a function that takes and returns `YuvFrame`s.
    start_s, end_s : float
        The piece to work on, see `read_frames`.
    progress : bool
        Show frames a second and the time left, in a terminal and in a notebook; log files stay clean.
    telemetry : str or Path, optional
        CSV file for a row a frame: frame (counted from the start of `source`), time_s, what `process` returned, and
        latency_ms, the time that `process` took.
    sound : bool
        Keep the sound track, if there is one.
    warm_up_s : float
        `process` is also given the frames of so many seconds before `start_s`; what it makes of them is not written.
    overlapped : bool
        Read, process and write at the same time, with codecs of several threads. False keeps to one thread, where
        other processes have work for the other cores; the telemetry is the same, the encoder's bytes are others.
    info : VideoInfo, optional
        What `inspect_video` says of `source`, where that is known: to find out it reads the whole file.

    Raises
    ------
    FileNotFoundError, VideoError
        If `source` cannot be used, `process` returns no picture, or not all frames were written.
    PictureError
        If `process` refuses a frame, for instance because the camera is of another size.
    OSError
        If `target` cannot be written.
    """
    began_s = time.perf_counter()
    info = info or inspect_video(source)
    if Path(target).exists() and os.path.samefile(source, target):
        raise VideoError(f"{target}: is the source itself; write the annotated video under another name.")
    decoders, encoders = (0, ENCODER_THREADS) if overlapped else (1, 1)
    sound_from = source if sound and info.has_audio else None
    writer = VideoWriter(target, fps=info.fps, sound_from=sound_from, threads=encoders)
    convert = to_upright_rgb
    if isinstance(process, YuvProcess):
        process, convert = process.process, to_upright_yuv
    first_s = max(0.0, start_s - warm_up_s)
    read = read_timed_frames(source, start_s=first_s, end_s=end_s, threads=decoders, convert=convert)
    with (
        _stopping_cleanly(),
        # In this order: telemetry gets its name only when the video has.
        nullcontext() if telemetry is None else TelemetryWriter(telemetry) as table,
        writer,
        closing(read_ahead(read) if overlapped else read) as frames,
        write_behind(writer.encode) if overlapped else nullcontext(writer.encode) as encode,
        _progress_bar(info, start_s, end_s, shown=progress) as bar,
    ):
        process, last_s, numbers = _with_time(process), None, []
        for frame in frames:
            elapsed_s = None if last_s is None else frame.time_s - last_s
            picture, row = _processed(process, frame.image, elapsed_s, f"frame {frame.number} of {source}")
            last_s = frame.time_s
            if frame.time_s < start_s - STAMP_TOLERANCE_S:
                continue
            # Converted here and not behind: `process` may return the same array again and again.
            encode(writer.convert(picture, frame.time_s))
            if table:
                table.write({"frame": frame.number, "time_s": round(frame.time_s, 6), **row})
            bar.update()
            numbers = [*numbers[:1], frame.number]
    missing = count_missing(info, numbers[0], numbers[-1], writer.frames, start_s=start_s, end_s=end_s)
    return _summary(writer, missing, time.perf_counter() - began_s)


def count_missing(
    info: VideoInfo, first: int, last: int, frames: int, *, start_s: float = 0.0, end_s: float | None = None
) -> int:
    """How many frames of a piece of a video are damaged or not there, if `frames` came, numbered `first` to `last`."""
    whole = start_s == 0 and (end_s is None or end_s >= info.duration_s)
    return max(0, (info.frames + info.missing if whole else last - first + 1) - frames)


def _progress_bar(info: VideoInfo, start_s: float, end_s: float | None, *, shown: bool) -> tqdm:
    """Frames done, frames a second and the time left; hidden where it would only fill a log file."""
    expected = round((min(end_s or info.duration_s, info.duration_s) - start_s) * info.fps)
    # A notebook's stderr is no terminal, but obeys the carriage return too. Text needs no ipywidgets.
    watched = sys.stderr.isatty() or type(sys.stderr).__module__.startswith("ipykernel")
    return tqdm(total=max(expected, 0), unit="frame", disable=not (shown and watched))


def _with_time(process: Process) -> Process:
    """`process` as a function of a frame and `elapsed_s`, whether it cares for the time or not."""
    try:
        cares = "elapsed_s" in inspect.signature(process).parameters
    except ValueError:
        cares = False  # functions written in C do not tell their parameters
    return process if cares else lambda frame, elapsed_s: process(frame)


def _processed(process: Process, frame: Frame, elapsed_s: float | None, name: str) -> tuple[Frame, Row]:
    """What `process` makes of a frame: the picture, and its telemetry with the time that it took."""
    began_s = time.perf_counter()
    try:
        result = process(frame, elapsed_s=elapsed_s)
    except PictureError as error:
        # It says "picture", because `process` does not know which one it is.
        raise PictureError(f"{name}: {str(error).removeprefix('picture: ')}") from error
    except Exception as error:
        error.add_note(f"(while processing {name})")
        raise
    latency_ms = round((time.perf_counter() - began_s) * 1e3, 3)
    picture, row = result if isinstance(result, tuple) else (result, {})
    _require_picture(picture, name)
    return picture, {**row, "latency_ms": latency_ms}


def _require_picture(result: object, name: str) -> None:
    if isinstance(result, YuvFrame):
        return
    if not isinstance(result, np.ndarray) or result.ndim != 3 or result.shape[2] != 3 or result.dtype != np.uint8:
        got = f"{result.dtype} of shape {result.shape}" if isinstance(result, np.ndarray) else type(result).__name__
        raise VideoError(f"{name}: process returned {got}; it must return an RGB picture (height, width, 3), uint8.")


def _summary(writer: VideoWriter, missing: int, elapsed_s: float) -> VideoSummary:
    written = writer.written
    about = written.fps, written.width, written.height, written.duration_s, written.has_audio
    return VideoSummary(writer.path, writer.frames, written.frames, *about, missing, elapsed_s)


@contextmanager
def _stopping_cleanly() -> Iterator[None]:
    """Turn SIGTERM into an exception, as Ctrl-C is one, so that half-written files are removed."""
    in_main = threading.current_thread() is threading.main_thread()
    # Python allows handlers in the main thread only; one that the caller has set is left to do its work.
    if not in_main or signal.getsignal(signal.SIGTERM) != signal.SIG_DFL:
        yield
        return

    def stop(number: int, _: object) -> None:
        raise SystemExit(128 + number)

    signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
