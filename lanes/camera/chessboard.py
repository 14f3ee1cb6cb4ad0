"""Detect the inner corners of a chessboard in an image, also if only a part of the board is visible.

The largest visible grid is used like a complete board: calibration needs points of a plane, and the origin in that
plane is arbitrary.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from lanes.camera.model import resize_points
from lanes.errors import CameraError
from lanes.video.images import require_rgb

# Largest relative error of the cross ratio of four corners, the median over a row. Measured: 0.013 on 40 rendered and
# real boards, mostly 0.012 with fisheye lenses of 140 to 200 degrees, and 0.08 or more if a row is skipped.
_MAX_UNEVENNESS = 0.07


@dataclass(frozen=True, eq=False)
class Board:
    """Inner corners of a chessboard, or of a part of it, detected in an image of `size` (width, height).

    `corners_px` (columns * rows, 2), float32, are pixels (u, v), row by row. A `doubtful` board is a complete one
    whose corners are not evenly spaced or not all between squares: of a fisheye lens, or a wrong detection.
    """

    corners_px: np.ndarray
    columns: int
    rows: int
    size: tuple[int, int]
    doubtful: bool = False

    @property
    def object_points(self) -> np.ndarray:
        """Corners in the coordinates of the board, ndarray (N, 3) float32, z = 0; the unit is one square."""
        y, x = np.mgrid[: self.rows, : self.columns]
        return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]).astype(np.float32)


def find_board(image: np.ndarray, pattern: tuple[int, int] = (9, 6), *, doubtful: bool = False) -> Board | None:
    """Inner corners of a chessboard, or of its largest visible part; None without a grid of at least 5 x 4 corners.

    The sector-based detector (Duda and Frese, BMVC 2018) is the first choice. The classic one is the second: it finds
    boards in the dark and in glare. A part of the board is the third. All corners are then refined to sub-pixel
    accuracy (`cv2.cornerSubPix`), which halves the largest error on the rendered boards.

    `image` is RGB (height, width, 3), uint8; `pattern` has the complete board's inner corners (columns, rows). With
    `doubtful`, a complete board that fails the tests is the last choice. Raises PictureError if the image is not RGB,
    and CameraError if `pattern` is smaller than 3 x 3.
    """
    image = require_rgb(image)
    if min(pattern) < 3:
        raise CameraError(f"a board of {pattern[0]}x{pattern[1]} inner corners is too small; give 3x3 or more.")
    gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    # the detectors are slow and less reliable on images longer than 1600 pixels
    scale = max(1.0, max(gray.shape) / 1600)
    if min(gray.shape) < 24 * scale:  # no board is recognised
        return None
    small = cv2.resize(gray, None, fx=1 / scale, fy=1 / scale, interpolation=cv2.INTER_AREA) if scale > 1 else gray
    # the sector-based detector draws random numbers
    cv2.setRNGSeed(0)
    grid, is_sure = _find_full_board(small, pattern)
    if not is_sure and (part := _find_partial_board(small, pattern)) is not None:
        grid, is_sure = part, True
    if grid is None or not (is_sure or doubtful):
        return None
    grid = _refine_corners(gray, resize_points(grid, scale))
    rows, columns, _ = grid.shape
    return Board(grid.reshape(-1, 2).astype(np.float32), columns, rows, (image.shape[1], image.shape[0]), not is_sure)


def draw_board(image: np.ndarray, board: Board) -> np.ndarray:
    """A copy of an RGB image (height, width, 3), uint8, with the corners joined row by row, each row in its colour."""
    return cv2.drawChessboardCorners(require_rgb(image).copy(), (board.columns, board.rows), board.corners_px, True)


def _find_full_board(gray: np.ndarray, pattern: tuple[int, int]) -> tuple[np.ndarray | None, bool]:
    """All corners of the board, (rows, columns, 2), or None; and whether they are those of a chessboard."""
    columns, rows = pattern
    # CALIB_CB_NORMALIZE_IMAGE is not set: it moved the corners of a large real board by pixels. CALIB_CB_ACCURACY is
    # not set: it takes four times as long, and the corners are refined later.
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
    # on a texture of single pixels the classic detector takes a minute
    smooth = cv2.GaussianBlur(gray, (0, 0), 1.5)
    unsure = None
    for find, seen, options in ((cv2.findChessboardCornersSB, gray, 0), (cv2.findChessboardCorners, smooth, flags)):
        found, corners = find(seen, pattern, flags=options)
        if found:
            grid = corners.reshape(rows, columns, 2)
            # some corners may lie in glare or at the border of the image; a grid along the diagonals has half of them
            if _is_chessboard(gray, grid, share=0.8):
                return grid, True
            unsure = grid if unsure is None else unsure
    return unsure, False


def _find_partial_board(gray: np.ndarray, pattern: tuple[int, int]) -> np.ndarray | None:
    """Largest grid (rows, columns, 2) grown from a small one, or None."""
    best = None
    for seed in ((3, 3), (5, 5)):  # which of them the detector finds depends on the image
        found, corners, kind = cv2.findChessboardCornersSBWithMeta(gray, seed, flags=cv2.CALIB_CB_LARGER)
        start = _valid_start_grid(gray, corners.reshape(*kind.shape, 2).astype(np.float32)) if found else None
        if start is None:
            continue
        grid = _grow_grid(gray, start, pattern)
        # smaller grids occur by chance in wall textures and keyboards
        if _fits_pattern(grid, pattern, (5, 4)) and (best is None or grid.size > best.size):
            best = grid
    return best


def _valid_start_grid(gray: np.ndarray, grid: np.ndarray) -> np.ndarray | None:
    """The grid if it is a valid chessboard, otherwise a valid 3 x 3 grid rebuilt from its corners, or None.

    Near the border of the image, and on boards rotated by 30 degrees or more, the detector finds true corners but
    assigns them to wrong rows and columns.
    """
    if _is_chessboard(gray, grid):
        return grid
    corners = grid.reshape(-1, 2)
    steps = np.mgrid[-1:2, -1:2].transpose(1, 2, 0)[..., ::-1]
    for middle in corners[np.argsort(np.linalg.norm(corners - corners.mean(axis=0), axis=1))]:
        offsets = corners - middle
        offsets = offsets[np.argsort(np.linalg.norm(offsets, axis=1))][1:]
        first = offsets[0]
        # the shortest offset, and the next one at more than 30 degrees to it
        cross_product = np.abs(first[0] * offsets[:, 1] - first[1] * offsets[:, 0])
        across = cross_product > 0.5 * np.linalg.norm(first) * np.linalg.norm(offsets, axis=1)
        if not across.any():
            continue
        start = (middle + steps @ np.stack([first, offsets[across][0]])).astype(np.float32)
        if _inside_image(gray, start) and _is_chessboard(gray, start := _refine_corners(gray, start)):
            return start
    return None


def _grow_grid(gray: np.ndarray, grid: np.ndarray, pattern: tuple[int, int]) -> np.ndarray:
    """The grid (rows, columns, 2) extended on all four sides by the rows and columns that are visible."""
    while True:
        candidates = (_extend_by_row(gray, np.rot90(grid, quarter_turns)) for quarter_turns in range(4))
        extended = [g for g in candidates if g is not None and _fits_pattern(g, pattern)]
        if not extended:
            return grid
        grid = max(extended, key=np.size)


def _extend_by_row(gray: np.ndarray, grid: np.ndarray) -> np.ndarray | None:
    """The grid with one more row, predicted by the homography of its last three rows; None if it is not visible."""
    last = grid[-3:]
    y, x = np.mgrid[: len(last) + 1, : grid.shape[1]].astype(np.float32)
    squares = np.stack([x, y], axis=-1)
    homography, _ = cv2.findHomography(squares[:-1].reshape(-1, 2), last.reshape(-1, 2))
    predicted = cv2.perspectiveTransform(squares[-1].reshape(-1, 1, 2), homography).reshape(-1, 2)
    if not _inside_image(gray, predicted):
        return None
    extended = np.concatenate([grid, predicted[None]]).astype(np.float32)
    extended[-1] = _refine_corners(gray, extended)[-1]
    return extended if _is_chessboard(gray, extended) else None


def _is_even(grid: np.ndarray) -> bool:
    """Whether no row or column of a grid (rows, columns, 2) is skipped, by the cross ratio of four corners in a line.

    A detector that looks for fewer rows than the board has can skip some. The cross ratio of four evenly spaced points
    is 4/3 in every perspective. The steps between corners change with it, and with the distortion of the lens.
    """
    for lines in (grid, grid.transpose(1, 0, 2)):
        a, b, c, d = (lines[k : len(lines) - 3 + k] for k in range(4))
        ac, bd, bc, ad = (np.linalg.norm(p - q, axis=2) for p, q in ((a, c), (b, d), (b, c), (a, d)))
        ratios = np.median(ac * bd / np.maximum(bc * ad, 1e-6), axis=1)
        if (np.abs(0.75 * ratios - 1) > _MAX_UNEVENNESS).any():
            return False
    return True


def _inside_image(gray: np.ndarray, points: np.ndarray) -> bool:
    """Whether all points (..., 2) are inside the image, with a margin of three pixels for the refinement."""
    height, width = gray.shape
    return bool(((points >= 3) & (points <= [width - 4, height - 4])).all())


def _is_chessboard(gray: np.ndarray, grid: np.ndarray, share: float = 1.0) -> bool:
    """Whether a grid (rows, columns, 2) is even, with black and white squares in turn at that share of its corners."""
    if min(grid.shape[:2]) < 3 or not _is_even(grid):
        return False
    step_u, step_v = np.gradient(grid, axis=1), np.gradient(grid, axis=0)
    diagonals = (step_u + step_v, -step_u - step_v, step_u - step_v, step_v - step_u)
    around = (grid + 0.25 * np.stack(diagonals)).astype(np.float32)
    squares = np.stack(
        [cv2.remap(gray, p[..., 0], p[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) for p in around]
    )
    odd = np.indices(grid.shape[:2]).sum(axis=0) % 2 == 1
    one, other = np.where(odd, squares[2:], squares[:2]), np.where(odd, squares[:2], squares[2:])
    bright, dark = (one, other) if one.mean() > other.mean() else (other, one)
    # both white squares around each corner are brighter than both black ones, in glare not by all of the mean contrast
    contrast = bright.min(axis=0).astype(float) - dark.max(axis=0)
    return bool((contrast > 0.3 * (bright.mean() - dark.mean())).mean() >= share)


def _refine_corners(gray: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Corners (rows, columns, 2) refined to sub-pixel accuracy (Foerstner and Guelch, 1987).

    The window covers two thirds of the smallest square: a larger one includes other corners, a smaller one is noisier.
    """
    steps = [np.linalg.norm(np.diff(grid, axis=axis), axis=2).min() for axis in (0, 1)]
    half = int(np.clip(min(steps) / 3, 2, 11))
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 60, 1e-4)
    corners = np.ascontiguousarray(grid.reshape(-1, 1, 2), np.float32)
    return cv2.cornerSubPix(gray, corners, (half, half), (-1, -1), criteria).reshape(grid.shape)


def _fits_pattern(grid: np.ndarray, pattern: tuple[int, int], smallest: tuple[int, int] = (3, 3)) -> bool:
    """Whether a grid can be a part of the board in either orientation, and is not smaller than `smallest`."""
    (long, short), (whole_long, whole_short) = sorted(grid.shape[:2], reverse=True), sorted(pattern, reverse=True)
    return max(smallest) <= long <= whole_long and min(smallest) <= short <= whole_short
