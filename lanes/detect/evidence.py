"""Evidence: what one image shows of lane markings in a bird's-eye view, from all
sources combined.

Each source states for each cell how much it looks like paint: the band filter, our
network and the mask of a foreign network (`lanes.detect.markings`). Their strengths
have one scale, the root of the odds of paint. Band filter and network fail in different
places; their combined strength has the mean of their log odds. A foreign mask takes
their place, or joins them in the same way. The network also states where the road
ends. The peaks of each row are the stripe candidates.

A stripe is brighter (or yellower) than the road on *both* its sides, and about 0.1 to
0.2 m wide, or 0.3 to 0.4 m where two stripes run side by side. The band filter measures
centre minus the larger neighbour. An edge (shadow, kerb, joint of two asphalts) has one
neighbour as bright as its bright side and scores zero; a dark tar seam scores below
zero. The response is divided by the local noise, so that one threshold serves all
exposures, in sun and in shade.

The road next to a single stripe is the darker of two strips: one touches the stripe,
the other lies a gap farther out. Blur brightens the first, the second stripe of a
double line the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache, reduce
from math import lcm

import cv2
import numpy as np

from lanes.detect.birdseye import BirdsEyeView, lightness, yellowness
from lanes.detect.markings import (
    Markings,
    as_source,
    crop_rows,
    network_log_odds,
)


@dataclass(frozen=True)
class PaintSettings:
    """Band filter, noise and stripe candidates; tuned on the labelled Udacity stills
    where no source is given.
    """

    # Painted widths of one stripe and of a double line taken as one; most countries
    # paint 0.10 to 0.15 m. The strips of road that a stripe is compared with are as
    # wide as a single one.
    single_m: float = 0.15
    double_m: float = 0.35
    # Distance of these strips from the stripe. A single stripe is also compared with
    # the strips that touch it.
    gap_m: float = 0.05
    # Window along a row (m), and rows, over which the noise is averaged.
    noise_window: tuple[float, int] = (2.5, 5)
    # Grey levels. Rounding to whole grey levels alone makes about this much noise; less
    # is never assumed.
    noise_floor: float = 1.0
    # Smallest strength (times the local noise) of a stripe candidate, and the number of
    # candidates kept in a row.
    min_strength: float = 3.0
    stripes_per_row: int = 14
    # Columns averaged into one before a direction is measured, so that the window holds
    # a stripe that moves sideways by many columns from row to row.
    coarse_columns: int = 4
    # Strength (times the local noise) at which a candidate has half the weight of a
    # certain marking.
    half_weight_strength: float = 6.6
    # Standard deviation of a candidate's direction: at this difference it has a quarter
    # of its weight.
    angle_std_rad: float = 0.1
    # Standard deviation of a candidate's lateral position: that of worn paint nearby;
    # far away it is one pixel.
    position_std_m: float = 0.04
    # Weight of an edge of the road relative to paint of the same probability.
    edge_weight: float = 0.25


PAINT = PaintSettings()

# The centre of a mask's stripe is the centroid of the mask within this distance.
MASK_REACH_M = 0.75
# It needs this share of the largest probability there.
_CENTRE_SHARE = 0.5
# If the mean exceeds this share of the largest probability, the mask is an area, no
# line.
_AREA_SHARE = 0.9
# The probability is limited, because larger values are not more certain.
_MAX_PROBABILITY = 0.99
# Share of the variance of colours that brightness does not explain, above which an
# image has colours. Chosen on 306 real images: 98 % have more, and 99 % of their copies
# in gray, sepia, blue and green (night vision), as JPEG, less.
_COLOUR_SHARE = 0.12
# Variance of gray cells by noise and codecs, squared grey levels.
_GRAY_VARIANCE = 4.0
# The longer side of the image in cells whose colours are compared.
_COLOUR_CELLS = 100
# At this distance from its centre, a mask beside our evidence has half its strength.
_HALF_AT_M = 0.5
# A weaker response of the band filter says nothing against paint.
_LEAST_STRENGTH = np.float32(1.5)


@dataclass(frozen=True, eq=False)
class MarkingResponse:
    """How much each cell of a view looks like a painted stripe."""

    # (rows, columns) float32, at least 0: the largest filter response in units of the
    # local noise. `strength_weight` is the probability of paint, so that the square is
    # proportional to the odds.
    strength: np.ndarray
    # (2, rows, columns) int: lightness and yellowness of the view, in grey levels.
    channels: np.ndarray
    # The strength of the band filter, from which kinds of lines are measured: masks may
    # join dashes.
    band_strength: np.ndarray


@dataclass(frozen=True, eq=False)
class Stripes:
    """Stripe candidates, found row by row; all arrays have shape (stripes,)."""

    # Row of the view.
    row: np.ndarray
    # Position on the flat road, metres ahead and to the left, with sub-column
    # precision.
    x_m: np.ndarray
    y_m: np.ndarray
    # Direction of the stripe, radians, positive to the left of straight ahead.
    angle: np.ndarray
    # Depth of the row in columns of the view. From row to row a stripe moves sideways
    # by `step` times the tangent of its direction.
    step: np.ndarray
    # Weight 0 to 1 as a road marking, from the strength of the response.
    weight: np.ndarray
    # Standard deviations of lateral position, metres, and direction.
    std_m: np.ndarray
    angle_std_rad: np.ndarray
    # Whether it is an edge of the road (kerb, gravel, grass), not paint.
    edge: np.ndarray
    # Weight of a certain marking of this kind: 1 of paint, less of an edge.
    full_weight: np.ndarray
    # Whether its profile and its gaps can be measured; not if only a mask shows it.
    measurable: np.ndarray

    def __len__(self) -> int:
        return len(self.row)

    def select(self, which: np.ndarray) -> Stripes:
        """The stripes that `which` (bool or index) picks."""
        selected = {}
        for entry in fields(self):
            selected[entry.name] = getattr(self, entry.name)[which]
        return Stripes(**selected)

    def joined(self, other: Stripes) -> Stripes:
        """These stripes, then the others."""
        joined = {}
        for entry in fields(self):
            arrays = [getattr(self, entry.name), getattr(other, entry.name)]
            joined[entry.name] = np.concatenate(arrays)
        return Stripes(**joined)


def marking_response(
    view_image: np.ndarray, view: BirdsEyeView, settings: PaintSettings
) -> MarkingResponse:
    """Response of the band filters to an image (rows, columns, 3), uint8, of the view.

    The image is that of `view.warp`. Filters use sums instead of means, scaled to a
    common unit: the integers are exact, and int16 is twice as fast as float32. If the
    sums do not fit because the cells are small, numpy's next larger type is used.
    """
    window_m, _ = settings.noise_window
    single = _odd_cells(settings.single_m, view)
    double = _odd_cells(settings.double_m, view)
    gap = _odd_cells(settings.gap_m, view)
    window = _odd_cells(window_m, view)
    unit = lcm(single, double)
    pad = double // 2 + gap + single + 1

    # both channels, with a margin in which the border repeats
    padded = cv2.copyMakeBorder(view_image, 0, 0, pad, pad, cv2.BORDER_REPLICATE)
    sums_type = np.min_scalar_type(-2 * 255 * unit)
    channels = np.empty((2, *padded.shape[:2]), sums_type)
    channels[0] = lightness(padded)
    channels[1] = yellowness(padded)

    # stripe minus road, of both widths
    singles = _sums_around(channels, single) * (unit // single)
    doubles = _sums_around(channels, double) * (unit // double)
    road = singles.copy()
    road[..., :pad] = road[..., pad, None]
    road[..., -pad:] = road[..., -pad - 1, None]
    beyond_double = double // 2 + gap + single // 2 + 1
    inside = (..., slice(pad, -pad))
    narrow = _filter_band(singles, road, [single, single + gap])[inside]
    wide = _filter_band(doubles, road, [beyond_double])[inside]

    # in units of the local noise; large sums are int32, whose quotients numpy makes
    # float64
    steps = np.abs(channels[..., pad : 1 - pad] - channels[..., pad - 1 : -pad])
    two_steps = steps[..., :-1] + steps[..., 1:]
    noise = unit * _local_noise(two_steps, window, view, settings)
    of_channels = np.maximum(narrow, wide) / noise
    larger = np.maximum(of_channels[0], of_channels[1])
    strength = np.maximum(larger, 0, dtype=np.float32)
    strength = cv2.copyTo(strength, view.seen.view(np.uint8))
    return MarkingResponse(strength, channels[inside], strength)


def _odd_cells(length_m: float, view: BirdsEyeView) -> int:
    """A length across the view in cells, rounded to an odd number."""
    return round(length_m / view.cell_m) | 1


def _sums_around(cells: np.ndarray, count: int) -> np.ndarray:
    """Sums over `count` (odd) columns around each of the cells (..., columns).

    They are not meaningful at the first and last columns. Rows are laid end to end,
    because one long row is added faster than many short ones.
    """
    row = cells.ravel()
    half = count // 2
    sums = np.zeros(cells.size, cells.dtype)
    sums[half : cells.size - half] = _window_sums(row, count)
    return sums.reshape(cells.shape)


def _window_sums(row: np.ndarray, count: int) -> np.ndarray:
    """(N - count + 1,) sums over `count` neighbours of (N,).

    By doubling: about log2(count) additions per cell.
    """
    if count == 1:
        return row
    half = _window_sums(row, count // 2)
    size = len(row) - count + 1
    sums = half[:size] + half[count // 2 :][:size]
    return sums + row[count - 1 :] if count % 2 else sums


def _filter_band(
    centre: np.ndarray, side: np.ndarray, reaches: Sequence[int]
) -> np.ndarray:
    """`centre` (..., columns) minus the larger of its two sides; in place.

    A side is the smallest of `side` (..., columns) at `reaches` columns to the left or
    right.
    """
    response = centre.ravel()
    beside = side.ravel()
    margin = max(reaches)
    size = response.size - 2 * margin

    left = [beside[margin - reach :][:size] for reach in reaches]
    right = [beside[margin + reach :][:size] for reach in reaches]
    darker_left = reduce(np.minimum, left)
    darker_right = reduce(np.minimum, right)
    response[margin:-margin] -= np.maximum(darker_left, darker_right)
    return response.reshape(centre.shape)


def _local_noise(
    steps: np.ndarray, window: int, view: BirdsEyeView, settings: PaintSettings
) -> np.ndarray:
    """Mean step from column to column around each cell plus the noise floor.

    The result is (2, rows, columns), float32. `steps` holds the sum of each cell's two
    steps, to the left and to the right, so that the mirrored image has the mirrored
    noise. Steps outside the image are 0 and are left out of the mean.
    """
    _, rows = settings.noise_window
    size = (window, rows)
    noise = np.array([cv2.boxFilter(channel, cv2.CV_32F, size) for channel in steps])
    # cells inside the image have a larger share than 0.2
    share = np.maximum(_seen_share(view, size), 0.2)
    noise /= 2 * share
    noise += settings.noise_floor
    return noise


@lru_cache(maxsize=8)
def _seen_share(view: BirdsEyeView, window: tuple[int, int]) -> np.ndarray:
    """(rows, columns) float32: share of a window around each cell that is in the image.

    `window` is (columns, rows).
    """
    return cv2.blur(view.seen.astype(np.float32), window)


def find_stripes(
    response: MarkingResponse, view: BirdsEyeView, settings: PaintSettings
) -> Stripes:
    """Peaks of the marking response along each row, with sub-column precision.

    They are the strongest `settings.stripes_per_row` of a row, and stronger than
    `settings.min_strength`.
    """
    strength = response.strength
    row, column = _peaks(strength, settings)
    x_m = view.x_m[row]
    step = view.row_columns[row]
    count = len(row)
    return Stripes(
        row=row,
        x_m=x_m,
        y_m=view.y_m[0] - peak_position(strength, row, column) * view.cell_m,
        angle=_stripe_angle(strength, row, column, step, settings.coarse_columns),
        step=step,
        weight=strength_weight(strength[row, column], settings),
        std_m=np.hypot(settings.position_std_m, x_m / view.focal_px),
        angle_std_rad=np.full(count, settings.angle_std_rad),
        edge=np.zeros(count, bool),
        full_weight=np.ones(count),
        measurable=np.ones(count, bool),
    )


def peak_position(
    strength: np.ndarray, row: np.ndarray, column: np.ndarray
) -> np.ndarray:
    """Column with its fraction, (N,), of the vertex of a parabola through each peak.

    The parabola passes through the peak and its two neighbours in the row.
    """
    left = strength[row, column - 1]
    middle = strength[row, column]
    right = strength[row, column + 1]
    bend = left - 2 * middle + right
    vertex = 0.5 * (left - right) / np.minimum(bend, -1e-9)
    shift = np.where(bend < 0, vertex, 0.0)
    return column + np.clip(shift, -0.5, 0.5)


def _peaks(
    strength: np.ndarray, settings: PaintSettings
) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the local maxima that are strong enough, in order of the
    rows.

    A maximum is the largest cell within two columns.
    """
    # positions in one long row: numpy finds them six times as fast as rows and columns
    largest_near = cv2.dilate(strength, np.ones((1, 5), np.uint8))
    peak = cv2.compare(strength, largest_near, cv2.CMP_GE).view(bool)
    found = np.flatnonzero(peak & (strength > settings.min_strength))
    columns = strength.shape[1]
    row, column = np.divmod(found, columns)
    inside = (column > 0) & (column < columns - 1)
    row = row[inside]
    column = column[inside]
    if np.bincount(row).max(initial=0) <= settings.stripes_per_row:
        return row, column

    # the strongest of each row
    order = np.lexsort((-strength[row, column], row))
    row = row[order]
    column = column[order]
    place_in_row = np.arange(len(row)) - np.searchsorted(row, row)
    keep = place_in_row < settings.stripes_per_row
    return row[keep], column[keep]


