"""Videos from file to file: read frames, process them in order, write a video that browsers play.

Every frame is processed once, at its own time, also in videos of variable rate. The sound is copied where browsers play
it. A video that is not finished never has the final name.
"""

from __future__ import annotations

import inspect
import os
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tqdm import tqdm

from lanes.errors import PictureError, VideoError
from lanes.files import TelemetryWriter
from lanes.video.reader import (
    STAMP_TOLERANCE_S,
    VideoInfo,
    inspect_video,
    read_timed_frames,
)
from lanes.video.writer import ENCODER_THREADS, VideoWriter

Row = Mapping[str, object]
Process = Callable[..., "np.ndarray | tuple[np.ndarray, Row]"]


@dataclass(frozen=True)
class VideoSummary:
    """Result of `annotate_video`.

    `frames_in` were processed and `frames_out` counted in the output; size, rate and duration are those of the output.
    `missing` frames of the source are damaged or not there; they are skipped, and the others keep their times.
    """

    frames_in: int
    frames_out: int
    fps: float
    width: int
    height: int
    duration_s: float
    has_audio: bool
    missing: int


def annotate_video(
    source: str | Path,
    target: str | Path,
    process: Process,
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
    """Process every frame of a video and write the result as an mp4 that browsers play.

    Parameters
    ----------
    source, target : str or Path
        `target` ends in .mp4 and is written atomically: after an exception, Ctrl-C or SIGTERM an earlier file of that
        name is unchanged, and no other file remains.
    process : callable
        Takes a frame, an RGB array (height, width, 3), uint8, which it may overwrite. Returns the annotated frame, or a
        pair of that and a mapping with the frame's telemetry. It is called once per frame, in order, in the caller's
        thread. All returned pictures must have the same size. If it has a parameter `elapsed_s`, it gets the seconds
        since the previous frame, None for the first; they vary in videos of variable rate.
    start_s, end_s
        As for `read_frames`.
    progress : bool
        Show frames per second and the remaining time, in a terminal or a notebook only.
    telemetry : str or Path, optional
        CSV file with a row per frame: frame (counted from the start of `source`), time_s, the telemetry of `process`,
        and latency_ms, the time that `process` took.
    warm_up_s : float
        `process` also gets the frames of this time before `start_s`; its results for them are not written.
    overlapped : bool
        Read, process and write at the same time, with multi-threaded codecs. False uses one thread, for runs with one
        process per core; the telemetry is the same, the encoder's bytes differ.
    info : VideoInfo, optional
        Result of `inspect_video(source)`, if known; otherwise the file is read twice.

    Raises
    ------
    FileNotFoundError, VideoError
        If `source` cannot be used, `process` does not return a picture, or frames are missing in the output.
    PictureError
        If `process` refuses a frame, for instance because its size differs from the camera's.
    OSError
        If `target` or `telemetry` cannot be written.
    """
    info = info or inspect_video(source)
    if Path(target).exists() and os.path.samefile(source, target):
        raise VideoError(f"{target}: is the source itself; write the annotated video under another name.")
    decoders, encoders = (0, ENCODER_THREADS) if overlapped else (1, 1)
    sound_from = source if sound and info.has_audio else None
    writer = VideoWriter(target, fps=info.fps, sound_from=sound_from, colours=info.colours, threads=encoders)
    first_s = max(0.0, start_s - warm_up_s)
    read = read_timed_frames(source, start_s=first_s, end_s=end_s, threads=decoders)
    with (
        _sigterm_as_exception(),
        # This order renames the telemetry file only after the video.
        nullcontext() if telemetry is None else TelemetryWriter(telemetry) as table,
        writer,
        closing(read_ahead(read) if overlapped else read) as frames,
        write_behind(writer.encode) if overlapped else nullcontext(writer.encode) as encode,
        _progress_bar(info, start_s, end_s, shown=progress) as bar,
    ):
        process = _with_time(process)
        last_s: float | None = None
        numbers: list[int] = []
        for frame in frames:
            elapsed_s = None if last_s is None else frame.time_s - last_s
            picture, row = _processed(process, frame.image, elapsed_s, f"frame {frame.number} of {source}")
            last_s = frame.time_s
            if frame.time_s < start_s - STAMP_TOLERANCE_S:
                continue
            # Converted in this thread: `process` may return the same array every time.
            encode(writer.convert(picture, frame.time_s))
            if table:
                table.write({"frame": frame.number, "time_s": round(frame.time_s, 6), **row})
            bar.update()
            numbers = [*numbers[:1], frame.number]
    written = writer.written
    return VideoSummary(
        frames_in=writer.frames,
        frames_out=written.frames,
        fps=written.fps,
        width=written.width,
        height=written.height,
        duration_s=written.duration_s,
        has_audio=written.has_audio,
        missing=count_missing(info, numbers[0], numbers[-1], writer.frames, start_s=start_s, end_s=end_s),
    )


def count_missing(
    info: VideoInfo, first: int, last: int, frames: int, *, start_s: float = 0.0, end_s: float | None = None
) -> int:
    """Number of damaged or missing frames in a part of a video whose `frames` have numbers from `first` to `last`."""
    whole = start_s == 0 and (end_s is None or end_s >= info.duration_s)
    return max(0, (info.frames + info.missing if whole else last - first + 1) - frames)


def _progress_bar(info: VideoInfo, start_s: float, end_s: float | None, *, shown: bool) -> tqdm:
    """A progress bar in frames; hidden if stderr is neither a terminal nor a notebook."""
    expected = round((min(end_s or info.duration_s, info.duration_s) - start_s) * info.fps)
    # A notebook's stderr also handles the carriage return. Text needs no ipywidgets.
    interactive = sys.stderr.isatty() or type(sys.stderr).__module__.startswith("ipykernel")
    return tqdm(total=max(expected, 0), unit="frame", disable=not (shown and interactive))


def _with_time(process: Process) -> Process:
    """`process` as a function of a frame and `elapsed_s`."""
    try:
        takes_time = "elapsed_s" in inspect.signature(process).parameters
    except ValueError:
        takes_time = False  # functions written in C have no signature
    return process if takes_time else lambda frame, elapsed_s: process(frame)


def _processed(process: Process, frame: np.ndarray, elapsed_s: float | None, name: str) -> tuple[np.ndarray, Row]:
    """The picture that `process` returns for a frame, and its telemetry with the latency; errors name the frame."""
    began_s = time.perf_counter()
    try:
        result = process(frame, elapsed_s=elapsed_s)
    except PictureError as error:
        # The message begins with "picture", because `process` does not know the frame's number.
        raise PictureError(f"{name}: {str(error).removeprefix('picture: ')}") from error
    except Exception as error:
        error.add_note(f"(while processing {name})")
        raise
    latency_ms = round((time.perf_counter() - began_s) * 1e3, 3)
    picture, row = result if isinstance(result, tuple) else (result, {})
    _require_picture(picture, name)
    return picture, {**row, "latency_ms": latency_ms}


def _require_picture(result: object, name: str) -> None:
    if not isinstance(result, np.ndarray) or result.ndim != 3 or result.shape[2] != 3 or result.dtype != np.uint8:
        got = f"{result.dtype} of shape {result.shape}" if isinstance(result, np.ndarray) else type(result).__name__
        raise VideoError(f"{name}: process returned {got}; it must return an RGB picture (height, width, 3), uint8.")


@contextmanager
def _sigterm_as_exception() -> Iterator[None]:
    """Turn SIGTERM into an exception, as for Ctrl-C, so that unfinished files are removed."""
    in_main = threading.current_thread() is threading.main_thread()
    # Python allows handlers in the main thread only; a handler of the caller is kept.
    if not in_main or signal.getsignal(signal.SIGTERM) != signal.SIG_DFL:
        yield
        return
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


# Read-ahead and write-behind for a loop over frames, each in its own thread.
#
# Decoding and encoding release Python's global lock, so that three frames are decoded, processed and encoded at the
# same
# time. Order and results are those of the plain loop. Exceptions of both threads are raised in the loop.

# Items between two threads. One would be enough if every step took constant time; many would only take memory.
QUEUE_SIZE = 3


def read_ahead(items: Generator, *, queue_size: int = QUEUE_SIZE) -> Generator:
    """The same items in the same order; up to `queue_size` are fetched in advance by another thread.

    Close it when leaving early (`contextlib.closing`): closing waits for the item being fetched and closes `items`.
    """
    end = object()
    pool = ThreadPoolExecutor(1, "read_ahead")
    try:
        waiting = deque(pool.submit(next, items, end) for _ in range(queue_size))
        while (item := waiting.popleft().result()) is not end:
            waiting.append(pool.submit(next, items, end))
            yield item
    finally:
        pool.shutdown(cancel_futures=True)
        items.close()


@contextmanager
def write_behind(write: Callable, *, queue_size: int = QUEUE_SIZE) -> Iterator[Callable]:
    """A function that queues an item for `write` in another thread; it blocks while `queue_size` items are waiting.

    All items have been written at the end of the `with` block. An exception of `write` is raised by a later call or at
    the end of the block. After an exception, also of the block itself, the waiting items are dropped. In all cases the
    thread has ended when the block is left.
    """
    pool = ThreadPoolExecutor(1, "write_behind")
    waiting: deque[Future] = deque()

    def put(item: object) -> None:
        if len(waiting) == queue_size:
            waiting.popleft().result()
        waiting.append(pool.submit(write, item))

    try:
        yield put
        for written in waiting:
            written.result()
    finally:
        pool.shutdown(cancel_futures=True)
