"""Calibrate a camera from pictures of a chessboard, complete or partly visible; outliers are rejected and named."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from lanes.camera import MAX_ASPECT_DIFFERENCE, CalibrationReport, Camera, resize_points
from lanes.canvas import LANE_COLOUR, LEFT_COLOUR, PANEL_COLOUR, TEXT_COLOUR, WINDOW_COLOUR, Colour, to_rgb, write_text
from lanes.chessboard import Board, draw_board, find_board
from lanes.errors import CameraError, PictureError
from lanes.images import list_pictures, opencv_threads, read_image

# Two views determine the intrinsics in theory; a third makes errors visible.
MIN_VIEWS = 3
# Two boards with a smaller mean distance are the same view: they differ by noise only.
SAME_VIEW_PX = 2.0
# A board with more than this many times the median error was bent, moved or detected wrongly. On the 20 Udacity boards,
# paper on a wall, the worst one has 1.5 times the median, and one with wrong corners 2.9 times.
OUTLIER_RATIO = 2.5
# Boards below this error are never outliers; it is the error of the corner detection in a compressed picture.
MIN_OUTLIER_ERROR_PX = 0.3
# Pictures of one camera whose sizes differ by at most this were cropped differently, not resized.
MAX_CROP_PX = 2
# Largest standard deviation of the focal length, as a share of it; three tilted real boards reach 0.4 %.
MAX_FOCAL_STD_SHARE = 0.02
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


def calibrate(boards: dict[str, Board], size: tuple[int, int]) -> Camera:
    """Camera intrinsics from boards in different poses (Zhang, PAMI 2000).

    Parameters
    ----------
    boards : dict of str to Board
        Boards by the name of the picture. Boards in pictures of another size are used if they fit the camera that the
        others determine: unchanged (the picture was cropped by a pixel or two) or rescaled, whichever fits better.
    size : tuple of int
        (width, height) of the camera's pictures.

    Returns
    -------
    Camera
        Without pose; its `report` has the reprojection error of each board, and the reason for each rejected board.

    Raises
    ------
    CameraError
        If fewer than three different views of the board remain, or they do not determine the intrinsics.
    """
    same_size = {name: board for name, board in boards.items() if board.size == size}
    rejected: dict[str, str] = {}
    camera = _calibrate_without_outliers(same_size, size, rejected)
    converted = {}
    for name in [name for name in boards if name not in same_size]:
        board, reason = _convert_size(boards[name], camera)
        if board is None:
            rejected[name] = reason
        else:
            converted[name] = board
    if converted:
        used = {**{name: same_size[name] for name in camera.require_report().board_rms_px}, **converted}
        camera = _calibrate_without_outliers({name: used[name] for name in boards if name in used}, size, rejected)
    return camera


def calibrate_folder(
    folder: str | Path, pattern: tuple[int, int] = (9, 6), *, progress: Callable[[int, int], None] | None = None
) -> Camera:
    """Camera intrinsics from all pictures of a folder, for their most frequent size.

    `pattern` is the complete board's inner corners (columns, rows). `progress` is called with (pictures done, pictures
    in all). The camera's `report.rejected` names the pictures not used, with the reason.

    Raises
    ------
    FileNotFoundError
        If the folder does not exist or holds no picture.
    CameraError
        If too few boards are found, or they do not determine the intrinsics.
    """
    return calibrate_detections(find_boards(list_pictures(folder), pattern, progress=progress), str(folder))


def find_boards(
    paths: Sequence[Path], pattern: tuple[int, int] = (9, 6), *, progress: Callable[[int, int], None] | None = None
) -> BoardDetections:
    """Detect the board in every picture; parameters as in `calibrate_folder`.

    Raises
    ------
    FileNotFoundError
        If a picture does not exist. Pictures that cannot be decoded are listed in `unused`.
    """
    same_name = Counter(path.name for path in paths)
    names = {path.name if same_name[path.name] == 1 else str(path): path for path in paths}
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
    return BoardDetections(names, pattern, boards, unused)


def calibrate_detections(detections: BoardDetections, source: str) -> Camera:
    """Camera intrinsics from detected boards; `source` names the pictures in messages.

    Raises
    ------
    CameraError
        If there are too few boards, or they do not determine the intrinsics.
    """
    unused = "".join(f"\n  {name}: {reason}" for name, reason in detections.unused.items())
    if not detections.boards:
        raise CameraError(
            f"no chessboard of {detections.pattern[0]}x{detections.pattern[1]} inner corners was found in any of the "
            f"{len(detections.paths)} pictures of {source}; give pictures of a board of that pattern, or the pattern "
            f"of this one.{unused}"
        )
    sizes = Counter(board.size for board in detections.boards.values())
    try:
        # Most frequent picture size; the larger one of two equally frequent.
        camera = calibrate(detections.boards, max(sizes, key=lambda size: (sizes[size], size)))
    except CameraError as error:
        raise CameraError(f"{source}: {error}{unused}") from error
    report = camera.require_report()
    return replace(camera, report=replace(report, rejected=detections.unused | report.rejected))


def _calibrate_without_outliers(boards: dict[str, Board], size: tuple[int, int], rejected: dict[str, str]) -> Camera:
    """Calibrate and remove the worst board until it is not an outlier; names and reasons are added to `rejected`."""
    boards = dict(boards)
    while True:
        camera = _calibrate_once(boards, size)
        report = camera.require_report()
        errors = report.board_rms_px
        median = float(np.median(list(errors.values())))
        worst = max(errors, key=errors.__getitem__)
        # With three boards it cannot be decided which one is wrong.
        if len(boards) == MIN_VIEWS or errors[worst] <= max(OUTLIER_RATIO * median, MIN_OUTLIER_ERROR_PX):
            return replace(camera, report=replace(report, rejected=rejected))
        rejected[worst] = (
            f"error {errors[worst]:.2f} px, more than {OUTLIER_RATIO} times the median board's {median:.2f}"
        )
        del boards[worst]


def _calibrate_once(boards: dict[str, Board], size: tuple[int, int]) -> Camera:
    views = _count_views(boards)
    if views < MIN_VIEWS:
        raise CameraError(
            f"{views} different view(s) of the board at {size[0]}x{size[1]} pixels, but calibration needs at least "
            f"{MIN_VIEWS}, better 15; take more pictures, with the board tilted each time in another direction."
        )
    object_points = [board.object_points for board in boards.values()]
    image_points = [board.corners_px for board in boards.values()]
    try:
        with opencv_threads(1):
            # OpenCV's stubs do not say that None stands for no initial intrinsics
            rms, matrix, distortion, *_, std, _, errors = cv2.calibrateCameraExtended(  # type: ignore[call-overload]
                object_points, image_points, size, None, None
            )
    except cv2.error as error:
        raise CameraError(f"these boards do not determine the intrinsics; {_ADVICE}.") from error
    focal, focal_std = matrix[0, 0], std[0, 0]
    if not (np.isfinite(matrix).all() and focal_std <= MAX_FOCAL_STD_SHARE * focal):
        raise CameraError(
            f"these boards do not determine the focal length ({focal:.0f} +- {focal_std:.0f} px); {_ADVICE}."
        )
    report = CalibrationReport(float(rms), dict(zip(boards, errors.ravel().tolist(), strict=True)))
    return Camera(*size, matrix, distortion.ravel(), report=report)


def _count_views(boards: dict[str, Board]) -> int:
    """Number of different views; a repeated picture adds no information."""
    views: list[Board] = []
    for board in boards.values():
        if not any(
            view.corners_px.shape == board.corners_px.shape
            and np.abs(view.corners_px - board.corners_px).mean() < SAME_VIEW_PX
            for view in views
        ):
            views.append(board)
    return len(views)


def _convert_size(board: Board, camera: Camera) -> tuple[Board | None, str]:
    """A board of a picture of another size, in the camera's pixels; or None and why it does not fit the camera."""
    (width, height), (board_width, board_height) = camera.size, board.size
    sizes = f"picture is {board_width}x{board_height} pixels, the others {width}x{height}"
    candidates = []
    if abs(board_width - width) <= MAX_CROP_PX and abs(board_height - height) <= MAX_CROP_PX:
        candidates.append(board.corners_px)
    if abs(board_width / board_height - width / height) <= MAX_ASPECT_DIFFERENCE:
        candidates.append(resize_points(board.corners_px, np.divide(camera.size, board.size)))
    if not candidates:
        return None, f"{sizes}: another aspect ratio, so another camera or a cropped picture"
    boards = [Board(c.astype(np.float32), board.columns, board.rows, camera.size) for c in candidates]
    errors = [_reprojection_error_px(b, camera) for b in boards]
    median = float(np.median(list(camera.require_report().board_rms_px.values())))
    limit = max(OUTLIER_RATIO * median, MIN_OUTLIER_ERROR_PX)
    if min(errors) > limit:
        return None, f"{sizes}, and it does not fit the same lens (error {min(errors):.2f} px, limit {limit:.2f})"
    return boards[int(np.argmin(errors))], ""


