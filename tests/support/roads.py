"""Pictures of roads with known truth, painted for the tests of the classic path.

A road is an arc of constant curvature; a line is the parallel arc at some distance from the lane's centre.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from lanes.camera.camera import Camera
from lanes.camera.camera_pose import CameraPose

WHITE, YELLOW = (235, 235, 230), (230, 185, 50)
LANE_WIDTH_M = 3.7
DASH_M, DASH_PERIOD_M = 3.05, 12.2

# A dashcam like the one the recipes were made for: its lens bends straight lines by up to 20 px at the corners.
CAMERA = Camera(
    1280,
    720,
    np.array([[1157.0, 0, 670], [0, 1152, 386], [0, 0, 1]]),
    np.array([-0.25, 0.05, -0.0009, 0.0008, 0.0]),
    CameraPose(height_m=1.2, pitch_rad=-0.026, yaw_rad=-0.022),
)


@dataclass(frozen=True)
class Road:
    """What is painted; `offset_m` > 0 puts the car left of the lane's centre, `curvature_per_m` > 0 bends left."""

    curvature_per_m: float = 0.0
    offset_m: float = 0.0
    left: tuple[int, int, int] | None = YELLOW
    right: tuple[int, int, int] | None = WHITE
    right_dashed: bool = False
    shadow_m: tuple[float, float] | None = None
    asphalt: int = 105
    paint_m: float = 0.15


def arc(road: Road, shift_m: float, x_m: np.ndarray) -> np.ndarray:
    """Lateral position (N,) of the arc `shift_m` left of the lane's centre, heading along x beside the car."""
    y0 = shift_m - road.offset_m
    k = road.curvature_per_m
    if abs(k) < 1e-9:
        return np.full_like(x_m, y0)
    radius = 1 / k - shift_m
    return y0 + radius - np.sign(radius) * np.sqrt(radius**2 - x_m**2)


def paint_picture(road: Road, camera: Camera = CAMERA, *, seed: int = 0) -> np.ndarray:
    """The raw (distorted) RGB picture (height, width, 3) of a road."""
    image = np.full((camera.height, camera.width, 3), (120, 150, 190), np.uint8)
    _fill(image, camera, np.array([[2.5, -14], [2.5, 14], [400, 200], [400, -200]]), (road.asphalt,) * 3)
    for colour, side, dashed in ((road.left, 1, False), (road.right, -1, road.right_dashed)):
        if colour is not None:
            for start, end in _pieces(dashed):
                _fill(image, camera, _stripe(road, side * LANE_WIDTH_M / 2, start, end), colour)
    if road.shadow_m:
        shade = np.full(image.shape[:2], 255, np.uint8)
        near, far = road.shadow_m
        _fill(shade, camera, np.array([[near, -14], [near + 1, 14], [far + 1, 14], [far, -14]]), 110)
        image = (image * (cv2.GaussianBlur(shade, (9, 9), 0)[..., None] / 255.0)).astype(np.uint8)
    noise = np.random.default_rng(seed).normal(0, 2.0, image.shape)
    return np.clip(cv2.GaussianBlur(image, (0, 0), 0.8) + noise, 0, 255).astype(np.uint8)


def paint_view(
    size: tuple[int, int], rows_to_columns, *, thickness_px: int = 15, rows: tuple[int, int] | None = None
) -> np.ndarray:
    """A binary view (height, width) with a line through the given columns, for each function of the row."""
    width, height = size
    binary = np.zeros((height, width), np.uint8)
    first, last = rows or (0, height)
    y = np.arange(first, last)
    for function in rows_to_columns:
        x = np.round(function(y)).astype(int)
        for shift in range(-(thickness_px // 2), thickness_px // 2 + 1):
            inside = (x + shift >= 0) & (x + shift < width)
            binary[y[inside], x[inside] + shift] = 255
    return binary


def _pieces(dashed: bool) -> list[tuple[float, float]]:
    if not dashed:
        return [(3.0, 120.0)]
    return [(s, s + DASH_M) for s in np.arange(4.0, 120.0, DASH_PERIOD_M)]


def _stripe(road: Road, shift_m: float, start_m: float, end_m: float) -> np.ndarray:
    x = np.linspace(start_m, end_m, max(int((end_m - start_m) * 4), 2))
    edges = [np.column_stack([x, arc(road, shift_m + s * road.paint_m / 2, x)]) for s in (1, -1)]
    return np.vstack([edges[0], edges[1][::-1]])


def _fill(image: np.ndarray, camera: Camera, road_polygon: np.ndarray, colour) -> None:
    """Fill a polygon on the road, anti-aliased, with its edges cut fine enough to bend with the lens."""
    closed = np.vstack([road_polygon, road_polygon[:1]])
    fine = np.vstack([np.linspace(a, b, 20, endpoint=False) for a, b in zip(closed, closed[1:], strict=False)])
    pixels = camera.road_to_pixels(fine)
    pixels = pixels[np.isfinite(pixels).all(axis=1) & (np.abs(pixels) < 20000).all(axis=1)]
    if len(pixels) >= 3:
        cv2.fillPoly(image, [np.round(pixels * 16).astype(np.int32)], colour, lineType=cv2.LINE_AA, shift=4)
