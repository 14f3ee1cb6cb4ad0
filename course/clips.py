"""moviepy clips of videos that were checked before."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from lanes.errors import VideoError
from lanes.video.reader import inspect_video

if TYPE_CHECKING:
    from moviepy import VideoFileClip


def open_clip(path: str | Path, *, start_s: float = 0.0, end_s: float | None = None) -> VideoFileClip:
    """A moviepy clip of a video that `inspect_video` has checked, without sound.

    Close it after use, best by `with open_clip(...) as clip`. Its frames are read-only.

    Raises
    ------
    FileNotFoundError, VideoError
        As `inspect_video`; also if `start_s` to `end_s` does not lie within the video.
    """
    info = inspect_video(path)
    if not 0 <= start_s < (info.duration_s if end_s is None else min(end_s, info.duration_s)):
        raise VideoError(f"{path}: lasts {info.duration_s} s; there is no piece from {start_s} s to {end_s} s.")
    # Imported here: it takes longer than all other imports together, and only one chapter of the course needs it.
    from moviepy import VideoFileClip

    clip = VideoFileClip(str(path), audio=False)
    return clip.subclipped(start_s, None if end_s is None else min(end_s, clip.duration))
