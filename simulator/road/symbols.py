"""Arrows, diamonds and words painted on the road."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from simulator.road.ground import Ground
from simulator.road.painted_lines import WHITE, worn

# Resolution of the stencils: 1.6 cm across the road, 3.1 cm along it.
ACROSS_PX_PER_M, ALONG_PX_PER_M = 64, 32
# Outlines as shares of width (0 left, 1 right) and length (0 near, 1 far), after MUTCD figures 3B-21 and 3B-24.
OUTLINES = {
    "arrow": [[0.38, 0], [0.62, 0], [0.62, 0.58], [1, 0.58], [0.5, 1], [0, 0.58], [0.38, 0.58]],
    "left arrow": [
        [0.68, 0], [0.9, 0], [0.9, 0.55], [0.78, 0.72], [0.45, 0.72], [0.45, 1], [0, 0.62], [0.45, 0.26], [0.45, 0.52],
        [0.62, 0.52], [0.68, 0.45],
    ],
    "diamond": [[0.5, 0], [1, 0.5], [0.5, 1], [0, 0.5]],
}  # fmt: skip
DIAMOND_STROKE = 0.24


@dataclass(frozen=True)
class Symbol:
    """Symbol painted on the road: `kind` is "arrow", "left arrow", "diamond", or a word to be written.

    `s_m` is the arc length of its near end, `lateral_m` the lateral position of its centre.
    """

    s_m: float
    lateral_m: float
    kind: str
    length_m: float = 3.6
    width_m: float = 1.2
    wear: float = 0.2


def paint_symbols(
    albedo: np.ndarray, symbols: tuple[Symbol, ...], ground: Ground, *, station_m: float, seed: int
) -> None:
    """Paint the symbols onto the road's reflectance (rows, width, 3) float32, in place."""
    flat = albedo.reshape(-1, 3)
    for number, symbol in enumerate(symbols):
        pixels, coverage = symbol_coverage(symbol, ground, station_m=station_m)
        if not len(pixels):
            continue
        coverage = coverage * worn(symbol.wear, ground, pixels, station_m, seed + number)
        flat[pixels] += coverage[:, None] * (np.array(WHITE, np.float32) - flat[pixels])


def symbol_coverage(symbol: Symbol, ground: Ground, *, station_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (K,), as indices into the raveled ground arrays, and the share (K,) of each that a symbol covers."""
    near = np.float32(symbol.s_m - station_m)
    far = near + np.float32(symbol.length_m)
    left = np.float32(symbol.lateral_m + symbol.width_m / 2)
    margin = ground.footprint_s
    inside = (ground.s > near - margin) & (ground.s < far + margin) & ground.visible
    inside &= np.abs(ground.d - np.float32(symbol.lateral_m)) < np.float32(symbol.width_m / 2 + 0.1)
    pixels = np.flatnonzero(inside)
    if not len(pixels):
        return pixels, np.zeros(0, np.float32)
    s, d = ground.s.ravel()[pixels], ground.d.ravel()[pixels]
    levels = _stencil(symbol.kind, symbol.length_m, symbol.width_m)
    # Footprints are much longer than wide, so only the rows are averaged.
    footprint_px = np.median(margin.ravel()[pixels]) * ALONG_PX_PER_M
    level = int(np.clip(np.rint(np.log2(max(footprint_px, 1.0))), 0, len(levels) - 1))
    row = ((far - s) * np.float32(ALONG_PX_PER_M) + np.float32(0.5)) / np.float32(2**level) - np.float32(0.5)
    column = (left - d) * np.float32(ACROSS_PX_PER_M)
    coverage = np.zeros(len(pixels), np.float32)
    # OpenCV refuses maps longer than 32767.
    for part in range(0, len(pixels), 32000):
        cut = slice(part, part + 32000)
        padded = cv2.remap(levels[level], column[cut][:, None] + 4, row[cut][:, None] + 4, cv2.INTER_LINEAR)
        coverage[cut] = padded.ravel()
    return pixels, coverage


@lru_cache(maxsize=32)
def _stencil(kind: str, length_m: float, width_m: float) -> list[np.ndarray]:
    """Pyramid of the stencil, float32 0..1: far end in the first row, 4 px of border; each level has half the rows."""
    fine = 4
    rows, columns = round(length_m * ALONG_PX_PER_M) * fine, round(width_m * ACROSS_PX_PER_M) * fine
    picture = _outline(kind, rows, columns) if kind in OUTLINES else _word(kind, rows, columns)
    picture = cv2.resize(picture, (columns // fine, rows // fine), interpolation=cv2.INTER_AREA)
    levels: list[np.ndarray] = [picture.astype(np.float32) / 255]
    while levels[-1].shape[0] > 8:
        size = (levels[-1].shape[1], levels[-1].shape[0] // 2)
        levels.append(cv2.resize(levels[-1], size, interpolation=cv2.INTER_AREA))
    return [np.pad(level, 4) for level in levels]


def _outline(kind: str, rows: int, columns: int) -> np.ndarray:
    picture = np.zeros((rows, columns), np.uint8)
    shape = np.array(OUTLINES[kind])
    cv2.fillPoly(picture, [np.rint([0, rows] + shape * [columns, -rows]).astype(np.int32)], 255)
    if kind == "diamond":
        inner = 0.5 + (shape - 0.5) * (1 - 2 * DIAMOND_STROKE)
        cv2.fillPoly(picture, [np.rint([0, rows] + inner * [columns, -rows]).astype(np.int32)], 0)
    return picture


def _word(text: str, rows: int, columns: int) -> np.ndarray:
    """Stencil filled with a word in block letters."""
    scale, stroke = 8.0, 40
    (wide, tall), below = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, stroke)
    picture = np.zeros((tall + 2 * stroke, wide + 2 * stroke), np.uint8)
    cv2.putText(picture, text, (stroke, tall + stroke), cv2.FONT_HERSHEY_SIMPLEX, scale, 255, stroke)
    inked = np.argwhere(picture)
    (top, left), (bottom, right) = inked.min(axis=0), inked.max(axis=0) + 1
    return cv2.resize(picture[top:bottom, left:right], (columns, rows), interpolation=cv2.INTER_AREA)
