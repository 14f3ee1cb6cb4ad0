"""Videos in the notebook."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from benchmark.evaluation import PROJECT_ROOT

if TYPE_CHECKING:
    from IPython.display import Video

# Width of the player in the notebook.
SHOWN_PX = 800


def show_video(path: Path) -> Video:
    """A player of a video file of the project, for the last line of a cell.

    The video stays a file: the notebook names it by its path from the project's folder.
    """
    from IPython.display import Video

    inside = path.relative_to(PROJECT_ROOT)
    return Video(inside.as_posix(), width=SHOWN_PX)
