"""Calibrate a camera from stills or videos of a chessboard, complete or partly visible;
outliers are rejected.

The EXIF orientation of stills is ignored, so that portrait and landscape stills of one
camera fit together.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from lanes.camera.chessboard import Board, Pattern, draw_board, find_board
from lanes.camera.model import CalibrationReport, Camera, resize_points
from lanes.camera.zoom import find_focal_groups
from lanes.canvas import (
    LANE_COLOUR,
    LEFT_COLOUR,
    PANEL_COLOUR,
    WINDOW_COLOUR,
    Colour,
    put_text,
)
from lanes.errors import CameraError, PictureError
from lanes.ros.log_files import is_robot_log
from lanes.video.images import as_stored, kind_of_file, opencv_threads, read_image
from lanes.video.reader import inspect_video, read_timed_frames
from lanes.video.sources import find_sources, list_paths, require_topic

# Two views determine the intrinsics in theory; a third makes errors visible.
_MIN_VIEWS = 3
# A board with more than this many times the median error was bent, moved or detected
# wrongly. On the 20 Udacity boards, paper on a wall, the worst one has 1.5 times the
# median, and one with wrong corners 2.9 times.
_OUTLIER_RATIO = 2.5
# Boards below this error are never outliers: it is the error of the corner detection in
# a compressed image.
_MIN_OUTLIER_ERROR_PX = 0.3
# Largest error that is plausible for a lens, as a share of the image's longer side: 3.2
# pixels of 1280, where Udacity's boards, paper on a wall, have 0.9.
_MAX_ERROR_SHARE = 0.0025
# Frames of a video that are searched for a board, and the most that are used.
_VIDEO_FRAMES = 60
_VIDEO_BOARDS = 20
_ADVICE = (
    "take images in which the board is tilted by 20 to 45 degrees, each time in "
    "another direction"
)

# (width, height) in pixels.
Size = tuple[int, int]
# Boards, or words about them, by the name of the image.
Boards = Mapping[str, Board]
Reasons = Mapping[str, str]


@dataclass(frozen=True, eq=False)
class BoardDetections:
    """Chessboards detected in images.

    `tiles` has all images by name, made small for the contact sheet. `boards` has the
    detected boards by the name of the image. `unused` has the images without a board,
    and the reason. `pattern` is the complete board's inner corners (columns, rows).
    """

    tiles: dict[str, np.ndarray]
    pattern: Pattern
    boards: dict[str, Board]
    unused: dict[str, str]


def calibrate(
    source: str | Path | Iterable[str | Path],
    pattern: Pattern = (9, 6),
    *,
    topic: str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Camera:
    """Camera intrinsics from images or videos of a chessboard, for their most frequent
    size.

    >>> camera = lanes.calibrate("boards/")  # doctest: +SKIP

    Parameters
    ----------
    source : path or iterable of paths
        A folder of images, or images, videos and folders.
    pattern : tuple of int
        The complete board's inner corners (columns, rows).
    topic : str, optional
        Topic of the images in robot logs; by default the only one.
    progress : callable, optional
        Called with (images done, images in all).

    Returns
    -------
    Camera
        Without pose, for images as the sensor sees them (`Camera.turned`); a fisheye
        lens has four coefficients. Its `report` has the error of each board, and the
        images not used, with the reason.

    Raises
    ------
    FileNotFoundError
        If a file or folder does not exist, or a folder holds no image.
    CameraError
        If too few boards are found, or they do not determine the intrinsics, or they
        fit no lens.
    """
    names = list_paths(source)
    files = find_sources(names).warn().files
    require_topic(files, topic)
    detections = find_boards(files, pattern, topic=topic, progress=progress)
    return calibrate_detections(detections, ", ".join(names[:3]))


def find_boards(
    paths: Sequence[Path],
    pattern: Pattern = (9, 6),
    *,
    topic: str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> BoardDetections:
    """The board in every image, and in those frames of a video that show it most
    differently.

    `topic` is that of the images in robot logs. Images that cannot be decoded are
    `unused`; one that does not exist is an error.
    """
    same_name = Counter(path.name for path in paths)
    # a video stands for as many images as frames of it are searched
    counts = [1 if kind_of_file(path) == "image" else _VIDEO_FRAMES for path in paths]
    total = sum(counts)
    done = 0
    found = BoardDetections({}, pattern, {}, {})
    for path, count in zip(paths, counts, strict=True):
        name = path.name if same_name[path.name] == 1 else str(path)
        seen = BoardDetections({}, pattern, {}, {})
        try:
            for share, view, image in _read_views(path, name, topic):
                if progress:
                    progress(done + int(share * count), total)
                _add_image(seen, view, image)
        except PictureError as error:
            seen.tiles[name] = np.zeros((_TILE_HEIGHT_PX, _TILE_WIDTH_PX, 3), np.uint8)
            seen.unused[name] = str(error)
        _add_best(found, seen, is_video=count > 1)
        done += count
    if progress:
        progress(total, total)
    return found


def _read_views(
    path: Path, name: str, topic: str | None
) -> Iterator[tuple[float, str, np.ndarray]]:
    """A still, or frames of a video, as the sensor saw them: share of the file before
    it, name, image.
    """
    if kind_of_file(path) == "image":
        yield 0.0, name, read_image(path, upright=False)
        return
    of_log = topic if is_robot_log(path) else None
    info = inspect_video(path, topic=of_log)
    step = max(1, info.frames // _VIDEO_FRAMES)
    for frame in read_timed_frames(path, topic=of_log):
        if frame.number % step == 0:
            share = min(frame.number / info.frames, 1.0)
            image = as_stored(frame.image, info.orientation)
            yield share, f"{name} at {frame.time_s:.2f} s", image


def _add_image(found: BoardDetections, name: str, image: np.ndarray) -> None:
    """Add the board in an image, or why it is not used, and its tile."""
    board = find_board(image, found.pattern, doubtful=True)
    if board:
        found.boards[name] = board
    else:
        columns, rows = found.pattern
        found.unused[name] = (
            f"no chessboard of {columns}x{rows} inner corners, nor a part of one"
        )
    height, width = image.shape[:2]
    scale = min(_TILE_WIDTH_PX / width, _TILE_HEIGHT_PX / height)
    small_width = max(1, round(scale * width))
    small_height = max(1, round(scale * height))
    found.tiles[name] = cv2.resize(
        image, (small_width, small_height), interpolation=cv2.INTER_AREA
    )


def _add_best(found: BoardDetections, seen: BoardDetections, *, is_video: bool) -> None:
    """Add the most different boards seen in a file, or its first image without one."""
    chosen = _most_different(seen.boards)[:_VIDEO_BOARDS]
    if not chosen:
        chosen = list(seen.tiles)[:1]
    others = f", also in {len(seen.tiles) - 1} others" if is_video else ""
    for view, tile in seen.tiles.items():
        if view not in chosen:
            continue
        found.tiles[view] = tile
        if view in seen.boards:
            found.boards[view] = seen.boards[view]
        if view in seen.unused:
            found.unused[view] = seen.unused[view] + others


def _most_different(boards: Boards) -> list[str]:
    """The names of the boards in different views, each as far from those before it as
    possible.

    Two views are the same if no outer corner differs by more than 1 % of the image's
    size.
    """
    # the four outer corners as shares of the image's size
    outlines = np.empty((len(boards), 4, 2))
    for outline, board in zip(outlines, boards.values(), strict=True):
        grid = board.corners_px.reshape(board.rows, board.columns, 2)
        outer = grid[[0, 0, -1, -1], [0, -1, 0, -1]]
        outline[:] = outer / board.size

    names = list(boards)
    chosen: list[str] = []
    distance = np.full(len(names), np.inf)
    while names and distance.max() >= 0.01:
        farthest = int(distance.argmax())
        chosen.append(names[farthest])
        change = np.abs(outlines - outlines[farthest])
        distance = np.minimum(distance, change.max(axis=(1, 2)))
    return chosen


def calibrate_detections(detections: BoardDetections, source: str) -> Camera:
    """Camera intrinsics from detected boards, as `calibrate`; `source` names the images
    in messages.
    """
    unused = ""
    for name, reason in detections.unused.items():
        unused += f"\n  {name}: {reason}"
    boards = detections.boards
    if not boards:
        columns, rows = detections.pattern
        raise CameraError(
            f"no chessboard of {columns}x{rows} inner corners was found in {source}; "
            "give images of a board of that pattern, or calibrate with the pattern of "
            f"this one.{unused}"
        )
    try:
        return calibrate_boards(boards, detections.unused)
    except CameraError as error:
        sure = sum(not board.doubtful for board in boards.values())
        hint = " Is the pattern right?" if len(detections.tiles) > 2 * sure else ""
        raise CameraError(f"{source}: {error}{hint}{unused}") from error


class _Fit(NamedTuple):
    """A lens that was fitted to boards, with its report."""

    camera: Camera
    report: CalibrationReport


class _Lens(NamedTuple):
    """Intrinsics, the error of each board (RMS, pixels), and that of the focal length
    (share).
    """

    matrix: np.ndarray
    distortion: np.ndarray
    errors_px: np.ndarray
    focal_std_share: float


def calibrate_boards(boards: Boards, unused: Reasons | None = None) -> Camera:
    """Camera intrinsics from boards in different poses, by the name of the image
    (Zhang, PAMI 2000).

    They are for images of the most frequent size, and of those that were cropped by a
    pixel or two. The report also has the `unused` images. Raises CameraError if fewer
    than three different views remain, or they do not determine the intrinsics, or fit
    neither a normal nor a fisheye lens.
    """
    sizes = Counter(board.size for board in boards.values())
    size = max(sizes, key=lambda size: (sizes[size], size))
    used = {}
    rejected = dict(unused or {})
    for name, board in boards.items():
        # cropped images: two of Udacity's differ by a pixel
        difference_px = np.abs(np.subtract(board.size, size))
        if difference_px.max() <= 2:
            used[name] = board
        else:
            rejected[name] = (
                f"image is {_in_words(board.size)} pixels, the others "
                f"{_in_words(size)}; take all with one setting"
            )

    fit = _fit_best_lens(used, size, every_board=len(used) == len(boards))
    _require_one_focal_length(_sure(used), fit)
    limit_px = _MAX_ERROR_SHARE * max(size)
    if fit.report.rms_px > limit_px:
        raise CameraError(
            "the boards fit neither a normal nor a fisheye lens "
            f"(error {fit.report.rms_px:.2f} px, at most {limit_px:.1f}). "
            "Check the pattern, that the board is flat, and that all images are of one "
            "camera that did not zoom."
        )
    rejected |= fit.report.rejected
    return replace(fit.camera, report=replace(fit.report, rejected=rejected))


def _require_one_focal_length(boards: Boards, fit: _Fit) -> None:
    """Raise CameraError if two focal lengths explain the boards, also those that one
    lens leaves out, clearly better.
    """
    if fit.camera.is_fisheye:
        return
    kept = {name: boards[name] for name in fit.report.board_rms_px}
    groups = find_focal_groups(boards, fit.camera)
    if groups:
        errors_px = groups[0].board_rms_px | groups[1].board_rms_px
        if len(kept) < len(boards) and _find_outlier(errors_px):
            groups = None
    if groups is None and len(kept) < len(boards):
        groups = find_focal_groups(kept, fit.camera)
    if groups is None:
        return

    described = ""
    for group in groups:
        names = ", ".join(sorted(group.board_rms_px, key=list(boards).index))
        described += f"\n  {group.focal_px:.0f} px: {names}"
    raise CameraError(
        "the boards have two focal lengths, so that the camera zoomed or changed its "
        "lens between them, or the board bent; calibrate each of these groups alone, "
        f"or take all images of a flat board with one setting.{described}"
    )


def _in_words(size: Size) -> str:
    width, height = size
    return f"{width}x{height}"


def _sure(boards: Boards) -> dict[str, Board]:
    return {name: board for name, board in boards.items() if not board.doubtful}


def _fit_best_lens(boards: Boards, size: Size, *, every_board: bool) -> _Fit:
    """A normal lens, or a fisheye lens if that explains the boards clearly better.

    It is tried if the normal lens leaves an error or a board, or with `every_board`
    False.
    """
    sure = _sure(boards)
    reason = (
        "its corners are not evenly spaced or hardly seen, and the lens is no fisheye "
        "lens"
    )
    doubtful = {name: reason for name in boards if name not in sure}
    try:
        fit = _fit_without_outliers(sure, size, doubtful, fisheye=False)
    except CameraError:
        if not doubtful:
            raise
        fit = _fit_with_doubtful(boards, size)

    every_board &= len(fit.report.board_rms_px) == len(boards)
    if every_board and fit.report.rms_px <= _MIN_OUTLIER_ERROR_PX:
        return fit
    with suppress(CameraError):
        fisheye = _fit_with_doubtful(boards, size)
        if _explains_more(fisheye, boards, size):
            return fisheye
    return fit


def _fit_with_doubtful(boards: Boards, size: Size) -> _Fit:
    """A fisheye lens, also from the doubtful boards that the lens of the others roughly
    explains.
    """
    sure = _sure(boards)
    try:
        camera, _ = _fit_without_outliers(sure, size, {}, fisheye=True)
    except CameraError:  # they are too few
        return _fit_without_outliers(boards, size, {}, fisheye=True)

    # the lens is not known well where no sure board was
    limit_px = 2 * _MAX_ERROR_SHARE * max(size)
    used = {}
    wrong = {}
    for name, board in boards.items():
        error_px = 0.0 if name in sure else _error_before_lens_px(board, camera)
        if error_px > limit_px:
            wrong[name] = f"error {error_px:.1f} px, it is no board"
        else:
            used[name] = board
    return _fit_without_outliers(used, size, wrong, fisheye=True)


def _error_before_lens_px(board: Board, camera: Camera) -> float:
    """Root mean square reprojection error of a board in its best pose before a fisheye
    lens.
    """
    _, turn, shift = cv2.fisheye.solvePnP(
        board.object_points.astype(float)[None],
        board.corners_px.astype(float)[None],
        camera.matrix,
        camera.distortion,
    )
    return _fisheye_error_px(board, turn, shift, camera.matrix, camera.distortion)


def _explains_more(fisheye: _Fit, boards: Boards, size: Size) -> bool:
    """Whether a fisheye lens fits its boards clearly better than a normal lens does."""
    used = {name: boards[name] for name in fisheye.report.board_rms_px}
    try:
        normal = _fit_once(used, size, {}, fisheye=False)
    except CameraError:
        return True
    # the two models fit a normal lens equally well
    return fisheye.report.rms_px < 0.8 * normal.report.rms_px


def _fit_without_outliers(
    boards: Boards, size: Size, rejected: Reasons, *, fisheye: bool
) -> _Fit:
    """Fit a lens and remove the worst board until it is not an outlier; the reasons are
    added to those `rejected`.
    """
    left = dict(boards)
    reasons = dict(rejected)
    while True:
        fit = _fit_once(left, size, reasons, fisheye=fisheye)
        errors_px = fit.report.board_rms_px
        worst = _find_outlier(errors_px)
        # With three boards it cannot be decided which one is wrong.
        if len(left) == _MIN_VIEWS or worst is None:
            return fit
        median_px = np.median(list(errors_px.values()))
        reasons[worst] = (
            f"error {errors_px[worst]:.2f} px, more than {_OUTLIER_RATIO} times the "
            f"median board's {median_px:.2f}"
        )
        del left[worst]


def _find_outlier(errors_px: Mapping[str, float]) -> str | None:
    """The board with the largest error, if that is much larger than the median."""
    worst = max(errors_px, key=errors_px.__getitem__)
    median_px = float(np.median(list(errors_px.values())))
    limit_px = max(_OUTLIER_RATIO * median_px, _MIN_OUTLIER_ERROR_PX)
    return worst if errors_px[worst] > limit_px else None


def _fit_once(boards: Boards, size: Size, rejected: Reasons, *, fisheye: bool) -> _Fit:
    """Fit a lens to all boards."""
    views = len(_most_different(boards))  # a repeated image adds no information
    if views < _MIN_VIEWS:
        raise CameraError(
            f"{views} different view(s) of the board at {_in_words(size)} pixels, but "
            f"calibration needs at least {_MIN_VIEWS}, better 15; take more images, "
            "with the board tilted each time in another direction."
        )
    fit_lens = _fit_fisheye_lens if fisheye else _fit_normal_lens
    try:
        # on several threads the result differs from run to run
        with opencv_threads(1):
            lens = fit_lens(list(boards.values()), size)
    except cv2.error as error:
        raise CameraError(
            f"these boards do not determine the intrinsics; {_ADVICE}."
        ) from error

    corners = [len(board.corners_px) for board in boards.values()]
    mean_square = np.average(lens.errors_px**2, weights=corners)
    report = CalibrationReport(
        rms_px=float(np.sqrt(mean_square)),
        board_rms_px=dict(zip(boards, lens.errors_px.tolist(), strict=True)),
        rejected=dict(rejected),
        focal_std_share=lens.focal_std_share,
    )
    return _Fit(Camera(*size, lens.matrix, lens.distortion), report)


def _fit_normal_lens(boards: list[Board], size: Size) -> _Lens:
    """A lens with five coefficients."""
    points = [board.object_points for board in boards]
    pixels = [board.corners_px for board in boards]
    # OpenCV's stubs do not say that None stands for no initial intrinsics
    _, matrix, distortion, *_, std, _, errors_px = cv2.calibrateCameraExtended(  # type: ignore[call-overload]
        points, pixels, size, None, None
    )
    focal_px = float(matrix[0, 0])
    focal_std_px = float(std[0, 0])
    # three tilted real boards reach 0.4 %, and a field of view that is assumed is off
    # by a third
    if not (np.isfinite(matrix).all() and focal_std_px <= 0.04 * focal_px):
        raise CameraError(
            "these boards do not determine the focal length "
            f"({focal_px:.0f} +- {focal_std_px:.0f} px); {_ADVICE}."
        )
    return _Lens(matrix, distortion, errors_px.ravel(), focal_std_px / focal_px)


def _fit_fisheye_lens(boards: list[Board], size: Size) -> _Lens:
    """A fisheye lens with four coefficients, and 0 for the unknown error of its focal
    length.
    """
    # begins at a view of 180 degrees across the longer side
    width, height = size
    focal_px = max(size) / np.pi
    guess = np.diag([focal_px, focal_px, 1])
    guess[0, 2] = (width - 1) / 2
    guess[1, 2] = (height - 1) / 2
    flags = cv2.CALIB_USE_INTRINSIC_GUESS
    flags |= cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_FIX_SKEW
    _, matrix, distortion, turns, shifts = cv2.fisheye.calibrate(
        [board.object_points.astype(float)[None] for board in boards],
        [board.corners_px.astype(float)[None] for board in boards],
        size,
        guess,
        np.zeros(4),
        flags=flags,
    )
    errors_px = []
    for board, turn, shift in zip(boards, turns, shifts, strict=True):
        error_px = _fisheye_error_px(board, turn, shift, matrix, distortion)
        errors_px.append(error_px)
    return _Lens(matrix, distortion, np.array(errors_px), 0.0)


def _fisheye_error_px(
    board: Board,
    turn: np.ndarray,
    shift: np.ndarray,
    matrix: np.ndarray,
    distortion: np.ndarray,
) -> float:
    """RMS reprojection error of a board in a pose before a fisheye lens."""
    points = board.object_points.astype(float)[None]
    projected, _ = cv2.fisheye.projectPoints(points, turn, shift, matrix, distortion)
    square_px = np.sum((projected - board.corners_px) ** 2, axis=-1)
    return float(np.sqrt(np.mean(square_px)))


# Summary of a calibration in words and as a contact sheet.

# Size of a tile of the contact sheet below its label, pixels, and height of the label.
_TILE_WIDTH_PX = 400
_TILE_HEIGHT_PX = 225
_LABEL_PX = 44


def describe_calibration(detections: BoardDetections, camera: Camera) -> str:
    """Text of several lines: reprojection error and use of each image, focal length,
    regions without corners.
    """
    report = camera.report
    assert report
    uses = _describe_uses(detections, camera)
    width = max(map(len, uses))
    lines = [f"{'image':<{width}}  error px  board"]
    for name, use in uses.items():
        error_px = report.board_rms_px.get(name)
        error = "-" if error_px is None else f"{error_px:.2f}"
        lines.append(f"{name:<{width}}  {error:>8}  {use}")

    used = [detections.boards[name] for name in report.board_rms_px]
    lens = "fisheye lens, " if camera.is_fisheye else ""
    lines += [
        f"{len(used)} of {len(uses)} images used, "
        f"error {report.rms_px:.2f} px (RMS of all corners)",
        f"{lens}focal length {camera.matrix[0, 0]:.1f} px, "
        f"horizontal field of view {camera.hfov_deg:.1f} deg, distortion included",
        _describe_coverage(used),
    ]
    if report.focal_std_share > 0.02:  # three tilted real boards reach 0.004
        lines.append(
            f"warning: the focal length is uncertain by {report.focal_std_share:.1%}, "
            f"and with it distances and curvature; {_ADVICE}"
        )
    return "\n".join(lines)


def _describe_coverage(boards: Iterable[Board]) -> str:
    """One sentence that names the regions of the image with fewer than ten corners: a
    row or two of one board.

    The distortion is determined only where corners were detected: a fit to the middle
    of the image does not extrapolate to its corners. It is largest in the outer
    quarters.
    """
    shares = [(board.corners_px + 0.5) / board.size for board in boards]
    u, v = np.concatenate(shares).T
    borders = [0.0, 0.25, 0.75, 1.0]
    counts, *_ = np.histogram2d(v, u, bins=[borders, borders])
    names = [
        ["upper left", "top", "upper right"],
        ["left", "middle", "right"],
        ["lower left", "bottom", "lower right"],
    ]
    missing = np.array(names)[counts < 10]
    if not missing.size:
        return "corners were detected in all regions of the image"
    regions = ", ".join(missing)
    return (
        f"few or no corners in these regions of the image: {regions}; add boards there"
    )


def _describe_uses(
    detections: BoardDetections, camera: Camera | None
) -> dict[str, str]:
    """Use of each image, by name: "used", "used, 7x6 corners of the board", or why it
    was not used.
    """
    if not (camera and camera.report):
        return dict.fromkeys(detections.tiles, "board found") | detections.unused
    uses = dict.fromkeys(detections.tiles, "used") | camera.report.rejected
    for name in camera.report.board_rms_px:
        board = detections.boards[name]
        if {board.columns, board.rows} != set(detections.pattern):
            uses[name] += f", {board.columns}x{board.rows} corners of the board"
        if board.size != camera.size:
            uses[name] += f", image of {_in_words(board.size)}"
    return uses


def draw_contact_sheet(
    detections: BoardDetections, camera: Camera | None
) -> np.ndarray:
    """Image (height, width, 3), uint8 RGB, with a tile for each board image, five in a
    row, and its corners.

    The frame of a tile is green if the image was used, yellow if a part of the board
    was used, and red if the image was not used. Without a camera, because the
    calibration was refused, it is yellow where a board was found.
    """
    uses = _describe_uses(detections, camera)
    errors_px = camera.report.board_rms_px if camera and camera.report else {}
    tiles = []
    for name, small in detections.tiles.items():
        label = uses[name]
        colour = LEFT_COLOUR
        if name in errors_px:
            label = f"{errors_px[name]:.2f} px, {label}"
            colour = LANE_COLOUR
        board = detections.boards.get(name)
        if "corners of the board" in label or (board and camera is None):
            colour = WINDOW_COLOUR
        if board:
            small = _draw_small_board(small, board)
        tiles.append(_draw_tile(small, [name, label], colour))

    columns = min(5, len(tiles))
    tiles += [np.full_like(tiles[0], PANEL_COLOUR)] * (-len(tiles) % columns)
    rows = []
    for start in range(0, len(tiles), columns):
        rows.append(np.hstack(tiles[start : start + columns]))
    return np.vstack(rows)


def _draw_small_board(small: np.ndarray, board: Board) -> np.ndarray:
    """A copy of an image that was made small, with the corners of its board."""
    scale = np.divide(small.shape[1::-1], board.size)
    corners_px = resize_points(board.corners_px, scale).astype(np.float32)
    return draw_board(small, replace(board, corners_px=corners_px))


def _draw_tile(small: np.ndarray, label: list[str], colour: Colour) -> np.ndarray:
    """A small image below its label, in a frame of that colour."""
    shape = (_LABEL_PX + _TILE_HEIGHT_PX, _TILE_WIDTH_PX, 3)
    tile = np.full(shape, PANEL_COLOUR, np.uint8)
    height, width = small.shape[:2]
    left = (_TILE_WIDTH_PX - width) // 2
    tile[_LABEL_PX:][:height, left : left + width] = small
    put_text(tile[:_LABEL_PX], label, size_px=13, panel_alpha=0)
    return cv2.copyMakeBorder(tile, 6, 6, 6, 6, cv2.BORDER_CONSTANT, value=colour)
