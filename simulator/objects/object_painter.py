"""The pictures of things beside and on the road: cars, barriers, trees, signs, posts.

Every thing is given in the car's road frame (x forward, y left, z up, metres; the camera above the origin). The sun's
direction points towards the sun, in the same frame.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np

from lanes.camera.camera import Camera
from simulator.landscape.foliage import plant_sprites
from simulator.landscape.sky import aerial_perspective
from simulator.light.shading import irradiance, shade_faces
from simulator.objects.cars import BODY, ON_BODY
from simulator.objects.overpass import BridgeSlice, paint_bridge_slice
from simulator.objects.scene_objects import Car, Post, SceneObject, Sign, Tree, vertical_rectangle, yaw_rotation
from simulator.objects.shadows import shadow_polygons
from simulator.objects.vehicles import facet_width_m, footprint, outline_points, vehicle_faces
from simulator.objects.walls import Wall, paint_wall
from simulator.painting.brush import (
    composite_behind,
    frustum_planes,
    inside_planes,
    outside_picture,
    paint_polygons,
    project_faces,
    split_channels,
    uncovered_window,
)

__all__ = ["Car", "Post", "Sign", "SceneObject", "Tree", "Wall", "paint_objects", "shadow_polygons"]

# Things farther than this are not worth drawing: a car is 4 pixels wide there.
MAX_OBJECT_M = 600.0
SIGN_COLOURS = {
    "green": ((0.012, 0.16, 0.085), (0.75, 0.77, 0.74)),
    "blue": ((0.015, 0.07, 0.26), (0.75, 0.77, 0.78)),
    "speed": ((0.74, 0.74, 0.72), (0.03, 0.03, 0.03)),
    "warning": ((0.72, 0.40, 0.012), (0.03, 0.03, 0.02)),
}


def paint_objects(
    picture: np.ndarray,
    camera: Camera,
    objects: list[SceneObject],
    *,
    sun_direction: np.ndarray,
    haze: float = 0.06,
    light_at: Callable[[np.ndarray], np.ndarray] | None = None,
    atmosphere_at: Callable[[float], tuple[np.ndarray, np.ndarray]] | None = None,
    crest: tuple[float, np.ndarray] | None = None,
) -> None:
    """Paint things behind what is in a picture, the nearest first: what they hide need not be painted.

    Parameters
    ----------
    picture : ndarray of shape (4, H, W), float32
        As from `brush.new_canvas`, changed.
    camera : Camera
        With a camera pose; its distortion bends the things as it bends the road.
    objects : list of Car, Wall, Tree, Sign, Post
        In the car's road frame.
    sun_direction : ndarray of shape (3,)
        Unit vector towards the sun, road frame.
    haze : float
        Extinction of the air, 1/km.
    light_at : callable, optional
        From places (N, 2) in the road frame to the light (N, 3) there, as a share of open daylight; all of it
        everywhere by default.
    atmosphere_at : callable, optional
        From a distance in metres to what `aerial_perspective` gives, instead of clear air with `haze`.
    crest : (float, ndarray of shape (H, W), bool), optional
        Distance of a crest of the road, and where its near side is: that hides the things beyond.

    Raises
    ------
    TypeError
        For a thing of another kind.
    """
    crest_distance_m, near_side = crest or (np.inf, None)
    sun = np.asarray(sun_direction, float) / np.linalg.norm(sun_direction)
    jobs = []
    for item in [item for item in objects if not isinstance(item, Tree)] + _planted(camera, objects):
        if isinstance(item, Wall):
            # All of a piece is behind the same air: thick air wants short pieces.
            segments = item.segments() if atmosphere_at is None else item.segments(growth=1.12)
        else:
            segments = [item]
        jobs += [(_distance(segment), segment) for segment in segments]
    # Backwards, so that of two things at one distance the later one is before the other.
    jobs = sorted((job for job in jobs if job[0] < MAX_OBJECT_M), key=lambda job: -job[0])[::-1]
    road = 0.0
    for (distance, item), light in zip(jobs, _lights([item for _, item in jobs], light_at), strict=True):
        if distance >= crest_distance_m:
            # From here on the near side of the crest hides all.
            road, crest_distance_m = picture[3] * near_side, np.inf
            picture[3] -= road
        through, air = aerial_perspective(distance, haze) if atmosphere_at is None else atmosphere_at(distance)
        if isinstance(item, Wall):
            item = replace(item, light=light)
        elif light is not None and not isinstance(item, BridgeSlice):
            through = through * light[0]
        _painter(item)(picture, camera, item, sun, (through, air))
    picture[3] += road


def _lights(objects: list[SceneObject], light_at: Callable[[np.ndarray], np.ndarray] | None) -> list[np.ndarray | None]:
    """The light (N, 3) where each thing stands, along the path of a wall; None in the open. A slab has its own."""
    if light_at is None:
        return [None] * len(objects)
    none = np.empty((0, 2))
    places = [
        np.asarray(t.path_m)[:, :2] if isinstance(t, Wall) else none if isinstance(t, BridgeSlice) else [[t.x_m, t.y_m]]
        for t in objects
    ]
    counts = [len(p) for p in places]
    # All places at once, because there are hundreds of things.
    return np.split(light_at(np.concatenate(places)), np.cumsum(counts)[:-1]) if any(counts) else [None] * len(objects)


def _distance(item: SceneObject) -> float:
    if isinstance(item, (Wall, BridgeSlice)):
        return item.distance_m()
    if not isinstance(item, (Car, Tree, Sign, Post)):
        raise TypeError(f"a {type(item).__name__} cannot be drawn; give Car, Wall, Tree, Sign or Post.")
    return float(np.hypot(item.x_m, item.y_m))


def _painter(item: SceneObject):
    painters = {
        Wall: paint_wall,
        BridgeSlice: paint_bridge_slice,
        Car: _paint_car,
        _Planted: _paint_tree,
        Sign: _paint_sign,
    }
    return (painters | {Post: _paint_post})[type(item)]


def _paint_car(picture: np.ndarray, camera: Camera, car: Car, sun: np.ndarray, air: tuple) -> None:
    """The faces that look at the camera, by layer and from far to near, and the contact shadow behind them."""
    turn = yaw_rotation(car.heading_rad)
    place = np.array([car.x_m, car.y_m, car.ground_height_m])
    if outside_picture(outline_points(car.body) @ turn.T + place, camera):
        return
    eye = (np.array([0, 0, camera.pose.height_m]) - place) @ turn
    distance = float(np.hypot(car.x_m, car.y_m))
    faces = vehicle_faces(car.body, car.paint, detail=1 if distance > 40 else 2)
    toward = np.flatnonzero(faces.flat_normal @ eye > faces.plane_distance)
    # What lies on the body keeps its order (plate on bumper); body and wheels go from far to near.
    layer = faces.layer[toward]
    away = faces.middle[toward] - eye
    apart = np.where(layer < ON_BODY, -np.einsum("ij,ij->i", away, away), 0)
    faces = faces.select(toward[np.lexsort((apart, layer))])
    colours = shade_faces(faces, eye, sun @ turn)
    ground = footprint(car.body)
    corners = np.concatenate([faces.corners, [ground * 1.03, ground * 0.97]]).reshape(-1, 3) @ turn.T + place
    pixels = project_faces(camera, corners.reshape(-1, 4, 3))
    cuts = np.searchsorted(faces.layer, [BODY, ON_BODY])
    # Facets are some 0.1 m wide: their shading is blended, the outline stays sharp.
    blend = facet_width_m(car.body) * camera.matrix[0, 0] / max(distance, 2)
    parts = (slice(0, cuts[0]), slice(*cuts), slice(cuts[1], len(colours)))
    for part, blend_px in zip(parts[::-1], (0.0, blend, 0.0), strict=True):
        paint_polygons(picture, pixels[part], colours[part], through=air[0], air=air[1], blend_px=blend_px)
    blur = float(np.clip(40 / max(distance, 1), 0.5, 4))
    dark = np.full((2, 3), 0.004)
    paint_polygons(
        picture, pixels[-2:], dark, opacity=np.array([0.55, 0.85]), through=air[0], air=air[1], softness_px=blur
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class _Planted(Tree):
    """A tree with the pixels (2, 2) of its foot and its top."""

    ends_px: np.ndarray


def _planted(camera: Camera, objects: list[SceneObject]) -> list[_Planted]:
    """The trees that the lens sees. All at once, because there are a hundred and each is little work."""
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
    near_foot, whole = (inside_planes(points, planes).all(axis=1) for points in (around, ends))
    pixels = camera.road_to_pixels(np.where(whole[:, None, None], ends, around).reshape(-1, 3)).reshape(-1, 2, 2)
    # Top and foot may be out of the lens's sight while the crown is in it: extend what is seen at mid height.
    rise = pixels[:, 1] - pixels[:, 0]
    extended = np.stack([pixels[:, 0] - 0.9 * rise, pixels[:, 0] + (height - 0.9)[:, None] * rise], axis=1)
    pixels = np.where(whole[:, None, None], pixels, extended)
    seen = [(tree, ends_px) for tree, ends_px, in_sight in zip(trees, pixels, near_foot, strict=True) if in_sight]
    return [_Planted(**vars(tree), ends_px=ends_px) for tree, ends_px in seen]


def _paint_tree(picture: np.ndarray, camera: Camera, tree: _Planted, sun: np.ndarray, air: tuple) -> None:
    """The plant's picture, placed by where its foot and its top are seen."""
    pixels = tree.ends_px
    rows = float(np.linalg.norm(pixels[1] - pixels[0]))
    sprites = _narrow_sprites(tree.species, tree.seed)
    sprite = next((s for s in reversed(sprites) if s.shape[0] >= rows), sprites[0])
    # The sprite is lit from its left. Mirrored by the side of the road on which the sun stands, not by the line of
    # sight, because a tree must not flip over while we drive past.
    _warp_sprite(picture, sprite, pixels, mirrored=sun[1] < 0, through=air[0], air=air[1])


