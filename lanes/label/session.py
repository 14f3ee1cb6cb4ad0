"""Stills to label, their labels on disk (`labels.jsonl`, TuSimple JSON lines), and marks that are not labels yet."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2

from lanes.annotate import DriveSettings
from lanes.errors import LaneError
from lanes.files import read_text, write_atomically
from lanes.images import read_image, write_image
from lanes.label.curve import fit_line, label_rows
from lanes.sources import sample_images


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
        self._paths = folder / "labels.jsonl", folder / "unsaved.jsonl"
        self._labels, self._unsaved = map(_read_labels, self._paths)

    def saved(self) -> list[bool]:
        """Whether each still has a label without unsaved changes."""
        return [name in self._labels and name not in self._unsaved for name in self._names]

    def label(self, k: int) -> dict[str, Any]:
        """The label of still `k`, or what its unsaved marks would be as one; also `saved`."""
        label = (self._labels | self._unsaved).get(self._names[k]) or self._fit(k, [[], []])
        return {"points": [[], []]} | label | {"saved": self.saved()}

    def mark(self, k: int, points: Any, save: bool) -> dict[str, Any]:
        """Write the `points` of both lines (None: not visible), with `save` as a label; returns `label`, or raises."""
        label = self._unsaved[self._names[k]] = self._fit(k, points)
        if save:
            if any(mark is not None and max(line) < 0 for mark, line in zip(points, label["lanes"], strict=True)):
                raise LaneError("Mark each line with two or more points, or as not visible.")
            self._labels[self._names[k]] = self._unsaved.pop(self._names[k])
        for path, labels in zip(self._paths[not save :], (self._labels, self._unsaved)[not save :], strict=True):
            write_atomically(path, "".join(json.dumps(label) + "\n" for label in labels.values()).encode() or b"\n")
        return self.label(k)

    def _fit(self, k: int, points: Any) -> dict[str, Any]:
        image = read_image(self.stills[k])
        left, right = (fit_line(image, mark or []).tolist() for mark in points)
        rows = label_rows(len(image)).tolist()
        return {"raw_file": self._names[k], "h_samples": rows, "lanes": [left, right], "points": points}


def _read_labels(path: Path) -> dict[str, dict[str, Any]]:
    try:
        lines = filter(str.strip, read_text(path, "label").split("\n") if path.exists() else [])
        return {label["raw_file"]: label for label in map(json.loads, lines)}
    except (ValueError, TypeError, LookupError) as error:
        raise LaneError(f"{path}: its labels cannot be used ({error}); repair it, or move it away.") from error
