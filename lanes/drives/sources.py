"""Sources named on the command line (files, folders, patterns, cameras), sorted into videos, stills and cameras."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from glob import glob
from pathlib import Path

from lanes.io.files import list_files, require_no_input_among
from lanes.io.images import PICTURE_SUFFIXES, natural_key

# Video suffixes looked for in a folder. A file that is named directly may have any suffix.
VIDEO_SUFFIXES = (".mp4", ".m4v", ".mov", ".avi", ".mkv", ".webm", ".ts", ".mts", ".mpg", ".mpeg")


@dataclass(frozen=True)
class Sources:
    """Videos and stills without duplicates, in natural order within a folder, and the numbers of live cameras."""

    videos: tuple[Path, ...]
    stills: tuple[Path, ...]
    cameras: tuple[int, ...]


def find_sources(names: Iterable[str]) -> Sources:
    """The videos, stills and live cameras that `names` stand for.

    Names are files, folders (videos and pictures in the folder itself, not in its subfolders), patterns such as
    ``drives/*.mp4``, or camera numbers. A number that is also the name of a file means the file.

    Raises
    ------
    FileNotFoundError
        If a file or folder does not exist, a pattern matches nothing, or a folder holds no video and no picture.
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
    return Sources(tuple(dict.fromkeys(videos)), tuple(dict.fromkeys(stills)), tuple(dict.fromkeys(cameras)))


def require_distinct_outputs(inputs: Iterable[Path], outputs: Iterable[Path]) -> None:
    """Check that each input has an output file of its own, and that no output is one of the inputs.

    Raises
    ------
    ValueError
        If an output would overwrite an input or another output.
    """
    inputs, outputs = list(inputs), list(outputs)
    require_no_input_among(outputs, inputs)
    source_of: dict[Path, Path] = {}
    for source, output in zip(inputs, outputs, strict=True):
        other = source_of.setdefault(output.resolve(), source)
        if other != source:
            raise ValueError(
                f"{output}: would be written from {other} and from {source}; annotate them into different folders."
            )


def _files(name: str) -> list[Path]:
    path = Path(name)
    try:
        path.exists()
    except PermissionError as error:
        raise ValueError(f"{name}: may not be read ({error.strerror}); ask for the right to, or copy it.") from error
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
