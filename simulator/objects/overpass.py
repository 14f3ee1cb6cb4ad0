"""Bridge across the road: deck on beams, side walls, and its shadow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lanes.camera import Camera
from simulator.light.shading import irradiance
from simulator.light.sunlight import BOUNCED_SHARE, BridgeShade, blocked_sky
from simulator.painting.brush import Atmosphere, paint_polygons, project_faces
from simulator.road.geometry import RoadGeometry, VehiclePose, surface_points

CONCRETE = np.array([0.36, 0.345, 0.315])
BEAM_EVERY_M, BEAM_M = 2.4, 0.8
BEAMS_PER_SLICE = 3
DECK_M, RAILING_M = 1.15, 0.95
# Length of the approach walls on either side of the opening, and width of their panels.
APPROACH_M, PANEL_M = 54.0, 3.0
# Light below the deck is reflected by the road: about the mean reflectance of asphalt, more near the edges.
FROM_ROAD = 0.08
MAX_BRIDGE_M = 420.0


@dataclass(frozen=True)
class Overpass:
    """Bridge from arc length `start_m` to `end_m`, with an opening from lateral `low_m` to `high_m`.

    `skew` is ds/dd of its edges, as in `BridgeShade`; `clearance_m` is the height of the beams above the road.
    """

    start_m: float
    end_m: float
    low_m: float
    high_m: float
    clearance_m: float = 5.0
    skew: float = 0.0
    seed: int = 0

    def shade(self) -> BridgeShade:
        """Shadow of the bridge for a high sun, including the skylight that it blocks."""
        return BridgeShade(self.start_m, self.end_m, self.skew, self.clearance_m)

    def slices_at(self, road: RoadGeometry, pose: VehiclePose) -> list[BridgeSlice]:
        """Slices of the bridge in the car's road frame, which can be sorted by distance."""
        if self.end_m < pose.s_m - 2 or self.start_m > pose.s_m + MAX_BRIDGE_M:
            return []
        count = max(2, round((self.end_m - self.start_m) / BEAM_EVERY_M))
        edges = np.linspace(self.start_m, self.end_m, count + 1)
        slices = [self._underside(low, high) for low, high in zip(edges[:-1], edges[1:], strict=True)]
        # Several beams in one slice, far ones first, because each paint call covers the upper half of the image.
        groups = [slices[i : i + BEAMS_PER_SLICE][::-1] for i in range(0, count, BEAMS_PER_SLICE)]
        faces, tones = self._front()
        front = BridgeSlice(_in_car(faces, road, pose), tones, front=True)
        joined = [[np.concatenate(parts) for parts in zip(*group, strict=True)] for group in groups]
        return [front, *(BridgeSlice(_in_car(faces, road, pose), light) for faces, light in joined)]

    def _front(self) -> tuple[np.ndarray, np.ndarray]:
        """Faces and tones of approach walls, edge of the deck and railing, all at `start_m`."""
        low, high, top = self.low_m, self.high_m, self.clearance_m + DECK_M
        sides = [np.arange(high, high + APPROACH_M, PANEL_M), low - PANEL_M - np.arange(0, APPROACH_M, PANEL_M)]
        panels = [(d, PANEL_M, z, z + 1.5, 0.94) for side in sides for d in side for z in np.arange(0, 5.9, 1.5)]
        whole = np.arange(low - APPROACH_M, high + APPROACH_M, PANEL_M)
        panels += [(d, PANEL_M, self.clearance_m, top, 1.0) for d in whole]
        panels += [(d, PANEL_M, top - 0.12, top, 1.25) for d in whole]
        panels += [(d, PANEL_M, top + z, top + z + 0.07, 0.7) for d in whole for z in (0.3, 0.6, RAILING_M)]
        panels += [(d, 0.12, top, top + RAILING_M, 0.7) for d in whole]
        rng = np.random.default_rng([self.seed, 51])
        d, wide, bottom, up, tone = np.array(panels).T
        faces = np.stack([_at(self.start_m, d, bottom), _at(self.start_m, d, up),
                          _at(self.start_m, d + wide, up), _at(self.start_m, d + wide, bottom)], axis=1)  # fmt: skip
        return self._skew(faces), tone * (1 + 0.06 * rng.standard_normal(len(tone)))

    def _underside(self, start: float, end: float) -> tuple[np.ndarray, np.ndarray]:
        """Faces and light of one beam, the gap behind it, and the side walls below; light as a share of open sky."""
        d = np.arange(self.low_m, self.high_m, 2.0)
        across = (d, np.minimum(d + 2.0, self.high_m))
        low, high, beam = self.clearance_m, self.clearance_m + DECK_M - 0.3, start + BEAM_M
        open_sky = 1 - float(blocked_sky(self.shade(), np.float32((start + end) / 2)))
        parts = [
            (_quads((start, beam), across, (low, low)), 0.5 + 0.5 * open_sky),
            (_quads((beam, end), across, (high, high)), 0.2 + 0.4 * open_sky),
            (_quads((start, start), across, (low, high)), 0.4 + 0.6 * open_sky),
        ]
        light = [np.full(len(quads), FROM_ROAD * share) for quads, share in parts]
        heights = np.linspace(0, high, 5)
        for d_wall in (self.low_m, self.high_m):
            wall = np.full(4, d_wall)
            parts.append((_quads((start, end), (wall, wall), (heights[:-1], heights[1:])), 1.0))
            # A vertical wall sees half of the ground's sky, and the road.
            light.append(np.full(4, FROM_ROAD / 2 + 0.5 * max(open_sky, BOUNCED_SHARE) * 0.16))
        return self._skew(np.concatenate([quads for quads, _ in parts])), np.concatenate(light)

    def _skew(self, faces: np.ndarray) -> np.ndarray:
        faces[..., 0] += self.skew * faces[..., 1]
        return faces


