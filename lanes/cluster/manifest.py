"""Manifest of a finished drive, a JSON file next to its outputs, so that no drive is annotated twice; summary of all.

The manifest is written last. A drive is finished if its manifest exists, names the same input, settings and versions,
and all its outputs exist with the sizes in the manifest. Every other drive is annotated.

The summary has one telemetry data set, one table of drives with the worst first, and totals.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import quote

import lanes
from lanes.camera.camera_file import camera_to_dict
from lanes.drives.annotation import output_path
from lanes.drives.settings import DriveResult, DriveSettings, versions
from lanes.io.files import atomic_write, read_text, require_file, write_atomically
from lanes.io.telemetry import read_telemetry, write_telemetry
from lanes.io.video.container import VideoError

# Hexadecimal digits of a key: 48 bits, enough to keep all drives of an output folder apart.
KEY_DIGITS = 12
# Largest manifest that is read. A real one has a few kilobytes.
MAX_MANIFEST_BYTES = 1_000_000
SUMMARY, DATA_SET = "summary", "telemetry"
MEASURES = ("tracked_share", "lost_s", "frames", "missing", "length_s", "cpu_s", "pieces")


@dataclass(frozen=True)
class DriveKey:
    """Everything the outputs of a drive depend on: input (path, size, modification time), settings and versions."""

    source: str
    size_bytes: int
    mtime_ns: int
    settings: Mapping[str, Any]
    versions: Mapping[str, str]

    @classmethod
    def from_video(cls, video: Path, settings: DriveSettings, piece_s: float) -> DriveKey:
        """The key of a drive in its present state; raises FileNotFoundError or VideoError if it is not a file."""
        status = require_file(video, "video", error=VideoError).stat()
        used = {
            "camera": settings.camera and camera_to_dict(settings.camera),
            "field": settings.field and asdict(settings.field),
            **{name: getattr(settings, name) for name in ("style", "start_s", "end_s", "report", "overlapped")},
            "piece_s": piece_s,
        }
        return cls(str(video), status.st_size, status.st_mtime_ns, used, all_versions())

    def digest(self) -> str:
        """The first `KEY_DIGITS` hexadecimal digits of a hash of the key."""
        content = json.dumps(asdict(self), sort_keys=True).encode(errors="replace")
        return hashlib.sha256(content).hexdigest()[:KEY_DIGITS]


@dataclass(frozen=True)
class Manifest:
    """Inputs, outputs and results of a finished drive.

    Attributes
    ----------
    outputs : mapping of str to int
        Names of the files in the output folder and their sizes in bytes.
    frames, missing, tracked_share, lost_s
        As in `DriveResult`.
    length_s : float
        Duration of the annotated video.
    cpu_s : float
        Processor time of all tasks of the drive.
    pieces : int
        Number of pieces that the drive was cut into.
    description : str
        A sentence about the drive, see `DriveResult.describe`.
    """

    key: DriveKey
    outputs: Mapping[str, int]
    frames: int
    missing: int
    length_s: float
    tracked_share: float
    lost_s: float
    cpu_s: float
    pieces: int
    description: str


@cache
def all_versions() -> dict[str, str]:
    """Versions of Python and of the packages that the results depend on, and a digest of the code of `lanes`."""
    digest = hashlib.sha256()
    root = Path(lanes.__file__).parent
    for path in sorted(root.rglob("*.py")):
        digest.update(path.relative_to(root).as_posix().encode() + path.read_bytes())
    return {**versions(), "lanes": digest.hexdigest()[:12]}


def manifest_path(video: Path, folder: Path) -> Path:
    """Path of the manifest of a drive, next to the annotated video."""
    return output_path(video, folder).with_suffix(".json")


def write_manifest(key: DriveKey, result: DriveResult, *, cpu_s: float, pieces: int) -> Manifest:
    """Write the manifest of a drive whose outputs are complete."""
    written = [path for path in (result.video, result.telemetry, result.report) if path]
    time_s = read_telemetry(result.telemetry)["time_s"]
    length_s = float(time_s[-1] - time_s[0]) * len(time_s) / max(len(time_s) - 1, 1)
    manifest = Manifest(
        key=key,
        outputs={path.name: path.stat().st_size for path in written},
        frames=result.frames,
        missing=result.missing,
        length_s=round(length_s, 6),
        tracked_share=result.tracked_share,
        lost_s=result.lost_s,
        cpu_s=round(cpu_s, 3),
        pieces=pieces,
        description=result.describe(),
    )
    write_atomically(result.video.with_suffix(".json"), json.dumps(asdict(manifest), indent=1).encode(errors="replace"))
    return manifest


def read_finished(key: DriveKey, folder: Path) -> Manifest | None:
    """The manifest of a drive if it is finished, else None. An unreadable or foreign file counts as no manifest."""
    path = manifest_path(Path(key.source), folder)
    try:
        content = json.loads(read_text(path, "manifest", max_bytes=MAX_MANIFEST_BYTES))
        manifest = Manifest(**{**content, "key": DriveKey(**content["key"])})
        _require_types(manifest)
        # Compared as JSON, because JSON turns tuples into lists.
        same = json.loads(json.dumps(asdict(key))) == json.loads(json.dumps(asdict(manifest.key)))
    except (OSError, ValueError, TypeError, KeyError, RecursionError):
        return None
    return manifest if same and not missing_outputs(manifest, folder) else None


def _require_types(manifest: Manifest) -> None:
    """Raise TypeError if an entry has the wrong type, or an output is not in the output folder."""
    numbers = ("frames", "missing", "length_s", "tracked_share", "lost_s", "cpu_s", "pieces")
    kinds = {name: (int, float) for name in numbers} | {"outputs": dict, "description": str}
    if not all(isinstance(getattr(manifest, name), kind) for name, kind in kinds.items()):
        raise TypeError("an entry of the manifest has the wrong type")
    if not all(isinstance(size, int) and name == Path(name).name for name, size in manifest.outputs.items()):
        raise TypeError("an output of the manifest is not in the output folder")


def missing_outputs(manifest: Manifest, folder: Path) -> Sequence[str]:
    """Names of the outputs that are not in `folder`, or have another size."""
    return [
        name
        for name, size_bytes in manifest.outputs.items()
        if not (folder / name).is_file() or (folder / name).stat().st_size != size_bytes
    ]


def add_to_data_set(telemetry: Path, folder: Path) -> Path:
    """Copy a drive's telemetry into the data set of `folder`; returns the path written.

    The data set is CSV with Hive partitioning by drive. Dask, DuckDB, Spark and Arrow read its folders (drive=NAME,
    special characters percent-encoded) as one table with a column `drive`.
    """
    part = _data_set_part(folder, telemetry.stem)
    with atomic_write(part) as partial:
        shutil.copyfile(telemetry, partial)
    return part


def _data_set_part(folder: Path, drive: str) -> Path:
    return folder / SUMMARY / DATA_SET / f"drive={quote(drive, safe=' ')}" / "part.csv"


def write_summary(folder: Path, finished: Sequence[Manifest], failed: Mapping[Path, Exception]) -> Path:
    """Write the table of drives, failed ones first, then by tracked share from the worst on; returns its path.

    The telemetry that an earlier run added for a drive that has failed now is removed from the data set.
    """
    for video in failed:
        _data_set_part(folder, video.stem).unlink(missing_ok=True)
    rows = [{"drive": video.stem, "state": "failed", "reason": str(error)} for video, error in sorted(failed.items())]
    rows += [
        {
            "drive": Path(manifest.key.source).stem,
            "state": "finished",
            **{name: getattr(manifest, name) for name in MEASURES},
            "source": manifest.key.source,
        }
        for manifest in sorted(finished, key=_rank)
    ]
    return write_telemetry(folder / SUMMARY / "drives.csv", rows)


def describe_totals(finished: Sequence[Manifest], failed: int, skipped: int) -> str:
    """A sentence about all drives."""
    counts = f"{len(finished)} drives finished ({skipped} of them before), {failed} failed"
    length_s = sum(m.length_s for m in finished)
    if not length_s:
        return f"{counts}."
    frames = sum(m.frames for m in finished)
    tracked = sum(m.tracked_share * m.frames for m in finished) / frames
    lost_s = sum(m.lost_s for m in finished)
    per_minute_s = 60 * sum(m.cpu_s for m in finished) / length_s
    worst = min(finished, key=_rank)
    return (
        f"{counts}: {length_s / 3600:.3g} hours of video, {frames} frames, lane tracked in {tracked:.0%} of them, lost "
        f"for {lost_s:.1f} s; {per_minute_s:.0f} s of processor time for a minute of video. Worst: "
        f"{Path(worst.key.source).name}, tracked in {worst.tracked_share:.0%}."
    )


def _rank(manifest: Manifest) -> tuple[float, float, str]:
    """Sort key of a drive, the worst first."""
    return manifest.tracked_share, -manifest.lost_s, manifest.key.source
