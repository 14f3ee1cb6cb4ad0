"""Chessboard pictures -> Camera: calibration from full and cut boards, with outliers dropped and named."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from lanes.camera.calibration.corners import Board, draw_board, find_board
from lanes.camera.camera import MAX_ASPECT_DIFFERENCE, CalibrationReport, Camera
from lanes.camera.camera_pose import CameraError
from lanes.io.frames import PictureError
from lanes.io.images import list_pictures, read_image
from lanes.io.threads import one_thread

__all__ = ["Board", "calibrate", "calibrate_folder", "draw_board", "find_board"]

# Five intrinsics beyond the pose of each view: two views determine them in theory, three make mistakes visible.
FEWEST_BOARDS = 3
# Two grids nearer than this are one view: what differs is noise, and noise must not pass for a second perspective.
SAME_VIEW_PX = 2.0
# A board whose error is this many times the median board's was bent, moved or misread: on twenty real boards of paper
# on a wall the worst one has 1.5 times the median, and one with misread corners 2.9 times.
OUTLIER_RATIO = 2.5
# Errors below this are the finder's on a compressed picture, whatever the median is.
OUTLIER_FLOOR_PX = 0.3
# Pictures of the same camera that differ by so many pixels were cut differently, not resized.
CUT_PX = 2
# Share of the focal length that its standard deviation may reach; three tilted real boards reach 0.4 %.
LARGEST_FOCAL_STD = 0.02


@dataclass(frozen=True, eq=False)
class BoardSearch:
    """What was found in pictures of a chessboard.

    Attributes
    ----------
    paths : dict of str to Path
        All pictures by name.
    pattern : tuple of int
        Inner corners (columns, rows) that were looked for.
    boards : dict of str to Board
    unused : dict of str to str
        Pictures without a board, and why.
    """

    paths: dict[str, Path]
    pattern: tuple[int, int]
    boards: dict[str, Board]
    unused: dict[str, str]


def calibrate(boards: dict[str, Board], size: tuple[int, int]) -> Camera:
    """Find the lens from boards seen in different poses (Zhang, PAMI 2000).

    Parameters
    ----------
    boards : dict of str to Board
        By the name of the picture. Boards in pictures of another size count if they fit the camera that the others
        give, as they are (cut by a pixel or two) or rescaled, whichever fits better.
    size : tuple of int
        (width, height) of the camera's pictures.

    Returns
    -------
    Camera
        Without pose; its `report` names each board's error, and each rejected board with the reason.

    Raises
    ------
    CameraError
        If fewer than three different views of the board remain, or they do not determine the lens.
    """
    ours = {name: board for name, board in boards.items() if board.size == size}
    rejected: dict[str, str] = {}
    camera = _calibrate_without_outliers(ours, size, rejected)
    adopted = {}
    for name in [name for name in boards if name not in ours]:
        board, reason = _adopt(boards[name], camera)
        if board is None:
            rejected[name] = reason
        else:
            adopted[name] = board
    if adopted:
        kept = {**{name: ours[name] for name in camera.report.board_rms_px}, **adopted}
        camera = _calibrate_without_outliers({name: kept[name] for name in boards if name in kept}, size, rejected)
    return camera


def calibrate_folder(
    folder: str | Path,
    pattern: tuple[int, int] = (9, 6),
    *,
    progress: Callable[[int, int], None] | None = None,
) -> Camera:
    """Calibrate from all pictures of a folder.

    Parameters
    ----------
    folder : str or Path
    pattern : tuple of int
        Inner corners (columns, rows) of the whole board.
    progress : callable, optional
        Called as progress(pictures done, pictures in all).

    Returns
    -------
    Camera
        For the picture size that most boards have; `report.rejected` names the pictures not used, with the reason.

    Raises
    ------
    FileNotFoundError
        If the folder does not exist or holds no picture.
    CameraError
        If too few boards are found, or they do not determine the lens.
    """
    return calibrate_found(find_boards(list_pictures(folder), pattern, progress=progress), str(folder))


def find_boards(
    paths: Sequence[Path], pattern: tuple[int, int] = (9, 6), *, progress: Callable[[int, int], None] | None = None
) -> BoardSearch:
    """Look for the board in every picture; see `calibrate_folder`."""
    names = _names(paths)
    boards: dict[str, Board] = {}
    unused: dict[str, str] = {}
    for done, (name, path) in enumerate(names.items(), 1):
        try:
            board = find_board(read_image(path), pattern)
        except PictureError as error:
            unused[name] = str(error)
        else:
            if board is None:
                unused[name] = f"no chessboard of {pattern[0]}x{pattern[1]} inner corners, nor a part of one"
            else:
                boards[name] = board
        if progress:
            progress(done, len(paths))
    return BoardSearch(names, pattern, boards, unused)


def calibrate_found(search: BoardSearch, source: str) -> Camera:
    """The lens from the boards found; see `calibrate_folder`. `source` names their pictures in errors."""
    unused = "".join(f"\n  {name}: {reason}" for name, reason in search.unused.items())
    if not search.boards:
        raise CameraError(
            f"no chessboard of {search.pattern[0]}x{search.pattern[1]} inner corners was found in any of the "
            f"{len(search.paths)} pictures of {source}; give pictures of a board of that pattern, or the pattern of "
            f"this one.{unused}"
        )
    try:
        camera = calibrate(search.boards, _most_common_size(search.boards))
    except CameraError as error:
        raise CameraError(f"{source}: {error}{unused}") from error
    report = camera.report
    return camera.with_report(CalibrationReport(report.rms_px, report.board_rms_px, search.unused | report.rejected))


def _names(paths: Sequence[Path]) -> dict[str, Path]:
    """The pictures by their file names, or by their paths where two have the same name."""
    names = Counter(path.name for path in paths)
    return {path.name if names[path.name] == 1 else str(path): path for path in paths}


def _most_common_size(boards: dict[str, Board]) -> tuple[int, int]:
    """The size that most pictures have, the larger one of two equally common."""
    sizes = Counter(board.size for board in boards.values())
    return max(sizes, key=lambda size: (sizes[size], size))


def _calibrate_without_outliers(boards: dict[str, Board], size: tuple[int, int], rejected: dict[str, str]) -> Camera:
    """Calibrate, drop the worst board if it is an outlier, and again; `rejected` takes the names and reasons."""
    boards = dict(boards)
    while True:
        camera = _calibrate_once(boards, size)
        errors = camera.report.board_rms_px
        median = float(np.median(list(errors.values())))
        worst = max(errors, key=errors.get)
        # With three boards left nothing tells which of them is wrong.
        if len(boards) == FEWEST_BOARDS or errors[worst] <= max(OUTLIER_RATIO * median, OUTLIER_FLOOR_PX):
            return camera.with_report(CalibrationReport(camera.report.rms_px, errors, rejected))
        rejected[worst] = (
            f"error {errors[worst]:.2f} px, more than {OUTLIER_RATIO} times the median board's {median:.2f}"
        )
        del boards[worst]


def _calibrate_once(boards: dict[str, Board], size: tuple[int, int]) -> Camera:
    views = _count_views(boards)
    if views < FEWEST_BOARDS:
        raise CameraError(
            f"{views} different view(s) of the board at {size[0]}x{size[1]} pixels, but calibration needs at least "
            f"{FEWEST_BOARDS}, better 15; take more pictures, with the board tilted each time in another direction."
        )
    planes = [board.plane_points for board in boards.values()]
    corners = [board.corners_px for board in boards.values()]
    try:
        with one_thread():
            rms, matrix, distortion, *_, std, _, errors = cv2.calibrateCameraExtended(planes, corners, size, None, None)
    except cv2.error as error:
        raise CameraError(f"these boards do not determine a lens; {_HOW_TO_TAKE}.") from error
    focal, focal_std = matrix[0, 0], std[0, 0]
    if not (np.isfinite(matrix).all() and focal_std <= LARGEST_FOCAL_STD * focal):
        raise CameraError(
            f"these boards leave the focal length open ({focal:.0f} px give or take {focal_std:.0f} px); "
            f"{_HOW_TO_TAKE}."
        )
    report = CalibrationReport(float(rms), dict(zip(boards, errors.ravel().tolist(), strict=True)))
    return Camera(*size, matrix, distortion.ravel(), report=report)


_HOW_TO_TAKE = "take pictures in which the board is tilted by 20 to 45 degrees, each time in another direction"


def _count_views(boards: dict[str, Board]) -> int:
    """How many boards are seen differently; the same picture twice determines nothing more than once."""
    views: list[Board] = []
    for board in boards.values():
        if not any(
            seen.corners_px.shape == board.corners_px.shape
            and np.abs(seen.corners_px - board.corners_px).mean() < SAME_VIEW_PX
            for seen in views
        ):
            views.append(board)
    return len(views)


def _adopt(board: Board, camera: Camera) -> tuple[Board | None, str]:
    """A board from a picture of another size, in the camera's pixels; or None and why it is not this camera's."""
    (width, height), (board_width, board_height) = camera.size, board.size
    which = f"picture is {board_width}x{board_height} pixels, the others {width}x{height}"
    candidates = []
    if abs(board_width - width) <= CUT_PX and abs(board_height - height) <= CUT_PX:
        candidates.append(board.corners_px)
    if abs(board_width / board_height - width / height) <= MAX_ASPECT_DIFFERENCE:
        # Pixel centres lie at integers, so the picture's edge is at -0.5: shift by half a pixel, scale, shift back.
        candidates.append((board.corners_px + 0.5) * np.divide(camera.size, board.size) - 0.5)
    if not candidates:
        return None, f"{which}: another aspect ratio, so another camera or a cropped picture"
    boards = [Board(c.astype(np.float32), board.columns, board.rows, camera.size) for c in candidates]
    errors = [_pose_error_px(b, camera) for b in boards]
    limit = max(OUTLIER_RATIO * float(np.median(list(camera.report.board_rms_px.values()))), OUTLIER_FLOOR_PX)
    if min(errors) > limit:
        return None, f"{which}, and it does not fit the same lens (error {min(errors):.2f} px, limit {limit:.2f})"
    return boards[int(np.argmin(errors))], ""


def _pose_error_px(board: Board, camera: Camera) -> float:
    """Root mean square distance of the corners from where the lens would show the best-placed board."""
    _, turn, shift = cv2.solvePnP(board.plane_points, board.corners_px, camera.matrix, camera.distortion)
    seen, _ = cv2.projectPoints(board.plane_points, turn, shift, camera.matrix, camera.distortion)
    return float(np.sqrt(((seen.reshape(-1, 2) - board.corners_px) ** 2).sum(axis=1).mean()))
