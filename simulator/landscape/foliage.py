"""Sprites of trees and bushes: seeded images of single plants with a transparent background.

A crown consists of lumps, a lump of leaf clusters, a cluster of leaves. Each leaf is a small polygon: bright where its
cluster and its lump face the sun, nearly black inside the crown and below. Branches connect the trunk with the lumps.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from simulator.disk_cache import cached_array
from simulator.painting import noise
from simulator.painting.noise import fractal_noise

# Direction to the sun in a sprite (x right, y towards the viewer, z up): upper left, slightly behind the viewer.
# Sprites are mirrored where the sun is on the other side.
SUN_IN_SPRITE = np.array([-0.55, 0.35, 0.76])
SPRITE_ROWS = 640
_OVERSAMPLING = 2


@dataclass(frozen=True)
class Species:
    """Shape and colour of a species: lengths as shares of its height, colours as linear RGB reflectance."""

    crown_width: float
    crown_bottom: float
    lumps: int
    lump_radius: float
    leaf_size: float
    leaves: int
    sun_colour: tuple[float, float, float]
    shade_colour: tuple[float, float, float]
    bark_colour: tuple[float, float, float] = (0.12, 0.09, 0.07)
    trunk_width: float = 0.035
    taper: float = 0.0
    openness: float = 0.2


SPECIES = {
    "oak": Species(1.0, 0.14, 40, 0.135, 0.0036, 44000, (0.150, 0.145, 0.042), (0.008, 0.010, 0.004), openness=0.15),
    "eucalyptus": Species(0.66, 0.16, 44, 0.10, 0.0033, 42000, (0.165, 0.155, 0.062), (0.010, 0.011, 0.007),
                          (0.30, 0.26, 0.21), openness=0.35),
    "plane": Species(1.05, 0.2, 70, 0.085, 0.0031, 34000, (0.16, 0.13, 0.058), (0.022, 0.019, 0.012),
                     (0.16, 0.125, 0.10), openness=0.9),
    "cypress": Species(0.30, 0.03, 60, 0.07, 0.0034, 32000, (0.062, 0.080, 0.030), (0.006, 0.009, 0.005),
                       taper=0.85, openness=0.1),
    "redwood": Species(0.46, 0.06, 70, 0.075, 0.0032, 38000, (0.070, 0.088, 0.032), (0.006, 0.009, 0.005),
                       (0.10, 0.06, 0.045), taper=0.8),
    "bush": Species(1.45, -0.12, 34, 0.20, 0.0060, 44000, (0.175, 0.175, 0.050), (0.010, 0.013, 0.005), openness=0.1),
    "scrub": Species(1.9, -0.12, 34, 0.19, 0.0075, 26000, (0.21, 0.165, 0.075), (0.026, 0.022, 0.012), openness=0.4),
}  # fmt: skip


@lru_cache(maxsize=32)
def plant_sprites(species: str, seed: int) -> tuple[np.ndarray, ...]:
    """Image pyramid (rows, columns, 4) float32 of one plant: linear RGB times coverage, and coverage.

    The foot is in the middle of the bottom edge, the top at the top edge. The first level has SPRITE_ROWS rows, each
    further level half as many. `species` is a name in `SPECIES`; each seed gives another plant of it.
    """
    sprites = [plant_picture(species, seed)]
    while sprites[-1].shape[0] > 10:
        size = (max(1, sprites[-1].shape[1] // 2), sprites[-1].shape[0] // 2)
        sprites.append(cv2.resize(sprites[-1], size, interpolation=cv2.INTER_AREA))
    for sprite in sprites:
        sprite.setflags(write=False)
    return tuple(sprites)


def sprite_level(sprites: tuple[np.ndarray, ...], rows: float) -> np.ndarray:
    """Smallest level of an image pyramid with at least `rows` rows; the largest one if there is none."""
    return next((sprite for sprite in reversed(sprites) if sprite.shape[0] >= rows), sprites[0])


def plant_picture(species: str, seed: int) -> np.ndarray:
    """Full-size image of a plant, from the disk cache."""
    sources = [Path(__file__), Path(noise.__file__)]
    return cached_array(f"plants/{species}-{seed}", sources, lambda: _paint_plant(species, seed))


def _paint_plant(species: str, seed: int) -> np.ndarray:
    kind = SPECIES[species]
    rng = np.random.default_rng([seed, sorted(SPECIES).index(species)])
    rows = SPRITE_ROWS * _OVERSAMPLING
    canvas = np.zeros((rows, int(rows * (kind.crown_width * 1.2 + 0.1)), 4), np.float32)
    lumps = _place_lumps(kind, rng)
    _draw_branches(canvas, kind, lumps, rng)
    _draw_leaves(canvas, kind, lumps, rng)
    return cv2.resize(canvas, None, fx=1 / _OVERSAMPLING, fy=1 / _OVERSAMPLING, interpolation=cv2.INTER_AREA)


def _place_lumps(kind: Species, rng: np.random.Generator) -> np.ndarray:
    """Lumps (lumps, 4): centre (x right, y towards the viewer, z up) and radius, as shares of the plant's height."""
    direction = rng.standard_normal((kind.lumps, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    # Square root, for more lumps near the surface of the crown, where the leaves are.
    reach = np.sqrt(rng.uniform(0.15, 1.0, kind.lumps))
    unit = direction * reach[:, None]
    if kind.taper:
        # Slender crowns are filled from bottom to top without gaps.
        unit[:, 2] = np.linspace(-0.98, 0.98, kind.lumps)
    radius = kind.lump_radius * rng.uniform(0.65, 1.25, kind.lumps)
    middle, half = (1 + kind.crown_bottom) / 2, (1 - kind.crown_bottom) / 2
    z = middle + unit[:, 2] * np.maximum(half - radius, 0.02)
    narrowing = 1 - kind.taper * (z - kind.crown_bottom) / (1 - kind.crown_bottom)
    width = (kind.crown_width / 2 - kind.lump_radius * 0.7) * np.clip(narrowing, 0.08, 1)
    # Uneven outline: some large sectors of the crown are wider than others.
    sway = 1 + 0.22 * (1 - kind.taper) * np.sin(3 * np.arctan2(unit[:, 2], unit[:, 0]) + rng.uniform(0, 6.28))
    lumps = np.column_stack([unit[:, 0] * width * sway, unit[:, 1] * width, z, radius * (0.35 + 0.65 * narrowing)])
    # One lump at the top, so that the plant has its nominal height.
    top = np.argmax(lumps[:, 2])
    lumps[top] = [rng.uniform(-0.1, 0.1) * width[top], 0, 1 - lumps[top, 3] * 0.9, lumps[top, 3]]
    return lumps[np.argsort(lumps[:, 1], kind="stable")]


def _to_canvas(canvas: np.ndarray, points: np.ndarray) -> np.ndarray:
    rows, columns = canvas.shape[:2]
    return np.column_stack([columns / 2 + points[:, 0] * rows, rows * (1 - points[:, 2])])


def _draw_branches(canvas: np.ndarray, kind: Species, lumps: np.ndarray, rng: np.random.Generator) -> None:
    """Draw the trunk, a few limbs, and a branch from a limb to each lump."""
    rows = canvas.shape[0]
    fork = np.array([0.0, 0, max(kind.crown_bottom, 0.0) * rng.uniform(0.7, 1.0) + 0.02])
    bend = rng.uniform(-0.012, 0.012)
    t = np.linspace(0, 1, 14)[:, None]

    def limb(start: np.ndarray, end: np.ndarray, thick: float, thin: float) -> np.ndarray:
        rise = 0.22 * np.linalg.norm(end - start)
        middle = 0.5 * (start + end) + [-0.25 * (end[0] - start[0]), 0, rise] + rng.normal(0, 0.012, 3)
        curve = (1 - t) ** 2 * start + 2 * t * (1 - t) * middle + t**2 * end
        _draw_limb(canvas, _to_canvas(canvas, curve), (thick + (thin - thick) * t[:, 0]) * rows, kind.bark_colour)
        return curve

    ends = lumps[:, :3] + [0, 0, 0.3] * lumps[:, 3:4]
    chosen = rng.choice(len(lumps), min(6, len(lumps)), replace=False)
    mains = [limb(fork, ends[i], 0.55 * kind.trunk_width, 0.15 * kind.trunk_width) for i in chosen]
    for i in np.setdiff1d(np.arange(len(lumps)), chosen):
        # A branch starts at the limb that is closest, preferably below its end.
        joints = np.array([curve[rng.integers(4, 11)] for curve in mains])
        joint = joints[
            np.argmin(np.linalg.norm(joints - ends[i], axis=1) + 2 * np.maximum(joints[:, 2] - ends[i, 2], 0))
        ]
        limb(joint, ends[i], 0.24 * kind.trunk_width, 0.05 * kind.trunk_width)
    trunk_z = np.linspace(0, fork[2] + 0.05, 8)
    trunk = np.column_stack([bend * np.sin(np.linspace(0, 3, 8)), np.zeros(8), trunk_z])
    width = kind.trunk_width * (1 + 0.5 * np.exp(-np.linspace(0, 8, 8)))
    _draw_limb(canvas, _to_canvas(canvas, trunk), width * rows, kind.bark_colour)
    # Furrows of the bark along the stem.
    furrows = fractal_noise((rows // 2, canvas.shape[1] // 2), rng, cell_px=(20, 4.5), octaves=2, gain=0.7)
    furrows = cv2.resize(furrows, canvas.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    painted = np.flatnonzero(cv2.extractChannel(canvas, 3))
    bark = np.clip(1 + 0.28 * furrows.ravel()[painted], 0.3, 1.8)
    # Channel by channel, because numpy is slow where the innermost axis has three elements.
    for colour in canvas.reshape(-1, 4).T[:3]:
        colour[painted] *= bark


def _draw_limb(canvas: np.ndarray, path: np.ndarray, width_px: np.ndarray, colour: tuple) -> None:
    """Draw a tapering limb in strips from sunlit to shaded."""
    across = np.column_stack([-np.gradient(path[:, 1]), np.gradient(path[:, 0])])
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-6)
    # Strips cross the limb from its left side to its right side.
    across *= -np.sign(across[len(across) // 2, 0] or 1)
    edges = np.linspace(0.5, -0.5, 6)
    for outer, inner, light in zip(edges[:-1], edges[1:], (0.75, 0.85, 0.6, 0.35, 0.16), strict=True):
        sides = [path + across * (edge * np.maximum(width_px, 1.5))[:, None] for edge in (outer, inner)]
        polygon = np.round(np.vstack([sides[0], sides[1][::-1]])).astype(np.int32)
        cv2.fillPoly(canvas, [polygon], (*(light * c for c in colour), 1.0))


def _draw_leaves(canvas: np.ndarray, kind: Species, lumps: np.ndarray, rng: np.random.Generator) -> None:
    """Draw all leaves from far to near."""
    position, light = _scatter_leaves(kind, lumps, rng)
    order = np.argsort(position[:, 1], kind="stable")
    position, light = position[order], light[order]
    count = len(position)
    # Each leaf is a diamond of random orientation and size. At image scale it stands for a spray of leaves.
    angle = rng.uniform(0, np.pi, count)
    size = kind.leaf_size * canvas.shape[0] * rng.uniform(0.5, 1.5, count)
    along = np.column_stack([np.cos(angle), np.sin(angle)]) * size[:, None]
    across = along[:, ::-1] * [1, -1] * rng.uniform(0.25, 0.7, count)[:, None]
    centre = _to_canvas(canvas, position)
    corners = np.stack([centre + along, centre + across, centre - along, centre - across], axis=1)
    corners = np.round(corners * 16).astype(np.int32)
    sunny, shaded = np.array(kind.sun_colour), np.array(kind.shade_colour)
    colour = shaded + 1.25 * (sunny - shaded) * light[:, None] ** 1.4
    colour *= np.exp(rng.normal(0, 0.15, (count, 1)) + rng.normal(0, 0.05, (count, 3)))
    for polygon, rgb in zip(corners, colour.tolist(), strict=True):
        cv2.fillConvexPoly(canvas, polygon, (*rgb, 1.0), cv2.LINE_8, 4)


def _scatter_leaves(kind: Species, lumps: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Positions (N, 3) of the leaves, and the light (N,) on each, 0 to 1."""
    share = lumps[:, 3] ** 2
    owner = rng.choice(len(lumps), kind.leaves, p=share / share.sum())
    clusters = 18
    cluster_direction = rng.standard_normal((len(lumps), clusters, 3))
    cluster_direction /= np.linalg.norm(cluster_direction, axis=2, keepdims=True)
    which = rng.integers(0, clusters, kind.leaves)
    outward = cluster_direction[owner, which]
    # Clipped, so that no leaf floats away from its cluster.
    scatter = (0.15 + 0.10 * kind.openness) * np.clip(rng.standard_normal((kind.leaves, 3)), -2.2, 2.2)
    local = outward * (0.8 + 0.2 * kind.openness) + scatter
    position = lumps[owner, :3] + local * lumps[owner, 3:4] * [1, 1, 0.8]
    position[:, 2] = np.clip(position[:, 2], 0.002, 0.998)
    crown_middle = np.array([0, 0, (1 + kind.crown_bottom) / 2])
    crown_size = np.array([kind.crown_width / 2, kind.crown_width / 2, (1 - kind.crown_bottom) / 2])
    crown = (position - crown_middle) / crown_size
    facing = 0.58 * (local @ SUN_IN_SPRITE) + 0.38 * (crown @ SUN_IN_SPRITE)
    clump = rng.normal(0, 0.17, (len(lumps), clusters))[owner, which]
    light = 0.22 + 0.95 * facing + clump + rng.normal(0, 0.06, kind.leaves) + 0.15 * kind.openness
    # Leaves inside the crown are shaded by the others.
    depth = np.linalg.norm(crown, axis=1)
    light *= 0.25 + 0.75 * np.clip(depth, 0, 1)
    return position, np.clip(light, 0.0, 1.2)
