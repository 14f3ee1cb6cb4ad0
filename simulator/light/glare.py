"""Glare of a low sun ahead: veiling light in the windscreen, and specular reflection of the road."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from simulator.painting.noise import fractal_noise, smoothstep
from simulator.road.ground import Ground

SUN_COLOUR = np.array([1.0, 0.93, 0.80], np.float32)
# The veil is computed on every 8th pixel, sheen and disc of the sun on every 4th.
VEIL_DOWNSAMPLING, SHEEN_DOWNSAMPLING = 8, 4


@dataclass(frozen=True)
class Glare:
    """Strengths of the glare; 0 switches a part off, 1 is a dirty windscreen.

    `veil` is light scattered by dirt on the windscreen and in the lens, strongest around the sun. `sheen` is the
    specular reflection of the road below the sun, `dashboard` that of the sunny dashboard in the windscreen, over the
    lower half of the image.
    """

    veil: float = 1.0
    sheen: float = 0.6
    dashboard: float = 0.0


def add_sheen(light: np.ndarray, ground: Ground, sun: np.ndarray, sun_direction: np.ndarray, *, strength: float,
              height_m: float) -> None:  # fmt: skip
    """Add the specular reflection of the sun on the road to the light (rows, width, 3) of the ground, in place.

    `sun` (rows, width) is the share of sunlight, `sun_direction` (3,) points towards the sun in the road frame,
    `height_m` is that of the camera. Beckmann microfacet distribution with Schlick's approximation of the Fresnel term.
    """
    x, y = (
        cv2.resize(a, None, fx=1 / SHEEN_DOWNSAMPLING, fy=1 / SHEEN_DOWNSAMPLING, interpolation=cv2.INTER_AREA)
        for a in (ground.x, ground.y)
    )
    to_eye: np.ndarray = np.stack([-x, -y, np.full_like(x, height_m)], axis=-1)
    to_eye /= np.linalg.norm(to_eye, axis=-1, keepdims=True)
    half: np.ndarray = to_eye + sun_direction.astype(np.float32)
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    tilt2 = 1 / np.maximum(half[..., 2], np.float32(0.05)) ** 2 - 1
    mirrored = 0.04 + 0.96 * (1 - (half * to_eye).sum(axis=-1)) ** 5
    # The RMS slope of worn asphalt is 0.25.
    sheen = np.float32(strength) * mirrored * np.exp(-tilt2 / np.float32(0.25**2))
    sheen = cv2.resize(sheen, (light.shape[1], light.shape[0]), interpolation=cv2.INTER_LINEAR) * sun
    # Brighter stones and paint are smoother.
    sheen *= 0.8 + np.minimum(light[..., 1], 1) * np.float32(0.4)
    # cv2.merge, because numpy is slow where the innermost axis has three elements.
    light += cv2.merge([sheen * c for c in SUN_COLOUR])


def add_glare(light: np.ndarray, rays: np.ndarray, sun_ray: np.ndarray, glare: Glare, *, sunshine: float) -> None:
    """Add veil, disc of the sun and dashboard reflection to the light (height, width, 3), in place.

    `rays` (height, width, 3) are those of `ground.pixel_rays`, `sun_ray` (3,) points towards the sun, both in camera
    axes; `sunshine` is the share of sunlight on the windscreen, 0 in the shade.
    """
    if sunshine <= 0:
        return
    height, width = light.shape[:2]
    veil = _veil(rays[::VEIL_DOWNSAMPLING, ::VEIL_DOWNSAMPLING], sun_ray, glare.veil)
    added: np.ndarray = cv2.resize(veil, (width, height))
    if glare.veil:
        added *= _dirt(height, width)
    if sun_ray[2] > 0.3:
        disc = _sun_disc(rays[::SHEEN_DOWNSAMPLING, ::SHEEN_DOWNSAMPLING], sun_ray)
        added += cv2.resize(disc, (width, height))
    if glare.dashboard:
        cv2.scaleAdd(_dashboard(height, width), glare.dashboard, added, dst=added)
    cv2.scaleAdd(added, sunshine, light, dst=light)


def _veil(rays: np.ndarray, sun_ray: np.ndarray, strength: float) -> np.ndarray:
    """Veiling light (rows, columns, 3): inverse square of the angle to the sun (Stiles-Holladay), plus a constant."""
    cosine = (rays @ sun_ray.astype(np.float32)) / np.linalg.norm(rays, axis=-1)
    angle2 = np.arccos(np.clip(cosine, -1, 1)) ** 2
    veil = np.float32(strength) * (0.04 + 0.012 / (angle2 + 0.003) + 2.0 * np.exp(-angle2 / 0.0012))
    return veil[..., None].astype(np.float32) * SUN_COLOUR


def _sun_disc(rays: np.ndarray, sun_ray: np.ndarray) -> np.ndarray:
    """Overexposed disc of the sun (rows, columns, 3)."""
    off = rays[..., :2] / rays[..., 2:] - (sun_ray[:2] / sun_ray[2]).astype(np.float32)
    disc = 6.0 * np.exp(-(off * off).sum(axis=-1) / np.float32(0.014**2))
    return disc[..., None] * SUN_COLOUR


@lru_cache(maxsize=2)
def _dirt(height: int, width: int) -> np.ndarray:
    """Relative scattering of a dirty windscreen (height, width, 3), about 1: wiper smears and specks."""
    rng = np.random.default_rng(71)
    smears = fractal_noise((height, width), rng, cell_px=(0.9 * height, 0.12 * width), octaves=4, gain=0.6)
    specks = fractal_noise((height, width), rng, cell_px=(5, 5), octaves=2)
    dirt = 1 + 0.12 * smears + 0.7 * smoothstep(2.6, 3.6, specks)
    return cv2.merge([np.clip(dirt, 0.5, 2).astype(np.float32)] * 3)


@lru_cache(maxsize=2)
def _dashboard(height: int, width: int) -> np.ndarray:
    """Reflected dashboard (height, width, 3), out of focus: grained plastic with a fold along its far edge."""
    rng = np.random.default_rng(72)
    v, u = np.mgrid[:height, :width] / np.array([height, width]).reshape(2, 1, 1)
    edge = 0.66 + 0.05 * (u - 0.4) ** 2
    grain = fractal_noise((height, width), rng, cell_px=(3, 12), octaves=2)
    cloth = fractal_noise((height, width), rng, cell_px=(0.2 * height, 0.4 * width), octaves=4)
    below = smoothstep(-0.012, 0.012, v - edge)
    fold = np.exp(-(((v - edge - 0.12) / 0.006) ** 2)) + 0.7 * np.exp(-(((v - edge) / 0.008) ** 2))
    tone = (0.10 + 0.14 * below) * (1 + 0.10 * cloth) + below * (0.022 * grain + 0.05 * fold)
    side = 1 - 0.75 * smoothstep(0.25, 0.85, u)
    layer = cv2.GaussianBlur((tone * side).astype(np.float32), (0, 0), height / 720)
    return layer[..., None] * np.array([0.94, 0.97, 1.06], np.float32)
