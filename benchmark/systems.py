"""All lane finders behind one interface: the three recipes, each in two variants, the tracker, and its detector.

The source points of a recipe's homography are the published ones, or those of a rectangle on the road from the camera
pose ("hls_sobel_pose" and so on; see `helpers.recipe_from_pose`).

`start_system` runs a system on the frames of a drive, with its memory: `LaneFinder.follow` or `LaneTracker.update`. The
detector has none: it is what the tracker does in a single picture.
`column_detector` runs it on single pictures.
"""

from __future__ import annotations

import inspect
import runpy
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np

from benchmark.estimates import AHEAD_M, ALONG_M, LaneEstimate, road_points
from helpers import (
    POSE_SUFFIX,
    RECIPES,
    LaneFinder,
    LaneResult,
    Lens,
    get_recipe,
    recipe_from_pose,
    road_homography,
)
from lanes import camera, detect, tracking
from lanes.camera import Camera, undistort
from lanes.detect.lane import Lane, columns_at
from lanes.detect.markings import Markings
from lanes.detect.road import CENTRE, CURVATURE, HEADING, SIDES, WIDTH, line_points
from lanes.detect.search import find_lane
from lanes.tracking.tracker import LaneTracker, TrackerSettings

TRACKER, DETECTOR = "tracker", "detector"
RECIPE_SYSTEMS = (*RECIPES, *(name + POSE_SUFFIX for name in RECIPES))
SYSTEMS = (*RECIPE_SYSTEMS, TRACKER, DETECTOR)
# In single pictures the tracker is the detector.
STILL_SYSTEMS = (*RECIPE_SYSTEMS, TRACKER)
# Files and folders that the estimates of a system depend on.
_CAMERA = Path(inspect.getfile(camera))
_HELPERS = Path(inspect.getfile(LaneFinder))
_DETECT, _TRACK = (Path(inspect.getfile(package)).parent for package in (detect, tracking))
# Distances at which a recipe's line is projected into the picture: even steps in 1 / x are even steps in picture rows.
PROJECTED_AT_M = 1 / np.linspace(1 / 1.5, 1 / 200.0, 400)


Lines = Sequence[Sequence[float]]
OwnFinder = Callable[[np.ndarray, Camera], Lines | None]
ColumnDetector = Callable[[np.ndarray, np.ndarray], np.ndarray]


def source_files(system: str) -> tuple[Path, ...]:
    """Source files and folders that the estimates of a system depend on."""
    if is_own_finder(system):
        return _CAMERA, Path(system.rpartition(":")[0])
    return (_CAMERA, _DETECT, _TRACK) if system in (TRACKER, DETECTOR) else (_CAMERA, _HELPERS)


def start_system(
    system: str | OwnFinder,
    camera: Camera,
    fps: float,
    *,
    settings: TrackerSettings | None = None,
    markings: Markings | None = None,
) -> tuple[Callable, Callable[..., LaneEstimate]]:
    """Start a system on a drive: a function of the next frame, and of the seconds since the one before if they are not
    1 / fps, and one that makes the estimate of what it returns.

    A frame is (height, width, 3) uint8 RGB with lens distortion. Only the first function counts in the time of a
    system. `system` is a name of `SYSTEMS`, "file.py:function", or a finder itself (see docs/own_finder.md);
    `settings` are those of the tracker, `markings` those of tracker and detector (`lanes.find_lane`). Raises ValueError
    if the system is unknown.
    """
    if callable(system):
        return lambda image, _=None: system(image, camera), estimate_from_lines
    if is_own_finder(system):
        return start_system(load_finder(system), camera, fps)
    require_system(system)
    if system == TRACKER:
        tracker = LaneTracker(camera, fps=fps, settings=settings, markings=markings)
        return lambda image, elapsed_s=None: tracker.update(image, elapsed_s=elapsed_s), lane_estimate
    if system == DETECTOR:
        return lambda image, _=None: find_lane(image, camera, markings=markings), lane_estimate
    finder = start_recipe(system, camera)
    return lambda image, _=None: finder.follow(recipe_image(image, camera)), recipe_estimate


def column_detector(system: str, camera: Camera) -> ColumnDetector:
    """A recipe, or a finder of one's own, that detects the lines of single pictures, without memory.

    It is a function of a picture and rows (R,), and returns the columns (2, R) of the left and right line in the raw
    picture, -2 where a line does not pass, as in TuSimple's files. Raises ValueError if the system is unknown.
    """
    require_system(system)
    if is_own_finder(system):
        find = load_finder(system)
        return lambda image, rows: _own_columns(find(image, camera), camera, rows)
    finder = start_recipe(system, camera)
    return lambda image, rows: recipe_columns(finder.find(recipe_image(image, camera)), camera, rows)


def start_recipe(system: str, camera: Camera) -> LaneFinder:
    """The finder of a recipe for the images of `recipe_image`; raises CameraError without a pose."""
    distortion = camera.distortion
    if camera.is_fisheye:
        distortion = np.zeros(5)
    lens = Lens(camera.matrix, distortion, camera.size)
    pose = camera.require_pose()
    image_to_road = road_homography(
        lens,
        height_m=pose.height_m,
        pitch_rad=pose.pitch_rad,
        yaw_rad=pose.yaw_rad,
        roll_rad=pose.roll_rad,
    )
    recipe = get_recipe(system.removesuffix(POSE_SUFFIX), camera.size)
    if system.endswith(POSE_SUFFIX):
        recipe = recipe_from_pose(recipe, image_to_road)
    return LaneFinder(recipe, lens, image_to_road)