def _stripe_angle(
    strength: np.ndarray,
    row: np.ndarray,
    column: np.ndarray,
    step: np.ndarray,
    coarse_columns: int,
) -> np.ndarray:
    """Direction of stripes on the road from the structure tensor of the response.

    After Bigun and Granlund (1987).
    """
    rows, columns = strength.shape
    # an odd number of cells, so that a mirrored image has mirrored directions
    cells = columns // coarse_columns | 1
    coarse = cv2.resize(strength, (cells, rows), interpolation=cv2.INTER_AREA)
    across = cv2.Scharr(coarse, cv2.CV_32F, 1, 0)
    along = cv2.Scharr(coarse, cv2.CV_32F, 0, 1)

    # only the tensor's off-diagonal element and the difference of its diagonal are
    # needed
    cell = (2 * column + 1) * cells // (2 * columns)
    off_diagonal = _mean_around(across * along)[row, cell]
    difference = _mean_around((across - along) * (across + along))[row, cell]
    normal = 0.5 * np.arctan2(2 * off_diagonal, difference)

    # from one row to the next nearer one the stripe moves this many cells to the right,
    # and x falls by the row's depth
    return np.arctan2(-np.tan(normal), step * cells / columns)


def _mean_around(cells: np.ndarray) -> np.ndarray:
    """Mean over 3 columns and 5 rows around each cell.

    For windows this small a separable filter is faster than cv2.blur.
    """
    three = np.full(3, 1 / 3, np.float32)
    five = np.full(5, 1 / 5, np.float32)
    return cv2.sepFilter2D(cells, -1, three, five, borderType=cv2.BORDER_REPLICATE)


