"""Backdrop: sky, clouds, hills and woods, painted once as a panorama.

The backdrop is at infinity: it moves in the image when the car turns, not when it drives. Directions are unit vectors
in the world frame (x along the start of the road, y left, z up). The panorama is an equal-area cylindrical projection:
columns are azimuths, rows are z components of the direction. A lookup therefore costs one arc tangent and one remap.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from lanes.images import opencv_threads
from simulator.disk_cache import cached_array, short_hash
from simulator.landscape import foliage
from simulator.landscape.foliage import SUN_IN_SPRITE, plant_sprites, sprite_level
from simulator.painting import noise
from simulator.painting.brush import Atmosphere, split_channels
from simulator.painting.noise import fractal_noise, fractal_profile, smoothstep

# 1304 px/rad, a little finer than the 1160 px/rad of a 63 degree wide image of 1280 columns.
PANORAMA_COLUMNS = 8192
PIXELS_PER_RAD = PANORAMA_COLUMNS / (2 * np.pi)
Z_TOP, Z_BOTTOM = 0.64, -0.06
PANORAMA_ROWS = round((Z_TOP - Z_BOTTOM) * PIXELS_PER_RAD)
HORIZON_ROW = Z_TOP * PIXELS_PER_RAD

# Linear RGB radiance of a dry summer sky (sunlit white paint is 1): at the zenith, the addition at the horizon, and its
# decay with z. Red decays fastest, so the sky is blue above.
ZENITH = np.array([0.020, 0.120, 0.380], np.float32)
HORIZON_GLOW = np.array([0.43, 0.47, 0.32], np.float32)
GLOW_FALL = np.array([5.0, 3.1, 1.9], np.float32)
# Airlight of infinite distance: the sky just above the horizon, a little darker and bluer.
HAZE_COLOUR = (ZENITH + HORIZON_GLOW) * np.array([0.62, 0.72, 0.90], np.float32)
# Panoramas in the disk cache. Each scene has its own one, so only those of the current drives are reused.
MAX_CACHED = 3
HILL_GRASS = np.array([0.40, 0.265, 0.135], np.float32)
DRY_SOIL = np.array([0.26, 0.175, 0.105], np.float32)
HILL_GREEN_GRASS = np.array([0.17, 0.20, 0.055], np.float32)
CHAPARRAL = np.array([0.050, 0.050, 0.022], np.float32)
FOREST_SUN = np.array([0.075, 0.080, 0.035], np.float32)
FOREST_SHADE = np.array([0.012, 0.017, 0.012], np.float32)


@dataclass(frozen=True)
class BackdropStyle:
    """Style of sky and landscape.

    `cloud_cover` is the share of the sky covered by cumulus clouds. `hill_height_rad` and `ridge_height_rad` are
    typical elevations of the near hills and of the far wooded ridge. `greenness` is the colour of the grass from dry
    gold (0) to spring green (1), `tree_density` that of the woods from bare (0) to closed (1). `haze_per_km` is the
    extinction of the air; 0.06 is a clear day, 0.4 a hazy one. The sun's position is in the world frame (azimuth > 0 is
    left of the road's first heading).
    """

    cloud_cover: float = 0.0
    hill_height_rad: float = 0.060
    ridge_height_rad: float = 0.062
    greenness: float = 0.0
    tree_density: float = 0.5
    haze_per_km: float = 0.06
    sun_azimuth_rad: float = 0.9
    sun_elevation_rad: float = 0.9

    def sun_direction(self) -> np.ndarray:
        """Unit vector (3,) towards the sun in the world frame."""
        level = np.cos(self.sun_elevation_rad)
        x, y = level * np.cos(self.sun_azimuth_rad), level * np.sin(self.sun_azimuth_rad)
        return np.array([x, y, np.sin(self.sun_elevation_rad)])


def aerial_perspective(distance_m: np.ndarray | float, haze_per_km: float) -> Atmosphere:
    """Attenuation and airlight for objects at distances of any shape; both get one more axis (3,) for RGB.

    `haze_per_km` is the extinction in 1/km. Koschmieder's law of contrast; blue is scattered most.
    """
    extinction = haze_per_km / 1000 * np.array([0.8, 1.0, 1.3], np.float32)
    transmittance = np.exp(-np.multiply.outer(np.asarray(distance_m, np.float32), extinction))
    return Atmosphere(transmittance, HAZE_COLOUR * (1 - transmittance))


def column_azimuths() -> np.ndarray:
    """Azimuth in radians of each column of the panorama."""
    return (np.arange(PANORAMA_COLUMNS, dtype=np.float32) + 0.5) / np.float32(PIXELS_PER_RAD)


def row_z() -> np.ndarray:
    """z component of the direction of each row of the panorama."""
    return (Z_TOP - (np.arange(PANORAMA_ROWS, dtype=np.float32) + 0.5) / PIXELS_PER_RAD).astype(np.float32)


def paint_sky(style: BackdropStyle) -> np.ndarray:
    """Clear sky (PANORAMA_ROWS, PANORAMA_COLUMNS, 3): vertical gradient, and the brightening towards the sun."""
    coarse = 4
    z = cv2.resize(row_z()[:, None], (1, PANORAMA_ROWS // coarse), interpolation=cv2.INTER_AREA).ravel()
    azimuth = column_azimuths().reshape(-1, coarse).mean(axis=1)
    gradient = ZENITH + HORIZON_GLOW * np.exp(-GLOW_FALL * np.maximum(z, 0)[:, None])
    sun = style.sun_direction().astype(np.float32)
    facing = np.cos(azimuth - style.sun_azimuth_rad) * np.hypot(sun[0], sun[1])
    away = 1 - (np.sqrt(1 - z * z)[:, None] * facing[None, :] + z[:, None] * sun[2])[..., None]
    # Aureole (forward scattering), weak brightening of the sun's side, and haze that whitens both.
    glow = 0.30 * np.exp(-away / 0.05) + (0.05 + 0.35 * style.haze_per_km) * np.exp(-away / 0.5)
    sky = gradient[:, None, :] * (1.06 - 0.06 * away) + glow * np.array([0.85, 0.97, 1.0], np.float32)
    return cv2.resize(sky.astype(np.float32), (PANORAMA_COLUMNS, PANORAMA_ROWS), interpolation=cv2.INTER_LINEAR)


def paint_clouds(panorama: np.ndarray, style: BackdropStyle, rng: np.random.Generator) -> None:
    """Paint cumulus clouds into a panorama (3, PANORAMA_ROWS, PANORAMA_COLUMNS), in place.

    The clouds are noise on a flat layer in perspective, so they get smaller towards the horizon.
    """
    size, coarse = 2048, 2
    noise = fractal_noise((size, size), rng, cell_px=(420, 420), octaves=8, gain=0.55)
    rows = int(HORIZON_ROW) // coarse
    z = np.maximum(row_z()[: rows * coarse : coarse], 0.004)[:, None]
    # The exponent is 1 for thin clouds; a smaller one gives them the height of cumulus.
    reach = 330 * np.sqrt(1 - z * z) / (z + 0.06) ** 0.55
    azimuth = column_azimuths()[::coarse]
    map_x = (reach * np.cos(azimuth) + size / 2).astype(np.float32)
    map_y = (reach * np.sin(azimuth) + size / 2).astype(np.float32)
    density = cv2.remap(noise, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    # Tops, with less cloud above them, are lit. Bases are grey.
    lit = density - np.roll(cv2.GaussianBlur(density, (0, 0), 5), 12, axis=0)
    edge = np.float32(np.quantile(density[::8, ::8], 1 - style.cloud_cover))
    cover = smoothstep(edge - 0.08, edge + 0.40, density)
    thick = smoothstep(edge + 0.1, edge + 1.7, cv2.GaussianBlur(density, (0, 0), 3))
    brightness = np.clip(0.84 - 0.46 * thick + 0.22 * lit, 0.26, 1.05)
    cover *= np.exp(-0.012 / z)
    size_px = (PANORAMA_COLUMNS, rows * coarse)
    clear = 1 - cv2.resize(cover, size_px, interpolation=cv2.INTER_LINEAR)
    for plane, bright, dark in zip(panorama[:, : rows * coarse], (1.0, 1.0, 1.01), (0.03, 0.05, 0.09), strict=True):
        colour = brightness * np.float32(bright) + (1 - brightness) * np.float32(dark)
        plane *= clear
        plane += cv2.resize(colour * cover, size_px, interpolation=cv2.INTER_LINEAR)


def paint_backdrop(directions: Sequence[np.ndarray], style: BackdropStyle, *, seed: int = 0) -> np.ndarray:
    """Radiance (H, W, 3) of the backdrop in each direction, linear float32 RGB; 1 is white paint in the sun.

    `directions` are x, y and z (H, W) float32 of unit vectors in the world frame, already turned by the car's heading.
    Each seed gives another landscape of the same style.
    """
    x, y, z = directions
    # cv2.phase is 0 to 2 pi. The panorama is padded by a column on each side, so that it wraps.
    column = cv2.phase(x, y) * np.float32(PIXELS_PER_RAD) + np.float32(0.5)
    row = (np.float32(Z_TOP) - z) * np.float32(PIXELS_PER_RAD) - np.float32(0.5)
    return cv2.remap(panorama(style, seed), column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def _veil(colour: np.ndarray, distance_km: np.ndarray | float, style: BackdropStyle) -> np.ndarray:
    transmittance, airlight = aerial_perspective(np.asarray(distance_km) * 1000, style.haze_per_km)
    return colour * transmittance + airlight


@lru_cache(maxsize=3)
def panorama(style: BackdropStyle, seed: int) -> np.ndarray:
    """Panorama (PANORAMA_ROWS, PANORAMA_COLUMNS + 2, 3), float32, 90 MB; row 0 is at Z_TOP, column 1 at azimuth 0."""
    sources = [Path(source) for source in (__file__, foliage.__file__, noise.__file__)]
    name = f"panoramas/{short_hash(style, seed)}"
    return cached_array(name, sources, lambda: _paint_panorama(style, seed), max_files=MAX_CACHED)


@opencv_threads(-1)
def _paint_panorama(style: BackdropStyle, seed: int) -> np.ndarray:
    rng = np.random.default_rng([seed, 20])
    # Separate planes, because numpy is slow where the innermost axis has three elements.
    panorama = split_channels(paint_sky(style))
    if style.cloud_cover > 0:
        paint_clouds(panorama, style, np.random.default_rng([seed, 21]))
    _paint_plain(panorama, style, rng)
    _paint_ridge(panorama, style, rng)
    for distance_km, share in ((4.0, 0.62), (1.6, 0.75), (0.7, 1.0)):
        _paint_hills(panorama, style, rng, distance_km=distance_km, height_rad=share * style.hill_height_rad)
    _paint_woods(panorama, style, rng)
    wrapped = np.empty((PANORAMA_ROWS, PANORAMA_COLUMNS + 2, 3), np.float32)
    cv2.merge(list(panorama), wrapped[:, 1:-1])
    wrapped[:, 0], wrapped[:, -1] = wrapped[:, -2], wrapped[:, 1]
    return wrapped


def _paint_plain(panorama: np.ndarray, style: BackdropStyle, rng: np.random.Generator) -> None:
    """Paint the plain below the horizon: fields that get finer and hazier with distance."""
    first = int(HORIZON_ROW)
    z = np.minimum(row_z()[first:], -2e-4)
    noise = fractal_noise((len(z), PANORAMA_COLUMNS), rng, cell_px=(14, 220), octaves=6, gain=0.6)
    share = smoothstep(-0.6, 1.4, noise)
    distance_km = np.minimum(1.4e-3 / -z, 6.0)
    transmittance, airlight = np.moveaxis(
        np.array(aerial_perspective(distance_km[:, None] * 1000, style.haze_per_km)), -1, 1
    )
    for plane, grass, scrub, factor, offset in zip(
        panorama, _grass(style), CHAPARRAL * 1.6, transmittance, airlight, strict=True
    ):
        plane[first:] = (grass * (1 - share) + scrub * share) * factor + offset


def _grass(style: BackdropStyle) -> np.ndarray:
    return HILL_GRASS + (HILL_GREEN_GRASS - HILL_GRASS) * style.greenness


def _skyline(rng: np.random.Generator, height_rad: float, *, cell_rad: float, roughness: float) -> np.ndarray:
    """Skyline of broad hills: z (PANORAMA_COLUMNS,), partly below the horizon."""
    profile = fractal_profile(PANORAMA_COLUMNS, rng, cell_px=cell_rad * PIXELS_PER_RAD, octaves=9, gain=roughness)
    return height_rad * np.clip(0.62 + 0.42 * profile, -0.3, 1.6)


def _paint_slope(
    panorama: np.ndarray,
    rows: slice,
    colours: Iterable[np.ndarray],
    skyline: np.ndarray,
    distance_km: float,
    style: BackdropStyle,
) -> None:
    """Paint a slope, seen through the air, over some rows of the panorama below `skyline`.

    The edge is anti-aliased over one pixel. The colour planes are overwritten.
    """
    air = aerial_perspective(np.asarray(distance_km) * 1000, style.haze_per_km)
    alpha = np.clip((skyline[None, :] - row_z()[rows, None]) * PIXELS_PER_RAD + 0.5, 0, 1)
    for plane, colour, factor, offset in zip(panorama[:, rows], colours, *map(np.asarray, air), strict=True):
        colour *= factor
        colour += offset
        _blend(plane, colour, alpha)


def _band(skyline: np.ndarray) -> tuple[int, int]:
    """First and last row of a ridge, down to the horizon."""
    return max(0, int(HORIZON_ROW - skyline.max() * PIXELS_PER_RAD) - 2), int(HORIZON_ROW) + 1


def _relief(shape: tuple[int, int], rng: np.random.Generator, style: BackdropStyle, *, cell_rad: float) -> np.ndarray:
    """Relative sunlight on folded slopes, about 1: the sides of spurs and gullies face the sun or not."""
    cell = cell_rad * PIXELS_PER_RAD
    ground = fractal_noise(shape, rng, cell_px=(0.9 * cell, 0.6 * cell), octaves=4, gain=0.42)
    across = np.gradient(ground, axis=1) * cell
    # The sun lights right-hand slopes where it is to the right of the line of sight.
    side = np.sin(column_azimuths() - style.sun_azimuth_rad)
    return np.clip(1 + 0.07 * across * side[None, :] + 0.06 * ground, 0.5, 1.5)


def _paint_ridge(panorama: np.ndarray, style: BackdropStyle, rng: np.random.Generator) -> None:
    """Paint two lines of far wooded ridges, blue with distance."""
    for distance_km, share in ((14.0, 1.0), (7.0, 0.72)):
        skyline = _skyline(rng, share * style.ridge_height_rad, cell_rad=0.45, roughness=0.40)
        skyline += 0.0007 * fractal_profile(PANORAMA_COLUMNS, rng, cell_px=7, octaves=3)
        first, last = _band(skyline)
        shape = (last - first, PANORAMA_COLUMNS)
        relief = _relief(shape, rng, style, cell_rad=0.10)
        trees = fractal_noise(shape, rng, cell_px=(5, 7), octaves=3, gain=0.8)
        glades = fractal_noise(shape, rng, cell_px=(14, 70), octaves=5, gain=0.65)
        clearings = 0.6 * smoothstep(1.9, 2.8, glades + 0.3 * trees)
        light = np.clip(0.55 * relief + 0.16 * trees, 0.05, 1.3)
        wood_edges = (
            shade + brighter * light for shade, brighter in zip(FOREST_SHADE, FOREST_SUN - FOREST_SHADE, strict=True)
        )
        colours = (
            _blend(wood, grass * relief, clearings) for wood, grass in zip(wood_edges, 0.8 * _grass(style), strict=True)
        )
        _paint_slope(panorama, slice(first, last), colours, skyline, distance_km, style)


def _blend(below: np.ndarray, above: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Blend `above` into `below` with weight `share`, in place; `above` is overwritten."""
    above -= below
    above *= share
    below += above
    return below