@dataclass(frozen=True, eq=False)
class BridgeSlice:
    """Slice of a bridge in the car's road frame: faces (F, 4, 3) in metres, and the light (F,) on them.

    Faces with `front` are in open daylight, and their `light` is a factor on the colour.
    """

    faces_m: np.ndarray
    light: np.ndarray
    front: bool = False

    def distance_m(self) -> float:
        """Sorting distance in metres: along the road to the median of the corners."""
        return float(np.abs(np.median(self.faces_m[..., 0])))

    def shadows(self, offset_per_m: np.ndarray) -> list[np.ndarray]:
        """Empty, because `Overpass.shade` is the shadow of the bridge."""
        return []


def paint_bridge_slice(
    picture: np.ndarray, camera: Camera, part: BridgeSlice, sun: np.ndarray, air: Atmosphere
) -> None:
    """Paint a slice of a bridge behind the content of a canvas (4, H, W), in place."""
    light = np.ones(3)
    if part.front:
        light = irradiance(np.array([[-1.0, 0, 0]]), sun)[0]
    colours = part.light[:, None] * CONCRETE * light / 0.8
    paint_polygons(picture, project_faces(camera, part.faces_m), colours, atmosphere=air)


def _in_car(faces: np.ndarray, road: RoadGeometry, pose: VehiclePose) -> np.ndarray:
    """Convert faces (F, 4, 3) from (s, d, z) to the car's road frame (x, y, z)."""
    points = surface_points(road, pose, faces[..., 0], faces[..., 1])
    return points + faces[..., 2:] * [0, 0, 1]


def _at(s: float, d: np.ndarray, z: np.ndarray) -> np.ndarray:
    return np.stack([np.full_like(d, s), d, z], axis=-1)


def _quads(s: tuple, d: tuple, z: tuple) -> np.ndarray:
    """Quadrilaterals (F, 4, 3) in (s, d, z): sides of boxes across, along, or parallel to the road."""
    (s0, s1), (d0, d1), (z0, z1) = s, d, z
    d0, d1, z0, z1 = np.broadcast_arrays(d0, d1, z0, z1)
    if s0 == s1:
        corners = [(s0, d0, z0), (s0, d0, z1), (s0, d1, z1), (s0, d1, z0)]
    elif np.array_equal(d0, d1):
        corners = [(s0, d0, z0), (s0, d0, z1), (s1, d0, z1), (s1, d0, z0)]
    else:
        corners = [(s0, d0, z0), (s1, d0, z0), (s1, d1, z0), (s0, d1, z0)]
    return np.stack([_at(place, np.asarray(y, float), np.asarray(h, float)) for place, y, h in corners], axis=1)
