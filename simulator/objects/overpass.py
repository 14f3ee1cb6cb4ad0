"""A road bridge over ours: the deck on its beams, the walls that carry it, and the shadow that it throws."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lanes.camera.camera import Camera
from simulator.light.shading import irradiance
from simulator.light.sunlight import BOUNCED_SHARE, BridgeShade, blocked_sky
from simulator.painting.brush import paint_polygons, project_faces
from simulator.road.geometry import RoadGeometry, VehiclePose, surface_points

CONCRETE = np.array([0.36, 0.345, 0.315])
BEAM_EVERY_M, BEAM_M = 2.4, 0.8
BEAMS_PER_SLICE = 3
DECK_M, RAILING_M = 1.15, 0.95
# The walls of the approaches on either side of the opening, and the width of their panels.
APPROACH_M, PANEL_M = 54.0, 3.0
# Light below the deck is what the road throws up: about the mean reflectance of asphalt, more near the open air.
FROM_ROAD = 0.08
MAX_BRIDGE_M = 420.0


@dataclass(frozen=True)
class Overpass:
    """A bridge across the road from arc length `start_m` to `end_m`; its opening is from `low_m` to `high_m` wide.

    `skew` is ds/dd of its edges, as of `BridgeShade`; `clearance_m` the height of its beams above the road.
    """

    start_m: float
    end_m: float
    low_m: float
    high_m: float
    clearance_m: float = 5.0
    skew: float = 0.0
    seed: int = 0

    def shade(self) -> BridgeShade:
        """Its shadow for a sun that stands high; the light of the sky that it hides belongs to it."""
        return BridgeShade(self.start_m, self.end_m, self.skew, self.clearance_m)

    def slices_at(self, road: RoadGeometry, pose: VehiclePose) -> list[BridgeSlice]:
        """The bridge in the car's road frame, in slices that a painter can sort by distance."""
        if self.end_m < pose.s_m - 2 or self.start_m > pose.s_m + MAX_BRIDGE_M:
            return []
        count = max(2, round((self.end_m - self.start_m) / BEAM_EVERY_M))
        edges = np.linspace(self.start_m, self.end_m, count + 1)
        slices = [self._underside(low, high) for low, high in zip(edges[:-1], edges[1:], strict=True)]
        # Some beams are painted together, the far ones first: each layer of paint covers the upper half of the picture.
        groups = [slices[i : i + BEAMS_PER_SLICE][::-1] for i in range(0, count, BEAMS_PER_SLICE)]
        faces, tones = self._front()
        front = BridgeSlice(_in_car(faces, road, pose), tones, front=True)
        joined = [[np.concatenate(parts) for parts in zip(*group, strict=True)] for group in groups]
        return [front, *(BridgeSlice(_in_car(faces, road, pose), light) for faces, light in joined)]

    def _front(self) -> tuple[np.ndarray, np.ndarray]:
        """Walls of the approaches, edge of the deck and railing, all across the road at `start_m`."""
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
        """One beam with the gap behind it, and the walls beside the road below them; light as a share of open sky."""
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
            # An upright wall sees half the sky that the ground sees, and the road's light below.
            light.append(np.full(4, FROM_ROAD / 2 + 0.5 * max(open_sky, BOUNCED_SHARE) * 0.16))
        return self._skew(np.concatenate([quads for quads, _ in parts])), np.concatenate(light)

    def _skew(self, faces: np.ndarray) -> np.ndarray:
        faces[..., 0] += self.skew * faces[..., 1]
        return faces


@dataclass(frozen=True, eq=False)
class BridgeSlice:
    """A slice of a bridge in the car's road frame: faces (F, 4, 3), metres; light on each of them (F,).

    `front` says that the faces stand in the open air and `light` is a tone of their colour.
    """

    faces_m: np.ndarray
    light: np.ndarray
    front: bool = False

    def distance_m(self) -> float:
        """Distance that painters sort by: along the road to the middle, because the slice spans it."""
        return float(np.abs(np.median(self.faces_m[..., 0])))

    def shadows(self, offset_per_m: np.ndarray) -> list[np.ndarray]:
        """None: the shade of a bridge is its own (`Overpass.shade`)."""
        return []


def paint_bridge_slice(picture: np.ndarray, camera: Camera, slab: BridgeSlice, sun: np.ndarray, air: tuple) -> None:
    """Paint a slice of a bridge behind what is in a picture (4, H, W), in place."""
    light = np.ones(3)
    if slab.front:
        light = irradiance(np.array([[-1.0, 0, 0]]), sun)[0]
    colours = slab.light[:, None] * CONCRETE * light / 0.8
    paint_polygons(picture, project_faces(camera, slab.faces_m), colours, through=air[0], air=air[1])


def _in_car(faces: np.ndarray, road: RoadGeometry, pose: VehiclePose) -> np.ndarray:
    """Faces (F, 4, 3: s, d, z) in the car's road frame (F, 4, 3: x, y, z)."""
    points = surface_points(road, pose, faces[..., 0], faces[..., 1])
    return points + faces[..., 2:] * [0, 0, 1]


def _at(s: float, d: np.ndarray, z: np.ndarray) -> np.ndarray:
    return np.stack([np.full_like(d, s), d, z], axis=-1)


def _quads(s: tuple, d: tuple, z: tuple) -> np.ndarray:
    """Quadrilaterals (F, 4, 3) with the corners (s0, d0, z0), (s1, d0, z0 or z1), ... of a box's side."""
    (s0, s1), (d0, d1), (z0, z1) = s, d, z
    d0, d1, z0, z1 = np.broadcast_arrays(d0, d1, z0, z1)
    if s0 == s1:
        corners = [(s0, d0, z0), (s0, d0, z1), (s0, d1, z1), (s0, d1, z0)]
    elif np.array_equal(d0, d1):
        corners = [(s0, d0, z0), (s0, d0, z1), (s1, d0, z1), (s1, d0, z0)]
    else:
        corners = [(s0, d0, z0), (s1, d0, z0), (s1, d1, z0), (s0, d1, z0)]
    return np.stack([_at(place, np.asarray(y, float), np.asarray(h, float)) for place, y, h in corners], axis=1)