def _paint_hills(
    panorama: np.ndarray, style: BackdropStyle, rng: np.random.Generator, *, distance_km: float, height_rad: float
) -> None:
    """Paint a line of grassy hills with scrub in the folds, and its trees."""
    skyline = _skyline(rng, height_rad, cell_rad=0.30 + 0.25 * (1.6 / (1 + distance_km)), roughness=0.36)
    # The road runs along a valley, so near hills are low ahead and behind.
    valley = smoothstep(0.02, 0.55, np.abs(np.sin(column_azimuths())))
    skyline = skyline * (1 - (1 - valley) * min(1.0, 1.2 / distance_km) * 0.85)
    skyline += 0.0006 * fractal_profile(PANORAMA_COLUMNS, rng, cell_px=9, octaves=3)
    first, last = _band(skyline)
    shape = (last - first, PANORAMA_COLUMNS)
    relief = _relief(shape, rng, style, cell_rad=0.16)
    grain = fractal_noise(shape, rng, cell_px=(6, 9), octaves=3, gain=0.8)
    patches = fractal_noise(shape, rng, cell_px=(34, 150), octaves=6, gain=0.6)
    dry = smoothstep(-0.4, 1.6, patches)
    moist, relief = 1 - 0.55 * dry, relief * (1 + 0.06 * grain)
    brush = smoothstep(2.2 - 2.2 * style.tree_density, 2.7 - 2.0 * style.tree_density, patches + 0.55 * grain)
    brush *= 0.85
    bushes = np.clip(1 + 0.45 * grain, 0.2, 2)
    colours = (
        _blend((grass * moist + soil * dry) * relief, scrub * bushes, brush)
        for grass, soil, scrub in zip(_grass(style), DRY_SOIL * 0.55, CHAPARRAL, strict=True)
    )
    _paint_slope(panorama, slice(first, last), colours, skyline, distance_km, style)
    count = int(3600 * style.tree_density * min(1.5, distance_km))
    column, depth = rng.integers(0, PANORAMA_COLUMNS, count), rng.uniform(0, 1, count) ** 0.8
    plant_trees = fractal_profile(PANORAMA_COLUMNS, rng, cell_px=260, octaves=4)
    keep = (plant_trees[column] > rng.normal(0.25, 0.5, count)) & (skyline[column] > 0.004)
    column, depth = column[keep], depth[keep]
    base = skyline[column] * (1 - 0.9 * depth) - 0.001
    _paint_trees(panorama, style, rng, column, base, distance_km, kinds=("oak", "oak", "bush", "scrub", "bush"))


