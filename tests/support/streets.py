"""Streets of houses without lane lines, and images whose edges do not converge."""

from __future__ import annotations

import cv2
import numpy as np

from lanes.camera import Camera
from tests.support.painted_roads import paint_motorway


def paint_street(camera: Camera, *, lines: tuple[int, ...] = ()) -> np.ndarray:
    """A street of houses with four storeys on both sides: strips along the road, each of a grey of its own."""
    rng = np.random.default_rng(0)
    image = paint_motorway(camera, lines=lines, solid=lines)
    for y_m in (-7.0, 7.0):
        for begin_m in (70.0, 40.0, 24.0, 12.0):
            for floor in range(4):
                x_m = [begin_m, begin_m * 1.6, begin_m * 1.6, begin_m]
                z_m = [1.5 * floor, 1.5 * floor, 1.5 * floor + 1.2, 1.5 * floor + 1.2]
                corners = camera.road_to_pixels(np.column_stack([x_m, [y_m] * 4, z_m]))
                cv2.fillPoly(image, [np.round(corners).astype(np.int32)], [int(rng.integers(30, 230))] * 3)
    return image


def _grey(values: np.ndarray) -> np.ndarray:
    return np.repeat(np.broadcast_to(values, (720, 1280))[..., None], 3, axis=2).astype(np.uint8)


def _noise(blur_px: float) -> np.ndarray:
    image = np.random.default_rng(3).integers(0, 255, (720, 1280, 3), dtype=np.uint8)
    return cv2.GaussianBlur(image, (0, 0), blur_px)


def _tiles() -> np.ndarray:
    rows, columns = np.mgrid[:720, :1280]
    return _grey(((rows + columns) // 80 + (rows - columns) // 80) % 2 * 150 + 50)


def _shapes() -> np.ndarray:
    rng, image = np.random.default_rng(5), np.full((720, 1280, 3), 128, np.uint8)
    for corners in rng.integers(0, 1280, (60, 3, 2)):
        cv2.fillPoly(image, [corners.astype(np.int32)], rng.integers(0, 255, 3).tolist())
    return image


NOT_STREETS = {
    "sky": _grey(np.linspace(200, 100, 720)[:, None]),
    "noise": _noise(0.5),
    "clouds": _noise(6.0),
    "tiles": _tiles(),
    "shapes": _shapes(),
    "black": np.zeros((720, 1280, 3), np.uint8),
}
