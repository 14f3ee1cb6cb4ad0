"""Seeded noise on the ground, looked up by place, so that texture moves with the road."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

TILE = 512
# Texels in one wavelength of the tile's band: enough for bilinear lookup, and 64 waves before it repeats.
TEXELS_PER_WAVE = 8
LIST_ROW = 1024


@lru_cache(maxsize=64)
def band_noise_tile(seed: int, *, octaves: int = 1) -> np.ndarray:
    """Periodic noise (TILE + 1, TILE + 1) float32, mean 0, standard deviation 1, wavelengths about TEXELS_PER_WAVE.

    With more octaves, longer waves are added, each half as steep: cloudy instead of grainy.
    """
    rng = np.random.default_rng(seed)
    waves = np.fft.rfft2(rng.standard_normal((TILE, TILE)))
    waves *= _gain(octaves)
    tile = np.fft.irfft2(waves, s=(TILE, TILE))
    tile /= tile.std()
    # One more row and column, so that bilinear lookup wraps without a seam.
    return cv2.copyMakeBorder(tile.astype(np.float32), 0, 1, 0, 1, cv2.BORDER_WRAP)


@lru_cache(maxsize=8)
def _gain(octaves: int) -> np.ndarray:
    """How strong the waves of a tile are, by np.fft.rfft2's frequencies."""
    frequency = np.hypot(np.fft.fftfreq(TILE)[:, None], np.fft.rfftfreq(TILE)[None, :]) * TEXELS_PER_WAVE
    gain = sum(2.0**k * np.exp(-(((frequency * 2.0**k) - 1) ** 2) / 0.5) * 1.4**k for k in range(octaves))
    gain[0, 0] = 0
    return gain


def sample_noise(tile: np.ndarray, s: np.ndarray, d: np.ndarray, *, wave_s_m: float, wave_d_m: float) -> np.ndarray:
    """Noise at places (s, d) with the given wavelengths along and across the road.

    Parameters
    ----------
    tile : ndarray of shape (TILE + 1, TILE + 1), float32
        From `band_noise_tile`.
    s, d : ndarray of shape (rows, width) or (K,), float32
        Metres.
    """
    u, v = _wrapped(s, wave_s_m), _wrapped(d, wave_d_m)
    if s.ndim == 2:
        return cv2.remap(tile, u, v, cv2.INTER_LINEAR)
    # OpenCV refuses maps longer than 32767, so a list is folded into rows.
    rows = max(1, -(-len(s) // LIST_ROW))
    return cv2.remap(tile, _folded(u, rows), _folded(v, rows), cv2.INTER_LINEAR).ravel()[: len(s)]


def _folded(values: np.ndarray, rows: int) -> np.ndarray:
    """(rows, LIST_ROW) with zeros after the values: np.resize would copy them twice."""
    folded = np.zeros(rows * LIST_ROW, np.float32)
    folded[: len(values)] = values
    return folded.reshape(rows, LIST_ROW)


def fade(footprint: np.ndarray, wave_m: float) -> np.ndarray:
    """How much of a wave is left after averaging over a footprint of length `reach`: 1 when short, 0 when long."""
    ratio = footprint * np.float32(1.6 / wave_m)
    ratio *= ratio
    ratio += 1
    return np.divide(1, ratio, out=ratio)


def _wrapped(metres: np.ndarray, wave_m: float) -> np.ndarray:
    # TILE is a power of two: tiles are as exact as texels.
    tiles = metres * np.float32(TEXELS_PER_WAVE / TILE / wave_m)
    tiles -= np.floor(tiles)
    tiles *= TILE
    return tiles
