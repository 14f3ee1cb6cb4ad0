"""Painted stripes in a raw picture, found before anybody knows where the road lies: short straight pieces as rays.

A stripe painted on a flat road has, along one picture row, a width that grows linearly with the row's distance from the
horizon, whatever its direction: one row sees one distance ahead. That needs only a rough idea of the horizon row.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from lanes.camera.camera import Camera

# Stripe width over camera height: 0.10-0.20 m of paint below a camera at 1.1-1.6 m. The filter answers to half and to
# twice that width, so one number serves cars and vans.
STRIPE_TO_HEIGHT = 0.09
# A response this many times the row's own median response is a stripe candidate.
STRIPE_TO_NOISE = 4.0
# Segments are cut where the distance ahead grows by this factor, so that a curve is nearly straight within each.
BAND_RATIO = 1.25
# Columns per row of a line 10 m beside a camera at 1.25 m; flatter ones are no lane lines near the car.
STEEPEST_SLOPE = 8.0


@dataclass(frozen=True)
class Segments:
    """Short pieces of stripes of one picture, in ray coordinates (x right, y down, at z = 1); all arrays are (N,).

    Attributes
    ----------
    x, y : ndarray
        Middle of the piece.
    slope : ndarray
        dx/dy.
    x_std, slope_std : ndarray
        Standard deviations of x (at y) and slope, from the scatter of the rows about the piece.
    rows : ndarray
        Frame rows that carry it.
    """

    x: np.ndarray
    y: np.ndarray
    slope: np.ndarray
    x_std: np.ndarray
    slope_std: np.ndarray
    rows: np.ndarray

    def __len__(self) -> int:
        return len(self.x)

    def select(self, chosen: np.ndarray) -> Segments:
        """The segments of a boolean mask or index array."""
        return Segments(*(getattr(self, name)[chosen] for name in self.__dataclass_fields__))

    def rolled_back(self, roll_rad: float) -> Segments:
        """As a camera without that roll would see them."""
        c, s = np.cos(roll_rad), np.sin(roll_rad)
        return replace(
            self,
            x=self.x * c - self.y * s,
            y=self.x * s + self.y * c,
            slope=(self.slope * c - s) / (self.slope * s + c),
        )


def find_segments(image: np.ndarray, camera: Camera, horizon_row: float) -> Segments:
    """Find pieces of painted stripes below a rough horizon.

    Parameters
    ----------
    image : ndarray of shape (height, width, 3), uint8
        RGB, raw, of the camera's size.
    camera : Camera
        Only its lens is used.
    horizon_row : float
        Rough row of the horizon at the middle of the picture. Where it is off, far pieces of stripes are missed, as
        the width expected of them is wrong; near ones are found all the same.

    Returns
    -------
    Segments
        Where the picture shows no stripe, of length 0.
    """
    top = int(np.clip(horizon_row + 8, 0, image.shape[0] - 8))
    below_horizon_px = np.maximum(np.arange(top, image.shape[0]) - horizon_row, 1)
    response = _stripe_response(image[top:], below_horizon_px)
    rows, columns, piece = _link_rows(response, below_horizon_px)
    if not len(rows):
        return Segments(*np.empty((6, 0)))
    rays = camera.rays(np.column_stack([columns, rows + top]))
    return _fit_pieces(rays[:, 0], rays[:, 1], piece, 1 / camera.matrix[0, 0])


def _stripe_response(image: np.ndarray, below_horizon_px: np.ndarray) -> np.ndarray:
    """How much brighter or yellower than both its neighbours, in units of the row's noise; (rows, columns) float32."""
    half = _half_widths(below_horizon_px)
    lab = cv2.cvtColor(image, cv2.COLOR_RGB2Lab)
    best = np.zeros(image.shape[:2], np.float32)
    for channel in (lab[..., 0], lab[..., 2]):
        band = _band_filter(channel, half)
        # One gray level is the least noise a digital picture has; the median does not see the few stripes themselves.
        noise = 1.0 + 1.48 * np.median(np.abs(band[:, ::4]), axis=1, keepdims=True)
        best = np.maximum(best, band / noise)
    return best


