"""The classic lane finder, in the order of chapters 2 to 8 of project.ipynb: read it from top to bottom.

Three published answers to Udacity's project "Advanced Lane Finding" are *recipes* here, as data in `RECIPES`:

- "hls_sobel" (A): warp the colour image; saturation or gradients; mean of the last five accepted fits;
- "equalized_hsv" (B): brightest and yellow pixels or strong gradients; mean of the last ten;
- "best_channel" (C): six binaries, the best one for each line; RANSAC; mean of the last thirty, with damped outliers.

The numbers are the published ones. Where the originals had defects, this file differs from them, and
tests/test_helpers_finder.py has a test for each difference. Images are RGB, points are (column, row) in pixels, road
points are (x forward, y left) in metres.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from math import inf
from typing import NamedTuple

import cv2
import numpy as np

# 1 to 3, images, lens and videos: the notebook builds these steps; the robust functions are those of `lanes`.
from lanes import canvas
from lanes.camera.calibration import calibrate as calibrate
from lanes.camera.model import Camera, resize_points
from lanes.camera.model import undistort as undistort
from lanes.describe import describe_bend as describe_bend
from lanes.describe import describe_offset as describe_offset
from lanes.errors import CameraError, PictureError
from lanes.video.images import read_image as read_image
from lanes.video.images import require_rgb
from lanes.video.images import to_rgb as to_rgb
from lanes.video.images import write_image as write_image
from lanes.video.reader import read_video as read_video
from lanes.video.writer import process_video as process_video

Points = Sequence[Sequence[float]]  # (u, v), pixels
Limits = tuple[float, float, float]
Fits = Sequence[Sequence["LineFit | None"]]

# 4. Look at the road from above


@dataclass(frozen=True, eq=False)
class FourPointWarp:
    """Homography that maps four points of the undistorted image to four points of the bird's-eye view.

    If the four points form a rectangle on a flat road, the view is a map of the road with two constant scales. The
    trapezia of the recipes were chosen by eye and fulfil this only approximately. Raises ValueError if there are not
    four points (u, v), or they do not go around a convex quadrangle.
    """

    source_px: np.ndarray  # (4, 2) (u, v) in the undistorted image, in order around the quadrangle
    destination_px: np.ndarray  # (4, 2) corresponding points in the bird's-eye view
    size: tuple[int, int]  # (width, height) of both
    matrix: np.ndarray = field(init=False, repr=False)
    inverse: np.ndarray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        for name in ("source_px", "destination_px"):
            points = np.array(getattr(self, name), np.float32)
            # OpenCV silently returns a singular homography for collinear points and self-intersecting quadrangles.
            if points.shape != (4, 2) or not np.isfinite(points).all() or not cv2.isContourConvex(points):
                raise ValueError(
                    f"{name}: expected four points (u, v) in order around a convex quadrangle, got {points.tolist()}."
                )
            object.__setattr__(self, name, points)
        object.__setattr__(self, "matrix", cv2.getPerspectiveTransform(self.source_px, self.destination_px))
        object.__setattr__(self, "inverse", np.linalg.inv(self.matrix))

    def image_to_birdseye(self, image: np.ndarray) -> np.ndarray:
        """Bird's-eye view of an undistorted image, both of `size`; binaries (2-D) keep their two values.

        Raises PictureError if `image` is not an RGB image or a binary of that size.
        """
        if not (isinstance(image, np.ndarray) and image.ndim == 2 and image.dtype == np.uint8):
            image = require_rgb(image)
        got, (width, height) = image.shape[1::-1], self.size
        if got != self.size:
            raise PictureError(
                f"picture: is {got[0]}x{got[1]} pixels, but this warp is for {width}x{height}; "
                "use a picture of that size, or a warp made for this one."
            )
        interpolation = cv2.INTER_NEAREST if image.ndim == 2 else cv2.INTER_LINEAR
        return cv2.warpPerspective(image, self.matrix, self.size, flags=interpolation)

    def points_to_birdseye(self, points_px: np.ndarray) -> np.ndarray:
        """Points (N, 2) of the bird's-eye view for points (N, 2) of the undistorted image."""
        return _transform(points_px, self.matrix)

    def points_to_image(self, points_px: np.ndarray) -> np.ndarray:
        """Points (N, 2) of the undistorted image for points (N, 2) of the bird's-eye view."""
        return _transform(points_px, self.inverse)