def strength_weight(strength: np.ndarray, settings: PaintSettings) -> np.ndarray:
    """Weights 0 to 1 as a road marking of cells or candidates of these strengths."""
    square = strength**2
    return square / (square + settings.half_weight_strength**2)


@dataclass(frozen=True, eq=False)
class Evidence:
    """What one image shows in a view.

    `image` (height, width, 3), uint8, is the raw image, `view_image` (rows, columns, 3)
    its bird's-eye view, `response` the combined one, `sources` are the names of its
    parts, `settings` those that it was found with.
    """

    image: np.ndarray
    view: BirdsEyeView
    view_image: np.ndarray
    response: MarkingResponse
    stripes: Stripes
    sources: tuple[str, ...]
    confidence_shift: float
    settings: PaintSettings

    @cached_property
    def has_colours(self) -> bool:
        """Whether the image shows colours; see `has_colours`."""
        return has_colours(self.image)

    def at_height(self, height_m: float) -> Evidence:
        """The same evidence for another height of the camera.

        All distances on the road are proportional to it.
        """
        factor = height_m / self.view.height_m
        stripes = replace(
            self.stripes,
            x_m=factor * self.stripes.x_m,
            y_m=factor * self.stripes.y_m,
            std_m=factor * self.stripes.std_m,
        )
        return replace(self, view=self.view.at_height(height_m), stripes=stripes)


