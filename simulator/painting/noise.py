"""Seeded noise: fields for hills, leaves, concrete and paint, and tiles that are sampled in road coordinates."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

TILE = 512
# Texels in a wavelength: enough for bilinear sampling, and 64 wavelengths in a tile before it repeats.
TEXELS_PER_WAVE = 8
LIST_ROW = 1024


def fractal_noise(
    shape: tuple[int, int],
    rng: np.random.Generator,
    *,
    cell_px: tuple[float, float],
    octaves: int = 5,
    gain: float = 0.5,
) -> np.ndarray:
    """Smooth random field of `shape`, float32, mean 0, standard deviation 1, periodic along the rows.

    It is a sum of value noise at `octaves` halving scales, without cells smaller than 1.5 pixels. `cell_px` is the
    height and width of the coarsest cell, `gain` the amplitude of each scale relative to the coarser one.
    """
    rows, columns = shape
    total = np.zeros(shape, np.float32)
    for octave in range(octaves):
        cell_rows, cell_columns = cell_px[0] / 2**octave, cell_px[1] / 2**octave
        if octave and min(cell_rows, cell_columns) < 1.5:
            break
        across = max(1, round(columns / cell_columns))
        grid = rng.standard_normal((int(np.ceil(rows / cell_rows)) + 4, across)).astype(np.float32)
        grid = np.pad(grid, ((0, 0), (2, 2)), mode="wrap")
        # Exact scale, so that the last column continues into the first one.
        to_grid = np.array([[across / columns, 0, 2], [0, 1 / cell_rows, 1]])
        flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
        layer: np.ndarray = cv2.warpAffine(
            grid, to_grid, (columns, rows), flags=flags, borderMode=cv2.BORDER_REFLECT_101
        )
        layer *= gain**octave
        total += layer
    # In place, because these fields are large.
    total -= total.mean()
    total /= max(float(np.sqrt(np.square(total).mean())), 1e-9)
    return total


def fractal_profile(
    length: int, rng: np.random.Generator, *, cell_px: float, octaves: int = 7, gain: float = 0.5
) -> np.ndarray:
    """Periodic 1-D fractal noise (length,) float32, mean 0, standard deviation 1; see `fractal_noise`."""
    return fractal_noise((1, length), rng, cell_px=(cell_px, cell_px), octaves=octaves, gain=gain)[0]


def smoothstep(low: np.ndarray | np.floating | float, high: np.floating | float, x: np.ndarray) -> np.ndarray:
    """Smooth step: 0 below `low`, 1 above `high`, a cubic between."""
    t = np.clip((x - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)


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
    return sample(tile, _wrapped(s, wave_s_m), _wrapped(d, wave_d_m))


def sample(image: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Bilinear samples of an image of one channel at pixels (u, v), (rows, width) or (K,) float32; 0 outside."""
    if u.ndim == 2 or not len(u):
        return cv2.remap(image, u, v, cv2.INTER_LINEAR) if len(u) else u
    # OpenCV refuses maps longer than 32767, so a list is reshaped to rows.
    u_rows, v_rows = (np.pad(x, (0, -len(x) % LIST_ROW)).reshape(-1, LIST_ROW) for x in (u, v))
    return cv2.remap(image, u_rows, v_rows, cv2.INTER_LINEAR).ravel()[: len(u)]


def fade(footprint: np.ndarray, wave_m: float) -> np.ndarray:
    """Share of a wave's amplitude left after averaging over a footprint: 1 for a short footprint, 0 for a long one."""
    return 1 / (1 + (footprint * np.float32(1.6 / wave_m)) ** 2)


def _wrapped(metres: np.ndarray, wave_m: float) -> np.ndarray:
    tiles = metres * np.float32(TEXELS_PER_WAVE / TILE / wave_m)
    return (tiles - np.floor(tiles)) * np.float32(TILE)
