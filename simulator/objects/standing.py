"""Objects that stand on the road or beside it; the simplest of them is a post.

The frame of the car is x forward, y left, z up, metres; the camera is above the origin. Every object of a scene has a
`distance_m` for sorting, the `places_m` whose light it needs, and the methods `shadows` and `paint_over`.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from simulator.light.sunlight import irradiance
from simulator.painting.brush import Atmosphere, Canvas, paint_polygons


@dataclass(frozen=True, kw_only=True)
class Standing:
    """Place of an object in the frame of the car, `ground_height_m` above the plane under the car."""

    x_m: float = 0.0
    y_m: float = 0.0
    ground_height_m: float = 0.0

    @property
    def foot_m(self) -> np.ndarray:
        """Position (3,) on the ground."""
        return np.array([self.x_m, self.y_m, self.ground_height_m])

    @property
    def distance_m(self) -> float:
        """Horizontal distance from the camera."""
        return float(np.hypot(self.x_m, self.y_m))

    @property
    def places_m(self) -> np.ndarray:
        """Position (1, 2) of the object."""
        return self.foot_m[None, :2]

    def cast_hull(self, points_m: np.ndarray, offset_per_m: np.ndarray) -> np.ndarray:
        """Shadow (M, 2) float32 of the convex hull of points (N, 3) relative to the foot.

        `offset_per_m` (2,) is the horizontal offset of a shadow for each metre of height.
        """
        cast = self.foot_m[:2] + points_m[:, :2] + points_m[:, 2:] * offset_per_m
        return cv2.convexHull(cast.astype(np.float32)).reshape(-1, 2)


@dataclass(frozen=True)
class Post(Standing):
    """Vertical pole: a delineator (1 m), a utility pole or, with an arm of length `arm_m`, a street lamp."""

    height_m: float = 1.0
    width_m: float = 0.1
    arm_m: float = 0.0
    colour: tuple[float, float, float] = (0.55, 0.55, 0.53)

    def shadows(self, offset_per_m: np.ndarray) -> list[np.ndarray]:
        """Shadow polygon (N, 2) of the pole; see `Standing.cast_hull`."""
        half = self.width_m / 2
        return [self.cast_hull(vertical_rectangle(0, half, half, 0, self.height_m), offset_per_m)]

    def paint_over(self, canvas: Canvas, sun: np.ndarray, air: Atmosphere, light: np.ndarray) -> None:
        """Paint the post, and the arm and the head of a street lamp."""
        half, top = self.width_m / 2, self.height_m
        faces = [vertical_rectangle(0, half, half, 0, top)]
        if self.arm_m:
            low, high = sorted((0.0, self.arm_m))
            faces.append(vertical_rectangle(0, high, -low, top - 0.06, top + 0.06))
            faces.append(vertical_rectangle(self.arm_m, 0.35, 0.35, top - 0.12, top + 0.10))
        colour = np.array(self.colour) * irradiance(np.array([[-1.0, 0, 0]]), sun) / 0.8
        pixels = canvas.project_faces(np.array(faces) + self.foot_m)
        paint_polygons(canvas, pixels, np.repeat(colour, len(faces), axis=0), atmosphere=air.dimmed(light[0]))


def vertical_rectangle(y: float, left: float, right: float, bottom: float, top: float) -> np.ndarray:
    """Corners (4, 3) of a vertical rectangle across the road: lower right, upper right, upper left, lower left."""
    return np.array([[0, y - right, bottom], [0, y - right, top], [0, y + left, top], [0, y + left, bottom]])
