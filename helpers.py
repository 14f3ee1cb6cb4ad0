"""The classic lane finder in one file: read it from top to bottom.

Its sections are those of the course's chapters:

2. Calibrate the camera: read and write images, `Lens`, `calibrate`
3. Undistort the image: `undistort`, and points there and back
4. Look at the road from above: `FourPointWarp`, `road_homography`, pixels to metres
5. Separate paint from road: channels, gradients, the masks of the three recipes
6. Find the lines: histogram, `sliding_windows`, `band_pixels`
7. Fit and measure: `fit_line`, `ransac_line`, `RoadLine`
8. Remember and put together: `Line`, `RECIPES`, `LaneFinder`; draw; `process_video`

It needs NumPy, OpenCV and moviepy only: copy it next to your own notebook. Three
published answers to Udacity's project "Advanced Lane Finding" are *recipes* here:

- "hls_sobel" (A): warp the colour image; saturation or gradients; mean of five fits;
- "equalized_hsv" (B): brightest or yellow pixels or edges; mean of ten fits;
- "best_channel" (C): six binaries, the best one for each line; mean of thirty fits.

Their numbers are the published ones. Where the originals had defects, this file differs
from them, and tests/test_helpers_*.py have a test for each difference.

Points of images are (u, v), column and row, pixels. Points of the road are (x, y), x
forward and y to the left, metres.
"""

from __future__ import annotations

import csv
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import KW_ONLY, astuple, dataclass, field, replace
from functools import cached_property, partial
from itertools import chain, product
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike

Image = np.ndarray  # RGB, (height, width, 3), uint8
# 0 or 255, (height, width), uint8: binaries combine with & and |, and can be warped or
# shown as they are
Binary = np.ndarray
Array = np.ndarray  # of another shape, which the docstring tells
Points = Sequence[Sequence[float]]
Colour = tuple[int, int, int]
Row = dict[str, str | float | None]  # of the telemetry, by the names of the columns

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
# Largest standard deviation of the focal length, as a share of it. Three tilted boards
# reach 0.001; three copies of one image have 0.024 and more.
MAX_FOCAL_STD = 0.02


def require_rgb(image: Image) -> Image:
    """The image, contiguous in memory; ValueError if it is not RGB, uint8."""
    is_rgb = False
    got = type(image).__name__
    if isinstance(image, np.ndarray):
        got = f"shape {image.shape}, dtype {image.dtype}"
        has_pixels = image.ndim == 3 and image.size > 0
        is_rgb = has_pixels and image.shape[2] == 3 and image.dtype == np.uint8
    if not is_rgb:
        raise ValueError(
            "expected an RGB image of shape (height, width, 3) and dtype uint8, "
            f"got {got}; read it with read_image."
        )
    return np.ascontiguousarray(image)


def require_size(image: Image, size: tuple[int, int], owner: str) -> None:
    """ValueError if an image is not of the size (width, height) of the lens or warp."""
    height, width = image.shape[:2]
    if (width, height) != tuple(size):
        raise ValueError(
            f"the image is {width}x{height} pixels, but this {owner} is for "
            f"{size[0]}x{size[1]}; use images of that size, or another {owner}."
        )


def read_image(path: str | Path) -> Image:
    """The image of a file; OSError if it does not exist, is cut off or is no image."""
    data = np.frombuffer(Path(path).read_bytes(), np.uint8)
    bgr = cv2.imdecode(data, cv2.IMREAD_COLOR) if data.size else None
    if bgr is None:
        raise OSError(
            f"{path}: cannot be decoded as an image; it is empty, cut off or of "
            "another format: copy it again, or convert it to JPEG."
        )
    return cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)


@contextmanager
def complete_file(path: Path) -> Iterator[Path]:
    """Another name to write a file under; it is renamed if the block succeeds."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial_path = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        # a folder that cannot be written to is reported before the work
        partial_path.touch()
        yield partial_path
        partial_path.replace(path)
    finally:
        partial_path.unlink(missing_ok=True)


def write_image(path: str | Path, image: Image) -> Path:
    """Write an image in the format of the suffix, creates folders, returns the path.

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

    matrix: Array  # (3, 3), pixels
    distortion: Array  # (5,)
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
    def maps(self) -> tuple[Array, Array]:
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

    points: Array  # (N, 3) on the board, squares, z = 0
    corners_px: Array  # (N, 2) in the image
    size: tuple[int, int]  # (width, height) of the image


def calibrate(
    board_files: str | Path | Iterable[str | Path], corners: tuple[int, int] = (9, 6)
) -> Lens:
    """Lens from images of a chessboard in different positions (Zhang, PAMI 2000).

    `board_files` is a folder or a list of files, `corners` the board's inner corners
    (columns, rows). Boards that the image border cuts off count with their visible
    part. Images without a board, images of another size and boards that fit far worse
    than the others are left out; `Lens.not_used` names them.

    Raises OSError if a file cannot be read, ValueError if fewer than three boards
    remain or they do not determine the lens.
    """
    boards: dict[str, Board] = {}
    not_used: dict[str, str] = {}
    for file in list_images(board_files):
        if file.name in {**boards, **not_used}:
            raise ValueError(f"two boards are called {file.name}; rename one of them.")
        gray = cv2.cvtColor(read_image(file), cv2.COLOR_RGB2GRAY)
        board = find_board(gray, corners)
        if board is not None:
            boards[file.name] = board
        else:
            grid = f"{corners[0]}x{corners[1]}"
            not_used[file.name] = f"no board of {grid} corners, nor a part of it"

    # the lens is for images of the most frequent size
    sizes = Counter(board.size for board in boards.values())
    size = max(sizes, key=sizes.__getitem__, default=(0, 0))
    for name, board in list(boards.items()):
        difference = np.abs(np.subtract(board.size, size))
        if difference.max() > MAX_CROP_PX:
            width, height = board.size
            not_used[name] = f"is {width}x{height}, not {size[0]}x{size[1]}"
            del boards[name]

    if len(boards) < 3:
        reasons = "".join(f"\n  {name}: {not_used[name]}" for name in not_used)
        raise ValueError(
            f"only {len(boards)} images show a board that can be used, but a "
            "calibration needs three, better 15; take more, tilted to different sides, "
            f"or give the number of inner corners of your board.{reasons}"
        )
    return fit_without_outliers(boards, size, not_used)


def list_images(files: str | Path | Iterable[str | Path]) -> list[Path]:
    """The images of a folder, or the listed files; board2 comes before board10."""

    def by_number(path: Path) -> tuple[int, str]:
        return len(path.name), path.name

    if isinstance(files, str | Path):
        inside = Path(files).iterdir()
        files = [path for path in inside if path.suffix.lower() in IMAGE_FILES]
    return sorted(map(Path, files), key=by_number)


def find_board(gray: Array, corners: tuple[int, int]) -> Board | None:
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
            # on the board, row by row: (0, 0, 0), (1, 0, 0), ...
            points = np.zeros((rows * columns, 3), np.float32)
            points[:, :2] = np.mgrid[:columns, :rows].T.reshape(-1, 2)
            if unevenness(grid, points) <= MAX_UNEVENNESS:
                return Board(points, refine_corners(gray, grid), (width, height))
    return None