def _paint_woods(panorama: np.ndarray, style: BackdropStyle, rng: np.random.Generator) -> None:
    """Paint trees and hedges on the plain at distances from 1 km to 350 m."""
    plant_trees = fractal_profile(PANORAMA_COLUMNS, rng, cell_px=900, octaves=5, gain=0.6)
    trees = ("oak", "plane", "eucalyptus", "oak", "bush")
    for distance_km in (1.0, 0.6, 0.35):
        # Undergrowth in front of the trees hides their feet.
        for kinds, share, spread in ((trees, 2000, 0.0), (("bush", "bush", "scrub"), 4500, 0.3)):
            count = int(share * style.tree_density)
            column = rng.integers(0, PANORAMA_COLUMNS, count)
            # No near trees in the direction of the road, because the scene has its own there.
            valley = np.abs(np.sin(column / PIXELS_PER_RAD))
            edge = rng.normal(0.9 - 1.4 * style.tree_density - spread, 0.35, count)
            column = column[(plant_trees[column] > edge) & (valley > 0.045 / distance_km)]
            base = -0.0015 / distance_km * rng.uniform(0.5, 1.1, len(column))
            _paint_trees(panorama, style, rng, column, base, distance_km, kinds=kinds)


def _paint_trees(
    panorama: np.ndarray,
    style: BackdropStyle,
    rng: np.random.Generator,
    column: np.ndarray,
    base_z: np.ndarray,
    distance_km: float,
    *,
    kinds: tuple[str, ...],
) -> None:
    """Paint trees on the panorama from far to near, that is from the highest foot down."""
    airlight = _veil(np.zeros(3, np.float32), distance_km, style)
    transmittance = _veil(np.ones(3, np.float32), distance_km, style) - airlight
    metres = {"oak": 9, "plane": 13, "eucalyptus": 19, "cypress": 12, "redwood": 24, "bush": 3, "scrub": 1.5}
    for i in np.argsort(-base_z, kind="stable"):
        kind = kinds[rng.integers(len(kinds))]
        height_m = metres[kind] * rng.uniform(0.55, 1.25)
        rows = height_m / (1000 * distance_km) * PIXELS_PER_RAD
        sprite = _sized_sprite(kind, int(rng.integers(2)), int(max(2, round(rows))))
        # Sprites are lit from the left. The sun is to the left of the line of sight where this sine is positive.
        if np.sin(style.sun_azimuth_rad - column[i] / PIXELS_PER_RAD) * -SUN_IN_SPRITE[0] < 0:
            sprite = sprite[:, ::-1]
        tint = np.exp(rng.normal(0, 0.16) + rng.normal(0, 0.05, 3)).astype(np.float32)
        foot = int(round(HORIZON_ROW - base_z[i] * PIXELS_PER_RAD))
        _stamp(panorama, sprite, int(column[i]), foot, tint, Atmosphere(transmittance, airlight))


