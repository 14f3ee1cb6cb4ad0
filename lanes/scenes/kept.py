"""What can be made again, but not quickly, is kept in files: rendered scenes, grown plants."""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np

from lanes.files import whole_file


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


def kept_array(name: str, sources: Iterable[Path], make: Callable[[], np.ndarray]) -> np.ndarray:
    """`make()`, or what it gave before with the same sources and versions; a cache that cannot be used is done without.

    Parameters
    ----------
    name : str
        Of the file, a folder before it.
    sources : iterable of Path
        Python files on which the array depends.
    make : callable
        Makes the array.
    """
    digest = hashlib.sha256(f"{cv2.__version__} {np.__version__}".encode())
    for source in sources:
        digest.update(source.read_bytes())
    try:
        path = cache_folder() / f"{name}-{digest.hexdigest()[:8]}.npy"
    except RuntimeError:  # a user without a home
        return make()
    with suppress(OSError, ValueError, EOFError):
        return np.load(path)
    array = make()
    with suppress(OSError), whole_file(path) as unfinished, unfinished.open("wb") as file:
        np.save(file, array)
    return array
