"""What a user names on the command line: files, folders, patterns and cameras, sorted by kind."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from glob import glob
from pathlib import Path

from lanes.io.files import list_files
from lanes.io.images import PICTURE_SUFFIXES, natural_key

# What is taken out of a folder; a file that is named itself may have any suffix.
VIDEO_SUFFIXES = (".mp4", ".m4v", ".mov", ".avi", ".mkv", ".webm", ".ts", ".mts", ".mpg", ".mpeg")


@dataclass(frozen=True)
class Sources:
    """Videos and stills, each file once and in natural order within a folder, and the numbers of live cameras."""

    videos: tuple[Path, ...]
    stills: tuple[Path, ...]
    cameras: tuple[int, ...]


def find_sources(names: Iterable[str]) -> Sources:
    """Sort out what `names` stand for.

    Parameters
    ----------
    names : iterable of str
        Files, folders (the videos and pictures right in them), patterns such as "drives/*.mp4", or whole numbers: a
        number that is no file's name is a camera's.

    Raises
    ------
    FileNotFoundError
        If a name stands for nothing.
    """
    videos: list[Path] = []
    stills: list[Path] = []
    cameras: list[int] = []
    for name in names:
        if name.isdecimal() and not Path(name).exists():
            cameras.append(int(name))
            continue
        for path in _files(name):
            (stills if path.suffix.lower() in PICTURE_SUFFIXES else videos).append(path)
    return Sources(*(tuple(dict.fromkeys(found)) for found in (videos, stills, cameras)))


def refuse_clashes(videos: Iterable[Path], outputs: Iterable[Path]) -> None:
    """Refuse to begin where an output would overwrite an input or another output.

    Raises
    ------
    ValueError
        Naming the files.
    """
    videos = list(videos)
    inputs = {video.resolve() for video in videos}
    taken: dict[Path, Path] = {}
    for video, output in zip(videos, outputs, strict=True):
        if output.resolve() in inputs:
            raise ValueError(f"{output}: is one of the inputs and would be overwritten; name another output folder.")
        other = taken.setdefault(output.resolve(), video)
        if other != video:
            raise ValueError(f"{output}: would be written from {other} and from {video}; annotate them one by one.")


def _files(name: str) -> list[Path]:
    path = Path(name)
    if name and path.is_dir():
        found = list_files(path, PICTURE_SUFFIXES + VIDEO_SUFFIXES)
        if not found:
            raise FileNotFoundError(f"{path}: holds neither a video nor a picture; name another folder.")
    elif name and path.exists():
        return [path]
    else:
        found = [Path(match) for match in glob(name, recursive=True) if Path(match).is_file()]
        if not found:
            raise FileNotFoundError(f"{name}: there is no such file or folder; check the name.")
    return sorted(found, key=lambda p: (str(p.parent), natural_key(p)))
