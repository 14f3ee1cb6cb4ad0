"""Sunlight: shades, irradiance of objects, shares of sunlight and skylight on the ground, and glare of a low sun."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from statistics import NormalDist
from typing import Any

import cv2
import numpy as np

from simulator.painting import fade, fractal_noise, smoothstep
from simulator.road.ground import Ground, strip_coverage

# Share of the sun in the light on objects; the rest comes from the sky.
SUN_SHARE = 0.84
# Share of the sky in the light on open ground, from measurements of shaded asphalt.
SKY_SHARE = np.array([0.11, 0.15, 0.22], np.float32)
# Light of an overcast sky on open ground, relative to that of the clear sky without the sun.
OVERCAST_LIGHT = np.array([0.36, 0.38, 0.41], np.float32) / SKY_SHARE
# Outside 1 - r^2 < -CROWN_CUTOFF (r is the distance from the centre in crown radii) there is no shade: noise above five
# standard deviations would be needed.
CROWN_CUTOFF = 3.0
# Height of the deck of a bridge above the road, metres.
CLEARANCE_M = 5.0
# Least skylight below a wide bridge, as a share of open sky: light scattered by walls and the sunny road outside.
BOUNCED_SHARE = 0.4


@dataclass(frozen=True)
class Sun:
    """Position of the sun: azimuth in the world frame (0 along the road's start, > 0 to the left), and elevation.

    An `overcast` sky has no shadows, and its light comes from above.
    """

    azimuth_rad: float
    elevation_rad: float
    overcast: bool = False

    def direction(self, heading_rad: float = 0.0) -> np.ndarray:
        """Unit vector (3,) towards the sun, in a road frame that points along `heading_rad`."""
        if self.overcast:
            return np.array([0.0, 0.0, 1.0])
        angle = self.azimuth_rad - heading_rad
        level = np.cos(self.elevation_rad)
        return np.array([level * np.cos(angle), level * np.sin(angle), np.sin(self.elevation_rad)])


@dataclass(frozen=True)
class TreeShade:
    """Dappled shadow of tree crowns: an elliptical area of the road between lateral `low_m` and `high_m`."""

    start_m: float
    end_m: float
    low_m: float
    high_m: float
    density: float = 0.8

    def sunlight(self, ground: Ground, seed: int) -> np.ndarray:
        """Share of sunlight below a crown: noise with a threshold that depends on the distance from the centre."""
        sides = ((ground.along, self.start_m, self.end_m), (ground.d, self.low_m, self.high_m))
        along, across = ((x - np.float32((low + high) / 2)) * np.float32(2 / (high - low)) for x, low, high in sides)
        middle = 1 - along**2 - across**2
        # No cluster farther out is dense enough to cast a shadow.
        near = np.flatnonzero(middle > -CROWN_CUTOFF)
        part = ground.at(near)
        clusters = part.noise(seed + 31, (0.55, 0.42), octaves=3, fading_m=4.0)
        leaves = part.noise(seed + 32, (0.22, 0.16), fading_m=0.5)
        level = (
            np.float32(1.6) * np.minimum(middle.ravel()[near], 0.8)
            + np.float32(0.75) * clusters
            + np.float32(0.35) * leaves
        )
        share = np.clip((level + np.float32(0.05)) * 2 + np.float32(0.5) - np.float32(0.6), 0, 1)
        sun = np.ones(ground.s.shape, np.float32)
        sun.ravel()[near] -= np.float32(self.density) * share * share * (3 - 2 * share)
        return sun


@dataclass(frozen=True)
class WoodShade:
    """Shade of a dense wood on both sides: blue skylight, and flecks of sun on a share `flecks` of the ground."""

    start_m: float
    end_m: float
    flecks: float = 0.04

    def sunlight(self, ground: Ground, seed: int) -> np.ndarray:
        """Share of sunlight in a wood: sun flecks stretched along the road, and irregular ends of the shade."""
        s = ground.along
        gaps = ground.noise(seed + 41, (1.6, 0.8), octaves=4)
        # Normal noise exceeds this quantile on the share `flecks` of the ground.
        level = np.float32(NormalDist().inv_cdf(1 - self.flecks))
        flecks = np.clip((gaps - level) * 2.5 + 0.5, 0, 1)
        flecks += (1 - fade(ground.footprint_s, 1.6)) * (np.float32(self.flecks) - flecks)
        inside = np.minimum(s - np.float32(self.start_m), np.float32(self.end_m) - s) + np.float32(1.5) * gaps
        closed = np.clip(inside / 2 + 0.5, 0, 1)
        return 1 - closed * (1 - np.float32(0.85) * flecks)


@dataclass(frozen=True)
class BridgeShade:
    """Sharp shadow of a bridge across the whole road, and the skylight blocked by its deck.

    `skew` is ds/dd of its edges.
    """

    start_m: float
    end_m: float
    skew: float = 0.0

    def sunlight(self, ground: Ground, seed: int) -> np.ndarray:
        """Share of sunlight (rows, width): none below the bridge."""
        t = ground.along - np.float32(self.skew) * ground.d
        # The sun is half a degree wide, so the shadow of an edge at 6 m is soft over 6 cm or more.
        soft = np.float32(0.1)
        return 1 - strip_coverage(t, np.abs(ground.s_u) + soft, ground.s_v, self.start_m, self.end_m)

    def blocked_sky(self, t: np.ndarray | np.floating) -> np.ndarray:
        """Share of skylight that an infinite strip overhead blocks, at positions `t` along the road.

        It is half the difference of the sines of the directions to its edges: the view factor of a strip and a
        parallel plate.
        """
        sines = [(edge - t) / np.hypot(edge - t, np.float32(CLEARANCE_M)) for edge in (self.start_m, self.end_m)]
        return (sines[1] - sines[0]).astype(np.float32) / 2


Shade = TreeShade | WoodShade | BridgeShade


def irradiance(normal: np.ndarray, sun: np.ndarray) -> np.ndarray:
    """Irradiance (N, 3) of surfaces with `normal` (N, 3): sun, blue sky above, warm light from the road below.

    The sun is in direction `sun` (3,); white paint that lies in the sun is 1.
    """
    direct = SUN_SHARE * np.clip(normal @ sun, 0, None) / max(float(sun[2]), 0.45)
    up = 0.5 + 0.5 * normal[:, 2]
    sky = (1 - SUN_SHARE) * up[:, None] * np.array([0.80, 0.98, 1.25])
    road = 0.11 * (1 - up)[:, None] * np.array([1.05, 1.0, 0.92])
    return direct[:, None] * np.array([1.02, 1.0, 0.95]) + sky + road


def sunlight_on_ground(shades: tuple[Shade, ...], ground: Ground, *, seed: int) -> np.ndarray:
    """Share of sunlight on the ground of each pixel (rows, width) float32: 1 in the open, 0 in full shade."""
    s = ground.along
    sun = np.ones_like(s)
    for number, shade in enumerate(shades):
        rows = np.flatnonzero(((s > shade.start_m - 12) & (s < shade.end_m + 12)).any(axis=1))
        if not len(rows):
            continue
        cut = slice(rows[0], rows[-1] + 1)
        sun[cut] *= shade.sunlight(ground.rows(cut), seed + number)
    return sun


def sky_on_ground(shades: tuple[Shade, ...], ground: Ground) -> np.ndarray | np.floating:
    """Share of skylight on the ground of each pixel (rows, width) float32; a single 1 without a bridge."""
    share: np.ndarray | np.floating = np.float32(1)
    for shade in (shade for shade in shades if isinstance(shade, BridgeShade)):
        t = ground.along - np.float32(shade.skew) * ground.d
        share = share - shade.blocked_sky(t)
    return np.maximum(share, np.float32(BOUNCED_SHARE))


def sun_along(shades: tuple[Shade, ...], s_m: np.ndarray, d_m: np.ndarray, *, seed: int) -> np.ndarray:
    """Share of sunlight (N,) at road coordinates `s_m`, `d_m` (N,), averaged over the leaves."""
    return sunlight_on_ground(shades, _points(s_m, d_m), seed=seed)[:, 0]


def light_along(shades: tuple[Shade, ...], s_m: np.ndarray, d_m: np.ndarray, *, seed: int) -> np.ndarray:
    """Irradiance (N, 3) relative to open ground at `s_m`, `d_m` (N,), averaged over the leaves."""
    sky = sky_on_ground(shades, _points(s_m, d_m))
    return light_on_ground(sun_along(shades, s_m, d_m, seed=seed)[:, None], sky)[:, 0]


def _points(s_m: np.ndarray, d_m: np.ndarray) -> Ground:
    """Points as ground of one column, with footprints so large that leaves average out."""
    s, d = (np.asarray(x, np.float32)[:, None] for x in (s_m, d_m))
    wide, none = np.full_like(s, 2.0), np.zeros_like(s)
    return Ground(0, 0.0, np.ones(s.shape, bool), s, s, d, s, d, none, wide, wide, none)


def light_on_ground(sun: np.ndarray, sky: np.ndarray | np.floating) -> np.ndarray:
    """Irradiance (rows, width, 3) float32 relative to open ground, from the shares of sunlight and skylight."""
    return cv2.merge([share * sky + sun * (1 - share) for share in SKY_SHARE])


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
    scale: Any = {"fx": 1 / SHEEN_DOWNSAMPLING, "fy": 1 / SHEEN_DOWNSAMPLING, "interpolation": cv2.INTER_AREA}
    x, y = (cv2.resize(a, None, **scale) for a in (ground.x, ground.y))
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