def _reprojection_error_px(board: Board, camera: Camera) -> float:
    """Root mean square reprojection error of a board whose pose is fitted to its corners."""
    _, rotation, translation = cv2.solvePnP(board.object_points, board.corners_px, camera.matrix, camera.distortion)
    projected, _ = cv2.projectPoints(board.object_points, rotation, translation, camera.matrix, camera.distortion)
    return float(np.sqrt(((projected.reshape(-1, 2) - board.corners_px) ** 2).sum(axis=1).mean()))


# Summary of a calibration: use and error of each picture, regions of the picture without corners, contact sheet.
#
# The distortion is determined only where corners were detected. A fit to the centre of the picture does not extrapolate
# to its corners.

# Borders of the 3 x 3 regions, as shares of width and height. Distortion is largest in the outer quarters.
REGION_BORDERS = (0.0, 0.25, 0.75, 1.0)
REGION_NAMES = (
    ("upper left", "top", "upper right"),
    ("left", "middle", "right"),
    ("lower left", "bottom", "lower right"),
)
# Fewer corners (one or two rows of one board) do not determine the distortion of a region.
MIN_CORNERS = 10
# A partial board with corners closer to the border of the picture, in squares, is cut off by it.
MAX_BORDER_DISTANCE_SQUARES = 1.5
# Contact sheet: tiles in a row, and sizes.
COLUMNS, TILE_PX, LABEL_PX, GAP_PX, TEXT_SIZE_PX = 5, (400, 225), 44, 6, 13


