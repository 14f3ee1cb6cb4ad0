"""Light on solid things: sun, sky and road on a surface, and what paint and glass mirror.

White paint that lies in the sun is 1, as in the whole renderer.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

# Share of the light on level ground that comes from the sun itself, the rest from the sky.
SUN_SHARE = 0.84


@dataclass(frozen=True)
class Faces:
    """Faces (F, 4, 3), metres; normals and colours (F, 3); gloss (F,): 0 matt, 1 paint, 2 glass; layer (F,)."""

    corners: np.ndarray
    normal: np.ndarray
    albedo: np.ndarray
    gloss: np.ndarray
    layer: np.ndarray

    @cached_property
    def middle(self) -> np.ndarray:
        """(F, 3) means of the corners."""
        return self.corners.mean(axis=1)

    @cached_property
    def flat_normal(self) -> np.ndarray:
        """(F, 3) normals of the faces themselves; `normal` may be smoothed."""
        return face_normals(self.corners)

    @cached_property
    def plane_distance(self) -> np.ndarray:
        """(F,) how far from the origin, along `flat_normal`, each face is: an eye that is farther sees it."""
        return (self.flat_normal * self.middle).sum(axis=1)

    @classmethod
    def concatenate(cls, parts: list[Faces]) -> Faces:
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in cls.__dataclass_fields__))

    def select(self, which: np.ndarray) -> Faces:
        """Some of the faces, by mask or by order; their middles are taken along, not computed again."""
        faces = Faces(*(getattr(self, name)[which] for name in self.__dataclass_fields__))
        faces.__dict__["middle"] = self.middle[which]
        return faces

    @classmethod
    def from_corners(cls, corners: np.ndarray, albedo: tuple, gloss: float, layer: int) -> Faces:
        corners = np.reshape(corners, (-1, 4, 3))
        count = len(corners)
        return cls(
            corners,
            face_normals(corners),
            np.tile(np.float64(albedo), (count, 1)),
            np.full(count, gloss),
            np.full(count, layer),
        )


def shade_faces(faces: Faces, eye_m: np.ndarray, sun: np.ndarray) -> np.ndarray:
    """Radiance of each face seen from `eye_m` (3,) under the sun in direction `sun` (3,), all in the faces' frame.

    Returns
    -------
    ndarray of shape (F, 3)
        Linear RGB; white paint lying in the sun is 1.
    """
    middle = faces.middle
    normal = faces.normal
    view = eye_m - middle
    view /= np.linalg.norm(view, axis=1, keepdims=True)
    facing = np.clip((normal * view).sum(axis=1), 0, 1)
    # Near the road less sky is seen, and what comes back from it has been in the car's own shadow.
    open_air = 0.5 + 0.5 * np.clip((middle[:, 2:] - 0.15) / 0.5, 0, 1)
    diffuse = faces.albedo / 0.8 * irradiance(normal, sun) * open_air
    mirrored = 2 * facing[:, None] * normal - view
    base = np.array([0.0, 0.07, 0.085])[np.clip(np.round(faces.gloss), 0, 2).astype(int)]
    fresnel = (base + (np.minimum(faces.gloss, 1) - base) * (1 - facing) ** 5)[:, None]
    highlight = np.clip(mirrored @ sun, 0, 1) ** 400 * 3.0 * np.minimum(faces.gloss, 1) * (sun @ normal.T > 0)
    return diffuse * (1 - fresnel) + fresnel * (_surroundings(mirrored) + highlight[:, None])


def face_normals(corners: np.ndarray) -> np.ndarray:
    """(F, 3) unit normals from the diagonals, so that a face whose corners coincide in pairs still has one."""
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    return normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)


def irradiance(normal: np.ndarray, sun: np.ndarray) -> np.ndarray:
    """Light (N, 3) on surfaces with `normal` (N, 3): sun, blue sky from above, warm light from the road below."""
    direct = SUN_SHARE * np.clip(normal @ sun, 0, None) / max(float(sun[2]), 0.45)
    up = 0.5 + 0.5 * normal[:, 2]
    sky = (1 - SUN_SHARE) * up[:, None] * np.array([0.80, 0.98, 1.25])
    road = 0.11 * (1 - up)[:, None] * np.array([1.05, 1.0, 0.92])
    return direct[:, None] * np.array([1.02, 1.0, 0.95]) + sky + road


def _surroundings(direction: np.ndarray) -> np.ndarray:
    """What paint and glass mirror: sky, a dark line of trees at the horizon, the road."""
    z = direction[:, 2:3]
    sky = np.array([0.06, 0.20, 0.46]) + np.array([0.42, 0.40, 0.28]) * np.exp(-5 * np.maximum(z, 0))
    trees, road = np.array([0.07, 0.07, 0.05]), np.array([0.10, 0.10, 0.10])
    horizon = np.clip((z - 0.06) / 0.30, 0, 1)
    ground = np.clip((-z - 0.02) / 0.08, 0, 1)
    return sky * horizon + (1 - horizon) * (trees * (1 - ground) + road * ground)
