"""Verge of the road: gravel, dry grass, and dust on the edge of the pavement."""

from __future__ import annotations

import numpy as np

from simulator.painting.texture import band_noise_tile, fade, sample_noise
from simulator.road.ground import Ground, edge_coverage, strip_coverage
from simulator.road.materials import MATERIALS
from simulator.road.surface import Surface

# Linear reflectance in a dry summer, 1.0 = white paint.
GRAVEL = np.array([0.30, 0.255, 0.185], np.float32)
DIRT = np.array([0.34, 0.265, 0.165], np.float32)
VERGE_GRASS = np.array([0.40, 0.285, 0.135], np.float32)
DUST = (0.26, 0.235, 0.215)
# Width of the dust on the pavement, and its coverage at the edge.
DUST_REACH_M = 2.0
DUST_SHARE = 0.22
# Rows per block, so that a block stays in the processor's cache.
BLOCK_ROWS = 32


def paint_verge(
    albedo: np.ndarray,
    surface: Surface,
    ground: Ground,
    s: np.ndarray,
    blotch: np.ndarray,
    *,
    needed: np.ndarray | None = None,
    seed: int,
) -> None:
    """Paint the ground next to the pavement onto the reflectance (rows, width, 3), in place.

    `s` (rows, width) are arc lengths from the road's start, `blotch` (rows, width) is noise.
    Only the pixels of the mask `needed` are painted; default: all.
    """
    for first in range(0, len(s), BLOCK_ROWS):
        rows = slice(first, first + BLOCK_ROWS)
        where = True if needed is None else needed[rows]
        _paint_rows(albedo[rows], surface, ground.crop(rows), s[rows], blotch[rows], where, seed)


def _paint_rows(
    albedo: np.ndarray,
    surface: Surface,
    ground: Ground,
    s: np.ndarray,
    blotch: np.ndarray,
    needed: np.ndarray | bool,
    seed: int,
) -> None:
    """`paint_verge` for a block of rows."""
    beyond = np.maximum(ground.d - np.float32(surface.left_edge_m), np.float32(surface.right_edge_m) - ground.d)
    pixels = np.flatnonzero((beyond > -ground.footprint_d - np.float32(DUST_REACH_M)) & needed)
    if not len(pixels):
        return
    arrays = (s, ground.d, ground.d_u, ground.d_v, ground.footprint_s, beyond)
    s, d, d_u, d_v, footprint, beyond = (array.ravel()[pixels] for array in arrays)
    cloudy = band_noise_tile(seed, octaves=4)
    rough = sample_noise(cloudy, s, d, wave_s_m=0.5, wave_d_m=0.3) * fade(footprint, 3.0)
    broad = sample_noise(cloudy, s, d + 5, wave_s_m=5.0, wave_d_m=1.8) * fade(footprint, 30.0)
    fine = sample_noise(band_noise_tile(seed + 1), s, d, wave_s_m=0.12, wave_d_m=0.07) * fade(footprint, 0.2)
    gravel_tone = 1 + 0.16 * rough + 0.15 * fine
    grass = _grass(s, d, footprint, rough, broad, fine, seed=seed + 2)
    # The border follows the tufts.
    to_grass = edge_coverage(beyond - np.float32(surface.gravel_m) + 0.15 * rough + 0.2 * broad, d_u + 0.5, d_v)
    share = edge_coverage(beyond + np.float32(0.02) * rough + np.float32(0.04) * broad, d_u, d_v)
    dust = np.clip(1 + beyond / np.float32(DUST_REACH_M), 0, 1) ** 2 * np.maximum(1 + 0.5 * rough + 0.3 * broad, 0)
    share += (1 - share) * np.float32(DUST_SHARE) * dust
    if surface.opposite_m is not None:
        # Plain asphalt, because barriers hide most of it.
        asphalt = MATERIALS["asphalt"].colour
        asphalt_tone = 1 + 0.1 * blotch.ravel()[pixels]
        on_asphalt = strip_coverage(d, d_u, d_v, *surface.opposite_m)
    # Channel by channel, because numpy is slow where the innermost axis has three elements.
    for channel in range(3):
        verge = GRAVEL[channel] * gravel_tone
        verge += to_grass * (grass[channel] - verge)
        verge *= np.float32(surface.verge_tint[channel])
        if surface.opposite_m is not None:
            verge += on_asphalt * (np.float32(asphalt[channel]) * asphalt_tone - verge)
        flat = albedo.reshape(-1, 3)[:, channel]
        below = flat[pixels]
        flat[pixels] = below + share * (verge - below)


def _grass(
    s: np.ndarray,
    d: np.ndarray,
    footprint: np.ndarray,
    rough: np.ndarray,
    broad: np.ndarray,
    fine: np.ndarray,
    *,
    seed: int,
) -> np.ndarray:
    """Reflectance (3, K) of dry grass in tufts, with bare soil and dark gaps."""
    tufts = sample_noise(band_noise_tile(seed), s, d, wave_s_m=0.6, wave_d_m=0.22)
    tufts = np.minimum(tufts, 0.6) * fade(footprint, 1.5)
    grass = VERGE_GRASS[:, None] * (1 + 0.20 * broad)
    grass += np.clip(0.35 * broad - 0.2, 0, 0.6) * (DIRT[:, None] - grass)
    return grass * np.maximum(1 + 0.22 * rough + 0.35 * fine + 0.25 * tufts, 0.12)
