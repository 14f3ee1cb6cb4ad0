"""A drive that systems are scored on: a video with its truth and its camera."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

NO_LANE = "no lane"


@dataclass(frozen=True)
class BenchmarkDrive:
    """A video with its truth (.csv) and camera (.yaml) beside it; `video` is None if it is not rendered yet."""

    name: str
    difficulty: str
    what: str
    video: Path | None


def own_drive(video: str | Path, *, difficulty: str = "own") -> BenchmarkDrive:
    """The drive of a video file that has its truth (.csv) and its camera (.yaml) beside it.

    Raises
    ------
    FileNotFoundError
        If the video, its truth or its camera is missing.
    """
    video = Path(video)
    for file, what in ((video, "video"), (video.with_suffix(".csv"), "truth"), (video.with_suffix(".yaml"), "camera")):
        if not file.is_file():
            raise FileNotFoundError(
                f"{file}: there is no such {what}; a drive is a video with .csv and .yaml beside it."
            )
    return BenchmarkDrive(video.stem, difficulty, f"{video}", video)
