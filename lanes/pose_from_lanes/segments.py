"""Short straight segments of painted stripes in a raw picture, before the camera pose is known.

The width of a stripe along a picture row grows linearly with the distance of that row from the horizon, whatever the
direction of the stripe, because one row of a level camera shows one distance. A rough horizon row is therefore enough.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from lanes.camera.camera import Camera
from lanes.camera.static_pattern import StaticPattern

# Stripe width over camera height: stripes of 0.10-0.20 m, cameras at 1.1-1.6 m. The filter also responds to half and
# to twice that width, so that one number serves cars and vans.
STRIPE_TO_HEIGHT = 0.09
# A pixel whose response is this many times the noise of its row belongs to a stripe candidate.
MIN_SIGNAL_TO_NOISE = 4.0
# Weights in the centroid of a stripe are limited to this signal-to-noise ratio, so that one glaring pixel does not
# dominate it.
MAX_CENTROID_WEIGHT = 20.0
# Rows with less than this share of the mean response of their segment are dropped: the blurred ends of a dash add rows
# that run straight up and down and would make flat dashes look steeper.
MIN_ROW_RESPONSE = 0.75
# Stripes are cut into segments at distances with this ratio, so that a curve is nearly straight within a segment.
DISTANCE_RATIO = 1.25
# Largest |slope| in columns per row: a line 10 m to the side of a camera at 1.25 m. Flatter ones are not lane lines.
MAX_SLOPE = 8.0
# A segment needs this many rows and at most this residual, in pixels.
MIN_SEGMENT_ROWS, MAX_RESIDUAL_PX = 6, 4
# Standard deviation of a stripe centre in pixels. Added because few rows can lie on a line by chance.
CENTRE_STD_PX = 0.4
# Grid of the static pattern, in pixels: segments are compared where they cross every eighth row.
STATIC_ROW_PX, STATIC_COLUMN_PX = 8, 2
# The first row that is used lies this far below the rough horizon.
HORIZON_MARGIN_PX = 8


@dataclass(frozen=True)
class Segments:
    """Stripe segments of one picture in ray coordinates (x right, y down, at z = 1); all arrays have shape (N,).

    The standard deviations are from the scatter of the rows about the segment.
    """

    x: np.ndarray  # centre
    y: np.ndarray
    slope: np.ndarray  # dx/dy
    x_std: np.ndarray  # of x at y
    slope_std: np.ndarray
    rows: np.ndarray  # number of picture rows that support the segment

    def __len__(self) -> int:
        return len(self.x)

    def select(self, chosen: np.ndarray) -> Segments:
        """The segments of a boolean mask or index array."""
        return Segments(*(getattr(self, name)[chosen] for name in self.__dataclass_fields__))

    def without_roll(self, roll_rad: float) -> Segments:
        """The segments as seen by the same camera without its roll."""
        c, s = np.cos(roll_rad), np.sin(roll_rad)
        return replace(
            self,
            x=self.x * c - self.y * s,
            y=self.x * s + self.y * c,
            slope=(self.slope * c - s) / (self.slope * s + c),
        )


def find_segments(image: np.ndarray, camera: Camera, horizon_row: float) -> Segments:
    """Segments of painted stripes below a rough horizon in a raw RGB picture (height, width, 3), uint8; can be empty.

    Only the intrinsics of `camera` are used. `horizon_row` is the approximate row of the horizon at the centre of the
    picture. An error changes the expected stripe width far away, so that far segments are missed; near ones are still
    found.
    """
    top = int(np.clip(horizon_row + HORIZON_MARGIN_PX, 0, image.shape[0] - HORIZON_MARGIN_PX))
    below_horizon_px = np.maximum(np.arange(top, image.shape[0]) - horizon_row, 1)
    response = _stripe_response(image[top:], below_horizon_px)
    rows, columns, segment = _stripe_centres(response, below_horizon_px)
    if not len(rows):
        return Segments(*np.empty((6, 0)))
    rays = camera.rays(np.column_stack([columns, rows + top]))
    return _fit_segments(rays[:, 0], rays[:, 1], segment, 1 / camera.matrix[0, 0])


def _stripe_response(image: np.ndarray, below_horizon_px: np.ndarray) -> np.ndarray:
    """Signal-to-noise ratio of a stripe brighter or yellower than both sides; (rows, columns) float32."""
    half_widths = _half_widths_px(below_horizon_px)
    lab = cv2.cvtColor(image, cv2.COLOR_RGB2Lab)
    best = np.zeros(image.shape[:2], np.float32)
    for channel in (lab[..., 0], lab[..., 2]):
        response = _band_filter(channel, half_widths)
        # Digital pictures have at least one gray level of noise. The median is not affected by the few stripes.
        noise = 1.0 + 1.48 * np.median(np.abs(response[:, ::4]), axis=1, keepdims=True)
        best = np.maximum(best, response / noise)
    return best


def _half_widths_px(below_horizon_px: np.ndarray) -> np.ndarray:
    return np.maximum(np.round(STRIPE_TO_HEIGHT / 2 * below_horizon_px), 1).astype(int)


def _side_distance_px(half_width_px: np.ndarray) -> np.ndarray:
    """Distance from the centre of the filter to that of its sides; a gap of one half width excludes soft edges."""
    return 3 * half_width_px + 1


def _band_filter(channel: np.ndarray, half_widths: np.ndarray) -> np.ndarray:
    """Mean over 2 half + 1 columns minus the greater of the means on both sides, so that an edge has no response."""
    response = np.zeros(channel.shape, np.float32)
    for half in np.unique(half_widths):
        mean = cv2.boxFilter(channel[half_widths == half], cv2.CV_32F, (2 * int(half) + 1, 1))
        side = _side_distance_px(half)
        if 2 * side < channel.shape[1]:
            sides = np.maximum(mean[:, : -2 * side], mean[:, 2 * side :])
            response[half_widths == half, side:-side] = mean[:, side:-side] - sides
    return response


def _stripe_centres(response: np.ndarray, below_horizon_px: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stripe centres in each row: rows (N,), sub-pixel columns (N,), and the index of their segment (N,)."""
    mask = response > MIN_SIGNAL_TO_NOISE
    _, blobs = cv2.connectedComponents(mask.astype(np.uint8), connectivity=8, ltype=cv2.CV_32S)
    v, u = np.nonzero(mask)
    # One centre for each row of each connected component.
    keys, centre = np.unique(blobs[v, u].astype(np.int64) * len(response) + v, return_inverse=True)
    weight = np.minimum(response[v, u], MAX_CENTROID_WEIGHT)
    columns = np.bincount(centre, weight * u) / np.bincount(centre, weight)
    # A stripe that is cut off where the filter ends would have a shifted centre.
    border = _side_distance_px(_half_widths_px(below_horizon_px))[v]
    complete = np.bincount(centre, (u <= border) | (u >= response.shape[1] - 1 - border)) == 0
    rows, blob = keys % len(response), keys // len(response)
    distance_band = np.floor(np.log(below_horizon_px[rows]) / np.log(DISTANCE_RATIO)).astype(int)
    segment = np.unique(blob * 64 + distance_band, return_inverse=True)[1]
    row_response = np.bincount(centre, response[v, u]) / np.bincount(centre)
    mean_response = np.bincount(segment, row_response) / np.bincount(segment)
    valid = complete & (row_response > MIN_ROW_RESPONSE * mean_response[segment])
    return rows[valid], columns[valid], np.unique(segment[valid], return_inverse=True)[1]


