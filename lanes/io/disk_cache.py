"""What can be made again, but not quickly, is kept in files: rendered scenes, grown plants, far country."""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Callable, Iterable
from contextlib import ExitStack, suppress
from pathlib import Path

import cv2
import numpy as np

from lanes.io.files import atomic_write, exclusive_writer, list_files


def cache_folder() -> Path:
    """Where rendered scenes are kept: LANES_CACHE if set, else the platform's folder for what can be made again."""
    if os.environ.get("LANES_CACHE"):
        return Path(os.environ["LANES_CACHE"])
    home = Path.home()
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or home / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = home / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or home / ".cache")
    return base / "advanced-lane-finding" / "scenes"


def cached_array(
    name: str, sources: Iterable[Path], make: Callable[[], np.ndarray], *, most: int | None = None
) -> np.ndarray:
    """`make()`, or what it gave before with the same sources and versions; a cache that cannot be used is done without.

    What is kept is read where it is used, and only there; processes share it. Of several that want what is not there
    yet, one makes it while the others wait.

    Parameters
    ----------
    name : str
        Of the file, a folder before it.
    sources : iterable of Path
        Python files on which the array depends.
    make : callable
        Makes the array.
    most : int, optional
        How many arrays to keep in that folder; then the oldest go.

    Returns
    -------
    ndarray
        Not to be written to.
    """
    digest = short_hash(cv2.__version__, np.__version__, *(source.read_bytes() for source in sources))
    try:
        path = cache_folder() / f"{name}-{digest}.npy"
    except RuntimeError:  # a user without a home
        return make()
    with ExitStack() as alone:
        array = _read(path)
        if array is None:
            with suppress(OSError):
                alone.enter_context(exclusive_writer(path, wait=True))
            array = _read(path)
        if array is None:
            array = make()
            with suppress(OSError), atomic_write(path) as unfinished, unfinished.open("wb") as file:
                np.save(file, array)
            _remove_oldest(path.parent, most)
    array.setflags(write=False)
    return array


def short_hash(*parts: object) -> str:
    """Eight digits, for a file's name, that change with any of the parts."""
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:8]


def _read(path: Path) -> np.ndarray | None:
    """What is kept in a file, mapped into memory; None if there is none or it is broken."""
    with suppress(OSError, ValueError, EOFError):
        return np.asarray(np.load(path, mmap_mode="r"))
    return None


def _remove_oldest(folder: Path, most: int | None) -> None:
    """Remove all but the `most` latest files of a folder; none if there is no such number."""
    with suppress(OSError, ValueError):
        files = sorted(list_files(folder, {".npy"}), key=lambda path: path.stat().st_mtime, reverse=True)
        for path in files[most if most is not None else len(files) :]:
            path.unlink()
