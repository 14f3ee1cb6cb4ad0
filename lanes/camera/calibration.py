"""Calibrate a camera from stills or videos of a chessboard, complete or partly visible; outliers are rejected.

The EXIF orientation of stills is ignored, so that portrait and landscape stills of one camera fit together.
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

from lanes.camera.chessboard import Board, draw_board, find_board
from lanes.camera.model import CalibrationReport, Camera, resize_points
from lanes.canvas import LANE_COLOUR, LEFT_COLOUR, PANEL_COLOUR, WINDOW_COLOUR, Colour, put_text
from lanes.errors import CameraError, PictureError
from lanes.video.images import as_stored, kind_of_file, opencv_threads, read_image
from lanes.video.reader import inspect_video, read_timed_frames
from lanes.video.sources import find_sources

# Two views determine the intrinsics in theory; a third makes errors visible.
_MIN_VIEWS = 3
# A board with more than this many times the median error was bent, moved or detected wrongly. On the 20 Udacity boards,
# paper on a wall, the worst one has 1.5 times the median, and one with wrong corners 2.9 times.
_OUTLIER_RATIO = 2.5
# Boards below this error are never outliers: it is the error of the corner detection in a compressed image.
_MIN_OUTLIER_ERROR_PX = 0.3
# Largest error that is plausible for a lens, as a share of the image's longer side: 3.2 pixels of 1280, where Udacity's
# boards, paper on a wall, have 0.9.
_MAX_ERROR_SHARE = 0.0025
# Frames of a video that are searched for a board, and the most that are used.
_VIDEO_FRAMES, _VIDEO_BOARDS = 60, 20
_ADVICE = "take images in which the board is tilted by 20 to 45 degrees, each time in another direction"


@dataclass(frozen=True, eq=False)
class BoardDetections:
    """Chessboards detected in images.

    `tiles` has all images by name, made small for the contact sheet. `boards` has the detected boards by the name of
    the image. `unused` has the images without a board, and the reason. `pattern` is the complete board's inner corners
    (columns, rows).
    """

    tiles: dict[str, np.ndarray]
    pattern: tuple[int, int]
    boards: dict[str, Board]
    unused: dict[str, str]


def calibrate(
    source: str | Path | Iterable[str | Path],
    pattern: tuple[int, int] = (9, 6),
    *,
    progress: Callable[[int, int], None] | None = None,
) -> Camera:
    """Camera intrinsics from images or videos of a chessboard, for their most frequent size.

    >>> camera = lanes.calibrate("boards/")  # doctest: +SKIP

    Parameters
    ----------
    source : path or iterable of paths
        A folder of images, or images, videos and folders.
    pattern : tuple of int
        The complete board's inner corners (columns, rows).
    progress : callable, optional
        Called with (images done, images in all).

    Returns
    -------
    Camera
        Without pose, for images as the sensor sees them (`Camera.turned`); a fisheye lens has four coefficients. Its
        `report` has the error of each board, and the images not used, with the reason.

    Raises
    ------
    FileNotFoundError
        If a file or folder does not exist, or a folder holds no image.
    CameraError
        If too few boards are found, or they do not determine the intrinsics, or they fit no lens.
    """
    sources = [source] if isinstance(source, str | Path) else list(source)
    detections = find_boards(find_sources(map(str, sources)).files, pattern, progress=progress)
    return calibrate_detections(detections, ", ".join(map(str, sources[:3])))


def find_boards(
    paths: Sequence[Path], pattern: tuple[int, int] = (9, 6), *, progress: Callable[[int, int], None] | None = None
) -> BoardDetections:
    """The board in every image, and in those frames of a video that show it most differently.

    Images that cannot be decoded are `unused`; one that does not exist is an error.
    """
    same_name = Counter(path.name for path in paths)
    found = BoardDetections({}, pattern, {}, {})
    # a video stands for as many images as frames of it are searched
    counts = [_VIDEO_FRAMES if kind_of_file(path) == "video" else 1 for path in paths]
    report = progress or (lambda done, total: None)
    for k, path in enumerate(paths):
        name = path.name if same_name[path.name] == 1 else str(path)
        seen = BoardDetections({}, pattern, {}, {})
        try:
            for share, view, image in _read_views(path, name):
                report(sum(counts[:k]) + int(share * counts[k]), sum(counts))
                _add_image(seen, view, image)
        except PictureError as error:
            seen.tiles[name] = np.zeros((_TILE_PX[1], _TILE_PX[0], 3), np.uint8)
            seen.unused[name] = str(error)
        chosen = _most_different(seen.boards)[:_VIDEO_BOARDS] or list(seen.tiles)[:1]
        others = f", also in {len(seen.tiles) - 1} others" if counts[k] > 1 else ""
        found.boards.update({view: board for view, board in seen.boards.items() if view in chosen})
        found.tiles.update({view: tile for view, tile in seen.tiles.items() if view in chosen})
        found.unused.update({view: reason + others for view, reason in seen.unused.items() if view in chosen})
    report(sum(counts), sum(counts))
    return found


def _read_views(path: Path, name: str) -> Iterator[tuple[float, str, np.ndarray]]:
    """A still, or frames of a video, as the sensor saw them: share of the file before it, name, image."""
    if kind_of_file(path) != "video":
        yield 0.0, name, read_image(path, upright=False)
        return
    info = inspect_video(path)
    count, orientation = info.frames, info.orientation
    for frame in read_timed_frames(path):
        if frame.number % max(1, count // _VIDEO_FRAMES) == 0:
            share = min(frame.number / count, 1.0)
            yield share, f"{name} at {frame.time_s:.2f} s", as_stored(frame.image, orientation)


def _add_image(found: BoardDetections, name: str, image: np.ndarray) -> None:
    if board := find_board(image, found.pattern, doubtful=True):
        found.boards[name] = board
    else:
        found.unused[name] = "no chessboard of {}x{} inner corners, nor a part of one".format(*found.pattern)
    scale = min(_TILE_PX[0] / image.shape[1], _TILE_PX[1] / image.shape[0])
    size = [max(1, round(scale * length)) for length in image.shape[1::-1]]
    found.tiles[name] = cv2.resize(image, size, interpolation=cv2.INTER_AREA)


def _most_different(boards: Mapping[str, Board]) -> list[str]:
    """The names of the boards in different views, each as far from those before it as possible.

    Two views are the same if no outer corner differs by more than 1 % of the image's size.
    """
    grids = [(board.corners_px.reshape(board.rows, board.columns, 2), board.size) for board in boards.values()]
    # the four outer corners as shares of the image's size
    outlines = np.array([grid[[0, 0, -1, -1], [0, -1, 0, -1]] / size for grid, size in grids])
    chosen: list[int] = []
    distance = np.full(len(boards), np.inf)
    while len(boards) and distance.max() >= 0.01:
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.abs(outlines - outlines[chosen[-1]]).max(axis=(1, 2)))
    return [list(boards)[index] for index in chosen]


def calibrate_detections(detections: BoardDetections, source: str) -> Camera:
    """Camera intrinsics from detected boards, as `calibrate`; `source` names the images in messages."""
    unused = "".join(f"\n  {name}: {reason}" for name, reason in detections.unused.items())
    if not detections.boards:
        raise CameraError(
            f"no chessboard of {detections.pattern[0]}x{detections.pattern[1]} inner corners was found in "
            f"{source}; give images of a board of that pattern, or calibrate with the pattern of this one.{unused}"
        )
    try:
        return calibrate_boards(detections.boards, detections.unused)
    except CameraError as error:
        sure = sum(not board.doubtful for board in detections.boards.values())
        hint = " Is the pattern right?" if len(detections.tiles) > 2 * sure else ""
        raise CameraError(f"{source}: {error}{hint}{unused}") from error


class _Fit(NamedTuple):
    """A lens that was fitted to boards, with its report."""

    camera: Camera
    report: CalibrationReport


def calibrate_boards(boards: Mapping[str, Board], unused: Mapping[str, str] | None = None) -> Camera:
    """Camera intrinsics from boards in different poses, by the name of the image (Zhang, PAMI 2000).

    They are for images of the most frequent size, and of those that were cropped by a pixel or two. The report also has
    the `unused` images. Raises CameraError if fewer than three different views remain, or they do not determine the
    intrinsics, or fit neither a normal nor a fisheye lens.
    """
    sizes = Counter(board.size for board in boards.values())
    size = max(sizes, key=lambda size: (sizes[size], size))
    # cropped images: two of Udacity's differ by a pixel
    used = {name: board for name, board in boards.items() if np.abs(np.subtract(board.size, size)).max() <= 2}
    reason = "image is {}x{} pixels, the others {}x{}; take all with one setting"
    rejected = {name: reason.format(*board.size, *size) for name, board in boards.items() if name not in used}
    sure = {name: board for name, board in used.items() if not board.doubtful}
    reason = "its corners are not evenly spaced or hardly seen, and the lens is no fisheye lens"
    doubtful = {name: reason for name in used if name not in sure}
    try:
        fit = _fit_without_outliers(sure, size, doubtful, fisheye=False)
    except CameraError:
        if not doubtful:
            raise
        fit = _fit_with_doubtful(used, size)
    if fit.report.rms_px > _MIN_OUTLIER_ERROR_PX or len(fit.report.board_rms_px) < len(boards):
        with suppress(CameraError):
            fisheye = _fit_with_doubtful(used, size)
            fit = fisheye if _explains_more(fisheye, used, size) else fit
    rms_px, limit_px = fit.report.rms_px, _MAX_ERROR_SHARE * max(size)
    if rms_px > limit_px:
        raise CameraError(
            f"the boards fit neither a normal nor a fisheye lens (error {rms_px:.2f} px, at most {limit_px:.1f}). "
            "Check the pattern, that the board is flat, and that all images are of one camera that did not zoom."
        )
    rejected = {**(unused or {}), **rejected, **fit.report.rejected}
    return replace(fit.camera, report=replace(fit.report, rejected=rejected))


def _fit_with_doubtful(boards: dict[str, Board], size: tuple[int, int]) -> _Fit:
    """A fisheye lens, also from the doubtful boards that the lens of the others roughly explains."""
    sure = {name: board for name, board in boards.items() if not board.doubtful}
    try:
        fit = _fit_without_outliers(sure, size, {}, fisheye=True)
    except CameraError:  # they are too few
        return _fit_without_outliers(boards, size, {}, fisheye=True)
    lens, wrong = (fit.camera.matrix, fit.camera.distortion), {}
    for name in (name for name in boards if name not in sure):
        points, pixels = boards[name].object_points.astype(float)[None], boards[name].corners_px.astype(float)[None]
        _, turn, shift = cv2.fisheye.solvePnP(points, pixels, *lens)
        error_px = _fisheye_error_px(points, pixels, turn, shift, lens)
        # the lens is not known well where no sure board was
        if error_px > 2 * _MAX_ERROR_SHARE * max(size):
            wrong[name] = f"error {error_px:.1f} px, it is no board"
    used = {name: board for name, board in boards.items() if name not in wrong}
    return _fit_without_outliers(used, size, wrong, fisheye=True)


def _explains_more(fisheye: _Fit, boards: dict[str, Board], size: tuple[int, int]) -> bool:
    """Whether a fisheye lens fits its boards clearly better than a normal lens does."""
    try:
        normal = _fit_once({name: boards[name] for name in fisheye.report.board_rms_px}, size, {}, fisheye=False)
    except CameraError:
        return True
    return fisheye.report.rms_px < 0.8 * normal.report.rms_px  # the two models fit a normal lens equally well


def _fit_without_outliers(
    boards: dict[str, Board], size: tuple[int, int], rejected: dict[str, str], *, fisheye: bool
) -> _Fit:
    """Fit a lens and remove the worst board until it is not an outlier; the reasons are added to those `rejected`."""
    while True:
        fit = _fit_once(boards, size, rejected, fisheye=fisheye)
        errors_px = fit.report.board_rms_px
        worst = max(errors_px, key=errors_px.__getitem__)
        error_px, median_px = errors_px[worst], float(np.median(list(errors_px.values())))
        # With three boards it cannot be decided which one is wrong.
        if len(boards) == _MIN_VIEWS or error_px <= max(_OUTLIER_RATIO * median_px, _MIN_OUTLIER_ERROR_PX):
            return fit
        reason = f"error {error_px:.2f} px, more than {_OUTLIER_RATIO} times the median board's {median_px:.2f}"
        rejected = rejected | {worst: reason}
        boards = {name: board for name, board in boards.items() if name != worst}


def _fit_once(boards: dict[str, Board], size: tuple[int, int], rejected: dict[str, str], *, fisheye: bool) -> _Fit:
    views = len(_most_different(boards))  # a repeated image adds no information
    if views < _MIN_VIEWS:
        raise CameraError(
            f"{views} different view(s) of the board at {size[0]}x{size[1]} pixels, but calibration needs at least "
            f"{_MIN_VIEWS}, better 15; take more images, with the board tilted each time in another direction."
        )
    points, pixels = [board.object_points for board in boards.values()], [board.corners_px for board in boards.values()]
    try:
        # on several threads the result differs from run to run
        with opencv_threads(1):
            fit_lens = _fit_fisheye_lens if fisheye else _fit_normal_lens
            matrix, distortion, errors_px, focal_std_share = fit_lens(points, pixels, size)
    except cv2.error as error:
        raise CameraError(f"these boards do not determine the intrinsics; {_ADVICE}.") from error
    rms_px = float(np.sqrt(np.average(errors_px**2, weights=[len(corners) for corners in pixels])))
    errors = dict(zip(boards, errors_px.tolist(), strict=True))
    report = CalibrationReport(rms_px, errors, rejected, focal_std_share=focal_std_share)
    return _Fit(Camera(*size, matrix, distortion), report)


def _fit_normal_lens(
    points: list[np.ndarray], pixels: list[np.ndarray], size: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Camera matrix, five coefficients, the error of each board (RMS, pixels), and that of the focal length (share)."""
    # OpenCV's stubs do not say that None stands for no initial intrinsics
    _, matrix, distortion, *_, std, _, errors_px = cv2.calibrateCameraExtended(  # type: ignore[call-overload]
        points, pixels, size, None, None
    )
    focal, focal_std = float(matrix[0, 0]), float(std[0, 0])
    # three tilted real boards reach 0.4 %, and a field of view that is assumed is off by a third
    if not (np.isfinite(matrix).all() and focal_std <= 0.04 * focal):
        raise CameraError(
            f"these boards do not determine the focal length ({focal:.0f} +- {focal_std:.0f} px); {_ADVICE}."
        )
    return matrix, distortion, errors_px.ravel(), focal_std / focal


