"""The errors of many frames in a few numbers: a row of the benchmark's table for each scene and system."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmark.errors import FrameErrors, recoveries
from benchmark.estimates import AT_M

# Distances of which the table speaks.
TABLE_AT_M = (5.0, 15.0, 30.0)
Row = dict[str, str | float]


@dataclass(frozen=True, eq=False)
class Result:
    """What a system made of a scene.

    Parameters
    ----------
    scene, difficulty, system : str
    errors : FrameErrors
    pose : str
        Of the camera that the system was given: "true", "estimated", or why there is none.
    workers : int
        Processes that worked at the same time when the milliseconds were taken.
    fps : float
        Frames a second of the drive.
    machine : str
        On which the milliseconds were taken, as `describe_machine` says.
    """

    scene: str
    difficulty: str
    system: str
    errors: FrameErrors
    pose: str = "true"
    workers: int = 1
    fps: float = 25.0
    machine: str = ""


def score_rows(results: Iterable[Result]) -> list[Row]:
    """A row for each scene and system: what it is, then `score`."""
    return [
        {
            "scene": result.scene,
            "difficulty": result.difficulty,
            "system": result.system,
            "pose": result.pose,
            "workers": result.workers,
            "machine": result.machine,
            **score([result.errors]),
        }
        for result in results
    ]


def total_rows(results: Sequence[Result]) -> list[Row]:
    """A row for each difficulty and system, over the frames of all scenes of that difficulty."""
    groups: dict[tuple[str, str], list[Result]] = {}
    for result in results:
        groups.setdefault((result.difficulty, result.system), []).append(result)
    return [
        {
            "scene": f"all {difficulty}",
            "difficulty": difficulty,
            "system": system,
            "pose": " ".join(sorted({result.pose for result in group})),
            "workers": max(result.workers for result in group),
            "machine": " or ".join(sorted({result.machine for result in group})),
            **score([result.errors for result in group]),
        }
        for (difficulty, system), group in groups.items()
    ]


def score(drives: Sequence[FrameErrors]) -> dict[str, float]:
    """The numbers of some drives, over all their frames.

    Returns
    -------
    dict of str to float
        NaN where there is nothing to measure. `*_share` of the frames with a lane; `confidently_wrong_share` of all
        frames. `*_median` and `*_p95` are over the frames with a lane given, infinite where so many of the lines found
        have turned back before the true ones. `recover_*` are lengths of losses, 0 if there was none.
    """
    exists = _joined([drive.exists for drive in drives])
    given = _joined([drive.given for drive in drives])
    right = _joined([drive.right for drive in drives])
    lateral = _joined([drive.lateral_m for drive in drives])
    lost = [length for drive in drives for length in recoveries(drive.right[drive.exists])]
    measured = {f"lateral_{x:.0f}m": lateral[:, int(np.argmax(x == AT_M))] for x in TABLE_AT_M}
    measured["lateral_5_20m"] = _joined([drive.near_m for drive in drives])
    measured["lateral_5_20m_in_picture"] = _joined([drive.in_picture_m for drive in drives])
    units = dict.fromkeys(measured, "m") | {"offset": "m", "heading": "rad", "curvature": "per_m"}
    measured |= {
        name: _joined([getattr(d, f"{name}_{units[name]}") for d in drives]) for name in units.keys() - measured
    }
    row = {
        "frames": float(len(exists)),
        "lane_frames": float(exists.sum()),
        "available_share": _share(given[exists]),
        "right_share": _share(right[exists]),
        "right_in_picture_share": _share(_joined([drive.right_in_picture for drive in drives])[exists]),
        "confidently_wrong_share": _share(_joined([drive.confidently_wrong for drive in drives])),
    }
    for name, unit in units.items():
        row[f"{name}_median_{unit}"] = percentile(measured[name], 50)
        row[f"{name}_p95_{unit}"] = percentile(measured[name], 95)
    row["recover_median_frames"] = percentile(np.array(lost or [0.0]), 50)
    row["recover_longest_frames"] = float(max(lost, default=0))
    row["time_median_ms"] = percentile(_joined([drive.time_ms for drive in drives]), 50)
    return row


def percentile(values: np.ndarray, percent: float) -> float:
    """The smallest value that is not exceeded by `percent` of them, NaN left out; NaN if there is none.

    A value that occurs, so that infinite ones, which have no mean, do no harm.
    """
    values = np.sort(values[~np.isnan(values)])
    return float(values[max(int(np.ceil(len(values) * percent / 100)) - 1, 0)]) if len(values) else float("nan")


def _share(true: np.ndarray) -> float:
    return float(true.mean()) if len(true) else float("nan")


def _joined(arrays: Sequence[np.ndarray]) -> np.ndarray:
    return np.concatenate(arrays)
