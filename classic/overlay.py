"""Draw the result of a classic recipe on the image, with its measurements."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from classic.finder import LaneFinder, LaneResult
from lanes.camera import Camera
from lanes.canvas import (
    LANE_COLOUR,
    LEFT_COLOUR,
    RIGHT_COLOUR,
    WINDOW_COLOUR,
    Colour,
    blend_polygon,
    draw_polyline,
    finite_points,
    put_text,
)
from lanes.describe import describe_bend, describe_offset
from lanes.images import require_rgb

# Straight lines of the undistorted image are curved in the raw one: steps of this length follow them to 0.01 px.
LENS_STEP_PX = 8.0


def describe_result(result: LaneResult) -> list[str]:
    """Text lines with bend and offset, or "lane lost"."""
    if result.state == "lost":
        return ["lane lost"]
    memory = ["(from memory)"] if result.state == "kept" else []
    return [describe_bend(result.curvature_per_m), describe_offset(result.offset_m), *memory]


def annotate_image(image: np.ndarray, result: LaneResult, camera: Camera) -> np.ndarray:
    """A copy of the raw RGB image with the lane and its numbers.

    The lines are projected from the bird's-eye view to the raw image, through the homography and the distortion of
    the lens, so that they coincide with the markings. The pose of the camera is not used.
    """
    drawn = _draw_result(image, result, camera)
    put_text(drawn, describe_result(result))
    return drawn


def to_rgb(image: np.ndarray) -> np.ndarray:
    """A new RGB image from RGB, gray (height, width) uint8, or a mask of bool or of 0 and 1."""
    image = np.asarray(image)
    if image.ndim == 2:
        if image.dtype == bool or (image.size and image.max() <= 1):
            image = (image > 0).astype(np.uint8) * 255
        image = np.repeat(image[:, :, None], 3, axis=2)
    return require_rgb(image).copy()


def follow_lane(
    finder: LaneFinder, camera: Camera
) -> Callable[[np.ndarray], tuple[np.ndarray, dict[str, str | float | None]]]:
    """A function for `process_video` that returns the annotated frame and its telemetry; frames must be in order."""

    def process(frame: np.ndarray) -> tuple[np.ndarray, dict[str, str | float | None]]:
        result = finder.follow(frame)
        return annotate_image(frame, result, camera), result.as_row()

    return process


def _draw_result(image: np.ndarray, result: LaneResult, camera: Camera) -> np.ndarray:
    """The image with the lane; a copy of the image if the lane is lost."""
    if result.state == "lost":
        return require_rgb(image).copy()
    left_px, right_px = result.lines_px
    return draw_lane_between(image, left_px, right_px, camera)


def draw_lane_between(
    image: np.ndarray,
    left_px: np.ndarray | None,
    right_px: np.ndarray | None,
    camera: Camera | None = None,
    *,
    line_width_px: float | None = None,
) -> np.ndarray:
    """Draw a lane on a raw or undistorted image.

    Parameters
    ----------
    image : ndarray of shape (height, width, 3), uint8
        RGB. The raw image if `camera` is given, otherwise the image that the points refer to.
    left_px, right_px : ndarray of shape (N, 2) and (M, 2), or None
        The two lines, both from far to near or both from near to far. If one is None, the other is drawn and the area
        is not filled.
    camera : Camera, optional
        If given, the points are pixels of the undistorted image and are distorted with its lens model.
    line_width_px : float, optional
        Width of the lines, red left and blue right; 0 draws none. The default is 1/160 of the image width.

    Raises
    ------
    PictureError
        If the image is not RGB or not of the camera's size.
    """
    drawn = require_rgb(image).copy()
    if camera is not None:
        camera.require_size(image)
    left, right = (_distort_line(points, camera) for points in (left_px, right_px))
    if len(left) >= 2 and len(right) >= 2:
        blend_polygon(drawn, np.vstack([left, right[::-1]]), LANE_COLOUR, 0.3)
    width_px = image.shape[1] / 160 if line_width_px is None else line_width_px
    if width_px > 0:
        draw_polyline(drawn, left, LEFT_COLOUR, width_px)
        draw_polyline(drawn, right, RIGHT_COLOUR, width_px)
    return drawn


def draw_windows(view: np.ndarray, windows_px: np.ndarray) -> np.ndarray:
    """Draw search windows (N, 4) (left, top, right, bottom edge, pixels) on an image or mask. Returns RGB."""
    drawn = to_rgb(view)
    for left, top, right, bottom in np.asarray(windows_px, float).reshape(-1, 4):
        outline = np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
        draw_polyline(drawn, outline, WINDOW_COLOUR, drawn.shape[1] / 320, closed=True)
    return drawn


def draw_pixels(view: np.ndarray, pixels_px: np.ndarray, *, colour: Colour) -> np.ndarray:
    """Colour the pixels (N, 2) (column, row) of an image or mask; pixels outside are ignored. Returns RGB."""
    drawn = to_rgb(view)
    columns, rows = np.asarray(pixels_px).reshape(-1, 2).astype(int).T
    inside = (columns >= 0) & (columns < drawn.shape[1]) & (rows >= 0) & (rows < drawn.shape[0])
    drawn[rows[inside], columns[inside]] = colour
    return drawn


def _distort_line(points_px: np.ndarray | None, camera: Camera | None) -> np.ndarray:
    """Points of the raw image for points of the undistorted one; empty for None."""
    if points_px is None:
        return np.empty((0, 2))
    points = finite_points(points_px)
    if camera is None or len(points) < 2:
        return points
    arc_length = np.concatenate([[0], np.hypot(*np.diff(points, axis=0).T).cumsum()])
    # The given points are kept, and evenly spaced ones are added, so that the polyline keeps its corners.
    positions = np.union1d(arc_length, np.arange(0, arc_length[-1], LENS_STEP_PX))
    return camera.distort_points(np.column_stack([np.interp(positions, arc_length, column) for column in points.T]))
