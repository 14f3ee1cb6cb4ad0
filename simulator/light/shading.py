"""Shading of object surfaces: irradiance from sun, sky and road, and reflections in paint and glass.

Radiance is linear RGB; horizontal white paint in the sun is 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

# Share of the sun in the light on level ground; the rest comes from the sky.
SUN_SHARE = 0.84


@dataclass(frozen=True)
class Faces:
    """Quadrilateral faces of an object: corners (F, 4, 3) in metres, normals and albedo (F, 3), gloss and layer (F,).

    Gloss is 0 for matt surfaces, 1 for paint, 2 for glass. The layer is the order of painting.
    """

    corners: np.ndarray
    normal: np.ndarray
    albedo: np.ndarray
    gloss: np.ndarray
    layer: np.ndarray

    @cached_property
    def middle(self) -> np.ndarray:
        """Centres (F, 3) of the faces."""
        return self.corners.mean(axis=1)

    @cached_property
    def flat_normal(self) -> np.ndarray:
        """Geometric normals (F, 3) of the faces; `normal` may be smoothed."""
        return face_normals(self.corners)

    @cached_property
    def plane_distance(self) -> np.ndarray:
        """Distances (F,) of the face planes from the origin along `flat_normal`; eyes beyond a plane see the face."""
        return (self.flat_normal * self.middle).sum(axis=1)

    @classmethod
    def concatenate(cls, parts: list[Faces]) -> Faces:
        """All faces of several parts."""
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in cls.__dataclass_fields__))

    def select(self, which: np.ndarray) -> Faces:
        """Faces selected by mask or indices, with their cached centres."""
        faces = Faces(*(getattr(self, name)[which] for name in self.__dataclass_fields__))
        faces.__dict__["middle"] = self.middle[which]
        return faces

    @classmethod
    def from_corners(cls, corners: ArrayLike, albedo: tuple, gloss: float, layer: int) -> Faces:
        """Faces of one material from their corners (..., 4, 3)."""
        corners = np.reshape(corners, (-1, 4, 3))
        count = len(corners)
        return cls(
            corners,
            face_normals(corners),
            np.tile(np.array(albedo, float), (count, 1)),
            np.full(count, gloss),
            np.full(count, layer),
        )


def shade_faces(faces: Faces, eye_m: np.ndarray, sun: np.ndarray) -> np.ndarray:
    """Radiance (F, 3) of each face towards `eye_m` (3,), linear RGB; horizontal white paint in the sun is 1.

    The sun is in direction `sun` (3,); all are in the faces' frame.
    """
    middle = faces.middle
    normal = faces.normal
    view = eye_m - middle
    view /= np.linalg.norm(view, axis=1, keepdims=True)
    facing = np.clip((normal * view).sum(axis=1), 0, 1)
    # Low surfaces see less sky, and the road below the car reflects little, because it is in shadow.
    open_air = 0.5 + 0.5 * np.clip((middle[:, 2:] - 0.15) / 0.5, 0, 1)
    diffuse = faces.albedo / 0.8 * irradiance(normal, sun) * open_air
    mirrored = 2 * facing[:, None] * normal - view
    base = np.array([0.0, 0.07, 0.085])[np.clip(np.round(faces.gloss), 0, 2).astype(int)]
    fresnel = (base + (np.minimum(faces.gloss, 1) - base) * (1 - facing) ** 5)[:, None]
    highlight = np.clip(mirrored @ sun, 0, 1) ** 400 * 3.0 * np.minimum(faces.gloss, 1) * (sun @ normal.T > 0)
    return diffuse * (1 - fresnel) + fresnel * (_surroundings(mirrored) + highlight[:, None])


def face_normals(corners: np.ndarray) -> np.ndarray:
    """Unit normals (F, 3) from the diagonals, which also exist for triangles (two equal corners)."""
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    return normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)


def irradiance(normal: np.ndarray, sun: np.ndarray) -> np.ndarray:
    """Irradiance (N, 3) of surfaces with `normal` (N, 3): sun, blue sky above, warm light from the road below."""
    direct = SUN_SHARE * np.clip(normal @ sun, 0, None) / max(float(sun[2]), 0.45)
    up = 0.5 + 0.5 * normal[:, 2]
    sky = (1 - SUN_SHARE) * up[:, None] * np.array([0.80, 0.98, 1.25])
    road = 0.11 * (1 - up)[:, None] * np.array([1.05, 1.0, 0.92])
    return direct[:, None] * np.array([1.02, 1.0, 0.95]) + sky + road


def _surroundings(direction: np.ndarray) -> np.ndarray:
    """Environment map for reflections: sky, a dark line of trees at the horizon, and road."""
    z = direction[:, 2:3]
    sky = np.array([0.06, 0.20, 0.46]) + np.array([0.42, 0.40, 0.28]) * np.exp(-5 * np.maximum(z, 0))
    trees, road = np.array([0.07, 0.07, 0.05]), np.array([0.10, 0.10, 0.10])
    horizon = np.clip((z - 0.06) / 0.30, 0, 1)
    ground = np.clip((-z - 0.02) / 0.08, 0, 1)
    return sky * horizon + (1 - horizon) * (trees * (1 - ground) + road * ground)
