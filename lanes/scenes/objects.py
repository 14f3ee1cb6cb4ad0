"""Things beside and on the road: cars, barriers, trees, signs, posts; their pictures and their shadows.

Every thing is given in the car's road frame (x forward, y left, z up, metres; the camera above the origin). The sun's
direction points towards the sun, in the same frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from lanes.camera import Camera
from lanes.scenes.backdrop import air_between
from lanes.scenes.bonnet import draw_bonnet
from lanes.scenes.brush import inside, lay_over, paint_polygons, project_faces, viewing_planes
from lanes.scenes.cars import BODY, ON_BODY, Shell, car_faces, face_normals, irradiance, shade_faces
from lanes.scenes.foliage import SPECIES, SUN_IN_SPRITE, plant_sprite
from lanes.scenes.walls import Wall, paint_wall

__all__ = ["Car", "Post", "Sign", "Tree", "Wall", "draw_bonnet", "draw_objects", "shadow_polygons"]

# Things farther than this are not worth drawing: a car is 4 pixels wide there.
FARTHEST_M = 600.0


@dataclass(frozen=True)
class Car:
    """A car on the ground at (x_m, y_m) of its middle; heading 0 drives with us, pi comes towards us."""

    x_m: float
    y_m: float
    heading_rad: float = 0.0
    paint: str = "white"
    body: str = "sedan"


@dataclass(frozen=True)
class Tree:
    """A tree or bush; `species` as in `foliage.SPECIES`."""

    x_m: float
    y_m: float
    height_m: float = 10.0
    species: str = "oak"
    seed: int = 0
    base_m: float = 0.0


@dataclass(frozen=True)
class Sign:
    """A sign on one or two posts that faces the traffic: kind "green", "speed", "warning" or "blue"."""

    x_m: float
    y_m: float
    kind: str = "green"
    width_m: float = 1.8
    height_m: float = 1.2
    bottom_m: float = 2.1


@dataclass(frozen=True)
class Post:
    """An upright pole: a delineator (1 m), a utility pole or, with `arm_m` reaching over the road, a street lamp."""

    x_m: float
    y_m: float
    height_m: float = 1.0
    width_m: float = 0.1
    arm_m: float = 0.0
    colour: tuple[float, float, float] = (0.55, 0.55, 0.53)


Thing = Car | Wall | Tree | Sign | Post
SIGN_COLOURS = {
    "green": ((0.012, 0.16, 0.085), (0.75, 0.77, 0.74)),
    "blue": ((0.015, 0.07, 0.26), (0.75, 0.77, 0.78)),
    "speed": ((0.74, 0.74, 0.72), (0.03, 0.03, 0.03)),
    "warning": ((0.72, 0.40, 0.012), (0.03, 0.03, 0.02)),
}


def draw_objects(
    image: np.ndarray, camera: Camera, objects: list[Thing], *, sun_direction: np.ndarray, haze: float = 0.06
) -> np.ndarray:
    """Paint things over a picture, the farthest first.

    Parameters
    ----------
    image : ndarray of shape (H, W, 3), float32
        Linear RGB radiance of the scene without them; not changed.
    camera : Camera
        With a mount; its distortion bends the things as it bends the road.
    objects : list of Car, Wall, Tree, Sign, Post
        In the car's road frame.
    sun_direction : ndarray of shape (3,)
        Unit vector towards the sun, road frame.
    haze : float
        Extinction of the air, 1/km.

    Returns
    -------
    ndarray of the same shape, float32

    Raises
    ------
    TypeError
        For a thing of another kind.
    """
    image = np.array(image, np.float32)
    sun = np.asarray(sun_direction, float) / np.linalg.norm(sun_direction)
    jobs = []
    for thing in objects:
        pieces = thing.pieces() if isinstance(thing, Wall) else [thing]
        jobs += [(_distance(piece), piece) for piece in pieces]
    for distance, thing in sorted((job for job in jobs if job[0] < FARTHEST_M), key=lambda job: -job[0]):
        _painter(thing)(image, camera, thing, sun, air_between(distance, haze))
    return image


def _distance(thing: Thing) -> float:
    if isinstance(thing, Wall):
        return thing.distance_m()
    if not isinstance(thing, (Car, Tree, Sign, Post)):
        raise TypeError(f"a {type(thing).__name__} cannot be drawn; give Car, Wall, Tree, Sign or Post.")
    return float(np.hypot(thing.x_m, thing.y_m))


def _painter(thing: Thing):
    return {Car: _paint_car, Wall: paint_wall, Tree: _paint_tree, Sign: _paint_sign, Post: _paint_post}[type(thing)]


def _paint_car(image: np.ndarray, camera: Camera, car: Car, sun: np.ndarray, air: tuple) -> None:
    """Contact shadow, then the faces that look at the camera, by layer and from far to near."""
    turn = _turn(car.heading_rad)
    place = np.array([car.x_m, car.y_m, 0.0])
    eye = (np.array([0, 0, camera.mount.height_m]) - place) @ turn
    distance = float(np.hypot(car.x_m, car.y_m))
    faces = car_faces(car.body, car.paint, detail=1 if distance > 40 else 2)
    middle = faces.corners.mean(axis=1)
    toward = ((eye - middle) * face_normals(faces.corners)).sum(axis=1) > 0
    faces = faces.chosen(toward)
    # What lies on the body keeps its order (plate on bumper); body and wheels go from far to near.
    apart = np.where(faces.layer < ON_BODY, -np.linalg.norm(middle[toward] - eye, axis=1), 0)
    faces = faces.chosen(np.lexsort((apart, faces.layer)))
    ground = np.array([[-2.35, -0.88, 0], [2.3, -0.88, 0], [2.3, 0.88, 0], [-2.35, 0.88, 0]])
    pixels = project_faces(camera, np.stack([ground * 1.03, ground * 0.97]) @ turn.T + place)
    blur = float(np.clip(40 / max(distance, 1), 0.5, 4))
    dark = np.full((2, 3), 0.004)
    paint_polygons(image, pixels, dark, opacity=np.array([0.55, 0.85]), through=air[0], air=air[1], softness_px=blur)
    colours = shade_faces(faces, eye, sun @ turn)
    pixels = project_faces(camera, faces.corners @ turn.T + place)
    cuts = np.searchsorted(faces.layer, [BODY, ON_BODY])
    # Facets are some 0.1 m wide: their shading is blended, the outline stays sharp.
    blend = 0.05 * camera.matrix[0, 0] / max(distance, 2)
    parts = (slice(0, cuts[0]), slice(*cuts), slice(cuts[1], None))
    for part, blend_px in zip(parts, (0.0, blend, 0.0), strict=True):
        paint_polygons(image, pixels[part], colours[part], through=air[0], air=air[1], blend_px=blend_px)


def _turn(heading_rad: float) -> np.ndarray:
    c, s = np.cos(heading_rad), np.sin(heading_rad)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def _paint_tree(image: np.ndarray, camera: Camera, tree: Tree, sun: np.ndarray, air: tuple) -> None:
    """The plant's picture, placed by where its foot and its top are seen."""
    ends = np.array([[tree.x_m, tree.y_m, tree.base_m], [tree.x_m, tree.y_m, tree.base_m + tree.height_m]])
    # Top and foot may be out of the lens's sight while the crown is in it: extend what is seen at mid height.
    around = ends[0] + np.array([[0, 0, 0.9], [0, 0, 1.9]])
    planes = viewing_planes(camera)
    if not inside(around, planes).all():
        return
    pixels = camera.road_to_pixels(ends if inside(ends, planes).all() else around)
    if not inside(ends, planes).all():
        up = pixels[1] - pixels[0]
        pixels = np.array([pixels[0] - 0.9 * up, pixels[0] + (tree.height_m - 0.9) * up])
    rows = float(np.linalg.norm(pixels[1] - pixels[0]))
    sprites = plant_sprite(tree.species, tree.seed)
    sprite = next((s for s in reversed(sprites) if s.shape[0] >= rows), sprites[0])
    # The sprite is lit from its left; mirror it where the sun is to the right of the line of sight.
    if -SUN_IN_SPRITE[0] * (tree.x_m * sun[1] - tree.y_m * sun[0]) < 0:
        sprite = sprite[:, ::-1]
    _warp_sprite(image, sprite, pixels, through=air[0], air=air[1])


