"""Detect the inner corners of a chessboard in an image, also if only a part of the
board is visible.

The largest visible grid is used like a complete board: calibration needs points of a
plane, and the origin in that plane is arbitrary.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from lanes.camera.model import resize_points
from lanes.errors import CameraError
from lanes.video.images import require_rgb

# Largest relative error of the cross ratio of four corners, the median over a row.
# Measured: 0.013 on 40 rendered and real boards, mostly 0.012 with fisheye lenses of
# 140 to 200 degrees, and 0.08 or more if a row is skipped.
_MAX_UNEVENNESS = 0.07
# The complete board's inner corners (columns, rows).
Pattern = tuple[int, int]


@dataclass(frozen=True, eq=False)
class Board:
    """Inner corners of a chessboard, or of a part of it, detected in an image of `size`
    (width, height).

    `corners_px` (columns * rows, 2), float32, are pixels (u, v), row by row. A
    `doubtful` board is a complete one whose corners are not evenly spaced or not all
    between squares: of a fisheye lens, or a wrong detection.
    """

    corners_px: np.ndarray
    columns: int
    rows: int
    size: tuple[int, int]
    doubtful: bool = False

    @property
    def object_points(self) -> np.ndarray:
        """Corners in the coordinates of the board, ndarray (N, 3) float32, z = 0; the
        unit is one square.
        """
        y, x = np.mgrid[: self.rows, : self.columns]
        points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
        return points.astype(np.float32)


def find_board(
    image: np.ndarray, pattern: Pattern = (9, 6), *, doubtful: bool = False
) -> Board | None:
    """Inner corners of a chessboard, or of its largest visible part; None without a
    grid of at least 5 x 4 corners.

    The sector-based detector (Duda and Frese, BMVC 2018) is the first choice. The
    classic one is the second: it finds boards in the dark and in glare. A part of the
    board is the third. All corners are then refined to sub-pixel accuracy
    (`cv2.cornerSubPix`), which halves the largest error on the rendered boards.

    `image` is RGB (height, width, 3), uint8; `pattern` has the complete board's inner
    corners (columns, rows). With `doubtful`, a complete board that fails the tests is
    the last choice. Raises PictureError if the image is not RGB, and CameraError if
    `pattern` is smaller than 3 x 3.
    """
    image = require_rgb(image)
    if min(pattern) < 3:
        columns, rows = pattern
        raise CameraError(
            f"a board of {columns}x{rows} inner corners is too small; give 3x3 or more."
        )
    gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    # the detectors are slow and less reliable on images longer than 1600 pixels
    scale = max(1.0, max(gray.shape) / 1600)
    if min(gray.shape) < 24 * scale:  # no board is recognised
        return None
    small = gray
    if scale > 1:
        factor = 1 / scale
        small = cv2.resize(
            gray, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA
        )
    grid, is_sure = _find_grid(small, pattern)
    if grid is None or not (is_sure or doubtful):
        return None

    grid = _refine_corners(gray, resize_points(grid, scale))
    rows, columns, _ = grid.shape
    height, width = gray.shape
    corners_px = grid.reshape(-1, 2).astype(np.float32)
    return Board(corners_px, columns, rows, (width, height), doubtful=not is_sure)


def draw_board(image: np.ndarray, board: Board) -> np.ndarray:
    """A copy of an RGB image (height, width, 3), uint8, with the corners joined row by
    row, each row in its colour.
    """
    drawn = require_rgb(image).copy()
    pattern = (board.columns, board.rows)
    return cv2.drawChessboardCorners(drawn, pattern, board.corners_px, True)


def _find_grid(gray: np.ndarray, pattern: Pattern) -> tuple[np.ndarray | None, bool]:
    """Corners (rows, columns, 2) of the board or of a part, or None; and whether they
    are those of a chessboard.
    """
    # the sector-based detector draws random numbers
    cv2.setRNGSeed(0)
    unsure = None
    for grid in _full_boards(gray, pattern):
        # some corners may lie in glare or at the border of the image; a grid along the
        # diagonals has half of them
        if _is_chessboard(gray, grid, share=0.8):
            return grid, True
        if unsure is None:
            unsure = grid
    part = _find_partial_board(gray, pattern)
    if part is not None:
        return part, True
    return unsure, False


def _full_boards(gray: np.ndarray, pattern: Pattern) -> Iterator[np.ndarray]:
    """All corners of the board, (rows, columns, 2), of each detector that finds it."""
    columns, rows = pattern
    # CALIB_CB_NORMALIZE_IMAGE is not set: it moved the corners of a large real board by
    # pixels. CALIB_CB_ACCURACY is not set: it takes four times as long, and the corners
    # are refined later.
    found, corners = cv2.findChessboardCornersSB(gray, pattern)
    if found:
        yield corners.reshape(rows, columns, 2)

    # on a texture of single pixels the classic detector takes a minute
    smooth = cv2.GaussianBlur(gray, (0, 0), 1.5)
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH
    flags |= cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
    found, corners = cv2.findChessboardCorners(smooth, pattern, flags=flags)
    if found:
        yield corners.reshape(rows, columns, 2)


def _find_partial_board(gray: np.ndarray, pattern: Pattern) -> np.ndarray | None:
    """Largest grid (rows, columns, 2) grown from a small one, or None."""
    best = None
    for seed in (
        (3, 3),
        (5, 5),
    ):  # which of them the detector finds depends on the image
        found, corners, kind = cv2.findChessboardCornersSBWithMeta(
            gray, seed, flags=cv2.CALIB_CB_LARGER
        )
        if not found:
            continue
        detected = corners.reshape(*kind.shape, 2).astype(np.float32)
        start = _valid_start_grid(gray, detected)
        if start is None:
            continue
        grid = _grow_grid(gray, start, pattern)
        # smaller grids occur by chance in wall textures and keyboards
        is_large = _fits_pattern(grid, pattern, smallest=(5, 4))
        if is_large and (best is None or grid.size > best.size):
            best = grid
    return best


def _valid_start_grid(gray: np.ndarray, grid: np.ndarray) -> np.ndarray | None:
    """The grid if it is a valid chessboard, otherwise a valid 3 x 3 grid rebuilt from
    its corners, or None.

    Near the border of the image, and on boards rotated by 30 degrees or more, the
    detector finds true corners but assigns them to wrong rows and columns.
    """
    if _is_chessboard(gray, grid):
        return grid
    corners = grid.reshape(-1, 2)
    for middle in _nearest_first(corners, corners.mean(axis=0)):
        start = _grid_around(middle, corners)
        if start is None or not _inside_image(gray, start):
            continue
        start = _refine_corners(gray, start)
        if _is_chessboard(gray, start):
            return start
    return None


def _nearest_first(points: np.ndarray, point: np.ndarray) -> np.ndarray:
    """The points (N, 2) in the order of their distance to a point."""
    distance = np.linalg.norm(points - point, axis=1)
    return points[np.argsort(distance)]


def _grid_around(middle: np.ndarray, corners: np.ndarray) -> np.ndarray | None:
    """A 3 x 3 grid around a corner, from its offsets to two of the others (N, 2)."""
    offsets = _nearest_first(corners, middle)[1:] - middle
    first = offsets[0]
    # the shortest offset, and the next one at more than 30 degrees to it
    u, v = offsets.T
    cross_product = np.abs(first[0] * v - first[1] * u)
    lengths = np.linalg.norm(offsets, axis=1)
    across = cross_product > 0.5 * np.linalg.norm(first) * lengths
    if not across.any():
        return None
    second = offsets[across][0]
    row, column = np.mgrid[-1:2, -1:2]
    steps = np.stack([column, row], axis=-1)
    grid = middle + steps @ np.stack([first, second])
    return grid.astype(np.float32)


def _grow_grid(gray: np.ndarray, grid: np.ndarray, pattern: Pattern) -> np.ndarray:
    """The grid (rows, columns, 2) extended on all four sides by the rows and columns
    that are visible.
    """
    while True:
        extended = []
        for quarter_turns in range(4):
            longer = _extend_by_row(gray, np.rot90(grid, quarter_turns))
            if longer is not None and _fits_pattern(longer, pattern):
                extended.append(longer)
        if not extended:
            return grid
        grid = max(extended, key=np.size)


def _extend_by_row(gray: np.ndarray, grid: np.ndarray) -> np.ndarray | None:
    """The grid with one more row, predicted by the homography of its last three rows;
    None if it is not visible.
    """
    last = grid[-3:]
    y, x = np.mgrid[: len(last) + 1, : grid.shape[1]]
    squares = np.stack([x, y], axis=-1).astype(np.float32)
    known = np.concatenate(squares[:-1])
    homography, _ = cv2.findHomography(known, np.concatenate(last))
    next_row = squares[-1][:, None]
    predicted = cv2.perspectiveTransform(next_row, homography)[:, 0]
    if not _inside_image(gray, predicted):
        return None

    extended = np.concatenate([grid, predicted[None]]).astype(np.float32)
    extended[-1] = _refine_corners(gray, extended)[-1]
    return extended if _is_chessboard(gray, extended) else None


def _is_even(grid: np.ndarray) -> bool:
    """Whether no row or column of a grid (rows, columns, 2) is skipped, by the cross
    ratio of four corners in a line.

    A detector that looks for fewer rows than the board has can skip some. The cross
    ratio of four evenly spaced points is 4/3 in every perspective. The steps between
    corners change with it, and with the distortion of the lens.
    """
    for lines in (grid, grid.transpose(1, 0, 2)):
        a = lines[:-3]
        b = lines[1:-2]
        c = lines[2:-1]
        d = lines[3:]
        ac_bd = _distance(a, c) * _distance(b, d)
        bc_ad = _distance(b, c) * _distance(a, d)
        cross_ratio = ac_bd / np.maximum(bc_ad, 1e-6)
        unevenness = np.abs(0.75 * np.median(cross_ratio, axis=1) - 1)
        if (unevenness > _MAX_UNEVENNESS).any():
            return False
    return True


def _distance(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.linalg.norm(a - b, axis=2)


def _inside_image(gray: np.ndarray, points: np.ndarray) -> bool:
    """Whether all points (..., 2) are inside the image, with a margin of three pixels
    for the refinement.
    """
    height, width = gray.shape
    inside = (points >= 3) & (points <= [width - 4, height - 4])
    return bool(inside.all())


def _is_chessboard(gray: np.ndarray, grid: np.ndarray, share: float = 1.0) -> bool:
    """Whether a grid (rows, columns, 2) is even, with black and white squares in turn
    at that share of its corners.
    """
    if min(grid.shape[:2]) < 3 or not _is_even(grid):
        return False
    bright, dark = _facing_squares(gray, grid)
    if bright.mean() <= dark.mean():
        bright, dark = dark, bright
    # both white squares around each corner are brighter than both black ones, in glare
    # not by all of the mean contrast
    darkest_white = bright.min(axis=0).astype(float)
    brightest_black = dark.max(axis=0)
    mean_contrast = bright.mean() - dark.mean()
    is_corner = darkest_white - brightest_black > 0.3 * mean_contrast
    return bool(is_corner.mean() >= share)


def _facing_squares(
    gray: np.ndarray, grid: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Gray values (2, rows, columns) of the squares around each corner of a chessboard:
    both of one colour, and both of the other.
    """
    step_u = np.gradient(grid, axis=1)
    step_v = np.gradient(grid, axis=0)
    falling = step_u + step_v
    rising = step_u - step_v
    diagonals = np.stack([falling, -falling, rising, -rising])
    squares = []
    for at in (grid + 0.25 * diagonals).astype(np.float32):
        square = cv2.remap(
            gray,
            at[..., 0],
            at[..., 1],
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )
        squares.append(square)

    # the colours change places from corner to corner
    on_falling = np.stack(squares[:2])
    on_rising = np.stack(squares[2:])
    row, column = np.indices(grid.shape[:2])
    is_odd = (row + column) % 2 == 1
    return (
        np.where(is_odd, on_rising, on_falling),
        np.where(is_odd, on_falling, on_rising),
    )


def _refine_corners(gray: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Corners (rows, columns, 2) refined to sub-pixel accuracy (Foerstner and Guelch,
    1987).

    The window covers two thirds of the smallest square: a larger one includes other
    corners, a smaller one is noisier.
    """
    down = _distance(grid[1:], grid[:-1])
    right = _distance(grid[:, 1:], grid[:, :-1])
    square_px = min(down.min(), right.min())
    half = int(np.clip(square_px / 3, 2, 11))
    corners = cv2.cornerSubPix(
        gray,
        np.ascontiguousarray(grid.reshape(-1, 1, 2), np.float32),
        winSize=(half, half),
        zeroZone=(-1, -1),
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 60, 1e-4),
    )
    return corners.reshape(grid.shape)


def _fits_pattern(
    grid: np.ndarray, pattern: Pattern, smallest: Pattern = (3, 3)
) -> bool:
    """Whether a grid can be a part of the board in either orientation, and is not
    smaller than `smallest`.
    """
    short, long = sorted(grid.shape[:2])
    least_short, least_long = sorted(smallest)
    most_short, most_long = sorted(pattern)
    return least_short <= short <= most_short and least_long <= long <= most_long
