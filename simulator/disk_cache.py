"""Disk cache for slow, reproducible arrays: rendered scenes, grown plants, the far landscape."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterable
from contextlib import ExitStack, suppress
from pathlib import Path

import cv2
import numpy as np
from filelock import FileLock
from platformdirs import user_cache_path

from lanes.files import atomic_write, hash_sources, list_files


def cache_folder() -> Path:
    """Folder of the cache: LANES_CACHE if set, else one in the platform's cache folder of this user.

    Raises RuntimeError if the user has no home folder.
    """
    if os.environ.get("LANES_CACHE"):
        return Path(os.environ["LANES_CACHE"])
    return user_cache_path("advanced-lane-finding", appauthor=False, opinion=False) / "scenes"


def cached_array(
    name: str, sources: Iterable[Path], make: Callable[[], np.ndarray], *, max_files: int | None = None
) -> np.ndarray:
    """The result of `make()`, read-only, from the cache if it was made with the same sources and library versions.

    The file is mapped into memory: only the parts in use are read, and processes share them. If several processes need
    a missing array, one makes it and the others wait. An unusable cache folder costs time only.

    `name` is the start of the file's name, with its folder in front; `sources` are the Python files on which the array
    depends. Of the arrays in that folder the oldest are removed, so that `max_files` are left.
    """
    digest = short_hash(cv2.__version__, np.__version__, hash_sources(*sources))
    try:
        path = cache_folder() / f"{name}-{digest}.npy"
    except RuntimeError:
        return make()
    with ExitStack() as stack:
        array = _read(path)
        if array is None:
            with suppress(OSError):
                path.parent.mkdir(parents=True, exist_ok=True)
                lock_path = path.with_name(f"{path.name}.lock")
                stack.enter_context(FileLock(lock_path))
                # While it is locked: a process that waits for it notices and creates the file again.
                stack.callback(lock_path.unlink, missing_ok=True)
            array = _read(path)
        if array is None:
            array = make()
            with suppress(OSError), atomic_write(path) as partial, partial.open("wb") as file:
                np.save(file, array)
            if max_files is not None:
                _remove_oldest(path.parent, max_files)
    array.setflags(write=False)
    return array


def short_hash(*parts: object) -> str:
    """Eight hexadecimal digits for a file name that change with any of the parts."""
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:8]


def _read(path: Path) -> np.ndarray | None:
    """The array in a file, mapped into memory; None if the file is missing or broken."""
    with suppress(OSError, ValueError, EOFError):
        return np.asarray(np.load(path, mmap_mode="r"))
    return None


def _remove_oldest(folder: Path, max_files: int) -> None:
    """Remove all but the `max_files` latest arrays of a folder."""
    with suppress(OSError, ValueError):
        arrays = (path for path in list_files(folder) if path.suffix == ".npy")
        files = sorted(arrays, key=lambda path: path.stat().st_mtime, reverse=True)
        for path in files[max_files:]:
            path.unlink()
