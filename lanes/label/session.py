"""Stills to label, their labels on disk (`labels.jsonl`, TuSimple JSON lines), and marks that are not labels yet."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from lanes.drive import DriveSettings
from lanes.errors import LaneError
from lanes.files import read_json_lines, write_json_lines
from lanes.images import read_image, write_image
from lanes.label.curve import fit_line, label_rows
from lanes.sources import sample_images

# More points than anyone clicks on a line.
MAX_POINTS = 1000


def pick_stills(video: Path, settings: DriveSettings, count: int) -> Iterator[Path]:
    """Yield the paths of frames spread over a part of a video, written as PNG; those of an earlier session stay."""
    part: dict[str, Any] = {"start_s": settings.start_s, "end_s": settings.end_s, "topic": settings.topic}
    for k, image in enumerate(sample_images([video], count, **part), 1):
        path = settings.output / f"{video.stem}_{k:02d}_of_{count}.png"
        if not path.exists():
            write_image(path, image)
        elif (other := read_image(path)).shape != image.shape or cv2.PSNR(other, image) < 30:  # of another decoder: 38
            raise LaneError(f"{path}: is no frame of this part of {video}; give another output folder (-o).")
        yield path


class Session:
    """Labels of `stills` in `folder`; labels of other pictures stay. Raises LaneError if a file cannot be used."""

    def __init__(self, folder: Path, stills: Sequence[Path]) -> None:
        self.stills = [path.resolve() for path in stills]
        if outside := [path for path in self.stills if not path.is_relative_to(folder.resolve())]:
            raise LaneError(f"{outside[0]}: lies outside of {folder}, the folder of the labels; give its folder (-o).")
        self._names = [path.relative_to(folder.resolve()).as_posix() for path in self.stills]
        self._files = _LabelFile(folder / "labels.jsonl"), _LabelFile(folder / "unsaved.jsonl")

    def saved(self) -> list[bool]:
        """Whether each still has a label without unsaved changes."""
        labels, unsaved = (file.labels for file in self._files)
        return [name in labels and name not in unsaved for name in self._names]

    def label(self, k: int) -> dict[str, Any]:
        """The label of still `k`, or what its unsaved marks would be as one; also `saved`."""
        labels, unsaved = (file.labels for file in self._files)
        label = (labels | unsaved).get(self._names[k]) or self._fit(k, [[], []])
        return {"points": [[], []]} | label | {"saved": self.saved()}

    def propose(self, k: int) -> dict[str, Any]:
        """The marks of the still before `k`, moved to the paint of still `k`, as a `label`; nothing is written.

        Raises LaneError if there are none, or if the stills differ in size.
        """
        points = self.label(k - 1)["points"] if k else [[], []]
        if points == [[], []]:
            raise LaneError("The still before this one has no points to copy.")
        if len({read_image(self.stills[number]).shape for number in (k - 1, k)}) > 1:
            raise LaneError("The still before this one has another size, so its points cannot be copied.")
        label = self._fit(k, points)
        rows, lines = np.array(label["h_samples"]), zip(points, label["lanes"], strict=True)
        return label | {"points": [_move(mark, rows, np.array(line)) for mark, line in lines]}

    def mark(self, k: int, points: Any, save: bool) -> dict[str, Any]:
        """Write the `points` of both lines (None: not visible), with `save` as a label; returns `label`.

        Raises LaneError for marks that are none, for a label that was compared, and if another program changed it.
        """
        name, label, (labels, unsaved) = self._names[k], self._fit(k, points), self._files
        if labels.labels.get(name, {}).get("compared"):
            raise LaneError("Our lines were shown, so this label stays as it is.")
        if not save:
            unsaved.change(name, label)
            return self.label(k)
        if any(mark is not None and max(line) < 0 for mark, line in zip(points, label["lanes"], strict=True)):
            raise LaneError("Mark each line with two or more points, or as not visible.")
        labels.change(name, label)
        unsaved.change(name, None)
        return self.label(k)

    def compare(self, k: int) -> None:
        """Note that our lines were shown beside the label of still `k`, which stays as it is from now on."""
        labels = self._files[0]
        label = labels.labels[self._names[k]]
        if not label.get("compared"):
            labels.change(self._names[k], label | {"compared": True})

    def _fit(self, k: int, points: Any) -> dict[str, Any]:
        image = read_image(self.stills[k])
        lines = _require_marks(points, image.shape[1::-1])
        left, right = (fit_line(image, line).tolist() for line in lines)
        rows = label_rows(len(image)).tolist()
        return {"raw_file": self._names[k], "h_samples": rows, "lanes": [left, right], "points": points}


class _LabelFile:
    """The labels in a file by the name of their picture; lines that other programs add or change stay."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.labels = _read_labels(path)

    def change(self, name: str, label: dict[str, Any] | None) -> None:
        """Write a label, or remove it (None); what is in memory is what is on the disk, also if that fails."""
        there = _read_labels(self._path)
        known, self.labels = self.labels, there
        if there.get(name) != known.get(name):
            raise LaneError(f"{name}: another program changed its label in {self._path.name}; open this still again.")
        labels = there | {name: label} if label else {other: line for other, line in there.items() if other != name}
        if labels != there:
            write_json_lines(self._path, labels.values())
            self.labels = labels


def _require_marks(points: Any, size: tuple[int, int]) -> list[np.ndarray]:
    """The marks of both lines, (N, 2) each, if all are points in a picture of `size` (width, height)."""
    try:
        if len(points) != 2 or max(map(len, filter(None, points)), default=0) > MAX_POINTS:
            raise ValueError
        lines = [np.array(mark or np.empty((0, 2)), float) for mark in points]
        inside = [line.shape[1:] == (2,) and ((line >= -1) & (line <= size)).all() for line in lines]
    except (TypeError, ValueError):
        inside = [False]
    if not all(inside):
        raise LaneError(
            "Marks are two lists of points in the picture, [column, row]; null for one that is not visible."
        )
    return lines


def _move(mark: list | None, rows: np.ndarray, line: np.ndarray) -> list | None:
    """The points of a mark, moved along the rows to a line with columns (R,) at `rows`, as far as it goes."""
    seen = line >= 0
    if not mark or not seen.any():
        return mark
    at = np.clip(np.array(mark)[:, 1], *rows[seen][[0, -1]])
    return np.stack([np.interp(at, rows[seen], line[seen]), at], axis=1).round(1).tolist()


def _read_labels(path: Path) -> dict[str, dict[str, Any]]:
    try:
        lines = read_json_lines(path, "label") if path.exists() else ()
        return {label["raw_file"]: label for _, label in lines}
    except (ValueError, TypeError, LookupError) as error:
        raise LaneError(f"{path}: its labels cannot be used ({error}); repair it, or move it away.") from error
