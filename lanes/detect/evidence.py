"""Evidence: what one image shows of lane markings in a bird's-eye view, from all sources combined.

Each source states for each cell how much it looks like paint: the band filter, our network and the mask of a foreign
network (`lanes.detect.markings`). Their strengths have one scale, the root of the odds of paint. Band filter and
network fail in different places; their combined strength has the mean of their log odds. A foreign mask takes their
place or joins them. The network also states where the road ends. The peaks of each row are the stripe candidates.

A stripe is brighter (or yellower) than the road on *both* its sides, and about 0.1 to 0.2 m wide, or 0.3 to 0.4 m
where two stripes run side by side. The band filter measures centre minus the larger neighbour. An edge (shadow, kerb,
joint of two asphalts) has one neighbour as bright as its bright side and scores zero; a dark tar seam scores below
zero. The response is divided by the local noise, so that one threshold serves all exposures, in sun and in shade.

The road next to a single stripe is the darker of two strips: one touches the stripe, the other lies a gap farther out.
Blur brightens the first, the second stripe of a double line the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache, reduce
from math import lcm

import cv2
import numpy as np

from lanes.detect.birdseye import BirdsEyeView, lightness, yellowness
from lanes.detect.markings import Markings, as_source, network_log_odds


@dataclass(frozen=True)
class PaintSettings:
    """Band filter, noise and stripe candidates; tuned on the labelled Udacity stills where no source is given."""

    # Painted widths of one stripe and of a double line taken as one; most countries paint 0.10 to 0.15 m. The strips of
    # road that a stripe is compared with are as wide as a single one.
    single_m: float = 0.15
    double_m: float = 0.35
    # Distance of these strips from the stripe. A single stripe is also compared with the strips that touch it.
    gap_m: float = 0.05
    # Window along a row (m), and rows, over which the noise is averaged.
    noise_window: tuple[float, int] = (2.5, 5)
    # Grey levels. Rounding to whole grey levels alone makes about this much noise; less is never assumed.
    noise_floor: float = 1.0
    # Smallest strength (times the local noise) of a stripe candidate, and the number of candidates kept in a row.
    min_strength: float = 3.0
    stripes_per_row: int = 14
    # Columns averaged into one before a direction is measured, so that the window holds a stripe that moves sideways
    # by many columns from row to row.
    coarse_columns: int = 4
    # Strength (times the local noise) at which a candidate has half the weight of a certain marking.
    half_weight_strength: float = 6.6
    # Standard deviation of a candidate's direction: at this difference it has a quarter of its weight.
    angle_std_rad: float = 0.1
    # Standard deviation of a candidate's lateral position: that of worn paint nearby; far away it is one pixel.
    position_std_m: float = 0.04
    # Weight of an edge of the road relative to paint of the same probability.
    edge_weight: float = 0.25


PAINT = PaintSettings()

# The centre of a mask's stripe is the centroid of the mask within this distance (m). It needs the first share of the
# largest probability there. If the mean exceeds the second share of it, the mask is an area and no line. The
# probability is limited, because larger values are not more certain.
MASK_REACH_M, _CENTRE_SHARE, _AREA_SHARE, _MAX_PROBABILITY = 0.75, 0.5, 0.9, 0.99


@dataclass(frozen=True, eq=False)
class MarkingResponse:
    """How much each cell of a view looks like a painted stripe."""

    # (rows, columns) float32, at least 0: the largest filter response in units of the local noise. `strength_weight`
    # is the probability of paint, so that the square is proportional to the odds.
    strength: np.ndarray
    # (2, rows, columns) int: lightness and yellowness of the view, in grey levels.
    channels: np.ndarray
    # The strength of the band filter, from which kinds of lines are measured: masks may join dashes.
    band_strength: np.ndarray


@dataclass(frozen=True, eq=False)
class Stripes:
    """Stripe candidates, found row by row; all arrays have shape (stripes,)."""

    # Row of the view.
    row: np.ndarray
    # Position on the flat road, metres ahead and to the left, with sub-column precision.
    x_m: np.ndarray
    y_m: np.ndarray
    # Direction of the stripe, radians, positive to the left of straight ahead.
    angle: np.ndarray
    # Depth of the row in columns of the view. From row to row a stripe moves sideways by `step` times the tangent of
    # its direction.
    step: np.ndarray
    # Weight 0 to 1 as a road marking, from the strength of the response.
    weight: np.ndarray
    # Standard deviations of lateral position, metres, and direction.
    std_m: np.ndarray
    angle_std_rad: np.ndarray
    # Whether it is an edge of the road (kerb, gravel, grass), not paint.
    edge: np.ndarray
    # Whether its profile and its gaps can be measured; not if only a mask shows it.
    measurable: np.ndarray

    def __len__(self) -> int:
        return len(self.row)

    def select(self, which: np.ndarray) -> Stripes:
        """The stripes that `which` (bool or index) picks."""
        return Stripes(*(getattr(self, f.name)[which] for f in fields(self)))

    def joined(self, other: Stripes) -> Stripes:
        """These stripes, then the others."""
        return Stripes(*(np.concatenate([getattr(self, f.name), getattr(other, f.name)]) for f in fields(self)))


def marking_response(view_image: np.ndarray, view: BirdsEyeView, settings: PaintSettings = PAINT) -> MarkingResponse:
    """Response of the band filters to an image (rows, columns, 3), uint8, of the view, from `view.warp`.

    Filters use sums instead of means, scaled to a common unit: the integers are exact, and int16 is twice as fast as
    float32. If the sums do not fit because the cells are small, numpy's next larger type is used.
    """
    lengths_m = settings.single_m, settings.double_m, settings.gap_m, settings.noise_window[0]
    single, double, gap, window = (round(length / view.cell_m) | 1 for length in lengths_m)
    pad, unit = double // 2 + gap + single + 1, lcm(single, double)
    padded = cv2.copyMakeBorder(view_image, 0, 0, pad, pad, cv2.BORDER_REPLICATE)
    channels = np.empty((2, *padded.shape[:2]), np.min_scalar_type(-2 * 255 * unit))
    channels[0], channels[1] = lightness(padded), yellowness(padded)
    inside = (..., slice(pad, -pad))
    singles = _sums_around(channels, single) * (unit // single)
    road = singles.copy()
    road[..., :pad], road[..., -pad:] = road[..., pad, None], road[..., -pad - 1, None]
    doubles = _sums_around(channels, double) * (unit // double)
    narrow = _filter_band(singles, road, [single, single + gap])[inside]
    wide = _filter_band(doubles, road, [double // 2 + gap + single // 2 + 1])[inside]
    steps = np.abs(channels[..., pad : 1 - pad] - channels[..., pad - 1 : -pad])
    noise = unit * _local_noise(steps[..., :-1] + steps[..., 1:], window, view, settings)
    # large sums are int32, whose quotients numpy makes float64
    strength = np.maximum(np.maximum(*np.maximum(narrow, wide) / noise), 0, dtype=np.float32)
    strength = cv2.copyTo(strength, view.seen.view(np.uint8))
    return MarkingResponse(strength, channels[inside], strength)


def _sums_around(cells: np.ndarray, count: int) -> np.ndarray:
    """Sums over `count` (odd) columns around each of the cells (..., columns); not meaningful at the first and last.

    Rows are laid end to end, because one long row is added faster than many short ones.
    """
    row, sums = cells.ravel(), np.zeros(cells.size, cells.dtype)
    sums[count // 2 : cells.size - count // 2] = _window_sums(row, count)
    return sums.reshape(cells.shape)


def _window_sums(row: np.ndarray, count: int) -> np.ndarray:
    """(N - count + 1,) sums over `count` neighbours of (N,), by doubling: about log2(count) additions per cell."""
    if count == 1:
        return row
    half, size = _window_sums(row, count // 2), len(row) - count + 1
    sums = half[:size] + half[count // 2 :][:size]
    return sums + row[count - 1 :] if count % 2 else sums


def _filter_band(centre: np.ndarray, side: np.ndarray, reaches: Sequence[int]) -> np.ndarray:
    """`centre` (..., columns) minus the larger of its two sides; in place.

    A side is the smallest of `side` (..., columns) at `reaches` columns to the left or right.
    """
    response, beside, margin = centre.ravel(), side.ravel(), max(reaches)
    size = response.size - 2 * margin
    left, right = (reduce(np.minimum, (beside[margin + k * r :][:size] for r in reaches)) for k in (-1, 1))
    response[margin:-margin] -= np.maximum(left, right)
    return response.reshape(centre.shape)


def _local_noise(steps: np.ndarray, window: int, view: BirdsEyeView, settings: PaintSettings) -> np.ndarray:
    """Mean step from column to column around each cell plus the noise floor, (2, rows, columns) float32.

    `steps` holds the sum of each cell's two steps, to the left and to the right, so that the mirrored image has the
    mirrored noise. Steps outside the image are 0 and are left out of the mean.
    """
    rows = settings.noise_window[1]
    noise = np.array([cv2.boxFilter(channel, cv2.CV_32F, (window, rows)) for channel in steps])
    # cells inside the image have a larger share than 0.2
    noise /= 2 * np.maximum(_seen_share(view, (window, rows)), 0.2)
    noise += settings.noise_floor
    return noise


@lru_cache(maxsize=8)
def _seen_share(view: BirdsEyeView, window: tuple[int, int]) -> np.ndarray:
    """(rows, columns) float32: share of a `window` (columns, rows) around each cell that lies inside the image."""
    return cv2.blur(view.seen.astype(np.float32), window)


def find_stripes(response: MarkingResponse, view: BirdsEyeView, settings: PaintSettings = PAINT) -> Stripes:
    """Peaks of the marking response along each row, with sub-column precision.

    They are the strongest `settings.stripes_per_row` of a row, and stronger than `settings.min_strength`.
    """
    strength = response.strength
    row, column = _peaks(strength, settings)
    y_m = view.y_m[0] - peak_position(strength, row, column) * view.cell_m
    x_m, step = view.x_m[row], view.row_columns[row]
    angle = _stripe_angle(strength, row, column, step, settings.coarse_columns)
    weight = strength_weight(strength[row, column], settings)
    std_m = np.hypot(settings.position_std_m, x_m / view.focal_px)
    angle_std_rad, edge = np.full(len(row), settings.angle_std_rad), np.zeros(len(row), bool)
    return Stripes(row, x_m, y_m, angle, step, weight, std_m, angle_std_rad, edge, ~edge)


def peak_position(strength: np.ndarray, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Column with its fraction, (N,), of the vertex of the parabola through each peak and its two neighbours."""
    left, middle, right = (strength[row, column + k] for k in (-1, 0, 1))
    bend = left - 2 * middle + right
    shift = np.where(bend < 0, 0.5 * (left - right) / np.minimum(bend, -1e-9), 0.0)
    return column + np.clip(shift, -0.5, 0.5)