def find_evidence(
    image: np.ndarray,
    view: BirdsEyeView,
    settings: PaintSettings,
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
        Its mask takes the place of the other sources, or joins them, as a
        `MarkingSource` says.
    quick : bool
        Leave our network out: it takes sixty times as long as the band filter.
    """
    view_image = view.warp(image)
    band = marking_response(view_image, view, settings)
    source = None if markings is None else as_source(markings)
    with_own = source is None or source.with_own

    # the strengths of all sources, combined
    ours = band.strength
    edges: np.ndarray | None = None
    sources: list[str] = []
    if with_own:
        sources.append("band filter")
    if with_own and not quick:
        ours, edges = _add_network(band.strength, image, view, settings)
        sources.append("network")
    strength = ours
    cell_px = 1.0
    if source is not None:
        sources.append("mask")
        rows = source.window_rows(view.camera)
        mask = source.find_mask(crop_rows(image, rows))
        in_view = mask_in_view(mask, rows, view)
        if with_own:
            if quick:
                # as in `_add_network`, a weak response says nothing
                ours = np.maximum(ours, _LEAST_STRENGTH * view.seen)
            strength = _add_mask(ours, in_view, view, settings)
        else:
            strength = _thinned_strength(in_view, view, settings)
            cell_px = max(view.camera.width / mask.shape[1], 1)

    # the stripes, at the more exact places of the band filter
    response = replace(band, strength=strength)
    stripes = find_stripes(response, view, settings)
    if strength is not band.strength:
        stripes, band_strength = place(stripes, band.strength, view, settings)
        if source is not None:
            stripes = _only_measured(stripes, band_strength, cell_px, settings)
    if edges is not None:
        of_edges = replace(band, strength=edges)
        stripes = stripes.joined(_edge_stripes(of_edges, view, settings))

    return Evidence(
        image=image,
        view=view,
        view_image=view_image,
        response=response,
        stripes=stripes,
        sources=tuple(sources),
        confidence_shift=0.0 if source is None else source.confidence_shift,
        settings=settings,
    )


def has_colours(image: np.ndarray) -> bool:
    """Whether an RGB image (height, width, 3), uint8, shows colours.

    In gray, tinted and night-vision images the colour is a function of the brightness:
    cells of neighbouring brightness have the same one. The share of the variance that
    differs between neighbours is von Neumann's ratio (1941).
    """
    # cells are larger than the blur of subsampled colours
    cell_px = max(image.shape[:2]) / _COLOUR_CELLS
    step = max(1, int(cell_px / 4))
    # channel by channel, because numpy copies few bytes at a time slowly
    channels = [np.ascontiguousarray(image[::step, ::step, k]) for k in range(3)]
    samples = cv2.merge(channels)
    scale = min(1.0, step / cell_px)
    cells = cv2.resize(samples, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)

    # not in whole grey levels, of which cells side by side often have the same one
    brightness = cells.reshape(-1, 3) @ (0.299, 0.587, 0.114)
    order = np.argsort(brightness, kind="stable")
    red, green, blue = cells.reshape(-1, 3)[order].astype(float).T
    colour = np.array([red - green, green - blue])
    variance = colour.var(axis=1).sum()
    between_neighbours = (np.diff(colour) ** 2).mean(axis=1).sum() / 2
    return bool(between_neighbours > _COLOUR_SHARE * (variance + _GRAY_VARIANCE))


def _add_network(
    band_strength: np.ndarray,
    image: np.ndarray,
    view: BirdsEyeView,
    settings: PaintSettings,
) -> tuple[np.ndarray, np.ndarray]:
    """The strength of band filter and network together, and that of edges of the road.

    The weight of a cell (`strength_weight`) is the probability that the network states.
    The combined strength is the mean of the log odds; a response below one and a half
    times the noise says nothing against paint.
    """
    log_odds = network_log_odds(image, view)
    strengths = settings.half_weight_strength * np.exp(log_odds / 2) * view.seen
    paint, edges = strengths
    least = _LEAST_STRENGTH * view.seen
    return np.sqrt(np.maximum(band_strength, least) * paint), edges


def _add_mask(
    ours: np.ndarray,
    in_view: np.ndarray,
    view: BirdsEyeView,
    settings: PaintSettings,
) -> np.ndarray:
    """The strength of our evidence and of a mask in the view together.

    It is the mean of the log odds of both. The mask never weakens our evidence: on
    roads unlike those of its training a network sees nothing. The centre of a stripe is
    its strongest place.
    """
    _, columns = _mass_and_centre(in_view, round(MASK_REACH_M / view.cell_m))
    from_centre = columns * view.cell_m / _HALF_AT_M
    of_mask = _odds_strength(in_view, settings) / (1 + from_centre**2)
    return np.maximum(ours, np.sqrt(ours * of_mask))


def _only_measured(
    stripes: Stripes,
    band_strength: np.ndarray,
    cell_px: float,
    settings: PaintSettings,
) -> Stripes:
    """The stripes of a mask: measurable only where the band filter sees them, too.

    A stripe of a mask alone is as exact as its pixels, `cell_px` wide, and has no
    profile.
    """
    is_clear = band_strength > settings.half_weight_strength
    std_m = np.where(is_clear, 1, cell_px) * stripes.std_m
    measurable = band_strength > settings.min_strength
    return replace(stripes, std_m=std_m, measurable=measurable)


def mask_in_view(
    mask: np.ndarray, rows: tuple[int, int], view: BirdsEyeView
) -> np.ndarray:
    """A mask in the view: probabilities (rows, columns) float32, 0 to 1.

    The mask is that of some `rows` of the image, from the first to the one below the
    last; it is 0 elsewhere.
    """
    top, bottom = rows
    resized = cv2.resize(mask, (view.camera.width, bottom - top))
    of_image = crop_rows(resized, (-top, view.camera.height - top))
    as_rgb = cv2.cvtColor(cv2.convertScaleAbs(of_image, alpha=255), cv2.COLOR_GRAY2RGB)
    in_view = view.warp(as_rgb)[..., 0] / np.float32(255)

    v = view.pixels[..., 1]
    in_rows = view.seen & (v >= top) & (v <= bottom - 1)
    return np.where(in_rows, in_view, np.float32(0))


def _odds_strength(probability: np.ndarray, settings: PaintSettings) -> np.ndarray:
    """Strengths whose weights (`strength_weight`) are the probabilities."""
    limited = np.minimum(probability, _MAX_PROBABILITY)
    return settings.half_weight_strength * np.sqrt(limited / (1 - limited))


def _thinned_strength(
    in_view: np.ndarray, view: BirdsEyeView, settings: PaintSettings
) -> np.ndarray:
    """Strengths (rows, columns) float32 of the lines of a mask in a view.

    A mask is wider than paint: it is thinned to parabolas, three columns wide, at the
    centres of its stripes.
    """
    reach = round(MASK_REACH_M / view.cell_m)
    mass, columns = _mass_and_centre(in_view, reach)
    around = np.ones((1, 2 * reach + 1))
    top = np.minimum(cv2.dilate(in_view, around), _MAX_PROBABILITY)
    is_narrow = mass < _AREA_SHARE * top * (2 * reach + 1)
    is_line = (in_view > _CENTRE_SHARE * top) & is_narrow
    strength = _odds_strength(top, settings) * (1 - (columns / 3) ** 2)
    kept = is_line & (np.abs(columns) <= 1.5) & view.seen
    return np.where(kept, strength, np.float32(0))


def _mass_and_centre(in_view: np.ndarray, reach: int) -> tuple[np.ndarray, np.ndarray]:
    """Sum of a mask over `reach` columns to both sides of each cell, and the distance
    of its centroid there, in columns.
    """
    mass = _sum_along_rows(in_view, np.ones(2 * reach + 1))
    moment = _sum_along_rows(in_view, np.arange(-reach, reach + 1.0))
    return mass, moment / np.maximum(mass, 1e-6)


def _sum_along_rows(cells: np.ndarray, kernel: np.ndarray) -> np.ndarray:
    """The correlation of each row with a kernel."""
    one = np.ones(1)
    return cv2.sepFilter2D(cells, -1, kernel, one, borderType=cv2.BORDER_REPLICATE)


def _edge_stripes(
    response: MarkingResponse, view: BirdsEyeView, settings: PaintSettings
) -> Stripes:
    """Candidates for edges of the road: less weight and larger std than paint."""
    edges = find_stripes(response, view, settings)
    return replace(
        edges,
        weight=settings.edge_weight * edges.weight,
        # a kerb, a gutter and the end of the asphalt are decimetres apart
        std_m=np.hypot(edges.std_m, 0.4),
        edge=np.ones(len(edges), bool),
        full_weight=np.full(len(edges), settings.edge_weight),
    )


def place(
    stripes: Stripes,
    band_strength: np.ndarray,
    view: BirdsEyeView,
    settings: PaintSettings,
) -> tuple[Stripes, np.ndarray]:
    """The stripes at the places of the band filter where they are clear for it.

    These are more exact. The second result is the strength of the band filter at each.
    """
    # within two columns a peak of the band filter is the same stripe, the nearest first
    column = np.rint((view.y_m[0] - stripes.y_m) / view.cell_m).astype(int)
    nearby = np.clip(column[:, None] + [0, -1, 1, -2, 2], 1, view.shape[1] - 2)
    strongest = band_strength[stripes.row[:, None], nearby].argmax(axis=1)
    peak = nearby[np.arange(len(nearby)), strongest]

    position = peak_position(band_strength, stripes.row, peak)
    y_m = view.y_m[0] - position * view.cell_m
    strength = band_strength[stripes.row, peak]
    is_clear = strength > settings.half_weight_strength
    placed = replace(stripes, y_m=np.where(is_clear, y_m, stripes.y_m))
    return placed, strength
