"""Paint, not brightness: how much each cell of the road view looks like a painted stripe.

A stripe is brighter (or yellower) than the road on *both* its sides, and about 0.1 to 0.2 m wide, or 0.3 to 0.4 m when
two stripes run side by side. The signed band filter asks just that: centre minus the larger neighbour. An edge, be it a
shadow's, a kerb's or that of another asphalt, has one neighbour as bright as its bright side and scores nothing; a dark
tar seam scores less than nothing. What remains is measured in units of the local noise, so that neither exposure nor
shade needs a threshold of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import lcm

import cv2
import numpy as np

from lanes.tracking.birdseye import BirdsEyeView

# Painted widths, metres: one stripe (0.10-0.15 m in most of the world), and a double line taken as one. Then the width
# of the road strips that the stripe is compared with, on either side, and their distance from it, and the window along
# a row over which noise is averaged.
SIZES_M = (0.15, 0.35, 0.15, 0.05, 2.5)
# In a hairpin a double yellow line crosses the rows aslant, which makes it wider, and pictures are blurred there: so
# wide, and so far beside it the road. In yellowness only: strips of light are as wide, but nothing is as yellow.
ASLANT_M, ASLANT_GAP_M = 0.45, 0.15
NOISE_ROWS = 5
# Rounding to whole grey levels alone makes about this much noise; less is never assumed.
NOISE_FLOOR = 1.0
# Cells inside the picture have more than this share of their window inside, too.
LEAST_SEEN = 0.2
# A stripe's strength above which it is worth keeping: so many times the local noise.
LEAST_STRENGTH = 3.0
STRIPES_PER_ROW = 14
# A stripe's direction is measured with so many columns taken as one, so that one that runs across, and moves aside by
# many of them from row to row, is still within the window there.
COARSE_COLUMNS = 4

# Strength (times the noise) at which a stripe counts half, and difference in direction at which it counts a quarter.
HALF_STRENGTH = 6.0
ANGLE_STD_RAD = 0.1
# A stripe that moves aside by this many columns from row to row shows its direction only half as well, and one that
# moves twice as much hardly at all.
BLIND_COLUMNS = 8.0
# Standard deviation of a stripe's lateral place: worn paint near by, one pixel far away; and how far a road of changing
# curvature strays from the model at 40 m, growing with the cube of the distance.
PLACE_STD_M, PLACE_STD_PX = 0.04, 1.0


@dataclass(frozen=True, eq=False)
class MarkingResponse:
    """How much each cell of a view looks like a painted stripe.

    Attributes
    ----------
    strength : ndarray of shape (rows, columns), float32
        The best filter's response in units of the local noise; 0 where there is nothing.
    channels : ndarray of shape (2, rows, columns), int
        Lightness and yellowness of the view, in grey levels.
    narrow, wide : ndarray of shape (2, rows, columns), int
        Responses of the filters for one stripe and for two, to lightness and to yellowness. Their unit is a grey
        level over a whole number, so that they are exact.
    noise : ndarray of shape (2, rows, columns), float32
        Local noise of lightness and of yellowness, in the unit of the responses.
    """

    strength: np.ndarray
    channels: np.ndarray
    narrow: np.ndarray
    wide: np.ndarray
    noise: np.ndarray


@dataclass(frozen=True, eq=False)
class Stripes:
    """Stripe centres found row by row; all arrays have shape (stripes,).

    Attributes
    ----------
    row : int
        Row of the view.
    x_m, y_m : float
        Where on the road, metres ahead and to the left, between the columns.
    angle : float
        Which way the stripe runs, radians, positive to the left of straight ahead.
    step : float
        How many columns of the view its row is deep: by so many times the tangent of its direction a stripe moves
        aside from row to row.
    strength : float
        Band filter response over local noise.
    double : bool
        The wide filter answered better than the narrow one.
    yellow : bool
        Yellowness answered better than lightness.
    """

    row: np.ndarray
    x_m: np.ndarray
    y_m: np.ndarray
    angle: np.ndarray
    step: np.ndarray
    strength: np.ndarray
    double: np.ndarray
    yellow: np.ndarray

    def __len__(self) -> int:
        return len(self.row)

    def select(self, which: np.ndarray) -> Stripes:
        """The stripes that `which` (bool or index) picks."""
        return Stripes(*(getattr(self, f.name)[which] for f in fields(self)))


def lightness(view_image: np.ndarray) -> np.ndarray:
    """Luma of an RGB view, (rows, columns) uint8, weights of ITU-R BT.601."""
    return cv2.cvtColor(view_image, cv2.COLOR_RGB2GRAY)


def yellowness(view_image: np.ndarray) -> np.ndarray:
    """How much blue is missing: min(R, G) - B as (rows, columns) int16; yellow paint has it in sun and in shade."""
    red, green, blue = cv2.split(view_image)
    return cv2.subtract(cv2.min(red, green), blue, dtype=cv2.CV_16S)


def sums_around(cells: np.ndarray, count: int) -> np.ndarray:
    """Sums over `count` (odd) columns around each of the cells (..., columns); not meaningful at the first and last.

    Rows are laid end to end, because one long row is added faster than many short ones.
    """
    row, sums = cells.ravel(), np.zeros(cells.size, cells.dtype)
    sums[count // 2 : cells.size - count // 2] = _window_sums(row, count)
    return sums.reshape(cells.shape)


def _window_sums(row: np.ndarray, count: int) -> np.ndarray:
    """(N - count + 1,) sums over `count` neighbours of (N,); sums of half as many save most of the additions."""
    if count == 1:
        return row
    half, size = _window_sums(row, count // 2), len(row) - count + 1
    sums = half[:size] + half[count // 2 :][:size]
    return sums + row[count - 1 :] if count % 2 else sums


def filter_band(centre: np.ndarray, side: np.ndarray, reach: int) -> np.ndarray:
    """How much more `centre` (..., columns) is than the larger of `side` at `reach` columns to its left and right."""
    response, beside = centre.ravel(), side.ravel()
    response[reach:-reach] -= np.maximum(beside[: -2 * reach], beside[2 * reach :])
    return response.reshape(centre.shape)


def local_noise(steps: np.ndarray, window: int, view: BirdsEyeView) -> np.ndarray:
    """Means of steps from column to column around each cell and `NOISE_FLOOR`, (2, rows, columns) float32.

    `steps` are each cell's two, to its left and to its right, added: the mirrored picture has the mirrored noise.
    Beyond the picture there are none, so that the means are those of the cells inside.
    """
    noise = np.empty(steps.shape, np.float32)
    for channel, mean in zip(steps, noise, strict=True):
        cv2.boxFilter(channel, cv2.CV_32F, (window, NOISE_ROWS), dst=mean)
    noise /= 2 * np.maximum(view.seen_share(NOISE_ROWS, window), LEAST_SEEN)
    noise += NOISE_FLOOR
    return noise


def marking_response(view_image: np.ndarray, view: BirdsEyeView) -> MarkingResponse:
    """Look for stripes everywhere in a view.

    Parameters
    ----------
    view_image : ndarray of shape (rows, columns, 3), uint8
        What `view.warp` returned.
    view : BirdsEyeView

    Returns
    -------
    MarkingResponse
    """
    single, double, beside, gap, window = (round(length / view.cell_m) | 1 for length in SIZES_M)
    aslant, far = (round(length / view.cell_m) | 1 for length in (ASLANT_M, ASLANT_GAP_M))
    margin, unit = aslant // 2 + far + beside + 1, lcm(single, double, beside, aslant)
    wider = cv2.copyMakeBorder(view_image, 0, 0, margin, margin, cv2.BORDER_REPLICATE)
    # Sums instead of means, times what makes them comparable: whole numbers, exact, and of int16 twice as many fit into
    # a register as of float32. (Should the cells be so small that the sums do not fit, numpy's next larger type.)
    channels = np.empty((2, *wider.shape[:2]), np.min_scalar_type(-2 * 255 * unit))
    channels[0], channels[1] = lightness(wider), yellowness(wider)
    inside = (..., slice(margin, -margin))
    side = sums_around(channels, beside) * (unit // beside)
    side[..., :margin], side[..., -margin:] = side[..., margin, None], side[..., -margin - 1, None]
    narrow, wide, broad = (
        filter_band(sums_around(cells, n) * (unit // n), road, n // 2 + apart + beside // 2 + 1)[inside]
        for cells, road, n, apart in (
            (channels, side, single, gap),
            (channels, side, double, gap),
            (channels[1], side[1], aslant, far),
        )
    )
    np.maximum(wide[1], broad, out=wide[1])
    steps = np.abs(channels[..., margin : 1 - margin] - channels[..., margin - 1 : -margin])
    noise = local_noise(steps[..., :-1] + steps[..., 1:], window, view)
    noise *= unit
    strength = np.maximum(np.maximum(*np.maximum(narrow, wide) / noise), 0)
    # what is cut by the picture's edge may be of any width
    whole = view.seen_around(single // 2 + 1)
    return MarkingResponse(cv2.copyTo(strength, whole), channels[inside], narrow, wide, noise)


def find_stripes(response: MarkingResponse, view: BirdsEyeView) -> Stripes:
    """Peaks of the evidence along each row, placed between the columns.

    Returns
    -------
    Stripes
        At most `STRIPES_PER_ROW` a row, the strongest, each at least `LEAST_STRENGTH` times the noise.
    """
    best = response.strength
    peak = cv2.compare(best, cv2.dilate(best, np.ones((1, 5), np.uint8)), cv2.CMP_GE)
    # places in one long row: numpy finds them six times as fast as rows and columns
    row, column = np.divmod(np.flatnonzero(peak.view(bool) & (best > LEAST_STRENGTH)), best.shape[1])
    inside = (column > 0) & (column < best.shape[1] - 1)
    row, column = _strongest_of_each_row(row[inside], column[inside], best)
    left, middle, right = (best[row, column + k] for k in (-1, 0, 1))
    bend = left - 2 * middle + right
    shift = np.where(bend < 0, 0.5 * (left - right) / np.minimum(bend, -1e-9), 0.0)
    y = view.y_m[0] - (column + np.clip(shift, -0.5, 0.5)) * view.cell_m
    noise = response.noise[:, row, column]
    narrow, wide = (response[:, row, column] / noise for response in (response.narrow, response.wide))
    double = np.maximum(*wide) > np.maximum(*narrow)
    yellow = np.greater(*np.maximum(narrow, wide)[::-1])
    step = view.x_m[row] * (view.growth / (1 + view.growth) / view.cell_m)
    return Stripes(row, view.x_m[row], y, _stripe_angle(best, row, column, step), step, middle, double, yellow)


def mean_around(values: np.ndarray, columns: int, rows: int) -> np.ndarray:
    """Mean over a window around each cell; for windows this small a separable filter is faster than cv2.blur."""
    across, along = (np.full(n, 1 / n, np.float32) for n in (columns, rows))
    return cv2.sepFilter2D(values, -1, across, along, borderType=cv2.BORDER_REPLICATE)


def _strongest_of_each_row(row: np.ndarray, column: np.ndarray, best: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    if np.bincount(row).max(initial=0) <= STRIPES_PER_ROW:
        return row, column
    order = np.lexsort((-best[row, column], row))
    row, column = row[order], column[order]
    keep = np.arange(len(row)) - np.searchsorted(row, row) < STRIPES_PER_ROW
    return row[keep], column[keep]


def _stripe_angle(response: np.ndarray, row: np.ndarray, column: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Direction of stripes on the road from the structure tensor of the evidence (Bigun and Granlund, 1987)."""
    rows, columns = response.shape
    # an odd number of cells, so that a mirrored picture has mirrored directions
    cells = columns // COARSE_COLUMNS | 1
    coarse = cv2.resize(response, (cells, rows), interpolation=cv2.INTER_AREA)
    across = cv2.Scharr(coarse, cv2.CV_32F, 1, 0)
    along = cv2.Scharr(coarse, cv2.CV_32F, 0, 1)
    cell = (2 * column + 1) * cells // (2 * columns)
    # only the tensor's off-diagonal and the difference of its diagonal are needed
    xy, difference = (
        mean_around(product, 3, 5)[row, cell] for product in (across * along, (across - along) * (across + along))
    )
    normal = 0.5 * np.arctan2(2 * xy, difference)
    # One row down the stripe moves this many cells to the right, while x falls by one row's depth.
    return np.arctan2(-np.tan(normal), step * cells / columns)


@dataclass(frozen=True, eq=False)
class FrameEvidence:
    """What one picture shows: its `BirdsEyeView.warp`, (rows, columns, 3) uint8, the evidence there and its stripes."""

    view_image: np.ndarray
    response: MarkingResponse
    stripes: Stripes


def extract_evidence(image: np.ndarray, view: BirdsEyeView) -> FrameEvidence:
    """Look at the road in a raw picture."""
    view_image = view.warp(image)
    response = marking_response(view_image, view)
    return FrameEvidence(view_image, response, find_stripes(response, view))


def marking_weight(stripes: Stripes) -> np.ndarray:
    """How likely a stripe is paint, from its strength: 0 to 1."""
    return stripes.strength**2 / (stripes.strength**2 + HALF_STRENGTH**2)


def position_std(stripes: Stripes, focal_px: float) -> np.ndarray:
    """Standard deviation of each stripe's lateral place on the road, metres."""
    return np.hypot(PLACE_STD_M, PLACE_STD_PX * stripes.x_m / focal_px)