def _peaks(strength: np.ndarray, settings: PaintSettings) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the largest cells within two columns that are strong enough, in order of the rows."""
    peak = cv2.compare(strength, cv2.dilate(strength, np.ones((1, 5), np.uint8)), cv2.CMP_GE).view(bool)
    # positions in one long row: numpy finds them six times as fast as rows and columns
    found = np.flatnonzero(peak & (strength > settings.min_strength))
    row, column = np.divmod(found, strength.shape[1])
    inside = (column > 0) & (column < strength.shape[1] - 1)
    row, column = row[inside], column[inside]
    if np.bincount(row).max(initial=0) > settings.stripes_per_row:
        order = np.lexsort((-strength[row, column], row))
        row, column = row[order], column[order]
        keep = np.arange(len(row)) - np.searchsorted(row, row) < settings.stripes_per_row
        row, column = row[keep], column[keep]
    return row, column


def _stripe_angle(
    strength: np.ndarray, row: np.ndarray, column: np.ndarray, step: np.ndarray, coarse_columns: int
) -> np.ndarray:
    """Direction of stripes on the road from the structure tensor of the response (Bigun and Granlund, 1987)."""
    rows, columns = strength.shape
    # an odd number of cells, so that a mirrored image has mirrored directions
    cells = columns // coarse_columns | 1
    coarse = cv2.resize(strength, (cells, rows), interpolation=cv2.INTER_AREA)
    across, along = cv2.Scharr(coarse, cv2.CV_32F, 1, 0), cv2.Scharr(coarse, cv2.CV_32F, 0, 1)
    cell = (2 * column + 1) * cells // (2 * columns)
    # only the tensor's off-diagonal element and the difference of its diagonal are needed
    products = across * along, (across - along) * (across + along)
    # for windows this small a separable filter is faster than cv2.blur
    window = np.full(3, 1 / 3, np.float32), np.full(5, 1 / 5, np.float32)
    means = (cv2.sepFilter2D(product, -1, *window, borderType=cv2.BORDER_REPLICATE) for product in products)
    xy, difference = (mean[row, cell] for mean in means)
    normal = 0.5 * np.arctan2(2 * xy, difference)
    # from one row to the next nearer one the stripe moves this many cells to the right, and x falls by the row's depth
    return np.arctan2(-np.tan(normal), step * cells / columns)


def strength_weight(strength: np.ndarray, settings: PaintSettings = PAINT) -> np.ndarray:
    """Weights 0 to 1 as a road marking of cells or candidates of these strengths."""
    return strength**2 / (strength**2 + settings.half_weight_strength**2)


@dataclass(frozen=True, eq=False)
class Evidence:
    """What one image shows in a view; `view_image` (rows, columns, 3), uint8, is its bird's-eye view.

    `response` is the combined one, `sources` are the names of its parts.
    """

    view: BirdsEyeView
    view_image: np.ndarray
    response: MarkingResponse
    stripes: Stripes
    sources: tuple[str, ...]
    confidence_shift: float

    def at_height(self, height_m: float) -> Evidence:
        """The same evidence for another height of the camera, to which all distances on the road are proportional."""
        factor, stripes = height_m / self.view.height_m, self.stripes
        scaled = {name: factor * getattr(stripes, name) for name in ("x_m", "y_m", "std_m")}
        return replace(self, view=self.view.at_height(height_m), stripes=replace(stripes, **scaled))


def find_evidence(
    image: np.ndarray,
    view: BirdsEyeView,
    settings: PaintSettings = PAINT,
    *,
    markings: Markings | None = None,
    quick: bool = False,
) -> Evidence:
    """The evidence in a raw RGB image.

    Parameters
    ----------
    image : ndarray of shape (height, width, 3), uint8
    view : BirdsEyeView
    settings : PaintSettings
    markings : callable, optional, as for `lanes.find_lane`
        Its mask takes the place of the other sources, or joins them, as a `MarkingSource` says.
    quick : bool
        Leave our network out: it takes sixty times as long as the band filter.
    """
    view_image = view.warp(image)
    band = marking_response(view_image, view, settings)
    strength, sources, edges = band.strength, ["band filter"], None
    source = None if markings is None else as_source(markings)
    own = source is None or source.with_own
    if own and not quick:
        # the weight of a cell (`strength_weight`) is the probability that the network states
        log_odds = network_log_odds(image, view)
        paint, edges = settings.half_weight_strength * np.exp(log_odds / 2) * view.seen
        # the mean of the log odds; a response below one and a half times the noise says nothing against paint
        strength = np.sqrt(np.maximum(strength, np.float32(1.5) * view.seen) * paint)
        sources.append("network")
    if source is not None:
        mask = source.find_mask(image)
        of_mask = _mask_strength(mask, view, settings)
        strength, sources = (np.maximum(strength, of_mask), [*sources, "mask"]) if own else (of_mask, ["mask"])
    response = replace(band, strength=strength)
    stripes = find_stripes(response, view, settings)
    if strength is not band.strength:
        stripes, band_strength = place(stripes, band.strength, view, settings)
        if source is not None:
            # a stripe of a mask alone is as exact as its pixels, and has no profile
            cell_px = 1 if own else max(view.camera.width / mask.shape[1], 1)
            std_m = np.where(band_strength > settings.half_weight_strength, 1, cell_px) * stripes.std_m
            stripes = replace(stripes, std_m=std_m, measurable=band_strength > settings.min_strength)
    if edges is not None:
        stripes = stripes.joined(_edge_stripes(replace(band, strength=edges), view, settings))
    shift = 0.0 if source is None else source.confidence_shift
    return Evidence(view, view_image, response, stripes, tuple(sources), shift)


def _mask_strength(probability: np.ndarray, view: BirdsEyeView, settings: PaintSettings) -> np.ndarray:
    """Strengths (rows, columns) float32 of the lines of a mask in a view.

    A mask is wider than paint: it is thinned to parabolas, three columns wide, at the centres of its stripes.
    """
    of_image = cv2.convertScaleAbs(cv2.resize(probability, view.camera.size), alpha=255)
    in_view = view.warp(cv2.cvtColor(of_image, cv2.COLOR_GRAY2RGB))[..., 0] / np.float32(255)
    reach = round(MASK_REACH_M / view.cell_m)
    kernels = np.ones(2 * reach + 1), np.arange(-reach, reach + 1.0)
    mass, moment = (cv2.sepFilter2D(in_view, -1, k, np.ones(1), borderType=cv2.BORDER_REPLICATE) for k in kernels)
    columns = moment / np.maximum(mass, 1e-6)
    top = np.minimum(cv2.dilate(in_view, np.ones((1, 2 * reach + 1))), _MAX_PROBABILITY)
    is_line = (in_view > _CENTRE_SHARE * top) & (mass < _AREA_SHARE * top * (2 * reach + 1))
    strength = settings.half_weight_strength * np.sqrt(top / (1 - top)) * (1 - (columns / 3) ** 2)
    return np.where(is_line & (np.abs(columns) <= 1.5) & view.seen, strength, np.float32(0))


def _edge_stripes(response: MarkingResponse, view: BirdsEyeView, settings: PaintSettings) -> Stripes:
    """Candidates for edges of the road, with less weight and a larger standard deviation than paint."""
    edges = find_stripes(response, view, settings)
    # a kerb, a gutter and the end of the asphalt are decimetres apart
    std_m, weight = np.hypot(edges.std_m, 0.4), settings.edge_weight * edges.weight
    return replace(edges, weight=weight, std_m=std_m, edge=np.ones(len(edges), bool))


def place(
    stripes: Stripes, band_strength: np.ndarray, view: BirdsEyeView, settings: PaintSettings = PAINT
) -> tuple[Stripes, np.ndarray]:
    """The stripes, at the more exact position of the band filter where they are clear for it; its strength at each."""
    column = np.rint((view.y_m[0] - stripes.y_m) / view.cell_m).astype(int)
    # within two columns a peak of the band filter is the same stripe, the nearest one first
    nearby = np.clip(column[:, None] + [0, -1, 1, -2, 2], 1, view.shape[1] - 2)
    peak = nearby[np.arange(len(nearby)), band_strength[stripes.row[:, None], nearby].argmax(axis=1)]
    y_m = view.y_m[0] - peak_position(band_strength, stripes.row, peak) * view.cell_m
    strength = band_strength[stripes.row, peak]
    return replace(stripes, y_m=np.where(strength > settings.half_weight_strength, y_m, stripes.y_m)), strength
