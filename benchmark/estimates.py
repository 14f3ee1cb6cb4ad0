"""The estimates of a system: one lane per frame, arrays for a whole drive, and their file."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np

from lanes.detect.confidence import CORRECT_AT_M
from lanes.files import require_file, write_atomically

# Distances ahead at which lines are compared with the truth, metres. The confidence is defined at the same distances.
AHEAD_M = CORRECT_AT_M
# Where an estimated line is sampled, metres: its chords are within 2 mm of a bend of 16 m radius. A true line that is
# compared is shorter than 60 m up to 30 m ahead, because its chords are below `benchmark.errors.MAX_LINE_ANGLE_RAD`.
ALONG_M = np.arange(0.0, 2 * AHEAD_M[-1] + 0.5, 0.5)
# Shapes of the estimates that are not single numbers.
SHAPES = {
    "lines_m": (2, len(ALONG_M), 2),
    "covariance": (4, 4),
    "lines_y_m": (2, len(AHEAD_M)),
    "lines_std_m": (2, len(AHEAD_M)),
}


@dataclass(frozen=True, eq=False)
class LaneEstimate:
    """The ego lane as a system sees it in one frame; all None if no lane is available. Signs as in docs/conventions.md.

    `lines_m` (2, P, 2) are points (x, y) of the left and right line, metres, in order from the car: at arc lengths
    ALONG_M of the road, or at distances x = ALONG_M ahead, as is easier for the system. `confidence` is None also if
    the system states none, as are the uncertainties: `covariance` (4, 4) of the errors of offset, heading, curvature
    and width; lateral positions `lines_y_m` (2, D) of the lines at AHEAD_M and their standard deviations `lines_std_m`
    (2, D), both NaN beyond the point where a line turns back.
    """

    lines_m: np.ndarray | None = None
    offset_m: float | None = None
    heading_rad: float | None = None
    curvature_per_m: float | None = None
    confidence: float | None = None
    width_m: float | None = None
    covariance: np.ndarray | None = None
    lines_y_m: np.ndarray | None = None
    lines_std_m: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class DriveEstimates:
    """The estimates of N consecutive frames as arrays, NaN for None.

    `lines_m` is (N, 2, P, 2), `covariance` (N, 4, 4), `lines_y_m` and `lines_std_m` are (N, 2, D), all others (N,).
    `time_ms` is the time that the system took for the frame.
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
    def from_frames(cls, estimates: Sequence[LaneEstimate], time_ms: Sequence[float]) -> DriveEstimates:
        """From the estimates of consecutive frames and their times."""
        arrays = {
            field.name: _stack([getattr(estimate, field.name) for estimate in estimates], SHAPES.get(field.name, ()))
            for field in fields(LaneEstimate)
        }
        return cls(**arrays, time_ms=np.array(time_ms, float))

    @property
    def available(self) -> np.ndarray:
        """(N,) bool: frames in which the system reports a lane."""
        return np.isfinite(self.offset_m)


def road_points(x_m: np.ndarray, lateral_m: np.ndarray) -> np.ndarray:
    """Points (..., P, 2) of lines with the lateral positions (..., P) at distances (P,) straight ahead."""
    return np.stack(np.broadcast_arrays(x_m, lateral_m), axis=-1)


def _stack(values: Sequence[float | np.ndarray | None], shape: tuple[int, ...]) -> np.ndarray:
    """(N, *shape) array of values, NaN for None."""
    nothing = np.full(shape, np.nan)
    return np.array([nothing if value is None else value for value in values], float).reshape(-1, *shape)


def write_estimates(path: Path, estimates: DriveEstimates, **metadata: object) -> None:
    """Write estimates and metadata (JSON types) as a compressed NumPy archive."""
    archive = io.BytesIO()
    np.savez_compressed(archive, metadata=json.dumps(metadata), **asdict(estimates))
    write_atomically(path, archive.getvalue())


def read_estimates(path: Path) -> tuple[DriveEstimates, dict]:
    """Estimates and metadata from a file of `write_estimates`.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If the file is damaged.
    """
    require_file(path, "estimates")
    try:
        with np.load(path) as archive:
            arrays = {field.name: archive[field.name] for field in fields(DriveEstimates)}
            return DriveEstimates(**arrays), json.loads(str(archive["metadata"]))
    except Exception as error:  # damaged archives raise errors of zipfile, zlib, tokenize and NumPy
        raise ValueError(f"{path}: holds no estimates ({error}); remove it, so that it is made again.") from error