def count_corners(boards: Mapping[str, Board]) -> np.ndarray:
    """Number of corners (3, 3) in each region of the picture; `REGION_NAMES` has their names."""
    counts = np.zeros((3, 3), int)
    for board in boards.values():
        u, v = ((board.corners_px + 0.5) / board.size).T
        counts += np.histogram2d(v, u, bins=[REGION_BORDERS, REGION_BORDERS])[0].astype(int)
    return counts


def describe_coverage(boards: Mapping[str, Board]) -> str:
    """One sentence that names the regions with no or few corners."""
    counts = count_corners(boards)
    missing = {
        "no": [REGION_NAMES[row][column] for row, column in np.argwhere(counts == 0)],
        "few": [REGION_NAMES[row][column] for row, column in np.argwhere((counts > 0) & (counts < MIN_CORNERS))],
    }
    clauses = [f"{amount} corners in the {_join(regions)}" for amount, regions in missing.items() if regions]
    if not clauses:
        return "corners were detected in all regions of the picture"
    return f"{' and '.join(clauses)}: add boards there"


def describe_boards(detections: BoardDetections, camera: Camera) -> dict[str, str]:
    """Use of each picture, by name: "used", "cut by the edge, 7x6 corners of it used", or why it was not used."""
    report = camera.require_report()
    used, rejected = report.board_rms_px, report.rejected
    return {
        name: _describe_use(detections.boards[name], detections.pattern, camera) if name in used else rejected[name]
        for name in detections.paths
    }


def used_boards(detections: BoardDetections, camera: Camera) -> dict[str, Board]:
    """The boards used for the calibration, by the name of the picture."""
    used = camera.require_report().board_rms_px
    return {name: detections.boards[name] for name in detections.paths if name in used}


def format_boards(detections: BoardDetections, camera: Camera) -> str:
    """Text table with name, reprojection error in pixels and use of each picture."""
    uses, errors = describe_boards(detections, camera), camera.require_report().board_rms_px
    width = max(map(len, uses))
    lines = [f"{'picture':<{width}}  error px  board"]
    for name, use in uses.items():
        error = f"{errors[name]:8.2f}" if name in errors else f"{'-':>8}"
        lines.append(f"{name:<{width}}  {error}  {use}")
    return "\n".join(lines)


def _describe_use(board: Board, pattern: tuple[int, int], camera: Camera) -> str:
    size = "" if board.size == camera.size else f", picture of {board.size[0]}x{board.size[1]}"
    if {board.columns, board.rows} == set(pattern):
        return f"used{size}"
    reason = "cut by the edge" if _is_cut_off(board) else "partly hidden"
    return f"{reason}, {board.columns}x{board.rows} corners of it used{size}"


def _is_cut_off(board: Board) -> bool:
    grid = board.corners_px.reshape(board.rows, board.columns, 2)
    square_px = np.median(np.hypot(*np.diff(grid, axis=1).reshape(-1, 2).T))
    to_border_px = np.minimum(board.corners_px, np.array(board.size) - 1 - board.corners_px).min()
    return bool(to_border_px < MAX_BORDER_DISTANCE_SQUARES * square_px)


