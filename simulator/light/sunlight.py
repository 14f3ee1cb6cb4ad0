"""Sunlight: shades, irradiance of objects, light on the ground, glare of a low sun."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from statistics import NormalDist

import cv2
import numpy as np

from simulator.painting import fade, fractal_noise, smoothstep, three_channels
from simulator.road.ground import Ground, strip_coverage

# Share of the sun in the light on objects; the rest comes from the sky.
SUN_SHARE = 0.84
# Light on objects, linear RGB: sun, blue sky above, warm road below.
OBJECT_SUN = np.array([1.02, 1.0, 0.95])
OBJECT_SKY = np.array([0.80, 0.98, 1.25])
OBJECT_ROAD = np.array([1.05, 1.0, 0.92])
# Share of the sky in the light on open ground, from measurements of shaded asphalt.
SKY_SHARE = np.array([0.11, 0.15, 0.22], np.float32)
# Light of an overcast sky on open ground, relative to that of the clear sky without the
# sun.
OVERCAST_LIGHT = np.array([0.36, 0.38, 0.41], np.float32) / SKY_SHARE
# Outside 1 - r^2 < -CROWN_CUTOFF (r is the distance from the centre in crown radii)
# there is no shade: noise above five standard deviations would be needed.
CROWN_CUTOFF = 3.0
# Height of the deck of a bridge above the road, metres.
CLEARANCE_M = 5.0
# The sun is half a degree wide, so the shadow of an edge at 6 m is soft over 6 cm or
# more.
BRIDGE_SOFT_M = 0.1
# Least skylight below a wide bridge, as a share of open sky: light scattered by walls
# and the sunny road outside.
BOUNCED_SHARE = 0.4
# Shades matter up to this distance before and after them.
SHADE_MARGIN_M = 12
# Footprint so large that leaves average out.
WIDE_FOOTPRINT_M = 2.0


@dataclass(frozen=True)
class Sun:
    """Position of the sun: azimuth in the world frame, and elevation.

    The azimuth is 0 along the road's start, > 0 to the left. An `overcast` sky has no
    shadows, and its light comes from above.
    """

    azimuth_rad: float
    elevation_rad: float
    overcast: bool = False

    def direction(self, heading_rad: float = 0.0) -> np.ndarray:
        """Unit vector (3,) towards the sun, in a road frame along `heading_rad`."""
        if self.overcast:
            return np.array([0.0, 0.0, 1.0])
        angle = self.azimuth_rad - heading_rad
        level = np.cos(self.elevation_rad)
        up = np.sin(self.elevation_rad)
        forward = level * np.cos(angle)
        left = level * np.sin(angle)
        return np.array([forward, left, up])


@dataclass(frozen=True)
class TreeShade:
    """Dappled shadow of tree crowns: an elliptical area of the road.

    It is between lateral `low_m` and `high_m`.
    """

    start_m: float
    end_m: float
    low_m: float
    high_m: float
    density: float

    def sunlight(self, ground: Ground, seed: int) -> np.ndarray:
        """Share of sunlight (rows, width) below a crown.

        It is noise with a threshold that depends on the distance from the centre.
        """
        along = _relative(ground.along, self.start_m, self.end_m)
        across = _relative(ground.d, self.low_m, self.high_m)
        inward = 1 - along**2 - across**2
        # No cluster farther out is dense enough to cast a shadow.
        near = np.flatnonzero(inward > -CROWN_CUTOFF)
        part = ground.at(near)
        clusters = part.noise(seed + 31, (0.55, 0.42), octaves=3, fading_m=4.0)
        leaves = part.noise(seed + 32, (0.22, 0.16), fading_m=0.5)

        middle = np.minimum(inward.ravel()[near], 0.8)
        level = 1.6 * middle + 0.75 * clusters + 0.35 * leaves
        t = np.clip((level + 0.05) * 2 + 0.5 - 0.6, 0, 1)
        sun = np.ones(ground.s.shape, np.float32)
        sun.ravel()[near] -= np.float32(self.density) * t * t * (3 - 2 * t)
        return sun


def _relative(
    place: np.ndarray,
    low: float,
    high: float,
) -> np.ndarray:
    """Position in an interval, -1 at `low` and 1 at `high`."""
    middle = np.float32((low + high) / 2)
    return (place - middle) * np.float32(2 / (high - low))


@dataclass(frozen=True)
class WoodShade:
    """Shade of a dense wood on both sides: blue skylight, and flecks of sun.

    The flecks are on a share `flecks` of the ground.
    """

    start_m: float
    end_m: float
    flecks: float

    def sunlight(self, ground: Ground, seed: int) -> np.ndarray:
        """Share of sunlight (rows, width) in a wood.

        Sun flecks are stretched along the road, and the ends of the shade irregular.
        """
        gaps = ground.noise(seed + 41, (1.6, 0.8), octaves=4)
        # Normal noise exceeds this quantile on the share `flecks` of the ground.
        level = np.float32(NormalDist().inv_cdf(1 - self.flecks))
        flecks = np.clip((gaps - level) * 2.5 + 0.5, 0, 1)
        averaged = 1 - fade(ground.footprint_s, 1.6)
        flecks += averaged * (np.float32(self.flecks) - flecks)

        from_start = ground.along - np.float32(self.start_m)
        to_end = np.float32(self.end_m) - ground.along
        inside = np.minimum(from_start, to_end) + 1.5 * gaps
        closed = np.clip(inside / 2 + 0.5, 0, 1)
        return 1 - closed * (1 - 0.85 * flecks)


@dataclass(frozen=True)
class BridgeShade:
    """Sharp shadow of a bridge across the whole road, and the skylight it blocks.

    `skew` is ds/dd of its edges.
    """

    start_m: float
    end_m: float
    skew: float = 0.0

    def place(self, ground: Ground) -> np.ndarray:
        """Positions along the road, relative to the skewed edges."""
        return ground.along - np.float32(self.skew) * ground.d

    def sunlight(self, ground: Ground, seed: int) -> np.ndarray:
        """Share of sunlight (rows, width): none below the bridge."""
        step_u = np.abs(ground.s_u) + BRIDGE_SOFT_M
        place = self.place(ground)
        return 1 - strip_coverage(place, step_u, ground.s_v, self.start_m, self.end_m)

    def blocked_sky(self, t: np.ndarray | np.floating) -> np.ndarray:
        """Share of skylight that an infinite strip overhead blocks.

        `t` are positions along the road. It is half the difference of the sines of the
        directions to the strip's edges: the view factor of a strip and a parallel
        plate.
        """
        to_start = self.start_m - t
        to_end = self.end_m - t
        start_sine = to_start / np.hypot(to_start, CLEARANCE_M)
        end_sine = to_end / np.hypot(to_end, CLEARANCE_M)
        return (end_sine - start_sine).astype(np.float32) / 2


Shade = TreeShade | WoodShade | BridgeShade


def irradiance(
    normal: np.ndarray,
    sun: np.ndarray,
) -> np.ndarray:
    """Irradiance (N, 3) of surfaces with `normal` (N, 3): sun, sky and road.

    The sun is in direction `sun` (3,); white paint that lies in the sun is 1.
    """
    facing = np.clip(normal @ sun, 0, None)
    direct = SUN_SHARE * facing / max(float(sun[2]), 0.45)
    up = 0.5 + 0.5 * normal[:, 2]
    sky = (1 - SUN_SHARE) * up[:, None] * OBJECT_SKY
    road = 0.11 * (1 - up)[:, None] * OBJECT_ROAD
    return direct[:, None] * OBJECT_SUN + sky + road


def sunlight_on_ground(
    shades: tuple[Shade, ...], ground: Ground, *, seed: int
) -> np.ndarray:
    """Share of sunlight on the ground of each pixel (rows, width) float32.

    It is 1 in the open, 0 in full shade.
    """
    s = ground.along
    sun = np.ones_like(s)
    for number, shade in enumerate(shades):
        after_start = s > shade.start_m - SHADE_MARGIN_M
        before_end = s < shade.end_m + SHADE_MARGIN_M
        rows = np.flatnonzero((after_start & before_end).any(axis=1))
        if len(rows):
            cut = slice(rows[0], rows[-1] + 1)
            sun[cut] *= shade.sunlight(ground.rows(cut), seed + number)
    return sun


def sky_on_ground(
    shades: tuple[Shade, ...], ground: Ground
) -> np.ndarray | np.floating:
    """Share of skylight on the ground of each pixel (rows, width) float32.

    It is a single 1 without a bridge.
    """
    share: np.ndarray | np.floating = np.float32(1)
    for shade in shades:
        if isinstance(shade, BridgeShade):
            share = share - shade.blocked_sky(shade.place(ground))
    return np.maximum(share, BOUNCED_SHARE)


def sun_along(
    shades: tuple[Shade, ...],
    s_m: np.ndarray,
    d_m: np.ndarray,
    *,
    seed: int,
) -> np.ndarray:
    """Share of sunlight (N,) at road coordinates (N,), averaged over the leaves."""
    return sunlight_on_ground(shades, _points(s_m, d_m), seed=seed)[:, 0]


def light_along(
    shades: tuple[Shade, ...],
    s_m: np.ndarray,
    d_m: np.ndarray,
    *,
    seed: int,
) -> np.ndarray:
    """Irradiance (N, 3) relative to open ground at road coordinates (N,).

    It is averaged over the leaves.
    """
    points = _points(s_m, d_m)
    sun = sunlight_on_ground(shades, points, seed=seed)
    return light_on_ground(sun, sky_on_ground(shades, points))[:, 0]


def _points(s_m: np.ndarray, d_m: np.ndarray) -> Ground:
    """Points as ground of one column, with wide footprints."""
    s = np.asarray(s_m, np.float32)[:, None]
    d = np.asarray(d_m, np.float32)[:, None]
    wide = np.full_like(s, WIDE_FOOTPRINT_M)
    none = np.zeros_like(s)
    return Ground(
        top=0,
        station_m=0.0,
        visible=np.ones(s.shape, bool),
        distance=s,
        x=s,
        y=d,
        s=s,
        d=d,
        s_u=none,
        s_v=wide,
        d_u=wide,
        d_v=none,
    )


def light_on_ground(
    sun: np.ndarray,
    sky: np.ndarray | np.floating,
) -> np.ndarray:
    """Irradiance (rows, width, 3) float32 relative to open ground.

    `sun` and `sky` are the shares of sunlight and skylight.
    """
    return cv2.merge([share * sky + sun * (1 - share) for share in SKY_SHARE])


SUN_COLOUR = np.array([1.0, 0.93, 0.80], np.float32)
# The veil is computed on every 8th pixel, sheen and disc of the sun on every 4th.
VEIL_DOWNSAMPLING = 8
SHEEN_DOWNSAMPLING = 4
# The RMS slope of worn asphalt.
ASPHALT_ROUGHNESS = 0.25


@dataclass(frozen=True)
class Glare:
    """Strengths of the glare; 0 switches a part off, 1 is a dirty windscreen.

    `veil` is light scattered by dirt on the windscreen and in the lens, strongest
    around the sun. `sheen` is the specular reflection of the road below the sun,
    `dashboard` that of the sunny dashboard in the windscreen, over the lower half of
    the image.
    """

    veil: float
    sheen: float = 0.6
    dashboard: float = 0.0


def add_sheen(
    light: np.ndarray,
    ground: Ground,
    sun: np.ndarray,
    sun_direction: np.ndarray,
    *,
    strength: float,
    height_m: float,
) -> None:
    """Add the specular reflection of the sun on the road to the light, in place.

    `light` (rows, width, 3) is that of the ground, `sun` (rows, width) the share of
    sunlight. `sun_direction` (3,) points towards the sun in the road frame, `height_m`
    is that of the camera. Beckmann microfacet distribution with Schlick's approximation
    of the Fresnel term.
    """
    x = _downsample(ground.x)
    y = _downsample(ground.y)
    up = np.full_like(x, height_m)
    to_eye: np.ndarray = np.stack([-x, -y, up], axis=-1)
    to_eye /= np.linalg.norm(to_eye, axis=-1, keepdims=True)
    half: np.ndarray = to_eye + sun_direction.astype(np.float32)
    half /= np.linalg.norm(half, axis=-1, keepdims=True)

    tilt2 = 1 / np.maximum(half[..., 2], 0.05) ** 2 - 1
    fresnel = 0.04 + 0.96 * (1 - (half * to_eye).sum(axis=-1)) ** 5
    slopes = np.exp(-tilt2 / ASPHALT_ROUGHNESS**2)
    sheen = np.float32(strength) * fresnel * slopes
    size = (light.shape[1], light.shape[0])
    sheen = cv2.resize(sheen, size, interpolation=cv2.INTER_LINEAR) * sun

    # Brighter stones and paint are smoother.
    sheen *= 0.8 + np.minimum(light[..., 1], 1) * 0.4
    # cv2.merge, because numpy is slow where the innermost axis has three elements.
    light += cv2.merge([sheen * channel for channel in SUN_COLOUR])


def _downsample(plane: np.ndarray) -> np.ndarray:
    scale = 1 / SHEEN_DOWNSAMPLING
    return cv2.resize(plane, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)


def add_glare(
    light: np.ndarray,
    rays: np.ndarray,
    sun_ray: np.ndarray,
    glare: Glare,
    *,
    sunshine: float,
) -> None:
    """Add veil, disc of the sun and dashboard reflection to the light, in place.

    `light` and `rays` are (height, width, 3). `rays` are those of `ground.pixel_rays`,
    `sun_ray` (3,) points towards the sun, both in camera axes; `sunshine` is the share
    of sunlight on the windscreen, 0 in the shade.
    """
    if sunshine <= 0:
        return
    height, width = light.shape[:2]
    coarse_rays = rays[::VEIL_DOWNSAMPLING, ::VEIL_DOWNSAMPLING]
    veil = _veil(coarse_rays, sun_ray, glare.veil)
    added: np.ndarray = cv2.resize(veil, (width, height))
    if glare.veil:
        added *= _dirt(height, width)
    if sun_ray[2] > 0.3:
        disc = _sun_disc(rays[::SHEEN_DOWNSAMPLING, ::SHEEN_DOWNSAMPLING], sun_ray)
        added += cv2.resize(disc, (width, height))
    if glare.dashboard:
        cv2.scaleAdd(_dashboard(height, width), glare.dashboard, added, dst=added)
    cv2.scaleAdd(added, sunshine, light, dst=light)


def _veil(
    rays: np.ndarray,
    sun_ray: np.ndarray,
    strength: float,
) -> np.ndarray:
    """Veiling light (rows, columns, 3).

    Inverse square of the angle to the sun (Stiles-Holladay), plus a constant.
    """
    length = np.linalg.norm(rays, axis=-1)
    cosine = (rays @ sun_ray.astype(np.float32)) / length
    angle2 = np.arccos(np.clip(cosine, -1, 1)) ** 2
    scattered = 0.04 + 0.012 / (angle2 + 0.003) + 2.0 * np.exp(-angle2 / 0.0012)
    veil = np.float32(strength) * scattered
    return veil[..., None] * SUN_COLOUR


def _sun_disc(
    rays: np.ndarray,
    sun_ray: np.ndarray,
) -> np.ndarray:
    """Overexposed disc of the sun (rows, columns, 3)."""
    centre = (sun_ray[:2] / sun_ray[2]).astype(np.float32)
    off = rays[..., :2] / rays[..., 2:] - centre
    distance2 = (off * off).sum(axis=-1)
    disc = 6.0 * np.exp(-distance2 / 0.014**2)
    return disc[..., None] * SUN_COLOUR


@lru_cache(maxsize=2)
def _dirt(height: int, width: int) -> np.ndarray:
    """Relative scattering of a dirty windscreen (height, width, 3), about 1.

    It has wiper smears and specks.
    """
    rng = np.random.default_rng(71)
    shape = (height, width)
    smear_px = (0.9 * height, 0.12 * width)
    smears = fractal_noise(shape, rng, cell_px=smear_px, octaves=4, gain=0.6)
    specks = fractal_noise(shape, rng, cell_px=(5, 5), octaves=2)
    dirt = 1 + 0.12 * smears + 0.7 * smoothstep(2.6, 3.6, specks)
    return three_channels(np.clip(dirt, 0.5, 2).astype(np.float32))


@lru_cache(maxsize=2)
def _dashboard(height: int, width: int) -> np.ndarray:
    """Reflected dashboard (height, width, 3), out of focus.

    Grained plastic with a fold along its far edge.
    """
    rng = np.random.default_rng(72)
    shape = (height, width)
    grain = fractal_noise(shape, rng, cell_px=(3, 12), octaves=2)
    cloth_px = (0.2 * height, 0.4 * width)
    cloth = fractal_noise(shape, rng, cell_px=cloth_px, octaves=4)

    # Shares of the image's height and width.
    u = np.arange(width) / width
    v = np.arange(height)[:, None] / height
    edge = 0.66 + 0.05 * (u - 0.4) ** 2
    below = smoothstep(-0.012, 0.012, v - edge)
    fold = np.exp(-(((v - edge - 0.12) / 0.006) ** 2))
    fold += 0.7 * np.exp(-(((v - edge) / 0.008) ** 2))

    tone = (0.10 + 0.14 * below) * (1 + 0.10 * cloth)
    tone = tone + below * (0.022 * grain + 0.05 * fold)
    side = 1 - 0.75 * smoothstep(0.25, 0.85, u)
    sharp = (tone * side).astype(np.float32)
    layer = cv2.GaussianBlur(sharp, (0, 0), height / 720)
    return layer[..., None] * np.array([0.94, 0.97, 1.06], np.float32)