def smaller_grids(corners: tuple[int, int]) -> list[tuple[int, int]]:
    """The whole board (columns, rows) and its parts, the largest first."""
    columns, rows = corners
    some_columns = range(min(MIN_COLUMNS, columns), columns + 1)
    some_rows = range(min(MIN_ROWS, rows), rows + 1)
    return sorted(product(some_columns, some_rows), key=np.prod, reverse=True)


def unevenness(grid: Array, points: Array) -> float:
    """Largest distance of corners (rows, columns, 2) from an even grid, in squares."""
    pixels = grid.reshape(-1, 2)
    homography, _ = cv2.findHomography(points[:, :2], pixels)
    if homography is None:
        return np.inf
    even = transform_points(points[:, :2], homography)
    distances_px = np.linalg.norm(even - pixels, axis=1)
    return float(distances_px.max() / smallest_square_px(grid))


def smallest_square_px(grid: Array) -> float:
    """Shortest distance between neighbours in a grid of corners (rows, columns, 2)."""
    along_rows = np.linalg.norm(np.diff(grid, axis=1), axis=2)
    along_columns = np.linalg.norm(np.diff(grid, axis=0), axis=2)
    return float(min(along_rows.min(), along_columns.min()))


def refine_corners(gray: Array, grid: Array) -> Array:
    """Corners (N, 2) to a fraction of a pixel (Foerstner and Guelch, 1987)."""
    # a larger window reaches other corners, a smaller one is noisier
    half_window_px = int(np.clip(smallest_square_px(grid) / 3, 2, 11))
    refined = cv2.cornerSubPix(
        image=gray,
        corners=grid.reshape(-1, 1, 2).copy(),
        winSize=(half_window_px, half_window_px),
        zeroZone=(-1, -1),
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 60, 1e-4),
    )
    return refined.reshape(-1, 2)


def fit_without_outliers(
    boards: dict[str, Board], size: tuple[int, int], not_used: dict[str, str]
) -> Lens:
    """Lens of the boards; those that fit far worse go from `boards` to `not_used`."""
    while True:
        lens = fit_lens(boards, size, not_used)
        errors_px = lens.board_rms_px
        worst = max(errors_px, key=errors_px.__getitem__)
        median_px = float(np.median(list(errors_px.values())))
        limit_px = max(MAX_ERROR_RATIO * median_px, MIN_ERROR_PX)
        # of three boards nobody can say which one is wrong
        if len(boards) == 3 or errors_px[worst] <= limit_px:
            return lens
        reason = f"error {errors_px[worst]:.2f} px, the median board {median_px:.2f} px"
        not_used[worst] = reason
        del boards[worst]


def fit_lens(
    boards: Mapping[str, Board], size: tuple[int, int], not_used: Mapping[str, str]
) -> Lens:
    """Lens that fits all boards best; ValueError if they do not determine it."""
    # several threads sum in another order each time: the last digits would change
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        rms_px, matrix, distortion, _, _, deviations, _, errors_px = (
            cv2.calibrateCameraExtended(
                objectPoints=[board.points for board in boards.values()],
                imagePoints=[board.corners_px for board in boards.values()],
                imageSize=size,
                # no first guess: they are overwritten
                cameraMatrix=np.eye(3),
                distCoeffs=np.zeros(5),
            )
        )
    finally:
        cv2.setNumThreads(threads)
    focal_std = deviations[0, 0] / matrix[0, 0]
    # also if it is NaN
    if not focal_std <= MAX_FOCAL_STD:
        raise ValueError(
            "these boards do not determine the lens; take images in which the board is "
            "tilted by 20 to 45 degrees, each time to another side."
        )
    return Lens(
        matrix=matrix,
        distortion=distortion.ravel()[:5],
        size=size,
        rms_px=rms_px,
        board_rms_px=dict(zip(boards, errors_px.ravel().tolist(), strict=True)),
        not_used=not_used,
    )


# 3. Undistort the image


def undistort(image: Image, lens: Lens) -> Image:
    """The image that a lens without distortion would have taken.

    Raises ValueError if the image is not RGB, or not of the lens's size.
    """
    image = require_rgb(image)
    require_size(image, lens.size, "lens")
    map_u, map_v = lens.maps
    return cv2.remap(image, map_u, map_v, cv2.INTER_LINEAR)


def as_points(points: ArrayLike) -> Array:
    """Points as an array (N, 2) of floats."""
    return np.asarray(points, float).reshape(-1, 2)


def finite_points(points: ArrayLike | None) -> Array:
    """Points (N, 2) without those that are not finite; (0, 2) for None."""
    pairs = as_points([] if points is None else points)
    return pairs[np.isfinite(pairs).all(axis=1)]


def homogeneous(points: ArrayLike) -> Array:
    """Points (N, 3), the third number 1, for points (N, 2)."""
    pairs = as_points(points)
    return np.column_stack([pairs, np.ones(len(pairs))])


def undistort_points(points_px: ArrayLike, lens: Lens) -> Array:
    """Points (N, 2) of the undistorted image for points (N, 2) of the raw one."""
    points = as_points(points_px)
    if not len(points):
        return points
    undistorted = cv2.undistortPoints(
        src=points[:, None],
        cameraMatrix=lens.matrix,
        distCoeffs=lens.distortion,
        P=lens.matrix,
        # OpenCV's five steps leave errors of pixels in the corners of wide lenses
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 1000, 1e-12),
    )
    return undistorted[:, 0]


def distort_points(points_px: ArrayLike, lens: Lens) -> Array:
    """Points (N, 2) of the raw image for points (N, 2) of the undistorted one.

    They are NaN where the lens model does not hold: far outside the image its
    polynomial turns back and would place them inside.
    """
    points = as_points(points_px)
    if not len(points):
        return points
    no_rotation = no_translation = np.zeros(3)
    raw, _ = cv2.projectPoints(
        objectPoints=homogeneous(points) @ np.linalg.inv(lens.matrix).T,
        rvec=no_rotation,
        tvec=no_translation,
        cameraMatrix=lens.matrix,
        distCoeffs=lens.distortion,
    )
    raw = raw[:, 0]
    there_and_back = undistort_points(raw, lens)
    off_px = np.linalg.norm(there_and_back - points, axis=1)
    raw[~(off_px < 1)] = np.nan
    return raw


# 4. Look at the road from above


class FourPointWarp:
    """Homography from four points of the undistorted image to the bird's-eye view.

    If the four points form a rectangle on a flat road, the view is a map of the road
    with two constant scales. Those of the recipes were chosen by eye and do so only
    roughly. Raises ValueError if the points do not go around a convex quadrangle.
    """

    def __init__(
        self, source_px: ArrayLike, destination_px: ArrayLike, size: tuple[int, int]
    ) -> None:
        # (4, 2) in the undistorted image, and the same points in the view
        self.source_px = require_quadrangle(source_px, "source_px")
        self.destination_px = require_quadrangle(destination_px, "destination_px")
        self.size = size  # (width, height) of both
        self.matrix = cv2.getPerspectiveTransform(self.source_px, self.destination_px)
        self.inverse = np.linalg.inv(self.matrix)

    def image_to_birdseye(self, image: Image) -> Array:
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

    def points_to_birdseye(self, points_px: ArrayLike) -> Array:
        """Points (N, 2) of the bird's-eye view for points (N, 2) of the image."""
        return transform_points(points_px, self.matrix)

    def points_to_image(self, points_px: ArrayLike) -> Array:
        """Points (N, 2) of the undistorted image for points (N, 2) of the view."""
        return transform_points(points_px, self.inverse)


