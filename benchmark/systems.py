"""Everything that finds lanes, behind one door: a system takes the frames of a drive, or a still, and says where it is.

The recipes follow with their own memory (`LaneFinder.follow`), the tracker with its tracker; in a still each
looks at that picture alone.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np

from benchmark.estimates import AT_M, Reading
from lanes import classic, tracking
from lanes.camera import camera
from lanes.camera.camera import Camera
from lanes.classic.finder import RECIPES, LaneFinder, get_recipe
from lanes.classic.result import LaneResult
from lanes.tracking.birdseye import BirdsEyeView
from lanes.tracking.detector import find_lane
from lanes.tracking.tracked_lane import TrackedLane
from lanes.tracking.tracker import LaneTracker

TRACKER = "tracker"
SYSTEMS = (*RECIPES, TRACKER)
_CAMERA = Path(camera.__file__)


def _package(package: ModuleType) -> Path:
    return Path(package.__file__).parent


# The files and folders that what a system says depends on.
SOURCES = {name: (_CAMERA, _package(classic)) for name in RECIPES} | {TRACKER: (_CAMERA, _package(tracking))}

# Where a recipe's line is put back into the picture: even steps in 1 / x are even steps in picture rows.
ALONG_M = 1 / np.linspace(1 / 1.5, 1 / 200.0, 400)

Follow = Callable[[np.ndarray], Reading]
FindColumns = Callable[[np.ndarray, np.ndarray], np.ndarray]


def follow_with(system: str, camera: Camera, fps: float) -> Follow:
    """A system that is to be shown the frames of a drive in order.

    Parameters
    ----------
    system : str
        In SYSTEMS.
    camera : Camera
        With its pose.
    fps : float
        Frames a second.

    Returns
    -------
    callable
        Takes a frame (height, width, 3) uint8 RGB as taken, gives its Reading.
    """
    require_system(system)
    if system == TRACKER:
        tracker = LaneTracker(camera, fps=fps)
        return lambda image: read_tracked(tracker.update(image))
    finder = LaneFinder(get_recipe(system, camera.size), camera)
    return lambda image: read_classic(finder.follow(image))


def look_with(system: str, camera: Camera) -> Follow:
    """As `follow_with`, for pictures that are looked at each on its own."""
    require_system(system)
    if system == TRACKER:
        view = BirdsEyeView(camera)
        return lambda image: read_tracked(TrackedLane.from_still(find_lane(image, view)))
    finder = LaneFinder(get_recipe(system, camera.size), camera)
    return lambda image: read_classic(finder.find(image))


def find_with(system: str, camera: Camera) -> FindColumns:
    """As `look_with`, for the lines in the picture.

    Returns
    -------
    callable
        Takes a picture and rows (R,), gives the columns (2, R) of the left and right line in the raw picture; -2 where
        a line does not pass, as in TuSimple's files.
    """
    require_system(system)
    if system == TRACKER:
        view = BirdsEyeView(camera)

        def find(image: np.ndarray, rows: np.ndarray) -> np.ndarray:
            lane = find_lane(image, view)
            return np.full((2, len(rows)), -2.0) if lane is None else lane.pixels(camera, rows)

        return find
    finder = LaneFinder(get_recipe(system, camera.size), camera)
    return lambda image, rows: classic_columns(finder.find(image), camera, rows)


def require_system(name: str) -> None:
    """Refuse a name that is no system's."""
    if name not in SYSTEMS:
        raise ValueError(f"there is no system {name!r}; the systems are {', '.join(SYSTEMS)}.")


def read_tracked(tracked: TrackedLane) -> Reading:
    """What the tracker says of a frame."""
    if tracked.lane is None:
        return Reading()
    lines = tracked.lane.lateral_m(AT_M)
    return Reading(lines, tracked.offset_m, tracked.heading_rad, tracked.curvature_per_m, tracked.confidence)


def read_classic(result: LaneResult) -> Reading:
    """What a recipe says of a frame: a lane where it has both lines, measured or from memory; no confidence."""
    lines = result.lateral_m(AT_M)
    if lines is None:
        return Reading()
    heading = np.arctan((result.left_road.c1 + result.right_road.c1) / 2)
    return Reading(lines, result.offset_m, float(heading), result.curvature_per_m)


def classic_columns(result: LaneResult, camera: Camera, rows: np.ndarray) -> np.ndarray:
    """Columns (2, R) of a recipe's lines at rows of the raw picture, from below it to the upper end of its view.

    They are the lines in metres, put back into the picture: views end above the bonnet, and a line does not.
    """
    columns = np.full((2, len(rows)), -2.0)
    lines = ((result.left_road, result.left_px), (result.right_road, result.right_px))
    for k, (line, points) in enumerate(lines):
        if line is None:
            continue
        u, v = camera.road_to_pixels(np.column_stack([ALONG_M, line.lateral_m(ALONG_M)])).T
        top = np.nanmin(camera.distort_points(points)[:, 1])
        shown = np.isfinite(v) & (v >= top - 1)
        if shown.sum() > 1:
            order = np.argsort(v[shown])
            columns[k] = np.interp(rows, v[shown][order], u[shown][order], left=-2, right=-2)
    return np.where((columns >= 0) & (columns <= camera.width - 1), columns, -2.0)