def _warp_sprite(image: np.ndarray, sprite: np.ndarray, ends_px: np.ndarray, **air: np.ndarray) -> None:
    """Lay a sprite over the picture, its foot at the first point and its top at the second one."""
    height, width = sprite.shape[:2]
    up = (ends_px[1] - ends_px[0]) / height
    right = np.array([-up[1], up[0]])
    place = np.column_stack([right, -up, ends_px[1] - right * (width - 1) / 2])
    corners = np.array([[0, 0, 1], [width, 0, 1], [0, height, 1], [width, height, 1]]) @ place.T
    low = np.maximum(np.floor(corners.min(axis=0)).astype(int) - 1, 0)
    high = np.minimum(np.ceil(corners.max(axis=0)).astype(int) + 2, [image.shape[1], image.shape[0]])
    if (high <= low).any():
        return
    place[:, 2] -= low
    layer = cv2.warpAffine(np.ascontiguousarray(sprite), place, (high - low).tolist(), flags=cv2.INTER_LINEAR)
    lay_over(image, layer, int(low[0]), int(low[1]), **air)


def _upright(x: float, y: float, left: float, right: float, bottom: float, top: float) -> np.ndarray:
    """(4, 3) corners of an upright rectangle across the road, anticlockwise as seen by the driver."""
    return np.array([[x, y - right, bottom], [x, y - right, top], [x, y + left, top], [x, y + left, bottom]])


