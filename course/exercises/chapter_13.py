"""Exercise of chapter 13, explain a result."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from course.exercises.drawings import draw_occlusion
from course.exercises.occlusion import FIRST_ROW, LARGEST_M, SHAPE, SQUARE_PX, explain_difference
from course.exercises.verdict import NOT_TRIED, Checks, Verdict, correct, hint
from lanes.camera import Camera
from lanes.draw import draw_lane
from lanes.stills import find_lane

OcclusionMap = Callable[[np.ndarray, Camera], Any]


def check_occlusion_map(occlusion_map: OcclusionMap, *, image: np.ndarray, camera: Camera) -> Verdict:
    """13.1: by how many metres the lane moves if a square of the image is covered, an array (5, 16)."""
    given = image.copy()
    answer = occlusion_map(given, camera)
    if answer is None:
        return NOT_TRIED
    if problem := _form_problem(answer):
        return hint(problem)
    if (lane := find_lane(image, camera)) is None:
        return hint("there is no lane in this image; take another one.")
    moved_m = np.asarray(answer, float)
    draw_occlusion(draw_lane(image, lane, camera, style="lines"), moved_m, FIRST_ROW)
    if not np.array_equal(given, image):
        return hint("you cover the image itself, so the squares add up. Begin with image.copy() for each square.")
    if problem := explain_difference(moved_m, image, lane, camera):
        return hint(problem)
    row, column = np.unravel_index(moved_m.argmax(), SHAPE)
    return correct(
        f"the lane moves most, by {moved_m.max():.2f} m, without the square [{row}, {column}], whose upper left corner "
        f"is at row {FIRST_ROW + SQUARE_PX * row}, column {SQUARE_PX * column}."
    )


def _form_problem(answer: Any) -> str | None:
    """The fault in the form of a map, or None."""
    if np.shape(answer) == SHAPE[::-1]:
        return f"the shape is {SHAPE[::-1]}. Rows come first: {SHAPE}."
    if np.shape(answer) != SHAPE:
        return f"return an array of shape {SHAPE}; yours has shape {np.shape(answer)}."
    moved_m = np.asarray(answer, float)
    if not np.isfinite(moved_m).all():
        return "the map has NaN or infinite values. Where no lane is found it holds 1."
    if moved_m.min() < 0:
        return "the map has negative values. Take the absolute difference."
    if moved_m.max() > LARGEST_M:
        return f"the map has a value of {moved_m.max():.2f} m. Limit it to 1 m."
    return None


CHECKS: Checks = {"13.1": check_occlusion_map}
