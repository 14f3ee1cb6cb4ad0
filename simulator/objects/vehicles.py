"""Vehicles as flat-shaded faces, and the bonnet of the car with the camera.

Vehicles are cars, lorries and motorcycles. The frame of a vehicle is x forward, y left,
z up, with its origin on the ground below its centre.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike

from simulator.light.sunlight import irradiance
from simulator.objects.standing import Standing, upright_rectangle
from simulator.painting import (
    Atmosphere,
    Canvas,
    composite,
    face_normals,
    paint_polygons,
    smoothstep,
)

PAINTS = {
    "white": (0.74, 0.74, 0.72),
    "silver": (0.36, 0.37, 0.385),
    "grey": (0.12, 0.125, 0.13),
    "black": (0.010, 0.010, 0.012),
    "blue": (0.020, 0.045, 0.13),
    "red": (0.26, 0.014, 0.014),
    "beige": (0.42, 0.37, 0.28),
}
GLASS = (0.03, 0.035, 0.04)
RUBBER = (0.018, 0.018, 0.019)
PLASTIC = (0.02, 0.02, 0.021)
CLOTH = (0.03, 0.04, 0.06)
TAIL_LAMP = (0.17, 0.008, 0.010)
HEADLAMP = (0.50, 0.52, 0.55)
PLATE = (0.72, 0.72, 0.70)

# Rings of a body: height, rear end, front end, half width (metres), and exponent of the
# superellipse. The fifth ring is the waist line; the windows are between the seventh
# and the ninth.
BODIES = {
    "sedan": np.array(
        [
            [0.19, -2.16, 2.2, 0.78, 5],
            [0.3, -2.36, 2.36, 0.88, 5],
            [0.48, -2.42, 2.42, 0.908, 5],
            [0.66, -2.42, 2.38, 0.912, 5],
            [0.86, -2.36, 2.26, 0.895, 4.6],
            [0.985, -2.22, 2.02, 0.84, 4.4],
            [1.02, -1.8, 1.02, 0.775, 4.2],
            [1.14, -1.52, 0.72, 0.735, 4],
            [1.33, -1.02, 0.2, 0.64, 3.6],
            [1.41, -0.8, -0.05, 0.575, 3.2],
            [1.45, -0.62, -0.22, 0.44, 3],
            [1.46, -0.45, -0.38, 0.12, 2.5],
        ]
    ),
    "suv": np.array(
        [
            [0.24, -2.14, 2.16, 0.8, 5.5],
            [0.36, -2.3, 2.32, 0.9, 5.5],
            [0.56, -2.36, 2.38, 0.93, 5.5],
            [0.8, -2.36, 2.36, 0.935, 5.5],
            [1, -2.31, 2.26, 0.92, 5],
            [1.07, -2.27, 2.02, 0.89, 5],
            [1.1, -2.24, 1.12, 0.86, 5],
            [1.22, -2.18, 0.9, 0.83, 5],
            [1.52, -1.98, 0.42, 0.74, 4.6],
            [1.64, -1.86, 0.2, 0.69, 4.2],
            [1.69, -1.7, -0.05, 0.56, 3.5],
            [1.7, -1.2, -0.5, 0.15, 2.5],
        ]
    ),
}
WAIST = 4
WINDOWS = slice(6, 8)
AXLES_M = (-1.40, 1.38)
# Rear end, front end and half width on the ground, metres.
FOOTPRINTS = {"truck": (-6.0, 6.0, 1.2), "motorcycle": (-1.0, 0.95, 0.14)}
CAR_FOOTPRINT = (-2.35, 2.3, 0.88)
# The contact shadow: two rectangles on the ground, a larger and a smaller one.
CONTACT_SIZES = np.array([1.03, 0.97]).reshape(2, 1, 1)
CONTACT_OPACITIES = np.array([0.55, 0.85])
CONTACT_COLOURS = np.full((2, 3), 0.004)
# Corners of a box as signs of x, y and z, and its faces as indices of corners.
BOX_CORNERS = np.array(
    [
        [-1, -1, -1],
        [1, -1, -1],
        [1, 1, -1],
        [-1, 1, -1],
        [-1, -1, 1],
        [1, -1, 1],
        [1, 1, 1],
        [-1, 1, 1],
    ]
)
BOX_FACES = np.array(
    [
        [0, 1, 5, 4],
        [1, 2, 6, 5],
        [2, 3, 7, 6],
        [3, 0, 4, 7],
        [4, 5, 6, 7],
        [3, 2, 1, 0],
    ]
)


class Faces(NamedTuple):
    """Faces (F, 4, 3) in metres, their albedo (F, 3), and the order (F,) of painting.

    The order is that of parts on the body.
    """

    corners_m: np.ndarray
    albedo: np.ndarray
    layer: np.ndarray


@lru_cache(maxsize=64)
def vehicle_faces(body: str, paint: str) -> Faces:
    """Faces of a vehicle.

    `body` is "sedan", "suv", "truck" or "motorcycle", `paint` a name in PAINTS.
    """
    if body == "truck":
        parts = _truck(paint)
    elif body == "motorcycle":
        parts = _motorcycle(paint)
    else:
        parts = _car(body, paint)
    rows = np.concatenate(parts)
    return Faces(
        corners_m=rows[:, :12].reshape(-1, 4, 3),
        albedo=rows[:, 12:15],
        layer=rows[:, 15],
    )


def _part(
    corners_m: ArrayLike,
    albedo: ArrayLike,
    layer: int = 0,
) -> np.ndarray:
    """Faces of one or of several materials as rows (F, 16).

    A row is four corners, albedo and layer.
    """
    corners = np.reshape(corners_m, (-1, 12))
    count = len(corners)
    albedos = np.broadcast_to(albedo, (count, 3))
    return np.column_stack([corners, albedos, np.full(count, layer)])


@lru_cache(maxsize=8)
def outline_points(body: str) -> np.ndarray:
    """Points (N, 3) on a vehicle in its own frame; their hull is its outline."""
    if body in BODIES:
        faces = _loft(BODIES[body], 8)
    else:
        faces = vehicle_faces(body, "black").corners_m
    return faces.reshape(-1, 3)


def _loft(rings: np.ndarray, around: int) -> np.ndarray:
    """Faces (rings - 1, around, 4, 3) of a car body."""
    height, rear, front, width, power = rings.T[:, :, None]
    x, y = _superellipse(_even_angles(around), 2 / power)
    x = (rear + front) / 2 + (front - rear) / 2 * x
    y = width * y

    # The bonnet slopes down.
    forward = np.clip((x - 0.9) / 1.5, 0, 1)
    above_bumper = np.clip((height - 0.45) / 0.5, 0, 1)
    z = height - 0.20 * forward**1.5 * above_bumper

    grid = np.stack([x, y, z], axis=-1)
    below = grid[:-1]
    above = grid[1:]
    corners = [
        below[:, :-1],
        below[:, 1:],
        above[:, 1:],
        above[:, :-1],
    ]
    return np.stack(corners, axis=2)


def _superellipse(
    angle: np.ndarray, power: np.ndarray | float
) -> tuple[np.ndarray, np.ndarray]:
    """Points x and y of a superellipse of half widths 1."""
    cosine = np.cos(angle)
    sine = np.sin(angle)
    x = np.sign(cosine) * np.abs(cosine) ** power
    y = np.sign(sine) * np.abs(sine) ** power
    return x, y


def _even_angles(count: int) -> np.ndarray:
    """Angles of points on a car-shaped superellipse, denser where it turns sharply."""
    angle = np.linspace(0, 2 * np.pi, 4001)
    x, y = _superellipse(angle, 0.45)
    dx = np.diff(2.3 * x)
    dy = np.diff(0.9 * y)
    direction = np.unwrap(np.arctan2(dy, dx))
    turn = np.abs(np.diff(direction, prepend=np.pi / 2))

    # More points at rear and front than on the flanks, because drivers mostly see the
    # rear and the front.
    length = np.hypot(dx, 2.5 * dy)
    density = length / length.sum() + 1.2 * turn / turn.sum()
    until = np.concatenate([[0], np.cumsum(density)])
    return np.interp(np.linspace(0, until[-1], count + 1), until, angle)


def _car(
    body: str,
    paint: str,
) -> list[np.ndarray]:
    """Body with windows all around, lamps, licence plate and wheels."""
    rings = BODIES[body]
    cells = _loft(rings, 28)
    albedo = np.empty_like(cells[:, :, 0])
    albedo[:] = PAINTS[paint]
    albedo[WINDOWS] = GLASS
    albedo[0] = PLASTIC

    waist = rings[WAIST, 0]
    rear = rings[WAIST, 1]
    front = rings[WAIST - 1, 2]
    plate = upright_rectangle(rear - 0.07, (-0.2, 0.2), (0.62, 0.75))
    parts = [
        _part(cells, albedo.reshape(-1, 3)),
        _part(plate, PLATE, 1),
    ]
    for side in (-1, 1):
        low, high = sorted((0.42 * side, 0.72 * side))
        lamp_height = (waist - 0.12, waist + 0.04)
        tail = upright_rectangle(rear - 0.05, (low, high), lamp_height)
        head = upright_rectangle(front + 0.05, (high, low), (0.48, 0.62))
        parts.append(_part(tail, TAIL_LAMP, 1))
        parts.append(_part(head, HEADLAMP, 1))
        for x in AXLES_M:
            parts += _car_wheel(x, side, side * (rings[2, 3] + 0.01))
    return parts


def _car_wheel(
    x: float,
    side: int,
    flank: float,
) -> list[np.ndarray]:
    """Wheel in its well, and its outer face on the flank."""
    y = sorted((0.8 * flank, flank))
    well = _box((x - 0.3, x + 0.3), y, (0.0, 0.6), RUBBER, -1)
    rear = x + side * 0.3
    front = x - side * 0.3
    face = [
        (rear, flank, 0.1),
        (front, flank, 0.1),
        (front, flank, 0.5),
        (rear, flank, 0.5),
    ]
    return [well, _part(face, RUBBER, 1)]


def _truck(paint: str) -> list[np.ndarray]:
    """Lorry with a box body, 2.5 m wide, 4 m high, 12 m long, the limits of the EU."""
    parts = [
        _box((-6.0, 3.3), (-1.25, 1.25), (1.10, 3.95), PAINTS["white"]),
        _box((3.7, 6.0), (-1.22, 1.22), (0.55, 3.2), PAINTS[paint]),
        _box((-5.7, 5.6), (-0.45, 0.45), (0.55, 1.05), PLASTIC),
        _box((-6.03, -6.0), (-1.15, 1.15), (0.86, 1.06), PLASTIC, 1),
        _box((-6.06, -6.03), (-0.26, 0.26), (0.90, 1.02), PLATE, 2),
        # The gap between the doors.
        _box((-6.02, -6.0), (-0.02, 0.02), (1.12, 3.86), PLASTIC, 1),
    ]
    for side in (-1, 1):
        lamp = sorted((side * 0.82, side * 1.13))
        wheel = sorted((side * 0.72, side * 1.22))
        parts.append(_box((-6.05, -6.03), lamp, (0.88, 1.04), TAIL_LAMP, 2))
        for x in (-4.9, -3.7, 4.9):
            parts.append(_box((x - 0.5, x + 0.5), wheel, (0.0, 1.0), RUBBER))
    return parts


def _motorcycle(paint: str) -> list[np.ndarray]:
    """Motorcycle and its rider."""
    return [
        # Wheels and arms.
        _box((-1.0, -0.38), (-0.08, 0.08), (0.0, 0.63), RUBBER),
        _box((0.33, 0.95), (-0.08, 0.08), (0.0, 0.63), RUBBER),
        _box((-0.02, 0.44), (-0.41, -0.23), (1.1, 1.36), CLOTH),
        _box((-0.02, 0.44), (0.23, 0.41), (1.1, 1.36), CLOTH),
        # Engine and tank.
        _box((-0.4, 0.4), (-0.17, 0.17), (0.25, 0.7), PLASTIC),
        _box((-0.95, 0.8), (-0.18, 0.18), (0.7, 1.0), PAINTS[paint]),
        # Legs, trunk and helmet.
        _box((-0.25, 0.25), (-0.34, 0.34), (0.3, 0.95), CLOTH),
        _box((-0.2, 0.2), (-0.25, 0.25), (0.9, 1.55), CLOTH),
        _box((-0.02, 0.28), (-0.13, 0.13), (1.5, 1.79), PAINTS["red"]),
        _box((-1.03, -1.00), (-0.08, 0.08), (0.74, 0.80), TAIL_LAMP, 1),
    ]


def _box(
    x: Sequence[float],
    y: Sequence[float],
    z: Sequence[float],
    albedo: tuple,
    layer: int = 0,
) -> np.ndarray:
    """Faces of a box between two values of each coordinate."""
    ranges = np.array([x, y, z], float)
    half = np.diff(ranges, axis=1)[:, 0] / 2
    corners = ranges.mean(axis=1) + BOX_CORNERS * half
    return _part(corners[BOX_FACES], albedo, layer)


@dataclass(frozen=True)
class Car(Standing):
    """Vehicle.

    `paint` is a name in `PAINTS`, `body` is "sedan", "suv", "truck" or "motorcycle".
    Heading 0 is the car's own direction, pi is oncoming.
    """

    paint: str = "white"
    body: str = "sedan"
    heading_rad: float = 0.0

    @property
    def turn(self) -> np.ndarray:
        """Rotation (3, 3) from the vehicle's own frame to that of the car."""
        cosine = np.cos(self.heading_rad)
        sine = np.sin(self.heading_rad)
        return np.array(
            [
                [cosine, -sine, 0],
                [sine, cosine, 0],
                [0, 0, 1],
            ]
        )

    def outline_m(self) -> np.ndarray:
        """Points (N, 3) in the frame of the car; their hull is its outline."""
        return outline_points(self.body) @ self.turn.T + self.foot_m

    def shadows(self, offset_per_m: np.ndarray) -> list[np.ndarray]:
        """Shadow polygon (N, 2); see `Standing.cast_hull`."""
        return [self.cast_hull(outline_points(self.body) @ self.turn.T, offset_per_m)]

    def paint_over(
        self,
        canvas: Canvas,
        sun: np.ndarray,
        air: Atmosphere,
        light: np.ndarray,
    ) -> None:
        """Paint the contact shadow and the visible faces."""
        if canvas.misses(self.outline_m()):
            return
        faces = vehicle_faces(self.body, self.paint)
        turn = self.turn

        # Faces that the camera sees, in the vehicle's own frame.
        eye_in_car = np.array([0, 0, canvas.camera.require_pose().height_m])
        eye = (eye_in_car - self.foot_m) @ turn
        normal = face_normals(faces.corners_m)
        to_eye = eye - faces.corners_m.mean(axis=1)
        seen = np.flatnonzero((normal * to_eye).sum(axis=1) > 0)
        # Parts on the body keep their order; the others are sorted from far to near.
        distance = np.linalg.norm(to_eye[seen], axis=1)
        seen = seen[np.lexsort((-distance, faces.layer[seen]))]
        colours = faces.albedo[seen] / 0.8 * irradiance(normal[seen], sun @ turn)

        corners = np.concatenate([faces.corners_m[seen], self._contact_shadow()])
        pixels = canvas.project_faces(corners @ turn.T + self.foot_m)
        dimmed = air.dimmed(light[0])
        paint_polygons(
            canvas,
            pixels[-2:],
            CONTACT_COLOURS,
            opacity=CONTACT_OPACITIES,
            atmosphere=dimmed,
            softness_px=float(np.clip(40 / max(self.distance_m, 1), 0.5, 4)),
        )
        paint_polygons(canvas, pixels[:-2], colours, atmosphere=dimmed)

    def _contact_shadow(self) -> np.ndarray:
        """Corners (2, 4, 3) of the dark ground below the vehicle, in its own frame."""
        rear, front, half = FOOTPRINTS.get(self.body, CAR_FOOTPRINT)
        ground = [
            [rear, -half, 0],
            [front, -half, 0],
            [front, half, 0],
            [rear, half, 0],
        ]
        return np.array(ground) * CONTACT_SIZES


