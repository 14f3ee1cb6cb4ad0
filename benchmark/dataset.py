"""Where the course's pictures, videos and truth are, and how a measured number is held against the truth.

The embedded data are rendered and come with truth files. `LANES_DATA=path/to/folder` names other data, laid out as
here or as in Udacity's repository; where those have no truth, a check says so instead of failing.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from lanes.camera.camera import Camera
from lanes.camera.camera_file import camera_from_dict
from lanes.io.files import read_text
from lanes.io.images import list_pictures
from lanes.io.telemetry import read_telemetry

Found = TypeVar("Found")

PROJECT_ROOT = Path(__file__).resolve().parents[1]


class DatasetError(OSError):
    """A data folder lacks something; the message says what and where it was looked for."""


@dataclass(frozen=True)
class Dataset:
    """A folder with camera_cal/, test_images/ and videos; `output` is where results made from it go."""

    root: Path
    output: Path

    @property
    def boards(self) -> Path:
        """Folder of the chessboard pictures."""
        return self.root / "camera_cal"

    @property
    def stills(self) -> list[Path]:
        """The test pictures in natural order."""
        return list_pictures(self.root / "test_images")

    def still(self, name: str) -> Path:
        """The test picture called `name` (without suffix).

        Raises
        ------
        DatasetError
            If there is none.
        """
        for path in self.stills:
            if path.stem == name:
                return path
        raise DatasetError(f"{self.root / 'test_images'}: holds no picture called {name}; see which names it has.")

    def video(self, name: str) -> Path:
        """The video called `name`, in test_videos/ or beside it as in Udacity's repository."""
        for folder in (self.root / "test_videos", self.root):
            if (folder / name).is_file():
                return folder / name
        raise DatasetError(f"{self.root}: holds no video {name}, neither in test_videos/ nor beside it; copy it there.")

    def true_camera(self) -> Camera | None:
        """The camera that the pictures were taken with, where it is known exactly."""
        path = self.root / "test_images" / "truth.json"
        return _read_truth(path, lambda truth: camera_from_dict(truth["camera"])) if path.is_file() else None

    def true_lane(self, still: Path) -> dict | None:
        """What is known of the lane in a test picture (keys: DESIGN of truth.json), or None."""
        path = still.parent / "truth.json"
        if not path.is_file():
            return None

        def find(truth: dict) -> dict | None:
            return next((frame for frame in truth["frames"] if Path(frame["raw_file"]).name == still.name), None)

        return _read_truth(path, find)

    def true_drive(self, video: Path) -> dict[str, np.ndarray] | None:
        """What is known of the lane in the frames of a video, an array for each column, or None."""
        path = video.with_suffix(".csv")
        return read_telemetry(path) if path.is_file() else None


def _read_truth(path: Path, take: Callable[[dict], Found]) -> Found:
    """What `take` takes out of a truth file."""
    try:
        return take(json.loads(read_text(path, "truth")))
    except (AttributeError, KeyError, TypeError, ValueError, RecursionError) as error:
        raise DatasetError(f"{path}: is no truth of pictures ({error!r}); remove it, or copy it again.") from error


def open_dataset(root: str | Path | None = None) -> Dataset:
    """Open the data folder that `root`, else the environment variable LANES_DATA, names; else the embedded data.

    Raises
    ------
    DatasetError
        If the folder lacks camera_cal/ or test_images/.
    """
    named = root or os.environ.get("LANES_DATA")
    folder = Path(named) if named else PROJECT_ROOT
    for part in ("camera_cal", "test_images"):
        if not (folder / part).is_dir():
            raise DatasetError(
                f"{folder}: has no {part}/; LANES_DATA must name a folder with camera_cal/, test_images/."
            )
    return Dataset(folder, PROJECT_ROOT / ("output_real" if named else "output_images"))
