"""Paints all objects of a frame from near to far: vehicles, walls, bridges, trees, signs and posts.

Objects are in the car's road frame (x forward, y left, z up, metres; the camera is above the origin). The direction of
the sun points towards the sun, in the same frame.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from lanes.camera import Camera
from simulator.landscape.sky import aerial_perspective
from simulator.objects.overpass import BridgeSlice, paint_bridge_slice
from simulator.objects.scene_objects import Car, Post, SceneObject, Sign, Tree
from simulator.objects.sign_painter import paint_post, paint_sign
from simulator.objects.tree_painter import ProjectedTree, paint_tree, project_trees
from simulator.objects.vehicle_painter import paint_vehicle
from simulator.objects.wall_painter import paint_wall
from simulator.objects.walls import Wall
from simulator.painting.brush import Atmosphere

# Objects farther than this are not painted: a car is 4 pixels wide there.
MAX_OBJECT_M = 600.0
# Each segment of a wall is painted behind homogeneous air, so fog needs shorter segments than clear air.
CLEAR_GROWTH, FOG_GROWTH = 1.3, 1.12
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
    """Paint objects behind the content of a canvas, from near to far, so that covered pixels can be skipped.

    Parameters
    ----------
    picture : ndarray of shape (4, H, W), float32
        Canvas from `brush.new_canvas`, changed.
    camera : Camera
        With its pose; the lens distorts objects and road alike.
    haze : float
        Extinction of the air, 1/km.
    light_at : callable, optional
        Function from positions (N, 2) in the road frame to the light (N, 3) there, as a share of daylight (default 1).
    atmosphere_at : callable, optional
        Function from a distance in metres to the Atmosphere. Default: `aerial_perspective` with `haze`.
    crest : (float, ndarray of shape (H, W), bool), optional
        Distance of a crest, and mask of the ground on its near side, which hides the objects beyond.

    Raises
    ------
    TypeError
        If an object has an unknown type.
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
    if isinstance(item, (Wall, BridgeSlice)):
        return item.distance_m()
    if not isinstance(item, (Car, Tree, Sign, Post)):
        raise TypeError(f"a {type(item).__name__} cannot be drawn; give Car, Wall, Tree, Sign or Post.")
    return float(np.hypot(item.x_m, item.y_m))
