"""The classic lane finder in one file: read it from top to bottom, in the order of the
course's chapters 2 to 8.

It needs NumPy, OpenCV and moviepy only: copy it next to your own notebook. Three
published answers to Udacity's project "Advanced Lane Finding" are *recipes* here:

- "hls_sobel" (A): warp the colour image; saturation or gradients; mean of five fits;
- "equalized_hsv" (B): brightest or yellow pixels or edges; mean of ten fits;
- "best_channel" (C): six binaries, the best one for each line; mean of thirty fits.

Their numbers are the published ones. Where the originals had defects, this file differs
from them, and tests/test_helpers_*.py have a test for each difference.

Images are RGB, uint8, (height, width, 3). Points are (u, v), column and row, pixels.
Road points are (x, y), x forward and y to the left, metres.
"""

from __future__ import annotations

import csv
import io
import os
import re
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike

Points = Sequence[Sequence[float]]
Colour = tuple[int, int, int]

# 2. Calibrate the camera

IMAGE_FILES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp")
# Smallest part of a board that is used: fewer corners occur by chance in textures.
MIN_COLUMNS = 5
MIN_ROWS = 4
# Largest distance of a corner from an even grid, as a share of a square. Measured on
# Udacity's boards: up to 0.16 because of the lens, 0.39 or more if a row is skipped.
MAX_UNEVENNESS = 0.25
# A board with more than this many times the median error was bent, moved or detected
# wrongly. The worst of Udacity's boards, paper on a wall, has 1.5 times the median.
MAX_ERROR_RATIO = 2.5
# Boards are never left out below this error: it is that of the corners in a JPEG.
MIN_ERROR_PX = 0.3
# Two of Udacity's images are one pixel larger than the others, which does no harm.
MAX_CROP_PX = 2


def require_rgb(image: np.ndarray) -> np.ndarray:
    """The image, contiguous in memory; ValueError if it is not RGB, uint8."""
    if not isinstance(image, np.ndarray):
        raise ValueError(
            f"expected an RGB image, got {type(image).__name__}; "
            "read it with read_image."
        )
    is_rgb = image.ndim == 3 and image.shape[-1] == 3 and image.dtype == np.uint8
    if not is_rgb:
        raise ValueError(
            "expected an RGB image of shape (height, width, 3) and dtype uint8, "
            f"got shape {image.shape}, dtype {image.dtype}; read it with read_image."
        )
    if not image.size:
        raise ValueError(
            f"image holds no pixels (shape {image.shape}); check how it was cropped."
        )
    return np.ascontiguousarray(image)


def require_size(image: np.ndarray, size: tuple[int, int], owner: str) -> None:
    """ValueError if an image is not of the size (width, height) of the lens or warp."""
    height, width = image.shape[:2]
    if (width, height) != tuple(size):
        raise ValueError(
            f"the image is {width}x{height} pixels, but this {owner} is for "
            f"{size[0]}x{size[1]}; use images of that size, or another {owner}."
        )


def read_image(path: str | Path) -> np.ndarray:
    """The RGB image (height, width, 3), uint8, of a file.

    Raises OSError if the file does not exist, is cut off or is no image.
    """
    data = np.frombuffer(Path(path).read_bytes(), np.uint8)
    bgr = None
    if data.size:
        bgr = cv2.imdecode(data, cv2.IMREAD_COLOR)
    if bgr is None:
        raise OSError(
            f"{path}: cannot be decoded as an image; it is empty, cut off or of "
            "another format: copy it again, or convert it to JPEG."
        )
    return cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)


@contextmanager
def complete_file(path: Path) -> Iterator[Path]:
    """Another name to write a file under; it is renamed if the block succeeds."""
    partial_path = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        # a folder that cannot be written to is reported before the work
        partial_path.touch()
        yield partial_path
        os.replace(partial_path, path)
    finally:
        partial_path.unlink(missing_ok=True)


def write_image(path: str | Path, image: np.ndarray) -> Path:
    """Write an RGB image (height, width, 3), uint8; returns the path.

    The format is that of the name's suffix, and the folder is created where needed.
    Raises ValueError if the image is not RGB or the suffix is not known.
    """
    path = Path(path)
    if path.suffix.lower() not in IMAGE_FILES:
        raise ValueError(f"{path}: end the name in .jpg or .png.")
    bgr = cv2.cvtColor(require_rgb(image), cv2.COLOR_RGB2BGR)
    options = []
    if path.suffix.lower() in (".jpg", ".jpeg"):
        # clean edges at about a fifth of the size of a PNG
        options = [cv2.IMWRITE_JPEG_QUALITY, 92]
    _, data = cv2.imencode(path.suffix, bgr, options)
    path.parent.mkdir(parents=True, exist_ok=True)
    with complete_file(path) as partial_path:
        partial_path.write_bytes(data.tobytes())
    return path


@dataclass(frozen=True, eq=False)
class Lens:
    """What calibration finds out about a camera, for images of one size.

    `distortion` are k1, k2, p1, p2, k3 in OpenCV's order. `board_rms_px` has the
    reprojection error of each board by the name of its file, `not_used` the files that
    were left out, with the reason.
    """

    matrix: np.ndarray  # (3, 3), pixels
    distortion: np.ndarray  # (5,)
    size: tuple[int, int]  # (width, height)
    rms_px: float = 0.0  # of all corners
    board_rms_px: Mapping[str, float] = field(default_factory=dict)
    not_used: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        matrix = np.asarray(self.matrix, float)
        distortion = np.asarray(self.distortion, float).ravel()
        if matrix.shape != (3, 3) or distortion.size not in (5, 8):
            raise ValueError(
                f"the matrix must be (3, 3), got {matrix.shape}; the distortion k1, "
                f"k2, p1, p2, k3, got {distortion.size} numbers; take those of "
                "cv2.calibrateCamera."
            )
        object.__setattr__(self, "matrix", matrix)
        object.__setattr__(self, "distortion", distortion)

    @cached_property
    def maps(self) -> tuple[np.ndarray, np.ndarray]:
        """Where `undistort` fetches each pixel; making them takes ten times as long."""
        return cv2.initUndistortRectifyMap(
            cameraMatrix=self.matrix,
            distCoeffs=self.distortion,
            R=np.eye(3),
            newCameraMatrix=self.matrix,
            size=self.size,
            m1type=cv2.CV_16SC2,
        )


class Board(NamedTuple):
    """Inner corners of a chessboard, or of the part of it that is visible."""

    points: np.ndarray  # (N, 3) on the board, squares, z = 0
    corners_px: np.ndarray  # (N, 2) in the image
    size: tuple[int, int]  # (width, height) of the image


class LensFit(NamedTuple):
    """Result of one call of calibrateCamera."""

    rms_px: float
    matrix: np.ndarray
    distortion: np.ndarray
    errors_px: dict[str, float]  # RMS of each board


def calibrate(
    board_files: str | Path | Iterable[str | Path], corners: tuple[int, int] = (9, 6)
) -> Lens:
    """Lens from images of a chessboard in different positions (Zhang, PAMI 2000).

    `board_files` is a folder or a list of files, `corners` the board's inner corners
    (columns, rows). Boards that the image border cuts off count with their visible
    part. Images without a board, images of another size and boards that fit far worse
    than the others are left out; `Lens.not_used` names them.

    Raises OSError if a file cannot be read, ValueError if fewer than three boards
    remain.
    """
    boards: dict[str, Board] = {}
    not_used: dict[str, str] = {}
    for file in list_images(board_files):
        gray = cv2.cvtColor(read_image(file), cv2.COLOR_RGB2GRAY)
        board = find_board(gray, corners)
        if board is None:
            columns, rows = corners
            not_used[file.name] = (
                f"no board of {columns}x{rows} corners, nor a part of it"
            )
        else:
            boards[file.name] = board

    size = most_frequent_size(boards)
    for name, board in list(boards.items()):
        difference = np.abs(np.subtract(board.size, size))
        if difference.max() > MAX_CROP_PX:
            not_used[name] = (
                f"is {board.size[0]}x{board.size[1]}, not {size[0]}x{size[1]}"
            )
            del boards[name]

    fit = fit_lens(boards, size, not_used)
    while (worst := find_outlier(fit.errors_px)) is not None:
        median_px = np.median(list(fit.errors_px.values()))
        error_px = fit.errors_px[worst]
        not_used[worst] = (
            f"error {error_px:.2f} px, the median board {median_px:.2f} px"
        )
        del boards[worst]
        fit = fit_lens(boards, size, not_used)
    return Lens(
        matrix=fit.matrix,
        distortion=fit.distortion,
        size=size,
        rms_px=fit.rms_px,
        board_rms_px=fit.errors_px,
        not_used=not_used,
    )


def list_images(files: str | Path | Iterable[str | Path]) -> list[Path]:
    """The images of a folder, or the listed files; 2 comes before 10."""
    if isinstance(files, str | Path) and Path(files).is_dir():
        inside = Path(files).iterdir()
        listed = [path for path in inside if path.suffix.lower() in IMAGE_FILES]
    elif isinstance(files, str | Path):
        listed = [Path(files)]
    else:
        listed = [Path(path) for path in files]
    names = Counter(path.name for path in listed)
    repeated = [name for name, count in names.items() if count > 1]
    if repeated:
        raise ValueError(f"two boards are called {repeated[0]}; rename one of them.")
    return sorted(listed, key=natural_order)


def natural_order(path: Path) -> list:
    """Sort key in which numbers are compared as numbers."""
    parts = re.split(r"(\d+)", path.name)
    return [int(part) if part.isdecimal() else part for part in parts]


def find_board(gray: np.ndarray, corners: tuple[int, int] = (9, 6)) -> Board | None:
    """The largest visible part of a chessboard in a gray image; None if there is none.

    The corners are refined to sub-pixel accuracy (`cv2.cornerSubPix`).
    """
    height, width = gray.shape
    for columns, rows in smaller_grids(corners):
        for finder in (cv2.findChessboardCorners, cv2.findChessboardCornersSB):
            found, rough = finder(gray, (columns, rows))
            if not found:
                continue
            grid = np.asarray(rough, np.float32).reshape(rows, columns, 2)
            points = board_points(columns, rows)
            if unevenness(grid, points) <= MAX_UNEVENNESS:
                fine = refine_corners(gray, grid)
                return Board(points, fine, (width, height))
    return None


def smaller_grids(corners: tuple[int, int]) -> list[tuple[int, int]]:
    """The whole board (columns, rows) and its parts, the largest first."""
    columns, rows = corners
    least_columns = min(MIN_COLUMNS, columns)
    least_rows = min(MIN_ROWS, rows)
    grids = [
        (some_columns, some_rows)
        for some_columns in range(least_columns, columns + 1)
        for some_rows in range(least_rows, rows + 1)
    ]
    return sorted(grids, key=np.prod, reverse=True)


