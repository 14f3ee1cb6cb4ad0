"""Bridge across the road: front, deck, side walls, and its shadow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simulator.light.sunlight import BOUNCED_SHARE, BridgeShade, irradiance
from simulator.painting.brush import Atmosphere, Canvas, paint_polygons
from simulator.road.geometry import RoadGeometry, VehiclePose, surface_points

CONCRETE = np.array([0.36, 0.345, 0.315])
SLICE_M = 5.0
# Height of the deck with its railing, and length of the approach walls on either side of the opening.
DECK_M, APPROACH_M = 1.8, 54.0
# Light below the deck is reflected by the road: about the mean reflectance of asphalt, more near the edges.
FROM_ROAD = 0.08
MAX_BRIDGE_M = 420.0


@dataclass(frozen=True)
class Overpass:
    """Bridge from arc length `start_m` to `end_m`, with an opening from lateral `low_m` to `high_m`.

    `skew` is ds/dd of its edges, as in `BridgeShade`; `clearance_m` is the height of the deck above the road.
    """

    start_m: float
    end_m: float
    low_m: float
    high_m: float
    clearance_m: float = 5.0
    skew: float = 0.0

    def shade(self) -> BridgeShade:
        """Shadow of the bridge for a high sun, including the skylight that it blocks."""
        return BridgeShade(self.start_m, self.end_m, self.skew, self.clearance_m)

    def slices_at(self, road: RoadGeometry, pose: VehiclePose) -> list[BridgeSlice]:
        """Slices of the bridge in the car's road frame, which can be sorted by distance."""
        if self.end_m < pose.s_m - 2 or self.start_m > pose.s_m + MAX_BRIDGE_M:
            return []
        low, high, under, top = self.low_m, self.high_m, self.clearance_m, self.clearance_m + DECK_M
        front = [
            self._sheet((low - APPROACH_M, low), (self.start_m, self.start_m), (0.0, top)),
            self._sheet((high, high + APPROACH_M), (self.start_m, self.start_m), (0.0, top)),
            self._sheet((low, high), (self.start_m, self.start_m), (under, top)),
        ]
        parts = [BridgeSlice(np.concatenate(front), np.ones(sum(map(len, front))), front=True)]
        edges = np.linspace(self.start_m, self.end_m, max(2, round((self.end_m - self.start_m) / SLICE_M)) + 1)
        # Slices overlap, because their anti-aliased edges would show what is behind.
        parts += [self._below((start - 0.5, end)) for start, end in zip(edges[:-1], edges[1:], strict=True)]
        return [BridgeSlice(_in_car(part.faces_m, road, pose), part.light, part.front) for part in parts]

    def _sheet(self, d: tuple[float, float], s: tuple[float, float], z: tuple[float, float]) -> np.ndarray:
        """Faces (F, 4, 3) across the road in (s, d, z), 3 m wide, because the lens bends straight lines."""
        edges = np.linspace(*d, max(2, round((d[1] - d[0]) / 3)) + 1)
        return self._skewed([[(s[0], a, z[0]), (s[1], a, z[1]), (s[1], b, z[1]), (s[0], b, z[0])]
                             for a, b in zip(edges[:-1], edges[1:], strict=True)])  # fmt: skip

    def _below(self, s: tuple[float, float]) -> BridgeSlice:
        """Underside of the deck and the side walls below it; light as a share of open sky."""
        top = self.clearance_m
        deck = self._sheet((self.low_m, self.high_m), s, (top, top))
        sides = [[(s[0], d, 0.0), (s[0], d, top), (s[1], d, top), (s[1], d, 0.0)] for d in (self.low_m, self.high_m)]
        open_sky = 1 - float(self.shade().blocked_sky(np.float32(sum(s) / 2)))
        # A vertical wall sees half of the ground's sky, and the road.
        wall = FROM_ROAD / 2 + 0.5 * max(open_sky, BOUNCED_SHARE) * 0.16
        light = [*np.full(len(deck), FROM_ROAD * (0.4 + 0.5 * open_sky)), wall, wall]
        return BridgeSlice(np.concatenate([deck, self._skewed(sides)]), np.array(light))

    def _skewed(self, faces: list) -> np.ndarray:
        corners = np.array(faces, float)
        corners[..., 0] += self.skew * corners[..., 1]
        return corners


@dataclass(frozen=True, eq=False)
class BridgeSlice:
    """Slice of a bridge in the car's road frame: faces (F, 4, 3) in metres, and the light (F,) on them.

    Faces with `front` are in open daylight, and their `light` is a factor on the colour.
    """

    faces_m: np.ndarray
    light: np.ndarray
    front: bool = False

    # The light below a bridge is its own.
    places_m = np.empty((0, 2))

    @property
    def distance_m(self) -> float:
        """Sorting distance in metres: along the road to the median of the corners."""
        return float(np.abs(np.median(self.faces_m[..., 0])))

    def shadows(self, offset_per_m: np.ndarray) -> list[np.ndarray]:
        """Empty, because `Overpass.shade` is the shadow of the bridge."""
        return []

    def paint_over(self, canvas: Canvas, sun: np.ndarray, air: Atmosphere, light: np.ndarray) -> None:
        """Paint the slice."""
        daylight = irradiance(np.array([[-1.0, 0, 0]]), sun)[0] if self.front else np.ones(3)
        colours = self.light[:, None] * CONCRETE * daylight / 0.8
        paint_polygons(canvas, canvas.project_faces(self.faces_m), colours, atmosphere=air)


def _in_car(faces: np.ndarray, road: RoadGeometry, pose: VehiclePose) -> np.ndarray:
    """Convert faces (F, 4, 3) from (s, d, z) to the car's road frame (x, y, z)."""
    return surface_points(road, pose, faces[..., 0], faces[..., 1]) + faces[..., 2:] * [0, 0, 1]
