"""Scores of every system on hand-labelled stills."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from benchmark.labels.consistency import StillCheck, check_stills
from benchmark.labels.tusimple import LaneColumns, LineScore, score_lines, summarize_lines
from benchmark.reporting.tables import format_table
from benchmark.systems import DETECTOR, TRACKER, column_detector
from lanes.camera import Camera
from lanes.images import read_image
from lanes.pose import PoseEstimate, ensure_pose

COLUMNS = ("lines", "accuracy", "matched", "FP", "FN", "median error")


def score_pictures(
    labels: Sequence[LaneColumns],
    pictures: Iterable[np.ndarray],
    camera: Camera,
    systems: Sequence[str],
    *,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, list[LineScore]]:
    """Scores of systems on labelled pictures (height, width, 3) uint8, each processed independently.

    The scores of a system are those of the left and right line of each picture in turn. `progress` is called as
    progress(pictures done, pictures in total).

    Raises
    ------
    PictureError
        If a picture is not of the camera's size.
    """
    detectors = {system: column_detector(system, camera) for system in systems}
    scores: dict[str, list[LineScore]] = {system: [] for system in systems}
    for done, (label, image) in enumerate(zip(labels, pictures, strict=True), 1):
        camera.require_size(image, label.name)
        for system, detect in detectors.items():
            detected = LaneColumns(label.name, label.rows, np.round(detect(image, label.rows), 1))
            scores[system] += score_lines(label, detected, width_px=camera.width)
        if progress:
            progress(done, len(labels))
    return scores


@dataclass(frozen=True, eq=False)
class LabelledFolder:
    """Scores of each system on the labelled stills of one camera, the checks of the detected lanes, and the pose.

    `checks` is empty if neither tracker nor detector is scored; `estimate` is None if the camera had a pose.
    """

    scores: dict[str, list[LineScore]]
    checks: list[StillCheck]
    estimate: PoseEstimate | None

    def describe_pose(self) -> str:
        """The estimated pose in words."""
        return self.estimate.describe() if self.estimate else "camera pose: that of the camera file"


def split_folders(labels: Sequence[LaneColumns]) -> dict[str, list[LaneColumns]]:
    """The labels of the pictures in each top folder below the file of the labels."""
    folders: dict[str, list[LaneColumns]] = {}
    for label in labels:
        folders.setdefault(PurePosixPath(label.name).parts[0], []).append(label)
    return folders


def score_folder(
    labels: Sequence[LaneColumns],
    files: Sequence[Path],
    lens: Camera,
    systems: Sequence[str],
    progress: Callable[[str], Callable[[int, int], None]],
) -> LabelledFolder:
    """Scores and checks on the labelled pictures of one camera, whose pose is estimated from them if it has none.

    `progress`, called with the name of a part of the work, returns its callback (done, total). Errors are those of
    `ensure_pose` and `score_pictures`.
    """
    camera, estimate = ensure_pose(lens, files, progress=progress("pose"))
    scores = score_pictures(labels, map(read_image, files), camera, systems, progress=progress("stills"))
    detects = not {TRACKER, DETECTOR}.isdisjoint(systems)
    checks = check_stills(labels, map(read_image, files), camera) if detects else []
    return LabelledFolder(scores, checks, estimate)


def join_scores(folders: Iterable[LabelledFolder]) -> dict[str, list[LineScore]]:
    """The scores of each system on the stills of all cameras."""
    scores: dict[str, list[LineScore]] = {}
    for folder in folders:
        for system, lines in folder.scores.items():
            scores.setdefault(system, []).extend(lines)
    return scores


def describe_labelled(scores: Mapping[str, Sequence[LineScore]]) -> str:
    """A table of the summary, a line for each system."""
    rows = {}
    for system, lines in scores.items():
        row = summarize_lines(lines)
        shares = [f"{row[name]:.3f}" for name in ("accuracy", "matched", "fp", "fn")]
        rows[system] = [f"{row['lines']:.0f}", *shares, f"{row['error_px']:.1f} px"]
    return format_table(COLUMNS, rows)