def board_points(columns: int, rows: int) -> np.ndarray:
    """Corners (N, 3) on the board, row by row: (0, 0, 0), (1, 0, 0), ..."""
    points = np.zeros((rows * columns, 3), np.float32)
    points[:, :2] = np.mgrid[:columns, :rows].T.reshape(-1, 2)
    return points


def unevenness(grid: np.ndarray, points: np.ndarray) -> float:
    """Largest distance of corners (rows, columns, 2) from an even grid, in squares."""
    pixels = grid.reshape(-1, 2)
    homography, _ = cv2.findHomography(points[:, :2], pixels)
    if homography is None:
        return np.inf
    even = cv2.perspectiveTransform(points[:, None, :2], homography)[:, 0]
    distances_px = np.linalg.norm(even - pixels, axis=1)
    return float(distances_px.max() / smallest_square_px(grid))


def smallest_square_px(grid: np.ndarray) -> float:
    """Shortest distance between neighbours in a grid of corners (rows, columns, 2)."""
    along_rows = np.linalg.norm(np.diff(grid, axis=1), axis=2)
    along_columns = np.linalg.norm(np.diff(grid, axis=0), axis=2)
    return float(min(along_rows.min(), along_columns.min()))


def refine_corners(gray: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Corners (N, 2) to a fraction of a pixel (Foerstner and Guelch, 1987)."""
    # a larger window reaches other corners, a smaller one is noisier
    half_window_px = int(np.clip(smallest_square_px(grid) / 3, 2, 11))
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 60, 1e-4)
    refined = cv2.cornerSubPix(
        image=gray,
        corners=grid.reshape(-1, 1, 2).copy(),
        winSize=(half_window_px, half_window_px),
        zeroZone=(-1, -1),
        criteria=criteria,
    )
    return refined.reshape(-1, 2)


def most_frequent_size(boards: Mapping[str, Board]) -> tuple[int, int]:
    """Size (width, height) that most boards have; (0, 0) without boards."""
    counts = Counter(board.size for board in boards.values())
    if not counts:
        return 0, 0
    return counts.most_common(1)[0][0]


def fit_lens(
    boards: Mapping[str, Board], size: tuple[int, int], not_used: Mapping[str, str]
) -> LensFit:
    """Lens that fits the boards best; ValueError if there are fewer than three."""
    if len(boards) < 3:
        reasons = "".join(f"\n  {name}: {why}" for name, why in not_used.items())
        raise ValueError(
            f"only {len(boards)} images show a board that can be used, but a "
            "calibration needs three, better 15; take more, tilted to different sides, "
            f"or give the number of inner corners of your board.{reasons}"
        )
    # several threads sum in another order each time: the last digits would change
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        result = cv2.calibrateCameraExtended(
            objectPoints=[board.points for board in boards.values()],
            imagePoints=[board.corners_px for board in boards.values()],
            imageSize=size,
            # no first guess: they are overwritten
            cameraMatrix=np.eye(3),
            distCoeffs=np.zeros(5),
        )
    except cv2.error as error:
        raise ValueError(
            "these boards do not determine the lens; take images in which the board is "
            "tilted by 20 to 45 degrees, each time to another side."
        ) from error
    finally:
        cv2.setNumThreads(threads)
    rms_px, matrix, distortion = result[:3]
    errors_px = dict(zip(boards, result[-1].ravel().tolist(), strict=True))
    return LensFit(rms_px, matrix, distortion.ravel()[:5], errors_px)


def find_outlier(errors_px: Mapping[str, float]) -> str | None:
    """Name of the board that fits worst, if it fits far worse than the others."""
    # of three boards nobody can say which one is wrong
    if len(errors_px) <= 3:
        return None
    worst = max(errors_px, key=errors_px.__getitem__)
    median_px = float(np.median(list(errors_px.values())))
    limit_px = max(MAX_ERROR_RATIO * median_px, MIN_ERROR_PX)
    return worst if errors_px[worst] > limit_px else None


# 3. Undistort the image


def undistort(image: np.ndarray, lens: Lens) -> np.ndarray:
    """The RGB image (height, width, 3) that a lens without distortion would have taken.

    Raises ValueError if the image is not RGB, or not of the lens's size.
    """
    image = require_rgb(image)
    require_size(image, lens.size, "lens")
    map_u, map_v = lens.maps
    return cv2.remap(image, map_u, map_v, cv2.INTER_LINEAR)


def undistort_points(points_px: ArrayLike, lens: Lens) -> np.ndarray:
    """Points (N, 2) of the undistorted image for points (N, 2) of the raw one."""
    points = np.asarray(points_px, float).reshape(-1, 1, 2)
    if not len(points):
        return np.empty((0, 2))
    # five steps, OpenCV's default, leave errors of pixels in the corners of wide lenses
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 1000, 1e-12)
    undistorted = cv2.undistortPoints(
        src=points,
        cameraMatrix=lens.matrix,
        distCoeffs=lens.distortion,
        P=lens.matrix,
        criteria=criteria,
    )
    return undistorted.reshape(-1, 2)


def distort_points(points_px: ArrayLike, lens: Lens) -> np.ndarray:
    """Points (N, 2) of the raw image for points (N, 2) of the undistorted one.

    They are NaN where the lens model does not hold: far outside the image its
    polynomial turns back and would place them inside.
    """
    points = np.asarray(points_px, float).reshape(-1, 2)
    if not len(points):
        return np.empty((0, 2))
    homogeneous = np.column_stack([points, np.ones(len(points))])
    rays = homogeneous @ np.linalg.inv(lens.matrix).T
    no_rotation = no_translation = np.zeros(3)
    raw, _ = cv2.projectPoints(
        objectPoints=rays,
        rvec=no_rotation,
        tvec=no_translation,
        cameraMatrix=lens.matrix,
        distCoeffs=lens.distortion,
    )
    raw = raw.reshape(-1, 2)
    there_and_back = undistort_points(raw, lens)
    off_px = np.linalg.norm(there_and_back - points, axis=1)
    raw[~(off_px < 1)] = np.nan
    return raw


# 4. Look at the road from above


@dataclass(frozen=True, eq=False)
class FourPointWarp:
    """Homography from four points of the undistorted image to the bird's-eye view.

    If the four points form a rectangle on a flat road, the view is a map of the road
    with two constant scales. Those of the recipes were chosen by eye and do so only
    roughly. Raises ValueError if the points do not go around a convex quadrangle.
    """

    source_px: np.ndarray  # (4, 2) in the undistorted image, around the quadrangle
    destination_px: np.ndarray  # (4, 2), the same points in the bird's-eye view
    size: tuple[int, int]  # (width, height) of both
    matrix: np.ndarray = field(init=False, repr=False)
    inverse: np.ndarray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        source = require_quadrangle(self.source_px, "source_px")
        destination = require_quadrangle(self.destination_px, "destination_px")
        matrix = cv2.getPerspectiveTransform(source, destination)
        object.__setattr__(self, "source_px", source)
        object.__setattr__(self, "destination_px", destination)
        object.__setattr__(self, "matrix", matrix)
        object.__setattr__(self, "inverse", np.linalg.inv(matrix))

    def image_to_birdseye(self, image: np.ndarray) -> np.ndarray:
        """Bird's-eye view of an undistorted RGB image, or of a binary (height, width).

        Raises ValueError if the image is neither, or not of the warp's size.
        """
        is_array = isinstance(image, np.ndarray)
        is_binary = is_array and image.ndim == 2 and image.dtype == np.uint8
        if not is_binary:
            image = require_rgb(image)
        require_size(image, self.size, "warp")
        # a binary keeps its two values
        interpolation = cv2.INTER_NEAREST if is_binary else cv2.INTER_LINEAR
        return cv2.warpPerspective(image, self.matrix, self.size, flags=interpolation)

    def points_to_birdseye(self, points_px: ArrayLike) -> np.ndarray:
        """Points (N, 2) of the bird's-eye view for points (N, 2) of the image."""
        return transform_points(points_px, self.matrix)

    def points_to_image(self, points_px: ArrayLike) -> np.ndarray:
        """Points (N, 2) of the undistorted image for points (N, 2) of the view."""
        return transform_points(points_px, self.inverse)


def require_quadrangle(points_px: ArrayLike, name: str) -> np.ndarray:
    """Four points (4, 2), float32; ValueError unless they go around a quadrangle."""
    points = np.array(points_px, np.float32)
    is_quadrangle = (
        points.shape == (4, 2)
        and bool(np.isfinite(points).all())
        # for other points OpenCV returns a useless homography without a word
        and cv2.isContourConvex(points)
    )
    if not is_quadrangle:
        raise ValueError(
            f"{name}: expected four points (u, v) in order around a convex quadrangle, "
            f"got {points.tolist()}."
        )
    return points


def transform_points(points_px: ArrayLike, matrix: np.ndarray) -> np.ndarray:
    """Points (N, 2) behind a homography (3, 3)."""
    points = np.asarray(points_px, float).reshape(-1, 2)
    if not len(points):
        return points
    return cv2.perspectiveTransform(points[:, None], matrix)[:, 0]


def road_homography(
    lens: Lens,
    *,
    height_m: float,
    pitch_rad: float,
    yaw_rad: float = 0.0,
    roll_rad: float = 0.0,
) -> np.ndarray:
    """Homography (3, 3) from undistorted pixels (u, v, 1) to the flat road (x, y, 1).

    The camera is `height_m` above the road; pitch > 0 looks down, yaw > 0 looks left,
    roll > 0 has the right side down. The third number, before the division, is 1 /
    depth in 1/m: it is 0 at the horizon and negative above it. Raises ValueError if a
    number is not finite, or the height not positive.
    """
    numbers = (height_m, pitch_rad, yaw_rad, roll_rad)
    if not np.isfinite(numbers).all() or height_m <= 0:
        raise ValueError(
            f"height {height_m} m, pitch {pitch_rad}, yaw {yaw_rad}, roll {roll_rad} "
            "rad: give finite numbers, and a positive height above the road."
        )
    sin_pitch, cos_pitch = np.sin(pitch_rad), np.cos(pitch_rad)
    sin_yaw, cos_yaw = np.sin(yaw_rad), np.cos(yaw_rad)
    sin_roll, cos_roll = np.sin(roll_rad), np.cos(roll_rad)
    yaw = np.array([[cos_yaw, -sin_yaw, 0], [sin_yaw, cos_yaw, 0], [0, 0, 1]])
    pitch = np.array([[cos_pitch, 0, sin_pitch], [0, 1, 0], [-sin_pitch, 0, cos_pitch]])
    roll = np.array([[1, 0, 0], [0, cos_roll, -sin_roll], [0, sin_roll, cos_roll]])

    # camera axes: X right, Y down, Z forward
    axes = np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0]])
    road_to_camera = axes @ (yaw @ pitch @ roll).T
    camera_m = np.array([0, 0, height_m])
    translation = -road_to_camera @ camera_m

    # a road point has z = 0, so the third column of the rotation is not needed
    columns = [road_to_camera[:, 0], road_to_camera[:, 1], translation]
    road_to_image = lens.matrix @ np.column_stack(columns)
    return np.linalg.inv(road_to_image)


