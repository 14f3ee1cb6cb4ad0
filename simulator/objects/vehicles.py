"""Vehicles: lorries and motorcycles as shaded faces, access to the faces of all vehicles, and their painter."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from lanes.camera import Camera
from simulator.light.shading import Faces, shade_faces
from simulator.objects.cars import (
    BEHIND_BODY,
    BODIES,
    BODY,
    ON_BODY,
    PAINTS,
    PLASTIC,
    PLATE,
    RIM,
    RUBBER,
    TAIL_LAMP,
    Shell,
    box,
    car_faces,
    grid_cells,
)
from simulator.objects.scene_objects import Car, yaw_rotation
from simulator.painting.brush import Atmosphere, outside_picture, paint_polygons, project_faces

JACKET, JEANS, HELMET, STEEL = (0.020, 0.021, 0.026), (0.035, 0.045, 0.075), (0.45, 0.06, 0.03), (0.22, 0.22, 0.23)
# Rear end, front end and half width on the ground, metres.
FOOTPRINTS = {"truck": (-6.0, 6.0, 1.2), "motorcycle": (-1.0, 0.95, 0.14)}
CAR_FOOTPRINT = (-2.35, 2.3, 0.88)


def vehicle_faces(body: str, paint: str, *, detail: int = 2) -> Faces:
    """Faces of a vehicle in its own frame (x forward, y left, z up, origin on the ground below its centre).

    `body` is "sedan", "suv", "truck" or "motorcycle", `paint` a name in `cars.PAINTS`; `detail` is 1 for a far car, 2
    or more for a near one.
    """
    if body in BODIES:
        return car_faces(body, paint, detail=detail)
    return {"truck": _truck, "motorcycle": _motorcycle}[body](paint)


@lru_cache(maxsize=8)
def outline_points(body: str) -> np.ndarray:
    """Points (N, 3) on a vehicle in its own frame, whose projected hull is its outline."""
    if body in BODIES:
        return Shell(body).loft(8, 1).reshape(-1, 3)
    return vehicle_faces(body, "black").corners.reshape(-1, 3)


def facet_width_m(body: str) -> float:
    """Width in metres of the facets of curved parts, over which shading is blurred."""
    return 0.012 if body == "motorcycle" else 0.05


def footprint(body: str) -> np.ndarray:
    """Corners (4, 3) of the ground area below a vehicle, in its own frame."""
    rear, front, half = FOOTPRINTS.get(body, CAR_FOOTPRINT)
    return np.array([[rear, -half, 0], [front, -half, 0], [front, half, 0], [rear, half, 0]])


@lru_cache(maxsize=16)
def _truck(paint: str) -> Faces:
    """Faces of a lorry with a box body, 2.5 m wide, 4 m high, 12 m long, the limits of the EU."""
    colour, white = PAINTS[paint], PAINTS["white"]
    parts = [
        box((-6.0, 3.3), (-1.25, 1.25), (1.10, 3.95), white, 0.6, cells=4),
        box((3.7, 6.0), (-1.22, 1.22), (0.55, 3.2), colour, 1.0, cells=3),
        box((-5.7, 5.6), (-0.45, 0.45), (0.55, 1.05), PLASTIC, 0.2, layer=BEHIND_BODY, cells=4),
        box((-5.95, -5.80), (-1.15, 1.15), (0.42, 0.56), STEEL, 0.4),
        box((-6.03, -6.0), (-1.15, 1.15), (0.86, 1.06), PLASTIC, 0.3, layer=ON_BODY),
        # Frame of the doors, gap between them, and locking bars.
        box((-6.02, -6.0), (-1.25, 1.25), (3.86, 3.95), STEEL, 0.5, layer=ON_BODY),
        box((-6.02, -6.0), (-0.012, 0.012), (1.12, 3.86), PLASTIC, 0.2, layer=ON_BODY),
    ]
    for y in (-0.75, -0.30, 0.30, 0.75):
        parts.append(box((-6.04, -6.0), (y - 0.018, y + 0.018), (1.15, 3.84), STEEL, 0.6, layer=ON_BODY))
    for side in (-1, 1):
        outer = sorted((side * 0.72, side * 1.22))
        parts.append(
            box((-6.05, -6.03), sorted((side * 0.82, side * 1.13)), (0.88, 1.04), TAIL_LAMP, 1.3, layer=ON_BODY + 1)
        )
        parts.append(box((-5.72, -5.68), sorted((side * 0.70, side * 1.22)), (0.20, 0.95), PLASTIC, 0.1))
        for x in (-4.9, -3.7, 4.9):
            parts.append(_ellipsoid((x, side * 0.98, 0.5), (0.52, 0.20, 0.50), RUBBER, 0.2))
            parts.append(box((x - 0.35, x + 0.35), outer, (0.02, 0.7), RUBBER, 0.2))
    parts.append(box((-6.06, -6.03), (-0.26, 0.26), (0.90, 1.02), PLATE, 0.0, layer=ON_BODY + 1))
    return Faces.concatenate(parts)


@lru_cache(maxsize=16)
def _motorcycle(paint: str) -> Faces:
    """Faces of a motorcycle and its rider."""
    colour = PAINTS[paint]
    parts = [
        _ellipsoid((-0.72, 0, 0.32), (0.32, 0.085, 0.32), RUBBER, 0.2),
        _ellipsoid((0.74, 0, 0.31), (0.31, 0.065, 0.31), RUBBER, 0.2),
        _ellipsoid((0.02, 0, 0.46), (0.34, 0.17, 0.22), STEEL, 0.6),
        _ellipsoid((0.28, 0, 0.86), (0.32, 0.17, 0.16), colour, 1.0),
        _ellipsoid((0.62, 0, 0.98), (0.18, 0.22, 0.24), colour, 1.0),
        _ellipsoid((-0.60, 0, 0.78), (0.42, 0.13, 0.10), colour, 1.0),
        _ellipsoid((-0.16, 0, 0.90), (0.24, 0.20, 0.16), JEANS, 0.2),
        _ellipsoid((-0.06, 0, 1.22), (0.17, 0.235, 0.33), JACKET, 0.5),
        _ellipsoid((0.04, 0, 1.44), (0.14, 0.25, 0.13), JACKET, 0.5),
        _ellipsoid((0.13, 0, 1.64), (0.155, 0.135, 0.155), HELMET, 1.0),
        box((-1.04, -1.02), (-0.10, 0.10), (0.48, 0.62), PLATE, 0.0, layer=ON_BODY),
        box((-1.03, -1.00), (-0.08, 0.08), (0.74, 0.80), TAIL_LAMP, 1.3, layer=ON_BODY),
    ]
    for side in (-1, 1):
        parts += [
            _ellipsoid((0.06, side * 0.23, 0.82), (0.30, 0.095, 0.11), JEANS, 0.2),
            _ellipsoid((-0.02, side * 0.25, 0.52), (0.10, 0.075, 0.27), JEANS, 0.2),
            _ellipsoid((0.00, side * 0.26, 0.30), (0.16, 0.060, 0.07), RUBBER, 0.3),
            _ellipsoid((0.10, side * 0.27, 1.32), (0.13, 0.085, 0.17), JACKET, 0.5),
            _ellipsoid((0.28, side * 0.32, 1.15), (0.20, 0.070, 0.09), JACKET, 0.5),
            _ellipsoid((0.46, side * 0.36, 1.08), (0.08, 0.050, 0.05), RUBBER, 0.3),
            _ellipsoid((0.50, side * 0.40, 1.28), (0.02, 0.055, 0.035), PLASTIC, 0.8),
            _ellipsoid((-0.55, side * 0.20, 0.36), (0.36, 0.06, 0.06), RIM, 1.0),
        ]
    return Faces.concatenate(parts)


def _ellipsoid(middle: tuple, radii: tuple, albedo: tuple, gloss: float) -> Faces:
    """Faces of an ellipsoid with smooth normals."""
    around, up = np.linspace(0, 2 * np.pi, 15)[None, :], np.linspace(-np.pi / 2, np.pi / 2, 9)[:, None]
    unit = np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up) + 0 * around], axis=-1)
    cells = grid_cells(unit).reshape(-1, 4, 3)
    faces = Faces.from_corners(np.array(middle) + cells * radii, albedo, gloss, BODY)
    normal = cells.mean(axis=1) / np.array(radii)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return replace(faces, normal=normal)


def paint_vehicle(picture: np.ndarray, camera: Camera, car: Car, sun: np.ndarray, air: Atmosphere) -> None:
    """Paint the visible faces of a vehicle and its contact shadow behind the content of a canvas, in place."""
    turn = yaw_rotation(car.heading_rad)
    place = np.array([car.x_m, car.y_m, car.ground_height_m])
    if outside_picture(outline_points(car.body) @ turn.T + place, camera):
        return
    eye = (np.array([0, 0, camera.require_pose().height_m]) - place) @ turn
    distance = float(np.hypot(car.x_m, car.y_m))
    faces = vehicle_faces(car.body, car.paint, detail=1 if distance > 40 else 2)
    toward = np.flatnonzero(faces.flat_normal @ eye > faces.plane_distance)
    # Parts on the body keep their order (licence plate on bumper); body and wheels are sorted from far to near.
    layer = faces.layer[toward]
    away = faces.middle[toward] - eye
    apart = np.where(layer < ON_BODY, -np.einsum("ij,ij->i", away, away), 0)
    faces = faces.select(toward[np.lexsort((apart, layer))])
    colours = shade_faces(faces, eye, sun @ turn)
    ground = footprint(car.body)
    corners = np.concatenate([faces.corners, [ground * 1.03, ground * 0.97]]).reshape(-1, 3) @ turn.T + place
    pixels = project_faces(camera, corners.reshape(-1, 4, 3))
    cuts = np.searchsorted(faces.layer, [BODY, ON_BODY])
    # Facets are about 0.1 m wide: their shading is blurred, the outline stays sharp.
    blend = facet_width_m(car.body) * camera.matrix[0, 0] / max(distance, 2)
    parts = (slice(0, cuts[0]), slice(*cuts), slice(cuts[1], len(colours)))
    for part, blend_px in zip(parts[::-1], (0.0, blend, 0.0), strict=True):
        paint_polygons(picture, pixels[part], colours[part], atmosphere=air, blend_px=blend_px)
    blur = float(np.clip(40 / max(distance, 1), 0.5, 4))
    dark = np.full((2, 3), 0.004)
    paint_polygons(picture, pixels[-2:], dark, opacity=np.array([0.55, 0.85]), atmosphere=air, softness_px=blur)