def _transform(points_px: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    points = np.asarray(points_px, float).reshape(-1, 2)
    if not len(points):
        return points
    return cv2.perspectiveTransform(points[:, None], matrix)[:, 0]


def birdseye_to_road(points_px: np.ndarray, warp: FourPointWarp, camera: Camera) -> np.ndarray:
    """Points (N, 2) on the flat road of points (N, 2) in the bird's-eye view; exact for every quadrangle.

    They are NaN at and above the horizon. The distortion of the camera is not applied, because `warp` starts from the
    undistorted image. Raises CameraError if the camera has no pose.
    """
    pinhole = replace(camera, distortion=np.zeros(5))
    return pinhole.pixels_to_road(warp.points_to_image(points_px))


def scale_to_road(
    points_px: np.ndarray, metres_per_px: tuple[float, float], birdseye_size: tuple[int, int]
) -> np.ndarray:
    """Points (N, 2) on the road of points (N, 2) in the bird's-eye view by constant scales, as in the original recipes.

    `metres_per_px` is (metres per column, metres per row), `birdseye_size` (width, height) in pixels. This assumes that
    the car is at the centre of the bottom row.
    """
    points = np.asarray(points_px, float)
    width, height = birdseye_size
    from_bottom_px, from_centre_px = height - 1 - points[:, 1], (width - 1) / 2 - points[:, 0]
    return np.column_stack([from_bottom_px * metres_per_px[1], from_centre_px * metres_per_px[0]])


def metres_per_pixel(warp: FourPointWarp, camera: Camera) -> tuple[float, float]:
    """(metres per column, metres per row) of a four-point warp, from the camera pose.

    They are exact only if the quadrangle is a rectangle on the road: the first one at the centre of the bottom row,
    where the offset is measured, the second one as the mean over the centre column. Raises CameraError if the camera
    has no pose, or the view reaches the horizon.
    """
    width, height = warp.size
    centre, bottom = (width - 1) / 2, height - 1
    points = np.array([[centre - 0.5, bottom], [centre + 0.5, bottom], [centre, bottom], [centre, 0]])
    road = birdseye_to_road(points, warp, camera)
    if not np.isfinite(road).all():
        raise CameraError(
            "the quadrangle of the warp reaches the horizon of this camera pose, so its rows have no length on the "
            "road; choose lower points or correct the pitch of the camera pose."
        )
    lateral = float(np.linalg.norm(road[0] - road[1]))
    longitudinal = float(np.linalg.norm(road[3] - road[2])) / max(height - 1, 1)
    return lateral, longitudinal


# 5. Separate paint from road
#
# A binary is an ndarray (height, width), uint8, 0 or 255, so that binaries combine with & and | and can be warped or
# shown as they are. Ranges include both ends.


class Levels(NamedTuple):
    """One threshold: the pixels whose value is in the range `low` to `high`, both ends included.

    The published gradients are on a scale on which the largest gradient of the image is 255, so that one glint of light
    changes every threshold. Here a step edge of `full_step` levels is 255: in `RECIPES` the medians of that largest
    gradient over 66 motorway images (gray 180 with a kernel of 3 and 195 with 9, lightness of the view 78, saturation
    232; those of recipe A are rounded to 75 and 255, which gives results closer to the published ones).
    """

    channel: str  # "gray", "equalized" (gray after histogram equalization), or space and channel: "HLS S", "Lab b"
    low: float  # OpenCV's 8-bit ranges: hue 0 to 179 (two degrees a level), all others 0 to 255
    high: float
    of: str = "value"  # or "gradient x", "gradient y", "magnitude"; "direction" in radians, 0 for a vertical edge
    full_step: float = 255
    kernel: int = 3  # size of the Sobel filter, pixels


def colour_channel(image: np.ndarray, name: str) -> np.ndarray:
    """One channel (height, width), uint8, of an RGB image, by the names of `Levels`.

    Raises ValueError if the name is not known, and PictureError if `image` is not an RGB image: OpenCV would silently
    ignore a fourth channel.
    """
    image, (space, _, letter) = require_rgb(image), name.partition(" ")
    if name in ("gray", "equalized"):
        gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        return gray if name == "gray" else cv2.equalizeHist(gray)
    if space not in ("RGB", "HLS", "HSV", "Lab", "Luv") or len(letter) != 1 or letter not in space:
        raise ValueError(f"channel {name!r} is not known; use gray, equalized, or for example HLS S, Lab b, RGB R.")
    converted = image if space == "RGB" else cv2.cvtColor(image, getattr(cv2, f"COLOR_RGB2{space.upper()}"))
    return np.ascontiguousarray(converted[..., space.index(letter)])


def sobel_gradient(channel: np.ndarray, kernel: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Horizontal and vertical gradient (height, width) of a channel, float32: k for a step edge of k levels."""
    derive, smooth = cv2.getDerivKernels(1, 0, kernel)
    scale = 1 / (smooth.sum() * np.abs(np.cumsum(derive)).max())
    along_x = cv2.Sobel(channel, cv2.CV_32F, 1, 0, ksize=kernel, scale=scale)
    return along_x, cv2.Sobel(channel, cv2.CV_32F, 0, 1, ksize=kernel, scale=scale)


def level_mask(
    levels: Levels,
    channel: Callable[[str], np.ndarray],
    gradient: Callable[[str, int], tuple[np.ndarray, np.ndarray]],
) -> np.ndarray:
    """Binary (height, width) of one threshold, from functions that give the channels and the gradients by name."""
    if levels.of == "value":
        return cv2.inRange(channel(levels.channel), levels.low, levels.high)
    along_x, along_y = gradient(levels.channel, levels.kernel)
    if levels.of == "direction":
        return cv2.inRange(cv2.phase(np.abs(along_x), np.abs(along_y)), levels.low, levels.high)
    # 255 is the end of the scale and includes all larger gradients.
    high = inf if levels.high >= 255 else levels.high * levels.full_step / 255
    if levels.of == "magnitude":
        size = cv2.magnitude(along_x, along_y)
    else:
        size = np.abs(along_x if levels.of == "gradient x" else along_y)
    return cv2.inRange(size, levels.low * levels.full_step / 255, high)


@dataclass(frozen=True)
class Thresholds:
    """The binaries of a recipe. A rule has alternatives, each of them `Levels` that all must hold."""

    rules: Mapping[str, tuple[tuple[Levels, ...], ...]]
    combined: tuple[str, ...]  # the binaries whose union is the binary "combined"
    candidates: tuple[str, ...] = ("combined",)  # those among which the best one is chosen for each line of a video
    region: Points | None = None  # polygon outside of which all are 0, as fractions of width and height
    close_px: int = 0  # gaps of "combined" narrower than this are closed

    def masks(self, image: np.ndarray) -> dict[str, np.ndarray]:
        """All binaries of an RGB image by name, and "combined"."""
        image = require_rgb(image)
        region = None
        if self.region:
            corners = np.round(np.array(self.region) * image.shape[1::-1]).astype(np.int32)
            region = cv2.fillPoly(np.zeros(image.shape[:2], np.uint8), [corners], 255)
        # The rows above the region are 0 and need no computation.
        top = 0 if region is None else int(region.any(axis=1).argmax())
        road = image[top:]
        channel = cache(lambda name: colour_channel(road, name))
        gradient = cache(lambda name, kernel: sobel_gradient(channel(name), kernel))
        masks = {}
        for name, alternatives in self.rules.items():
            rules = [[level_mask(one, channel, gradient) for one in levels] for levels in alternatives]
            mask = np.bitwise_or.reduce([np.bitwise_and.reduce(masks_of_all) for masks_of_all in rules])
            masks[name] = mask if region is None else mask & region[top:]
        masks["combined"] = np.bitwise_or.reduce([masks[name] for name in self.combined])
        if self.close_px:
            square = np.ones((self.close_px, self.close_px), np.uint8)
            masks["combined"] = cv2.morphologyEx(masks["combined"], cv2.MORPH_CLOSE, square)
        if top:
            border = partial(cv2.copyMakeBorder, borderType=cv2.BORDER_CONSTANT)
            masks = {name: border(mask, top=top, bottom=0, left=0, right=0) for name, mask in masks.items()}
        return masks

    def scaled(self, factor: float) -> Thresholds:
        """The same thresholds for images `factor` times as large; a kernel of 3 pixels stays, it is the finest one."""

        def odd(size: int, least: int) -> int:
            return max(2 * round((size * factor - 1) / 2) + 1, least)

        def scale(levels: Levels) -> Levels:  # OpenCV has Sobel filters of 3 to 31 pixels
            return levels if levels.kernel == 3 else levels._replace(kernel=min(odd(levels.kernel, 3), 31))

        rules = {name: tuple(tuple(map(scale, each)) for each in levels) for name, levels in self.rules.items()}
        return replace(self, rules=rules, close_px=self.close_px and odd(self.close_px, 1))


# 6. Find the lines


class WindowSearch(NamedTuple):
    """Pixels (N, 2) as (column, row) of each line, and the windows (M, 4): left, top, right and bottom edge, pixels."""

    pixels: list[np.ndarray]  # of the left and of the right line
    windows: list[np.ndarray]


def lane_histogram(binary: np.ndarray, rows_px: tuple[int, int] | None = None) -> np.ndarray:
    """Set pixels (width,) in each column of a binary, in `rows_px` (first, end), by default in the lower half."""
    first, end = rows_px or (binary.shape[0] // 2, binary.shape[0])
    return np.count_nonzero(binary[first:end], axis=0)


def find_peaks(histogram: np.ndarray) -> tuple[int | None, int | None]:
    """Columns of the highest peak left and right of the centre; None if a half is empty.

    Of equally high columns the one closest to the centre is used, so that a mirrored image has mirrored peaks.
    """
    middle = len(histogram) // 2
    left, right = histogram[:middle][::-1], histogram[middle:]
    left_peak = middle - 1 - int(left.argmax()) if left.any() else None
    return left_peak, middle + int(right.argmax()) if right.any() else None


def binary_pixels(binary: np.ndarray) -> np.ndarray:
    """(column, row) of every set pixel, (N, 2) int32, sorted by row."""
    found = cv2.findNonZero(binary)
    return np.empty((0, 2), np.int32) if found is None else found.reshape(-1, 2)


def sliding_windows(
    binary: np.ndarray,
    *,
    count: int = 9,
    margin_px: float = 80,
    recentre_pixels: int = 50,
    flood_pixels: int | None = None,
    histogram_rows_px: tuple[int, int] | None = None,
) -> WindowSearch:
    """Pixels of each line from a stack of windows that starts at the histogram peak and goes up.

    `count` windows cover the full height; each reaches `margin_px` to both sides. One with at least `recentre_pixels`
    moves the next one to their mean column; one with at least `flood_pixels` is dropped, because the threshold is
    flooded there. `histogram_rows_px`: see `lane_histogram`. A line without a peak has no windows and no pixels.
    """
    pixels = binary_pixels(binary)
    edges = np.linspace(len(binary), 0, count + 1).round().astype(int)
    # Pixels are sorted by row, so those in the rows of a window are one slice.
    bounds = np.searchsorted(pixels[:, 1], edges)
    search = WindowSearch([], [])
    for peak in find_peaks(lane_histogram(binary, histogram_rows_px)):
        column = float(peak or 0)
        caught, windows = [pixels[:0]], [np.empty((0, 4))]
        for k in range(0 if peak is None else count):
            strip = pixels[bounds[k + 1] : bounds[k]]
            inside = strip[np.abs(strip[:, 0] - column) <= margin_px]
            windows.append(np.array([[column - margin_px, edges[k + 1], column + margin_px, edges[k] - 1]]))
            if flood_pixels is not None and len(inside) >= flood_pixels:
                continue
            caught.append(inside)
            if len(inside) >= max(recentre_pixels, 1):
                column = float(inside[:, 0].mean())
        search.pixels.append(np.concatenate(caught))
        search.windows.append(np.concatenate(windows))
    return search


def band_pixels(pixels: np.ndarray, line: LineFit, margin_px: float) -> np.ndarray:
    """The pixels, of (N, 2), within `margin_px` columns of a known line, for example that of the previous frame."""
    if not len(pixels):
        return pixels
    # One evaluation per row and a lookup for each pixel is ten times faster than one evaluation per pixel.
    columns = line.columns(np.arange(pixels[:, 1].max() + 1)).astype(np.float32)
    return pixels[np.abs(pixels[:, 0] - columns[pixels[:, 1]]) <= margin_px]


# 7. Fit and measure
#
# In the bird's-eye view a line is x = A y^2 + B y + C, the column as a function of the row, because lane lines are
# nearly vertical there. On the road it is y = c0 + c1 x + c2 x^2 / 2, x forward and y left of the car, metres.


@dataclass(frozen=True)
class LineFit:
    """One lane line in the bird's-eye view: x = A y^2 + B y + C, column x and row y in pixels, y growing downward."""

    coefficients: tuple[float, float, float]  # A, B, C
    pixels: int  # number of pixels that support the line

    def columns(self, rows_px: np.ndarray | float) -> np.ndarray:
        """Columns in pixels at the given rows."""
        return np.polyval(self.coefficients, rows_px)

    def points(self, height: int) -> np.ndarray:
        """Points (N, 2) as (column, row) in every eighth row and the last, far to near, for drawing."""
        rows = np.append(np.arange(0, height - 1, 8), height - 1)
        return np.column_stack([self.columns(rows), rows])


def fit_line(pixels: np.ndarray, *, min_span_px: float = 2) -> LineFit | None:
    """Least-squares parabola through the pixels (N, 2) (column, row) of one line; None if they do not determine it.

    They need three different rows, and `min_span_px` rows between the first and the last one.
    """
    pixels = np.asarray(pixels, float).reshape(-1, 2)
    if not _determines_parabola(pixels[:, 1], min_span_px):
        return None
    x, y = pixels.T
    powers, centre, half_span = _scaled_powers(y)
    a, b, c = np.linalg.solve(powers.T @ powers, powers.T @ x)
    # Coefficients for unscaled rows: substitute (y - centre) / half_span.
    a, b = a / half_span**2, b / half_span
    coefficients = (float(a), float(b - 2 * a * centre), float(c - b * centre + a * centre**2))
    return LineFit(coefficients, len(y))


def ransac_line(
    pixels: np.ndarray,
    *,
    trials: int = 100,
    samples: int = 3,
    residual_px: float = 15.0,
    seed: int = 0,
    min_span_px: float = 2,
) -> LineFit | None:
    """Parabola through the largest consensus set (RANSAC, Fischler and Bolles 1981); see `fit_line`.

    Each trial fits `samples` pixels, drawn with replacement, and counts the inliers within `residual_px` columns among
    at most 2000 evenly spaced pixels. The inliers of the best trial are fitted by least squares. The same `seed` gives
    the same line. Three pixels determine a parabola; a sample of more is less often free of outliers.
    """
    pixels = np.asarray(pixels, float).reshape(-1, 2)
    if not _determines_parabola(pixels[:, 1], min_span_px):
        return None
    x, y = pixels.T
    powers, _, _ = _scaled_powers(y)
    drawn = np.random.default_rng(seed).integers(len(x), size=(trials, min(samples, len(x))))
    p = powers[drawn]
    # A sample may have fewer than three different rows. The pseudo-inverse then gives a line with few inliers.
    models = np.linalg.pinv(p.transpose(0, 2, 1) @ p, hermitian=True) @ (p.transpose(0, 2, 1) @ x[drawn][..., None])
    subset = slice(None, None, -(-len(x) // 2000))
    inliers = np.abs(powers[subset] @ models[..., 0].T - x[subset, None]) <= residual_px
    best = models[np.argmax(inliers.sum(axis=0)), :, 0]
    return fit_line(pixels[np.abs(powers @ best - x) <= residual_px], min_span_px=min_span_px)


def _determines_parabola(rows: np.ndarray, min_span_px: float) -> bool:
    if len(rows) < 3:
        return False
    first, last = rows.min(), rows.max()
    return last - first >= max(min_span_px, 2) and bool(((rows > first) & (rows < last)).any())


def _scaled_powers(rows: np.ndarray) -> tuple[np.ndarray, float, float]:
    """Powers (N, 3) of the rows scaled to -1..1, for well-conditioned normal equations; their centre and half span."""
    centre, half_span = (rows.min() + rows.max()) / 2, (rows.max() - rows.min()) / 2
    scaled = (rows - centre) / half_span
    return np.column_stack([scaled * scaled, scaled, np.ones_like(scaled)]), centre, half_span


def mean_fit(fits: Sequence[LineFit]) -> LineFit | None:
    """Mean of the coefficients, with the pixels of all fits; None without fits."""
    if not fits:
        return None
    a, b, c = np.mean([fit.coefficients for fit in fits], axis=0).tolist()
    return LineFit((a, b, c), sum(fit.pixels for fit in fits))


def mean_distance_px(fit: LineFit, other: LineFit, height: int) -> float:
    """Mean absolute distance between two lines over the rows 0..height-1, pixels."""
    rows = np.arange(height)
    return float(np.abs(fit.columns(rows) - other.columns(rows)).mean())


@dataclass(frozen=True)
class RoadLine:
    """A lane line on the road: y(x) = c0 + c1 x + c2 x^2 / 2, x forward and y left of the car, metres."""

    c0_m: float
    c1: float
    c2_per_m: float

    def lateral_m(self, x_m: np.ndarray | float) -> np.ndarray | float:
        """Lateral position at `x_m` metres ahead, positive left."""
        return self.c0_m + self.c1 * x_m + self.c2_per_m * np.square(x_m) / 2

    def curvature_per_m(self) -> float:
        """Signed curvature y'' / (1 + y'^2)^1.5 at the car, in 1/m."""
        return self.c2_per_m / (1 + self.c1**2) ** 1.5


def road_line(fit: LineFit, to_road: Callable[[np.ndarray], np.ndarray], height: int) -> RoadLine | None:
    """The line on the road: points of the line in the view, of `height` rows, are mapped to the road and fitted there.

    `to_road` maps points (N, 2) of the view to metres. None if fewer than three points are below the horizon.
    """
    rows = np.linspace(0, height - 1, 60)
    points = to_road(np.column_stack([fit.columns(rows), rows]))
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < 3 or np.ptp(points[:, 0]) == 0:
        return None
    half_c2, c1, c0 = np.polyfit(points[:, 0], points[:, 1], 2)
    return RoadLine(float(c0), float(c1), float(2 * half_c2))


# 8. Remember: the memory of one line


@dataclass(frozen=True)
class Line:
    """Memory of one line: mean of the last accepted fits, with a gate for new ones. `update` returns the next one."""

    length: int  # accepted fits averaged in `average`
    measured_length: int | None = None  # the same for `measured_average`; default `length`
    # Largest |dA|, |dB|, |dC| between a new fit and `average`. Within the first limits the fit is accepted, within the
    # second ones it is damped: its weight is `damped_weight`, and `average` has the rest. Otherwise it is rejected.
    accept_limits: Limits = (inf, inf, inf)
    damp_limits: Limits = (0, 0, 0)
    damped_weight: float = 0.0
    max_missed: int = 25  # after more missed frames in a row the line starts again: a wrong one must not persist
    search_again: bool = True  # search with windows in the frame after a miss, not around the previous line
    fits: tuple[LineFit, ...] = ()
    missed: int = 0
    state: str = "lost"

    @property
    def average(self) -> LineFit | None:
        """Mean of the last `length` fits; None before the first fit and after too many missed frames."""
        return mean_fit(self.fits[-self.length :])

    @property
    def measured_average(self) -> LineFit | None:
        """Mean of the last `measured_length` fits, for measurements on the road."""
        return mean_fit(self.fits)

    @property
    def search_prior(self) -> LineFit | None:
        """The line around which to search in the next frame; None for a search with sliding windows."""
        return None if self.missed and self.search_again else self.average

    def update(self, fit: LineFit | None) -> Line:
        """The memory after the next frame, with the fit of that frame or None.

        Its `state` is "found" if the fit was accepted, "kept" if it was not, "lost" if the memory has no line.
        """
        accepted = None if fit is None else self._accept(fit)
        if accepted is None:
            missed = self.missed + 1
            if not self.fits or missed > self.max_missed:
                return replace(self, fits=(), missed=0, state="lost")
            return replace(self, missed=missed, state="kept")
        fits = (*self.fits, accepted)[-(self.measured_length or self.length) :]
        return replace(self, fits=fits, missed=0, state="found" if accepted is fit else "kept")

    def scaled(self, sx: float, sy: float) -> Line:
        """The same settings, without fits, for images scaled by `sx` in columns and `sy` in rows."""
        # A, B and C have the units px/px^2, px/px and px.
        factors = (sx / sy**2, sx / sy, sx)
        accept_limits, damp_limits = (
            tuple(np.multiply(limits, factors).tolist()) for limits in (self.accept_limits, self.damp_limits)
        )
        return replace(self, accept_limits=accept_limits, damp_limits=damp_limits, fits=(), missed=0, state="lost")

    def _accept(self, fit: LineFit) -> LineFit | None:
        """The fit if it is accepted, a damped one, or None if it is rejected."""
        previous = self.average
        if previous is None:
            return fit
        average = np.array(previous.coefficients)
        change = fit.coefficients - average
        if (np.abs(change) <= self.accept_limits).all():
            return fit
        if self.damped_weight == 0 or (np.abs(change) > self.damp_limits).any():
            return None
        return replace(fit, coefficients=tuple((average + self.damped_weight * change).tolist()))


# The recipes: all numbers of the three lane finders, for images of 1280 x 720 pixels

POSE_SUFFIX = "_pose"  # of the name of a recipe with points from the camera pose
# The published top row is 41 m away in the embedded images, in a camera that looks farther up much farther.
_MAX_FAR_EDGE_M = 60.0


@dataclass(frozen=True)
class Recipe:
    """Settings of one classic lane finder, in pixels of images of `size`."""

    name: str
    source_px: Points  # of the homography, see FourPointWarp
    destination_px: Points
    thresholds: Thresholds  # of stills
    video_thresholds: Thresholds
    margin_px: float  # half width of the windows, and of the band around the line of the previous frames (video)
    still_band_px: float  # half width of the band around the line of the windows (stills)
    memories: tuple[Line, ...]  # empty ones of the left and the right line
    size: tuple[int, int] = (1280, 720)  # (width, height)
    warp_first: bool = False  # warp the colour image and then threshold it, or warp the binaries
    histogram_rows_px: tuple[int, int] = (360, 720)
    recentre_pixels: int = 50
    flood_pixels: int | None = None
    ransac_px: float | None = None  # inlier threshold; None fits by least squares
    ransac_samples: int = 150
    # Smallest share of the pixels in the search band that must be inliers. A noisy channel fills the band evenly and
    # would otherwise confirm the previous line forever. On motorway stills paint has 0.5 to 1, noise 0.2 to 0.38.
    min_inlier_ratio: float = 0.4
    min_span_px: float = 160  # two windows: a shorter line does not determine a curvature

    def four_point_warp(self) -> FourPointWarp:
        """The homography from the undistorted image to the bird's-eye view."""
        return FourPointWarp(np.array(self.source_px), np.array(self.destination_px), self.size)

    def require_size(self, camera: Camera) -> None:
        """Raise CameraError unless the recipe is for images of the camera's size."""
        if self.size != camera.size:
            raise CameraError(
                f"recipe {self.name} is for {self.size[0]}x{self.size[1]} pictures, but the camera was "
                f"calibrated for {camera.width}x{camera.height}; use get_recipe(name, camera.size)."
            )

    def scaled(self, size: tuple[int, int]) -> Recipe:
        """The same recipe for images resized to `size` (width, height).

        Lengths, pixel counts and kernels are scaled. Gradients are not, because a smaller image has sharper edges.
        Raises ValueError if the size is not positive.
        """
        width, height = size
        if width < 1 or height < 1:
            raise ValueError(
                f"a picture size of {width}x{height} pixels is not valid; give the width and height of the pictures."
            )
        sx, sy = width / self.size[0], height / self.size[1]
        area = sx * sy
        first_row, end_row = self.histogram_rows_px
        columns = {name: getattr(self, name) for name in ("margin_px", "still_band_px", "ransac_px")}
        return replace(
            self,
            **{name: value and value * sx for name, value in columns.items()},
            size=(width, height),
            source_px=resize_points(np.array(self.source_px), (sx, sy)).tolist(),
            destination_px=resize_points(np.array(self.destination_px), (sx, sy)).tolist(),
            thresholds=self.thresholds.scaled(area**0.5),
            video_thresholds=self.video_thresholds.scaled(area**0.5),
            histogram_rows_px=(round(first_row * sy), round(end_row * sy)),
            recentre_pixels=max(round(self.recentre_pixels * area), 1),
            flood_pixels=self.flood_pixels and max(round(self.flood_pixels * area), 1),
            min_span_px=self.min_span_px * sy,
            memories=tuple(m.scaled(sx, sy) for m in self.memories),
        )


def _hls_sobel(gradient: float) -> Thresholds:
    """Recipe A, on the warped colour image, with the lowest `gradient` of stills or of video.

    The published range of gradient directions is left out, because 0 to pi/2 includes all directions. Saturation
    changes by nearly its full range next to white pixels, so the scale of its gradient is the full range.
    """
    rules = {
        "saturation": ((Levels("HLS S", 120, 255), Levels("HLS L", 30, 255)),),
        "gradient x": ((Levels("HLS L", gradient, 255, "gradient x", full_step=75),),),
        "magnitude": ((Levels("HLS S", gradient, 255, "magnitude", full_step=255),),),
    }
    return Thresholds(rules, combined=tuple(rules))


_EQUALIZED_HSV = Thresholds(
    rules={
        "white": ((Levels("equalized", 251, 255),),),
        "yellow": ((Levels("HSV H", 0, 50), Levels("HSV S", 70, 255), Levels("HSV V", 70, 255)),),
        "magnitude": ((Levels("gray", 51, 255, "magnitude", full_step=195, kernel=9),),),
    },
    combined=("white", "yellow", "magnitude"),
    close_px=5,
)
_SLANTED = Levels("gray", 0.7, 1.2, "direction")
_BEST_CHANNEL = Thresholds(
    rules={
        "red": ((Levels("RGB R", 210, 255),),),
        "gradients": (
            (Levels("gray", 100, 200, "gradient x", 180), Levels("gray", 100, 200, "gradient y", 180)),
            (Levels("gray", 10, 225, "magnitude", 180), _SLANTED),
        ),
        "hue": ((Levels("HLS H", 20, 80), _SLANTED),),
        "saturation": ((Levels("HLS S", 85, 255),),),
        "luv lightness": ((Levels("Luv L", 225, 255),),),
        "lab b": ((Levels("Lab b", 155, 200), _SLANTED),),
    },
    combined=("saturation", "red", "lab b"),
    candidates=("red", "gradients", "hue", "saturation", "luv lightness", "lab b"),
    # It excludes the sky and the adjacent lanes.
    region=((0, 1), (0.45, 1 / 1.8), (0.55, 1 / 1.8), (0.99, 1)),
)
# The left line of recipe C is damped more than the right one, and starts again sooner.
_BEST_CHANNEL_MEMORIES = tuple(
    Line(30, None, accept_limits=(7e-5, inf, 50), damp_limits=(damp_a, inf, 150), damped_weight=w, max_missed=missed)
    for damp_a, w, missed in ((12e-5, 0.05, 8), (15e-5, 0.15, 10))
)
RECIPES = {
    "hls_sobel": Recipe(
        name="hls_sobel",
        source_px=((580, 460), (740, 460), (1100, 670), (270, 670)),
        destination_px=((200, 0), (1080, 0), (1080, 720), (200, 720)),
        warp_first=True,
        thresholds=_hls_sobel(gradient=20),
        video_thresholds=_hls_sobel(gradient=15),
        margin_px=80,
        still_band_px=80,
        memories=(Line(length=5, accept_limits=(0.001, 1.0, 100)),) * 2,
    ),
    "equalized_hsv": Recipe(
        name="equalized_hsv",
        source_px=((1280, 710), (0, 710), (546, 460), (732, 460)),
        destination_px=((1280, 720), (0, 720), (0, 0), (1280, 0)),
        thresholds=_EQUALIZED_HSV,
        video_thresholds=_EQUALIZED_HSV,
        histogram_rows_px=(360, 690),
        margin_px=100,
        still_band_px=100,
        memories=(Line(length=10, measured_length=20, search_again=False),) * 2,
    ),
    "best_channel": Recipe(
        name="best_channel",
        source_px=((249, 690), (579, 460), (704, 460), (1058, 690)),
        destination_px=((249, 720), (249, 0), (1058, 0), (1058, 720)),
        thresholds=_BEST_CHANNEL,
        video_thresholds=_BEST_CHANNEL,
        margin_px=75,
        still_band_px=100,
        flood_pixels=9500,
        ransac_px=15,
        memories=_BEST_CHANNEL_MEMORIES,
    ),
}


def get_recipe(name: str, size: tuple[int, int] = (1280, 720)) -> Recipe:
    """A recipe by name, for images of `size` (width, height). Raises ValueError if there is none, or no such size."""
    if name not in RECIPES:
        raise ValueError(f"there is no recipe {name!r}; the recipes are {', '.join(RECIPES)}.")
    return RECIPES[name].scaled(size)


def recipe_from_pose(recipe: Recipe, camera: Camera) -> Recipe:
    """The recipe, named "..._pose", with the source points of a true rectangle on the road.

    The published points were chosen for another camera pose. With these points the view is a map of the road with two
    constant scales. The edges of the rectangle are parallel to the car's axis and equally far to the left and right of
    the camera. Its near and far edge are where the centre column of the image crosses the published bottom and top row,
    the far edge at most 60 m ahead. Its width is the published one at the near edge. Points may lie outside the image.
    Raises CameraError if the camera has no pose or another size, or the near edge is not on the road.
    """
    pose = camera.require_pose()
    recipe.require_size(camera)
    pinhole = replace(camera, distortion=np.zeros(5))  # the points are those of the undistorted image
    source = np.array(recipe.source_px)
    u, v = source.T
    left, near = u < u.mean(), v > v.mean()
    centre = (camera.width - 1) / 2
    near_m, far_m = pinhole.pixels_to_road(np.array([(centre, v[near].mean()), (centre, v[~near].mean())]))[:, 0]
    half_width_m = np.ptp(pinhole.pixels_to_road(source[near])[:, 1]) / 2
    x = np.where(near, near_m, np.fmin(far_m, _MAX_FAR_EDGE_M))
    points = pinhole.road_to_pixels(np.column_stack([x, np.where(left, half_width_m, -half_width_m)]))
    if not (np.isfinite(points).all() and near_m < _MAX_FAR_EDGE_M):
        raise CameraError(
            f"the bottom row of recipe {recipe.name}'s points is not on the road ahead ({pose.describe()}); "
            "correct the camera pose."
        )
    return replace(recipe, name=recipe.name + POSE_SUFFIX, source_px=points.tolist())


# The finder: one image, or the frames of a video


@dataclass(frozen=True, eq=False)
class FoundLine:
    """One line of one frame, before the memory: fit, pixels (N, 2), name of the channel, search windows (M, 4)."""

    fit: LineFit | None
    pixels: np.ndarray
    channel: str
    windows: np.ndarray = field(default_factory=lambda: np.empty((0, 4)))


@dataclass(frozen=True, eq=False)
class LaneResult:
    """The lane in one frame with its intermediate results; a measurement is None if the lines it needs are missing.

    Curvature > 0: the road bends left; offset > 0: the car is left of the lane centre. "found": both lines are measured
    in this frame; "kept": at least one is from memory; "lost": a line is missing.
    """

    left: LineFit | None  # in the bird's-eye view, smoothed by the memory if there is one
    right: LineFit | None
    left_road: RoadLine | None
    right_road: RoadLine | None
    state: str  # "found", "kept" or "lost"
    undistorted: np.ndarray  # (height, width, 3)
    masks: dict[str, np.ndarray]  # all binaries, of the view if the recipe warps first, else of the undistorted image
    warped_binary: np.ndarray  # binary with the pixels of both lines, in the bird's-eye view
    left_found: FoundLine  # of this frame without the memory
    right_found: FoundLine
    warp: FourPointWarp

    @property
    def lines_px(self) -> list[np.ndarray | None]:
        """Points (N, 2) of both lines in the undistorted image, from far to near; None for a line that is missing."""
        lines = (None if line is None else line.points(self.warp.size[1]) for line in (self.left, self.right))
        return [None if points is None else self.warp.points_to_image(points) for points in lines]

    @property
    def curvature_per_m(self) -> float | None:
        """Mean curvature of the available lines in 1/m, > 0 bends left."""
        lines = [line.curvature_per_m() for line in (self.left_road, self.right_road) if line]
        return sum(lines) / len(lines) if lines else None

    @property
    def offset_m(self) -> float | None:
        """Offset from the lane centre in metres, > 0: car left of the lane centre."""
        sides_m = self.lateral_m(np.zeros(1))
        return None if sides_m is None else -float(sides_m.mean())

    @property
    def lane_width_m(self) -> float | None:
        """Distance between the lines at the car in metres, perpendicular to the lane."""
        if self.left_road is None or self.right_road is None:
            return None
        left, right = self.left_road, self.right_road
        return (left.c0_m - right.c0_m) / float(np.hypot(1, (left.c1 + right.c1) / 2))

    def lateral_m(self, x_m: np.ndarray) -> np.ndarray | None:
        """Lateral positions (2, N) of the left and right line at distances (N,), metres; None if a line is missing."""
        if self.left_road is None or self.right_road is None:
            return None
        return np.array([self.left_road.lateral_m(x_m), self.right_road.lateral_m(x_m)])

    def as_row(self) -> dict[str, str | float | None]:
        """Measurements by the column names of the telemetry."""
        row = {name: getattr(self, name) for name in ("state", "offset_m", "curvature_per_m", "lane_width_m")}
        lines, names = {"left": self.left_road, "right": self.right_road}, ("c0_m", "c1", "c2_per_m")
        return row | {f"{side}_{name}": line and getattr(line, name) for side, line in lines.items() for name in names}


@dataclass(frozen=True, eq=False)
class Channel:
    """One binary of a frame with the line search of a recipe; warping and window search run at most once."""

    name: str
    mask: np.ndarray  # of the view if the recipe warps first, else of the undistorted image
    recipe: Recipe
    warp: FourPointWarp

    @cached_property
    def binary(self) -> np.ndarray:
        """The binary in the bird's-eye view."""
        return self.mask if self.recipe.warp_first else self.warp.image_to_birdseye(self.mask)

    @cached_property
    def pixels(self) -> np.ndarray:
        """Set pixels (N, 2) of the bird's-eye view."""
        return binary_pixels(self.binary)

    @cached_property
    def search(self) -> WindowSearch:
        """Sliding-window search of both lines."""
        names = "margin_px", "recentre_pixels", "flood_pixels", "histogram_rows_px"
        return sliding_windows(self.binary, **{name: getattr(self.recipe, name) for name in names})

    def line_from_windows(self, side: int) -> FoundLine:
        """Left (0) or right (1) line: fit the pixels in the windows, then those in a band around that fit."""
        pixels, windows = self.search.pixels[side], self.search.windows[side]
        first = self._fit(pixels)
        if first is None:
            return FoundLine(None, pixels, self.name, windows)
        return replace(self.line_near(first, self.recipe.still_band_px), windows=windows)

    def line_near(self, known: LineFit, margin_px: float) -> FoundLine:
        """Fit the pixels within `margin_px` of a known line, along the row."""
        pixels = band_pixels(self.pixels, known, margin_px)
        return FoundLine(self._fit(pixels), pixels, self.name)

    def _fit(self, pixels: np.ndarray) -> LineFit | None:
        r = self.recipe
        if r.ransac_px is None:
            return fit_line(pixels, min_span_px=r.min_span_px)
        fit = ransac_line(pixels, samples=r.ransac_samples, residual_px=r.ransac_px, min_span_px=r.min_span_px)
        return fit if fit and fit.pixels >= r.min_inlier_ratio * len(pixels) else None


def nearest_line(channels: Sequence[Channel], memory: Line, side: int) -> FoundLine:
    """The line of the channel whose fit is closest to the average in `memory`."""
    prior, average = memory.search_prior, memory.average
    lines = [c.line_near(prior, c.recipe.margin_px) if prior else c.line_from_windows(side) for c in channels]
    height = channels[0].recipe.size[1]
    return min(lines, key=lambda line: mean_distance_px(line.fit, average, height) if line.fit and average else inf)


class LaneFinder:
    """Lane detection with a recipe: `find` for a still, `follow` for the consecutive frames of one drive.

    The intrinsics of `camera` undistort the images; its pose projects pixels to the road, unless `metres_per_px` is
    given, (metres per column, metres per row) of the view, for example (3.7 / 700, 30 / 720) in the originals. Raises
    CameraError if the recipe is for another size than the camera, or neither a pose nor scales are given.
    """

    def __init__(self, recipe: Recipe, camera: Camera, *, metres_per_px: tuple[float, float] | None = None) -> None:
        recipe.require_size(camera)
        if camera.pose is None and metres_per_px is None:
            raise CameraError(
                "this camera has no pose (height and angles), so nothing can be measured on the road; "
                "give it one, or give metres_per_px."
            )
        self.recipe, self.camera, self.warp = recipe, camera, recipe.four_point_warp()
        self._to_road = partial(birdseye_to_road, warp=self.warp, camera=camera)
        if metres_per_px is not None:
            self._to_road = partial(scale_to_road, metres_per_px=metres_per_px, birdseye_size=recipe.size)
        self._memories = recipe.memories

    def find(self, image: np.ndarray) -> LaneResult:
        """The lane in one raw RGB image, without memory; raises PictureError if it is not of the camera's size."""
        undistorted, channels = self._threshold(image, self.recipe.thresholds)
        lines = [channels["combined"].line_from_windows(side) for side in (0, 1)]
        fits = [line.fit for line in lines]
        state = "found" if all(fits) else "lost"
        return self._result(undistorted, channels, lines, (fits, fits), state)

    def follow(self, image: np.ndarray) -> LaneResult:
        """The lane in the next frame of a drive, with the memory of the previous frames; see `find`."""
        undistorted, channels = self._threshold(image, self.recipe.video_thresholds)
        candidates = [channels[name] for name in self.recipe.video_thresholds.candidates]
        lines = [
            nearest_line(candidates, memory, side) if memory.average else channels["combined"].line_from_windows(side)
            for side, memory in enumerate(self._memories)
        ]
        self._memories = tuple(m.update(line.fit) for m, line in zip(self._memories, lines, strict=True))
        state = min((memory.state for memory in self._memories), key=["lost", "kept", "found"].index)
        fits = [m.average for m in self._memories], [m.measured_average for m in self._memories]
        return self._result(undistorted, channels, lines, fits, state)

    def _threshold(self, image: np.ndarray, thresholds: Thresholds) -> tuple[np.ndarray, dict[str, Channel]]:
        undistorted = undistort(image, self.camera)
        masks = thresholds.masks(self.warp.image_to_birdseye(undistorted) if self.recipe.warp_first else undistorted)
        return undistorted, {name: Channel(name, mask, self.recipe, self.warp) for name, mask in masks.items()}

    def _result(
        self, undistorted: np.ndarray, channels: dict[str, Channel], lines: Sequence[FoundLine], fits: Fits, state: str
    ) -> LaneResult:
        (left, right), (shown, measured) = lines, fits
        roads = [None if fit is None else road_line(fit, self._to_road, self.recipe.size[1]) for fit in measured]
        masks = {name: channel.mask for name, channel in channels.items()}
        binary = channels[left.channel].binary | channels[right.channel].binary
        found = (shown[0], shown[1], roads[0], roads[1])
        return LaneResult(*found, state, undistorted, masks, binary, left, right, self.warp)


# Draw


def draw_windows(view: np.ndarray, windows_px: np.ndarray) -> np.ndarray:
    """Draw search windows (N, 4) (left, top, right, bottom edge, pixels) on an image or mask. Returns RGB."""
    drawn = to_rgb(view)
    for left, top, right, bottom in np.asarray(windows_px, float).reshape(-1, 4):
        outline = np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
        canvas.draw_polyline(drawn, outline, canvas.WINDOW_COLOUR, drawn.shape[1] / 320, closed=True)
    return drawn


def draw_pixels(view: np.ndarray, pixels_px: np.ndarray, *, colour: canvas.Colour) -> np.ndarray:
    """Colour the pixels (N, 2) (column, row) of an image or mask; pixels outside are ignored. Returns RGB."""
    drawn = to_rgb(view)
    columns, rows = np.asarray(pixels_px).reshape(-1, 2).astype(int).T
    inside = (columns >= 0) & (columns < drawn.shape[1]) & (rows >= 0) & (rows < drawn.shape[0])
    drawn[rows[inside], columns[inside]] = colour
    return drawn


def draw_lane_between(
    image: np.ndarray,
    left_px: np.ndarray | None,
    right_px: np.ndarray | None,
    camera: Camera | None = None,
    *,
    line_width_px: float | None = None,
) -> np.ndarray:
    """Draw a lane on a raw or undistorted image.

    The points (N, 2) are from far to near, or both from near to far. With a `camera`, `image` is the raw one and the
    points are those of the undistorted one. If a line is None, the other one is drawn and the area is not filled.
    `line_width_px` is that of the lines, red left and blue right; 0 draws none. Raises PictureError if the image is not
    RGB or not of the camera's size.
    """
    drawn = (require_rgb(image) if camera is None else camera.require_size(image)).copy()
    left, right = (np.empty((0, 2)) if line is None else canvas.finite_points(line) for line in (left_px, right_px))
    if camera is not None:
        left, right = camera.distort_line(left), camera.distort_line(right)
    if len(left) >= 2 and len(right) >= 2:
        canvas.blend_polygon(drawn, np.vstack([left, right[::-1]]), canvas.LANE_COLOUR, 0.3)
    width_px = image.shape[1] / 160 if line_width_px is None else line_width_px
    if width_px > 0:
        canvas.draw_polyline(drawn, left, canvas.LEFT_COLOUR, width_px)
        canvas.draw_polyline(drawn, right, canvas.RIGHT_COLOUR, width_px)
    return drawn


def describe_result(result: LaneResult) -> list[str]:
    """Text lines with bend and offset, or "lane lost"."""
    if result.state == "lost":
        return ["lane lost"]
    memory = ["(from memory)"] if result.state == "kept" else []
    return [describe_bend(result.curvature_per_m), describe_offset(result.offset_m), *memory]


def annotate_image(image: np.ndarray, result: LaneResult, camera: Camera) -> np.ndarray:
    """A copy of the raw RGB image with the lane and its numbers, drawn through the lens; the pose is not used."""
    left_px, right_px = (None, None) if result.state == "lost" else result.lines_px
    drawn = draw_lane_between(image, left_px, right_px, camera)
    canvas.put_text(drawn, describe_result(result))
    return drawn


def follow_lane(
    finder: LaneFinder, camera: Camera
) -> Callable[[np.ndarray], tuple[np.ndarray, dict[str, str | float | None]]]:
    """A function for `process_video` that returns the annotated frame and its telemetry; frames must be in order."""

    def process(frame: np.ndarray) -> tuple[np.ndarray, dict[str, str | float | None]]:
        result = finder.follow(frame)
        return annotate_image(frame, result, camera), result.as_row()

    return process