def require_quadrangle(points_px: ArrayLike, name: str) -> Array:
    """Four points (4, 2), float32; ValueError unless they go around a quadrangle."""
    points = np.array(points_px, np.float32)
    is_quadrangle = (
        points.shape == (4, 2)
        and np.isfinite(points).all()
        # for other points OpenCV returns a useless homography without a word
        and cv2.isContourConvex(points)
    )
    if not is_quadrangle:
        raise ValueError(
            f"{name}: expected four points (u, v) in order around a convex quadrangle, "
            f"got {points.tolist()}."
        )
    return points


def transform_points(points_px: ArrayLike, matrix: Array) -> Array:
    """Points (N, 2) behind a homography (3, 3)."""
    points = as_points(points_px)
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
) -> Array:
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
    # car axes: x forward, y left, z up; camera axes: X right, Y down, Z forward
    yaw = rotation("xy", yaw_rad)
    pitch = rotation("zx", pitch_rad)
    roll = rotation("yz", roll_rad)
    axes = np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0]])
    road_to_camera = axes @ (yaw @ pitch @ roll).T
    forward, left, up = road_to_camera.T
    # a road point is x forward + y left from the camera's foot, which is below it
    road_to_image = lens.matrix @ np.column_stack([forward, left, -height_m * up])
    return np.linalg.inv(road_to_image)


def rotation(axes: str, angle_rad: float) -> Array:
    """Rotation (3, 3) of the first axis towards the second one: "xy", "yz" or "zx"."""
    first, second = map("xyz".index, axes)
    matrix = np.eye(3)
    matrix[first, first] = matrix[second, second] = np.cos(angle_rad)
    matrix[second, first] = np.sin(angle_rad)
    matrix[first, second] = -np.sin(angle_rad)
    return matrix


def pixels_to_road(points_px: ArrayLike, image_to_road: Array) -> Array:
    """Points (N, 2) on the flat road, metres, of undistorted pixels (N, 2).

    `image_to_road` is a homography of `road_homography`. NaN at and above the horizon.
    """
    x, y, inverse_depth = (homogeneous(points_px) @ image_to_road.T).T
    depth = 1 / np.where(inverse_depth > 1e-9, inverse_depth, np.nan)
    return np.column_stack([x * depth, y * depth])


def road_to_pixels(points_m: ArrayLike, image_to_road: Array) -> Array:
    """Undistorted pixels (N, 2) of points (N, 2) on the flat road, metres.

    NaN behind the camera.
    """
    # the same division by the third number, which is the depth this time
    return pixels_to_road(points_m, np.linalg.inv(image_to_road))


def birdseye_to_road(
    points_px: ArrayLike, warp: FourPointWarp, image_to_road: Array
) -> Array:
    """Points (N, 2) on the flat road, metres, of points (N, 2) in the bird's-eye view.

    It is exact for every quadrangle of the warp. NaN at and above the horizon.
    """
    return pixels_to_road(warp.points_to_image(points_px), image_to_road)


def scale_to_road(
    points_px: ArrayLike,
    metres_per_px: tuple[float, float],
    birdseye_size: tuple[int, int],
) -> Array:
    """Points (N, 2) on the road of points (N, 2) in the view by the two usual scales.

    `metres_per_px` is (metres per column, metres per row), in the originals (3.7 / 700,
    30 / 720). The car is taken to be at the centre of the bottom row.
    """
    u, v = as_points(points_px).T
    width, height = birdseye_size
    across_m, along_m = metres_per_px
    rows_ahead = height - 1 - v
    columns_left = (width - 1) / 2 - u
    return np.column_stack([rows_ahead * along_m, columns_left * across_m])


def metres_per_pixel(warp: FourPointWarp, image_to_road: Array) -> tuple[float, float]:
    """(metres per column, metres per row) of a view.

    They are exact only if the four points are a rectangle on the road: the first one is
    that at the centre of the bottom row, where the offset is measured, the second one
    the mean over the centre column. Raises ValueError if the view reaches the horizon.
    """
    width, height = warp.size
    centre = (width - 1) / 2
    bottom = height - 1
    across_px = [(centre - 0.5, bottom), (centre + 0.5, bottom)]
    along_px = [(centre, bottom), (centre, 0)]
    points_m = birdseye_to_road(across_px + along_px, warp, image_to_road)
    if not np.isfinite(points_m).all():
        raise ValueError(
            "the quadrangle of the warp reaches the horizon of this camera, so its "
            "rows have no length on the road; choose lower points or correct the pitch."
        )
    left, right, near, far = points_m
    across_m = np.linalg.norm(left - right)
    along_m = np.linalg.norm(far - near) / bottom
    return float(across_m), float(along_m)


# 5. Separate paint from road

CONVERSIONS = {
    "HLS": cv2.COLOR_RGB2HLS,
    "HSV": cv2.COLOR_RGB2HSV,
    "Lab": cv2.COLOR_RGB2LAB,
    "Luv": cv2.COLOR_RGB2LUV,
}


def colour_channel(image: Image, name: str) -> Array:
    """One channel (height, width), uint8, of an RGB image.

    `name` is "gray", "equalized" (after histogram equalization), or space and channel:
    "RGB R", "HLS S", "HSV V", "Lab b", "Luv L". Hue is 0 to 179, two degrees a level.
    Raises ValueError if the name is not known, or the image is not RGB.
    """
    image = require_rgb(image)
    if name in ("gray", "equalized"):
        gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        return gray if name == "gray" else cv2.equalizeHist(gray)

    space, _, letter = name.partition(" ")
    if space not in ("RGB", *CONVERSIONS) or letter not in list(space):
        raise ValueError(
            f"channel {name!r} is not known; use gray, equalized, or for example "
            "HLS S, Lab b, RGB R."
        )
    if space != "RGB":
        image = cv2.cvtColor(image, CONVERSIONS[space])
    return np.ascontiguousarray(image[..., space.index(letter)])


def sobel_gradient(channel: Array, kernel: int = 3) -> tuple[Array, Array]:
    """Horizontal and vertical gradient (height, width), float32.

    They are k for a step edge of k levels, whatever the size of the kernel.
    """
    derivative, smoothing = cv2.getDerivKernels(1, 0, kernel)
    step = np.abs(np.cumsum(derivative)).max()
    scale = 1 / (smoothing.sum() * step)
    along_u = cv2.Sobel(channel, cv2.CV_32F, 1, 0, ksize=kernel, scale=scale)
    along_v = cv2.Sobel(channel, cv2.CV_32F, 0, 1, ksize=kernel, scale=scale)
    return along_u, along_v


def gradient_mask(
    gradient: Array, low: float, high: float, *, full_step: float
) -> Binary:
    """Binary of the pixels whose gradient, of any sign, is in a range, ends included.

    The published gradients are scaled so that the largest one of the image is 255: one
    glint changes every threshold. Here a step edge of `full_step` levels is 255. In the
    recipes these are the medians of the largest gradient over 66 motorway images: gray
    180 with a kernel of 3 and 195 with 9, lightness of the view 78, saturation 232.
    Those of recipe A are rounded to 75 and 255, closer to its published results.
    """
    scale = full_step / 255
    # 255 is the end of the scale and includes all larger gradients
    top = np.inf if high >= 255 else high * scale
    return cv2.inRange(np.abs(gradient), low * scale, top)


