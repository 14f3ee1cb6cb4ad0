"""Whether boards were taken with two focal lengths: a phone zoomed, or changed its
lens, between them.

One lens explains such boards nearly as well as good ones, because the distance of a
board makes up for its focal length, so that the error alone does not show it. Here the
boards are split into those with a shorter and a longer focal length. Centre and
distortion are common: a zoom enlarges the image about the centre.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np

from lanes.camera.chessboard import Board
from lanes.camera.model import Camera
from lanes.video.images import opencv_threads

# Two focal lengths differ if they reduce the error to this share of that of one lens,
# by this ratio, and by so many standard deviations. Of 103 random sets of 4 to
# 18 of Udacity's boards, paper on a wall, none leaves less than 0.93 of the error.
_LARGEST_ERROR_SHARE = 0.9
_LEAST_RATIO = 1.05
_LEAST_DEVIATIONS = 12
# Their distance in standard deviations within a group.
_LEAST_SEPARATION = 3.5
# Error of the corner detection, which no second focal length reduces.
_CORNER_ERROR_PX = 0.1
# A single board with another focal length is an outlier, or does no harm.
_MIN_BOARDS = 2
_ROUNDS = 10
# The ratio is found if it changes by less.
_SAME_RATIO = 0.003


@dataclass(frozen=True)
class FocalGroup:
    """Boards of one focal length: their errors (RMS, pixels) by name."""

    focal_px: float
    board_rms_px: dict[str, float]


class _Lens(NamedTuple):
    """Camera matrix (3, 3) and distortion (5,)."""

    matrix: np.ndarray
    distortion: np.ndarray


class _Focal(NamedTuple):
    """A focal length, its standard deviation (share), the error of each board (RMS,
    pixels), and the sum of squared errors.
    """

    focal_px: float
    std_share: float
    errors_px: list[float]
    square_px: float


class _Split(NamedTuple):
    """Which boards (N,) have the shorter focal length, and both; the other intrinsics
    are those of a lens.
    """

    lens: _Lens
    is_short: np.ndarray
    short: _Focal
    long: _Focal

    @property
    def square_px(self) -> float:
        return self.short.square_px + self.long.square_px


def find_focal_groups(
    boards: Mapping[str, Board], camera: Camera
) -> tuple[FocalGroup, FocalGroup] | None:
    """The boards with the shorter and with the longer focal length; None if one lens
    explains all.

    `camera` is the normal lens that was fitted to the boards.
    """
    if len(boards) < 2 * _MIN_BOARDS:
        return None
    lens = _Lens(camera.matrix, camera.distortion)
    found = list(boards.values())
    with opencv_threads(1):
        square_px = sum(_error_square_px(board, lens) for board in found)
        corners = sum(len(board.corners_px) for board in found)
        if square_px <= corners * _CORNER_ERROR_PX**2:
            return None
        split = _best_split(found, lens)
        if split is None or not _is_clear(split, square_px):
            return None
        if _separation(found, split) < _LEAST_SEPARATION:
            return None

    names = np.array(list(boards))
    return (
        _group(split.short, names[split.is_short]),
        _group(split.long, names[~split.is_short]),
    )


def _group(focal: _Focal, names: np.ndarray) -> FocalGroup:
    board_rms_px = dict(zip(names.tolist(), focal.errors_px, strict=True))
    return FocalGroup(focal.focal_px, board_rms_px)


def _is_clear(split: _Split, square_px: float) -> bool:
    """Whether two focal lengths explain clearly more than the one that leaves
    `square_px`.
    """
    log_ratio = np.log(split.long.focal_px / split.short.focal_px)
    std = np.hypot(split.short.std_share, split.long.std_share)
    error_share = np.sqrt(split.square_px / square_px)
    return bool(
        error_share <= _LARGEST_ERROR_SHARE
        and log_ratio >= np.log(_LEAST_RATIO)
        and log_ratio >= _LEAST_DEVIATIONS * std
    )


def _separation(boards: Sequence[Board], split: _Split) -> float:
    """Distance of the two focal lengths, in standard deviations of the focal lengths
    that the boards of a group have alone.

    Those of boards that bend differ as well, but not in two groups.
    """
    alone = [_fit_focal([board], split.lens) for board in boards]
    focal_px = np.array([focal.focal_px for focal in alone])
    weights = np.array([focal.std_share for focal in alone]) ** -2.0
    of_group_px = np.where(split.is_short, split.short.focal_px, split.long.focal_px)
    square = np.average(np.log(focal_px / of_group_px) ** 2, weights=weights)
    log_ratio = np.log(split.long.focal_px / split.short.focal_px)
    return float(log_ratio / np.sqrt(square))


def _best_split(boards: Sequence[Board], lens: _Lens) -> _Split | None:
    """The split with the smallest error, from several first ones."""
    best: _Split | None = None
    for is_short in _first_splits(boards, lens):
        with suppress(cv2.error):
            for split in _improve(boards, lens, is_short):
                if best is None or split.square_px < best.square_px:
                    best = split
    return best


def _first_splits(boards: Sequence[Board], lens: _Lens) -> Iterator[np.ndarray]:
    """A quarter, half and three quarters of the boards, by the focal length that each
    has alone.
    """
    focal_px = [_fit_focal([board], lens).focal_px for board in boards]
    rank = np.argsort(np.argsort(focal_px))
    count = len(boards)
    for short in sorted({count // 4, count // 2, count - count // 4}):
        yield rank < short


def _improve(
    boards: Sequence[Board], lens: _Lens, is_short: np.ndarray
) -> Iterator[_Split]:
    """Splits, each from the lens of the one before, by which focal length leaves the
    smaller error of each board.
    """
    before = 0.0
    for _ in range(_ROUNDS):
        smaller_group = min(is_short.sum(), (~is_short).sum())
        if smaller_group < _MIN_BOARDS:
            return
        split = _fit_split(boards, lens, is_short)
        yield split

        # The lens of all boards, those of the shorter focal length enlarged.
        ratio = split.long.focal_px / split.short.focal_px
        enlarged = []
        for board, short in zip(boards, split.is_short, strict=True):
            scale = ratio if short else 1.0
            enlarged.append(_scaled(board, scale, lens.matrix[:2, 2]))
        lens = _fit_lens(enlarged)

        # Each board goes to the focal length that explains it better.
        matrix = lens.matrix.copy()
        matrix[[0, 1], [0, 1]] /= ratio
        short_lens = lens._replace(matrix=matrix)
        short_errors = [_error_square_px(board, short_lens) for board in boards]
        long_errors = [_error_square_px(board, lens) for board in boards]
        is_short = np.less(short_errors, long_errors)
        is_same = bool((is_short == split.is_short).all())
        if is_same and abs(ratio - before) < _SAME_RATIO:
            return
        before = ratio


def _fit_split(boards: Sequence[Board], lens: _Lens, is_short: np.ndarray) -> _Split:
    """Both focal lengths, with centre and distortion of a lens."""
    pairs = list(zip(boards, is_short, strict=True))
    short = _fit_focal([board for board, is_one in pairs if is_one], lens)
    long = _fit_focal([board for board, is_one in pairs if not is_one], lens)
    if short.focal_px <= long.focal_px:
        return _Split(lens, is_short, short, long)
    return _Split(lens, ~is_short, long, short)


def _scaled(board: Board, scale: float, centre_px: np.ndarray) -> Board:
    from_centre = board.corners_px - centre_px
    corners_px = (scale * from_centre + centre_px).astype(np.float32)
    return replace(board, corners_px=corners_px)


def _fit_focal(boards: Sequence[Board], lens: _Lens) -> _Focal:
    """The focal length of boards, with the other intrinsics of a lens."""
    flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_PRINCIPAL_POINT
    flags |= cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_FIX_TANGENT_DIST
    flags |= cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3
    _, matrix, *_, std, _, errors_px = cv2.calibrateCameraExtended(
        [board.object_points for board in boards],
        [board.corners_px for board in boards],
        boards[0].size,
        lens.matrix.copy(),
        lens.distortion.copy(),
        flags=flags,
    )
    corners = np.array([len(board.corners_px) for board in boards])
    square_px = float(np.sum(corners * errors_px.ravel() ** 2))
    # with a fixed aspect ratio OpenCV states the deviation of the second one only
    std_share = float(std[1, 0] / matrix[1, 1])
    return _Focal(float(matrix[0, 0]), std_share, errors_px.ravel().tolist(), square_px)


def _fit_lens(boards: Sequence[Board]) -> _Lens:
    _, matrix, distortion, *_ = cv2.calibrateCamera(
        [board.object_points for board in boards],
        [board.corners_px for board in boards],
        boards[0].size,
        None,
        None,
    )
    return _Lens(matrix, distortion)


def _error_square_px(board: Board, lens: _Lens) -> float:
    """Sum of the squared errors of a board in its best pose before a lens."""
    points = board.object_points
    corners_px = board.corners_px
    _, turn, shift = cv2.solvePnP(points, corners_px, *lens)
    turn, shift = cv2.solvePnPRefineLM(points, corners_px, *lens, turn, shift)
    projected, _ = cv2.projectPoints(points, turn, shift, *lens)
    return float(np.sum((projected[:, 0] - corners_px) ** 2))