def pixels_to_road(points_px: ArrayLike, image_to_road: np.ndarray) -> np.ndarray:
    """Points (N, 2) on the flat road, metres, of undistorted pixels (N, 2).

    `image_to_road` is a homography of `road_homography`. NaN at and above the horizon.
    """
    points = np.asarray(points_px, float).reshape(-1, 2)
    homogeneous = np.column_stack([points, np.ones(len(points))])
    x, y, inverse_depth = (homogeneous @ image_to_road.T).T
    is_road = inverse_depth > 1e-9
    depth_m = 1 / np.where(is_road, inverse_depth, np.nan)
    return np.column_stack([x * depth_m, y * depth_m])


def road_to_pixels(points_m: ArrayLike, image_to_road: np.ndarray) -> np.ndarray:
    """Undistorted pixels (N, 2) of points (N, 2) on the flat road, metres.

    NaN behind the camera.
    """
    points = np.asarray(points_m, float).reshape(-1, 2)
    homogeneous = np.column_stack([points, np.ones(len(points))])
    u, v, depth_m = (homogeneous @ np.linalg.inv(image_to_road).T).T
    is_ahead = depth_m > 1e-6
    inverse_depth = 1 / np.where(is_ahead, depth_m, np.nan)
    return np.column_stack([u * inverse_depth, v * inverse_depth])


def birdseye_to_road(
    points_px: ArrayLike, warp: FourPointWarp, image_to_road: np.ndarray
) -> np.ndarray:
    """Points (N, 2) on the flat road, metres, of points (N, 2) in the bird's-eye view.

    It is exact for every quadrangle of the warp. NaN at and above the horizon.
    """
    return pixels_to_road(warp.points_to_image(points_px), image_to_road)


def scale_to_road(
    points_px: ArrayLike,
    metres_per_px: tuple[float, float],
    birdseye_size: tuple[int, int],
) -> np.ndarray:
    """Points (N, 2) on the road of points (N, 2) in the view by the two usual scales.

    `metres_per_px` is (metres per column, metres per row), in the originals (3.7 / 700,
    30 / 720). The car is taken to be at the centre of the bottom row.
    """
    points = np.asarray(points_px, float).reshape(-1, 2)
    width, height = birdseye_size
    across_m, along_m = metres_per_px
    rows_ahead = height - 1 - points[:, 1]
    columns_left = (width - 1) / 2 - points[:, 0]
    return np.column_stack([rows_ahead * along_m, columns_left * across_m])


def metres_per_pixel(
    warp: FourPointWarp, image_to_road: np.ndarray
) -> tuple[float, float]:
    """(metres per column, metres per row) of a view.

    They are exact only if the four points are a rectangle on the road: the first one is
    that at the centre of the bottom row, where the offset is measured, the second one
    the mean over the centre column. Raises ValueError if the view reaches the horizon.
    """
    width, height = warp.size
    centre = (width - 1) / 2
    bottom = height - 1
    column_px = [(centre - 0.5, bottom), (centre + 0.5, bottom)]
    left, right = birdseye_to_road(column_px, warp, image_to_road)
    near, far = birdseye_to_road([(centre, bottom), (centre, 0)], warp, image_to_road)
    if not np.isfinite([left, right, near, far]).all():
        raise ValueError(
            "the quadrangle of the warp reaches the horizon of this camera, so its "
            "rows have no length on the road; choose lower points or correct the pitch."
        )
    across_m = np.linalg.norm(left - right)
    along_m = np.linalg.norm(far - near) / max(height - 1, 1)
    return float(across_m), float(along_m)


# 5. Separate paint from road
#
# A binary is an array (height, width), uint8, 0 or 255: binaries combine with & and |,
# and can be warped or shown as they are.


class Levels(NamedTuple):
    """One threshold: the pixels whose value is in a range, both ends included.

    The published gradients are scaled so that the largest one of the image is 255: one
    glint changes every threshold. Here a step edge of `full_step` levels is 255. In
    `RECIPES` these are the medians of the largest gradient over 66 motorway images:
    gray 180 with a kernel of 3 and 195 with 9, lightness of the view 78, saturation
    232. Those of recipe A are rounded to 75 and 255, closer to its published results.
    """

    # "gray", "equalized" (after histogram equalization), or space and channel: "HLS S"
    channel: str
    # OpenCV's 8 bits: hue 0 to 179 (two degrees a level), all others 0 to 255
    low: float
    high: float
    # "value", "gradient x", "gradient y", "magnitude", or "direction": radians, 0 for a
    # vertical edge, pi / 2 for a horizontal one
    of: str = "value"
    full_step: float = 255
    kernel: int = 3  # size of the Sobel filter, pixels
    # keep only the edges of the resulting binary with a direction in this range
    edges_rad: tuple[float, float] | None = None


def colour_channel(image: np.ndarray, name: str) -> np.ndarray:
    """One channel (height, width), uint8, of an RGB image; `Levels` has the names.

    Raises ValueError if the name is not known, or the image is not RGB.
    """
    image = require_rgb(image)
    if name == "gray":
        return cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    if name == "equalized":
        return cv2.equalizeHist(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))

    conversions = {
        "HLS": cv2.COLOR_RGB2HLS,
        "HSV": cv2.COLOR_RGB2HSV,
        "Lab": cv2.COLOR_RGB2LAB,
        "Luv": cv2.COLOR_RGB2LUV,
    }
    space, _, letter = name.partition(" ")
    is_known = space == "RGB" or space in conversions
    if not is_known or len(letter) != 1 or letter not in space:
        raise ValueError(
            f"channel {name!r} is not known; use gray, equalized, or for example "
            "HLS S, Lab b, RGB R."
        )
    converted = image
    if space != "RGB":
        converted = cv2.cvtColor(image, conversions[space])
    return np.ascontiguousarray(converted[..., space.index(letter)])


def sobel_gradient(
    channel: np.ndarray, kernel: int = 3
) -> tuple[np.ndarray, np.ndarray]:
    """Horizontal and vertical gradient (height, width), float32.

    They are k for a step edge of k levels, whatever the size of the kernel.
    """
    derivative, smoothing = cv2.getDerivKernels(1, 0, kernel)
    step = np.abs(np.cumsum(derivative)).max()
    scale = 1 / (smoothing.sum() * step)
    along_u = cv2.Sobel(channel, cv2.CV_32F, 1, 0, ksize=kernel, scale=scale)
    along_v = cv2.Sobel(channel, cv2.CV_32F, 0, 1, ksize=kernel, scale=scale)
    return along_u, along_v


def edge_direction(along_u: np.ndarray, along_v: np.ndarray) -> np.ndarray:
    """Directions of a gradient, radians; 0 is a vertical edge, pi / 2 a level one."""
    return cv2.phase(np.abs(along_u), np.abs(along_v))


class Channels:
    """The channels and gradients of an RGB image; each is computed once."""

    def __init__(self, image: np.ndarray) -> None:
        self.image = image
        self.channels: dict[str, np.ndarray] = {}
        self.gradients: dict[tuple[str, int], tuple[np.ndarray, np.ndarray]] = {}

    def channel(self, name: str) -> np.ndarray:
        """See `colour_channel`."""
        if name not in self.channels:
            self.channels[name] = colour_channel(self.image, name)
        return self.channels[name]

    def gradient(self, name: str, kernel: int) -> tuple[np.ndarray, np.ndarray]:
        """See `sobel_gradient`."""
        key = (name, kernel)
        if key not in self.gradients:
            self.gradients[key] = sobel_gradient(self.channel(name), kernel)
        return self.gradients[key]


def gradient_mask(channels: Channels, levels: Levels) -> np.ndarray:
    """Binary of a threshold on the gradient of a channel."""
    along_u, along_v = channels.gradient(levels.channel, levels.kernel)
    if levels.of == "direction":
        return cv2.inRange(edge_direction(along_u, along_v), levels.low, levels.high)

    if levels.of == "magnitude":
        size = cv2.magnitude(along_u, along_v)
    elif levels.of == "gradient x":
        size = np.abs(along_u)
    elif levels.of == "gradient y":
        size = np.abs(along_v)
    else:
        raise ValueError(
            f"a threshold of {levels.of!r} is not known; use value, gradient x, "
            "gradient y, magnitude or direction."
        )
    scale = levels.full_step / 255
    # 255 is the end of the scale and includes all larger gradients
    high = np.inf if levels.high >= 255 else levels.high * scale
    return cv2.inRange(size, levels.low * scale, high)


def slanted_edges(binary: np.ndarray, edges_rad: tuple[float, float]) -> np.ndarray:
    """The edges of a binary whose direction is in a range, both ends included."""
    along_u, along_v = sobel_gradient(binary)
    return cv2.inRange(edge_direction(along_u, along_v), edges_rad[0], edges_rad[1])


def level_mask(channels: Channels, levels: Levels) -> np.ndarray:
    """Binary (height, width) of one threshold."""
    if levels.of == "value":
        channel = channels.channel(levels.channel)
        mask = cv2.inRange(channel, levels.low, levels.high)
    else:
        mask = gradient_mask(channels, levels)
    if levels.edges_rad is not None:
        mask = slanted_edges(mask, levels.edges_rad)
    return mask


@dataclass(frozen=True)
class Thresholds:
    """The binaries of a recipe.

    A rule has alternatives; each of them is a list of `Levels` that all must hold.
    """

    rules: Mapping[str, Sequence[Sequence[Levels]]]
    combined: Sequence[str]  # the binaries whose union is the binary "combined"
    # those among which the best one is chosen for each line of a video, in this order
    candidates: Sequence[str] = ("combined",)
    # polygon outside of which all binaries are 0, as shares of width and height
    region: Points | None = None
    close_px: int = 0  # gaps of "combined" narrower than this are closed

    def masks(self, image: np.ndarray) -> dict[str, np.ndarray]:
        """All binaries (height, width) of an RGB image by name, and "combined"."""
        channels = Channels(require_rgb(image))
        region = self.region_mask(image)
        masks = {}
        for name, alternatives in self.rules.items():
            mask = np.zeros_like(region)
            for all_levels in alternatives:
                all_hold = region.copy()
                for levels in all_levels:
                    all_hold &= level_mask(channels, levels)
                mask |= all_hold
            masks[name] = mask

        combined = np.zeros_like(region)
        for name in self.combined:
            combined |= masks[name]
        if self.close_px:
            square = np.ones((self.close_px, self.close_px), np.uint8)
            combined = cv2.morphologyEx(combined, cv2.MORPH_CLOSE, square)
        masks["combined"] = combined
        return masks

    def region_mask(self, image: np.ndarray) -> np.ndarray:
        """Binary of the region in which the other binaries may be set."""
        height, width = image.shape[:2]
        if self.region is None:
            return np.full((height, width), 255, np.uint8)
        corners = np.array(self.region) * (width, height)
        polygon = corners.round().astype(np.int32)
        return cv2.fillPoly(np.zeros((height, width), np.uint8), [polygon], 255)

    def scaled(self, factor: float) -> Thresholds:
        """The same thresholds for images `factor` times as large.

        A kernel of 3 pixels stays: it is the finest one, and the largest has 31.
        """
        rules = {}
        for name, alternatives in self.rules.items():
            rules[name] = [
                [scaled_levels(levels, factor) for levels in all_levels]
                for all_levels in alternatives
            ]
        close_px = self.close_px
        if close_px:
            close_px = odd_size(close_px * factor, least=1)
        return replace(self, rules=rules, close_px=close_px)