def slanted_edges(channel: Array) -> Binary:
    """Binary of the slanted edges of a channel or a binary (C).

    Their direction is 0.7 to 1.2 rad; that of a vertical edge is 0, of a horizontal one
    pi / 2.
    """
    along_u, along_v = sobel_gradient(channel)
    direction_rad = cv2.phase(np.abs(along_u), np.abs(along_v))
    return cv2.inRange(direction_rad, 0.7, 1.2)


def hls_sobel_masks(image: Image, *, lowest: float) -> dict[str, Binary]:
    """Recipe A, of the warped RGB image; `lowest` is 20 in stills and 15 in videos.

    Its range of directions is left out: 0 to pi / 2 includes all. Saturation changes by
    nearly its full range next to white pixels, so a full step is the full range.
    """
    lightness = colour_channel(image, "HLS L")
    saturation = colour_channel(image, "HLS S")
    saturated: Binary = cv2.inRange(saturation, 120, 255)
    saturated &= cv2.inRange(lightness, 30, 255)
    lightness_u, _ = sobel_gradient(lightness)
    edges = gradient_mask(lightness_u, lowest, 255, full_step=75)
    saturation_u, saturation_v = sobel_gradient(saturation)
    size = cv2.magnitude(saturation_u, saturation_v)
    strong = gradient_mask(size, lowest, 255, full_step=255)
    return {
        "saturation": saturated,
        "gradient x": edges,
        "magnitude": strong,
        "combined": saturated | edges | strong,
    }


def equalized_hsv_masks(image: Image) -> dict[str, Binary]:
    """Recipe B, of the undistorted RGB image: white above 250, edges above 50."""
    white = cv2.inRange(colour_channel(image, "equalized"), 251, 255)
    yellow: Binary = cv2.inRange(colour_channel(image, "HSV H"), 0, 50)
    yellow &= cv2.inRange(colour_channel(image, "HSV S"), 70, 255)
    yellow &= cv2.inRange(colour_channel(image, "HSV V"), 70, 255)
    kernel, closing_px = kernels_of_b(image)
    along_u, along_v = sobel_gradient(colour_channel(image, "gray"), kernel)
    size = cv2.magnitude(along_u, along_v)
    strong = gradient_mask(size, 51, 255, full_step=195)
    # close the gaps
    square = np.ones((closing_px, closing_px), np.uint8)
    combined = cv2.morphologyEx(white | yellow | strong, cv2.MORPH_CLOSE, square)
    return {
        "white": white,
        "yellow": yellow,
        "magnitude": strong,
        "combined": combined,
    }


def kernels_of_b(image: Image) -> tuple[int, int]:
    """Sizes, odd numbers of pixels, of recipe B's Sobel filter and of its closing."""

    def odd_size(size_px: float, least: int) -> int:
        return max(2 * round((size_px - 1) / 2) + 1, least)

    height, width = image.shape[:2]
    scale = np.sqrt(width * height / (1280 * 720))
    # OpenCV's largest kernel has 31 pixels
    return min(odd_size(9 * scale, least=3), 31), odd_size(5 * scale, least=1)


def best_channel_masks(image: Image) -> dict[str, Binary]:
    """Recipe C, of the undistorted RGB image.

    Its author excludes the lower end of a range of values: red is above 210. The
    gradients include both ends.
    """
    gray = colour_channel(image, "gray")
    along_u, along_v = sobel_gradient(gray)
    size = cv2.magnitude(along_u, along_v)
    steep_u = gradient_mask(along_u, 100, 200, full_step=180)
    steep_v = gradient_mask(along_v, 100, 200, full_step=180)
    strong = gradient_mask(size, 10, 225, full_step=180)
    hue = cv2.inRange(colour_channel(image, "HLS H"), 21, 80)
    lab_b = cv2.inRange(colour_channel(image, "Lab b"), 156, 200)
    masks = {
        # in the author's order: of two equally good binaries the first one is taken
        "red": cv2.inRange(colour_channel(image, "RGB R"), 211, 255),
        "gradients": (steep_u & steep_v) | (strong & slanted_edges(gray)),
        # the edges of the binary of a channel, and not of the channel
        "hue": slanted_edges(hue),
        "saturation": cv2.inRange(colour_channel(image, "HLS S"), 86, 255),
        "luv lightness": cv2.inRange(colour_channel(image, "Luv L"), 226, 255),
        "lab b": slanted_edges(lab_b),
    }

    # without the sky and the adjacent lanes
    height, width = image.shape[:2]
    corners = np.array([(0, 1), (0.45, 1 / 1.8), (0.55, 1 / 1.8), (0.99, 1)])
    polygon = (corners * (width, height)).round().astype(np.int32)
    region = cv2.fillPoly(np.zeros((height, width), np.uint8), [polygon], 255)
    for mask in masks.values():
        mask &= region
    masks["combined"] = masks["saturation"] | masks["red"] | masks["lab b"]
    return masks


# 6. Find the lines


class WindowSearch(NamedTuple):
    """Of the left and the right line: pixels (N, 2), (u, v); windows (M, 4).

    A window is given by its left, top, right and bottom edge, pixels.
    """

    pixels: list[Array]
    windows: list[Array]


def lane_histogram(binary: Binary, rows_px: tuple[int, int] | None = None) -> Array:
    """Set pixels (width,) in each column of a binary.

    They are counted in `rows_px` (first, end), by default in the lower half.
    """
    if rows_px is None:
        rows_px = (len(binary) // 2, len(binary))
    first, end = rows_px
    return np.count_nonzero(binary[first:end], axis=0)


def find_peaks(histogram: Array) -> tuple[int | None, int | None]:
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


def binary_pixels(binary: Binary) -> Array:
    """(u, v) of every set pixel, (N, 2) int32, sorted by row."""
    pixels = cv2.findNonZero(binary)
    if pixels is None:
        return np.empty((0, 2), np.int32)
    return pixels.reshape(-1, 2)


def sliding_windows(
    binary: Binary,
    *,
    count: int = 9,
    margin_px: float = 80,
    recentre_pixels: int = 50,
    flood_pixels: float = np.inf,
    histogram_rows_px: tuple[int, int] | None = None,
) -> WindowSearch:
    """Pixels of each line from a stack of windows that starts at its histogram peak.

    `count` windows cover the full height; each reaches `margin_px` to both sides. One
    with more than `recentre_pixels` moves the next one to their mean column. The pixels
    of one with at least `flood_pixels` are dropped, because the threshold is flooded
    there; the next window moves all the same. A line without a peak has no windows and
    no pixels.
    """
    pixels = binary_pixels(binary)
    edges = np.linspace(len(binary), 0, count + 1).round().astype(int)
    # the pixels are sorted by row, so those in the rows of a window are one slice
    bounds = np.searchsorted(pixels[:, 1], edges)
    strips = [pixels[bounds[k + 1] : bounds[k]] for k in range(count)]

    search = WindowSearch(pixels=[], windows=[])
    for peak in find_peaks(lane_histogram(binary, histogram_rows_px)):
        found = [pixels[:0]]
        windows = []
        column: float | None = peak
        for k, strip in enumerate(strips):
            if column is None:
                break
            inside = strip[np.abs(strip[:, 0] - column) <= margin_px]
            left, right = column - margin_px, column + margin_px
            windows.append((left, edges[k + 1], right, edges[k] - 1))
            if len(inside) < flood_pixels:
                found.append(inside)
            if len(inside) > recentre_pixels:
                column = inside[:, 0].mean()
        search.pixels.append(np.concatenate(found))
        search.windows.append(np.array(windows, float).reshape(-1, 4))
    return search


def band_pixels(pixels: Array, line: Array, margin_px: float) -> Array:
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


def fit_line(pixels: ArrayLike, *, min_span_px: float = 2) -> Array | None:
    """Line (A, B, C) of least squares through pixels (N, 2); None without one.

    The pixels determine a line if they have three different rows, and `min_span_px`
    rows between the first and the last one.
    """
    u, v = as_points(pixels).T
    if len(v) < 3:
        return None
    first, last = v.min(), v.max()
    has_third_row = ((v > first) & (v < last)).any()
    if not has_third_row or last - first < min_span_px:
        return None
    # as np.polyfit(v, u, 2), in a tenth of its time: with rows from -1 to 1 the normal
    # equations are well conditioned
    centre = (first + last) / 2
    half_span = (last - first) / 2
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
) -> Array | None:
    """Line (A, B, C) through the largest consensus set; None without one.

    RANSAC (Fischler and Bolles 1981): each trial fits `samples` different pixels and
    counts the inliers, those within `residual_px` columns of its line; the inliers of
    the best trial are fitted. The same `seed` gives the same line. Three pixels
    determine a parabola; recipe C takes 150, which are less often free of outliers.
    """
    points = as_points(pixels)
    u, v = points.T
    random = np.random.default_rng(seed)
    sample_size = min(samples, len(points))
    best = np.zeros(len(points), bool)
    for _ in range(trials):
        chosen = random.choice(len(points), sample_size, replace=False)
        line = fit_line(points[chosen])
        if line is None:
            continue
        inliers = np.abs(u - np.polyval(line, v)) <= residual_px
        if np.count_nonzero(inliers) > np.count_nonzero(best):
            best = inliers
    return fit_line(points[best], min_span_px=min_span_px)


