"""Paints vehicles with their contact shadow."""

from __future__ import annotations

import numpy as np

from lanes.camera import Camera
from simulator.light.shading import shade_faces
from simulator.objects.cars import BODY, ON_BODY
from simulator.objects.scene_objects import Car, yaw_rotation
from simulator.objects.vehicles import facet_width_m, footprint, outline_points, vehicle_faces
from simulator.painting.brush import Atmosphere, outside_picture, paint_polygons, project_faces


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
