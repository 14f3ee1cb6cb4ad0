"""Shadow polygons of objects on the ground."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from simulator.landscape.foliage import SPECIES
from simulator.objects.overpass import BridgeSlice
from simulator.objects.scene_objects import Car, SceneObject, Sign, Tree, vertical_rectangle, yaw_rotation
from simulator.objects.vehicles import outline_points
from simulator.objects.walls import Wall


def shadow_polygons(objects: list[SceneObject], sun_direction: np.ndarray) -> list[np.ndarray]:
    """Polygons (N, 2) of the shadows on the ground, metres in the road frame, float32; their union is the shadow.

    A tree has a polygon for each lump of leaves. `sun_direction` (3,) points towards the sun, in the road frame.

    Raises
    ------
    ValueError
        If the sun is not above the horizon.
    """
    sun = np.asarray(sun_direction, float)
    if sun[2] <= 0:
        raise ValueError("the sun is at or below the horizon, so nothing casts a shadow; give a direction with z > 0.")
    offset_per_m = -sun[:2] / sun[2]
    return [polygon.astype(np.float32, copy=False) for item in objects for polygon in _shadows(item, offset_per_m)]


def _shadows(item: SceneObject, offset_per_m: np.ndarray) -> list[np.ndarray]:
    """Shadow polygons of one object; `offset_per_m` (2,) is the horizontal shadow offset for each metre of height."""
    if isinstance(item, (Wall, BridgeSlice)):
        return item.shadows(offset_per_m)
    place = np.array([item.x_m, item.y_m])
    if isinstance(item, Car):
        rings = outline_points(item.body) @ yaw_rotation(item.heading_rad).T
        return [_hull(place + rings[:, :2] + rings[:, 2:] * offset_per_m)]
    if isinstance(item, Tree):
        return _tree_shadows(item, place, offset_per_m)
    if isinstance(item, Sign):
        plate = vertical_rectangle(
            0, 0, item.width_m / 2, item.width_m / 2, item.bottom_m, item.bottom_m + item.height_m
        )
        pole = vertical_rectangle(0, 0, 0.05, 0.05, 0, item.bottom_m)
    else:
        half = item.width_m / 2
        plate, pole = vertical_rectangle(0, 0, half, half, 0, item.height_m), None
    return [_hull(place + part[:, :2] + part[:, 2:] * offset_per_m) for part in (plate, pole) if part is not None]


def _tree_shadows(tree: Tree, place: np.ndarray, offset_per_m: np.ndarray) -> list[np.ndarray]:
    """Irregular polygons of the lumps, with sun flecks between them, and the polygon of the trunk."""
    kind = SPECIES[tree.species]
    low = max(kind.crown_bottom, 0.0)
    share, aside, blot = _lumps(tree.species, tree.seed, tree.height_m)
    middle = place + aside + (share * tree.height_m + tree.base_m)[:, None] * offset_per_m
    # A lump is as tall as wide, so its shadow gets longer with a low sun.
    away = offset_per_m / max(np.linalg.norm(offset_per_m), 1e-9)
    outline = blot + 0.3 * np.linalg.norm(offset_per_m) * (blot @ away)[..., None] * away
    blots = list((middle[:, None] + outline).astype(np.float32))
    half = max(0.12, kind.trunk_width * tree.height_m / 2)
    trunk = vertical_rectangle(0, 0, half, half, 0, tree.height_m * (low + 0.3))
    return [*blots, _hull(place + trunk[:, :2] + trunk[:, 2:] * offset_per_m)]


@lru_cache(maxsize=512)
def _lumps(species: str, seed: int, height_m: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lumps of a tree: heights (N,) as shares, offsets from the trunk (N, 2) and outlines (N, 12, 2) in metres.

    Seeded, so they are the same in all frames.
    """
    kind, count = SPECIES[species], 45
    rng = np.random.default_rng([seed, 7])
    angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    low = max(kind.crown_bottom, 0.0)
    share = low + (1 - low) * rng.uniform(0.08, 0.92, count)
    reach = np.sqrt(rng.uniform(0, 1, count)) * kind.crown_width / 2 * height_m * (1 - kind.taper * share)
    toward = rng.uniform(0, 2 * np.pi, count)
    aside = reach[:, None] * np.column_stack([np.cos(toward), np.sin(toward)])
    size = height_m * kind.lump_radius * rng.uniform(0.2, 0.8, (count, 1)) * rng.uniform(0.3, 1.4, (count, 12))
    return share, aside, size[..., None] * np.column_stack([np.cos(angle), np.sin(angle)])


def _hull(points: np.ndarray) -> np.ndarray:
    return cv2.convexHull(points.astype(np.float32)).reshape(-1, 2)
