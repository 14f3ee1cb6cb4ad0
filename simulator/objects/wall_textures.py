"""Textures of walls and banks: concrete, kerbstones, steel rails, grass, rock and wood."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from simulator.disk_cache import cached_array
from simulator.landscape import foliage
from simulator.landscape.foliage import plant_sprites
from simulator.painting import noise
from simulator.painting.noise import fractal_noise, smoothstep

TEXTURE_LENGTH_M = 48.0
TEXTURE_PX_PER_M = 40
# Textures in the disk cache, because painting them takes longer than reading. The number is twice that of the suite.
SLOW = ("wood", "grass", "rock")
MAX_CACHED = 26


@lru_cache(maxsize=32)
def wall_texture(name: str, seed: int) -> tuple[np.ndarray, ...]:
    """Image pyramid (rows, columns, 4): RGB reflectance times coverage, and coverage, top row first."""
    levels = [(_cached if name in SLOW else _paint)(name, seed)]
    while levels[-1].shape[1] > 16:
        # Walls are seen at grazing angles, so columns are reduced more than rows.
        rows = max(8, levels[-1].shape[0] // 2) if len(levels) > 2 else levels[-1].shape[0]
        levels.append(cv2.resize(levels[-1], (levels[-1].shape[1] // 2, rows), interpolation=cv2.INTER_AREA))
    return tuple(levels)


def _paint(name: str, seed: int) -> np.ndarray:
    """Full-size texture."""
    columns = int(TEXTURE_LENGTH_M * TEXTURE_PX_PER_M)
    return _PAINTERS[name](np.random.default_rng([seed, 5]), columns).astype(np.float32)


def _cached(name: str, seed: int) -> np.ndarray:
    sources = [Path(source) for source in (__file__, foliage.__file__, noise.__file__)]
    return cached_array(f"walls/{name}-{seed}", sources, lambda: _paint(name, seed), max_files=MAX_CACHED)


def _with_cover(rgb: np.ndarray, cover: np.ndarray | float = 1.0) -> np.ndarray:
    cover = np.broadcast_to(np.asarray(cover, np.float32), rgb.shape[:2])[..., None]
    return np.concatenate([rgb * cover, cover], axis=2)


def _concrete(rng: np.random.Generator, columns: int) -> np.ndarray:
    """Cast concrete: blotches, vertical water stains, joints every 6 m, dirt at the foot."""
    rows = 40
    shape = (rows, columns)
    blotches = fractal_noise(shape, rng, cell_px=(30, 90), octaves=5, gain=0.6)
    drips = fractal_noise(shape, rng, cell_px=(60, 12), octaves=3, gain=0.7)
    grain = rng.normal(0, 1, shape)
    height = np.linspace(1, 0, rows)[:, None]
    grey = 0.34 * (1 + 0.10 * blotches + 0.05 * grain - 0.10 * np.clip(drips, 0, 2) * height)
    # The foot is inclined and gets more skylight.
    grey *= 1 + 0.16 * smoothstep(0.36, 0.28, height) - 0.45 * smoothstep(0.13, 0.0, height) * (1 + 0.3 * blotches)
    joint = (np.arange(columns) % int(6 * TEXTURE_PX_PER_M)) < 2
    grey[:, joint] *= 0.45
    return _with_cover(np.clip(grey, 0.03, 0.8)[..., None] * np.array([1.03, 1.0, 0.93]))


def _concrete_top(rng: np.random.Generator, columns: int) -> np.ndarray:
    blotches = fractal_noise((12, columns), rng, cell_px=(20, 60), octaves=5, gain=0.7)
    grey = 0.42 * (1 + 0.10 * blotches + 0.04 * rng.normal(0, 1, blotches.shape))
    grey[:, (np.arange(columns) % int(6 * TEXTURE_PX_PER_M)) < 2] *= 0.5
    return _with_cover(np.clip(grey, 0.05, 0.8)[..., None] * np.array([1.03, 1.0, 0.93]))


def _kerb(rng: np.random.Generator, columns: int) -> np.ndarray:
    """Face of kerbstones: individual tones, tyre marks above, dirt of the gutter below."""
    rows = 16
    height = np.linspace(1, 0, rows)[:, None]
    grey = _kerbstones((rows, columns), rng)
    rubber = fractal_noise((rows, columns), rng, cell_px=(6, 120), octaves=4, gain=0.6)
    dirt = fractal_noise((rows, columns), rng, cell_px=(16, 50), octaves=4, gain=0.6)
    grey *= 1 - 0.22 * smoothstep(0.8, 1.8, rubber) * smoothstep(0.25, 0.6, height)
    grey *= 1 - 0.55 * smoothstep(0.45 + 0.12 * dirt, 0.0, height)
    return _with_cover(np.clip(grey, 0.03, 0.8)[..., None] * np.array([1.03, 1.0, 0.93]))


def _kerb_top(rng: np.random.Generator, columns: int) -> np.ndarray:
    return _with_cover(np.clip(_kerbstones((12, columns), rng), 0.05, 0.8)[..., None] * np.array([1.03, 1.0, 0.93]))


def _kerbstones(shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Grey (rows, columns) of concrete stones 1.2 m long with joints of 2.5 cm; periodic along the wall."""
    length = int(1.2 * TEXTURE_PX_PER_M)
    stone = np.arange(shape[1]) // length
    tone = rng.normal(0, 0.05, stone[-1] + 1)[stone]
    blotches = fractal_noise(shape, rng, cell_px=(20, 40), octaves=5, gain=0.7)
    grey = 0.38 * (1 + tone + 0.08 * blotches + 0.04 * rng.normal(0, 1, shape))
    grey[:, np.arange(shape[1]) % length == 0] *= 0.45
    return grey


