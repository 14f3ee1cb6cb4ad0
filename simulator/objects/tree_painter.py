"""Paints trees and bushes: sprites warped to the projected foot and top."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from lanes.camera import Camera
from simulator.landscape.foliage import plant_sprites, sprite_level
from simulator.objects.scene_objects import SceneObject, Tree
from simulator.painting.brush import (
    Atmosphere,
    composite_behind,
    frustum_planes,
    inside_planes,
    split_channels,
    uncovered_window,
)


@dataclass(frozen=True, eq=False, kw_only=True)
class ProjectedTree(Tree):
    """Tree with the pixels (2, 2) of its foot and its top."""

    ends_px: np.ndarray


def project_trees(camera: Camera, objects: list[SceneObject]) -> list[ProjectedTree]:
    """Trees in the view of the lens, projected in one call, because there are hundreds."""
    trees = [item for item in objects if isinstance(item, Tree)]
    if not trees:
        return []
    foot, height = (
        np.array([[t.x_m, t.y_m, t.base_m + t.ground_height_m] for t in trees]),
        np.array([t.height_m for t in trees]),
    )
    up = np.array([0, 0, 1.0])
    ends = np.stack([foot, np.column_stack([foot[:, :2], foot[:, 2] + height])], axis=1)
    around = foot[:, None] + [0.9 * up, 1.9 * up]
    planes = frustum_planes(camera)
    near_foot, whole = (np.all(inside_planes(points, planes), axis=1) for points in (around, ends))
    pixels = camera.road_to_pixels(np.where(whole[:, None, None], ends, around).reshape(-1, 3)).reshape(-1, 2, 2)
    # Foot or top can be outside the view of a lens that sees the crown: extrapolate from points at mid height.
    rise = pixels[:, 1] - pixels[:, 0]
    extended = np.stack([pixels[:, 0] - 0.9 * rise, pixels[:, 0] + (height - 0.9)[:, None] * rise], axis=1)
    pixels = np.where(whole[:, None, None], pixels, extended)
    seen = [(tree, ends_px) for tree, ends_px, in_sight in zip(trees, pixels, near_foot, strict=True) if in_sight]
    return [ProjectedTree(**vars(tree), ends_px=ends_px) for tree, ends_px in seen]


def paint_tree(picture: np.ndarray, camera: Camera, tree: ProjectedTree, sun: np.ndarray, air: Atmosphere) -> None:
    """Paint the sprite of a tree between its projected foot and top, in place."""
    ends_px = tree.ends_px
    sprite = sprite_level(_narrow_sprites(tree.species, tree.seed), float(np.linalg.norm(ends_px[1] - ends_px[0])))
    height, width = sprite.shape[:2]
    up = (ends_px[1] - ends_px[0]) / height
    # The sprite is lit from its left. The sun's side of the road decides on mirroring, not its side of the line of
    # sight, so that no tree flips while the car passes.
    right = np.array([-up[1], up[0]]) * (-1 if sun[1] < 0 else 1)
    place = np.column_stack([right, -up, ends_px[1] - right * (width - 1) / 2])
    corners = np.array([[0, 0, 1], [width, 0, 1], [0, height, 1], [width, height, 1]]) @ place.T
    low = np.maximum(np.floor(corners.min(axis=0)).astype(int) - 1, 0)
    high = np.minimum(np.ceil(corners.max(axis=0)).astype(int) + 2, [picture.shape[2], picture.shape[1]])
    seen = uncovered_window(picture[3, low[1] : high[1], low[0] : high[0]]) if (high > low).all() else None
    if seen is None:
        return
    rows, columns = seen
    left, top = int(low[0] + columns.start), int(low[1] + rows.start)
    place[:, 2] -= [left, top]
    size = (int(columns.stop - columns.start), int(rows.stop - rows.start))
    layer = cv2.warpAffine(sprite, place, size, flags=cv2.INTER_LINEAR)
    composite_behind(picture, split_channels(layer), left, top, atmosphere=air)


@lru_cache(maxsize=64)
def _narrow_sprites(species: str, seed: int) -> tuple[np.ndarray, ...]:
    """Sprites of a plant without their empty columns on both sides."""
    sprites = plant_sprites(species, seed)
    filled = [np.any(sprite[..., 3] > 0, axis=0) for sprite in sprites]
    bare = [np.argmax(columns | columns[::-1]) for columns in filled]
    return tuple(sprite[:, n : sprite.shape[1] - n] for sprite, n in zip(sprites, bare, strict=True))
