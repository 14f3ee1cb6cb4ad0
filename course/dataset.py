"""The data of the course: pictures, videos and their truth.

The embedded data are rendered and come with truth files. The environment variable LANES_DATA names a folder with other
data, in the layout of this project or of Udacity's repository; those may have no truth.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from benchmark.evaluation import PROJECT_ROOT
from lanes.camera.model import Camera, camera_from_dict
from lanes.files import read_telemetry, read_text
from lanes.labels import LaneColumns, read_labels
from lanes.video.images import read_image
from lanes.video.sources import find_sources

Part = TypeVar("Part")


class DatasetError(OSError):
    """A file or folder of the data is missing or damaged; the message names it."""


@dataclass(frozen=True)
class Dataset:
    """A folder with camera_cal/, test_images/ and videos; `output` is the folder for results."""

    root: Path
    output: Path

    @property
    def boards(self) -> Path:
        """The folder with the chessboard pictures."""
        return self.root / "camera_cal"

    @property
    def board_files(self) -> list[Path]:
        """The chessboard pictures in natural order."""
        return list(find_sources([str(self.boards)]).stills)

    @property
    def stills(self) -> list[Path]:
        """The test pictures in natural order."""
        return list(find_sources([str(self.root / "test_images")]).stills)

    def still(self, name: str) -> Path:
        """The test picture called `name` (without suffix).

        Raises DatasetError if there is no such picture.
        """
        for path in self.stills:
            if path.stem == name:
                return path
        raise DatasetError(f"{self.root / 'test_images'}: there is no picture {name}; look there for its names.")

    def video(self, name: str) -> Path:
        """The video file `name`, in test_videos/ or directly in the data folder, as in Udacity's repository.

        Raises DatasetError if there is no such video.
        """
        for folder in (self.root / "test_videos", self.root):
            if (folder / name).is_file():
                return folder / name
        raise DatasetError(f"{self.root}: there is no video {name}, here or in test_videos/; copy it there.")

    def true_camera(self) -> Camera | None:
        """The true camera of the test pictures, from truth.json; None without that file."""
        return _read_truth(self.root / "test_images", lambda truth: camera_from_dict(truth["camera"]))

    def true_lane(self, still: Path) -> dict | None:
        """The entry of a test picture in truth.json (keys: simulator/road/truth.py); None without one."""
        frames = _read_truth(still.parent, lambda truth: {Path(f["raw_file"]).name: f for f in truth["frames"]})
        return frames and frames.get(still.name)

    def labels(self) -> dict[str, LaneColumns]:
        """The hand-made ego lanes of the test pictures by file name, from labels.jsonl; empty without that file."""
        path = self.root / "labels.jsonl"
        if not path.is_file():
            return {}
        labels = {Path(label.name).name: label for label in read_labels(path)}
        labelled = [still for still in self.stills if still.name in labels]
        return {still.name: labels[still.name].ego_lane(read_image(still).shape[1::-1]) for still in labelled}

    def line_columns(self, still: Path) -> LaneColumns | None:
        """The columns of both lines in a test picture: the truth, else the hand-made labels, None without either."""
        truth = self.true_lane(still)
        if truth is None:
            return self.labels().get(still.name)
        return LaneColumns(still.name, np.array(truth["h_samples"]), np.array(truth["lanes"]))

    def true_drive(self, video: Path) -> dict[str, np.ndarray] | None:
        """The truth CSV of a video, an array (frames,) for each column; None without that file."""
        path = video.with_suffix(".csv")
        return read_telemetry(path) if path.is_file() else None


def _read_truth(folder: Path, select: Callable[[dict], Part]) -> Part | None:
    """The part of the truth of a folder of pictures that `select` returns; None without a truth file."""
    path = folder / "truth.json"
    if not path.is_file():
        return None
    try:
        return select(json.loads(read_text(path, "truth")))
    except (AttributeError, KeyError, TypeError, ValueError, RecursionError) as error:
        raise DatasetError(f"{path}: is not a truth file of pictures ({error!r}); remove or replace it.") from error


def open_dataset(root: str | Path | None = None) -> Dataset:
    """The data folder `root`; default: the one named by the environment variable LANES_DATA, else the embedded data.

    Raises DatasetError if the folder lacks camera_cal/ or test_images/.
    """
    named = root or os.environ.get("LANES_DATA")
    folder = Path(named) if named else PROJECT_ROOT
    for part in ("camera_cal", "test_images"):
        if not (folder / part).is_dir():
            layout = "LANES_DATA must name a folder with camera_cal/, test_images/."
            raise DatasetError(f"{folder}: has no {part}/; {layout}")
    return Dataset(folder, PROJECT_ROOT / ("output_real" if named else "output_images"))
