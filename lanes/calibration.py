"""Calibrate a camera from pictures of a chessboard, complete or partly visible; outliers are rejected and named."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from lanes.camera import MAX_ASPECT_DIFFERENCE, CalibrationReport, Camera, resize_points
from lanes.canvas import LANE_COLOUR, LEFT_COLOUR, PANEL_COLOUR, WINDOW_COLOUR, Colour, put_text
from lanes.chessboard import Board, draw_board, find_board
from lanes.errors import CameraError, PictureError
from lanes.images import list_pictures, opencv_threads, read_image

# Two views determine the intrinsics in theory; a third makes errors visible.
MIN_VIEWS = 3
# A board with more than this many times the median error was bent, moved or detected wrongly. On the 20 Udacity boards,
# paper on a wall, the worst one has 1.5 times the median, and one with wrong corners 2.9 times.
OUTLIER_RATIO = 2.5
# Boards below this error are never outliers; it is the error of the corner detection in a compressed picture.
MIN_OUTLIER_ERROR_PX = 0.3
_ADVICE = "take pictures in which the board is tilted by 20 to 45 degrees, each time in another direction"


@dataclass(frozen=True, eq=False)
class BoardDetections:
    """Chessboards detected in pictures.

    `paths` has all pictures by name, `boards` the detected boards by the name of the picture, and `unused` the pictures
    without a board with the reason. `pattern` is the complete board's inner corners (columns, rows).
    """

    paths: dict[str, Path]
    pattern: tuple[int, int]
    boards: dict[str, Board]
    unused: dict[str, str]


def calibrate(
    source: str | Path | Iterable[str | Path],
    pattern: tuple[int, int] = (9, 6),
    *,
    progress: Callable[[int, int], None] | None = None,
) -> Camera:
    """Camera intrinsics from pictures of a chessboard, for their most frequent size.

    >>> camera = lanes.calibrate("boards/")  # doctest: +SKIP

    Parameters
    ----------
    source : path or iterable of paths
        A folder of pictures, or pictures and folders.
    pattern : tuple of int
        The complete board's inner corners (columns, rows).
    progress : callable, optional
        Called with (pictures done, pictures in all).

    Returns
    -------
    Camera
        Without pose. Its `report` has the error of each board, and the pictures not used, with the reason.

    Raises
    ------
    FileNotFoundError
        If a file or folder does not exist, or a folder holds no picture.
    CameraError
        If too few boards are found, or they do not determine the intrinsics.
    """
    sources = [source] if isinstance(source, str | Path) else list(source)
    detections = find_boards(list_board_pictures(sources), pattern, progress=progress)
    return calibrate_detections(detections, ", ".join(map(str, sources[:3])))


def list_board_pictures(sources: Iterable[str | Path]) -> list[Path]:
    """The pictures in folders, and pictures that are named themselves."""
    return [path for given in map(Path, sources) for path in (list_pictures(given) if given.is_dir() else [given])]


def find_boards(
    paths: Iterable[Path], pattern: tuple[int, int] = (9, 6), *, progress: Callable[[int, int], None] | None = None
) -> BoardDetections:
    """The board in every picture. Pictures that cannot be decoded are `unused`; one that does not exist is an error."""
    paths = list(paths)
    same_name = Counter(path.name for path in paths)
    names = {path.name if same_name[path.name] == 1 else str(path): path for path in paths}
    boards: dict[str, Board] = {}
    unused: dict[str, str] = {}
    for done, (name, path) in enumerate(names.items(), 1):
        reason = f"no chessboard of {pattern[0]}x{pattern[1]} inner corners, nor a part of one"
        try:
            board = find_board(read_image(path), pattern)
        except PictureError as error:
            board, reason = None, str(error)
        if board:
            boards[name] = board
        else:
            unused[name] = reason
        if progress:
            progress(done, len(paths))
    return BoardDetections(names, pattern, boards, unused)


def calibrate_detections(detections: BoardDetections, source: str) -> Camera:
    """Camera intrinsics from detected boards, as `calibrate`; `source` names the pictures in messages."""
    unused = "".join(f"\n  {name}: {reason}" for name, reason in detections.unused.items())
    if not detections.boards:
        raise CameraError(
            f"no chessboard of {detections.pattern[0]}x{detections.pattern[1]} inner corners was found in any of the "
            f"{len(detections.paths)} pictures of {source}; give pictures of a board of that pattern, or the pattern "
            f"of this one.{unused}"
        )
    try:
        camera = calibrate_boards(detections.boards)
    except CameraError as error:
        raise CameraError(f"{source}: {error}{unused}") from error
    report = camera.require_report()
    return replace(camera, report=replace(report, rejected=detections.unused | report.rejected))


def calibrate_boards(boards: Mapping[str, Board]) -> Camera:
    """Camera intrinsics from boards in different poses, by the name of the picture (Zhang, PAMI 2000).

    They are for pictures of the most frequent size. Boards in pictures of another size are used if they fit the camera
    that the others determine: unchanged (the picture was cropped by a pixel or two) or rescaled, whichever fits better.
    Raises CameraError if fewer than three different views of the board remain, or they do not determine the intrinsics.
    """
    sizes = Counter(board.size for board in boards.values())
    size = max(sizes, key=lambda size: (sizes[size], size))
    same_size = {name: board for name, board in boards.items() if board.size == size}
    camera = _calibrate_without_outliers(same_size, size, {})
    if len(same_size) == len(boards):
        return camera
    rejected, used = dict(camera.require_report().rejected), {}
    for name, board in boards.items():
        fitting, reason = (board, "") if name in same_size else _convert_size(board, camera)
        if fitting is None:
            rejected[name] = reason
        elif name not in rejected:
            used[name] = fitting
    return _calibrate_without_outliers(used, size, rejected)


def _calibrate_without_outliers(boards: dict[str, Board], size: tuple[int, int], rejected: dict[str, str]) -> Camera:
    """Calibrate and remove the worst board until it is not an outlier; the reasons are added to those `rejected`."""
    boards, rejected = dict(boards), dict(rejected)
    while True:
        camera = _calibrate_once(boards, size, rejected)
        errors = camera.require_report().board_rms_px
        worst = max(errors, key=errors.__getitem__)
        # With three boards it cannot be decided which one is wrong.
        if len(boards) == MIN_VIEWS or errors[worst] <= _largest_error_px(errors):
            return camera
        limit = f"{OUTLIER_RATIO} times the median board's {np.median(list(errors.values())):.2f}"
        rejected[worst] = f"error {errors[worst]:.2f} px, more than {limit}"
        del boards[worst]


def _largest_error_px(errors: Mapping[str, float]) -> float:
    """The largest error of a board that is no outlier among boards with these errors."""
    return max(OUTLIER_RATIO * float(np.median(list(errors.values()))), MIN_OUTLIER_ERROR_PX)


def _calibrate_once(boards: dict[str, Board], size: tuple[int, int], rejected: dict[str, str]) -> Camera:
    """The camera, with the error of each board and the `rejected` ones in its report."""
    views = _count_views(boards)
    if views < MIN_VIEWS:
        raise CameraError(
            f"{views} different view(s) of the board at {size[0]}x{size[1]} pixels, but calibration needs at least "
            f"{MIN_VIEWS}, better 15; take more pictures, with the board tilted each time in another direction."
        )
    object_points = [board.object_points for board in boards.values()]
    image_points = [board.corners_px for board in boards.values()]
    try:
        # on several threads the result differs from run to run
        with opencv_threads(1):
            # OpenCV's stubs do not say that None stands for no initial intrinsics
            rms, matrix, distortion, *_, std, _, errors = cv2.calibrateCameraExtended(  # type: ignore[call-overload]
                object_points, image_points, size, None, None
            )
    except cv2.error as error:
        raise CameraError(f"these boards do not determine the intrinsics; {_ADVICE}.") from error
    focal, focal_std = matrix[0, 0], std[0, 0]
    # three tilted real boards reach 0.4 %
    if not (np.isfinite(matrix).all() and focal_std <= 0.02 * focal):
        raise CameraError(
            f"these boards do not determine the focal length ({focal:.0f} +- {focal_std:.0f} px); {_ADVICE}."
        )
    report = CalibrationReport(float(rms), dict(zip(boards, errors.ravel().tolist(), strict=True)), rejected)
    return Camera(*size, matrix, distortion.ravel(), report=report)


def _count_views(boards: Mapping[str, Board]) -> int:
    """Number of different views. A repeated picture adds no information: its corners differ by noise, below 2 px."""
    views: list[np.ndarray] = []
    for board in boards.values():
        corners = board.corners_px
        if not any(view.shape == corners.shape and np.abs(view - corners).mean() < 2.0 for view in views):
            views.append(corners)
    return len(views)


def _convert_size(board: Board, camera: Camera) -> tuple[Board | None, str]:
    """A board of a picture of another size, in the camera's pixels; or None and why it does not fit the camera."""
    (width, height), (board_width, board_height) = camera.size, board.size
    sizes = f"picture is {board_width}x{board_height} pixels, the others {width}x{height}"
    candidates = []
    if abs(board_width - width) <= 2 and abs(board_height - height) <= 2:
        candidates.append(board.corners_px)
    if abs(board_width / board_height - width / height) <= MAX_ASPECT_DIFFERENCE:
        candidates.append(resize_points(board.corners_px, np.divide(camera.size, board.size)))
    if not candidates:
        return None, f"{sizes}: another aspect ratio, so another camera or a cropped picture"
    boards = [replace(board, corners_px=corners.astype(np.float32), size=camera.size) for corners in candidates]
    errors = [_reprojection_error_px(b, camera) for b in boards]
    limit = _largest_error_px(camera.require_report().board_rms_px)
    if min(errors) > limit:
        return None, f"{sizes}, and it does not fit the same lens (error {min(errors):.2f} px, limit {limit:.2f})"
    return boards[int(np.argmin(errors))], ""