def _paint_sign(image: np.ndarray, camera: Camera, sign: Sign, sun: np.ndarray, air: tuple) -> None:
    """Posts, plate, border and lines of writing."""
    if sign.kind not in SIGN_COLOURS:
        raise ValueError(f"there is no sign {sign.kind!r}; there are {', '.join(sorted(SIGN_COLOURS))}.")
    field, ink = (np.array(c) for c in SIGN_COLOURS[sign.kind])
    light = irradiance(np.array([[-1.0, 0, 0]]), sun)[0] / 0.8
    half, low, tall = sign.width_m / 2, sign.bottom_m, sign.height_m
    faces, colours = [], []
    feet = (-0.6 * half, 0.6 * half) if half > 0.7 else (0.0,)
    for foot in feet:
        faces.append(_upright(sign.x_m + 0.05, sign.y_m + foot, 0.04, 0.04, 0, low + 0.9 * tall))
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
            faces.append(_upright(sign.x_m, sign.y_m, edge, edge, low + inset, low + tall - inset))
            colours.append(colour)
        lines, colour = _writing(sign), ink
        faces += lines
        colours += [colour] * len(lines)
    pixels = project_faces(camera, np.array(faces))
    paint_polygons(image, pixels, np.array(colours) * light, through=air[0], air=air[1])


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
            strokes.append(_upright(sign.x_m - 0.01, sign.y_m + y, 0, width, bottom, top))
            y -= width + letter * rng.uniform(0.14, 0.4)
    return strokes


def _paint_post(image: np.ndarray, camera: Camera, post: Post, sun: np.ndarray, air: tuple) -> None:
    """Three upright strips from light to shade; a lamp's arm reaches `arm_m` to the left (negative: right)."""
    half = post.width_m / 2
    edges = np.linspace(-half, half, 4)
    faces = [_upright(post.x_m, post.y_m, b, -a, 0, post.height_m) for a, b in zip(edges[:-1], edges[1:], strict=True)]
    normals = np.array([[-0.5, -0.86, 0], [-1.0, 0, 0], [-0.5, 0.86, 0]])
    if post.arm_m:
        low, high = sorted((0.0, post.arm_m))
        top = post.height_m
        faces.append(_upright(post.x_m, post.y_m, high, -low, top - 0.06, top + 0.06))
        end = post.arm_m
        faces.append(_upright(post.x_m, post.y_m, end + 0.35, -end + 0.35, top - 0.12, top + 0.10))
        normals = np.vstack([normals, [[-1.0, 0, 0], [-1.0, 0, 0]]])
    colours = np.array(post.colour) / 0.8 * irradiance(normals, sun)
    paint_polygons(image, project_faces(camera, np.array(faces)), colours, through=air[0], air=air[1])