def _rail(rng: np.random.Generator, columns: int) -> np.ndarray:
    """W-beam guard rail on posts every 2 m, open below."""
    rows = 48
    height = np.linspace(0.80, 0, rows)[:, None]
    beam = smoothstep(0.44, 0.46, height) * smoothstep(0.79, 0.77, height)
    # Two ridges, each bright on its upper half and dark on its lower half.
    fold = np.sin((height - 0.46) / 0.31 * 4 * np.pi)
    rust = fractal_noise((rows, columns), rng, cell_px=(20, 50), octaves=5, gain=0.7)
    steel = (0.34 + 0.17 * fold) * (1 + 0.07 * rust)
    post = ((np.arange(columns) % (2 * TEXTURE_PX_PER_M)) < 6) & (height < 0.70)
    grey = np.where(beam > 0.5, steel, 0.16)
    return _with_cover(grey[..., None] * np.array([0.98, 1.0, 1.0]), np.maximum(beam, post))


def _handrail(rng: np.random.Generator, columns: int) -> np.ndarray:
    """Round rail on short posts every 2.4 m, as on bridges."""
    rows = 32
    height = np.linspace(1, 0, rows)[:, None]
    rail = smoothstep(0.50, 0.56, height)
    bright = 0.30 + 0.38 * np.sin(np.clip((height - 0.5) / 0.5, 0, 1) * np.pi * 0.75 + 0.1)
    noise = fractal_noise((rows, columns), rng, cell_px=(20, 80), octaves=4)
    place = np.abs((np.arange(columns) % (2.4 * TEXTURE_PX_PER_M)) - 8)
    post = place < 4 + 5 * (1 - height)
    grey = np.where(rail > 0.5, bright, 0.42) * (1 + 0.05 * noise)
    return _with_cover(grey[..., None] * np.array([1.0, 1.0, 0.98]), np.maximum(rail, post))