def scaled_levels(levels: Levels, factor: float) -> Levels:
    """A threshold for images `factor` times as large."""
    if levels.kernel == 3:
        return levels
    kernel = min(odd_size(levels.kernel * factor, least=3), 31)
    return levels._replace(kernel=kernel)


def odd_size(size_px: float, least: int) -> int:
    """The closest odd number of pixels, at least `least`."""
    return max(2 * round((size_px - 1) / 2) + 1, least)


# 6. Find the lines


class WindowSearch(NamedTuple):
    """Of the left and the right line: pixels (N, 2), (u, v); windows (M, 4).

    A window is given by its left, top, right and bottom edge, pixels.
    """

    pixels: list[np.ndarray]
    windows: list[np.ndarray]


def lane_histogram(
    binary: np.ndarray, rows_px: tuple[int, int] | None = None
) -> np.ndarray:
    """Set pixels (width,) in each column of a binary.

    They are counted in `rows_px` (first, end), by default in the lower half.
    """
    if rows_px is None:
        rows_px = (len(binary) // 2, len(binary))
    first, end = rows_px
    return np.count_nonzero(binary[first:end], axis=0)


def find_peaks(histogram: np.ndarray) -> tuple[int | None, int | None]:
    """Columns of the highest peaks left and right of the centre; None without one.

    Of equally high columns the one closest to the centre is used, so that a mirrored
    image has mirrored peaks.
    """
    middle = len(histogram) // 2
    outwards = histogram[:middle][::-1]
    right = histogram[middle:]
    left_peak = right_peak = None
    if outwards.any():
        left_peak = middle - 1 - int(outwards.argmax())
    if right.any():
        right_peak = middle + int(right.argmax())
    return left_peak, right_peak


def binary_pixels(binary: np.ndarray) -> np.ndarray:
    """(u, v) of every set pixel, (N, 2) int32, sorted by row."""
    pixels = cv2.findNonZero(binary)
    if pixels is None:
        return np.empty((0, 2), np.int32)
    return pixels.reshape(-1, 2)


def sliding_windows(
    binary: np.ndarray,
    *,
    count: int = 9,
    margin_px: float = 80,
    recentre_pixels: int = 50,
    flood_pixels: int | None = None,
    histogram_rows_px: tuple[int, int] | None = None,
) -> WindowSearch:
    """Pixels of each line from a stack of windows that starts at its histogram peak.

    `count` windows cover the full height; each reaches `margin_px` to both sides. One
    with more than `recentre_pixels` moves the next one to their mean column. The pixels
    of one with at least `flood_pixels` are dropped, because the threshold is flooded
    there; the next window moves all the same. A line without a peak has no windows and
    no pixels.
    """
    histogram = lane_histogram(binary, histogram_rows_px)
    search = WindowSearch(pixels=[], windows=[])
    for peak in find_peaks(histogram):
        pixels, windows = slide_along_line(
            binary,
            peak,
            count=count,
            margin_px=margin_px,
            recentre_pixels=recentre_pixels,
            flood_pixels=flood_pixels,
        )
        search.pixels.append(pixels)
        search.windows.append(windows)
    return search


def slide_along_line(
    binary: np.ndarray,
    peak: int | None,
    *,
    count: int,
    margin_px: float,
    recentre_pixels: int,
    flood_pixels: int | None,
) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (N, 2) and windows (M, 4) of one line; see `sliding_windows`."""
    pixels = binary_pixels(binary)
    found = [pixels[:0]]
    windows: list[tuple[float, float, float, float]] = []
    if peak is None:
        return pixels[:0], np.empty((0, 4))

    edges = np.linspace(len(binary), 0, count + 1).round().astype(int)
    # the pixels are sorted by row, so those in the rows of a window are one slice
    bounds = np.searchsorted(pixels[:, 1], edges)
    column = float(peak)
    for k in range(count):
        strip = pixels[bounds[k + 1] : bounds[k]]
        inside = strip[np.abs(strip[:, 0] - column) <= margin_px]
        left, right = column - margin_px, column + margin_px
        windows.append((left, edges[k + 1], right, edges[k] - 1))

        is_flooded = flood_pixels is not None and len(inside) >= flood_pixels
        if not is_flooded:
            found.append(inside)
        if len(inside) > recentre_pixels:
            column = float(inside[:, 0].mean())
    return np.concatenate(found), np.array(windows)


def band_pixels(pixels: np.ndarray, line: np.ndarray, margin_px: float) -> np.ndarray:
    """The pixels, of (N, 2), within `margin_px` columns of a line (A, B, C)."""
    if not len(pixels):
        return pixels
    u, v = np.asarray(pixels).T
    # a column for each row and a lookup is faster than a column for each pixel
    columns = np.polyval(line, np.arange(v.max() + 1))
    distances_px = np.abs(u - columns[v])
    return pixels[distances_px <= margin_px]


# 7. Fit and measure
#
# A line in the bird's-eye view is an array (3,): A, B, C of u = A v^2 + B v + C, the
# column as a function of the row, as np.polyfit(v, u, 2) returns it. On the road it is
# a RoadLine: y = c0 + c1 x + c2 x^2 / 2.


def determines_parabola(rows: np.ndarray, min_span_px: float) -> bool:
    """Whether there are three different rows, and enough between first and last."""
    if len(rows) < 3:
        return False
    first, last = rows.min(), rows.max()
    has_third_row = bool(((rows > first) & (rows < last)).any())
    return has_third_row and last - first >= min_span_px


def fit_line(pixels: ArrayLike, *, min_span_px: float = 2) -> np.ndarray | None:
    """Line (A, B, C) of least squares through pixels (N, 2); None without one.

    The pixels determine a line if they have three different rows, and `min_span_px`
    rows between the first and the last one.
    """
    points = np.asarray(pixels, float).reshape(-1, 2)
    u, v = points.T
    if not determines_parabola(v, min_span_px):
        return None
    # as np.polyfit(v, u, 2), in a tenth of its time: with rows from -1 to 1 the normal
    # equations are well conditioned
    centre = (v.min() + v.max()) / 2
    half_span = (v.max() - v.min()) / 2
    scaled = (v - centre) / half_span
    powers = np.column_stack([scaled**2, scaled, np.ones_like(scaled)])
    a, b, c = np.linalg.solve(powers.T @ powers, powers.T @ u)
    # back to rows in pixels: substitute (v - centre) / half_span
    a = a / half_span**2
    b = b / half_span
    return np.array([a, b - 2 * a * centre, c - b * centre + a * centre**2])


def ransac_line(
    pixels: ArrayLike,
    *,
    trials: int = 100,
    samples: int = 150,
    residual_px: float = 15.0,
    seed: int = 0,
    min_span_px: float = 2,
) -> np.ndarray | None:
    """Line (A, B, C) through the largest consensus set; None without one.

    RANSAC (Fischler and Bolles 1981): each trial fits `samples` different pixels and
    counts the inliers, those within `residual_px` columns of its line; the inliers of
    the best trial are fitted. The same `seed` gives the same line. Three pixels
    determine a parabola; recipe C takes 150, which are less often free of outliers.
    """
    points = np.asarray(pixels, float).reshape(-1, 2)
    if not determines_parabola(points[:, 1], min_span_px):
        return None
    random = np.random.default_rng(seed)
    sample_size = min(samples, len(points))
    best = np.zeros(len(points), bool)
    for _ in range(trials):
        chosen = random.choice(len(points), sample_size, replace=False)
        line = fit_line(points[chosen])
        if line is None:
            continue
        residuals_px = np.abs(points[:, 0] - np.polyval(line, points[:, 1]))
        inliers = residuals_px <= residual_px
        if np.count_nonzero(inliers) > np.count_nonzero(best):
            best = inliers
    return fit_line(points[best], min_span_px=min_span_px)


def line_points(line: np.ndarray, height: int) -> np.ndarray:
    """Points (N, 2) of a line in every eighth row and the last one, far to near."""
    rows = np.append(np.arange(0, height - 1, 8), height - 1)
    return np.column_stack([np.polyval(line, rows), rows])


def mean_distance_px(line: np.ndarray, other: np.ndarray, height: int) -> float:
    """Mean absolute distance of two lines over the rows 0 to height - 1, columns."""
    rows = np.arange(height)
    distances_px = np.polyval(line, rows) - np.polyval(other, rows)
    return float(np.abs(distances_px).mean())


@dataclass(frozen=True)
class RoadLine:
    """A lane line on the road: y(x) = c0 + c1 x + c2 x^2 / 2, metres."""

    c0_m: float  # lateral position at the car, positive left
    c1: float  # heading
    c2_per_m: float  # curvature

    def lateral_m(self, x_m: ArrayLike) -> np.ndarray | float:
        """Lateral position at `x_m` metres ahead, positive left."""
        x = np.asarray(x_m, float)
        return self.c0_m + self.c1 * x + self.c2_per_m * x**2 / 2

    def curvature_per_m(self, x_m: float = 0.0) -> float:
        """Curvature y'' / (1 + y'^2)^1.5 at `x_m` metres ahead, 1/m, > 0 bends left."""
        slope = self.c1 + self.c2_per_m * x_m
        return float(self.c2_per_m / (1 + slope**2) ** 1.5)


def road_line(
    line: np.ndarray, to_road: Callable[[np.ndarray], np.ndarray], height: int
) -> RoadLine | None:
    """The line on the road: points of a line of the view, mapped and fitted there.

    `to_road` maps points (N, 2) of the view, of `height` rows, to metres. None if fewer
    than three points are below the horizon.
    """
    rows = np.linspace(0, height - 1, 60)
    points_m = to_road(np.column_stack([np.polyval(line, rows), rows]))
    points_m = points_m[np.isfinite(points_m).all(axis=1)]
    if len(points_m) < 3 or np.ptp(points_m[:, 0]) == 0:
        return None
    half_c2, c1, c0 = np.polyfit(points_m[:, 0], points_m[:, 1], 2)
    return RoadLine(float(c0), float(c1), float(2 * half_c2))


def circle_curvature_per_m(points_m: ArrayLike) -> float:
    """Curvature of the circle through three points (3, 2) of the road, far to near.

    Recipe C measures its RANSAC lines so. > 0 bends left, 0 for points on a straight
    line.
    """
    far, middle, near = np.asarray(points_m, float)
    first = middle - near
    second = far - middle
    doubled_area = first[0] * second[1] - first[1] * second[0]
    sides_m = (
        np.linalg.norm(first) * np.linalg.norm(second) * np.linalg.norm(far - near)
    )
    return float(2 * doubled_area / sides_m)


# 8. Remember


class Line:
    """Memory of one line, for fits (3,) of consecutive frames.

    A new fit counts fully if no number of it differs by more than `accept` from the
    mean so far. If it does, but by no more than `damp`, it is doubtful: it counts with
    `weight`, the mean with the rest. Otherwise it is refused. Doubtful, refused and
    missing fits count as missed.
    """

    def __init__(
        self,
        length: int,
        *,
        accept: ArrayLike = np.inf,
        damp: ArrayLike = 0.0,
        weight: float = 0.0,
        max_missed: int = 25,
        on_miss: str = "keep",
        near: str = "mean",
    ) -> None:
        self.length = length  # accepted fits in the mean
        self.accept = np.asarray(accept, float)
        self.damp = np.asarray(damp, float)
        self.weight = weight
        # Our restart: after more missed frames in a row the line begins again, because
        # a wrong one must not persist. The authors have none: A and B keep their last
        # line for ever, and the counter of C does nothing.
        self.max_missed = max_missed
        # what a frame without a fit does to the list: "keep" it, "drop newest" fit (A),
        # or "repeat last" fit (B)
        self.on_miss = on_miss
        self.near = near  # search around the "mean" so far or the "last" fit
        self.fits: list[np.ndarray] = []
        self.missed = 0  # frames in a row
        # "found" in this frame, "kept" from earlier ones, or "lost"
        self.state = "lost"

    def mean(self) -> np.ndarray | None:
        """Mean (3,) of the last fits; None without any."""
        if not self.fits:
            return None
        return np.mean(self.fits, axis=0)

    def search_near(self) -> np.ndarray | None:
        """The line around which to search in the next frame; None: use windows."""
        if self.missed or not self.fits:
            return None
        return self.fits[-1] if self.near == "last" else self.mean()

    def update(self, fit: np.ndarray | None) -> np.ndarray | None:
        """Take the fit of the next frame, or None; returns the mean so far."""
        if fit is None:
            self.miss_fit()
            return self.mean()

        mean = self.mean()
        share = self.share_of(fit)
        if share > 0:
            damped = fit if mean is None else mean + share * (fit - mean)
            self.fits.append(damped)
            self.fits = self.fits[-self.length :]
        if share == 1:
            self.missed = 0
            self.state = "found"
        else:
            self.count_missed()
        return self.mean()

    def share_of(self, fit: np.ndarray) -> float:
        """How much a new fit counts: 1, `weight` if doubtful, 0 if it is refused."""
        mean = self.mean()
        if mean is None:
            return 1.0
        change = np.abs(fit - mean)
        if np.all(change <= self.accept):
            return 1.0
        return self.weight if np.all(change <= self.damp) else 0.0

    def miss_fit(self) -> None:
        """A frame without a fit."""
        if self.on_miss == "drop newest" and len(self.fits) > 1:
            self.fits.pop()
        if self.on_miss == "repeat last" and self.fits:
            self.fits.append(self.fits[-1])
            self.fits = self.fits[-self.length :]
        self.count_missed()

    def count_missed(self) -> None:
        """Keep the line, or begin again after too many missed frames."""
        self.missed += 1
        if self.missed > self.max_missed:
            self.fits = []
            self.missed = 0
        self.state = "kept" if self.fits else "lost"

    def fresh(self, scale_u: float = 1.0, scale_v: float = 1.0) -> Line:
        """An empty memory with the same rules, for images scaled by two factors."""
        # units of A, B and C: px/px^2, px/px and px
        units = np.array([scale_u / scale_v**2, scale_u / scale_v, scale_u])
        return Line(
            self.length,
            accept=self.accept * units,
            damp=self.damp * units,
            weight=self.weight,
            max_missed=self.max_missed,
            on_miss=self.on_miss,
            near=self.near,
        )


# The recipes: all numbers of the three finders, for images of 1280 x 720 pixels

POSE_SUFFIX = "_pose"  # of the name of a recipe with points from the camera pose
# The published top row is 41 m away in the course's images, and much farther for a
# camera that looks up.
MAX_FAR_EDGE_M = 60.0


@dataclass(frozen=True)
class Recipe:
    """Settings of one classic lane finder, in pixels of images of `size`."""

    name: str
    source_px: Points  # of the homography, see FourPointWarp
    destination_px: Points
    thresholds: Thresholds  # of stills
    video_thresholds: Thresholds
    margin_px: float  # half width of the windows, and of the band in videos
    still_band_px: (
        float  # half width of the band around the line of the windows in stills
    )
    left_line: Line  # empty; `LaneFinder` works with fresh ones
    right_line: Line
    size: tuple[int, int] = (1280, 720)  # (width, height)
    warp_first: bool = (
        False  # warp the image and then threshold it, or warp the binaries
    )
    histogram_rows_px: tuple[int, int] = (360, 720)
    recentre_pixels: int = 50
    flood_pixels: int | None = None
    # candidates for the left and the right line of the first frame, and of a later one
    # if the line is not known
    first_binaries: tuple[str, str] = ("combined", "combined")
    unknown_binaries: tuple[str, str] = ("combined", "combined")
    # search both lines with windows as soon as one of them was missed
    search_together: bool = True
    # Measure the mean of so many fits in metres (B), else the line that is drawn. (A's
    # author measures the present frame, and C's program the first one for ever.)
    measured_fits: int | None = None
    min_span_px: float = 160  # two windows: a shorter line determines no curvature

    def four_point_warp(self) -> FourPointWarp:
        """The homography from the undistorted image to the bird's-eye view."""
        source_px = np.array(self.source_px)
        destination_px = np.array(self.destination_px)
        return FourPointWarp(source_px, destination_px, self.size)

    def scaled(self, size: tuple[int, int]) -> Recipe:
        """The same recipe for images resized to `size` (width, height).

        Lengths, counts of pixels and kernels are scaled. Gradients are not, because a
        smaller image has sharper edges. Raises ValueError if the size is not positive.
        """
        width, height = size
        if width < 1 or height < 1:
            raise ValueError(
                f"an image of {width}x{height} pixels is not possible; give its width "
                "and height."
            )
        scale_u = width / self.size[0]
        scale_v = height / self.size[1]
        area = scale_u * scale_v
        first_row, end_row = self.histogram_rows_px
        flood_pixels = self.flood_pixels
        if flood_pixels is not None:
            flood_pixels = max(round(flood_pixels * area), 1)
        return replace(
            self,
            size=(width, height),
            source_px=resize_points(self.source_px, scale_u, scale_v),
            destination_px=resize_points(self.destination_px, scale_u, scale_v),
            thresholds=self.thresholds.scaled(area**0.5),
            video_thresholds=self.video_thresholds.scaled(area**0.5),
            margin_px=self.margin_px * scale_u,
            still_band_px=self.still_band_px * scale_u,
            left_line=self.left_line.fresh(scale_u, scale_v),
            right_line=self.right_line.fresh(scale_u, scale_v),
            histogram_rows_px=(round(first_row * scale_v), round(end_row * scale_v)),
            recentre_pixels=max(round(self.recentre_pixels * area), 1),
            flood_pixels=flood_pixels,
            min_span_px=self.min_span_px * scale_v,
        )


def resize_points(points_px: Points, scale_u: float, scale_v: float) -> Points:
    """Points (N, 2) of a resized image; pixel centres are at whole numbers."""
    scale = (scale_u, scale_v)
    resized = (np.array(points_px) + 0.5) * scale - 0.5
    return resized.tolist()


def hls_sobel_thresholds(lowest: float) -> Thresholds:
    """Recipe A, on the warped colour image; `lowest` is 20 in stills and 15 in videos.

    Its range of directions is left out: 0 to pi / 2 includes all. Saturation changes by
    nearly its full range next to white pixels, so a full step is the full range.
    """
    saturated = Levels("HLS S", 120, 255)
    not_dark = Levels("HLS L", 30, 255)
    edges = Levels("HLS L", lowest, 255, "gradient x", full_step=75)
    strong = Levels("HLS S", lowest, 255, "magnitude", full_step=255)
    return Thresholds(
        rules={
            "saturation": [[saturated, not_dark]],
            "gradient x": [[edges]],
            "magnitude": [[strong]],
        },
        combined=("saturation", "gradient x", "magnitude"),
    )


def equalized_hsv_thresholds() -> Thresholds:
    """Recipe B, on the undistorted image: white above 250, edges above 50."""
    hue = Levels("HSV H", 0, 50)
    saturation = Levels("HSV S", 70, 255)
    value = Levels("HSV V", 70, 255)
    strong = Levels("gray", 51, 255, "magnitude", full_step=195, kernel=9)
    return Thresholds(
        rules={
            "white": [[Levels("equalized", 251, 255)]],
            "yellow": [[hue, saturation, value]],
            "magnitude": [[strong]],
        },
        combined=("white", "yellow", "magnitude"),
        close_px=5,
    )


def best_channel_thresholds() -> Thresholds:
    """Recipe C, on the undistorted image.

    Its author excludes the lower end of a range of values: red is above 210. The
    gradients include both ends.
    """
    slanted = (0.7, 1.2)  # radians
    steep_x = Levels("gray", 100, 200, "gradient x", full_step=180)
    steep_y = Levels("gray", 100, 200, "gradient y", full_step=180)
    strong = Levels("gray", 10, 225, "magnitude", full_step=180)
    direction = Levels("gray", 0.7, 1.2, "direction")
    return Thresholds(
        # in the author's order: of two equally good binaries the first one is taken
        rules={
            "red": [[Levels("RGB R", 211, 255)]],
            "gradients": [[steep_x, steep_y], [strong, direction]],
            "hue": [[Levels("HLS H", 21, 80, edges_rad=slanted)]],
            "saturation": [[Levels("HLS S", 86, 255)]],
            "luv lightness": [[Levels("Luv L", 226, 255)]],
            "lab b": [[Levels("Lab b", 156, 200, edges_rad=slanted)]],
        },
        combined=("saturation", "red", "lab b"),
        candidates=("red", "gradients", "hue", "saturation", "luv lightness", "lab b"),
        # without the sky and the adjacent lanes
        region=((0, 1), (0.45, 1 / 1.8), (0.55, 1 / 1.8), (0.99, 1)),
    )


HLS_SOBEL = Recipe(
    name="hls_sobel",
    source_px=((580, 460), (740, 460), (1100, 670), (270, 670)),
    destination_px=((200, 0), (1080, 0), (1080, 720), (200, 720)),
    warp_first=True,
    thresholds=hls_sobel_thresholds(lowest=20),
    video_thresholds=hls_sobel_thresholds(lowest=15),
    margin_px=80,
    still_band_px=80,
    left_line=Line(5, accept=(0.001, 1.0, 100), on_miss="drop newest"),
    right_line=Line(5, accept=(0.001, 1.0, 100), on_miss="drop newest"),
)
EQUALIZED_HSV = Recipe(
    name="equalized_hsv",
    source_px=((1280, 710), (0, 710), (546, 460), (732, 460)),
    destination_px=((1280, 720), (0, 720), (0, 0), (1280, 0)),
    thresholds=equalized_hsv_thresholds(),
    video_thresholds=equalized_hsv_thresholds(),
    histogram_rows_px=(360, 690),
    margin_px=100,
    still_band_px=100,
    left_line=Line(10, on_miss="repeat last", near="last"),
    right_line=Line(10, on_miss="repeat last", near="last"),
    measured_fits=20,
)
BEST_CHANNEL = Recipe(
    name="best_channel",
    source_px=((249, 690), (579, 460), (704, 460), (1058, 690)),
    destination_px=((249, 720), (249, 0), (1058, 0), (1058, 720)),
    thresholds=best_channel_thresholds(),
    video_thresholds=best_channel_thresholds(),
    margin_px=75,
    still_band_px=100,
    flood_pixels=9500,
    # good: |dA| up to 7e-5 and |dC| up to 50 px; doubtful: up to 12e-5 on the left and
    # 15e-5 on the right, and 150 px
    left_line=Line(
        30, accept=(7e-5, np.inf, 50), damp=(12e-5, np.inf, 150), weight=0.05
    ),
    right_line=Line(
        30, accept=(7e-5, np.inf, 50), damp=(15e-5, np.inf, 150), weight=0.15
    ),
    first_binaries=("gradients", "red"),
    unknown_binaries=("lab b", "red"),
    search_together=False,
)
RECIPES = {recipe.name: recipe for recipe in (HLS_SOBEL, EQUALIZED_HSV, BEST_CHANNEL)}


def get_recipe(name: str, size: tuple[int, int] = (1280, 720)) -> Recipe:
    """A recipe by name, for images of `size` (width, height).

    Raises ValueError if there is none of this name, or the size is not positive.
    """
    if name not in RECIPES:
        names = ", ".join(RECIPES)
        raise ValueError(f"there is no recipe {name!r}; the recipes are {names}.")
    return RECIPES[name].scaled(size)


def recipe_from_pose(recipe: Recipe, image_to_road: np.ndarray) -> Recipe:
    """The recipe, named "..._pose", with points that are a rectangle on the road.

    The published points were chosen for another camera. With these the view is a map of
    the road with two constant scales. The edges of the rectangle are parallel to the
    car's axis, equally far to the left and right of the camera. The near and the far
    one are where the centre column crosses the published bottom and top row, at most 60
    m ahead. The width is the published one at the near edge. Points may lie outside the
    image.

    `image_to_road` is for images of the recipe's size. Raises ValueError if the near
    edge is not on the road.
    """
    source_px = np.array(recipe.source_px, float)
    u, v = source_px.T
    is_left = u < u.mean()
    is_near = v > v.mean()

    # where the edges are on the road
    centre = (recipe.size[0] - 1) / 2
    edges_px = [(centre, v[is_near].mean()), (centre, v[~is_near].mean())]
    near_m, far_m = pixels_to_road(edges_px, image_to_road)[:, 0]
    near_corners_m = pixels_to_road(source_px[is_near], image_to_road)
    half_width_m = np.ptp(near_corners_m[:, 1]) / 2
    far_m = np.fmin(far_m, MAX_FAR_EDGE_M)

    x_m = np.where(is_near, near_m, far_m)
    y_m = np.where(is_left, half_width_m, -half_width_m)
    points_px = road_to_pixels(np.column_stack([x_m, y_m]), image_to_road)
    if not np.isfinite(points_px).all() or near_m >= MAX_FAR_EDGE_M:
        raise ValueError(
            f"the bottom row of recipe {recipe.name}'s points is not on the road ahead "
            "of this camera; correct its height and pitch."
        )
    name = recipe.name + POSE_SUFFIX
    return replace(recipe, name=name, source_px=points_px.tolist())


# The finder: one image, or the frames of a video


@dataclass(frozen=True, eq=False)
class FoundLine:
    """One line of one frame, before the memory."""

    fit: np.ndarray | None  # (3,)
    pixels: np.ndarray  # (N, 2) that were fitted
    binary: str  # name of the binary that they are from
    windows: np.ndarray  # (M, 4) of the search; M = 0 if it was a band


@dataclass(frozen=True, eq=False)
class LaneResult:
    """The lane in one frame, with intermediate results.

    Curvature > 0: the road bends left; offset > 0: the car is left of the lane centre.
    A measurement is None if a line that it needs is missing. `state` is "found" if both
    lines are measured in this frame, "kept" if one is from memory, "lost" if one is
    missing.
    """

    # (3,) in the bird's-eye view, from the memory if there is one
    left: np.ndarray | None
    right: np.ndarray | None
    left_road: RoadLine | None
    right_road: RoadLine | None
    state: str
    undistorted: np.ndarray  # (height, width, 3)
    # all binaries: of the view if the recipe warps first, else of the undistorted image
    masks: dict[str, np.ndarray]
    warped_binary: np.ndarray  # that with the pixels of both lines, in the view
    left_found: FoundLine  # of this frame, without the memory
    right_found: FoundLine
    warp: FourPointWarp

    @property
    def lines_px(self) -> list[np.ndarray | None]:
        """Points (N, 2) of both lines in the undistorted image, or None."""
        height = self.warp.size[1]
        lines: list[np.ndarray | None] = []
        for line in (self.left, self.right):
            if line is None:
                lines.append(None)
            else:
                lines.append(self.warp.points_to_image(line_points(line, height)))
        return lines

    @property
    def curvature_per_m(self) -> float | None:
        """Mean curvature of the lines that are there, 1/m, > 0 bends left."""
        lines = [line for line in (self.left_road, self.right_road) if line is not None]
        if not lines:
            return None
        return float(np.mean([line.curvature_per_m() for line in lines]))

    @property
    def offset_m(self) -> float | None:
        """Offset of the car from the lane centre, metres, > 0: left of it."""
        if self.left_road is None or self.right_road is None:
            return None
        return -(self.left_road.c0_m + self.right_road.c0_m) / 2

    @property
    def lane_width_m(self) -> float | None:
        """Distance between the lines at the car, perpendicular to the lane, metres."""
        if self.left_road is None or self.right_road is None:
            return None
        heading = (self.left_road.c1 + self.right_road.c1) / 2
        across_m = self.left_road.c0_m - self.right_road.c0_m
        return float(across_m / np.hypot(1, heading))

    def lateral_m(self, x_m: ArrayLike) -> np.ndarray | None:
        """Lateral positions (2, N) of the lines at (N,) metres ahead, or None."""
        if self.left_road is None or self.right_road is None:
            return None
        return np.array([self.left_road.lateral_m(x_m), self.right_road.lateral_m(x_m)])

    def as_row(self) -> dict[str, str | float | None]:
        """The measurements by the column names of the telemetry."""
        row: dict[str, str | float | None] = {
            "state": self.state,
            "offset_m": self.offset_m,
            "curvature_per_m": self.curvature_per_m,
            "lane_width_m": self.lane_width_m,
        }
        for side, line in (("left", self.left_road), ("right", self.right_road)):
            row[f"{side}_c0_m"] = None if line is None else line.c0_m
            row[f"{side}_c1"] = None if line is None else line.c1
            row[f"{side}_c2_per_m"] = None if line is None else line.c2_per_m
        return row


class View:
    """One binary in the bird's-eye view, with the line search of a recipe."""

    def __init__(self, name: str, binary: np.ndarray, recipe: Recipe) -> None:
        self.name = name
        self.binary = binary
        self.recipe = recipe

    @cached_property
    def pixels(self) -> np.ndarray:
        """Set pixels (N, 2)."""
        return binary_pixels(self.binary)

    @cached_property
    def search(self) -> WindowSearch:
        """The window search of both lines."""
        return sliding_windows(
            self.binary,
            margin_px=self.recipe.margin_px,
            recentre_pixels=self.recipe.recentre_pixels,
            flood_pixels=self.recipe.flood_pixels,
            histogram_rows_px=self.recipe.histogram_rows_px,
        )

    def line_in_windows(self, side: int) -> FoundLine:
        """The left (0) or right (1) line, fitted to the pixels in its windows."""
        pixels = self.search.pixels[side]
        fit = fit_line(pixels, min_span_px=self.recipe.min_span_px)
        return FoundLine(fit, pixels, self.name, self.search.windows[side])

    def line_in_band(self, near: np.ndarray, margin_px: float) -> FoundLine:
        """The line fitted to the pixels within `margin_px` of another one."""
        pixels = band_pixels(self.pixels, near, margin_px)
        fit = fit_line(pixels, min_span_px=self.recipe.min_span_px)
        return FoundLine(fit, pixels, self.name, np.empty((0, 4)))

    def line_in_still(self, side: int) -> FoundLine:
        """The line in windows, and then in the band around it."""
        first = self.line_in_windows(side)
        if first.fit is None:
            return first
        second = self.line_in_band(first.fit, self.recipe.still_band_px)
        return replace(second, windows=first.windows)


def nearest_line(
    candidates: Sequence[FoundLine], line_so_far: np.ndarray, height: int
) -> FoundLine:
    """The candidate whose fit is closest to a line; of equal ones the first."""
    best = candidates[0]
    best_distance_px = np.inf
    for candidate in candidates:
        if candidate.fit is None:
            continue
        distance_px = mean_distance_px(candidate.fit, line_so_far, height)
        if distance_px < best_distance_px:
            best = candidate
            best_distance_px = distance_px
    return best


class LaneFinder:
    """Finds the lane: `find` in a still, `follow` in the frames of a drive.

    `lens` undistorts the images. `image_to_road`, see `road_homography`, places the
    lines on the road; with `metres_per_px`, (metres per column, metres per row) of the
    view, for example (3.7 / 700, 30 / 720), the two usual scales do. Raises ValueError
    if there is neither, or the recipe is for another size than the lens.
    """

    def __init__(
        self,
        recipe: Recipe,
        lens: Lens,
        image_to_road: np.ndarray | None = None,
        *,
        metres_per_px: tuple[float, float] | None = None,
    ) -> None:
        if recipe.size != tuple(lens.size):
            raise ValueError(
                f"recipe {recipe.name} is for images of {recipe.size[0]}x"
                f"{recipe.size[1]} pixels, but the lens for {lens.size[0]}x"
                f"{lens.size[1]}; use get_recipe(name, lens.size)."
            )
        self.recipe = recipe
        self.lens = lens
        self.warp = recipe.four_point_warp()
        if metres_per_px is not None:
            self.to_road = partial(
                scale_to_road, metres_per_px=metres_per_px, birdseye_size=recipe.size
            )
        elif image_to_road is not None:
            self.to_road = partial(
                birdseye_to_road, warp=self.warp, image_to_road=image_to_road
            )
        else:
            raise ValueError(
                "nothing can be measured on the road without a scale; give "
                "image_to_road, or metres_per_px."
            )
        self.lines = [recipe.left_line.fresh(), recipe.right_line.fresh()]
        # recipe B measures the mean of more fits, in metres
        measured_fits = recipe.measured_fits or 1
        self.road_lines = [
            Line(measured_fits, on_miss="repeat last"),
            Line(measured_fits, on_miss="repeat last"),
        ]
        self.is_first_frame = True

    def find(self, image: np.ndarray) -> LaneResult:
        """The lane in one raw RGB image, without memory.

        Raises ValueError if the image is not RGB or of another size than the lens.
        """
        undistorted = undistort(image, self.lens)
        masks = self.threshold(undistorted, self.recipe.thresholds)
        view = self.look_from_above("combined", masks)
        found = [view.line_in_still(side) for side in (0, 1)]
        fits = [line.fit for line in found]
        return self.result(
            undistorted=undistorted,
            masks=masks,
            views={"combined": view},
            found=found,
            lines=fits,
            roads=[self.place_on_road(fit) for fit in fits],
            state="lost" if fits[0] is None or fits[1] is None else "found",
        )

    def follow(self, image: np.ndarray) -> LaneResult:
        """The lane in the next frame of a drive, with memory; see `find`."""
        thresholds = self.recipe.video_thresholds
        undistorted = undistort(image, self.lens)
        masks = self.threshold(undistorted, thresholds)
        views = {}
        for name in thresholds.candidates:
            views[name] = self.look_from_above(name, masks)

        near = [line.search_near() for line in self.lines]
        if self.recipe.search_together and (near[0] is None or near[1] is None):
            near = [None, None]
        found = [self.find_line(views, side, near[side]) for side in (0, 1)]
        self.is_first_frame = False

        lines = []
        roads = []
        for side in (0, 1):
            lines.append(self.lines[side].update(found[side].fit))
            roads.append(self.measure(side, found[side].fit))
        states = [line.state for line in self.lines]
        worst_first = ("lost", "kept", "found")
        return self.result(
            undistorted=undistorted,
            masks=masks,
            views=views,
            found=found,
            lines=lines,
            roads=roads,
            state=min(states, key=worst_first.index),
        )

    def threshold(
        self, undistorted: np.ndarray, thresholds: Thresholds
    ) -> dict[str, np.ndarray]:
        """The binaries by name, of the view if the recipe warps first."""
        if self.recipe.warp_first:
            undistorted = self.warp.image_to_birdseye(undistorted)
        return thresholds.masks(undistorted)

    def look_from_above(self, name: str, masks: dict[str, np.ndarray]) -> View:
        """One of the binaries in the bird's-eye view."""
        binary = masks[name]
        if not self.recipe.warp_first:
            binary = self.warp.image_to_birdseye(binary)
        return View(name, binary, self.recipe)

    def find_line(
        self, views: dict[str, View], side: int, near: np.ndarray | None
    ) -> FoundLine:
        """The left (0) or right (1) line of a frame, around a line or with windows."""
        line_so_far = self.lines[side].mean()
        if line_so_far is None:
            names = self.recipe.unknown_binaries
            if self.is_first_frame:
                names = self.recipe.first_binaries
            return views[names[side]].line_in_windows(side)

        candidates = []
        for name in self.recipe.video_thresholds.candidates:
            if near is None:
                candidates.append(views[name].line_in_windows(side))
            else:
                candidates.append(views[name].line_in_band(near, self.recipe.margin_px))
        return nearest_line(candidates, line_so_far, self.recipe.size[1])

    def place_on_road(self, line: np.ndarray | None) -> RoadLine | None:
        """The line in metres."""
        if line is None:
            return None
        return road_line(line, self.to_road, self.recipe.size[1])

    def measure(self, side: int, fit: np.ndarray | None) -> RoadLine | None:
        """The line in metres that is measured: from the memory, or a mean of fits."""
        if self.recipe.measured_fits is None:
            return self.place_on_road(self.lines[side].mean())
        road = self.place_on_road(fit)
        numbers = None
        if road is not None:
            numbers = np.array([road.c0_m, road.c1, road.c2_per_m])
        mean = self.road_lines[side].update(numbers)
        return None if mean is None else RoadLine(*mean.tolist())

    def result(
        self,
        *,
        undistorted: np.ndarray,
        masks: dict[str, np.ndarray],
        views: dict[str, View],
        found: list[FoundLine],
        lines: list[np.ndarray | None],
        roads: list[RoadLine | None],
        state: str,
    ) -> LaneResult:
        """The result of a frame; lists are for the left and the right line."""
        left_binary = views[found[0].binary].binary
        right_binary = views[found[1].binary].binary
        return LaneResult(
            left=lines[0],
            right=lines[1],
            left_road=roads[0],
            right_road=roads[1],
            state=state,
            undistorted=undistorted,
            masks=masks,
            warped_binary=left_binary | right_binary,
            left_found=found[0],
            right_found=found[1],
            warp=self.warp,
        )


# Draw. All functions draw on a copy.

LANE_COLOUR: Colour = (0, 220, 90)
LEFT_COLOUR: Colour = (255, 70, 60)
RIGHT_COLOUR: Colour = (60, 130, 255)
WINDOW_COLOUR: Colour = (255, 210, 0)
RANSAC_COLOUR: Colour = (255, 0, 255)
# OpenCV draws at 1/16 px: coordinates are whole numbers with four fractional bits
SHIFT = 4


def to_rgb(image: np.ndarray) -> np.ndarray:
    """A new RGB image of an RGB or gray one, or of a binary (bool, 0 and 1 or 255)."""
    image = np.asarray(image)
    if image.ndim == 3:
        return require_rgb(image).copy()
    is_mask = image.dtype == bool or (image.size > 0 and image.max() <= 1)
    if is_mask:
        image = (image > 0).astype(np.uint8) * 255
    return require_rgb(np.dstack([image, image, image]))


def finite_points(points_px: ArrayLike | None) -> np.ndarray:
    """Points (N, 2) without those that are not finite; (0, 2) for None."""
    if points_px is None:
        return np.empty((0, 2))
    points = np.asarray(points_px, float).reshape(-1, 2)
    return points[np.isfinite(points).all(axis=1)]


def to_fixed_point(points_px: np.ndarray) -> np.ndarray:
    """Whole numbers (N, 2) of 1/16 px."""
    # a million is far outside any image, and its fixed-point number fits in 32 bits
    limited = points_px.clip(-1e6, 1e6)
    return np.round(limited * 2**SHIFT).astype(np.int32)


def draw_polyline(
    image: np.ndarray,
    points_px: np.ndarray,
    colour: Colour,
    width_px: float,
    *,
    closed: bool = False,
) -> None:
    """Draw a line centred on points (N, 2), on the image itself."""
    if len(points_px) < 2:
        return
    # measured with LINE_AA: an even thickness n is n + 1.4 px wide, and an odd one, too
    thickness = max(1, 2 * round((width_px - 1.4) / 2))
    cv2.polylines(
        img=image,
        pts=[to_fixed_point(points_px)],
        isClosed=closed,
        color=colour,
        thickness=thickness,
        lineType=cv2.LINE_AA,
        shift=SHIFT,
    )


def draw_windows(view: np.ndarray, windows_px: ArrayLike) -> np.ndarray:
    """Windows (M, 4) (left, top, right, bottom edge) on an image or a binary; RGB."""
    drawn = to_rgb(view)
    width_px = drawn.shape[1] / 320
    for left, top, right, bottom in np.asarray(windows_px, float).reshape(-1, 4):
        corners = [(left, top), (right, top), (right, bottom), (left, bottom)]
        draw_polyline(drawn, np.array(corners), WINDOW_COLOUR, width_px, closed=True)
    return drawn


def draw_pixels(
    view: np.ndarray, pixels_px: ArrayLike, *, colour: Colour
) -> np.ndarray:
    """Pixels (N, 2) in a colour on an image or a binary; those outside are left out."""
    drawn = to_rgb(view)
    height, width = drawn.shape[:2]
    u, v = np.asarray(pixels_px).reshape(-1, 2).astype(int).T
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    drawn[v[inside], u[inside]] = colour
    return drawn


def draw_lines(
    view: np.ndarray,
    lines: Sequence[np.ndarray | None],
    *,
    colour: Colour = RANSAC_COLOUR,
    width_px: float | None = None,
) -> np.ndarray:
    """Lines (A, B, C) on a bird's-eye view; those that are None are left out; RGB.

    Recipe C draws its RANSAC lines so, in magenta over the windows.
    """
    drawn = to_rgb(view)
    if width_px is None:
        width_px = drawn.shape[1] / 200
    for line in lines:
        if line is not None:
            draw_polyline(drawn, line_points(line, len(drawn)), colour, width_px)
    return drawn


def draw_lane(
    image: np.ndarray,
    left_px: ArrayLike | None,
    right_px: ArrayLike | None,
    lens: Lens | None = None,
    *,
    line_width_px: float | None = None,
) -> np.ndarray:
    """The lane on a raw or undistorted RGB image: green, its lines red and blue.

    The points (N, 2) of both lines go from far to near. With a `lens` the image is the
    raw one, and the points are those of the undistorted one. If a line is None, the
    other one is drawn, and no lane. A `line_width_px` of 0 draws no lines. Raises
    ValueError if the image is not RGB, or not of the lens's size.
    """
    drawn = require_rgb(image).copy()
    left = finite_points(left_px)
    right = finite_points(right_px)
    if lens is not None:
        require_size(image, lens.size, "lens")
        left = bend_line(left, lens)
        right = bend_line(right, lens)

    if len(left) >= 2 and len(right) >= 2:
        outline = np.vstack([left, right[::-1]])
        filled = drawn.copy()
        cv2.fillPoly(filled, [to_fixed_point(outline)], LANE_COLOUR, cv2.LINE_AA, SHIFT)
        drawn = cv2.addWeighted(filled, 0.3, drawn, 0.7, 0)
    if line_width_px is None:
        line_width_px = image.shape[1] / 160
    if line_width_px > 0:
        draw_polyline(drawn, left, LEFT_COLOUR, line_width_px)
        draw_polyline(drawn, right, RIGHT_COLOUR, line_width_px)
    return drawn


def bend_line(points_px: np.ndarray, lens: Lens) -> np.ndarray:
    """Raw points (M, 2) of a line (N, 2), dense enough to follow the lens."""
    if len(points_px) < 2:
        return points_px
    steps_px = np.linalg.norm(np.diff(points_px, axis=0), axis=1)
    along_px = np.append(0, np.cumsum(steps_px))
    # every 8 px follows the bend to 0.01 px
    dense_px = np.union1d(along_px, np.arange(0, along_px[-1], 8))
    u = np.interp(dense_px, along_px, points_px[:, 0])
    v = np.interp(dense_px, along_px, points_px[:, 1])
    return finite_points(distort_points(np.column_stack([u, v]), lens))


def put_text(image: np.ndarray, lines: Sequence[str]) -> None:
    """White text on a dark panel at the top left, on the image itself."""
    height, width = image.shape[:2]
    scale = np.sqrt(width * height) / 960
    line_height = max(round(40 * scale), 1)
    panel_height = round(line_height * (len(lines) + 0.5))
    panel_width = 0
    for text in lines:
        (text_width, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, 2)
        panel_width = max(panel_width, text_width + line_height)
    panel = image[:panel_height, :panel_width]
    panel[:] = panel * 0.4
    for number, text in enumerate(lines, start=1):
        cv2.putText(
            img=image,
            text=text,
            org=(line_height // 2, number * line_height),
            fontFace=cv2.FONT_HERSHEY_SIMPLEX,
            fontScale=scale,
            color=(255, 255, 255),
            thickness=max(1, round(2 * scale)),
            lineType=cv2.LINE_AA,
        )


def describe_bend(curvature_per_m: float | None) -> str:
    """A curvature in words: "bends right, R 640 m", "straight (R > 3 km)"."""
    if curvature_per_m is None:
        return "bend unknown"
    # At 3 km a line leaves its tangent by 0.15 m, the width of a marking, over 30 m: on
    # a straight road the measured radius is as large, and of either sign.
    if abs(curvature_per_m) < 1 / 3000:
        return "straight (R > 3 km)"
    side = "left" if curvature_per_m > 0 else "right"
    radius_m = 1 / abs(curvature_per_m)
    # it is accurate to a few per cent
    digits = -1 if radius_m >= 100 else 0
    return f"bends {side}, R {round(radius_m, digits):.0f} m"


def describe_offset(offset_m: float | None) -> str:
    """An offset in words: "0.12 m left of centre", "in the centre"."""
    if offset_m is None:
        return "offset unknown"
    if abs(offset_m) < 0.005:
        return "in the centre"
    side = "left" if offset_m > 0 else "right"
    return f"{abs(offset_m):.2f} m {side} of centre"


def describe_result(result: LaneResult) -> list[str]:
    """Lines of text with bend and offset, or "lane lost"."""
    if result.state == "lost":
        return ["lane lost"]
    lines = [describe_bend(result.curvature_per_m), describe_offset(result.offset_m)]
    if result.state == "kept":
        lines.append("(from memory)")
    return lines


def annotate_image(image: np.ndarray, result: LaneResult, lens: Lens) -> np.ndarray:
    """A copy of the raw RGB image with the lane and its measurements."""
    left_px, right_px = result.lines_px
    if result.state == "lost":
        left_px = right_px = None
    drawn = draw_lane(image, left_px, right_px, lens)
    put_text(drawn, describe_result(result))
    return drawn


# Videos

Row = Mapping[str, str | float | None]
FrameFunction = Callable[[np.ndarray], "np.ndarray | tuple[np.ndarray, Row]"]


def follow_lane(
    finder: LaneFinder,
) -> Callable[[np.ndarray], tuple[np.ndarray, Row]]:
    """A function for `process_video`: the next frame, annotated, and its telemetry."""

    def process(frame: np.ndarray) -> tuple[np.ndarray, Row]:
        result = finder.follow(frame)
        return annotate_image(frame, result, finder.lens), result.as_row()

    return process


@contextmanager
def open_video(path: str | Path) -> Iterator[cv2.VideoCapture]:
    """A video that is open for reading; OSError if it cannot be read."""
    if not Path(path).exists():
        raise FileNotFoundError(f"{path}: there is no such video.")
    capture = cv2.VideoCapture(str(path))
    try:
        if not capture.isOpened():
            raise OSError(
                f"{path}: cannot be read as a video; it is cut off or of another "
                "format: copy it again, or convert it to mp4."
            )
        yield capture
    finally:
        capture.release()


def frame_rate(path: str | Path) -> float:
    """Frames per second of a video."""
    with open_video(path) as capture:
        return capture.get(cv2.CAP_PROP_FPS)


def read_video(
    path: str | Path, *, start_s: float = 0.0, end_s: float | None = None
) -> Iterator[np.ndarray]:
    """Yield the frames of a video with start_s <= time < end_s, in order.

    Each is an RGB image (height, width, 3), uint8, of its own, which may be changed.
    Raises OSError if the file cannot be read, ValueError if there is no frame in that
    time.
    """
    for _, frame in read_numbered(path, start_s, end_s):
        yield frame


def read_numbered(
    path: str | Path, start_s: float, end_s: float | None
) -> Iterator[tuple[int, np.ndarray]]:
    """Yield number and RGB image of the frames of a video; see `read_video`."""
    last_s = np.inf if end_s is None else end_s
    if not 0 <= start_s < last_s:
        raise ValueError(f"{path}: from {start_s} s to {end_s} s there is no time.")
    with open_video(path) as capture:
        fps = capture.get(cv2.CAP_PROP_FPS)
        announced = round(capture.get(cv2.CAP_PROP_FRAME_COUNT))
        # 4.6 - 2.6 is 1.9999...: a time this close to a frame is meant to be its time
        first = int(np.ceil(start_s * fps - 1e-3))
        end = np.ceil(last_s * fps - 1e-3)

        # seeking is exact in few files; passing over frames is, and takes 1 ms each
        number = 0
        while number < first and capture.grab():
            number += 1
        read = 0
        while number < end:
            is_there, bgr = capture.read()
            if not is_there:
                break
            yield number, cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)
            number += 1
            read += 1
    if not read:
        raise ValueError(f"{path}: has no frame at {start_s} s; it ends before.")
    if number < min(end, announced):
        warnings.warn(
            f"{path}: only {number} of {announced} frames can be read: it is damaged, "
            "or was cut so that the others are hidden.",
            stacklevel=3,
        )


def process_video(
    source: str | Path,
    target: str | Path,
    function: FrameFunction,
    *,
    start_s: float = 0.0,
    end_s: float | None = None,
    telemetry: str | Path | None = None,
) -> int:
    """Write a video of what a function makes of each frame, with the source's sound.

    `function` takes an RGB image and returns one, or a pair of it and a row of
    telemetry, which goes into the CSV file `telemetry`. It is called once for each
    frame from `start_s` to `end_s`, in order. `target` ends in .mp4 and has the
    source's frame rate; it is written under another name and renamed when it is
    complete. Returns the number of frames.

    Raises OSError if a file cannot be read or written, ValueError if the function does
    not return an RGB image, or the target is the source.
    """
    target = Path(target)
    if target.suffix.lower() != ".mp4":
        raise ValueError(f"{target}: the name of the new video must end in .mp4.")
    if target.exists() and os.path.samefile(source, target):
        raise ValueError(f"{target}: is the source itself; write under another name.")
    fps = frame_rate(source)
    target.parent.mkdir(parents=True, exist_ok=True)

    rows: list[dict[str, object]] = []
    frames = read_numbered(source, start_s, end_s)
    with complete_file(target) as partial_video:
        with video_writer(partial_video, source, fps, start_s, end_s) as write:
            for number, frame in frames:
                returned = function(frame)
                row: Row = {}
                if isinstance(returned, tuple):
                    returned, row = returned
                write(require_rgb(returned))
                rows.append({"frame": number, "time_s": round(number / fps, 6), **row})
        require_frames(partial_video, target, len(rows))
    if telemetry is not None:
        write_rows(Path(telemetry), rows)
    return len(rows)


@contextmanager
def video_writer(
    path: Path, source: str | Path, fps: float, start_s: float, end_s: float | None
) -> Iterator[Callable[[np.ndarray], None]]:
    """A function that appends an RGB image to a new mp4 with the sound of `source`."""
    from moviepy.video.io.ffmpeg_writer import FFMPEG_VideoWriter

    sound = path.with_suffix(".m4a")
    writer = None
    size = None

    def write(image: np.ndarray) -> None:
        nonlocal writer, size
        height, width = image.shape[:2]
        if size is None:
            size = (width, height)
            has_sound = write_sound(sound, source, start_s, end_s)
            writer = FFMPEG_VideoWriter(
                filename=str(path),
                size=(width + width % 2, height + height % 2),
                fps=fps,
                audiofile=str(sound) if has_sound else None,
                preset="veryfast",
                # the bytes depend on the number of threads; browsers play yuv420p
                threads=4,
                ffmpeg_params=["-movflags", "+faststart"],
            )
        require_size(image, size, "video")
        # H.264 needs an even width and height: the last column or row is repeated
        even = cv2.copyMakeBorder(
            src=image,
            top=0,
            bottom=height % 2,
            left=0,
            right=width % 2,
            borderType=cv2.BORDER_REPLICATE,
        )
        writer.write_frame(even)

    try:
        yield write
    finally:
        if writer is not None:
            writer.close()
        sound.unlink(missing_ok=True)


def write_sound(
    path: Path, source: str | Path, start_s: float, end_s: float | None
) -> bool:
    """Write the sound of a part of a video as AAC; False if it has none."""
    from moviepy import VideoFileClip

    with VideoFileClip(str(source)) as clip:
        if clip.audio is None:
            return False
        sound = clip.audio
        last_s = sound.duration
        if end_s is not None:
            last_s = min(end_s, last_s)
        if start_s >= last_s:
            return False
        part = sound.subclipped(start_s, last_s)
        part.write_audiofile(str(path), codec="aac", logger=None)
    return True


def require_frames(path: Path, target: Path, expected: int) -> None:
    """OSError if a video that was written does not hold all frames."""
    if not expected:
        raise ValueError(f"{target}: no frame was written.")
    with open_video(path) as capture:
        written = round(capture.get(cv2.CAP_PROP_FRAME_COUNT))
    if written != expected:
        raise OSError(
            f"{target}: only {written} of {expected} frames could be written; is there "
            "space left on the disk?"
        )


def write_rows(path: Path, rows: Sequence[Mapping[str, object]]) -> None:
    """Write rows of telemetry as CSV, empty where there is no value."""
    path.parent.mkdir(parents=True, exist_ok=True)
    names = dict.fromkeys(name for row in rows for name in row)
    text = io.StringIO()
    table = csv.DictWriter(text, fieldnames=list(names), lineterminator="\n")
    table.writeheader()
    for row in rows:
        table.writerow({name: csv_field(row.get(name)) for name in names})
    with complete_file(path) as partial_table:
        partial_table.write_text(text.getvalue(), encoding="utf-8", newline="")


def csv_field(value: object) -> object:
    """A value as it stands in the table: nine digits hide what differs by processor."""
    if value is None:
        return ""
    if isinstance(value, float | np.floating):
        return "" if np.isnan(value) else f"{value:.9g}"
    return value
