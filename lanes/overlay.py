"""What the driver sees: a classic recipe's result drawn on the picture that it was found in, with its numbers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from lanes.camera import Camera
from lanes.draw import LEFT, RIGHT, WINDOW, draw_fit, draw_lane, draw_mosaic, draw_pixels, draw_windows, write_text
from lanes.fit import LineFit
from lanes.images import PictureError, list_pictures, read_image, write_image
from lanes.measure import describe_bend, describe_offset
from lanes.recipes import LaneFinder, get_recipe
from lanes.result import LaneResult

# A row in twenty is plenty for a parabola: drawn as straight pieces it leaves the curve by less than 0.1 px.
_ROW_STEP_PX = 20


def line_points(fit: LineFit | None, height: int) -> np.ndarray | None:
    """Points (N, 2) of a fitted line from the bottom of the view to its top, view pixels; None of no line."""
    if fit is None:
        return None
    rows = np.append(np.arange(height - 1, 0, -_ROW_STEP_PX), 0.0)
    return np.column_stack([fit.columns(rows), rows])


def describe_result(result: LaneResult) -> list[str]:
    """The result in words, a line each: what is known, or that the lane is lost."""
    if result.state == "lost":
        return ["lane lost"]
    memory = ["(from memory)"] if result.state == "kept" else []
    return [describe_bend(result.curvature_per_m), describe_offset(result.offset_m), *memory]


def annotate(image: np.ndarray, result: LaneResult, camera: Camera) -> np.ndarray:
    """Draw the lane and its numbers on the raw picture.

    The lines were found in the view of an undistorted picture; they go back through the warp and through the lens,
    so that they lie on the paint of the picture as it was taken.

    Parameters
    ----------
    image : ndarray of shape (height, width, 3), uint8
        RGB, raw. Stays as it is.
    result : LaneResult
    camera : Camera
        The lens; its mount is not needed.

    Returns
    -------
    ndarray of the same shape, uint8
    """
    if result.state == "lost":
        return write_text(image, describe_result(result))
    left, right = (
        result.warp.points_to_picture(line_points(fit, result.warp.size[1])) for fit in (result.left, result.right)
    )
    return write_text(draw_lane(image, left, right, camera), describe_result(result))


def draw_search(result: LaneResult) -> np.ndarray:
    """The view's binary with what the search did: windows, the pixels of each line, the fitted lines. RGB."""
    steps = result.steps
    drawn = draw_pixels(steps.warped_binary, steps.left.pixels, colour=LEFT)
    drawn = draw_pixels(drawn, steps.right.pixels, colour=RIGHT)
    boxes = np.array([(w.left, w.top, w.right, w.bottom) for w in steps.windows], float).reshape(-1, 4)
    drawn = draw_windows(drawn, boxes, colour=WINDOW)
    height = drawn.shape[0]
    return draw_fit(drawn, line_points(result.left, height), line_points(result.right, height))


def diagnose(image: np.ndarray, result: LaneResult, camera: Camera) -> np.ndarray:
    """The annotated picture under a strip of the steps that led to it: binary, view, search."""
    thumbnails = [result.steps.warped_binary, result.steps.view, draw_search(result)]
    annotated = annotate(image, result, camera)
    return draw_mosaic(annotated, thumbnails, ["binary", "view", "search"], lines=describe_result(result))


def telemetry_row(result: LaneResult) -> dict[str, object]:
    """The numbers of one frame, named as in the telemetry's columns; what was not measured is None."""
    row: dict[str, object] = {
        "state": result.state,
        "offset_m": result.offset_m,
        "curvature_per_m": result.curvature_per_m,
        "lane_width_m": result.lane_width_m,
    }
    for side, line in (("left", result.left_road), ("right", result.right_road)):
        row[f"{side}_c0_m"] = line and line.c0_m
        row[f"{side}_c1"] = line and line.c1
        row[f"{side}_c2_per_m"] = line and line.c2_per_m
    return row


def follow_lane(finder: LaneFinder, camera: Camera) -> Callable[[np.ndarray], tuple[np.ndarray, dict[str, object]]]:
    """A function for `video.annotate_video`: takes the frames in order, gives each annotated and its telemetry."""

    def process(frame: np.ndarray) -> tuple[np.ndarray, dict[str, object]]:
        result = finder.follow(frame)
        return annotate(frame, result, camera), telemetry_row(result)

    return process


def annotate_folder(folder: str | Path, output: str | Path, camera: Camera, *, recipe: str = "hls_sobel") -> list[Path]:
    """Find the lane in every picture of a folder, each on its own, and write the annotated pictures to `output`.

    Parameters
    ----------
    folder, output : str or Path
        Two different folders; the pictures keep their names.
    camera : Camera
        With the mount that the pictures were taken from; the recipe's view is laid out for it.
    recipe : str
        A name in `recipes.RECIPES`.

    Raises
    ------
    FileNotFoundError, PictureError
        If a picture cannot be used, or `output` is the folder of the pictures itself.
    """
    if Path(output).resolve() == Path(folder).resolve():
        raise PictureError(f"{output}: is the folder of the pictures, which would be overwritten; name another one.")
    finder = LaneFinder(get_recipe(recipe, camera.size).fitted_to(camera), camera)
    written = []
    for path in list_pictures(folder):
        image = read_image(path)
        camera.require_size(image, path)
        written.append(write_image(Path(output) / path.name, annotate(image, finder.find(image), camera)))
    return written
