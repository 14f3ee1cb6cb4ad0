"""Trees and bushes: a trunk and a crown of lumps, which are painted and cast the shadow."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from simulator.objects.scene_objects import Tree, vertical_rectangle
from simulator.painting.brush import Atmosphere, Canvas, heights_above, paint_polygons

LUMPS = 45
BARK = (0.12, 0.09, 0.07)
# Painted lumps are larger and more even than those of the shadow, which leaves flecks of sun.
PAINTED_RADIUS = 1.5
OCTAGON = np.stack([f(np.arange(8) * np.pi / 4) for f in (np.cos, np.sin)], axis=-1)


@dataclass(frozen=True)
class Species:
    """Shape and colours of a species: lengths as shares of its height, linear RGB of lumps in the sun and in shade."""

    crown_width: float
    crown_bottom: float
    lump_radius: float
    sun_colour: tuple[float, float, float]
    shade_colour: tuple[float, float, float]
    taper: float = 0.0
    trunk_width: float = 0.035


SPECIES = {
    "oak": Species(1.0, 0.14, 0.135, (0.110, 0.108, 0.032), (0.012, 0.014, 0.006)),
    "eucalyptus": Species(0.66, 0.16, 0.10, (0.120, 0.115, 0.046), (0.014, 0.016, 0.010)),
    "plane": Species(1.05, 0.2, 0.085, (0.120, 0.100, 0.045), (0.024, 0.021, 0.013)),
    "cypress": Species(0.30, 0.03, 0.07, (0.048, 0.060, 0.024), (0.008, 0.011, 0.006), taper=0.85),
    "redwood": Species(0.46, 0.06, 0.075, (0.052, 0.066, 0.024), (0.008, 0.011, 0.006), taper=0.8),
    "bush": Species(1.45, -0.12, 0.20, (0.130, 0.130, 0.038), (0.014, 0.017, 0.007)),
    "scrub": Species(1.9, -0.12, 0.19, (0.160, 0.125, 0.058), (0.028, 0.024, 0.013)),
}


@dataclass(frozen=True, eq=False)
class Crown:
    """Lumps of a tree: heights (N,) as shares, offsets from the trunk (N, 2) and shadow outlines (N, 12, 2), metres."""

    share: np.ndarray
    aside_m: np.ndarray
    outline_m: np.ndarray


@lru_cache(maxsize=512)
def crown(species: str, seed: int, height_m: float) -> Crown:
    """Crown of a tree; seeded, so it is the same in all frames."""
    kind = SPECIES[species]
    rng = np.random.default_rng([seed, 7])
    angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    low = max(kind.crown_bottom, 0.0)
    share = low + (1 - low) * rng.uniform(0.08, 0.92, LUMPS)
    reach = np.sqrt(rng.uniform(0, 1, LUMPS)) * kind.crown_width / 2 * height_m * (1 - kind.taper * share)
    toward = rng.uniform(0, 2 * np.pi, LUMPS)
    aside = reach[:, None] * np.column_stack([np.cos(toward), np.sin(toward)])
    size = height_m * kind.lump_radius * rng.uniform(0.2, 0.8, (LUMPS, 1)) * rng.uniform(0.3, 1.4, (LUMPS, 12))
    return Crown(share, aside, size[..., None] * np.column_stack([np.cos(angle), np.sin(angle)]))


def tree_shadows(tree: Tree, offset_per_m: np.ndarray) -> list[np.ndarray]:
    """Polygons (N, 2) of the shadows of the lumps, with sun flecks between them, and of the trunk."""
    kind, place, lumps = SPECIES[tree.species], np.array([tree.x_m, tree.y_m]), crown(*_seeded(tree))
    middle = place + lumps.aside_m + (lumps.share * tree.height_m + tree.base_m)[:, None] * offset_per_m
    # A lump is as tall as wide, so its shadow gets longer with a low sun.
    away = offset_per_m / max(np.linalg.norm(offset_per_m), 1e-9)
    outline = lumps.outline_m + 0.3 * np.linalg.norm(offset_per_m) * (lumps.outline_m @ away)[..., None] * away
    half = max(0.12, kind.trunk_width * tree.height_m / 2)
    trunk = vertical_rectangle(0, 0, half, half, 0, tree.height_m * (max(kind.crown_bottom, 0.0) + 0.3))
    shadow = cv2.convexHull((place + trunk[:, :2] + trunk[:, 2:] * offset_per_m).astype(np.float32))
    return [*(middle[:, None] + outline).astype(np.float32), shadow.reshape(-1, 2)]


def _seeded(tree: Tree) -> tuple[str, int, float]:
    return tree.species, tree.seed, tree.height_m


def project_trees(canvas: Canvas, trees: list[Tree]) -> list[tuple[Tree, np.ndarray]]:
    """Trees in the view of the lens, with the pixels (2, 2) of foot and top; all in one call, because they are many."""
    if not trees:
        return []
    foot = np.array([[t.x_m, t.y_m, t.base_m + t.ground_height_m] for t in trees])
    # Points a little above the foot: the top can be outside the view of a lens that sees the trunk.
    ends = foot[:, None] + np.array([[0, 0, 0.9], [0, 0, 1.9]])
    seen = np.flatnonzero((heights_above(canvas.frustum, ends) >= -1e-9).all(axis=(1, 2)))
    pixels = canvas.camera.road_to_pixels(ends[seen].reshape(-1, 3)).reshape(-1, 2, 2)
    rise, height = pixels[:, 1] - pixels[:, 0], np.array([t.height_m for t in trees])[seen, None]
    lines = np.stack([pixels[:, 0] - 0.9 * rise, pixels[:, 0] + (height - 0.9) * rise], axis=1)
    return [(trees[i], line) for i, line in zip(seen, lines, strict=True)]


def paint_tree(canvas: Canvas, tree: Tree, ends_px: np.ndarray, sun: np.ndarray, air: Atmosphere) -> None:
    """Paint a tree between its projected foot and top (2, 2), from the far lumps to the near ones."""
    kind, lumps = SPECIES[tree.species], crown(*_seeded(tree))
    up = (ends_px[1] - ends_px[0]) / tree.height_m
    right = np.array([-up[1], up[0]])
    to_eye = -np.array([tree.x_m, tree.y_m]) / max(np.hypot(tree.x_m, tree.y_m), 1e-6)
    order = np.argsort(lumps.aside_m @ to_eye, kind="stable")
    aside, share = lumps.aside_m[order], lumps.share[order]
    across = aside @ np.array([-to_eye[1], to_eye[0]])
    cast = np.linalg.norm(lumps.outline_m[order], axis=2).mean(axis=1)
    radius = PAINTED_RADIUS * np.sqrt(cast * kind.lump_radius * tree.height_m)
    outline = radius[:, None, None] * (OCTAGON[..., :1] * right + OCTAGON[..., 1:] * up)
    # The top of the crown stays below the height of the tree.
    height = np.minimum(share * tree.height_m, tree.height_m - radius)
    blots = ends_px[0] + across[:, None, None] * right + height[:, None, None] * up + outline
    half, fork = kind.trunk_width * tree.height_m / 2, max(kind.crown_bottom, 0.0) + 0.3
    corners = np.array([[-half, 0], [-half, fork * tree.height_m], [half, fork * tree.height_m], [half, 0]])
    trunk = ends_px[0] + corners[:, :1] * right + corners[:, 1:] * up
    # Lumps are light where their side of the crown faces the sun.
    side = np.column_stack([2 * aside / (kind.crown_width * tree.height_m), 2 * share - 1])
    light = np.clip(0.40 + 0.45 * side @ sun, 0.05, 1)[:, None]
    shade, bright = np.array(kind.shade_colour), np.array(kind.sun_colour)
    colours = np.vstack([0.5 * np.array(BARK), shade + light * (bright - shade)])
    paint_polygons(canvas, [trunk, *blots], colours, atmosphere=air)
