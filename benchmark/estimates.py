"""The estimates of a system: one lane per frame, arrays for a whole drive, and their JSON file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np

from lanes.io.files import read_text, write_atomically
from lanes.tracking.confidence import CORRECT_AT_M

# Distances ahead at which lines are compared with the truth, metres. The confidence is defined at the same distances.
AHEAD_M = CORRECT_AT_M
# Shapes of the estimates that are not single numbers.
SHAPES = {"lines_y_m": (2, len(AHEAD_M)), "covariance": (4, 4), "lines_std_m": (2, len(AHEAD_M))}


@dataclass(frozen=True, eq=False)
class LaneEstimate:
    """The ego lane as a system sees it in one frame; all None if no lane is available. Signs as in docs/conventions.md.

    `lines_y_m` (2, D) are lateral positions of the left and right line at AHEAD_M; NaN beyond the point where a line
    turns back. `confidence` is None also if the system states none, as are the uncertainties: `covariance` (4, 4) of
    the errors of offset, heading, curvature and width, and standard deviations `lines_std_m` (2, D) of `lines_y_m`.
    """

    lines_y_m: np.ndarray | None = None
    offset_m: float | None = None
    heading_rad: float | None = None
    curvature_per_m: float | None = None
    confidence: float | None = None
    width_m: float | None = None
    covariance: np.ndarray | None = None
    lines_std_m: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class DriveEstimates:
    """The estimates of N consecutive frames as arrays, NaN for None.

    `lines_y_m` and `lines_std_m` are (N, 2, D), `covariance` is (N, 4, 4), all others are (N,). `time_ms` is the time
    that the system took for the frame.
    """

    lines_y_m: np.ndarray
    offset_m: np.ndarray
    heading_rad: np.ndarray
    curvature_per_m: np.ndarray
    confidence: np.ndarray
    width_m: np.ndarray
    covariance: np.ndarray
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


def _stack(values: Sequence[float | np.ndarray | None], shape: tuple[int, ...]) -> np.ndarray:
    """(N, *shape) array of values, NaN for None."""
    nothing = np.full(shape, np.nan)
    return np.array([nothing if value is None else value for value in values], float).reshape(-1, *shape)


def write_estimates(path: Path, estimates: DriveEstimates, **metadata: object) -> None:
    """Write estimates and metadata as JSON; NaN becomes null, and all but the covariance is rounded to 1e-7."""
    numbers = {}
    for name, array in asdict(estimates).items():
        # variances of the curvature are as small as 1e-11
        rounded = (array if name == "covariance" else np.round(array, 7)).astype(object)
        rounded[np.isnan(array)] = None
        numbers[name] = rounded.tolist()
    write_atomically(path, json.dumps(metadata | numbers).encode())


def read_estimates(path: Path) -> tuple[DriveEstimates, dict]:
    """Estimates and metadata from a file of `write_estimates`.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If the file is damaged.
    """
    try:
        content = json.loads(read_text(path, "estimates"))
        arrays = {
            field.name: np.array(content.pop(field.name), float).reshape(-1, *SHAPES.get(field.name, ()))
            for field in fields(DriveEstimates)
        }
    except (AttributeError, KeyError, TypeError, ValueError, RecursionError) as error:
        raise ValueError(f"{path}: holds no estimates ({error}); remove it, so that it is made again.") from error
    return DriveEstimates(**arrays), content
