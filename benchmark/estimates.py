"""What a system says of each frame of a drive, and how that is kept in a file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np

from lanes.io.files import read_text, write_atomically
from lanes.tracking.confidence import RIGHT_AT_M

# Distances ahead at which lines are held against the truth, metres: those that the confidence speaks of.
AT_M = RIGHT_AT_M


@dataclass(frozen=True, eq=False)
class Reading:
    """What a system says of one frame; all None where it gives no lane.

    Parameters
    ----------
    lines_y_m : ndarray of shape (2, D) or None
        Lateral places of the left and right line at the distances AT_M; NaN where a line has turned back before.
    offset_m, heading_rad, curvature_per_m : float or None
        Signs as everywhere.
    confidence : float or None
        None also where the system states none.
    """

    lines_y_m: np.ndarray | None = None
    offset_m: float | None = None
    heading_rad: float | None = None
    curvature_per_m: float | None = None
    confidence: float | None = None


@dataclass(frozen=True, eq=False)
class Readings:
    """The readings of N frames as arrays, NaN for None.

    Parameters
    ----------
    lines_y_m : ndarray of shape (N, 2, D)
    offset_m, heading_rad, curvature_per_m, confidence, time_ms : ndarray of shape (N,)
        `time_ms` is how long the system took.
    """

    lines_y_m: np.ndarray
    offset_m: np.ndarray
    heading_rad: np.ndarray
    curvature_per_m: np.ndarray
    confidence: np.ndarray
    time_ms: np.ndarray

    @classmethod
    def of(cls, readings: Sequence[Reading], time_ms: Sequence[float]) -> Readings:
        """The readings of consecutive frames, and the milliseconds that each took."""
        nowhere = np.full((2, len(AT_M)), np.nan)
        lines = [nowhere if r.lines_y_m is None else r.lines_y_m for r in readings]
        numbers = {
            name: np.array([getattr(r, name) for r in readings], float)
            for name in ("offset_m", "heading_rad", "curvature_per_m", "confidence")
        }
        return cls(np.array(lines, float).reshape(-1, 2, len(AT_M)), **numbers, time_ms=np.array(time_ms, float))

    @property
    def given(self) -> np.ndarray:
        """(N,) bool: frames in which a lane is given."""
        return np.isfinite(self.offset_m)

    def cut(self, frames: slice) -> Readings:
        """The readings of some of the frames."""
        return Readings(**{field.name: getattr(self, field.name)[frames] for field in fields(self)})


def write_readings(path: Path, readings: Readings, **about: object) -> None:
    """Write readings, and what else is to be known `about` them, as JSON; micrometres are kept, NaN becomes null."""
    numbers = {name: _nested(array) for name, array in asdict(readings).items()}
    write_atomically(path, json.dumps(about | numbers).encode())


def read_readings(path: Path) -> tuple[Readings, dict]:
    """Read what `write_readings` wrote: the readings, and what else is known; ValueError if it is damaged."""
    try:
        content = json.loads(read_text(path, "readings"))
        arrays = {field.name: np.array(content.pop(field.name), float) for field in fields(Readings)}
        arrays["lines_y_m"] = arrays["lines_y_m"].reshape(-1, 2, len(AT_M))
    except (AttributeError, KeyError, TypeError, ValueError, RecursionError) as error:
        raise ValueError(f"{path}: holds no readings ({error}); remove it, to have them made again.") from error
    return Readings(**arrays), content


def _nested(array: np.ndarray) -> list:
    """Nested lists of numbers with null for NaN, as JSON has no NaN; offsets and places need no more than 1e-7."""
    return np.where(np.isnan(array), None, np.round(array, 7).astype(object)).tolist()