# The bonnet is dusty, reddish-brown, out of focus, and fixed at the bottom edge of the
# image. Upper edge as shares of image width and height: left wing, dip, hump in the
# middle, right wing.
BONNET = np.array(
    [
        [-0.02, 0.933],
        [0.05, 0.936],
        [0.11, 0.943],
        [0.16, 0.9515],
        [0.21, 0.953],
        [0.27, 0.9495],
        [0.34, 0.9395],
        [0.42, 0.932],
        [0.52, 0.9295],
        [0.62, 0.9315],
        [0.69, 0.9375],
        [0.75, 0.9425],
        [0.82, 0.9435],
        [0.86, 0.9395],
        [0.90, 0.931],
        [0.95, 0.922],
        [1.02, 0.917],
    ]
)
BONNET_PAINT = np.array([0.190, 0.125, 0.110])


def paint_bonnet(image: np.ndarray, *, light: float) -> None:
    """Paint the bonnet along the bottom of an image (H, W, 3) float32, in place.

    `light` is 1 in the sun and about 0.25 under trees.
    """
    height, width = image.shape[:2]
    layer, top = _bonnet_layer(height, width)
    composite(image, layer, 0, top, Atmosphere(light))


@lru_cache(maxsize=4)
def _bonnet_layer(
    height: int,
    width: int,
) -> tuple[np.ndarray, int]:
    """Premultiplied RGBA image of the bonnet (rows, W, 4), and its first row."""
    # Linear interpolation, smoothed to look like pressed steel.
    u, v = BONNET.T * [[width], [height]]
    edge = np.interp(np.arange(width), u, v)
    window = max(3, int(0.05 * width)) | 1
    edge = cv2.GaussianBlur(
        edge[None, :], (window, 1), window / 5, borderType=cv2.BORDER_REFLECT
    )[0]

    # The edge is out of focus: a ramp of about three rows. It reflects the sky at a
    # grazing angle.
    scale = height / 720
    top = int(edge.min() - 8 * scale)
    inward = (np.arange(top, height)[:, None] - edge) / scale
    cover = smoothstep(-1.6, 1.6, inward)
    tone = cover * (1 - 0.3 * smoothstep(0, 40, inward))

    planes = [*(tone * channel for channel in BONNET_PAINT), cover]
    layer: np.ndarray = cv2.merge(planes).astype(np.float32)
    layer = cv2.GaussianBlur(
        layer, (0, 0), 0.6 * scale, borderType=cv2.BORDER_REPLICATE
    )
    return layer, top
