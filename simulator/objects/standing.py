"""Objects that stand beside the road: posts, trees and bushes.

The frame of the car is x forward, y left, z up, metres; the camera is above the origin.
Every object of a scene has a `distance_m` for sorting, the `places_m` whose light it
needs, and the methods `shadows` and `paint_over`.
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
    """Place of an object in the frame of the car.

    `ground_height_m` is that of the ground above the plane under the car.
    """

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

    def cast_hull(
        self,
        points_m: np.ndarray,
        offset_per_m: np.ndarray,
    ) -> np.ndarray:
        """Shadow (M, 2) float32 of the convex hull of points (N, 3).

        The points are relative to the foot. `offset_per_m` (2,) is the horizontal
        offset of a shadow for each metre of height.
        """
        foot = self.foot_m[:2] + points_m[:, :2]
        cast = foot + points_m[:, 2:] * offset_per_m
        return cv2.convexHull(cast.astype(np.float32)).reshape(-1, 2)


# Normal of a surface that faces the car.
FACING_REAR = np.array([[-1.0, 0, 0]])


@dataclass(frozen=True)
class Post(Standing):
    """Vertical pole: a delineator, a utility pole or a street lamp.

    A street lamp has an arm of length `arm_m`.
    """

    height_m: float
    width_m: float = 0.1
    arm_m: float = 0.0
    colour: tuple[float, float, float] = (0.55, 0.55, 0.53)

    @property
    def pole(self) -> np.ndarray:
        """Corners (4, 3) of the pole, relative to its foot."""
        half = self.width_m / 2
        return upright_rectangle(0, (-half, half), (0, self.height_m))

    def shadows(self, offset_per_m: np.ndarray) -> list[np.ndarray]:
        """Shadow polygon (N, 2) of the pole; see `Standing.cast_hull`."""
        return [self.cast_hull(self.pole, offset_per_m)]

    def paint_over(
        self,
        canvas: Canvas,
        sun: np.ndarray,
        air: Atmosphere,
        light: np.ndarray,
    ) -> None:
        """Paint the post, and the arm and the head of a street lamp."""
        faces = [self.pole]
        if self.arm_m:
            end = self.arm_m
            top = self.height_m
            span = sorted((0.0, end))
            faces += [
                upright_rectangle(0, span, (top - 0.06, top + 0.06)),
                upright_rectangle(
                    0, (end - 0.35, end + 0.35), (top - 0.12, top + 0.10)
                ),
            ]
        pixels = canvas.project_faces(np.array(faces) + self.foot_m)
        colour = np.array(self.colour) * irradiance(FACING_REAR, sun) / 0.8
        colours = np.repeat(colour, len(faces), axis=0)
        paint_polygons(canvas, pixels, colours, atmosphere=air.dimmed(light[0]))


def upright_rectangle(
    x: float,
    y: Sequence[float],
    z: Sequence[float],
) -> np.ndarray:
    """Corners (4, 3) of a rectangle across the road between two values of y and z.

    It faces the rear if `y` rises, else the front.
    """
    near, far = y
    low, high = z
    return np.array(
        [
            (x, near, low),
            (x, near, high),
            (x, far, high),
            (x, far, low),
        ]
    )


# A tree is a trunk and a crown of lumps, which are painted and cast the shadow.
LUMPS = 45
SHADOW_CORNERS = 12
# Width of a trunk as a share of the height of the tree, and least half width of its
# shadow.
TRUNK_WIDTH = 0.035
MIN_TRUNK_M = 0.12
BARK = np.array([0.12, 0.09, 0.07])
# Painted lumps are larger and more even than those of the shadow, which leaves flecks
# of sun.
PAINTED_RADIUS = 1.5


@dataclass(frozen=True)
class Species:
    """Shape and colours of a species.

    Lengths are shares of its height. The linear RGB colours are those of lumps in the
    sun and in shade.
    """

    crown_width: float
    crown_bottom: float
    lump_radius: float
    sun_colour: tuple[float, float, float]
    shade_colour: tuple[float, float, float]
    taper: float = 0.0


SPECIES = {
    "oak": Species(
        crown_width=1.0,
        crown_bottom=0.14,
        lump_radius=0.135,
        sun_colour=(0.110, 0.108, 0.032),
        shade_colour=(0.012, 0.014, 0.006),
    ),
    "eucalyptus": Species(
        crown_width=0.66,
        crown_bottom=0.16,
        lump_radius=0.10,
        sun_colour=(0.120, 0.115, 0.046),
        shade_colour=(0.014, 0.016, 0.010),
    ),
    "plane": Species(
        crown_width=1.05,
        crown_bottom=0.2,
        lump_radius=0.085,
        sun_colour=(0.120, 0.100, 0.045),
        shade_colour=(0.024, 0.021, 0.013),
    ),
    "cypress": Species(
        crown_width=0.30,
        crown_bottom=0.03,
        lump_radius=0.07,
        sun_colour=(0.048, 0.060, 0.024),
        shade_colour=(0.008, 0.011, 0.006),
        taper=0.85,
    ),
    "redwood": Species(
        crown_width=0.46,
        crown_bottom=0.06,
        lump_radius=0.075,
        sun_colour=(0.052, 0.066, 0.024),
        shade_colour=(0.008, 0.011, 0.006),
        taper=0.8,
    ),
    "bush": Species(
        crown_width=1.45,
        crown_bottom=-0.12,
        lump_radius=0.20,
        sun_colour=(0.130, 0.130, 0.038),
        shade_colour=(0.014, 0.017, 0.007),
    ),
    "scrub": Species(
        crown_width=1.9,
        crown_bottom=-0.12,
        lump_radius=0.19,
        sun_colour=(0.160, 0.125, 0.058),
        shade_colour=(0.028, 0.024, 0.013),
    ),
}


@dataclass(frozen=True, eq=False)
class Crown:
    """Lumps of a tree.

    Heights (N,) as shares, offsets from the trunk (N, 2), outlines of shadows (N, 12,
    2), and radii (N,) of painted lumps.
    """

    share: np.ndarray
    aside_m: np.ndarray
    outline_m: np.ndarray
    radius_m: np.ndarray


def _directions(angle: np.ndarray) -> np.ndarray:
    """Unit vectors (N, 2) at angles (N,)."""
    return np.column_stack([np.cos(angle), np.sin(angle)])


OCTAGON = _directions(np.arange(8) * np.pi / 4)


@lru_cache(maxsize=512)
def crown(species: str, seed: int, height_m: float) -> Crown:
    """Crown of a tree; seeded, so it is the same in all frames."""
    kind = SPECIES[species]
    rng = np.random.default_rng([seed, 7])

    # Heights of the lumps, and places inside the width of the crown.
    low = max(kind.crown_bottom, 0.0)
    share = low + (1 - low) * rng.uniform(0.08, 0.92, LUMPS)
    reach = np.sqrt(rng.uniform(0, 1, LUMPS)) * kind.crown_width / 2 * height_m
    reach *= 1 - kind.taper * share
    toward = rng.uniform(0, 2 * np.pi, LUMPS)

    # Ragged outlines.
    size = height_m * kind.lump_radius * rng.uniform(0.2, 0.8, (LUMPS, 1))
    size = size * rng.uniform(0.3, 1.4, (LUMPS, SHADOW_CORNERS))
    angle = np.linspace(0, 2 * np.pi, SHADOW_CORNERS, endpoint=False)
    outline = size[..., None] * _directions(angle)
    mean_radius = np.linalg.norm(outline, axis=2).mean(axis=1)
    return Crown(
        share=share,
        aside_m=reach[:, None] * _directions(toward),
        outline_m=outline,
        radius_m=PAINTED_RADIUS * np.sqrt(mean_radius * kind.lump_radius * height_m),
    )


@dataclass(frozen=True)
class Tree(Standing):
    """Tree or bush.

    `species` is a name in `SPECIES`, `base_m` the height of its foot above the road.
    """

    height_m: float
    species: str
    seed: int
    base_m: float = 0.0

    @property
    def fork(self) -> float:
        """Height of the painted trunk as a share of the tree's."""
        return max(SPECIES[self.species].crown_bottom, 0.0) + 0.3

    @property
    def crown(self) -> Crown:
        """Lumps of its leaves."""
        return crown(self.species, self.seed, self.height_m)

    def shadows(self, offset_per_m: np.ndarray) -> list[np.ndarray]:
        """Polygons (N, 2) of the shadows of the lumps, and of the trunk.

        There are flecks of sun between the lumps.
        """
        lumps = self.crown
        height = lumps.share * self.height_m + self.base_m
        middle = self.places_m + lumps.aside_m + height[:, None] * offset_per_m

        # A lump is as tall as wide, so its shadow gets longer with a low sun.
        length = np.linalg.norm(offset_per_m)
        away = offset_per_m / max(length, 1e-9)
        outward = (lumps.outline_m @ away)[..., None]
        outline = lumps.outline_m + 0.3 * length * outward * away
        polygons = (middle[:, None] + outline).astype(np.float32)

        half = max(MIN_TRUNK_M, TRUNK_WIDTH * self.height_m / 2)
        trunk = upright_rectangle(0, (-half, half), (0, self.height_m * self.fork))
        return [*polygons, self.cast_hull(trunk, offset_per_m)]

    def paint_over(
        self,
        canvas: Canvas,
        sun: np.ndarray,
        air: Atmosphere,
        light: np.ndarray,
    ) -> None:
        """Paint the trunk, and the crown from the far lumps to the near ones.

        Nothing is painted outside the view of the lens.
        """
        axes = self._axes_px(canvas)
        if axes is None:
            return
        foot, right, up = axes
        half = TRUNK_WIDTH * self.height_m / 2
        fork_m = self.fork * self.height_m
        corners = np.array(
            [
                [-half, 0],
                [-half, fork_m],
                [half, fork_m],
                [half, 0],
            ]
        )
        trunk = foot + corners[:, :1] * right + corners[:, 1:] * up

        # Lumps from far to near.
        lumps = self.crown
        to_eye = -self.foot_m[:2] / max(self.distance_m, 1e-6)
        order = np.argsort(lumps.aside_m @ to_eye, kind="stable")
        aside = lumps.aside_m[order]
        share = lumps.share[order]
        radius = lumps.radius_m[order]

        # The top of the crown stays below the height of the tree.
        across = aside @ np.array([-to_eye[1], to_eye[0]])
        height = np.minimum(share * self.height_m, self.height_m - radius)
        octagon = OCTAGON[:, :1] * right + OCTAGON[:, 1:] * up
        middle = foot + across[:, None, None] * right + height[:, None, None] * up
        blots = middle + radius[:, None, None] * octagon

        colours = np.vstack([0.5 * BARK, self._lump_colours(aside, share, sun)])
        polygons = [trunk, *blots]
        paint_polygons(canvas, polygons, colours, atmosphere=air.dimmed(light[0]))

    def _axes_px(self, canvas: Canvas) -> tuple[np.ndarray, ...] | None:
        """Pixel (2,) of the foot, and pixels of a metre to the right and of one up.

        None outside the view of the lens.
        """
        # Points a little above the foot: the top can be outside the view of a lens that
        # sees the trunk.
        foot_m = self.foot_m + [0, 0, self.base_m]
        ends = foot_m + [[0, 0, 0.9], [0, 0, 1.9]]
        if (heights_above(canvas.frustum, ends) < -1e-9).any():
            return None
        low, high = canvas.camera.road_to_pixels(ends)
        up = high - low
        right = np.array([-up[1], up[0]])
        return low - 0.9 * up, right, up

    def _lump_colours(
        self,
        aside: np.ndarray,
        share: np.ndarray,
        sun: np.ndarray,
    ) -> np.ndarray:
        """Colours (N, 3), light on the side of the crown that faces the sun."""
        kind = SPECIES[self.species]
        outward = 2 * aside / (kind.crown_width * self.height_m)
        side = np.column_stack([outward, 2 * share - 1])
        facing = np.clip(0.40 + 0.45 * side @ sun, 0.05, 1)
        shade = np.array(kind.shade_colour)
        bright = np.array(kind.sun_colour)
        return shade + facing[:, None] * (bright - shade)
