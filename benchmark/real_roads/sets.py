"""Labelled sets of stills in a folder: `labels.jsonl`, and a folder of stills for each.

The stills of a set are of one camera, unless an entry of its labels has
`"several_cameras": true`. An entry may name a `clip`, and the `frame` of it that the
still is. A file `official.jsonl` beside it, which is not ours to publish, adds labels,
and lines that a label lacks.
"""

from __future__ import annotations

import argparse
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from lanes.camera.model import Camera
from lanes.console import bounded, split_names
from lanes.files import read_json_lines
from lanes.labels import LaneColumns, read_labels
from lanes.video.sources import find_sources

LABELS = "labels.jsonl"
OFFICIAL = "official.jsonl"


@dataclass(frozen=True, eq=False)
class RoadSet:
    """Labelled stills of one camera, or of `several_cameras`.

    `clips` are the labels of those that are a frame of a clip, by the number of the
    frame.
    """

    name: str
    folder: Path
    lens: Camera | None = None
    several_cameras: bool = False
    labels: list[LaneColumns] = field(default_factory=list)
    clips: dict[Path, dict[int, LaneColumns]] = field(default_factory=dict)

    @property
    def half(self) -> str:
        """A or B, by the hash of the name."""
        digest = hashlib.sha256(self.name.encode()).digest()
        return "AB"[digest[0] % 2]

    @property
    def row_name(self) -> str:
        """Half and name: its row in a table."""
        return f"{self.half} {self.name}"

    def stills(self) -> Sequence[Path]:
        """All stills, also those without a label."""
        path = self.folder / self.name
        pattern = str(path) if path.is_dir() else f"{path}*"
        return find_sources([pattern]).stills


def read_road_sets(
    folder: Path, lens: Camera | None = None, several_cameras: Sequence[str] = ()
) -> list[RoadSet]:
    """The labelled sets in a folder, by name.

    `lens` is that of all of them, if it is calibrated; `several_cameras` are names of
    sets. Stills named DRIVE_NUMBER in one folder "stills" are a set for each drive.
    Raises ValueError if there is no set of such a name.
    """
    sets: dict[str, RoadSet] = {}
    file = folder / LABELS
    for label, entry in _read_entries(folder):
        name = label.folder
        if name == "stills":
            drive, *_ = Path(label.name).stem.split("_")
            name = f"{name}/{drive}_"
        if name not in sets:
            several = name in several_cameras or bool(entry.get("several_cameras"))
            sets[name] = RoadSet(name, folder, lens, several)
        roads = sets[name]
        roads.labels.append(label)
        if "clip" in entry:
            of_clip = roads.clips.setdefault(folder / entry["clip"], {})
            of_clip[int(entry["frame"])] = label

    unknown = [name for name in several_cameras if name not in sets]
    if unknown:
        raise ValueError(
            f"{file}: has no set {', '.join(unknown)}; its sets are {', '.join(sets)}."
        )
    return [sets[name] for name in sorted(sets)]


def _read_entries(folder: Path) -> list[tuple[LaneColumns, dict]]:
    """The labels of a folder, each with its entry; official ones add what they lack."""
    labelled = _read_file(folder / LABELS)
    if not (folder / OFFICIAL).is_file():
        return labelled
    official = {
        label.name: (label, entry) for label, entry in _read_file(folder / OFFICIAL)
    }
    completed = []
    for label, entry in labelled:
        other, _ = official.pop(label.name, (label, entry))
        missing = ~(label.columns >= 0).any(axis=1, keepdims=True)
        columns = np.where(missing, other.at(label.rows), label.columns)
        completed.append((replace(label, columns=columns), entry))
    return completed + list(official.values())


def _read_file(file: Path) -> list[tuple[LaneColumns, dict]]:
    entries = [entry for _, entry in read_json_lines(file, "label")]
    return list(zip(read_labels(file), entries, strict=True))


def add_road_arguments(
    parser: argparse.ArgumentParser, *, optional: bool = False
) -> None:
    """Add the options that choose labelled sets, and say how they are processed."""
    add_set_arguments(parser, optional=optional)
    add_processing_arguments(parser)


def add_set_arguments(
    parser: argparse.ArgumentParser, *, optional: bool = False
) -> None:
    """Add the options that choose labelled sets."""
    parser.add_argument(
        "folder",
        type=Path,
        nargs="?" if optional else None,
        help="has labels.jsonl, and a folder of stills for each set",
    )
    parser.add_argument(
        "--half",
        choices=("A", "B", "AB"),
        default="AB",
        help="of the sets (default: both halves)",
    )


def add_processing_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options that say how labelled sets are processed."""
    parser.add_argument(
        "--several-cameras",
        type=split_names,
        default=[],
        metavar="NAME,...",
        help="sets whose stills have no common pose",
    )
    parser.add_argument(
        "--workers", type=bounded(int, 1), default=1, metavar="N", help="processes"
    )


def choose_road_sets(
    options: argparse.Namespace, lens: Camera | None = None
) -> list[RoadSet]:
    """The sets that the options of `add_road_arguments` choose."""
    sets = read_road_sets(options.folder, lens, options.several_cameras)
    return [roads for roads in sets if roads.half in options.half]