def _fit_segments(x: np.ndarray, y: np.ndarray, segment: np.ndarray, pixel: float) -> Segments:
    """Least-squares line through the centres of each segment; short, curved or irregular segments are dropped."""
    rows = np.bincount(segment).astype(float)
    mean_x, mean_y = np.bincount(segment, x) / rows, np.bincount(segment, y) / rows
    dx, dy = x - mean_x[segment], y - mean_y[segment]
    spread = np.maximum(np.bincount(segment, dy**2), 1e-12)
    slope = np.bincount(segment, dx * dy) / spread
    variance = np.bincount(segment, (dx - slope[segment] * dy) ** 2) / np.maximum(rows - 2, 1)
    std = np.sqrt(variance + (CENTRE_STD_PX * pixel) ** 2)
    # The ends of a segment are uncertain within their rows: 0.25 row in position, 0.35 row in length.
    x_std = np.hypot(std / np.sqrt(rows), 0.25 * slope * pixel)
    slope_std = np.hypot(std / np.sqrt(spread), 0.35 * slope / rows)
    found = Segments(mean_x, mean_y, slope, x_std, slope_std, rows)
    return found.select((rows >= MIN_SEGMENT_ROWS) & (std < MAX_RESIDUAL_PX * pixel) & (np.abs(slope) < MAX_SLOPE))


def drop_static(pictures: Sequence[Sequence[Segments]], camera: Camera) -> list[Segments]:
    """The segments of pictures of one drive, in order, without those at the same place of most pictures.

    Guide lines that a camera draws, and stripes on a bonnet, would give their own vanishing point. Each picture may
    have several sets of segments; the result has all of them.
    """
    pattern = StaticPattern(camera.height // STATIC_ROW_PX + 1, camera.width // STATIC_COLUMN_PX + 1)
    for sets in pictures:
        pattern.add(*np.hstack([_places(segments, camera) for segments in sets]))
    every = [segments for sets in pictures for segments in sets]
    return [segments.select(~pattern.is_static(*_places(segments, camera))) for segments in every]


def _places(segments: Segments, camera: Camera) -> np.ndarray:
    """Rows and columns (2, N), int, of the grid of the static pattern at which segments cross the nearest row."""
    (fx, _, cx), (_, fy, cy) = camera.matrix[:2]
    row = np.clip(np.round((fy * segments.y + cy) / STATIC_ROW_PX), 0, camera.height // STATIC_ROW_PX)
    x = segments.x + segments.slope * ((row * STATIC_ROW_PX - cy) / fy - segments.y)
    column = np.clip(np.round((fx * x + cx) / STATIC_COLUMN_PX), 0, camera.width // STATIC_COLUMN_PX)
    return np.stack([row, column]).astype(int)
