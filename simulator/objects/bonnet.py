"""Bonnet of the car: dusty, dark reddish-brown, out of focus, fixed at the bottom edge of the image."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from simulator.painting.brush import Atmosphere, composite_behind, split_channels
from simulator.painting.noise import fractal_noise, smoothstep

# Upper edge as shares of image width and height: left wing, dip, hump in the middle, right wing.
_OUTLINE = np.array(
    [
        [-0.02, 0.933], [0.05, 0.936], [0.11, 0.943], [0.16, 0.9515], [0.21, 0.953], [0.27, 0.9495], [0.34, 0.9395],
        [0.42, 0.932], [0.52, 0.9295], [0.62, 0.9315], [0.69, 0.9375], [0.75, 0.9425], [0.82, 0.9435], [0.86, 0.9395],
        [0.90, 0.931], [0.95, 0.922], [1.02, 0.917],
    ]
)  # fmt: skip
DUSTY_PAINT = np.array([0.235, 0.160, 0.138])
CLEAN_PAINT = np.array([0.125, 0.070, 0.066])
SKY_IN_PAINT = np.array([0.125, 0.090, 0.140])


def bonnet_outline(size: tuple[int, int]) -> np.ndarray:
    """Row of the bonnet's upper edge in each column (width,) of an image of `size` (width, height)."""
    width, height = size
    knots_u, knots_v = _OUTLINE[:, 0] * width, _OUTLINE[:, 1] * height
    u = np.arange(width, dtype=float)
    edge = np.interp(u, knots_u, knots_v)
    # Linear interpolation, smoothed to look like pressed steel.
    window = max(3, int(0.05 * width)) | 1
    return cv2.GaussianBlur(edge[None, :], (window, 1), window / 5, borderType=cv2.BORDER_REFLECT)[0]


def first_hidden_row(size: tuple[int, int], seed: int = 0) -> int:
    """First row from which the bonnet hides everything in an image of `size` (width, height); the height if none."""
    layer, top = _bonnet_layer(size, seed)
    open_rows = np.flatnonzero(layer[..., 3].min(axis=1) < 1 - 1e-6)
    return top + int(open_rows[-1]) + 1


def paint_bonnet(picture: np.ndarray, *, seed: int = 0, light: float = 1.0) -> None:
    """Paint the bonnet along the bottom of a canvas (4, H, W) of `new_canvas`, in place; it is nearer than all else.

    `seed` is that of the dust; `light` is 1 in the sun and about 0.25 under trees.
    """
    layer, top = _bonnet_layer(picture.shape[:0:-1], seed)
    composite_behind(picture, split_channels(layer), 0, top, atmosphere=Atmosphere(light))


@lru_cache(maxsize=4)
def _bonnet_layer(size: tuple[int, int], seed: int) -> tuple[np.ndarray, int]:
    """Premultiplied RGBA image of the bonnet (rows, W, 4), and its first row."""
    width, height = size
    scale = height / 720
    edge = bonnet_outline(size)
    top = int(edge.min() - 8 * scale)
    v = np.arange(top, height)[:, None]
    rng = np.random.default_rng([seed, 31])
    inward = (v - edge) / scale
    colour = _paint(size, inward, rng)
    # The edge is out of focus: a ramp of about three rows.
    cover = smoothstep(-1.6, 1.6, inward)[..., None]
    layer: np.ndarray = np.concatenate([colour * cover, cover], axis=2).astype(np.float32)
    layer = cv2.GaussianBlur(layer, (0, 0), 0.6 * scale, borderType=cv2.BORDER_REPLICATE)
    layer.setflags(write=False)
    return layer, top


def _paint(size: tuple[int, int], inward: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Colour (rows, W, 3): dusty at the edge, with foreshortened reflections of dark trees and flecks below."""
    width = size[0]
    shape = inward.shape
    across = (np.arange(width) / width)[None, :]
    broad = fractal_noise(shape, rng, cell_px=(14, 150), octaves=5, gain=0.6)
    dark = fractal_noise(shape, rng, cell_px=(3.0, 20), octaves=3, gain=0.8)
    flecks = fractal_noise(shape, rng, cell_px=(2.6, 17), octaves=2, gain=0.7)
    grain = fractal_noise(shape, rng, cell_px=(1.6, 3.5), octaves=1)
    # The hump in the middle, between two creases that diverge towards the windscreen.
    run = np.clip(inward / 48, 0, 1) ** 0.7
    left, right = 0.335 - 0.16 * run, 0.70 + 0.19 * run
    hump = smoothstep(-0.006, 0.006, across - left) * smoothstep(-0.012, 0.012, right - across)
    clean = np.clip(hump * smoothstep(4, 30, inward) * 0.75 + 0.22 * broad + 0.12, 0, 1)
    colour = DUSTY_PAINT * (1 - clean[..., None]) + CLEAN_PAINT * clean[..., None]
    # The wings slope outwards and reflect the blue sky.
    wings = np.maximum(smoothstep(0.13, 0.04, across), smoothstep(0.90, 0.97, across)) * smoothstep(26, 8, inward)
    colour += (0.8 * wings)[..., None] * (SKY_IN_PAINT - colour)
    light = 1 + 0.05 * grain - 0.04 * np.clip(dark, -1, 2)
    light += 0.18 * (np.exp(-(((across - left) / 0.006) ** 2)) + 0.6 * np.exp(-(((across - right) / 0.008) ** 2)))
    light -= 0.38 * smoothstep(1.6, 2.5, dark) * smoothstep(3, 9, inward)
    light += 0.55 * smoothstep(2.1, 2.8, flecks) * smoothstep(5, 14, inward)
    # A brighter line where the bonnet curves down and reflects the sky at a grazing angle.
    light += 0.14 * np.exp(-(((inward - 2.5) / 2.5) ** 2))
    return np.clip(colour * light[..., None], 0.005, 1)