def _grass(rng: np.random.Generator, columns: int) -> np.ndarray:
    """Dry grass with darker weeds and bare soil."""
    rows = 128
    shape = (rows, columns)
    tufts = fractal_noise(shape, rng, cell_px=(9, 10), octaves=3, gain=0.8)
    mottle = fractal_noise(shape, rng, cell_px=(40, 60), octaves=5, gain=0.75)
    patches = fractal_noise(shape, rng, cell_px=(64, 300), octaves=7, gain=0.62)
    straw, grey, soil = np.array([0.37, 0.26, 0.140]), np.array([0.235, 0.18, 0.115]), np.array([0.25, 0.18, 0.12])
    broad = fractal_noise(shape, rng, cell_px=(128, 420), octaves=3, gain=0.5)
    colour = grey + (straw - grey) * smoothstep(-1.6, 1.4, mottle + 0.9 * broad)[..., None]
    bare = smoothstep(0.9, 1.9, patches + 0.3 * mottle)[..., None]
    weeds = smoothstep(0.7, 1.7, -patches + 0.5 * mottle + 0.3 * tufts)[..., None]
    colour += bare * 0.6 * (soil - colour) + weeds * 0.75 * (np.array([0.085, 0.078, 0.040]) - colour)
    colour *= (1 + 0.08 * tufts)[..., None]
    return _with_cover(np.clip(colour, 0.01, 0.9))


def _rock(rng: np.random.Generator, columns: int) -> np.ndarray:
    """Weathered rock of a cutting: ledges, vertical cracks, soil and weeds on flat parts."""
    shape = (200, columns)
    ledges = fractal_noise(shape, rng, cell_px=(24, 48), octaves=6, gain=0.7)
    cracks = fractal_noise(shape, rng, cell_px=(70, 20), octaves=6, gain=0.7)
    broad = fractal_noise(shape, rng, cell_px=(80, 200), octaves=4, gain=0.6)
    relief = np.gradient(ledges, axis=0) + 0.6 * np.gradient(cracks, axis=1)
    light = np.clip(1 + 0.9 * relief + 0.12 * broad, 0.2, 1.8)
    light *= 1 - 0.6 * smoothstep(1.2, 2.2, np.abs(cracks)) * smoothstep(0.2, 0.0, np.abs(ledges))
    colour = np.array([0.25, 0.205, 0.15]) * light[..., None]
    weeds = smoothstep(0.9, 1.7, broad + 0.6 * ledges)[..., None]
    colour += weeds * 0.8 * (np.array([0.07, 0.075, 0.03]) - colour)
    return _with_cover(np.clip(colour, 0.01, 0.9))


def _wood(rng: np.random.Generator, columns: int) -> np.ndarray:
    """Edge of a wood, 15 m high: dark background, large plants, then small plants in front."""
    rows, tall_m = 360, 15.0
    picture = np.zeros((rows, columns, 4), np.float32)
    depth = fractal_noise((rows, columns), rng, cell_px=(50, 60), octaves=5, gain=0.7)
    dark = np.array([0.020, 0.024, 0.012]) * np.clip(1 + 0.5 * depth, 0.3, 2.5)[..., None]
    height = np.linspace(1, 0, rows)[:, None]
    picture[:] = _with_cover(dark, smoothstep(0.72, 0.55, height + 0.05 * depth))
    for kinds, count, low, high in (
        (("redwood", "oak", "redwood", "plane"), 34, 9.0, 15.0),
        (("oak", "plane", "bush"), 60, 4.0, 9.0),
        (("bush", "scrub", "bush"), 90, 1.0, 3.0),
    ):
        for _ in range(count):
            kind, size_m = str(rng.choice(kinds)), rng.uniform(low, high)
            sprite = plant_sprites(kind, int(rng.integers(6)))[0]
            size = (
                max(4, round(size_m * sprite.shape[1] / sprite.shape[0] * TEXTURE_PX_PER_M)),
                max(4, round(size_m / tall_m * rows)),
            )
            tint = np.array([*rng.uniform(0.7, 1.2, 3), 1], np.float32)
            sprite = cv2.resize(sprite, size, interpolation=cv2.INTER_AREA) * tint
            where = (np.arange(size[0]) + rng.integers(columns)) % columns
            below = picture[rows - size[1] :, where]
            picture[rows - size[1] :, where] = below * (1 - sprite[..., 3:]) + sprite
    return picture


_PAINTERS = {
    "rock": _rock,
    "wood": _wood,
    "concrete": _concrete,
    "top": _concrete_top,
    "kerb": _kerb,
    "kerb top": _kerb_top,
    "rail": _rail,
    "handrail": _handrail,
    "grass": _grass,
}