def _reprojection_error_px(board: Board, camera: Camera) -> float:
    """Root mean square reprojection error of a board whose pose is fitted to its corners."""
    _, rotation, translation = cv2.solvePnP(board.object_points, board.corners_px, camera.matrix, camera.distortion)
    projected, _ = cv2.projectPoints(board.object_points, rotation, translation, camera.matrix, camera.distortion)
    return float(np.sqrt(((projected.reshape(-1, 2) - board.corners_px) ** 2).sum(axis=1).mean()))


# Summary of a calibration in words and as a contact sheet.

# Borders of the 3 x 3 regions of a picture, as shares of width and height, and their names. Distortion is largest in
# the outer quarters.
REGION_BORDERS = (0.0, 0.25, 0.75, 1.0)
REGION_NAMES = ("upper left", "top", "upper right", "left", "middle", "right", "lower left", "bottom", "lower right")
# Contact sheet: size of a tile below its label, pixels.
TILE_PX, LABEL_PX = (400, 225), 44


def describe_calibration(detections: BoardDetections, camera: Camera) -> str:
    """Text of several lines: reprojection error and use of each picture, focal length, regions without corners."""
    report = camera.require_report()
    uses, errors = _describe_uses(detections, camera), report.board_rms_px
    width = max(map(len, uses))
    lines = [f"{'picture':<{width}}  error px  board"]
    for name, use in uses.items():
        error = f"{errors[name]:8.2f}" if name in errors else f"{'-':>8}"
        lines.append(f"{name:<{width}}  {error}  {use}")
    lines += [
        f"{len(errors)} of {len(uses)} pictures used, error {report.rms_px:.2f} px (RMS of all corners)",
        f"focal length {camera.matrix[0, 0]:.1f} px, horizontal field of view {camera.hfov_deg:.1f} deg",
        describe_coverage([detections.boards[name] for name in errors]),
    ]
    return "\n".join(lines)


