"""A video from file to file: every frame is read, passed to a function and written, once, in order and at its own time.

Decoding and encoding release Python's global lock: three frames are read, processed and written at the same time.
"""

from __future__ import annotations

import inspect
import os
import sys
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
from tqdm import tqdm

from lanes.errors import PictureError, VideoError, require_number
from lanes.files import TelemetryWriter, translate_write_errors
from lanes.video.container import VideoInfo, count_missing
from lanes.video.reader import TimedFrame, inspect_video, read_timed_frames
from lanes.video.writer import VideoWriter

Row = Mapping[str, object]
# Frames that wait between two threads. One would be enough if every step took constant time.
_QUEUE_SIZE = 3


def process_video(
    source: str | Path,
    target: str | Path,
    function: Callable[..., np.ndarray | tuple[np.ndarray, Row]],
    *,
    start_s: float = 0.0,
    end_s: float | None = None,
    progress: bool = True,
    telemetry: str | Path | TelemetryWriter | None = None,
    info: VideoInfo | None = None,
) -> VideoInfo:
    """Write what a function makes of every frame of a video as an mp4 that browsers play, with the source's sound.

    Parameters
    ----------
    source, target : str or Path
        `target` ends in .mp4 and is written atomically: after an exception or Ctrl-C an earlier file of that name is
        unchanged, and no other file remains. It has the frame rate and time stamps of `source`.
    function : callable
        Takes an RGB image (height, width, 3), uint8, which it may overwrite. Returns an RGB image, or a pair of that
        and a mapping with the frame's telemetry. It is called once per frame, in order, in the caller's thread. All
        returned images must have the same size. If it has a parameter `elapsed_s`, it gets the seconds since the
        previous frame, None for the first; they vary in videos of variable rate.
    start_s, end_s : float
        As for `read_timed_frames`.
    progress : bool
        Show frames per second and the remaining time, in a terminal or a notebook only.
    telemetry : str, Path or TelemetryWriter, optional
        CSV file with a row per frame: frame (counted from the start of `source`), time_s, the telemetry of `function`,
        and, unless that contains it, latency_ms, the time that `function` took.
    info : VideoInfo, optional
        Result of `inspect_video(source)`, if known; otherwise the file is read twice.

    Returns
    -------
    VideoInfo
        Properties of `target`, with its frames counted; every processed frame is in it. `missing` counts the frames of
        `source` that are damaged or not there: they are skipped, and the others keep their times.

    Raises
    ------
    FileNotFoundError, LaneError, OSError
        If `source` cannot be used, `function` refuses a frame or returns no RGB image, or an output cannot be written.
    """
    start_s = require_number(start_s, "start_s")
    end_s = None if end_s is None else require_number(end_s, "end_s", finite=False)
    info = info or inspect_video(source)
    with translate_write_errors(Path(target)):
        same = Path(target).exists() and os.path.samefile(source, target)
    if same:
        raise VideoError(f"{target}: is the source itself; write the output under another name.")
    if isinstance(telemetry, str | Path):
        telemetry = TelemetryWriter(telemetry)
    sound_from = source if info.has_audio else None
    writer = VideoWriter(target, fps=info.fps, sound_from=sound_from)
    try:
        takes_time = "elapsed_s" in inspect.signature(function).parameters
    except ValueError:
        takes_time = False  # functions written in C have no signature
    with (
        # This order renames the telemetry file only after the video.
        telemetry or nullcontext() as table,
        writer,
        closing(read_frames(source, info, start_s=start_s, end_s=end_s, progress=progress)) as frames,
        _write_behind(writer.encode) as encode,
    ):
        numbers: list[int] = []
        for frame in frames:
            options = {"elapsed_s": frame.elapsed_s} if takes_time else {}
            image, row = _apply(function, frame.image, options, f"frame {frame.number} of {source}")
            # Converted in this thread: `function` may return the same array every time.
            encode(writer.convert(image, frame.time_s))
            if table:
                table.write({"frame": frame.number, "time_s": round(frame.time_s, 6), **row})
            numbers.append(frame.number)
    whole = start_s == 0 and (end_s is None or end_s >= info.duration_s)
    gaps = np.diff(numbers) - 1
    missing = info.frames + info.missing - len(numbers) if whole else count_missing(gaps)
    return replace(writer.written, missing=max(0, missing))


def _apply(function: Callable, image: np.ndarray, options: Mapping, name: str) -> tuple[np.ndarray, Row]:
    """The image that `function` returns, and its telemetry with the latency; errors begin with the frame's `name`."""
    began_s = time.perf_counter()
    try:
        result = function(image, **options)
    except PictureError as error:
        # The message begins with "image", because `function` does not know the frame's number.
        raise PictureError(f"{name}: {str(error).removeprefix('image: ')}") from error
    except Exception as error:
        error.add_note(f"(while processing {name})")
        raise
    latency_ms = round((time.perf_counter() - began_s) * 1e3, 3)
    made, row = result if isinstance(result, tuple) else (result, {})
    if not isinstance(made, np.ndarray) or made.ndim != 3 or made.shape[2] != 3 or made.dtype != np.uint8:
        got = f"{made.dtype} of shape {made.shape}" if isinstance(made, np.ndarray) else type(made).__name__
        raise VideoError(f"{name}: the function returned {got}; it must return an RGB image (height, width, 3), uint8.")
    return made, {**row, "latency_ms": row.get("latency_ms", latency_ms)}


def read_frames(
    path: str | Path, info: VideoInfo, *, start_s: float = 0.0, end_s: float | None = None, progress: bool = False
) -> Generator[TimedFrame]:
    """The frames of `read_timed_frames`; another thread reads up to `_QUEUE_SIZE` in advance.

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
        waiting = deque(thread.submit(next, items, None) for _ in range(_QUEUE_SIZE))
        while (frame := waiting.popleft().result()) is not None:
            waiting.append(thread.submit(next, items, None))
            yield frame
            bar.update()


@contextmanager
def _write_behind(write: Callable) -> Iterator[Callable]:
    """A function that queues an item for `write` in another thread; it blocks while `_QUEUE_SIZE` items are waiting.

    An exception of `write` is raised by a later call or at the end of the block. All items are written at its end.
    """
    waiting: deque[Future] = deque()
    with ThreadPoolExecutor(1) as thread:

        def put(item: object) -> None:
            waiting.append(thread.submit(write, item))
            if len(waiting) > _QUEUE_SIZE:
                waiting.popleft().result()

        yield put
        for written in waiting:
            written.result()