def recipe_image(image: np.ndarray, camera: Camera) -> np.ndarray:
    """The image for a recipe: undistorted if the lens is a fisheye lens, which helpers.py does not know."""
    return undistort(image, camera) if camera.is_fisheye else image


def require_system(name: str) -> None:
    """Raise a ValueError if there is no system of this name, or its file "file.py:function" cannot be used."""
    if is_own_finder(name):
        load_finder(name)
    elif name not in SYSTEMS:
        raise ValueError(
            f"there is no system {name!r}; the systems are {', '.join(SYSTEMS)}, and file.py:function for your own."
        )


def lane_estimate(lane: Lane | None) -> LaneEstimate:
    """The estimate of the tracker or the detector for a frame."""
    if lane is None:
        return {}
    names = ("offset_m", "heading_rad", "curvature_per_m", "confidence", "width_m")
    stated, signs = [CENTRE, HEADING, CURVATURE, WIDTH], [-1, 1, 1, 1]  # the offset is that of the car from the centre
    return {name: getattr(lane, name) for name in names} | {
        "lines_m": line_points(lane.model, SIDES, ALONG_M),
        "covariance": lane.covariance[np.ix_(stated, stated)] * np.outer(signs, signs),
        "lines_y_m": lane.lateral_m(AHEAD_M),
        "lines_std_m": lane.lateral_std_m(AHEAD_M),
    }


def recipe_estimate(result: LaneResult) -> LaneEstimate:
    """A recipe's estimate for a frame: a lane if both lines are measured or remembered; no confidence."""
    roads = result.left_road, result.right_road
    lines = [(road.c2_per_m / 2, road.c1, road.c0_m) for road in roads if road]
    return estimate_from_lines(lines if len(lines) == 2 else None)


def _own_columns(lines: Lines | None, camera: Camera, rows: np.ndarray) -> np.ndarray:
    lateral_m = [None if lines is None else np.polyval(lines[side], PROJECTED_AT_M) for side in (0, 1)]
    return project_lines(lateral_m, camera, rows)


def project_lines(
    lateral_m: Iterable[np.ndarray | None],
    camera: Camera,
    rows: np.ndarray,
    *,
    top_rows: tuple[float, float] = (-np.inf, -np.inf),
) -> np.ndarray:
    """Columns (2, R) in the raw picture of lines with lateral positions (2, N) at PROJECTED_AT_M; -2 outside of it.

    A line that is None has no columns. `top_rows` are the rows at which the two lines end.
    """
    outlines = []
    for y_m, top_row in zip(lateral_m, top_rows, strict=True):
        points = np.empty((0, 2)) if y_m is None else np.column_stack([PROJECTED_AT_M, y_m])
        pixels = camera.road_to_pixels(points)
        shown = pixels[np.isfinite(pixels[:, 1]) & (pixels[:, 1] >= top_row)]
        outlines.append(shown[np.argsort(-shown[:, 1])])
    return columns_at(rows, outlines, camera)


def recipe_columns(result: LaneResult, camera: Camera, rows: np.ndarray) -> np.ndarray:
    """Columns (2, R) of a recipe's lines at rows of the raw picture, up to the upper end of its bird's-eye view.

    The lines in metres are projected into the picture, because the view ends above the bonnet and the lines do not.
    """
    lines = result.left_road, result.right_road
    lateral_m = [None if line is None else np.asarray(line.lateral_m(PROJECTED_AT_M)) for line in lines]
    left_row, right_row = (
        np.inf if points is None else np.nanmin(camera.distort_points(points)[:, 1]) - 1 for points in result.lines_px
    )
    return project_lines(lateral_m, camera, rows, top_rows=(left_row, right_row))


def is_own_finder(system: str) -> bool:
    """Whether the name of a system has the form "file.py:function"."""
    return ".py:" in system


def load_finder(system: str) -> OwnFinder:
    """The function of a system "file.py:function", from the file as it is now; each call executes the file.

    Raises ValueError if the file does not exist, cannot be executed, or has no such function.
    """
    path, _, name = system.rpartition(":")
    file = Path(path)
    if not file.is_file():
        raise ValueError(f"{file}: there is no such file; name your finder as file.py:function.")
    try:
        finder = runpy.run_path(path, run_name=file.stem).get(name)
    except Exception as error:
        raise ValueError(f"{file}: cannot be executed ({type(error).__name__}: {error}); correct it.") from error
    if not callable(finder):
        raise ValueError(f"{file}: has no function {name!r}; name your finder as file.py:function.")
    return finder


def estimate_from_lines(lines: Lines | None) -> LaneEstimate:
    """The estimate of a finder that returns the coefficients of two lines; no lane for None.

    Raises ValueError if there are not two lines.
    """
    if lines is None:
        return {}
    if len(lines) != 2:
        raise ValueError(f"a finder returns two lines or None, but this one returned {len(lines)}.")
    shapes = [np.poly1d(line) for line in lines]
    lateral_m, slopes, bends = np.array([[shape.deriv(order)(0.0) for shape in shapes] for order in (0, 1, 2)])
    return {
        "lines_m": road_points(ALONG_M, np.array([shape(ALONG_M) for shape in shapes])),
        "offset_m": -lateral_m.mean(),
        "heading_rad": np.arctan(slopes.mean()),
        "curvature_per_m": np.mean(bends / (1 + slopes**2) ** 1.5),
    }
