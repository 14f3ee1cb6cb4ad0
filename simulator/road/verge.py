"""Verge of the road: gravel, dry grass, and dust on the edge of the pavement."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from simulator.painting.texture import band_noise_tile, fade, sample_noise
from simulator.road.ground import Ground, edge_coverage, strip_coverage

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


@dataclass(frozen=True)
class OppositeCarriageway:
    """Carriageway beyond the verge: lateral edges, mean reflectance, and relative tone (rows, width)."""

    edges_m: tuple[float, float]
    colour: tuple[float, float, float]
    tone: np.ndarray


def paint_verge(
    albedo: np.ndarray,
    ground: Ground,
    s: np.ndarray,
    *,
    edges_m: tuple[float, float],
    gravel_m: float,
    opposite: OppositeCarriageway | None = None,
    tint: tuple[float, float, float] = (1.0, 1.0, 1.0),
    needed: np.ndarray | None = None,
    seed: int,
) -> None:
    """Paint the ground next to the pavement, in place.

    Parameters
    ----------
    albedo : ndarray of shape (rows, width, 3), float32
        Reflectance of the pavement.
    s : ndarray of shape (rows, width), float32
        Arc lengths from the road's start.
    edges_m : (float, float)
        Right and left edge of the pavement, lateral.
    gravel_m : float
        Width of the gravel strip between pavement and grass.
    tint : (float, float, float)
        Factor on the colours of gravel and grass.
    wanted : ndarray of shape (rows, width), bool, optional
        Pixels to paint; all if None.
    """
    for first in range(0, len(s), BLOCK_ROWS):
        rows = slice(first, first + BLOCK_ROWS)
        across = None if opposite is None else replace(opposite, tone=opposite.tone[rows])
        where = True if needed is None else needed[rows]
        _paint_rows(albedo[rows], ground.crop(rows), s[rows], edges_m, gravel_m, across, tint, where, seed)


def _paint_rows(
    albedo: np.ndarray,
    ground: Ground,
    s: np.ndarray,
    edges_m: tuple[float, float],
    gravel_m: float,
    opposite: OppositeCarriageway | None,
    tint: tuple[float, float, float],
    needed: np.ndarray | bool,
    seed: int,
) -> None:
    """`paint_verge` for a block of rows."""
    beyond = np.maximum(ground.d - np.float32(edges_m[1]), np.float32(edges_m[0]) - ground.d)
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
    to_grass = edge_coverage(beyond - np.float32(gravel_m) + 0.15 * rough + 0.2 * broad, d_u + 0.5, d_v)
    share = edge_coverage(beyond + np.float32(0.02) * rough + np.float32(0.04) * broad, d_u, d_v)
    dust = np.clip(1 + beyond / np.float32(DUST_REACH_M), 0, 1) ** 2 * np.maximum(1 + 0.5 * rough + 0.3 * broad, 0)
    share += (1 - share) * np.float32(DUST_SHARE) * dust
    if opposite is not None:
        pavement_tone = opposite.tone.ravel()[pixels]
        on_pavement = strip_coverage(d, d_u, d_v, *opposite.edges_m)
    # Channel by channel, because numpy is slow where the innermost axis has three elements.
    for channel in range(3):
        verge = GRAVEL[channel] * gravel_tone
        verge += to_grass * (grass[channel] - verge)
        if tint[channel] != 1.0:
            verge *= np.float32(tint[channel])
        if opposite is not None:
            verge += on_pavement * (np.float32(opposite.colour[channel]) * pavement_tone - verge)
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