def line_points(line: Array, height: int) -> Array:
    """Points (N, 2) of a line in every eighth row and the last one, far to near."""
    rows = np.append(np.arange(0, height - 1, 8), height - 1)
    return np.column_stack([np.polyval(line, rows), rows])


def mean_distance_px(line: Array, other: Array, height: int) -> float:
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

    def lateral_m(self, x_m: ArrayLike) -> Array | float:
        """Lateral position at `x_m` metres ahead, positive left."""
        x = np.asarray(x_m, float)
        return self.c0_m + self.c1 * x + self.c2_per_m * x**2 / 2

    def curvature_per_m(self) -> float:
        """Curvature y'' / (1 + y'^2)^1.5 at the car, 1/m, > 0 bends left."""
        return float(self.c2_per_m / (1 + self.c1**2) ** 1.5)


def road_line(
    line: Array, to_road: Callable[[Array], Array], height: int
) -> RoadLine | None:
    """The line on the road: points of a line of the view, mapped and fitted there.

    `to_road` maps points (N, 2) of the view, of `height` rows, to metres. None if fewer
    than three points are below the horizon.
    """
    rows = np.linspace(0, height - 1, 60)
    points_px = np.column_stack([np.polyval(line, rows), rows])
    x, y = finite_points(to_road(points_px)).T
    if len(x) < 3 or np.ptp(x) == 0:
        return None
    half_c2, c1, c0 = np.polyfit(x, y, 2)
    return RoadLine(float(c0), float(c1), float(2 * half_c2))


# 8. Remember


@dataclass(eq=False)
class Line:
    """Memory of one line, for fits (3,) of consecutive frames.

    A new fit counts fully if no number of it differs by more than `accept` from the
    mean so far. If it does, but by no more than `damp`, it is doubtful: it counts with
    `weight`, the mean with the rest. Otherwise it is refused. Doubtful, refused and
    missing fits count as missed.
    """

    length: int  # accepted fits in the mean
    _: KW_ONLY
    accept: ArrayLike = np.inf
    damp: ArrayLike = 0.0
    weight: float = 0.0
    # Our restart: after more missed frames in a row the line begins again, because a
    # wrong one must not persist. The authors have none: A and B keep their last line
    # for ever, and the counter of C does nothing.
    max_missed: int = 25
    # what a frame without a fit does to the list: "keep" it, "drop newest" fit (A), or
    # "repeat last" fit (B)
    on_miss: str = "keep"
    near: str = "mean"  # search around the "mean" so far or the "last" fit
    fits: list[Array] = field(default_factory=list, init=False)
    missed: int = field(default=0, init=False)  # frames in a row
    # "found" in this frame, "kept" from earlier ones, or "lost"
    state: str = field(default="lost", init=False)

    def mean(self) -> Array | None:
        """Mean (3,) of the last fits; None without any."""
        if not self.fits:
            return None
        return np.mean(self.fits, axis=0)

    def search_near(self) -> Array | None:
        """The line around which to search in the next frame; None: use windows."""
        if self.missed or not self.fits:
            return None
        return self.fits[-1] if self.near == "last" else self.mean()

    def update(self, fit: Array | None) -> Array | None:
        """Take the fit of the next frame, or None; returns the mean so far."""
        mean = self.mean()
        share = 0.0
        if fit is not None:
            share = self.share_of(fit)
            if share > 0:
                self.fits.append(fit if mean is None else mean + share * (fit - mean))
        elif self.on_miss == "drop newest" and len(self.fits) > 1:
            self.fits.pop()
        elif self.on_miss == "repeat last" and self.fits:
            self.fits.append(self.fits[-1])
        self.fits = self.fits[-self.length :]

        if share == 1:
            self.missed = 0
            self.state = "found"
            return self.mean()
        self.missed += 1
        if self.missed > self.max_missed:
            self.fits = []
            self.missed = 0
        self.state = "kept" if self.fits else "lost"
        return self.mean()

    def share_of(self, fit: Array) -> float:
        """How much a new fit counts: 1, `weight` if doubtful, 0 if it is refused."""
        mean = self.mean()
        if mean is None:
            return 1.0
        change = np.abs(fit - mean)
        if np.less_equal(change, self.accept).all():
            return 1.0
        return self.weight if np.less_equal(change, self.damp).all() else 0.0

    def fresh(self, scale_u: float = 1.0, scale_v: float = 1.0) -> Line:
        """An empty memory with the same rules, for images scaled by two factors."""
        # units of A, B and C: px/px^2, px/px and px
        units = np.array([scale_u / scale_v**2, scale_u / scale_v, scale_u])
        accept = np.multiply(self.accept, units)
        damp = np.multiply(self.damp, units)
        return replace(self, accept=accept, damp=damp)


# The recipes: all numbers of the three finders, for images of 1280 x 720 pixels

POSE_SUFFIX = "_pose"  # of the name of a recipe with points from the camera pose
# The published top row is 41 m away in the course's images, and much farther for a
# camera that looks up.
MAX_FAR_EDGE_M = 60.0


@dataclass(frozen=True)
class Thresholds:
    """The binaries of a recipe."""

    # all binaries (height, width) of an RGB image by name, with one called "combined"
    masks: Callable[[Image], dict[str, Binary]]
    # those among which the best one is chosen for each line of a video, in this order
    candidates: Sequence[str] = ("combined",)


