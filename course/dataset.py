"""The data of the course: images, videos and their truth.

The embedded data are rendered and come with truth files. The environment variable
LANES_DATA names a folder with other data, in the layout of this project or of Udacity's
repository; those may have no truth.
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
from lanes.camera import Camera, camera_from_dict
from lanes.files import read_telemetry, read_text
from lanes.images import read_image
from lanes.labels import LaneColumns, read_labels
from lanes.sources import find_sources

Part = TypeVar("Part")


class DatasetError(OSError):
    """A file or folder of the data is missing or damaged; the message names it."""


@dataclass(frozen=True)
class Dataset:
    """A folder with camera_cal/, test_images/ and videos."""

    root: Path
    output: Path  # the folder for results

    @property
    def boards(self) -> Path:
        """The folder with the images of chessboards."""
        return self.root / "camera_cal"

    @property
    def board_files(self) -> list[Path]:
        """The images of chessboards in natural order."""
        return list(find_sources([str(self.boards)]).stills)

    @property
    def stills(self) -> list[Path]:
        """The test images in natural order."""
        folder = self.root / "test_images"
        return list(find_sources([str(folder)]).stills)

    def still(self, name: str) -> Path:
        """The test image called `name` (without suffix).

        Raises DatasetError if there is no such image.
        """
        for path in self.stills:
            if path.stem == name:
                return path
        folder = self.root / "test_images"
        raise DatasetError(f"{folder}: has no image {name}; look there for its names.")

    def video(self, name: str) -> Path:
        """The video file `name`.

        It is in test_videos/ or directly in the data folder, as in Udacity's
        repository. Raises DatasetError if there is no such video.
        """
        for folder in (self.root / "test_videos", self.root):
            if (folder / name).is_file():
                return folder / name
        raise DatasetError(
            f"{self.root}: has no video {name}, here or in test_videos/; copy it there."
        )

    def true_camera(self) -> Camera | None:
        """The true camera of the test images, from truth.json; None without it."""
        return _read_truth(self.root / "test_images", _camera_of_truth)

    def true_lane(self, still: Path) -> dict | None:
        """The entry of a test image in truth.json; None without one.

        Its keys are described in simulator/road/truth.py.
        """
        frames = _read_truth(still.parent, _frames_of_truth)
        if frames is None:
            return None
        return frames.get(still.name)

    def labels(self) -> dict[str, LaneColumns]:
        """The hand-made ego lanes of the test images by file name, from labels.jsonl.

        Empty without that file.
        """
        path = self.root / "labels.jsonl"
        if not path.is_file():
            return {}
        labels = {Path(label.name).name: label for label in read_labels(path)}
        lanes = {}
        for still in self.stills:
            if still.name in labels:
                height, width = read_image(still).shape[:2]
                lanes[still.name] = labels[still.name].ego_lane((width, height))
        return lanes

    def line_columns(self, still: Path) -> LaneColumns | None:
        """The columns of both lines in a test image.

        They are the truth, else the hand-made labels, None without either.
        """
        truth = self.true_lane(still)
        if truth is None:
            return self.labels().get(still.name)
        rows = np.array(truth["h_samples"])
        columns = np.array(truth["lanes"])
        return LaneColumns(still.name, rows, columns)

    def true_drive(self, video: Path) -> dict[str, np.ndarray] | None:
        """The truth CSV of a video, an array (frames,) per column; None without it."""
        path = video.with_suffix(".csv")
        if not path.is_file():
            return None
        return read_telemetry(path)


def _camera_of_truth(truth: dict) -> Camera:
    return camera_from_dict(truth["camera"])


def _frames_of_truth(truth: dict) -> dict[str, dict]:
    """The entries of a truth file by the name of their image."""
    return {Path(frame["raw_file"]).name: frame for frame in truth["frames"]}


def _read_truth(folder: Path, select: Callable[[dict], Part]) -> Part | None:
    """The part of the truth of a folder of images that `select` returns.

    None without a truth file. Raises DatasetError if the file is damaged.
    """
    path = folder / "truth.json"
    if not path.is_file():
        return None
    damage = (AttributeError, KeyError, TypeError, ValueError, RecursionError)
    try:
        return select(json.loads(read_text(path, "truth")))
    except damage as error:
        raise DatasetError(
            f"{path}: is not a truth file of images ({error!r}); remove or replace it."
        ) from error


def open_dataset(root: str | Path | None = None) -> Dataset:
    """The data folder `root`.

    The default is the folder that the environment variable LANES_DATA names, else the
    embedded data. Raises DatasetError if the folder lacks camera_cal/ or test_images/.
    """
    named = root or os.environ.get("LANES_DATA")
    folder = PROJECT_ROOT
    results = "output_images"
    if named:
        folder = Path(named)
        results = "output_real"
    for part in ("camera_cal", "test_images"):
        if not (folder / part).is_dir():
            raise DatasetError(
                f"{folder}: has no {part}/; LANES_DATA must name a folder with "
                "camera_cal/, test_images/."
            )
    return Dataset(folder, PROJECT_ROOT / results)
