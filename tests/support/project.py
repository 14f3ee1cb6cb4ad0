"""Folders that tests read from, and what a folder holds."""

from __future__ import annotations

import os
from pathlib import Path

# The project's top folder.
ROOT = Path(__file__).parents[2]
# Pictures, videos and labels of real drives, which are not part of the project.
REAL_DATA = Path(os.environ.get("LANES_DATA") or ROOT.parent / "shared" / "real")


def names(folder: Path) -> set[str]:
    """The names in a folder; none if it does not exist."""
    return {path.name for path in folder.iterdir()} if folder.exists() else set()