def _half_widths(below_horizon_px: np.ndarray) -> np.ndarray:
    return np.maximum(np.round(STRIPE_TO_HEIGHT / 2 * below_horizon_px), 1).astype(int)


def _aside(half: np.ndarray) -> np.ndarray:
    """From the filter's middle to that of its sides: a gap of one half width keeps soft edges out of them."""
    return 3 * half + 1


def _band_filter(channel: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Mean over 2 half + 1 columns minus the greater of the means beside it, so that an edge scores nothing."""
    response = np.zeros(channel.shape, np.float32)
    for h in np.unique(half):
        mean = cv2.boxFilter(channel[half == h], cv2.CV_32F, (2 * int(h) + 1, 1))
        aside = _aside(h)
        if 2 * aside < channel.shape[1]:
            beside = np.maximum(mean[:, : -2 * aside], mean[:, 2 * aside :])
            response[half == h, aside:-aside] = mean[:, aside:-aside] - beside
    return response


def _link_rows(response: np.ndarray, below_horizon_px: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stripe centres row by row: rows (N,), sub-pixel columns (N,), and the number of the piece they belong to (N,)."""
    mask = response > STRIPE_TO_NOISE
    _, blobs = cv2.connectedComponents(mask.astype(np.uint8), connectivity=8, ltype=cv2.CV_32S)
    v, u = np.nonzero(mask)
    keys, at = np.unique(blobs[v, u].astype(np.int64) * len(response) + v, return_inverse=True)
    # Capped, or a single glaring pixel would pull the centre to itself.
    weight = np.minimum(response[v, u], 5 * STRIPE_TO_NOISE)
    columns = np.bincount(at, weight * u) / np.bincount(at, weight)
    # A stripe that leaves the filter's reach is cut in two, which would shift its centre.
    reach = _aside(_half_widths(below_horizon_px))[v]
    whole = np.bincount(at, (u <= reach) | (u >= response.shape[1] - 1 - reach)) == 0
    rows, blob = keys % len(response), keys // len(response)
    band = np.floor(np.log(below_horizon_px[rows]) / np.log(BAND_RATIO)).astype(int)
    piece = np.unique(blob * 64 + band, return_inverse=True)[1]
    # The blurred ends of a dash reach a row too far, straight up and down, which would make flat dashes look steeper.
    strength = np.bincount(at, response[v, u]) / np.bincount(at)
    usual = np.bincount(piece, strength) / np.bincount(piece)
    sound = whole & (strength > 0.75 * usual[piece])
    return rows[sound], columns[sound], np.unique(piece[sound], return_inverse=True)[1]


def _fit_pieces(x: np.ndarray, y: np.ndarray, piece: np.ndarray, pixel: float) -> Segments:
    """A straight line through the stripe centres of every piece; short, bent or ragged ones are dropped."""
    rows = np.bincount(piece).astype(float)
    mean_x, mean_y = np.bincount(piece, x) / rows, np.bincount(piece, y) / rows
    dx, dy = x - mean_x[piece], y - mean_y[piece]
    spread = np.maximum(np.bincount(piece, dy**2), 1e-12)
    slope = np.bincount(piece, dx * dy) / spread
    scatter = np.bincount(piece, (dx - slope[piece] * dy) ** 2) / np.maximum(rows - 2, 1)
    # Six rows may happen to lie on a line; that makes them no better than 0.4 px.
    std = np.sqrt(scatter + (0.4 * pixel) ** 2)
    # Where in its first and last row a piece begins and ends stays open: a quarter row for its place, more for slope.
    x_std = np.hypot(std / np.sqrt(rows), 0.25 * slope * pixel)
    slope_std = np.hypot(std / np.sqrt(spread), 0.35 * slope / rows)
    found = Segments(mean_x, mean_y, slope, x_std, slope_std, rows)
    return found.select((rows >= 6) & (std < 4 * pixel) & (np.abs(slope) < STEEPEST_SLOPE))
