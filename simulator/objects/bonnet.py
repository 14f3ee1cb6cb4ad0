"""Bonnet of the car: dusty, reddish-brown, out of focus, fixed at the bottom edge of the image."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from simulator.painting.brush import Atmosphere, composite
from simulator.painting.noise import smoothstep

# Upper edge as shares of image width and height: left wing, dip, hump in the middle, right wing.
_OUTLINE = np.array(
    [
        [-0.02, 0.933], [0.05, 0.936], [0.11, 0.943], [0.16, 0.9515], [0.21, 0.953], [0.27, 0.9495], [0.34, 0.9395],
        [0.42, 0.932], [0.52, 0.9295], [0.62, 0.9315], [0.69, 0.9375], [0.75, 0.9425], [0.82, 0.9435], [0.86, 0.9395],
        [0.90, 0.931], [0.95, 0.922], [1.02, 0.917],
    ]
)  # fmt: skip
PAINT = np.array([0.190, 0.125, 0.110])


def bonnet_outline(size: tuple[int, int]) -> np.ndarray:
    """Row of the bonnet's upper edge in each column (width,) of an image of `size` (width, height)."""
    width, height = size
    edge = np.interp(np.arange(width, dtype=float), _OUTLINE[:, 0] * width, _OUTLINE[:, 1] * height)
    # Linear interpolation, smoothed to look like pressed steel.
    window = max(3, int(0.05 * width)) | 1
    return cv2.GaussianBlur(edge[None, :], (window, 1), window / 5, borderType=cv2.BORDER_REFLECT)[0]


def paint_bonnet(image: np.ndarray, *, light: float = 1.0) -> None:
    """Paint the bonnet along the bottom of an image (H, W, 3) float32, in place.

    `light` is 1 in the sun and about 0.25 under trees.
    """
    layer, top = _bonnet_layer((image.shape[1], image.shape[0]))
    composite(image, layer, 0, top, Atmosphere(light))


@lru_cache(maxsize=4)
def _bonnet_layer(size: tuple[int, int]) -> tuple[np.ndarray, int]:
    """Premultiplied RGBA image of the bonnet (rows, W, 4), and its first row."""
    height, edge = size[1], bonnet_outline(size)
    scale = height / 720
    top = int(edge.min() - 8 * scale)
    inward = (np.arange(top, height)[:, None] - edge) / scale
    # The edge is out of focus: a ramp of about three rows. It reflects the sky at a grazing angle.
    cover = smoothstep(-1.6, 1.6, inward)
    tone = cover * (1 - 0.3 * smoothstep(0, 40, inward))
    layer: np.ndarray = cv2.merge([*(tone * channel for channel in PAINT), cover]).astype(np.float32)
    layer = cv2.GaussianBlur(layer, (0, 0), 0.6 * scale, borderType=cv2.BORDER_REPLICATE)
    return layer, top
