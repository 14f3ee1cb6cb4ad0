"""Sample pictures of a drive, from stills and videos."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import groupby
from operator import itemgetter
from pathlib import Path

import numpy as np

from lanes.io.frames import as_rgb
from lanes.io.images import PICTURE_SUFFIXES, read_image
from lanes.io.video.container import VideoError
from lanes.io.video.reader import TimedFrame, inspect_video, read_timed_frames

# Reading this much of a video takes about as long as reopening it at another time.
SEEK_S = 2.0


def pick_pictures(
    files: list[Path],
    max_pictures: int,
    *,
    require: Callable[[np.ndarray, Path], None] | None = None,
    start_s: float = 0.0,
    end_s: float | None = None,
) -> Iterator[np.ndarray]:
    """Yield up to `max_pictures` RGB pictures (height, width, 3), uint8, evenly spaced over stills and videos.

    `require(image, file)` raises if a picture cannot be used, as `Camera.require_size` does. `start_s` and `end_s` are
    the part of each video to sample, seconds since the first frame.

    Raises
    ------
    FileNotFoundError, PictureError, VideoError
        If a file cannot be read, `require` refuses a picture, or a video ends before `start_s`.
    """
    candidates: list[tuple[Path, float | None]] = []
    for file in files:
        if file.suffix.lower() in PICTURE_SUFFIXES:
            candidates.append((file, None))
        else:
            candidates += [(file, time_s) for time_s in _times_s(file, max_pictures, start_s, end_s)]
    count = min(max_pictures, len(candidates))
    chosen = np.unique(np.linspace(0, len(candidates) - 1, count).round().astype(int))
    for file, group in groupby((candidates[index] for index in chosen), key=itemgetter(0)):
        times_s = [time_s for _, time_s in group]
        for image in [read_image(file)] if times_s[0] is None else _frames_at(file, times_s):
            if require:
                require(image, file)
            yield image


def _times_s(video: Path, max_times: int, start_s: float, end_s: float | None) -> np.ndarray:
    """Up to `max_times` times, evenly spaced over a part of a video, at most one per frame."""
    info = inspect_video(video)
    length_s = min(info.duration_s, math.inf if end_s is None else end_s) - start_s
    if length_s <= 0:
        raise VideoError(f"{video}: lasts {info.duration_s:g} s; begin before that, not at {start_s:g} s.")
    count = min(max_times, max(round(length_s * info.fps), 1))
    return start_s + length_s * np.arange(count) / count


def _frames_at(video: Path, times_s: list[float]) -> Iterator[np.ndarray]:
    """The frames shown at increasing times; seeks if the next time is more than `SEEK_S` ahead."""
    frames: Iterator[TimedFrame] = iter(())
    now_s = -np.inf
    for time_s in times_s:
        if time_s > now_s + SEEK_S:
            frames = read_timed_frames(video, start_s=time_s)
        frame = next((f for f in frames if f.time_s >= time_s - 1e-3), None)
        if frame is None:
            return
        now_s = frame.time_s
        yield as_rgb(frame.image)
