"""The inner corners of a chessboard in a picture: of the whole board, or of the part that the picture shows.

A board may hang over the picture's edge: the largest part of it that forms a full grid is as good as a whole board,
because each board only brings its own plane; where that plane's origin lies does not matter.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from lanes.io.frames import require_rgb

# A grid of fewer corners than this is found by chance in wall textures and keyboards.
SMALLEST_PART = (5, 4)
# Larger pictures are searched at this width, in pixels: the finders take time and lose their way in more of them.
SEARCHED_WIDTH = 1600
# Sizes of the grids that a part of a board grows from; which of them the finder sees depends on the picture.
SEEDS = ((3, 3), (4, 4), (5, 4), (5, 5), (6, 5))
# Share of the board's contrast that is left, in glare, between the darker white and the brighter black square of four.
SMALLEST_CONTRAST = 0.3
# How much a step from corner to corner may differ from the next one, as a share of the board's smallest step;
# perspective and lens together reach 0.23 on forty rendered and real boards.
LARGEST_CHANGE = 0.4


@dataclass(frozen=True, eq=False)
class Board:
    """The inner corners found in one picture.

    Parameters
    ----------
    corners_px : ndarray of shape (columns * rows, 2), float32
        Pixels (u, v), row by row.
    columns, rows : int
        Size of the grid found, which may be a part of the board.
    size : tuple of int
        (width, height) of the picture it was found in, pixels.
    """

    corners_px: np.ndarray
    columns: int
    rows: int
    size: tuple[int, int]

    @property
    def plane_points(self) -> np.ndarray:
        """The corners on the board itself, ndarray (N, 3) float32, z = 0; the unit is one square."""
        y, x = np.mgrid[: self.rows, : self.columns]
        return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]).astype(np.float32)


def find_board(image: np.ndarray, pattern: tuple[int, int] = (9, 6)) -> Board | None:
    """Find the inner corners of a chessboard, or of the largest part of it that is in the picture.

    The sector-based finder (Duda and Frese, BMVC 2018) sees boards in bad light, the classic one is the second choice,
    parts of the board the third. Corners of all three are refined by the gradients around them, which halves the
    largest error and with it that of the lens in the picture's corners (measured on the rendered boards).

    Parameters
    ----------
    image : ndarray of shape (height, width, 3), uint8
        RGB.
    pattern : tuple of int
        Inner corners (columns, rows) of the whole board.

    Returns
    -------
    Board or None
        None if there is no grid of at least 5 x 4 corners.

    Raises
    ------
    PictureError
        If `image` is no RGB picture.
    ValueError
        If `pattern` is smaller than 3 x 3.
    """
    require_rgb(image)
    if min(pattern) < 3:
        raise ValueError(f"a board of {pattern[0]}x{pattern[1]} inner corners is too small; give 3x3 or more.")
    gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    shrink = max(1.0, gray.shape[1] / SEARCHED_WIDTH)
    small = cv2.resize(gray, None, fx=1 / shrink, fy=1 / shrink, interpolation=cv2.INTER_AREA) if shrink > 1 else gray
    grid = _find_whole(small, pattern)
    if grid is None:
        grid = _find_part(small, pattern)
    if grid is None:
        return None
    # Pixel centres lie at integers, so the picture's edge is at -0.5: shift by half a pixel, scale, shift back.
    grid = _refine(gray, (grid + 0.5) * shrink - 0.5)
    rows, columns, _ = grid.shape
    return Board(grid.reshape(-1, 2).astype(np.float32), columns, rows, (image.shape[1], image.shape[0]))


def draw_board(image: np.ndarray, board: Board) -> np.ndarray:
    """A copy of `image` (height, width, 3) uint8 RGB with the corners joined row by row, each row in its own colour."""
    require_rgb(image)
    # A copy of our own, because frames that come from a video are read-only.
    canvas = image.copy()
    cv2.drawChessboardCorners(canvas, (board.columns, board.rows), board.corners_px, True)
    return canvas


def _find_whole(gray: np.ndarray, pattern: tuple[int, int]) -> np.ndarray | None:
    """All corners as a grid (rows, columns, 2), or None."""
    columns, rows = pattern
    # Without CALIB_CB_NORMALIZE_IMAGE, which moves corners of a big real board by pixels, and without
    # CALIB_CB_ACCURACY, which takes four times as long and is not needed before a refinement.
    found, corners = cv2.findChessboardCornersSB(gray, pattern, flags=0)
    if found:
        return corners.reshape(rows, columns, 2)
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
    found, corners = cv2.findChessboardCorners(gray, pattern, flags=flags)
    return corners.reshape(rows, columns, 2) if found else None


def _find_part(gray: np.ndarray, pattern: tuple[int, int]) -> np.ndarray | None:
    """The largest grid that grows out of a small one; a few tries bound the time where there is no board at all."""
    best = None
    for seed in SEEDS:
        found, corners, kind = cv2.findChessboardCornersSBWithMeta(gray, seed, flags=cv2.CALIB_CB_LARGER)
        if not found:
            continue
        core = _sound_core(gray, corners.reshape(*kind.shape, 2).astype(np.float32))
        if core is None:
            continue
        grid = _grow(gray, core, pattern)
        if _fits(grid, pattern, SMALLEST_PART) and (best is None or grid.size > best.size):
            best = grid
    return best


def _sound_core(gray: np.ndarray, grid: np.ndarray) -> np.ndarray | None:
    """The grid if it is a chessboard; else a 3 x 3 part built anew from its corners.

    Near the picture's edge, and on boards turned by 30 degrees and more, the finder joins true corners askew.
    """
    if _is_chessboard(gray, grid):
        return grid
    corners = grid.reshape(-1, 2)
    steps = np.mgrid[-1:2, -1:2].transpose(1, 2, 0)[..., ::-1]
    for middle in corners[np.argsort(np.linalg.norm(corners - corners.mean(axis=0), axis=1))]:
        away = corners - middle
        away = away[np.argsort(np.linalg.norm(away, axis=1))][1:]
        across = np.abs(away[0, 0] * away[:, 1] - away[0, 1] * away[:, 0]) > 0.5 * np.linalg.norm(
            away[0]
        ) * np.linalg.norm(away, axis=1)
        if not across.any():
            continue
        core = (middle + steps @ np.stack([away[0], away[across][0]])).astype(np.float32)
        if _shows(gray, core) and _is_chessboard(gray, core := _refine(gray, core)):
            return core
    return None


def _grow(gray: np.ndarray, grid: np.ndarray, pattern: tuple[int, int]) -> np.ndarray:
    """Add rows and columns to a grid (rows, columns, 2) on all four sides as long as the picture shows them."""
    while True:
        candidates = (_with_another_row(gray, np.rot90(grid, turns)) for turns in range(4))
        wider = [g for g in candidates if g is not None and _fits(g, pattern)]
        if not wider:
            return grid
        grid = max(wider, key=np.size)


def _with_another_row(gray: np.ndarray, grid: np.ndarray) -> np.ndarray | None:
    """The grid with one more row at its end, foreseen by the perspective of its last three; None if it is not there."""
    last = grid[-3:]
    y, x = np.mgrid[: len(last) + 1, : grid.shape[1]].astype(np.float32)
    squares = np.stack([x, y], axis=-1)
    perspective, _ = cv2.findHomography(squares[:-1].reshape(-1, 2), last.reshape(-1, 2))
    foreseen = cv2.perspectiveTransform(squares[-1].reshape(-1, 1, 2), perspective).reshape(-1, 2)
    if not _shows(gray, foreseen):
        return None
    wider = np.concatenate([grid, foreseen[None]]).astype(np.float32)
    wider[-1] = _refine(gray, wider)[-1]
    return wider if _is_chessboard(gray, wider) else None


def _shows(gray: np.ndarray, places: np.ndarray, margin_px: int = 3) -> bool:
    """Whether all places (..., 2) are in the picture, far enough inside to look around them."""
    height, width = gray.shape
    return bool(((places >= margin_px) & (places <= [width - 1 - margin_px, height - 1 - margin_px])).all())


def _is_chessboard(gray: np.ndarray, grid: np.ndarray) -> bool:
    """Whether a grid (rows, columns, 2) lies evenly and black and white squares alternate around all its corners."""
    if min(grid.shape[:2]) < 3:
        return False
    step_u, step_v = np.gradient(grid, axis=1), np.gradient(grid, axis=0)
    changes = [np.linalg.norm(np.diff(grid, 2, axis=axis), axis=2).max() for axis in (0, 1)]
    smallest = min(np.linalg.norm(step, axis=2).min() for step in (step_u, step_v))
    if max(changes) > LARGEST_CHANGE * smallest:
        return False
    return _alternates(gray, grid, step_u, step_v)


def _alternates(gray: np.ndarray, grid: np.ndarray, step_u: np.ndarray, step_v: np.ndarray) -> bool:
    """Whether both white squares around each corner are brighter than both black ones."""
    diagonals = (step_u + step_v, -step_u - step_v, step_u - step_v, step_v - step_u)
    around = np.stack([_brightness(gray, grid + 0.25 * diagonal) for diagonal in diagonals])
    odd = np.indices(grid.shape[:2]).sum(axis=0) % 2 == 1
    one, other = np.where(odd, around[2:], around[:2]), np.where(odd, around[:2], around[2:])
    bright, dark = (one, other) if one.mean() > other.mean() else (other, one)
    return bool((bright.min(axis=0) - dark.max(axis=0) > SMALLEST_CONTRAST * (bright.mean() - dark.mean())).all())


def _brightness(gray: np.ndarray, places: np.ndarray) -> np.ndarray:
    places = places.astype(np.float32)
    return cv2.remap(gray, places[..., 0], places[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(
        float
    )


def _refine(gray: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Move corners (rows, columns, 2) to where all gradients around point past them (Foerstner and Guelch, 1987).

    The window reaches over two thirds of the smallest square: more brings in its neighbours, less brings in noise.
    """
    steps = [np.linalg.norm(np.diff(grid, axis=axis), axis=2).min() for axis in (0, 1)]
    half = int(np.clip(min(steps) / 3, 2, 11))
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 60, 1e-4)
    corners = np.ascontiguousarray(grid.reshape(-1, 1, 2), np.float32)
    return cv2.cornerSubPix(gray, corners, (half, half), (-1, -1), stop).reshape(grid.shape)


def _fits(grid: np.ndarray, pattern: tuple[int, int], smallest: tuple[int, int] = (3, 3)) -> bool:
    """Whether a grid can be a part of the board, either way round, and is not smaller than `smallest`."""
    (long, short), (whole_long, whole_short) = sorted(grid.shape[:2], reverse=True), sorted(pattern, reverse=True)
    return long >= max(smallest) and short >= min(smallest) and long <= whole_long and short <= whole_short