@dataclass(frozen=True)
class Recipe:
    """Settings of one classic lane finder, in pixels of images of `size`."""

    name: str
    source_px: Points  # of the homography, see FourPointWarp
    destination_px: Points
    thresholds: Thresholds  # of stills
    video_thresholds: Thresholds
    margin_px: float  # half width of the windows, and of the band in videos
    still_band_px: float  # half width of the band around the line of the windows
    left_line: Line  # empty; `LaneFinder` works with fresh ones
    right_line: Line
    size: tuple[int, int] = (1280, 720)  # (width, height)
    warp_first: bool = False  # warp the image and threshold it, or warp the binaries
    histogram_rows_px: tuple[int, int] = (360, 720)
    recentre_pixels: int = 50
    flood_pixels: float = np.inf
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

    def search_windows(self, binary: Binary) -> WindowSearch:
        """The sliding windows of this recipe in a binary of the view."""
        return sliding_windows(
            binary,
            margin_px=self.margin_px,
            recentre_pixels=self.recentre_pixels,
            flood_pixels=self.flood_pixels,
            histogram_rows_px=self.histogram_rows_px,
        )

    def four_point_warp(self) -> FourPointWarp:
        """The homography from the undistorted image to the bird's-eye view."""
        return FourPointWarp(self.source_px, self.destination_px, self.size)

    def scaled(self, size: tuple[int, int]) -> Recipe:
        """The same recipe for images resized to `size` (width, height).

        Lengths and counts of pixels are scaled. Gradients are not, because a smaller
        image has sharper edges. Raises ValueError if the size is not positive.
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
        return replace(
            self,
            size=(width, height),
            source_px=resize_points(self.source_px, scale_u, scale_v),
            destination_px=resize_points(self.destination_px, scale_u, scale_v),
            margin_px=self.margin_px * scale_u,
            still_band_px=self.still_band_px * scale_u,
            left_line=self.left_line.fresh(scale_u, scale_v),
            right_line=self.right_line.fresh(scale_u, scale_v),
            histogram_rows_px=(round(first_row * scale_v), round(end_row * scale_v)),
            recentre_pixels=max(round(self.recentre_pixels * area), 1),
            flood_pixels=np.round(self.flood_pixels * area),
            min_span_px=self.min_span_px * scale_v,
        )


def resize_points(points_px: Points, scale_u: float, scale_v: float) -> Points:
    """Points (N, 2) of a resized image; pixel centres are at whole numbers."""
    scale = (scale_u, scale_v)
    resized = (np.array(points_px) + 0.5) * scale - 0.5
    return resized.tolist()


MEMORY_OF_A = Line(5, accept=(0.001, 1.0, 100), on_miss="drop newest")
MEMORY_OF_B = Line(10, on_miss="repeat last", near="last")
# good: |dA| up to 7e-5 and |dC| up to 50 px; doubtful: up to 12e-5 on the left and
# 15e-5 on the right, and 150 px
GOOD_OF_C = (7e-5, np.inf, 50)
LEFT_OF_C = Line(30, accept=GOOD_OF_C, damp=(12e-5, np.inf, 150), weight=0.05)
RIGHT_OF_C = Line(30, accept=GOOD_OF_C, damp=(15e-5, np.inf, 150), weight=0.15)

HLS_SOBEL = Recipe(
    name="hls_sobel",
    source_px=((580, 460), (740, 460), (1100, 670), (270, 670)),
    destination_px=((200, 0), (1080, 0), (1080, 720), (200, 720)),
    warp_first=True,
    thresholds=Thresholds(partial(hls_sobel_masks, lowest=20)),
    video_thresholds=Thresholds(partial(hls_sobel_masks, lowest=15)),
    margin_px=80,
    still_band_px=80,
    left_line=MEMORY_OF_A,
    right_line=MEMORY_OF_A,
)
EQUALIZED_HSV = Recipe(
    name="equalized_hsv",
    source_px=((1280, 710), (0, 710), (546, 460), (732, 460)),
    destination_px=((1280, 720), (0, 720), (0, 0), (1280, 0)),
    thresholds=Thresholds(equalized_hsv_masks),
    video_thresholds=Thresholds(equalized_hsv_masks),
    histogram_rows_px=(360, 690),
    margin_px=100,
    still_band_px=100,
    left_line=MEMORY_OF_B,
    right_line=MEMORY_OF_B,
    measured_fits=20,
)
BEST_CHANNEL = Recipe(
    name="best_channel",
    source_px=((249, 690), (579, 460), (704, 460), (1058, 690)),
    destination_px=((249, 720), (249, 0), (1058, 0), (1058, 720)),
    thresholds=Thresholds(best_channel_masks),
    video_thresholds=Thresholds(
        best_channel_masks,
        candidates=("red", "gradients", "hue", "saturation", "luv lightness", "lab b"),
    ),
    margin_px=75,
    still_band_px=100,
    flood_pixels=9500,
    left_line=LEFT_OF_C,
    right_line=RIGHT_OF_C,
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


def recipe_from_pose(recipe: Recipe, image_to_road: Array) -> Recipe:
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

    fit: Array | None  # (3,)
    pixels: Array  # (N, 2) that were fitted
    binary: str  # name of the binary that they are from
    windows: Array  # (M, 4) of the search; M = 0 if it was a band


@dataclass(frozen=True, eq=False)
class LaneResult:
    """The lane in one frame, with intermediate results.

    Curvature > 0: the road bends left; offset > 0: the car is left of the lane centre.
    A measurement is None if a line that it needs is missing. `state` is "found" if both
    lines are measured in this frame, "kept" if one is from memory, "lost" if one is
    missing.
    """

    # (3,) in the bird's-eye view, from the memory if there is one
    left: Array | None
    right: Array | None
    left_road: RoadLine | None
    right_road: RoadLine | None
    state: str
    undistorted: Image  # (height, width, 3)
    # all binaries: of the view if the recipe warps first, else of the undistorted image
    masks: dict[str, Binary]
    warped_binary: Binary  # that with the pixels of both lines, in the view
    left_found: FoundLine  # of this frame, without the memory
    right_found: FoundLine
    warp: FourPointWarp

    @property
    def lines_px(self) -> list[Array | None]:
        """Points (N, 2) of both lines in the undistorted image, or None."""
        height = self.warp.size[1]
        lines = []
        for line in (self.left, self.right):
            points_px = None
            if line is not None:
                points_px = self.warp.points_to_image(line_points(line, height))
            lines.append(points_px)
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

    def lateral_m(self, x_m: ArrayLike) -> Array | None:
        """Lateral positions (2, N) of the lines at (N,) metres ahead, or None."""
        if self.left_road is None or self.right_road is None:
            return None
        return np.array([self.left_road.lateral_m(x_m), self.right_road.lateral_m(x_m)])

    def as_row(self) -> Row:
        """The measurements by the column names of the telemetry."""
        row: Row = {
            "state": self.state,
            "offset_m": self.offset_m,
            "curvature_per_m": self.curvature_per_m,
            "lane_width_m": self.lane_width_m,
        }
        for side, line in (("left", self.left_road), ("right", self.right_road)):
            for name in ("c0_m", "c1", "c2_per_m"):
                row[f"{side}_{name}"] = getattr(line, name, None)
        return row


class Frame(NamedTuple):
    """One image, as far as it is the same for both lines."""

    undistorted: Image
    masks: dict[str, Binary]
    binaries: dict[str, Binary]  # those that are searched, in the view


def nearest_line(
    candidates: Sequence[FoundLine], line_so_far: Array, height: int
) -> FoundLine:
    """The candidate whose fit is closest to a line; of equal ones the first."""

    def distance_px(candidate: FoundLine) -> float:
        if candidate.fit is None:
            return np.inf
        return mean_distance_px(candidate.fit, line_so_far, height)

    return min(candidates, key=distance_px)


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
        image_to_road: Array | None = None,
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
        memory_m = Line(recipe.measured_fits or 1, on_miss="repeat last")
        self.road_lines = [memory_m.fresh(), memory_m.fresh()]
        self.is_first_frame = True

    def find(self, image: Image) -> LaneResult:
        """The lane in one raw RGB image, without memory.

        Raises ValueError if the image is not RGB or of another size than the lens.
        """
        frame = self.look(image, self.recipe.thresholds, ["combined"])
        # windows, and then the band around the line in them
        first = self.search(frame, "combined", [None, None])
        fits = [line.fit for line in first]
        second = self.search(frame, "combined", fits, self.recipe.still_band_px)
        found = []
        for in_windows, in_band in zip(first, second, strict=True):
            found.append(replace(in_band, windows=in_windows.windows))

        left, right = found[0].fit, found[1].fit
        return self.result(
            frame,
            found,
            lines=[left, right],
            roads=[self.place_on_road(left), self.place_on_road(right)],
            state="lost" if left is None or right is None else "found",
        )

    def follow(self, image: Image) -> LaneResult:
        """The lane in the next frame of a drive, with memory; see `find`."""
        thresholds = self.recipe.video_thresholds
        frame = self.look(image, thresholds, thresholds.candidates)
        near = [line.search_near() for line in self.lines]
        if self.recipe.search_together and (near[0] is None or near[1] is None):
            near = [None, None]
        candidates = {}
        for name in frame.binaries:
            candidates[name] = self.search(frame, name, near, self.recipe.margin_px)
        found = [self.choose(candidates, side) for side in (0, 1)]
        self.is_first_frame = False

        lines = []
        roads = []
        for side in (0, 1):
            fit = found[side].fit
            lines.append(self.lines[side].update(fit))
            roads.append(self.measure(side, fit))
        states = [line.state for line in self.lines]
        worst_first = ("lost", "kept", "found")
        state = min(states, key=worst_first.index)
        return self.result(frame, found, lines=lines, roads=roads, state=state)

    def look(self, image: Image, thresholds: Thresholds, names: Sequence[str]) -> Frame:
        """The binaries of a raw image, and those of these names in the view."""
        undistorted = undistort(image, self.lens)
        if self.recipe.warp_first:
            masks = thresholds.masks(self.warp.image_to_birdseye(undistorted))
            binaries = {name: masks[name] for name in names}
        else:
            masks = thresholds.masks(undistorted)
            binaries = {
                name: self.warp.image_to_birdseye(masks[name]) for name in names
            }
        return Frame(undistorted, masks, binaries)

    def search(
        self,
        frame: Frame,
        name: str,
        near: Sequence[Array | None],
        band_px: float = 0.0,
    ) -> list[FoundLine]:
        """The left and the right line in a binary.

        Each is fitted to the pixels within `band_px` of the line in `near`, or, where
        that is None, to those in windows.
        """
        binary = frame.binaries[name]
        pixels = binary_pixels(binary)
        if near[0] is None or near[1] is None:
            in_windows = self.recipe.search_windows(binary)
        found = []
        for side, line in enumerate(near):
            if line is None:
                inside = in_windows.pixels[side]
                windows = in_windows.windows[side]
            else:
                inside = band_pixels(pixels, line, band_px)
                windows = np.empty((0, 4))
            fit = fit_line(inside, min_span_px=self.recipe.min_span_px)
            found.append(FoundLine(fit, inside, name, windows))
        return found

    def choose(self, candidates: dict[str, list[FoundLine]], side: int) -> FoundLine:
        """The left (0) or right (1) line from the best of the binaries."""
        line_so_far = self.lines[side].mean()
        if line_so_far is None:
            names = self.recipe.unknown_binaries
            if self.is_first_frame:
                names = self.recipe.first_binaries
            return candidates[names[side]][side]
        of_side = [found[side] for found in candidates.values()]
        return nearest_line(of_side, line_so_far, self.recipe.size[1])

    def place_on_road(self, line: Array | None) -> RoadLine | None:
        """The line in metres."""
        if line is None:
            return None
        return road_line(line, self.to_road, self.recipe.size[1])

    def measure(self, side: int, fit: Array | None) -> RoadLine | None:
        """The line in metres that is measured: from the memory, or a mean of fits."""
        if self.recipe.measured_fits is None:
            return self.place_on_road(self.lines[side].mean())
        road = self.place_on_road(fit)
        numbers = None if road is None else np.array(astuple(road))
        mean = self.road_lines[side].update(numbers)
        return None if mean is None else RoadLine(*mean.tolist())

    def result(
        self,
        frame: Frame,
        found: list[FoundLine],
        *,
        lines: list[Array | None],
        roads: list[RoadLine | None],
        state: str,
    ) -> LaneResult:
        """The result of a frame; lists are for the left and the right line."""
        left_binary = frame.binaries[found[0].binary]
        right_binary = frame.binaries[found[1].binary]
        return LaneResult(
            left=lines[0],
            right=lines[1],
            left_road=roads[0],
            right_road=roads[1],
            state=state,
            undistorted=frame.undistorted,
            masks=frame.masks,
            warped_binary=left_binary | right_binary,
            left_found=found[0],
            right_found=found[1],
            warp=self.warp,
        )


# Draw. All functions draw on a copy, except draw_polyline and put_text.

LANE_COLOUR: Colour = (0, 220, 90)
LEFT_COLOUR: Colour = (255, 70, 60)
RIGHT_COLOUR: Colour = (60, 130, 255)
WINDOW_COLOUR: Colour = (255, 210, 0)
RANSAC_COLOUR: Colour = (255, 0, 255)
# OpenCV draws at 1/16 px: coordinates are whole numbers with four fractional bits
SHIFT = 4


def to_rgb(image: Image) -> Image:
    """A new RGB image of an RGB or gray one, or of a binary (bool, 0 and 1 or 255)."""
    image = np.asarray(image)
    if image.ndim == 3:
        return require_rgb(image).copy()
    if image.max() <= 1:
        image = (image > 0).astype(np.uint8) * 255
    return require_rgb(np.dstack([image, image, image]))


def to_fixed_point(points_px: Array) -> Array:
    """Whole numbers (N, 2) of 1/16 px."""
    # a million is far outside any image, and its fixed-point number fits in 32 bits
    limited = points_px.clip(-1e6, 1e6)
    return np.round(limited * 2**SHIFT).astype(np.int32)


def draw_polyline(
    image: Image,
    points_px: Array,
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


def draw_windows(view: Array, windows_px: ArrayLike) -> Image:
    """Windows (M, 4) (left, top, right, bottom edge) on an image or a binary; RGB."""
    drawn = to_rgb(view)
    width_px = drawn.shape[1] / 320
    for left, top, right, bottom in np.asarray(windows_px, float).reshape(-1, 4):
        corners = [(left, top), (right, top), (right, bottom), (left, bottom)]
        draw_polyline(drawn, np.array(corners), WINDOW_COLOUR, width_px, closed=True)
    return drawn


def draw_pixels(view: Array, pixels_px: ArrayLike, *, colour: Colour) -> Image:
    """Pixels (N, 2) in a colour on an image or a binary; those outside are left out."""
    drawn = to_rgb(view)
    height, width = drawn.shape[:2]
    u, v = as_points(pixels_px).astype(int).T
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    drawn[v[inside], u[inside]] = colour
    return drawn


def draw_lines(
    view: Array,
    lines: Sequence[Array | None],
    *,
    colour: Colour = RANSAC_COLOUR,
    width_px: float | None = None,
) -> Image:
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
    image: Image,
    left_px: ArrayLike | None,
    right_px: ArrayLike | None,
    lens: Lens | None = None,
    *,
    line_width_px: float | None = None,
) -> Image:
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


def bend_line(points_px: Array, lens: Lens) -> Array:
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


def put_text(image: Image, lines: Sequence[str]) -> None:
    """White text on a dark panel at the top left, on the image itself."""
    height, width = image.shape[:2]
    font = cv2.FONT_HERSHEY_SIMPLEX
    scale = np.sqrt(width * height) / 960
    line_height = round(40 * scale)
    panel_height = round(line_height * (len(lines) + 0.5))
    text_widths = [cv2.getTextSize(text, font, scale, 2)[0][0] for text in lines]
    panel = image[:panel_height, : max(text_widths) + line_height]
    panel[:] = panel * 0.4
    for number, text in enumerate(lines, start=1):
        cv2.putText(
            img=image,
            text=text,
            org=(line_height // 2, number * line_height),
            fontFace=font,
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


def annotate_image(image: Image, result: LaneResult, lens: Lens) -> Image:
    """A copy of the raw RGB image with the lane and its measurements."""
    left_px, right_px = result.lines_px
    if result.state == "lost":
        left_px = right_px = None
    drawn = draw_lane(image, left_px, right_px, lens)
    put_text(drawn, describe_result(result))
    return drawn


# Videos

FrameFunction = Callable[[Image], Image | tuple[Image, Row]]


def follow_lane(finder: LaneFinder) -> FrameFunction:
    """A function for `process_video`: the next frame, annotated, and its telemetry."""

    def process(frame: Image) -> tuple[Image, Row]:
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


def frame_number(time_s: float, fps: float) -> float:
    """Number of the first frame at or after a time; infinite for an infinite time."""
    # 4.6 - 2.6 is 1.9999...: a time this close to a frame is meant to be its time
    return float(np.ceil(time_s * fps - 1e-3))


def read_video(
    path: str | Path, *, start_s: float = 0.0, end_s: float | None = None
) -> Iterator[Image]:
    """Yield the frames of a video with start_s <= time < end_s, in order.

    Each is an image of its own, which may be changed. Raises OSError if the file cannot
    be read, ValueError if there is no frame in that time. Warns if the file has fewer
    frames than it says.
    """
    last_s = np.inf if end_s is None else end_s
    if not 0 <= start_s < last_s:
        raise ValueError(f"{path}: from {start_s} s to {end_s} s there is no time.")
    with open_video(path) as capture:
        fps = capture.get(cv2.CAP_PROP_FPS)
        announced = round(capture.get(cv2.CAP_PROP_FRAME_COUNT))
        first = frame_number(start_s, fps)
        end = frame_number(last_s, fps)

        # seeking is exact in few files; passing over frames is, and takes 1 ms each
        number = 0
        while number < first and capture.grab():
            number += 1
        while first <= number < end:
            is_there, bgr = capture.read()
            if not is_there:
                break
            yield cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)
            number += 1
    if number <= first:
        raise ValueError(f"{path}: has no frame at {start_s} s; it ends before.")
    if number < min(end, announced):
        warnings.warn(
            f"{path}: only {number} of {announced} frames can be read: it is damaged, "
            "or was cut so that the others are hidden.",
            stacklevel=2,
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
    if target.exists() and target.samefile(source):
        raise ValueError(f"{target}: is the source itself; write under another name.")
    with open_video(source) as capture:
        fps = capture.get(cv2.CAP_PROP_FPS)
    rows: list[dict[str, object]] = []

    def process_frames() -> Iterator[Image]:
        first = int(frame_number(start_s, fps))
        frames = read_video(source, start_s=start_s, end_s=end_s)
        for number, frame in enumerate(frames, start=first):
            returned = function(frame)
            row: Row = {}
            if isinstance(returned, tuple):
                returned, row = returned
            rows.append({"frame": number, "time_s": round(number / fps, 6), **row})
            yield require_rgb(returned)

    # the sound of the same time, if there is any
    sound_filter = f"atrim=start={start_s},asetpts=PTS-STARTPTS"
    if end_s is not None:
        sound_filter = f"atrim=end={end_s}," + sound_filter
    with complete_file(target) as partial_video:
        write_video(partial_video, process_frames(), fps, source, sound_filter)
        with open_video(partial_video) as capture:
            written = round(capture.get(cv2.CAP_PROP_FRAME_COUNT))
        if written != len(rows):
            raise OSError(
                f"{target}: only {written} of {len(rows)} frames could be written; is "
                "there space left on the disk?"
            )
    if telemetry is not None:
        write_rows(Path(telemetry), rows)
    return len(rows)


def write_video(
    path: Path,
    images: Iterator[Image],
    fps: float,
    sound: str | Path,
    sound_filter: str,
) -> None:
    """Write RGB images and the filtered sound of a file as an mp4."""
    from moviepy.video.io.ffmpeg_writer import FFMPEG_VideoWriter

    first = next(images)
    height, width = first.shape[:2]
    # H.264 needs an even width and height
    odd_rows = height % 2
    odd_columns = width % 2
    with FFMPEG_VideoWriter(
        filename=str(path),
        size=(width + odd_columns, height + odd_rows),
        fps=fps,
        audiofile=str(sound),
        audio_codec="aac",
        preset="veryfast",
        # the bytes depend on the number of threads
        threads=4,
        ffmpeg_params=[
            # the images, and a sound track if there is one
            *("-map", "0:v"),
            *("-map", "1:a:0?"),
            *("-af", sound_filter),
            *("-movflags", "+faststart"),
        ],
    ) as writer:
        for image in chain([first], images):
            require_size(image, (width, height), "video")
            # below and to the right
            even = cv2.copyMakeBorder(
                image, 0, odd_rows, 0, odd_columns, cv2.BORDER_REPLICATE
            )
            writer.write_frame(even)


def write_rows(path: Path, rows: Sequence[Mapping[str, object]]) -> None:
    """Write rows of telemetry as CSV, empty where there is no value."""
    names = dict.fromkeys(name for row in rows for name in row)
    with (
        complete_file(path) as partial_path,
        partial_path.open("w", encoding="utf-8", newline="") as file,
    ):
        table = csv.DictWriter(file, list(names), lineterminator="\n")
        table.writeheader()
        for row in rows:
            fields = {name: csv_field(value) for name, value in row.items()}
            table.writerow(fields)


def csv_field(value: object) -> object:
    """A value as it stands in the table: nine digits hide what differs by processor."""
    if isinstance(value, float | np.floating):
        return "" if np.isnan(value) else f"{value:.9g}"
    return value