@lru_cache(maxsize=512)
def _sized_sprite(kind: str, seed: int, rows: int) -> np.ndarray:
    sprites = plant_sprites(kind, seed)
    level = sprite_level(sprites, rows)
    columns = max(1, round(level.shape[1] * rows / level.shape[0]))
    return cv2.resize(level, (columns, rows), interpolation=cv2.INTER_AREA)


def _stamp(
    panorama: np.ndarray,
    sprite: np.ndarray,
    column: int,
    foot: int,
    tint: np.ndarray,
    atmosphere: Atmosphere,
) -> None:
    """Composite a sprite over the panorama with its foot at (column, foot), wrapping around the end."""
    rows, columns = sprite.shape[:2]
    top, bottom = max(0, foot - rows), min(PANORAMA_ROWS, foot)
    sprite = sprite[top - (foot - rows) : bottom - (foot - rows)]
    left = column - columns // 2
    where: slice | np.ndarray = slice(left, left + columns)
    if left < 0 or left + columns > PANORAMA_COLUMNS:
        where = np.arange(left, left + columns) % PANORAMA_COLUMNS
    *colours, alpha = sprite.transpose(2, 0, 1)
    clear = 1 - alpha
    for plane, colour, tone, factor, offset in zip(panorama, colours, tint, *map(np.asarray, atmosphere), strict=True):
        plane[top:bottom, where] = plane[top:bottom, where] * clear + colour * tone * factor + offset * alpha
