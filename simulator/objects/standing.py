"""Objects that stand beside the road: posts, trees and bushes.

The frame of the car is x forward, y left, z up, metres; the camera is above the origin. Every object of a scene has a
`distance_m` for sorting, the `places_m` whose light it needs, and the methods `shadows` and `paint_over`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from simulator.light.sunlight import irradiance
from simulator.painting import Atmosphere, Canvas, heights_above, paint_polygons


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
        return [
            self.cast_hull(
                upright_rectangle(0, (-half, half), (0, self.height_m)), offset_per_m
            )
        ]

    def paint_over(
        self, canvas: Canvas, sun: np.ndarray, air: Atmosphere, light: np.ndarray
    ) -> None:
        """Paint the post, and the arm and the head of a street lamp."""
        half, top = self.width_m / 2, self.height_m
        faces = [upright_rectangle(0, (-half, half), (0, top))]
        if self.arm_m:
            faces.append(
                upright_rectangle(
                    0, sorted((0.0, self.arm_m)), (top - 0.06, top + 0.06)
                )
            )
            faces.append(
                upright_rectangle(
                    0, (self.arm_m - 0.35, self.arm_m + 0.35), (top - 0.12, top + 0.10)
                )
            )
        colour = np.array(self.colour) * irradiance(np.array([[-1.0, 0, 0]]), sun) / 0.8
        pixels = canvas.project_faces(np.array(faces) + self.foot_m)
        paint_polygons(
            canvas,
            pixels,
            np.repeat(colour, len(faces), axis=0),
            atmosphere=air.dimmed(light[0]),
        )


def upright_rectangle(x: float, y: Sequence[float], z: Sequence[float]) -> np.ndarray:
    """Corners (4, 3) of a rectangle across the road: it faces the rear if `y` rises, else the front."""
    return np.array(
        [(x, y[0], z[0]), (x, y[0], z[1]), (x, y[1], z[1]), (x, y[1], z[0])]
    )


# A tree is a trunk and a crown of lumps, which are painted and cast the shadow.
LUMPS = 45
# Width of a trunk as a share of the height of the tree.
TRUNK_WIDTH, BARK = 0.035, (0.12, 0.09, 0.07)
# Painted lumps are larger and more even than those of the shadow, which leaves flecks of sun.
PAINTED_RADIUS = 1.5
OCTAGON = np.stack([f(np.arange(8) * np.pi / 4) for f in (np.cos, np.sin)], axis=-1)


@dataclass(frozen=True)
class Species:
    """Shape and colours of a species: lengths as shares of its height, linear RGB of lumps in the sun and in shade."""

    crown_width: float
    crown_bottom: float
    lump_radius: float
    sun_colour: tuple[float, float, float]
    shade_colour: tuple[float, float, float]
    taper: float = 0.0


SPECIES = {
    "oak": Species(1.0, 0.14, 0.135, (0.110, 0.108, 0.032), (0.012, 0.014, 0.006)),
    "eucalyptus": Species(
        0.66, 0.16, 0.10, (0.120, 0.115, 0.046), (0.014, 0.016, 0.010)
    ),
    "plane": Species(1.05, 0.2, 0.085, (0.120, 0.100, 0.045), (0.024, 0.021, 0.013)),
    "cypress": Species(
        0.30, 0.03, 0.07, (0.048, 0.060, 0.024), (0.008, 0.011, 0.006), taper=0.85
    ),
    "redwood": Species(
        0.46, 0.06, 0.075, (0.052, 0.066, 0.024), (0.008, 0.011, 0.006), taper=0.8
    ),
    "bush": Species(1.45, -0.12, 0.20, (0.130, 0.130, 0.038), (0.014, 0.017, 0.007)),
    "scrub": Species(1.9, -0.12, 0.19, (0.160, 0.125, 0.058), (0.028, 0.024, 0.013)),
}


@dataclass(frozen=True, eq=False)
class Crown:
    """Lumps of a tree: heights (N,) as shares, offsets from the trunk (N, 2), outlines of shadows (N, 12, 2), radii."""

    share: np.ndarray
    aside_m: np.ndarray
    outline_m: np.ndarray
    radius_m: np.ndarray


@lru_cache(maxsize=512)
def crown(species: str, seed: int, height_m: float) -> Crown:
    """Crown of a tree; seeded, so it is the same in all frames."""
    kind = SPECIES[species]
    rng = np.random.default_rng([seed, 7])
    angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    low = max(kind.crown_bottom, 0.0)
    share = low + (1 - low) * rng.uniform(0.08, 0.92, LUMPS)
    reach = (
        np.sqrt(rng.uniform(0, 1, LUMPS))
        * kind.crown_width
        / 2
        * height_m
        * (1 - kind.taper * share)
    )
    toward = rng.uniform(0, 2 * np.pi, LUMPS)
    aside = reach[:, None] * np.column_stack([np.cos(toward), np.sin(toward)])
    size = (
        height_m
        * kind.lump_radius
        * rng.uniform(0.2, 0.8, (LUMPS, 1))
        * rng.uniform(0.3, 1.4, (LUMPS, 12))
    )
    outline = size[..., None] * np.column_stack([np.cos(angle), np.sin(angle)])
    cast = np.linalg.norm(outline, axis=2).mean(axis=1)
    return Crown(
        share,
        aside,
        outline,
        PAINTED_RADIUS * np.sqrt(cast * kind.lump_radius * height_m),
    )


@dataclass(frozen=True)
class Tree(Standing):
    """Tree or bush; `species` is a name in `SPECIES`, `base_m` the height of its foot above the road."""

    height_m: float = 10.0
    species: str = "oak"
    seed: int = 0
    base_m: float = 0.0

    @property
    def fork(self) -> float:
        """Height of the painted trunk as a share of the tree's."""
        return max(SPECIES[self.species].crown_bottom, 0.0) + 0.3

    def shadows(self, offset_per_m: np.ndarray) -> list[np.ndarray]:
        """Polygons (N, 2) of the shadows of the lumps, with sun flecks between them, and of the trunk."""
        lumps = crown(self.species, self.seed, self.height_m)
        middle = (
            self.places_m
            + lumps.aside_m
            + (lumps.share * self.height_m + self.base_m)[:, None] * offset_per_m
        )
        # A lump is as tall as wide, so its shadow gets longer with a low sun.
        away = offset_per_m / max(np.linalg.norm(offset_per_m), 1e-9)
        outline = (
            lumps.outline_m
            + 0.3
            * np.linalg.norm(offset_per_m)
            * (lumps.outline_m @ away)[..., None]
            * away
        )
        half = max(0.12, TRUNK_WIDTH * self.height_m / 2)
        trunk = upright_rectangle(0, (-half, half), (0, self.height_m * self.fork))
        return [
            *(middle[:, None] + outline).astype(np.float32),
            self.cast_hull(trunk, offset_per_m),
        ]

    def paint_over(
        self, canvas: Canvas, sun: np.ndarray, air: Atmosphere, light: np.ndarray
    ) -> None:
        """Paint the trunk, and the crown from the far lumps to the near ones; nothing outside the view of the lens."""
        # Points a little above the foot: the top can be outside the view of a lens that sees the trunk.
        ends = self.foot_m + [0, 0, self.base_m] + np.array([[0, 0, 0.9], [0, 0, 1.9]])
        if (heights_above(canvas.frustum, ends) < -1e-9).any():
            return
        low, high = canvas.camera.road_to_pixels(ends)
        up = high - low
        foot, right = low - 0.9 * up, np.array([-up[1], up[0]])
        kind, lumps = (
            SPECIES[self.species],
            crown(self.species, self.seed, self.height_m),
        )
        to_eye = -self.foot_m[:2] / max(self.distance_m, 1e-6)
        order = np.argsort(lumps.aside_m @ to_eye, kind="stable")
        aside, share, radius = (
            lumps.aside_m[order],
            lumps.share[order],
            lumps.radius_m[order],
        )
        across = aside @ np.array([-to_eye[1], to_eye[0]])
        outline = radius[:, None, None] * (
            OCTAGON[..., :1] * right + OCTAGON[..., 1:] * up
        )
        # The top of the crown stays below the height of the tree.
        height = np.minimum(share * self.height_m, self.height_m - radius)
        blots = (
            foot + across[:, None, None] * right + height[:, None, None] * up + outline
        )
        half, fork_m = TRUNK_WIDTH * self.height_m / 2, self.fork * self.height_m
        corners = np.array([[-half, 0], [-half, fork_m], [half, fork_m], [half, 0]])
        trunk = foot + corners[:, :1] * right + corners[:, 1:] * up
        # Lumps are light where their side of the crown faces the sun.
        side = np.column_stack(
            [2 * aside / (kind.crown_width * self.height_m), 2 * share - 1]
        )
        facing = np.clip(0.40 + 0.45 * side @ sun, 0.05, 1)[:, None]
        shade, bright = np.array(kind.shade_colour), np.array(kind.sun_colour)
        colours = np.vstack([0.5 * np.array(BARK), shade + facing * (bright - shade)])
        paint_polygons(
            canvas, [trunk, *blots], colours, atmosphere=air.dimmed(light[0])
        )