def _fit_fisheye_lens(
    points: list[np.ndarray], pixels: list[np.ndarray], size: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """As `_fit_normal_lens`, with the four coefficients of a fisheye lens, and 0 for the unknown last error."""
    on_board, in_image = ([part.astype(float)[None] for part in group] for group in (points, pixels))
    # begins at a view of 180 degrees across the longer side
    focal_px = max(size) / np.pi
    guess = np.array([[focal_px, 0, (size[0] - 1) / 2], [0, focal_px, (size[1] - 1) / 2], [0, 0, 1]])
    flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_FIX_SKEW
    _, matrix, distortion, turns, shifts = cv2.fisheye.calibrate(
        on_board, in_image, size, guess, np.zeros(4), flags=flags
    )
    boards = zip(on_board, in_image, turns, shifts, strict=True)
    errors_px = [_fisheye_error_px(*board, (matrix, distortion)) for board in boards]
    return matrix, distortion, np.array(errors_px), 0.0


def _fisheye_error_px(
    points: np.ndarray, pixels: np.ndarray, turn: np.ndarray, shift: np.ndarray, lens: tuple[np.ndarray, np.ndarray]
) -> float:
    """Root mean square reprojection error of a board in a pose before a fisheye lens."""
    projected, _ = cv2.fisheye.projectPoints(points, turn, shift, *lens)
    return float(np.sqrt(np.mean(np.sum((projected - pixels) ** 2, axis=-1))))


# Summary of a calibration in words and as a contact sheet.

# Size of a tile of the contact sheet below its label, pixels.
_TILE_PX = (400, 225)


def describe_calibration(detections: BoardDetections, camera: Camera) -> str:
    """Text of several lines: reprojection error and use of each image, focal length, regions without corners."""
    assert camera.report
    report, uses = camera.report, _describe_uses(detections, camera)
    width = max(map(len, uses))
    lines = [f"{'image':<{width}}  error px  board"]
    for name, use in uses.items():
        error = f"{report.board_rms_px[name]:.2f}" if name in report.board_rms_px else "-"
        lines.append(f"{name:<{width}}  {error:>8}  {use}")
    lines += [
        f"{len(report.board_rms_px)} of {len(uses)} images used, error {report.rms_px:.2f} px (RMS of all corners)",
        f"{'fisheye lens, ' if camera.is_fisheye else ''}focal length {camera.matrix[0, 0]:.1f} px, "
        f"horizontal field of view {camera.hfov_deg:.1f} deg, distortion included",
        _describe_coverage([detections.boards[name] for name in report.board_rms_px]),
    ]
    if (share := report.focal_std_share) > 0.02:  # three tilted real boards reach 0.004
        uncertain = f"the focal length is uncertain by {share:.1%}, and with it distances and curvature"
        lines.append(f"warning: {uncertain}; {_ADVICE}")
    return "\n".join(lines)


def _describe_coverage(boards: Iterable[Board]) -> str:
    """One sentence that names the regions of the image with fewer than ten corners: a row or two of one board.

    The distortion is determined only where corners were detected: a fit to the middle of the image does not
    extrapolate to its corners. It is largest in the outer quarters.
    """
    u, v = np.concatenate([(board.corners_px + 0.5) / board.size for board in boards]).T
    borders = [0.0, 0.25, 0.75, 1.0]
    counts = np.histogram2d(v, u, bins=[borders, borders])[0].ravel()
    names = "upper left", "top", "upper right", "left", "middle", "right", "lower left", "bottom", "lower right"
    missing = [name for name, count in zip(names, counts, strict=True) if count < 10]
    if not missing:
        return "corners were detected in all regions of the image"
    return f"few or no corners in these regions of the image: {', '.join(missing)}; add boards there"


def _describe_uses(detections: BoardDetections, camera: Camera | None) -> dict[str, str]:
    """Use of each image, by name: "used", "used, 7x6 corners of the board", or why it was not used."""
    if not (camera and camera.report):
        return dict.fromkeys(detections.tiles, "board found") | detections.unused
    uses = dict.fromkeys(detections.tiles, "used") | camera.report.rejected
    for name in camera.report.board_rms_px:
        board = detections.boards[name]
        if {board.columns, board.rows} != set(detections.pattern):
            uses[name] += f", {board.columns}x{board.rows} corners of the board"
        if board.size != camera.size:
            uses[name] += f", image of {board.size[0]}x{board.size[1]}"
    return uses


def draw_contact_sheet(detections: BoardDetections, camera: Camera | None) -> np.ndarray:
    """Image (height, width, 3), uint8 RGB, with a tile for each board image, five in a row, and its corners.

    The frame of a tile is green if the image was used, yellow if a part of the board was used, and red if the image
    was not used. Without a camera, because the calibration was refused, it is yellow where a board was found.
    """
    uses, errors = _describe_uses(detections, camera), camera.report.board_rms_px if camera and camera.report else {}
    tiles = []
    for name, small in detections.tiles.items():
        if board := detections.boards.get(name):
            corners = resize_points(board.corners_px, np.divide(small.shape[1::-1], board.size)).astype(np.float32)
            small = draw_board(small, replace(board, corners_px=corners))
        label = [name, f"{errors[name]:.2f} px, {uses[name]}" if name in errors else uses[name]]
        in_part = "corners of the board" in uses[name] or (camera is None and board)
        colour = WINDOW_COLOUR if in_part else LANE_COLOUR if name in errors else LEFT_COLOUR
        tiles.append(_draw_tile(small, label, colour))
    columns = min(5, len(tiles))
    tiles += [np.full_like(tiles[0], PANEL_COLOUR)] * (-len(tiles) % columns)
    return np.vstack([np.hstack(tiles[start : start + columns]) for start in range(0, len(tiles), columns)])


def _draw_tile(small: np.ndarray, label: list[str], colour: Colour) -> np.ndarray:
    """A small image below a label of 44 pixels, in a frame of that colour."""
    tile = np.full((_TILE_PX[1] + 44, _TILE_PX[0], 3), PANEL_COLOUR, np.uint8)
    left = (_TILE_PX[0] - small.shape[1]) // 2
    tile[44 : 44 + small.shape[0], left : left + small.shape[1]] = small
    put_text(tile[:44], label, size_px=13, panel_alpha=0)
    return cv2.copyMakeBorder(tile, 6, 6, 6, 6, cv2.BORDER_CONSTANT, value=colour)