def _join(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def draw_contact_sheet(detections: BoardDetections, camera: Camera) -> np.ndarray:
    """All pictures of a calibration on one contact sheet.

    RGB (height, width, 3), uint8. The frame of a tile is green if the complete board was used, yellow if a part of it
    was used, and red if the picture was not used. The last tile shows the positions of all corners used, and their
    number by region. `camera` is the result of `calibrate_detections`.
    """
    uses, errors = describe_boards(detections, camera), camera.require_report().board_rms_px
    tiles = []
    for name, path in detections.paths.items():
        label = [name, f"{errors[name]:.2f} px, {uses[name]}"] if name in errors else [name, uses[name]]
        colour = LEFT_COLOUR if name not in errors else LANE_COLOUR if uses[name].startswith("used") else WINDOW_COLOUR
        tiles.append(_draw_tile(_draw_corners(detections, name, path), label, colour))
    tiles.append(_draw_tile(_draw_coverage(detections, camera), ["where corners were seen"], TEXT_COLOUR))
    columns = min(COLUMNS, len(tiles))
    blank = np.full_like(tiles[0], PANEL_COLOUR)
    tiles += [blank] * (-len(tiles) % columns)
    rows = [np.hstack(tiles[start : start + columns]) for start in range(0, len(tiles), columns)]
    return np.vstack(rows)


def _draw_corners(detections: BoardDetections, name: str, path: Path) -> np.ndarray:
    """The picture with its corners, both resized to a tile; black if it cannot be read."""
    try:
        image = read_image(path)
    except PictureError:
        return np.zeros((TILE_PX[1], TILE_PX[0], 3), np.uint8)
    small = _fit_to_tile(image)
    if name not in detections.boards:
        return small
    board, scale = detections.boards[name], small.shape[1] / image.shape[1]
    corners = resize_points(board.corners_px, scale).astype(np.float32)
    return draw_board(small, replace(board, corners_px=corners, size=(small.shape[1], small.shape[0])))


def _fit_to_tile(image: np.ndarray) -> np.ndarray:
    scale = min(TILE_PX[0] / image.shape[1], TILE_PX[1] / image.shape[0])
    size = round(image.shape[1] * scale), round(image.shape[0] * scale)
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA)


def _draw_tile(image: np.ndarray, label: list[str], colour: Colour) -> np.ndarray:
    """The picture below its label, in a frame of that colour."""
    small = _fit_to_tile(image)
    tile = np.full((TILE_PX[1] + LABEL_PX, TILE_PX[0], 3), PANEL_COLOUR, np.uint8)
    left = (TILE_PX[0] - small.shape[1]) // 2
    tile[LABEL_PX : LABEL_PX + small.shape[0], left : left + small.shape[1]] = small
    tile[:LABEL_PX] = write_text(tile[:LABEL_PX], label, size_px=TEXT_SIZE_PX, panel_alpha=0)
    return cv2.copyMakeBorder(tile, GAP_PX, GAP_PX, GAP_PX, GAP_PX, cv2.BORDER_CONSTANT, value=colour)


def _draw_coverage(detections: BoardDetections, camera: Camera) -> np.ndarray:
    """All corners used as dots, the regions of the picture, and the number of corners in each."""
    width, height = 2 * TILE_PX[0], round(2 * TILE_PX[0] * camera.height / camera.width)
    boards = used_boards(detections, camera)
    drawn = to_rgb(np.full((height, width), 30, np.uint8))
    for board in boards.values():
        for u, v in (board.corners_px + 0.5) / board.size * (width, height):
            cv2.circle(drawn, (round(float(u)), round(float(v))), 3, LANE_COLOUR, -1, cv2.LINE_AA)
    for share in REGION_BORDERS[1:-1]:
        cv2.line(drawn, (0, round(share * height)), (width, round(share * height)), TEXT_COLOUR, 1)
        cv2.line(drawn, (round(share * width), 0), (round(share * width), height), TEXT_COLOUR, 1)
    edges_u, edges_v = (np.multiply(REGION_BORDERS, length).round().astype(int) for length in (width, height))
    counts = count_corners(boards)
    for row, column in np.ndindex(counts.shape):
        region = drawn[edges_v[row] : edges_v[row + 1], edges_u[column] : edges_u[column + 1]]
        region[:] = write_text(region, str(counts[row, column]), corner="bottom right", size_px=28)
    return drawn
