"""Seeded fractal noise for hills, leaves, concrete and paint."""

from __future__ import annotations

import cv2
import numpy as np


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
    x = np.arange(length)
    total = np.zeros(length)
    for octave in range(octaves):
        across = max(1, round(length / (cell_px / 2**octave)))
        grid = rng.standard_normal(across)
        position = x * across / length
        left = np.floor(position).astype(int)
        share = position - left
        share = share * share * (3 - 2 * share)
        total += gain**octave * (grid[left % across] * (1 - share) + grid[(left + 1) % across] * share)
    return ((total - total.mean()) / max(total.std(), 1e-9)).astype(np.float32)


def smoothstep(low: np.ndarray | np.floating | float, high: np.floating | float, x: np.ndarray) -> np.ndarray:
    """Smooth step: 0 below `low`, 1 above `high`, a cubic between."""
    t = np.clip((x - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)
