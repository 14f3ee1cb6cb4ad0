"""Cars as shaded faces: a lofted body with windows, lamps, licence plate and wheels.

A body is a stack of superelliptic rings from the sill to the roof. Windows, lamps and other parts lie on its surface.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from simulator.light.shading import Faces, face_normals

PAINTS = {
    "white": (0.74, 0.74, 0.72),
    "silver": (0.36, 0.37, 0.385),
    "grey": (0.12, 0.125, 0.13),
    "black": (0.010, 0.010, 0.012),
    "blue": (0.020, 0.045, 0.13),
    "red": (0.26, 0.014, 0.014),
    "beige": (0.42, 0.37, 0.28),
}
GLASS, RUBBER, RIM, PLASTIC = (0.012, 0.016, 0.017), (0.018, 0.018, 0.019), (0.46, 0.46, 0.47), (0.02, 0.02, 0.021)
TAIL_LAMP, HEADLAMP, PLATE = (0.17, 0.008, 0.010), (0.50, 0.52, 0.55), (0.72, 0.72, 0.70)

BODY_PAINT = (np.nan, np.nan, np.nan)

# Rings: height, rear end, front end, half width (metres), and exponent of the superellipse. The origin is on the ground
# below the centre of the car. The fifth ring is the waist line, the seventh the lower edge of the windows.
BODIES = {
    "sedan": np.array(
        [
            [0.19, -2.16, 2.20, 0.78, 5.0],
            [0.30, -2.36, 2.36, 0.88, 5.0],
            [0.48, -2.42, 2.42, 0.908, 5.0],
            [0.66, -2.42, 2.38, 0.912, 5.0],
            [0.86, -2.36, 2.26, 0.895, 4.6],
            [0.985, -2.22, 2.02, 0.840, 4.4],
            [1.02, -1.80, 1.02, 0.775, 4.2],
            [1.14, -1.52, 0.72, 0.735, 4.0],
            [1.33, -1.02, 0.20, 0.640, 3.6],
            [1.41, -0.80, -0.05, 0.575, 3.2],
            [1.45, -0.62, -0.22, 0.44, 3.0],
            [1.46, -0.45, -0.38, 0.12, 2.5],
        ]
    ),
    "suv": np.array(
        [
            [0.24, -2.14, 2.16, 0.80, 5.5],
            [0.36, -2.30, 2.32, 0.90, 5.5],
            [0.56, -2.36, 2.38, 0.930, 5.5],
            [0.80, -2.36, 2.36, 0.935, 5.5],
            [1.00, -2.31, 2.26, 0.920, 5.0],
            [1.07, -2.27, 2.02, 0.890, 5.0],
            [1.10, -2.24, 1.12, 0.860, 5.0],
            [1.22, -2.18, 0.90, 0.830, 5.0],
            [1.52, -1.98, 0.42, 0.740, 4.6],
            [1.64, -1.86, 0.20, 0.690, 4.2],
            [1.69, -1.70, -0.05, 0.56, 3.5],
            [1.70, -1.20, -0.50, 0.15, 2.5],
        ]
    ),
}
WHEEL_RADIUS_M = 0.33
AXLES_M = (-1.40, 1.38)
# Layers in the order of painting: treads and mirrors, the body, parts on the body.
BEHIND_BODY, BODY, ON_BODY = 0, 1, 2
BOX_FACES = np.array([[0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7], [4, 5, 6, 7], [3, 2, 1, 0]])
BOX_CORNERS = np.array([[x, y, z] for z in (-1, 1) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))])


class Shell:
    """Surface of a car body of BODIES: its rings, and points on rear, front and flanks."""

    def __init__(self, body: str):
        self.rings = BODIES[body]

    def ring(self, z: np.ndarray) -> tuple[np.ndarray, ...]:
        """Centre, half length, half width and exponent at heights z."""
        rear, front, width, power = (np.interp(z, self.rings[:, 0], self.rings[:, i]) for i in range(1, 5))
        return (rear + front) / 2, (front - rear) / 2, width, power

    def droop(self, points: np.ndarray) -> np.ndarray:
        """Lower high points at the front, because the bonnet slopes down."""
        points = np.array(points, float)
        forward = np.clip((points[..., 0] - 0.9) / 1.5, 0, 1)
        points[..., 2] -= 0.20 * forward**1.5 * np.clip((points[..., 2] - 0.45) / 0.5, 0, 1)
        return points

    def end(self, y: np.ndarray, z: np.ndarray, *, side: int, lift_m: float = 0.006) -> np.ndarray:
        """Points (..., 3) on the rear (side -1) or front (+1) at lateral y and height z."""
        middle, length, width, power = self.ring(z)
        inner = np.clip(1 - np.abs(y / width) ** power, 0, 1) ** (1 / power)
        return self.droop(np.stack([middle + side * (length * inner + lift_m), y, z], axis=-1))

    def flank(self, x: np.ndarray, z: np.ndarray, *, side: int, lift_m: float = 0.006) -> np.ndarray:
        """Points (..., 3) on the left (side +1) or right (-1) flank at x and height z."""
        middle, length, width, power = self.ring(z)
        inner = np.clip(1 - np.abs((x - middle) / length) ** power, 0, 1) ** (1 / power)
        return self.droop(np.stack([x, side * (width * inner + lift_m), z], axis=-1))

    def loft(self, around: int, between: int) -> np.ndarray:
        """Faces (levels, around, 4, 3) of the whole body, with outward normals."""
        z, rear, front, width, power = _rounded(self.rings, between).T[:, :, None]
        angle = _even_angles(around)
        c, s = np.cos(angle), np.sin(angle)
        x = (rear + front) / 2 + (front - rear) / 2 * np.sign(c) * np.abs(c) ** (2 / power)
        y = width * np.sign(s) * np.abs(s) ** (2 / power)
        return grid_cells(self.droop(np.stack([x, y, np.broadcast_to(z, x.shape)], axis=-1)))


def _rounded(rings: np.ndarray, between: int) -> np.ndarray:
    """Rings interpolated by Catmull-Rom splines, `between` for each interval."""
    padded = np.vstack([2 * rings[0] - rings[1], rings, 2 * rings[-1] - rings[-2]])
    t = (np.arange(between) / between)[:, None, None]
    a, b, c, d = padded[:-3], padded[1:-2], padded[2:-1], padded[3:]
    curve = 0.5 * (2 * b + (c - a) * t + (2 * a - 5 * b + 4 * c - d) * t**2 + (3 * b - a - 3 * c + d) * t**3)
    return np.vstack([curve.transpose(1, 0, 2).reshape(-1, rings.shape[1]), rings[-1:]])


def _even_angles(count: int) -> np.ndarray:
    """Angles of points on a car-shaped superellipse, denser where it turns sharply."""
    angle = np.linspace(0, 2 * np.pi, 4001)
    c, s = np.cos(angle), np.sin(angle)
    x, y = 2.3 * np.sign(c) * np.abs(c) ** 0.45, 0.9 * np.sign(s) * np.abs(s) ** 0.45
    dx, dy = np.diff(x), np.diff(y)
    turn = np.abs(np.diff(np.unwrap(np.arctan2(dy, dx)), prepend=np.pi / 2))
    # More points at rear and front than on the flanks, because drivers mostly see the rear and the front.
    length = np.hypot(dx, 2.5 * dy)
    spent = np.concatenate([[0], np.cumsum(length / length.sum() + 1.2 * turn / turn.sum())])
    return np.interp(np.linspace(0, spent[-1], count + 1), spent, angle)


def grid_cells(grid: np.ndarray) -> np.ndarray:
    """Faces (rows, columns, 4, 3) between the points of a grid (rows + 1, columns + 1, 3)."""
    return np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]], axis=2)


def _smooth_normals(cells: np.ndarray) -> np.ndarray:
    """Normals (F, 3) of a loft, averaged with the neighbours for smooth shading."""
    normal = face_normals(cells.reshape(-1, 4, 3)).reshape(*cells.shape[:2], 3)
    around = normal + 0.6 * (np.roll(normal, 1, axis=1) + np.roll(normal, -1, axis=1))
    up = np.concatenate([around[:1], around, around[-1:]])
    mixed = up[1:-1] + 0.5 * (up[:-2] + up[2:])
    return (mixed / np.linalg.norm(mixed, axis=2, keepdims=True)).reshape(-1, 3)


def _patch(corners: ArrayLike, surface, *, columns: int = 4, rows: int = 3) -> np.ndarray:
    """Faces of a piece of a surface; `corners` (4, 2) in surface coordinates, anticlockwise as seen from outside."""
    a, b, c, d = np.asarray(corners, float)
    p, q = np.linspace(0, 1, columns + 1)[None, :, None], np.linspace(0, 1, rows + 1)[:, None, None]
    grid = surface((1 - q) * ((1 - p) * a + p * b) + q * ((1 - p) * d + p * c))
    return grid_cells(grid).reshape(-1, 4, 3)


@lru_cache(maxsize=32)
def car_faces(body: str, paint: str, *, detail: int = 2) -> Faces:
    """Faces of a car of BODIES and PAINTS, as from `vehicles.vehicle_faces`."""
    faces = _unpainted_faces(body, detail)
    return replace(faces, albedo=np.where(np.isnan(faces.albedo), PAINTS[paint], faces.albedo))


@lru_cache(maxsize=8)
def _unpainted_faces(body: str, detail: int) -> Faces:
    """Faces of a car; those in the colour of the car have the placeholder albedo BODY_PAINT."""
    shell = Shell(body)
    cells = shell.loft(28 * detail, detail)
    skin = replace(Faces.from_corners(cells, BODY_PAINT, 1.0, BODY), normal=_smooth_normals(cells))
    return Faces.concatenate([skin, *_end_parts(shell), *_flank_parts(shell), *_wheels(shell, detail)])


def _end_parts(shell: Shell) -> list[Faces]:
    """Windows, lamps, licence plate and bumper of rear and front."""
    z = shell.rings[:, 0]
    waist, foot, top = z[4], z[6], z[8]
    parts = []
    for side, glow in ((-1, TAIL_LAMP), (1, HEADLAMP)):

        def surface(yz: np.ndarray, side: int = side) -> np.ndarray:
            return shell.end(side * yz[..., 0], yz[..., 1], side=side)

        def add(y: tuple, zz: tuple, albedo: tuple, gloss: float, surface=surface, columns: int = 4) -> None:
            corners = [(y[0], zz[0]), (y[1], zz[0]), (y[2], zz[1]), (y[3], zz[1])]
            parts.append(Faces.from_corners(_patch(corners, surface, columns=columns), albedo, gloss, ON_BODY))

        width = shell.ring(np.array([foot, top]))[2]
        low, high = 0.90 * width[0], 0.86 * width[1]
        frame = (-low - 0.03, low + 0.03, high + 0.03, -high - 0.03)
        add(frame, (foot + 0.005, top + 0.035), PLASTIC, 0.5, columns=10)
        add((-low, low, high, -high), (foot + 0.025, top + 0.015), GLASS, 2.0, columns=10)
        add((-0.80, 0.80, 0.78, -0.78), (0.21, 0.34), PLASTIC, 0.3, columns=8)
        if side < 0:
            _add_rear(add, waist, foot, top)
        else:
            add((-0.45, 0.45, 0.42, -0.42), (waist - 0.30, waist - 0.10), PLASTIC, 0.6, columns=8)
        lamp = (waist - 0.10, waist + 0.05) if side < 0 else (waist - 0.16, waist - 0.03)
        for y0, y1 in ((0.50, 0.86), (-0.86, -0.50)):
            add((y0, y1, y1, y0), lamp, glow, 1.3)
            inner = (0.52, 0.66) if y0 > 0 else (-0.66, -0.52)
            add((inner[0], inner[1], inner[1], inner[0]), (lamp[0] + 0.02, lamp[0] + 0.06), (0.34, 0.22, 0.22), 1.0)
    return parts


def _add_rear(add: Callable, waist: float, foot: float, top: float) -> None:
    """Head rests, gaps of the boot lid, badge, licence plate and reflectors."""
    for y in (-0.36, 0.36):
        add(
            (y - 0.13, y + 0.13, y + 0.10, y - 0.10), (foot + 0.04, foot + 0.55 * (top - foot)), (0.03, 0.03, 0.03), 1.6
        )
    add((-0.82, 0.82, 0.82, -0.82), (waist - 0.245, waist - 0.233), PLASTIC, 0.2, columns=8)
    for y in (-0.70, 0.70):
        add((y - 0.007, y + 0.007, y + 0.007, y - 0.007), (waist - 0.24, foot), PLASTIC, 0.2)
        add((y - 0.09, y + 0.09, y + 0.09, y - 0.09), (waist - 0.43, waist - 0.39), TAIL_LAMP, 0.6)
    add((-0.34, 0.34, 0.34, -0.34), (waist - 0.03, waist + 0.0), RIM, 1.0)
    add((-0.05, 0.05, 0.05, -0.05), (waist + 0.02, waist + 0.08), RIM, 1.0)
    add((-0.19, 0.19, 0.18, -0.18), (waist - 0.215, waist - 0.035), PLASTIC, 0.4)
    add((-0.155, 0.155, 0.155, -0.155), (waist - 0.20, waist - 0.05), PLATE, 0.0)
    add((-0.11, 0.11, 0.11, -0.11), (waist - 0.145, waist - 0.095), (0.20, 0.22, 0.32), 0.0)


def _flank_parts(shell: Shell) -> list[Faces]:
    """Side windows, door handles and seams, sills, side parts of the lamps, and mirrors."""
    z = shell.rings[:, 0]
    waist, foot, top = z[4], z[6], z[8]
    bottom_rear, bottom_front = shell.rings[6, 1:3]
    top_rear, top_front = shell.rings[8, 1:3]
    pillar = 0.35 * (bottom_rear + bottom_front) + 0.30 * (top_rear + top_front) / 2
    parts = []
    for side in (-1, 1):

        def surface(xz: np.ndarray, side: int = side) -> np.ndarray:
            return shell.flank(-side * xz[..., 0], xz[..., 1], side=side)

        def add(x: tuple, zz: tuple, albedo: tuple, gloss: float, surface=surface, side: int = side) -> None:
            # Anticlockwise as seen from outside: x is mirrored on the left flank.
            corners = [(x[0], zz[0]), (x[1], zz[0]), (x[2], zz[1]), (x[3], zz[1])]
            if side > 0:
                corners = [(-x[1], zz[0]), (-x[0], zz[0]), (-x[3], zz[1]), (-x[2], zz[1])]
            parts.append(Faces.from_corners(_patch(corners, surface), albedo, gloss, ON_BODY))

        windows = (foot + 0.02, top - 0.02)
        around = (bottom_rear + 0.33, bottom_front - 0.27, top_front - 0.08, top_rear + 0.17)
        add(around, (foot + 0.0, top + 0.005), PLASTIC, 0.5)
        add((bottom_rear + 0.38, pillar - 0.04, pillar - 0.06, top_rear + 0.22), windows, GLASS, 2.0)
        add((pillar + 0.04, bottom_front - 0.34, top_front - 0.12, pillar + 0.02), windows, GLASS, 2.0)
        for x in (-0.48, 0.42):
            add((x, x + 0.16, x + 0.16, x), (waist + 0.015, waist + 0.045), BODY_PAINT, 1.0)
            add((x, x + 0.16, x + 0.16, x), (waist - 0.005, waist + 0.012), PLASTIC, 0.2)
        for x in (-0.62, 0.28, 1.08):
            add((x - 0.006, x + 0.006, x + 0.006, x - 0.006), (0.30, foot - 0.02), PLASTIC, 0.2)
        add((-1.0, 1.0, 1.0, -1.0), (0.21, 0.29), PLASTIC, 0.3)
        add((-2.30, -2.02, -2.06, -2.27), (waist - 0.09, waist + 0.04), TAIL_LAMP, 1.3)
        add((1.86, 2.16, 2.10, 1.90), (waist - 0.10, waist + 0.0), HEADLAMP, 1.3)
        mirror = ((0.66, 0.78), (side * 0.91 - 0.09, side * 0.91 + 0.09), (foot - 0.015, foot + 0.095))
        parts.append(box(*mirror, BODY_PAINT, 1.0, layer=BEHIND_BODY))
    return parts


def box(
    x: tuple, y: Sequence[float], z: tuple, albedo: tuple, gloss: float, *, layer: int = BODY, cells: int = 1
) -> Faces:
    """Faces of a box between two values of each coordinate; each side has cells x cells faces."""
    ranges = np.array([x, y, z], float)
    corners = ranges.mean(axis=1) + BOX_CORNERS * np.diff(ranges, axis=1)[:, 0] / 2
    share = np.linspace(0, 1, cells + 1)
    p, q = share[None, None, :, None], share[None, :, None, None]
    a, b, c, d = (corners[BOX_FACES[:, i]][:, None, None] for i in range(4))
    grid = (1 - q) * ((1 - p) * a + p * b) + q * ((1 - p) * d + p * c)
    return Faces.from_corners([grid_cells(side) for side in grid], albedo, gloss, layer)


def _wheels(shell: Shell, detail: int) -> list[Faces]:
    """Treads below the body; arches, tyres and rims on the flanks."""
    angle = np.linspace(0, 2 * np.pi, 12 * detail + 1)
    width, radius = float(shell.rings[2, 3]), WHEEL_RADIUS_M
    rings = ((radius + 0.055, (0.008, 0.008, 0.008), 0.0), (radius, RUBBER, 0.3), (0.68 * radius, RIM, 0.6))
    parts = []
    for x in AXLES_M:
        for side in (-1, 1):
            outer, inner = side * (width - 0.015), side * (width - 0.24)
            rim = np.stack([x + radius * np.cos(angle), radius * (1 + np.sin(angle))], -1)
            a, b = (np.insert(rim, 1, y, axis=1) for y in ((outer, inner) if side > 0 else (inner, outer)))
            tread = np.stack([a[:-1], a[1:], b[1:], b[:-1]], axis=1)
            parts.append(Faces.from_corners(tread, RUBBER, 0.0, BEHIND_BODY))
            for layer, (size, albedo, gloss) in enumerate(rings, start=1):
                disc = _disc((x, outer + 0.012 * layer * side, radius), size, angle * side)
                parts.append(Faces.from_corners(disc, albedo, gloss, ON_BODY + layer))
            for turn in 2 * np.pi * (np.arange(5) + 0.5) / 5:
                gap = (x + 0.14 * np.cos(turn), outer + 0.045 * side, radius + 0.14 * np.sin(turn))
                parts.append(Faces.from_corners(_disc(gap, 0.05, angle * side), PLASTIC, 0.0, ON_BODY + 4))
    return parts


def _disc(middle: tuple[float, float, float], radius: float, angle: np.ndarray) -> np.ndarray:
    """Faces (F, 4, 3) of a vertical disc, facing left for increasing `angle`, right for decreasing."""
    ring = np.stack([radius * np.cos(angle), 0 * angle, radius * np.sin(angle)], axis=-1) + middle
    centre = np.broadcast_to(middle, ring[1:].shape)
    return np.stack([centre, ring[1:], ring[:-1], centre], axis=1)
