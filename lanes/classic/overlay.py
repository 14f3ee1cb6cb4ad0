"""What the driver sees: a classic recipe's result drawn on the picture that it was found in, with its numbers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lanes.camera import Camera
from lanes.classic.recipes import LaneFinder
from lanes.classic.result import LaneResult
from lanes.draw import LEFT, RIGHT, WINDOW, draw_fit, draw_lane, draw_mosaic, draw_pixels, draw_windows, write_text
from lanes.words import describe_bend, describe_offset


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
    return write_text(_draw_result(image, result, camera), describe_result(result))


def draw_search(result: LaneResult) -> np.ndarray:
    """The view's binary with what the search did: windows, the pixels of each line, the fitted lines. RGB."""
    steps = result.steps
    drawn = draw_pixels(steps.warped_binary, steps.left.pixels, colour=LEFT)
    drawn = draw_pixels(drawn, steps.right.pixels, colour=RIGHT)
    drawn = draw_windows(drawn, steps.windows_px, colour=WINDOW)
    left, right = (fit and fit.points(drawn.shape[0]) for fit in (result.left, result.right))
    return draw_fit(drawn, left, right)


def diagnose(image: np.ndarray, result: LaneResult, camera: Camera) -> np.ndarray:
    """The annotated picture under a strip of the steps that led to it: binary, view, search."""
    thumbnails = [result.steps.warped_binary, result.steps.view, draw_search(result)]
    drawn = _draw_result(image, result, camera)
    return draw_mosaic(drawn, thumbnails, ["binary", "view", "search"], lines=describe_result(result))


def follow_lane(finder: LaneFinder, camera: Camera) -> Callable[[np.ndarray], tuple[np.ndarray, dict[str, object]]]:
    """A function for `video.annotate_video`: takes the frames in order, gives each annotated and its telemetry."""

    def process(frame: np.ndarray) -> tuple[np.ndarray, dict[str, object]]:
        result = finder.follow(frame)
        return annotate(frame, result, camera), result.as_row()

    return process


def _draw_result(image: np.ndarray, result: LaneResult, camera: Camera) -> np.ndarray:
    """The lane alone; nothing of a lane that is lost."""
    if result.state == "lost":
        return image.copy()
    return draw_lane(image, result.left_px, result.right_px, camera)
