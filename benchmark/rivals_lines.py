"""Two simple lane finders that need no camera: Hough lines, and the lines of a mask.

Both return the columns (2, R) of the left and the right line at rows (R,) of the image,
`NO_POINT` where a line has none.
"""

from __future__ import annotations

import cv2
import numpy as np

from lanes.labels import NO_POINT

# Width of the images of Udacity's first project, whose usual numbers are these. Shares
# are of the height: where the horizon is in them, and where the lines end below it.
PROJECT_WIDTH_PX = 960
PROJECT_HORIZON = 0.55
LINES_END_BELOW = 0.05
# Lines with more columns a row are no lane lines.
MAX_LEAN = 2.0

# A line of a mask has its points within this share of the width.
NEAR_LINE = 0.03
# Fewer points are no line.
MIN_POINTS = 5
# Of two segments of a mask, the one that is nearer to the centre by this share of the
# width counts e times as much.
NEARER = 0.15


def hough_columns(
    image: np.ndarray, rows: np.ndarray, horizon: float = PROJECT_HORIZON
) -> np.ndarray:
    """The lines of Udacity's first project, as most of its students find them.

    Canny edges in a trapezoid, segments of the probabilistic Hough transform, and their
    mean on each side, weighted with the lengths. `horizon` is the row of the horizon in
    the image (height, width, 3), uint8, as a share of its height.
    """
    scale = image.shape[1] / PROJECT_WIDTH_PX
    height = round(image.shape[0] / scale)
    reduced = cv2.resize(image, (PROJECT_WIDTH_PX, height))
    top = round((horizon + LINES_END_BELOW) * height)
    segments = find_segments(
        _road_edges(reduced, top), threshold=15, min_length=40, max_gap=20
    )
    x, y, lean, length = segments

    columns = np.full((2, len(rows)), float(NO_POINT))
    for side, leans_inwards in enumerate((lean < 0, lean > 0)):
        chosen = leans_inwards & (np.abs(lean) < MAX_LEAN)
        if chosen.any():
            weights = length[chosen]
            mean_lean = np.average(lean[chosen], weights=weights)
            at_row_0 = (x - lean * y)[chosen]
            mean_at_row_0 = np.average(at_row_0, weights=weights)
            found = scale * mean_at_row_0 + mean_lean * rows
            columns[side] = np.where(rows >= scale * top, found, NO_POINT)
    return _inside(columns, image.shape[1])


def _road_edges(image: np.ndarray, top: int) -> np.ndarray:
    """Canny edges in a trapezoid from the lower corners to a row `top`."""
    gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    edges = cv2.Canny(cv2.GaussianBlur(gray, (5, 5), 0), 50, 150)
    height, width = gray.shape
    left_top = (0.47 * width, top)
    right_top = (0.53 * width, top)
    corners = np.array([(0, height), left_top, right_top, (width, height)])
    road = np.zeros_like(edges)
    cv2.fillPoly(road, [corners.astype(np.int32)], 255)
    return cv2.bitwise_and(edges, road)


def find_segments(
    binary: np.ndarray, *, threshold: int, min_length: float, max_gap: float
) -> np.ndarray:
    """Segments of a binary image: (4, N) column and row of an end, columns a row, and
    length. Level ones are left out.
    """
    found = cv2.HoughLinesP(
        binary,
        rho=2,
        theta=np.radians(1),
        threshold=threshold,
        minLineLength=min_length,
        maxLineGap=max_gap,
    )
    if found is None:
        return np.empty((4, 0))
    x, y, other_x, other_y = found.reshape(-1, 4).T.astype(float)
    run = other_x - x
    rise = other_y - y
    with np.errstate(divide="ignore", invalid="ignore"):
        lean = run / rise
    return np.array([x, y, lean, np.hypot(run, rise)])[:, rise != 0]


def mask_columns(
    mask: np.ndarray,
    rows: np.ndarray,
    *,
    covers: tuple[int, int],
    size: tuple[int, int],
) -> np.ndarray:
    """The left and the right line of a mask (rows, columns) of probabilities.

    The centres of the mask's stripes in each row are points. On each side of the middle
    a long segment of them near the middle is a first line. A parabola is fitted to the
    points near it, three times. `covers` are the first row and the row below the last
    one that the mask has of the image of this `size`, (width, height); rows outside of
    the image are left out.
    """
    width, height = size
    top, bottom = covers
    mask_height, mask_width = mask.shape
    rows_per_row = mask_height / (bottom - top)
    mask_rows = (rows - top) * rows_per_row

    y, x = stripe_centres(mask > 0.5)
    in_image = (y >= -top * rows_per_row) & (y < (height - top) * rows_per_row)
    y = y[in_image]
    x = x[in_image]
    points = np.zeros(mask.shape, np.uint8)
    points[y, x.astype(int)] = 255
    segments = find_segments(points, threshold=10, min_length=20, max_gap=60)

    columns = np.full((2, len(rows)), float(NO_POINT))
    for side, sign in enumerate((-1, 1)):
        first = _first_line(segments, sign, mask.shape)
        if first is not None:
            line, end = _fit_parabola(first, x, y, NEAR_LINE * mask_width)
            found = np.polyval(line, mask_rows) * width / mask_width
            columns[side] = np.where(mask_rows >= end, found, NO_POINT)
    return _inside(columns, width)


def _fit_parabola(
    line: np.ndarray, x: np.ndarray, y: np.ndarray, near_px: float
) -> tuple[np.ndarray, float]:
    """Coefficients of a parabola x(y) through the points near a first line, and its
    upper end.

    The end is infinite if there are too few points.
    """
    end = np.inf
    for _ in range(3):
        near = np.abs(x - np.polyval(line, y)) < near_px
        if near.sum() < MIN_POINTS:
            break
        end = float(y[near].min())
        line = np.polyfit(y[near], x[near], 2)
    return line, end


def stripe_centres(binary: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns (N,) of the centres of the runs in each row of a bool array."""
    padded = np.pad(binary, ((0, 0), (1, 1))).astype(np.int8)
    steps = np.diff(padded, axis=1)
    row, first = np.nonzero(steps == 1)
    _, after = np.nonzero(steps == -1)
    return row, (first + after - 1) / 2


def _first_line(
    segments: np.ndarray, sign: int, shape: tuple[int, int]
) -> np.ndarray | None:
    """Coefficients (2,) of the longest segment that is near the middle, on its right
    (`sign` 1) or left (-1) at the lower border; None without one.
    """
    x, y, lean, length = segments
    height, width = shape
    at_border = x + lean * (height - y)
    from_middle = sign * (at_border - width / 2)
    value = length * np.exp(-from_middle / (NEARER * width))
    value[from_middle < 0] = 0
    if not value.any():
        return None
    best = value.argmax()
    return np.array([lean[best], x[best] - lean[best] * y[best]])


def _inside(columns: np.ndarray, width: int) -> np.ndarray:
    """The columns that lie in an image of this width."""
    inside = (columns >= 0) & (columns <= width - 1)
    return np.where(inside, columns, NO_POINT)
