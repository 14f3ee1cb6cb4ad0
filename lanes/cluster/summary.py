"""Summary of all drives: one telemetry data set, one table of drives with the worst first, and totals."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from urllib.parse import quote

from lanes.cluster.manifest import Manifest
from lanes.io.files import atomic_write
from lanes.io.telemetry import write_telemetry

SUMMARY, DATA_SET = "summary", "telemetry"
MEASURES = ("tracked_share", "lost_s", "frames", "missing", "length_s", "cpu_s", "pieces")


def add_to_data_set(telemetry: Path, folder: Path) -> Path:
    """Copy a drive's telemetry into the data set of `folder`; returns the path written.

    The data set is CSV with Hive partitioning by drive. Dask, DuckDB, Spark and Arrow read its folders (drive=NAME,
    special characters percent-encoded) as one table with a column `drive`.

    Raises
    ------
    OSError
        If the telemetry cannot be read or the copy cannot be written.
    """
    part = folder / SUMMARY / DATA_SET / f"drive={quote(telemetry.stem, safe=' ')}" / "part.csv"
    with atomic_write(part) as partial:
        shutil.copyfile(telemetry, partial)
    return part


def write_summary(folder: Path, finished: Sequence[Manifest], failed: Mapping[Path, Exception]) -> Path:
    """Write the table of drives, failed ones first, then by tracked share from the worst on; returns its path.

    Raises
    ------
    OSError
        If the table cannot be written.
    """
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
