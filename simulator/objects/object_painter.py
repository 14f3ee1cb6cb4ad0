"""Paints all objects of a frame from far to near: vehicles, walls, bridges, trees and posts.

Objects are in the car's road frame (x forward, y left, z up, metres; the camera is above the origin). The direction of
the sun points towards the sun, in the same frame.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from lanes.camera import Camera
from simulator.backdrop import aerial_perspective
from simulator.light.sunlight import irradiance
from simulator.objects.overpass import BridgeSlice, paint_bridge_slice
from simulator.objects.scene_objects import MAX_OBJECT_M, Car, Post, SceneObject, Tree, vertical_rectangle
from simulator.objects.trees import paint_tree, project_trees
from simulator.objects.vehicles import paint_vehicle
from simulator.objects.walls import Wall, paint_wall
from simulator.painting.brush import Atmosphere, Canvas, paint_polygons

# Each segment of a wall is painted behind homogeneous air, so fog needs shorter segments than clear air.
CLEAR_GROWTH, FOG_GROWTH = 1.3, 1.12


def paint_objects(
    image: np.ndarray,
    camera: Camera,
    objects: list[SceneObject],
    *,
    sun_direction: np.ndarray,
    haze: float = 0.06,
    light_at: Callable[[np.ndarray], np.ndarray] | None = None,
    atmosphere_at: Callable[[float], Atmosphere] | None = None,
    crest: tuple[float, np.ndarray] | None = None,
) -> None:
    """Paint objects over an image (H, W, 3) float32 of linear RGB, from far to near, in place.

    `light_at` is a function from positions (N, 2) in the road frame to the light (N, 3) there, as a share of daylight
    (default: 1), `atmosphere_at` one from a distance in metres to the Atmosphere (default: `aerial_perspective` with
    `haze`, 1/km). `crest` are the distance of a crest, and the mask (H, W) of the ground on its near side, which hides
    the objects beyond.
    """
    crest_distance_m, near_side = crest or (0.0, None)
    bare = image if crest is None else image.copy()
    canvas = Canvas(image, camera)
    sun = np.asarray(sun_direction, float) / np.linalg.norm(sun_direction)
    parts = _sort_by_distance(objects, CLEAR_GROWTH if atmosphere_at is None else FOG_GROWTH)
    ends_px = {id(tree): ends for tree, ends in project_trees(canvas, [i for _, i in parts if isinstance(i, Tree)])}
    for (distance, item), light in zip(parts, _lights([item for _, item in parts], light_at), strict=True):
        if near_side is not None and distance < crest_distance_m:
            # The near side of the crest hides everything painted so far.
            image[near_side], near_side = bare[near_side], None
        air = aerial_perspective(distance, haze) if atmosphere_at is None else atmosphere_at(distance)
        if light is not None and not isinstance(item, Wall | BridgeSlice):
            air = air._replace(transmittance=air.transmittance * light[0])
        if isinstance(item, Wall):
            paint_wall(canvas, replace(item, light=light), sun, air)
        elif isinstance(item, BridgeSlice):
            paint_bridge_slice(canvas, item, sun, air)
        elif isinstance(item, Car):
            paint_vehicle(canvas, item, sun, air)
        elif not isinstance(item, Tree):
            _paint_post(canvas, item, sun, air)
        elif id(item) in ends_px:
            paint_tree(canvas, item, ends_px[id(item)], sun, air)
    if near_side is not None:
        image[near_side] = bare[near_side]


def _paint_post(canvas: Canvas, post: Post, sun: np.ndarray, air: Atmosphere) -> None:
    """Paint a post, and the arm and the head of a street lamp."""
    half, top = post.width_m / 2, post.height_m
    faces = [vertical_rectangle(0, 0, half, half, 0, top)]
    if post.arm_m:
        low, high = sorted((0.0, post.arm_m))
        faces.append(vertical_rectangle(0, 0, high, -low, top - 0.06, top + 0.06))
        faces.append(vertical_rectangle(0, post.arm_m, 0.35, 0.35, top - 0.12, top + 0.10))
    pixels = canvas.project_faces(np.array(faces) + [post.x_m, post.y_m, post.ground_height_m])
    colour = np.array(post.colour) * irradiance(np.array([[-1.0, 0, 0]]), sun) / 0.8
    paint_polygons(canvas, pixels, np.repeat(colour, len(faces), axis=0), atmosphere=air)


def _sort_by_distance(objects: list[SceneObject], growth: float) -> list[tuple[float, SceneObject]]:
    """Objects up to MAX_OBJECT_M with their distances, farthest first; walls are cut into segments.

    Of two objects at one distance, the later one in the list is in front.
    """
    parts: list[tuple[float, SceneObject]] = []
    for item in objects:
        segments = item.segments(growth=growth) if isinstance(item, Wall) else [item]
        parts += [(_distance(segment), segment) for segment in segments]
    return sorted((part for part in parts if part[0] < MAX_OBJECT_M), key=lambda part: -part[0])


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
    return [*np.split(light_at(np.concatenate([none, *places])), np.cumsum(counts)[:-1])] if objects else []


def _distance(item: SceneObject) -> float:
    return item.distance_m() if isinstance(item, (Wall, BridgeSlice)) else float(np.hypot(item.x_m, item.y_m))
