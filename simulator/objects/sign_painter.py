"""Paints signs, posts and street lamps."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from lanes.camera import Camera
from simulator.light.shading import irradiance
from simulator.objects.scene_objects import Post, Sign, vertical_rectangle
from simulator.painting.brush import Atmosphere, paint_polygons, project_faces

SIGN_COLOURS = {
    "green": ((0.012, 0.16, 0.085), (0.75, 0.77, 0.74)),
    "blue": ((0.015, 0.07, 0.26), (0.75, 0.77, 0.78)),
    "speed": ((0.74, 0.74, 0.72), (0.03, 0.03, 0.03)),
    "warning": ((0.72, 0.40, 0.012), (0.03, 0.03, 0.02)),
}


def paint_sign(picture: np.ndarray, camera: Camera, sign: Sign, sun: np.ndarray, air: Atmosphere) -> None:
    """Paint the posts, plate, border and text of a sign behind the content of a canvas, in place.

    Raises
    ------
    ValueError
        If there is no such kind of sign.
    """
    if sign.kind not in SIGN_COLOURS:
        raise ValueError(f"unknown sign {sign.kind!r}; choose one of {', '.join(sorted(SIGN_COLOURS))}.")
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
