"""Occlusion maps of exercise 13.1: the lane of an image of which a square is covered.

M. D. Zeiler and R. Fergus, "Visualizing and understanding convolutional networks", European Conference on Computer
Vision, 2014.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from course.exercises.hints import require, require_equal
from lanes.camera import Camera
from lanes.detect.lane import Lane
from lanes.detect.search import find_lane

# Rows and columns of squares, their size in pixels, the first row of the image, and their gray level.
SHAPE, SQUARE_PX, FIRST_ROW, GRAY = (5, 16), 80, 320, 128
# Distances at which lanes are compared: that of the exercise, and one that a reader may take instead, metres.
AHEAD_M = np.array([20.0, 10.0])
LARGEST_M, CLOSE_M = 1.0, 0.002
# A map is compared at the squares on the lines at these distances (metres), at two above the road, and where its own
# values are largest. Wrong covers are only tried where it is wrong.
ON_LINES_M = np.array([6.5, 8.0, 11.0, 15.0, 22.0])
ABOVE_ROAD, LARGEST_COUNT, COMPARED_COUNT = ([0, 0], [0, 15]), 5, 5

Cover = Callable[[np.ndarray, int, int], np.ndarray]


def choose_squares(moved_m: np.ndarray, lane: Lane, camera: Camera) -> np.ndarray:
    """The squares (N, 2), as (row, column), at which a map is compared with the right one."""
    lines_m = [np.column_stack([ON_LINES_M, y_m]) for y_m in lane.lateral_m(ON_LINES_M)]
    columns_px, rows_px = camera.road_to_pixels(np.vstack(lines_m)).T
    on_lines = np.column_stack([rows_px - FIRST_ROW, columns_px]) // SQUARE_PX
    inside = ((on_lines >= 0) & (on_lines < SHAPE)).all(axis=1)
    largest = np.unravel_index(np.argsort(moved_m.ravel())[-LARGEST_COUNT:], SHAPE)
    return np.unique(np.vstack([ABOVE_ROAD, on_lines[inside], np.column_stack(largest)]).astype(int), axis=0)


def cover_square(image: np.ndarray, row: int, column: int, *, level: int = GRAY) -> np.ndarray:
    """A copy of an image with one square covered."""
    covered = image.copy()
    top, left = FIRST_ROW + SQUARE_PX * row, SQUARE_PX * column
    covered[top : top + SQUARE_PX, left : left + SQUARE_PX] = level
    return covered


def require_occlusion(moved_m: np.ndarray, image: np.ndarray, lane: Lane, camera: Camera) -> None:
    """Raise a `HintError` if a map is wrong at some of its squares; the uncovered image has this lane."""
    squares = choose_squares(moved_m, lane, camera)
    mine, signed = moved_m[tuple(squares.T)], _moves(image, lane, camera, squares, cover_square)
    size = np.minimum(np.abs(signed), LARGEST_M)
    expected = size[:, :, 0].max(axis=1)
    if np.allclose(mine, expected, rtol=0, atol=CLOSE_M):
        return
    require(
        moved_m.any(), "every value is 0. Cover parts of the road, and compare with the lane of the uncovered image."
    )
    mistakes = {
        "this is the left line alone. Take the larger of both.": size[:, 0, 0],
        "this is the right line alone. Take the larger of both.": size[:, 1, 0],
        "moves to one side are missing. Take the absolute difference.": np.clip(
            signed[:, :, 0].max(axis=1), 0, LARGEST_M
        ),
        "this is 10 m ahead. Compare the lines 20 m ahead.": size[:, :, 1].max(axis=1),
    }
    wrong = np.argsort(-np.abs(expected - mine))[:COMPARED_COUNT]
    for sentence, cover in WRONG_COVERS.items():
        mistakes[sentence] = mine.copy()
        moved = np.abs(_moves(image, lane, camera, squares[wrong], cover)[:, :, 0])
        mistakes[sentence][wrong] = np.minimum(moved.max(axis=1), LARGEST_M)
    place, got_m, right_m = squares[wrong[0]].tolist(), mine[wrong[0]], expected[wrong[0]]
    otherwise = f"at {place} it has {got_m:.3f} m instead of {right_m:.3f} m. Is a square of 80 x 80 pixels gray, 128?"
    require_equal(mine, expected, mistakes, otherwise, atol=CLOSE_M)


def _moves(image: np.ndarray, lane: Lane, camera: Camera, squares: np.ndarray, cover: Cover) -> np.ndarray:
    """By how much both lines move to the left (squares, 2, distances), metres; `LARGEST_M` if no lane is found."""
    before_m, moves = lane.lateral_m(AHEAD_M), []
    for row, column in squares.tolist():
        found = find_lane(cover(image, row, column), camera)
        moves.append(np.full_like(before_m, LARGEST_M) if found is None else found.lateral_m(AHEAD_M) - before_m)
    return np.array(moves)


def _cover_so_far(image: np.ndarray, row: int, column: int) -> np.ndarray:
    """A copy with this square and all before it covered."""
    covered = image.copy()
    top, left = FIRST_ROW + SQUARE_PX * row, SQUARE_PX * (column + 1)
    covered[FIRST_ROW:top] = GRAY
    covered[top : top + SQUARE_PX, :left] = GRAY
    return covered


WRONG_COVERS: dict[str, Cover] = {
    "the squares add up: begin with a new image.copy() for each square.": _cover_so_far,
    "you cover with black. Use gray, (128, 128, 128).": partial(cover_square, level=0),
}
