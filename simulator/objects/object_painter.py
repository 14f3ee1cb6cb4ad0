"""Paints all objects of a frame from near to far: vehicles, walls, bridges, trees, signs and posts.

Objects are in the car's road frame (x forward, y left, z up, metres; the camera is above the origin). The direction of
the sun points towards the sun, in the same frame.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import ArrayLike

from lanes.camera import Camera
from simulator.landscape.backdrop import aerial_perspective
from simulator.landscape.foliage import plant_sprites, sprite_level
from simulator.light.shading import irradiance
from simulator.objects.overpass import BridgeSlice, paint_bridge_slice
from simulator.objects.scene_objects import MAX_OBJECT_M, Car, Post, SceneObject, Sign, Tree, vertical_rectangle
from simulator.objects.vehicles import paint_vehicle
from simulator.objects.walls import Wall, paint_wall
from simulator.painting.brush import (
    Atmosphere,
    composite_behind,
    frustum_planes,
    inside_planes,
    paint_polygons,
    project_faces,
    split_channels,
    uncovered_window,
)

SIGN_COLOURS = {
    "green": ((0.012, 0.16, 0.085), (0.75, 0.77, 0.74)),
    "blue": ((0.015, 0.07, 0.26), (0.75, 0.77, 0.78)),
    "speed": ((0.74, 0.74, 0.72), (0.03, 0.03, 0.03)),
    "warning": ((0.72, 0.40, 0.012), (0.03, 0.03, 0.02)),
}
# Each segment of a wall is painted behind homogeneous air, so fog needs shorter segments than clear air.
CLEAR_GROWTH, FOG_GROWTH = 1.3, 1.12


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


def paint_sign(picture: np.ndarray, camera: Camera, sign: Sign, sun: np.ndarray, air: Atmosphere) -> None:
    """Paint the posts, plate, border and text of a sign behind the content of a canvas, in place."""
    field, ink = (np.array(c) for c in SIGN_COLOURS[sign.kind])
    light = irradiance(np.array([[-1.0, 0, 0]]), sun)[0] / 0.8
    half, low, tall = sign.width_m / 2, sign.bottom_m, sign.height_m
    faces: list[np.ndarray] = []
    colours: list[ArrayLike] = []
    feet = (-0.6 * half, 0.6 * half) if half > 0.7 else (0.0,)
    for foot in feet:
        faces.append(vertical_rectangle(sign.x_m + 0.05, sign.y_m + foot, 0.04, 0.04, 0, low + 0.9 * tall))
        colours.append((0.25, 0.24, 0.22))
    if sign.kind == "warning":
        for size, colour in ((1.0, field), (0.93, ink), (0.89, field), (0.28, ink)):
            r, m = size * half, low + half
            diamond = [[0, 0, m - r], [0, -r, m], [0, 0, m + r], [0, r, m]]
            faces.append(np.array(diamond) + [sign.x_m, sign.y_m, 0])
            colours.append(colour)
    else:
        for inset, colour in ((0.0, field), (0.035 * tall, ink), (0.07 * tall, field)):
            edge = half - inset
            faces.append(vertical_rectangle(sign.x_m, sign.y_m, edge, edge, low + inset, low + tall - inset))
            colours.append(colour)
        lines, colour = _writing(sign), ink
        faces += lines
        colours += [colour] * len(lines)
    pixels = project_faces(camera, np.array(faces) + [0, 0, sign.ground_height_m])
    paint_polygons(picture, pixels, np.array(colours) * light, atmosphere=air)


def _writing(sign: Sign) -> list[np.ndarray]:
    """Uneven strokes instead of letters, which a dashcam does not resolve."""
    rng = np.random.default_rng([int(abs(sign.y_m) * 10), int(sign.width_m * 100)])
    rows = 1 if sign.kind == "speed" else 2
    letter = 0.42 * sign.height_m if rows == 1 else 0.22 * sign.height_m
    strokes = []
    for row in range(rows):
        bottom = sign.bottom_m + sign.height_m * ((0.18, 0.56)[row] if rows == 2 else 0.18)
        reach = sign.width_m * (0.30 if rows == 1 else 0.40) * rng.uniform(0.75, 1.0)
        y = reach
        while y > -reach:
            width = letter * rng.uniform(0.10, 0.22)
            top = bottom + letter * rng.choice([0.7, 1.0])
            strokes.append(vertical_rectangle(sign.x_m - 0.01, sign.y_m + y, 0, width, bottom, top))
            y -= width + letter * rng.uniform(0.14, 0.4)
    return strokes


def paint_post(picture: np.ndarray, camera: Camera, post: Post, sun: np.ndarray, air: Atmosphere) -> None:
    """Paint a post as three vertical strips from light to shade, with the arm of a lamp, in place."""
    half = post.width_m / 2
    edges = np.linspace(-half, half, 4)
    faces = [
        vertical_rectangle(post.x_m, post.y_m, b, -a, 0, post.height_m)
        for a, b in zip(edges[:-1], edges[1:], strict=True)
    ]
    normals = np.array([[-0.5, -0.86, 0], [-1.0, 0, 0], [-0.5, 0.86, 0]])
    if post.arm_m:
        low, high = sorted((0.0, post.arm_m))
        top = post.height_m
        faces.append(vertical_rectangle(post.x_m, post.y_m, high, -low, top - 0.06, top + 0.06))
        end = post.arm_m
        faces.append(vertical_rectangle(post.x_m, post.y_m, end + 0.35, -end + 0.35, top - 0.12, top + 0.10))
        normals = np.vstack([normals, [[-1.0, 0, 0], [-1.0, 0, 0]]])
    colours = np.array(post.colour) / 0.8 * irradiance(normals, sun)
    pixels = project_faces(camera, np.array(faces) + [0, 0, post.ground_height_m])
    paint_polygons(picture, pixels, colours, atmosphere=air)


PAINTERS: dict[type, Callable[..., None]] = {
    Wall: paint_wall,
    BridgeSlice: paint_bridge_slice,
    Car: paint_vehicle,
    ProjectedTree: paint_tree,
    Sign: paint_sign,
    Post: paint_post,
}


def paint_objects(
    picture: np.ndarray,
    camera: Camera,
    objects: list[SceneObject],
    *,
    sun_direction: np.ndarray,
    haze: float = 0.06,
    light_at: Callable[[np.ndarray], np.ndarray] | None = None,
    atmosphere_at: Callable[[float], Atmosphere] | None = None,
    crest: tuple[float, np.ndarray] | None = None,
) -> None:
    """Paint objects behind the content of a canvas (4, H, W), from near to far, so that covered pixels can be skipped.

    `light_at` is a function from positions (N, 2) in the road frame to the light (N, 3) there, as a share of daylight
    (default: 1), `atmosphere_at` one from a distance in metres to the Atmosphere (default: `aerial_perspective` with
    `haze`, 1/km). `crest` are the distance of a crest, and the mask (H, W) of the ground on its near side, which hides
    the objects beyond.
    """
    crest_distance_m, near_side = crest or (np.inf, None)
    sun = np.asarray(sun_direction, float) / np.linalg.norm(sun_direction)
    parts = _sort_by_distance(camera, objects, CLEAR_GROWTH if atmosphere_at is None else FOG_GROWTH)
    road = 0.0
    for (distance, item), light in zip(parts, _lights([item for _, item in parts], light_at), strict=True):
        if distance >= crest_distance_m:
            # The near side of the crest hides everything from here on.
            road, crest_distance_m = picture[3] * near_side, np.inf
            picture[3] -= road
        air = aerial_perspective(distance, haze) if atmosphere_at is None else atmosphere_at(distance)
        if isinstance(item, Wall):
            item = replace(item, light=light)
        elif light is not None and not isinstance(item, BridgeSlice):
            air = air._replace(transmittance=air.transmittance * light[0])
        PAINTERS[type(item)](picture, camera, item, sun, air)
    picture[3] += road


def _sort_by_distance(
    camera: Camera, objects: list[SceneObject], growth: float
) -> list[tuple[float, SceneObject | ProjectedTree]]:
    """Objects up to MAX_OBJECT_M with their distances, nearest first; walls are cut into segments."""
    parts: list[tuple[float, SceneObject | ProjectedTree]] = []
    for item in [item for item in objects if not isinstance(item, Tree)] + project_trees(camera, objects):
        segments = item.segments(growth=growth) if isinstance(item, Wall) else [item]
        parts += [(_distance(segment), segment) for segment in segments]
    # Sorted backwards and reversed: of two objects at one distance, the later one in the list is in front.
    return sorted((part for part in parts if part[0] < MAX_OBJECT_M), key=lambda part: -part[0])[::-1]


def _lights(objects: list[SceneObject], light_at: Callable[[np.ndarray], np.ndarray] | None) -> list[np.ndarray | None]:
    """Light (N, 3) at each object, or along the path of a wall; None in the open. Bridge slices have their own."""
    if light_at is None:
        return [None] * len(objects)
    none = np.empty((0, 2))
    places = [
        np.asarray(t.path_m)[:, :2] if isinstance(t, Wall) else none if isinstance(t, BridgeSlice) else [[t.x_m, t.y_m]]
        for t in objects
    ]
    counts = [len(p) for p in places]
    # One call for all positions, because there are hundreds of objects.
    if not any(counts):
        return [None] * len(objects)
    return [*np.split(light_at(np.concatenate(places)), np.cumsum(counts)[:-1])]


def _distance(item: SceneObject) -> float:
    return item.distance_m() if isinstance(item, (Wall, BridgeSlice)) else float(np.hypot(item.x_m, item.y_m))
