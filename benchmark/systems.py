"""All lane finders behind one interface: the three recipes, each in two variants, the
tracker, and its detector.

The source points of a recipe's homography are the published ones, or those of a
rectangle on the road from the camera pose ("hls_sobel_pose" and so on; see
`helpers.recipe_from_pose`).

`start_system` runs a system on the frames of a drive, with its memory:
`LaneFinder.follow` or `LaneTracker.update`. The detector has none: it is what the
tracker does in a single picture. `column_detector` runs it on single pictures.
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
from lanes import detect, tracking
from lanes.camera import model
from lanes.camera.model import Camera, undistort
from lanes.detect.lane import Lane, columns_at
from lanes.detect.markings import Markings
from lanes.detect.road import CENTRE, CURVATURE, HEADING, SIDES, WIDTH, line_points
from lanes.detect.search import find_lane
from lanes.tracking.tracker import LaneTracker, TrackerSettings

TRACKER = "tracker"
DETECTOR = "detector"
RECIPE_SYSTEMS = (*RECIPES, *(name + POSE_SUFFIX for name in RECIPES))
SYSTEMS = (*RECIPE_SYSTEMS, TRACKER, DETECTOR)
# In single pictures the tracker is the detector.
STILL_SYSTEMS = (*RECIPE_SYSTEMS, TRACKER)
# Files and folders that the estimates of a system depend on.
_CAMERA = Path(inspect.getfile(model))
_HELPERS = Path(inspect.getfile(LaneFinder))
_DETECT = Path(inspect.getfile(detect)).parent
_TRACK = Path(inspect.getfile(tracking)).parent
# Distances at which a recipe's line is projected into the picture: even steps in 1 / x
# are even steps in picture rows.
PROJECTED_AT_M = 1 / np.linspace(1 / 1.5, 1 / 200.0, 400)


Lines = Sequence[Sequence[float]]
OwnFinder = Callable[[np.ndarray, Camera], Lines | None]
ColumnDetector = Callable[[np.ndarray, np.ndarray], np.ndarray]


def source_files(system: str) -> tuple[Path, ...]:
    """Source files and folders that the estimates of a system depend on."""
    if is_own_finder(system):
        path, _, _ = system.rpartition(":")
        return _CAMERA, Path(path)
    if system in (TRACKER, DETECTOR):
        return _CAMERA, _DETECT, _TRACK
    return _CAMERA, _HELPERS


def start_system(
    system: str | OwnFinder,
    camera: Camera,
    fps: float,
    *,
    settings: TrackerSettings | None = None,
    markings: Markings | None = None,
) -> tuple[Callable, Callable[..., LaneEstimate]]:
    """Start a system on a drive: two functions.

    The first is called with the next frame, and with the seconds since the one before
    if they are not 1 / fps; only it counts in the time of a system. The second makes
    the estimate of what the first returns.

    A frame is (height, width, 3) uint8 RGB with lens distortion. `system` is a name of
    `SYSTEMS`, "file.py:function", or a finder itself (see docs/own_finder.md);
    `settings` are those of the tracker, `markings` those of tracker and detector
    (`lanes.find_lane`). Raises ValueError if the system is unknown.
    """
    if callable(system):
        return lambda image, _=None: system(image, camera), estimate_from_lines
    if is_own_finder(system):
        return start_system(load_finder(system), camera, fps)
    require_system(system)

    if system == TRACKER:
        tracker = LaneTracker(camera, fps=fps, settings=settings, markings=markings)

        def track(image: np.ndarray, elapsed_s: float | None = None) -> Lane | None:
            return tracker.update(image, elapsed_s=elapsed_s)

        return track, lane_estimate

    if system == DETECTOR:

        def detect_lane(image: np.ndarray, _: float | None = None) -> Lane | None:
            return find_lane(image, camera, markings=markings)

        return detect_lane, lane_estimate

    finder = start_recipe(system, camera)

    def follow(image: np.ndarray, _: float | None = None) -> LaneResult:
        return finder.follow(recipe_image(image, camera))

    return follow, recipe_estimate


def column_detector(system: str, camera: Camera) -> ColumnDetector:
    """A recipe, or a finder of one's own, that detects the lines of single pictures,
    without memory.

    It is a function of a picture and rows (R,), and returns the columns (2, R) of the
    left and right line in the raw picture, -2 where a line does not pass, as in
    TuSimple's files. Raises ValueError if the system is unknown.
    """
    require_system(system)
    if is_own_finder(system):
        find = load_finder(system)

        def find_columns(image: np.ndarray, rows: np.ndarray) -> np.ndarray:
            return _own_columns(find(image, camera), camera, rows)

    else:
        finder = start_recipe(system, camera)

        def find_columns(image: np.ndarray, rows: np.ndarray) -> np.ndarray:
            result = finder.find(recipe_image(image, camera))
            return recipe_columns(result, camera, rows)

    return find_columns


def start_recipe(system: str, camera: Camera) -> LaneFinder:
    """The finder of a recipe for the images of `recipe_image`.

    Raises CameraError without a pose.
    """
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
    """The image for a recipe: undistorted if the lens is a fisheye lens, which
    helpers.py does not know.
    """
    return undistort(image, camera) if camera.is_fisheye else image


def require_system(name: str) -> None:
    """Raise a ValueError if there is no system of this name, or its file
    "file.py:function" cannot be used.
    """
    if is_own_finder(name):
        load_finder(name)
    elif name not in SYSTEMS:
        raise ValueError(
            f"there is no system {name!r}; the systems are {', '.join(SYSTEMS)}, and "
            "file.py:function for your own."
        )


def lane_estimate(lane: Lane | None) -> LaneEstimate:
    """The estimate of the tracker or the detector for a frame."""
    if lane is None:
        return {}
    stated = [CENTRE, HEADING, CURVATURE, WIDTH]
    # the offset is that of the car from the centre
    signs = [-1, 1, 1, 1]
    covariance = lane.covariance[np.ix_(stated, stated)]
    return {
        "offset_m": lane.offset_m,
        "heading_rad": lane.heading_rad,
        "curvature_per_m": lane.curvature_per_m,
        "confidence": lane.confidence,
        "width_m": lane.width_m,
        "lines_m": line_points(lane.model, SIDES, ALONG_M),
        "covariance": covariance * np.outer(signs, signs),
        "lines_y_m": lane.lateral_m(AHEAD_M),
        "lines_std_m": lane.lateral_std_m(AHEAD_M),
    }


def recipe_estimate(result: LaneResult) -> LaneEstimate:
    """A recipe's estimate for a frame: a lane if both lines are measured or remembered.

    No confidence.
    """
    roads = (result.left_road, result.right_road)
    lines = [(road.c2_per_m / 2, road.c1, road.c0_m) for road in roads if road]
    if len(lines) < 2:
        return {}
    return estimate_from_lines(lines)


def _own_columns(lines: Lines | None, camera: Camera, rows: np.ndarray) -> np.ndarray:
    if lines is None:
        return project_lines([None, None], camera, rows)
    _require_two(lines)
    lateral_m = [np.polyval(line, PROJECTED_AT_M) for line in lines]
    return project_lines(lateral_m, camera, rows)


def project_lines(
    lateral_m: Iterable[np.ndarray | None],
    camera: Camera,
    rows: np.ndarray,
    *,
    top_rows: Sequence[float] = (-np.inf, -np.inf),
) -> np.ndarray:
    """Columns (2, R) in the raw picture of lines with lateral positions (2, N) at
    PROJECTED_AT_M; -2 outside of it.

    A line that is None has no columns. `top_rows` are the rows at which the two lines
    end.
    """
    outlines = []
    for y_m, top_row in zip(lateral_m, top_rows, strict=True):
        points_m = np.empty((0, 2))
        if y_m is not None:
            points_m = np.column_stack([PROJECTED_AT_M, y_m])
        pixels = camera.road_to_pixels(points_m)
        v = pixels[:, 1]
        visible = pixels[np.isfinite(v) & (v >= top_row)]
        upwards = np.argsort(-visible[:, 1])
        outlines.append(visible[upwards])
    return columns_at(rows, outlines, camera)


def recipe_columns(result: LaneResult, camera: Camera, rows: np.ndarray) -> np.ndarray:
    """Columns (2, R) of a recipe's lines at rows of the raw picture, up to the upper
    end of its bird's-eye view.

    The lines in metres are projected into the picture, because the view ends above the
    bonnet and the lines do not.
    """
    lateral_m: list[np.ndarray | None] = [None, None]
    top_rows = [np.inf, np.inf]
    roads = (result.left_road, result.right_road)
    for side, (road, points) in enumerate(zip(roads, result.lines_px, strict=True)):
        if road is not None:
            lateral_m[side] = np.asarray(road.lateral_m(PROJECTED_AT_M))
        if points is not None:
            pixels = camera.distort_points(points)
            top_rows[side] = np.nanmin(pixels[:, 1]) - 1
    return project_lines(lateral_m, camera, rows, top_rows=top_rows)


def is_own_finder(system: str) -> bool:
    """Whether the name of a system has the form "file.py:function"."""
    return ".py:" in system


def load_finder(system: str) -> OwnFinder:
    """The function of a system "file.py:function", from the file as it is now.

    Each call executes the file.

    Raises ValueError if the file does not exist, cannot be executed, or has no such
    function.
    """
    path, _, name = system.rpartition(":")
    file = Path(path)
    if not file.is_file():
        raise ValueError(
            f"{file}: there is no such file; name your finder as file.py:function."
        )
    try:
        names = runpy.run_path(path, run_name=file.stem)
    except Exception as error:
        kind = type(error).__name__
        raise ValueError(
            f"{file}: cannot be executed ({kind}: {error}); correct it."
        ) from error
    finder = names.get(name)
    if not callable(finder):
        raise ValueError(
            f"{file}: has no function {name!r}; name your finder as file.py:function."
        )
    return finder


def estimate_from_lines(lines: Lines | None) -> LaneEstimate:
    """The estimate of a finder that returns the coefficients of two lines.

    No lane for None.

    Raises ValueError if there are not two lines.
    """
    if lines is None:
        return {}
    _require_two(lines)
    polynomials = [np.poly1d(line) for line in lines]
    lateral_m = np.array([line(ALONG_M) for line in polynomials])
    # At the car: position, first and second derivative.
    at_car_m = np.array([line(0.0) for line in polynomials])
    slopes = np.array([line.deriv(1)(0.0) for line in polynomials])
    bends = np.array([line.deriv(2)(0.0) for line in polynomials])
    curvatures = bends / (1 + slopes**2) ** 1.5
    return {
        "lines_m": road_points(ALONG_M, lateral_m),
        "offset_m": -at_car_m.mean(),
        "heading_rad": np.arctan(slopes.mean()),
        "curvature_per_m": np.mean(curvatures),
    }


def _require_two(lines: Lines) -> None:
    if len(lines) != 2:
        raise ValueError(
            f"a finder returns two lines or None, but this one returned {len(lines)}."
        )
