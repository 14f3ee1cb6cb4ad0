"""Pictures of a drive, from stills and videos alike."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import groupby
from operator import itemgetter
from pathlib import Path

import numpy as np

from lanes.io.images import PICTURE_SUFFIXES, read_image
from lanes.io.video.container import VideoError
from lanes.io.video.reader import TimedFrame, inspect_video, read_timed_frames

# Reading on for this long costs about as much as opening the video again at another place.
SEEK_S = 2.0


def pick_pictures(
    files: list[Path],
    most: int,
    *,
    require: Callable[[np.ndarray, Path], None] | None = None,
    start_s: float = 0.0,
    end_s: float | None = None,
) -> Iterator[np.ndarray]:
    """At most `most` pictures, spread evenly over stills and videos; RGB (height, width, 3) uint8.

    Of videos only the piece from `start_s` to `end_s` counts, seconds since the first frame. `require(image, file)`
    raises where a picture cannot be used, as `Camera.require_size` does.

    Raises
    ------
    FileNotFoundError, PictureError, VideoError
        If a file cannot be read, `require` refuses a picture, or a video is over at `start_s`.
    """
    places: list[tuple[Path, float | None]] = []
    for file in files:
        if file.suffix.lower() in PICTURE_SUFFIXES:
            places.append((file, None))
        else:
            places += [(file, time_s) for time_s in _times_s(file, most, start_s, end_s)]
    chosen = np.unique(np.linspace(0, len(places) - 1, min(most, len(places))).round().astype(int))
    for file, group in groupby((places[at] for at in chosen), key=itemgetter(0)):
        times_s = [time_s for _, time_s in group]
        for image in [read_image(file)] if times_s[0] is None else _frames_at(file, times_s):
            if require:
                require(image, file)
            yield image


def _times_s(video: Path, most: int, start_s: float, end_s: float | None) -> np.ndarray:
    """At most `most` times, evenly spread over a piece of a video, not more than there are frames."""
    info = inspect_video(video)
    length_s = min(info.duration_s, math.inf if end_s is None else end_s) - start_s
    if length_s <= 0:
        raise VideoError(f"{video}: lasts {info.duration_s:g} s; begin before that, not at {start_s:g} s.")
    count = min(most, max(round(length_s * info.fps), 1))
    return start_s + length_s * np.arange(count) / count


def _frames_at(video: Path, times_s: list[float]) -> Iterator[np.ndarray]:
    """The frames shown at rising times; reads on where the next is near, and seeks where it is far."""
    frames: Iterator[TimedFrame] = iter(())
    now_s = -np.inf
    for time_s in times_s:
        if time_s > now_s + SEEK_S:
            frames = read_timed_frames(video, start_s=time_s)
        frame = next((f for f in frames if f.time_s >= time_s - 1e-3), None)
        if frame is None:
            return
        now_s = frame.time_s
        yield frame.image
