"""Seeded noise on the ground, sampled in road coordinates, so that the texture moves with the road."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

TILE = 512
# Texels in a wavelength: enough for bilinear sampling, and 64 wavelengths in a tile before it repeats.
TEXELS_PER_WAVE = 8
LIST_ROW = 1024


@lru_cache(maxsize=64)
def band_noise_tile(seed: int, *, octaves: int = 1) -> np.ndarray:
    """Periodic noise (TILE + 1, TILE + 1) float32, mean 0, standard deviation 1, wavelengths about TEXELS_PER_WAVE.

    More octaves add longer waves of half the slope each, which look cloudy instead of grainy.
    """
    rng = np.random.default_rng(seed)
    waves = np.fft.rfft2(rng.standard_normal((TILE, TILE)))
    waves *= _gain(octaves)
    tile = np.fft.irfft2(waves, s=(TILE, TILE))
    tile /= tile.std()
    # One more row and column, so that bilinear sampling wraps without a seam.
    return cv2.copyMakeBorder(tile.astype(np.float32), 0, 1, 0, 1, cv2.BORDER_WRAP)


@lru_cache(maxsize=8)
def _gain(octaves: int) -> np.ndarray:
    """Amplitude of each frequency of np.fft.rfft2 in a tile."""
    frequency = np.hypot(np.fft.fftfreq(TILE)[:, None], np.fft.rfftfreq(TILE)[None, :]) * TEXELS_PER_WAVE
    gain = sum(2.0**k * np.exp(-(((frequency * 2.0**k) - 1) ** 2) / 0.5) * 1.4**k for k in range(octaves))
    gain[0, 0] = 0
    return gain


def sample_noise(tile: np.ndarray, s: np.ndarray, d: np.ndarray, *, wave_s_m: float, wave_d_m: float) -> np.ndarray:
    """Noise of a `band_noise_tile` at road coordinates (rows, width) or (K,) float32, with wavelengths in metres."""
    u, v = _wrapped(s, wave_s_m), _wrapped(d, wave_d_m)
    if s.ndim == 2:
        return cv2.remap(tile, u, v, cv2.INTER_LINEAR)
    # OpenCV refuses maps longer than 32767, so a list is reshaped to rows.
    rows = max(1, -(-len(s) // LIST_ROW))
    return cv2.remap(tile, _folded(u, rows), _folded(v, rows), cv2.INTER_LINEAR).ravel()[: len(s)]


def _folded(values: np.ndarray, rows: int) -> np.ndarray:
    """The values as (rows, LIST_ROW), padded with zeros; np.resize would copy them twice."""
    folded = np.zeros(rows * LIST_ROW, np.float32)
    folded[: len(values)] = values
    return folded.reshape(rows, LIST_ROW)


def fade(footprint: np.ndarray, wave_m: float) -> np.ndarray:
    """Share of a wave's amplitude left after averaging over a footprint: 1 for a short footprint, 0 for a long one."""
    ratio = footprint * np.float32(1.6 / wave_m)
    ratio *= ratio
    ratio += 1
    return np.divide(1, ratio, out=ratio)


def _wrapped(metres: np.ndarray, wave_m: float) -> np.ndarray:
    # TILE is a power of two, so this scaling is exact.
    tiles = metres * np.float32(TEXELS_PER_WAVE / TILE / wave_m)
    tiles -= np.floor(tiles)
    tiles *= TILE
    return tiles
