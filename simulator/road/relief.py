"""Ray casting onto a road with a vertical profile, where crests hide the ground behind them."""

from __future__ import annotations

import cv2
import numpy as np

from simulator.road.road_ahead import RoadAhead

# Beyond this distance the ground is less than 2 px below the horizon and is part of the backdrop.
MAX_GROUND_M = 800.0
MIN_GROUND_M = 1.0
# Directions out from the camera (tangents), and the distances sampled in each.
TANGENTS = np.linspace(-1.0, 1.0, 81)
DISTANCES_M = np.geomspace(MIN_GROUND_M, MAX_GROUND_M, 420)
# Slopes of rays (rise per metre ahead) in the table; the step is half a pixel of a dashcam.
SLOPES = np.arange(-1.0, 0.35, 1 / 2400)
# Safety margin for the differences of slope within a row between the sampled columns.
SKY_MARGIN = 0.02
# After steps shorter than this share of the distance, road coordinates are extrapolated and not looked up again.
SHORT_STEP = 1e-4
# Rows per block, so that a block stays in the processor's cache.
BLOCK_ROWS = 48


def cast_on_relief(
    rays: np.ndarray, height_m: float, road: RoadAhead
) -> tuple[int, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """First intersection of each ray with the ground.

    Ground at distance x and height h is visible if the slope (h - height_m) / x exceeds that of all nearer ground in
    the same direction. The inverse of the running maximum of this slope gives the range of each ray; two steps of
    Newton's method refine it. `rays` (height, width, 3) are directions in the car's road frame, `height_m` is that of
    the camera above the road below it.

    Returns
    -------
    top : int
        First row with visible ground.
    visible : ndarray of shape (height - top, width), bool
    x, y : ndarrays of that shape, float32
        Metres ahead and to the left; MAX_GROUND_M ahead where no ground is visible.
    s, d : ndarrays of that shape, float32
        Road coordinates of these points, as from `RoadAhead.locate`.
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
    """Number of rows at the top of the picture whose rays are all too steep to meet ground."""
    steepest = SLOPES[np.flatnonzero(inverse.any(axis=1)).max(initial=0)]
    few = rays[:, ::32]
    rising = few[..., 2] > np.float32(steepest + SKY_MARGIN) * np.maximum(few[..., 0], np.float32(0.05))
    return int(np.argmin(rising.all(axis=1)))


def _inverse_distance_table(height_m: float, road: RoadAhead) -> np.ndarray:
    """Table (slopes, tangents) float32 of 1 / x of the first ground that a ray meets; 0 for no ground.

    The table holds 1 / x, because it is linear in the slope over level ground.
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
    """Points (x, s, d) after two steps of Newton's method from x (N,).

    Steps are limited to the step of the table, and skipped where a ray grazes the ground.
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
        # Nearly all steps are short enough to extrapolate s and d linearly.
        s += step * along / np.maximum(1 - curvature * d, np.float32(0.2))
        d += step * (cosine * tangent - sine)
        far = np.flatnonzero(np.abs(step) > np.float32(SHORT_STEP) * x)
        s[far], d[far] = road.locate(x[far], x[far] * tangent[far])
    return x, s, d