def shadow_polygons(objects: list[Thing], sun_direction: np.ndarray) -> list[np.ndarray]:
    """Where things keep the sun from the ground.

    Parameters
    ----------
    objects : list of Car, Wall, Tree, Sign, Post
    sun_direction : ndarray of shape (3,)
        Unit vector towards the sun, road frame.

    Returns
    -------
    list of ndarray of shape (N, 2), float32
        Polygons in the road frame, metres; their union is the shadow. A tree gives one for each lump of leaves.

    Raises
    ------
    ValueError
        If the sun is not above the horizon.
    """
    sun = np.asarray(sun_direction, float)
    if sun[2] <= 0:
        raise ValueError("the sun is at or below the horizon, so nothing casts a shadow; give a direction with z > 0.")
    drift = -sun[:2] / sun[2]
    return [polygon.astype(np.float32) for thing in objects for polygon in _shadows(thing, drift)]


def _shadows(thing: Thing, drift: np.ndarray) -> list[np.ndarray]:
    """`drift` is how far the shadow of a point 1 m up lies from the point's foot."""
    if isinstance(thing, Wall):
        return thing.shadows(drift)
    place = np.array([thing.x_m, thing.y_m])
    if isinstance(thing, Car):
        rings = Shell(thing.body).loft(8, 1).reshape(-1, 3) @ _turn(thing.heading_rad).T
        return [_hull(place + rings[:, :2] + rings[:, 2:] * drift)]
    if isinstance(thing, Tree):
        return _tree_shadows(thing, place, drift)
    if isinstance(thing, Sign):
        plate = _upright(0, 0, thing.width_m / 2, thing.width_m / 2, thing.bottom_m, thing.bottom_m + thing.height_m)
        pole = _upright(0, 0, 0.05, 0.05, 0, thing.bottom_m)
    else:
        half = thing.width_m / 2
        plate, pole = _upright(0, 0, half, half, 0, thing.height_m), None
    return [_hull(place + part[:, :2] + part[:, 2:] * drift) for part in (plate, pole) if part is not None]


def _tree_shadows(tree: Tree, place: np.ndarray, drift: np.ndarray) -> list[np.ndarray]:
    """Ragged blots, so that sun flecks remain between them, and the trunk."""
    kind = SPECIES[tree.species]
    rng = np.random.default_rng([tree.seed, 7])
    angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    count, low = 45, max(kind.crown_bottom, 0.0)
    share = low + (1 - low) * rng.uniform(0.08, 0.92, count)
    reach = np.sqrt(rng.uniform(0, 1, count)) * kind.crown_width / 2 * tree.height_m * (1 - kind.taper * share)
    toward = rng.uniform(0, 2 * np.pi, count)
    aside = reach[:, None] * np.column_stack([np.cos(toward), np.sin(toward)])
    middle = place + aside + (share * tree.height_m + tree.base_m)[:, None] * drift
    size = tree.height_m * kind.lump_radius * rng.uniform(0.2, 0.8, (count, 1)) * rng.uniform(0.3, 1.4, (count, 12))
    outline = size[..., None] * np.column_stack([np.cos(angle), np.sin(angle)])
    # A lump is as tall as it is wide, so a low sun draws its shadow out.
    away = drift / max(np.linalg.norm(drift), 1e-9)
    outline += 0.3 * np.linalg.norm(drift) * (outline @ away)[..., None] * away
    blots = list(middle[:, None] + outline)
    half = max(0.12, kind.trunk_width * tree.height_m / 2)
    trunk = _upright(0, 0, half, half, 0, tree.height_m * (low + 0.3))
    return [*blots, _hull(place + trunk[:, :2] + trunk[:, 2:] * drift)]


def _hull(points: np.ndarray) -> np.ndarray:
    return cv2.convexHull(points.astype(np.float32)).reshape(-1, 2)