@lru_cache(maxsize=64)
def _narrow_sprites(species: str, seed: int) -> tuple[np.ndarray, ...]:
    """The plant's pictures without the columns on both sides in which there is nothing."""
    sprites = plant_sprites(species, seed)
    filled = [(sprite[..., 3] > 0).any(axis=0) for sprite in sprites]
    bare = [np.argmax(columns | columns[::-1]) for columns in filled]
    return tuple(sprite[:, n : sprite.shape[1] - n] for sprite, n in zip(sprites, bare, strict=True))


def _warp_sprite(
    picture: np.ndarray, sprite: np.ndarray, ends_px: np.ndarray, *, mirrored: bool, **air: np.ndarray
) -> None:
    """Lay a sprite behind what is in the picture, its foot at the first point and its top at the second one."""
    height, width = sprite.shape[:2]
    up = (ends_px[1] - ends_px[0]) / height
    right = np.array([-up[1], up[0]]) * (-1 if mirrored else 1)
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
    composite_behind(picture, split_channels(layer), left, top, **air)


def _paint_sign(picture: np.ndarray, camera: Camera, sign: Sign, sun: np.ndarray, air: tuple) -> None:
    """Posts, plate, border and lines of writing."""
    if sign.kind not in SIGN_COLOURS:
        raise ValueError(f"there is no sign {sign.kind!r}; there are {', '.join(sorted(SIGN_COLOURS))}.")
    field, ink = (np.array(c) for c in SIGN_COLOURS[sign.kind])
    light = irradiance(np.array([[-1.0, 0, 0]]), sun)[0] / 0.8
    half, low, tall = sign.width_m / 2, sign.bottom_m, sign.height_m
    faces, colours = [], []
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
    paint_polygons(picture, pixels, np.array(colours) * light, through=air[0], air=air[1])


def _writing(sign: Sign) -> list[np.ndarray]:
    """Strokes in place of letters: at a dashcam's sharpness, lines of writing are rows of uneven marks."""
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


def _paint_post(picture: np.ndarray, camera: Camera, post: Post, sun: np.ndarray, air: tuple) -> None:
    """Three upright strips from light to shade; a lamp's arm reaches `arm_m` to the left (negative: right)."""
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
    paint_polygons(picture, pixels, colours, through=air[0], air=air[1])
