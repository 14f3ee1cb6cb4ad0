"""Where a ray first meets a road that goes up and down: crests hide what is behind them."""

from __future__ import annotations

import cv2
import numpy as np

from simulator.road.road_ahead import RoadAhead

# Beyond this the ground is less than 2 px below the horizon and belongs to the backdrop.
MAX_GROUND_M = 800.0
MIN_GROUND_M = 1.0
# Ways out from under the camera, by the tangent of their direction, and the distances looked at on each.
TANGENTS = np.linspace(-1.0, 1.0, 81)
DISTANCES_M = np.geomspace(MIN_GROUND_M, MAX_GROUND_M, 420)
# Slopes of rays (rise per metre ahead) between which the table is read: half a pixel of a dashcam apart.
SLOPES = np.arange(-1.0, 0.35, 1 / 2400)
# By how much slopes may differ within a row between the columns that are looked at, and more.
SKY_MARGIN = 0.02
# After steps shorter than this share of the distance a place need not be looked up again.
SHORT_STEP = 1e-4
# So many stay in the processor's cache through all steps.
BLOCK_ROWS = 48


def cast_on_relief(
    rays: np.ndarray, height_m: float, road: RoadAhead
) -> tuple[int, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The first ground that each ray meets.

    Parameters
    ----------
    rays : ndarray of shape (height, width, 3), float32
        Directions in the car's road frame.
    height_m : float
        Of the camera above the road under it.
    road : RoadAhead

    Returns
    -------
    top : int
        First row with ground in it.
    visible : ndarray of shape (height - top, width), bool
    x, y : ndarrays of that shape, float32
        Metres ahead and to the left; at FARTHEST_M where no ground is seen.
    s, d : ndarrays of that shape, float32
        The same places along the road, as from `RoadAhead.locate`.

    Notes
    -----
    Along a way out, ground at distance x and height h is hidden unless (h - height) / x is larger than everywhere
    before: the running maximum of that slope, inverted, says how far each ray gets. Newton's method does the rest.
    """
    inverse = _inverse_distance_table(height_m, road)
    sky = _count_sky_rows(rays, inverse)
    rays = rays[sky:]
    forward = np.maximum(rays[..., 0], np.float32(0.05))
    tangent, slope = rays[..., 1] / forward, rays[..., 2] / forward
    column = (tangent - np.float32(TANGENTS[0])) / np.float32(TANGENTS[1] - TANGENTS[0])
    row = (slope - np.float32(SLOPES[0])) / np.float32(SLOPES[1] - SLOPES[0])
    seen = cv2.remap(inverse, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    visible = seen > np.float32(1 / MAX_GROUND_M)
    top = int(np.argmax(visible.any(axis=1)))
    visible, tangent, slope = visible[top:], tangent[top:], slope[top:]
    x = 1 / np.maximum(seen[top:], np.float32(1 / MAX_GROUND_M))
    s, d = np.empty_like(x), np.empty_like(x)
    for first in range(0, len(x), BLOCK_ROWS):
        rows = slice(first, first + BLOCK_ROWS)
        places = _refine(x[rows].ravel(), tangent[rows].ravel(), slope[rows].ravel(), height_m, road)
        x[rows], s[rows], d[rows] = (place.reshape(x[rows].shape) for place in places)
    return sky + top, visible, x, x * tangent, s, d


def _count_sky_rows(rays: np.ndarray, inverse: np.ndarray) -> int:
    """How many rows at the top of the picture see no ground for certain: all of their rays rise too steeply."""
    steepest = SLOPES[np.flatnonzero(inverse.any(axis=1)).max(initial=0)]
    few = rays[:, ::32]
    rising = few[..., 2] > np.float32(steepest + SKY_MARGIN) * np.maximum(few[..., 0], np.float32(0.05))
    return int(np.argmin(rising.all(axis=1)))


def _inverse_distance_table(height_m: float, road: RoadAhead) -> np.ndarray:
    """(slopes, tangents) float32 of 1 / x of the first ground that a ray meets, 0 where it meets none.

    1 / x, because over level ground it is linear in the slope.
    """
    x, tangent = (a.astype(np.float32) for a in np.meshgrid(DISTANCES_M, TANGENTS))
    s, _ = road.locate(x, x * tangent)
    horizon = np.maximum.accumulate((road.height_above_plane(s.astype(float)) - height_m) / DISTANCES_M, axis=1)
    inverse = 1 / DISTANCES_M
    columns = [np.interp(SLOPES, line, inverse, left=inverse[0], right=0.0) for line in horizon]
    return np.column_stack(columns).astype(np.float32)


def _refine(
    x: np.ndarray, tangent: np.ndarray, slope: np.ndarray, height_m: float, road: RoadAhead
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two steps of Newton's method from x (N,), and the places (x, s, d) where they end.

    No step is longer than one of the table, and there is none where a ray grazes the ground.
    """
    s, d = road.locate(x, x * tangent)
    for _ in range(2):
        height_above_plane, grade = road.height_and_grade(s)
        above = np.float32(height_m) + slope * x - height_above_plane
        cosine, sine, curvature = road.directions(s)
        along = cosine + sine * tangent
        falling = slope - grade * along
        step = -above / np.minimum(falling, np.float32(-1e-3))
        step = np.clip(step, np.float32(-0.02) * x, np.float32(0.02) * x) * (falling < -1e-3)
        x = x + step
        # Nearly all steps are so short that the place moves along with them.
        s += step * along / np.maximum(1 - curvature * d, np.float32(0.2))
        d += step * (cosine * tangent - sine)
        far = np.flatnonzero(np.abs(step) > np.float32(SHORT_STEP) * x)
        s[far], d[far] = road.locate(x[far], x[far] * tangent[far])
    return x, s, d