def describe_coverage(boards: Iterable[Board]) -> str:
    """One sentence that names the regions of the picture with fewer than ten corners: a row or two of one board.

    The distortion is determined only where corners were detected: a fit to the middle of the picture does not
    extrapolate to its corners.
    """
    u, v = np.concatenate([(board.corners_px + 0.5) / board.size for board in boards]).T
    counts = np.histogram2d(v, u, bins=[REGION_BORDERS, REGION_BORDERS])[0].ravel()
    missing = [name for name, count in zip(REGION_NAMES, counts, strict=True) if count < 10]
    if not missing:
        return "corners were detected in all regions of the picture"
    return f"few or no corners in these regions of the picture: {', '.join(missing)}; add boards there"


def _describe_uses(detections: BoardDetections, camera: Camera) -> dict[str, str]:
    """Use of each picture, by name: "used", "used, 7x6 corners of the board", or why it was not used."""
    report = camera.require_report()
    uses = dict.fromkeys(detections.paths, "used") | report.rejected
    for name in report.board_rms_px:
        board = detections.boards[name]
        if {board.columns, board.rows} != set(detections.pattern):
            uses[name] += f", {board.columns}x{board.rows} corners of the board"
        if board.size != camera.size:
            uses[name] += f", picture of {board.size[0]}x{board.size[1]}"
    return uses


def draw_contact_sheet(detections: BoardDetections, camera: Camera) -> np.ndarray:
    """Picture (height, width, 3), uint8 RGB, with a tile for each board picture, five in a row, and its corners.

    The frame of a tile is green if the picture was used, yellow if a part of the board was used, and red if the picture
    was not used.
    """
    uses, errors = _describe_uses(detections, camera), camera.require_report().board_rms_px
    tiles = []
    for name, path in detections.paths.items():
        colour = LEFT_COLOUR if name not in errors else WINDOW_COLOUR if "corners" in uses[name] else LANE_COLOUR
        label = [name, f"{errors[name]:.2f} px, {uses[name]}" if name in errors else uses[name]]
        tiles.append(_draw_tile(path, detections.boards.get(name), label, colour))
    columns = min(5, len(tiles))
    tiles += [np.full_like(tiles[0], PANEL_COLOUR)] * (-len(tiles) % columns)
    return np.vstack([np.hstack(tiles[start : start + columns]) for start in range(0, len(tiles), columns)])


def _draw_tile(path: Path, board: Board | None, label: list[str], colour: Colour) -> np.ndarray:
    """A picture with the corners of its board below a label, in a frame of that colour; black if it cannot be read."""
    try:
        image = read_image(path)
    except PictureError:
        image = np.zeros((TILE_PX[1], TILE_PX[0], 3), np.uint8)
    scale = min(TILE_PX[0] / image.shape[1], TILE_PX[1] / image.shape[0])
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    if board:
        small = draw_board(small, replace(board, corners_px=resize_points(board.corners_px, scale).astype(np.float32)))
    tile = np.full((TILE_PX[1] + LABEL_PX, TILE_PX[0], 3), PANEL_COLOUR, np.uint8)
    left = (TILE_PX[0] - small.shape[1]) // 2
    tile[LABEL_PX : LABEL_PX + small.shape[0], left : left + small.shape[1]] = small
    put_text(tile[:LABEL_PX], label, size_px=13, panel_alpha=0)
    return cv2.copyMakeBorder(tile, 6, 6, 6, 6, cv2.BORDER_CONSTANT, value=colour)
