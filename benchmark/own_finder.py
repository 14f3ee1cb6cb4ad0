"""A lane finder of one's own as a system of the benchmark.

It is a function of a raw RGB picture and the camera with its pose. It returns the left and the right line as polynomial
coefficients in metres, highest power first as `np.polyfit` returns them (y = np.polyval(line, x), x forward, y left of
the car), or None where it finds no lane. The benchmark's commands name it "file.py:function".
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from benchmark.estimates import ALONG_M, LaneEstimate, road_points
from lanes.camera import Camera

Lines = Sequence[Sequence[float]]
OwnFinder = Callable[[np.ndarray, Camera], Lines | None]


def is_own_finder(system: str) -> bool:
    """Whether the name of a system has the form "file.py:function"."""
    return ".py:" in system


def finder_file(system: str) -> Path:
    """The file of a system "file.py:function"."""
    return Path(system.rpartition(":")[0])


def load_finder(system: str) -> OwnFinder:
    """The function of a system "file.py:function", from the file as it is now; each call executes the file.

    Raises
    ------
    ValueError
        If the file does not exist, cannot be executed, or has no such function.
    """
    file, name = finder_file(system), system.rpartition(":")[2]
    if not file.is_file():
        raise ValueError(f"{file}: there is no such file; name your finder as file.py:function.")
    spec = importlib.util.spec_from_file_location(file.stem, file)
    if spec is None or spec.loader is None:
        raise ValueError(f"{file}: is not a Python file; name your finder as file.py:function.")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise ValueError(f"{file}: cannot be executed ({type(error).__name__}: {error}); correct it.") from error
    if not callable(getattr(module, name, None)):
        raise ValueError(f"{file}: has no function {name!r}; name your finder as file.py:function.")
    return getattr(module, name)


def estimate_from_lines(lines: Lines | None) -> LaneEstimate:
    """The estimate of a finder that returns the coefficients of two lines; no lane for None.

    Raises
    ------
    ValueError
        If there are not two lines.
    """
    if lines is None:
        return LaneEstimate()
    if len(lines) != 2:
        raise ValueError(f"a finder returns two lines or None, but this one returned {len(lines)}.")
    shapes = [np.poly1d(line) for line in lines]
    slope = np.mean([shape.deriv()(0.0) for shape in shapes])
    bend = np.mean([shape.deriv(2)(0.0) for shape in shapes])
    return LaneEstimate(
        road_points(ALONG_M, np.array([shape(ALONG_M) for shape in shapes])),
        offset_m=float(-np.mean([shape(0.0) for shape in shapes])),
        heading_rad=float(np.arctan(slope)),
        curvature_per_m=float(bend / (1 + slope**2) ** 1.5),
    )
