"""What was made of a drive, from what and with what: a file beside its outputs, so that nothing is done twice.

It is written last. A drive whose manifest is there, tells of the same input, settings and versions, and names outputs
that are there in the same size, is finished; every other drive is to be annotated.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path

import lanes
from lanes.camera.camera_file import camera_to_dict
from lanes.drives.annotation import output_for
from lanes.drives.settings import DriveResult, DriveSettings, versions
from lanes.io.files import read_text, require_file, write_atomically
from lanes.io.telemetry import read_telemetry
from lanes.io.video.container import VideoError

# Of a key, enough to tell all that anybody ever makes apart.
DIGITS = 12
# One has a few kilobytes.
MAX_MANIFEST_BYTES = 1_000_000


@dataclass(frozen=True)
class DriveKey:
    """All that the outputs of a drive depend on: the input by path, size and mtime; settings; versions."""

    source: str
    size_bytes: int
    mtime_ns: int
    settings: Mapping[str, object]
    versions: Mapping[str, str]

    @classmethod
    def of(cls, video: Path, settings: DriveSettings, piece_s: float) -> DriveKey:
        """The key of a drive as it is now; raises FileNotFoundError if it is not there."""
        found = require_file(video, "video", error=VideoError).stat()
        told = {
            "camera": settings.camera and camera_to_dict(settings.camera),
            "field": settings.field and asdict(settings.field),
            "style": settings.style,
            "start_s": settings.start_s,
            "end_s": settings.end_s,
            "report": settings.report,
            "overlapped": settings.overlapped,
            "piece_s": piece_s,
        }
        return cls(str(video), found.st_size, found.st_mtime_ns, told, all_versions())

    def digits(self) -> str:
        """`DIGITS` digits that change with any part of it."""
        return hashlib.sha256(json.dumps(asdict(self), sort_keys=True).encode(errors="replace")).hexdigest()[:DIGITS]


@dataclass(frozen=True)
class Manifest:
    """What came of a drive.

    Attributes
    ----------
    key : DriveKey
    outputs : mapping of str to int
        Names of the files in the output folder, and their sizes in bytes.
    frames, missing : int
    length_s : float
        Of the annotated video.
    tracked_share, lost_s : float
        As in `DriveResult`.
    cpu_s : float
        Processor time of all that was done for the drive.
    pieces : int
    told : str
        The drive in a sentence.
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
    told: str


@cache
def all_versions() -> dict[str, str]:
    """What the results depend on: versions of packages, and a digest of this project's own code."""
    digest = hashlib.sha256()
    root = Path(lanes.__file__).parent
    for path in sorted(root.rglob("*.py")):
        digest.update(path.relative_to(root).as_posix().encode() + path.read_bytes())
    return {**versions(), "lanes": digest.hexdigest()[:12]}


def manifest_path(video: Path, folder: Path) -> Path:
    """Where the manifest of a drive goes: beside the annotated video."""
    return output_for(video, folder).with_suffix(".json")


def write_manifest(key: DriveKey, result: DriveResult, *, cpu_s: float, pieces: int) -> Manifest:
    """Write the manifest of a drive whose outputs are all there."""
    written = [path for path in (result.video, result.telemetry, result.report) if path]
    time_s = read_telemetry(result.telemetry)["time_s"]
    length_s = float(time_s[-1] - time_s[0]) * len(time_s) / max(len(time_s) - 1, 1)
    manifest = Manifest(
        key,
        {path.name: path.stat().st_size for path in written},
        result.frames,
        result.missing,
        round(length_s, 6),
        result.tracked_share,
        result.lost_s,
        round(cpu_s, 3),
        pieces,
        result.describe(),
    )
    write_atomically(result.video.with_suffix(".json"), json.dumps(asdict(manifest), indent=1).encode(errors="replace"))
    return manifest


def read_finished(key: DriveKey, folder: Path) -> Manifest | None:
    """The manifest of a drive if that is finished, else None: also if somebody has written something else there."""
    path = manifest_path(Path(key.source), folder)
    try:
        content = json.loads(read_text(path, "manifest", max_bytes=MAX_MANIFEST_BYTES))
        manifest = Manifest(**{**content, "key": DriveKey(**content["key"])})
        _require_kinds(manifest)
        # Compared as JSON, which knows no tuples.
        same = json.loads(json.dumps(asdict(key))) == json.loads(json.dumps(asdict(manifest.key)))
    except (OSError, ValueError, TypeError, KeyError, RecursionError):
        return None
    return manifest if same and not missing_outputs(manifest, folder) else None


def _require_kinds(manifest: Manifest) -> None:
    """TypeError if its numbers are none, or an output lies outside of its folder."""
    numbers = ("frames", "missing", "length_s", "tracked_share", "lost_s", "cpu_s", "pieces")
    kinds = {name: (int, float) for name in numbers} | {"outputs": dict, "told": str}
    if not all(isinstance(getattr(manifest, name), kind) for name, kind in kinds.items()):
        raise TypeError("an entry of the manifest is of another kind")
    if not all(isinstance(size, int) and name == Path(name).name for name, size in manifest.outputs.items()):
        raise TypeError("an output of the manifest lies elsewhere")


def missing_outputs(manifest: Manifest, folder: Path) -> Sequence[str]:
    """Outputs that are not in the folder, or are of another size."""

    def there(name: str, size_bytes: int) -> bool:
        path = folder / name
        return path.is_file() and path.stat().st_size == size_bytes

    return [name for name, size_bytes in manifest.outputs.items() if not there(name, size_bytes)]
