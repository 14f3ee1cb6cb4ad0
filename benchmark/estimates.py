"""Estimates of a system, a lane per frame: arrays for a whole drive, and their file."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from lanes.detect.confidence import CORRECT_AT_M
from lanes.files import require_file, write_atomically

# Distances ahead at which lines are compared with the truth, metres. The confidence is
# defined at the same distances.
AHEAD_M = CORRECT_AT_M
# Where an estimated line is sampled, metres: its chords are within 2 mm of a bend of 16
# m radius. A true line that is compared is shorter than 60 m up to 30 m ahead, because
# its chords are below `benchmark.errors.MAX_LINE_ANGLE_RAD`.
ALONG_M = np.arange(0.0, 2 * AHEAD_M[-1] + 0.5, 0.5)
# Shapes of the estimates that are not single numbers.
SHAPES = {
    "lines_m": (2, len(ALONG_M), 2),
    "covariance": (4, 4),
    "lines_y_m": (2, len(AHEAD_M)),
    "lines_std_m": (2, len(AHEAD_M)),
}
# What a system states in one frame: values of `DriveEstimates` by name, empty if no
# lane is available.
LaneEstimate = Mapping[str, ArrayLike]


@dataclass(frozen=True, eq=False)
class DriveEstimates:
    """The ego lane as a system sees it in N consecutive frames.

    NaN if no lane is available, or nothing is stated.

    Signs as in docs/conventions.md; all are (N,) except for these. `lines_m` (N, 2, P,
    2) are points (x, y) of the left and right line, metres, in order from the car: at
    arc lengths ALONG_M of the road, or at distances x = ALONG_M ahead, as is easier for
    the system. `covariance` (N, 4, 4) is that of the errors of offset, heading,
    curvature and width. `lines_y_m` (N, 2, D) are the lateral positions of the lines at
    AHEAD_M, `lines_std_m` (N, 2, D) their standard deviations, both NaN beyond the
    point where a line turns back. `time_ms` is the time that the system took.
    """

    lines_m: np.ndarray
    offset_m: np.ndarray
    heading_rad: np.ndarray
    curvature_per_m: np.ndarray
    confidence: np.ndarray
    width_m: np.ndarray
    covariance: np.ndarray
    lines_y_m: np.ndarray
    lines_std_m: np.ndarray
    time_ms: np.ndarray

    @classmethod
    def from_frames(
        cls, estimates: Sequence[LaneEstimate], time_ms: Sequence[float]
    ) -> DriveEstimates:
        """From the estimates of consecutive frames and their times."""
        arrays = {}
        for field in fields(cls):
            shape = SHAPES.get(field.name, ())
            arrays[field.name] = np.full((len(estimates), *shape), np.nan)
        frames = zip(estimates, time_ms, strict=True)
        for frame, (estimate, frame_ms) in enumerate(frames):
            arrays["time_ms"][frame] = frame_ms
            for name, value in estimate.items():
                arrays[name][frame] = value
        return cls(**arrays)

    @property
    def available(self) -> np.ndarray:
        """(N,) bool: frames in which the system reports a lane."""
        return np.isfinite(self.offset_m)


def road_points(x_m: np.ndarray, lateral_m: np.ndarray) -> np.ndarray:
    """Points (..., P, 2) of lines at distances (P,) straight ahead.

    `lateral_m` (..., P) are their lateral positions.
    """
    return np.stack(np.broadcast_arrays(x_m, lateral_m), axis=-1)


def write_estimates(path: Path, estimates: DriveEstimates, **metadata: object) -> None:
    """Write estimates and metadata (JSON types) as a compressed NumPy archive."""
    archive = io.BytesIO()
    np.savez_compressed(archive, metadata=json.dumps(metadata), **asdict(estimates))
    write_atomically(path, archive.getvalue())


def read_estimates(path: Path) -> tuple[DriveEstimates, dict]:
    """Estimates and metadata from a file of `write_estimates`.

    Raises OSError if the file cannot be read. Raises ValueError if the file is damaged.
    """
    require_file(path, "estimates")
    try:
        with np.load(path) as archive:
            arrays = [archive[field.name] for field in fields(DriveEstimates)]
            metadata = json.loads(str(archive["metadata"]))
    # damaged archives raise errors of zipfile, zlib, tokenize and NumPy
    except Exception as error:
        raise ValueError(
            f"{path}: holds no estimates ({error}); remove it, so that it is made "
            "again."
        ) from error
    return DriveEstimates(*arrays), metadata
