"""Walls along the road, and bridges across it.

A wall is a stack of strips between lines that follow a path at given lateral offsets and heights: concrete barriers,
guard rails, parapets, kerbs, rock, woods and grassy banks. A bridge has a front, a deck, side walls, and a shadow.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from simulator.light.sunlight import BOUNCED_SHARE, CLEARANCE_M, BridgeShade, irradiance
from simulator.painting import (
    Atmosphere,
    Canvas,
    face_normals,
    paint_polygons,
    smoothstep,
)
from simulator.road.geometry import RoadGeometry, VehiclePose, surface_points

# Sorting distance of a fully visible bank: behind everything.
BANK_DISTANCE_M = 590.0
# Panels along a wall differ in tone.
PANEL_M, PANELS = 3.0, 64
CONCRETE, KERB, STEEL = (0.350, 0.340, 0.316), (0.391, 0.380, 0.353), (0.38, 0.39, 0.39)
DARK_STEEL = (0.23, 0.23, 0.23)
GRASS, ROCK, LEAVES = (0.28, 0.20, 0.115), (0.25, 0.205, 0.15), (0.040, 0.046, 0.020)


@dataclass(frozen=True)
class WallProfile:
    """Cross section of a kind of wall: lines (lateral offset, height) in metres, and parts of the strips between.

    A part is (strip, lower edge, upper edge, colour), the edges as shares of the strip's height; the rest is open.
    `uneven` is the standard deviation of the tone of panels, `ragged` that of their height, as a share.
    """

    lines: tuple[tuple[float, float], ...]
    parts: tuple[tuple[int, float, float, tuple[float, float, float]], ...]
    uneven: float = 0.06
    ragged: float = 0.0


BANK = ((0.0, 0.0), (2.5, 0.5), (7.0, 2.6), (13.0, 5.6), (19.0, 7.6), (25.0, 8.4))
WALLS = {
    "jersey": WallProfile(
        ((0.0, 0.0), (0.20, 0.81), (0.36, 0.81)), ((0, 0, 1, CONCRETE), (1, 0, 1, KERB))
    ),
    "rail": WallProfile(
        ((0.0, 0.0), (0.0, 0.80)), ((0, 0.57, 0.77, DARK_STEEL), (0, 0.77, 0.97, STEEL))
    ),
    "parapet": WallProfile(
        ((0.0, 0.0), (0.05, 0.62), (0.30, 0.62), (0.30, 1.02)),
        ((0, 0, 1, CONCRETE), (1, 0, 1, KERB), (2, 0.5, 1, STEEL)),
    ),
    # The rounded edge gets more light than the face.
    "kerb": WallProfile(
        ((0.0, 0.0), (0.02, 0.11), (0.05, 0.14), (0.20, 0.14)),
        tuple((strip, 0, 1, KERB) for strip in range(3)),
    ),
    # In parts, because the lens bends tall edges.
    "rock": WallProfile(
        ((0.0, 0.0), (2.2, 6.5)),
        tuple((0, k / 3, (k + 1) / 3, ROCK) for k in range(3)),
        0.3,
    ),
    "wood": WallProfile(
        ((0.0, 0.0), (0.6, 15.0)),
        tuple((0, k / 4, (k + 1) / 4, LEAVES) for k in range(4)),
        0.35,
        ragged=0.15,
    ),
    "bank": WallProfile(BANK, tuple((strip, 0, 1, GRASS) for strip in range(5))),
}


@dataclass(frozen=True, eq=False)
class Wall:
    """Wall along a path (N, 3) in the car's frame: the foot of the traffic face, in the road's direction.

    `kind` is a name in `WALLS`, `side` +1 on the left (the back is farther left) and -1 on the right, `height_scale`
    the height relative to the profile. The arc length `start_m` of the first point fixes panels to the road.
    """

    path_m: np.ndarray
    kind: str = "jersey"
    side: int = 1
    height_scale: float = 1.0
    start_m: float = 0.0
    seed: int = 0

    @property
    def places_m(self) -> np.ndarray:
        """Points (N, 2) along the path."""
        return self.path_m[:, :2]

    @property
    def distance_m(self) -> float:
        """Sorting distance in metres: that of the middle of the path.

        A bank is behind all objects on it, up to the bend where it turns out of view.
        """
        path = self.places_m
        if self.kind == "wood":
            # Objects in front of the edge of the wood must be painted over it.
            return float(np.hypot(*path.T).max())
        if self.kind != "bank":
            return float(np.hypot(*path[len(path) // 2]))
        ahead = path[path[:, 0] > 1]
        turn = (
            np.argmin(self.side * np.arctan2(ahead[:, 1], ahead[:, 0]))
            if len(ahead)
            else 0
        )
        return (
            float(np.hypot(*ahead[turn]))
            if 0 < turn < len(ahead) - 1
            else BANK_DISTANCE_M
        )

    def segments(self, *, growth: float) -> list[Wall]:
        """Segments of the wall for sorting by distance; distances grow by the factor `growth`."""
        points, along = _resample(self.path_m)
        if self.kind == "bank":
            return [replace(self, path_m=points)]
        distance = np.hypot(points[:, 0], points[:, 1])
        band = np.floor(np.log(np.maximum(distance, 1.0)) / np.log(growth)).astype(int)
        cuts = [0, *(np.flatnonzero(np.diff(band)) + 1), len(points) - 1]
        # Segments overlap, because their anti-aliased ends would show what is behind.
        spans = [
            (max(0, a - 1), b + 2)
            for a, b in zip(cuts[:-1], cuts[1:], strict=True)
            if b > a
        ]
        return [
            replace(self, path_m=points[a:b], start_m=self.start_m + float(along[a]))
            for a, b in spans
        ]

    def lines(self) -> np.ndarray:
        """Points (K, N, 3) of the lines of the profile along the path, road frame."""
        path, ground_height_m = self.places_m, self.path_m[:, 2]
        along = np.gradient(path, axis=0)
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
        outward = np.column_stack([-along[:, 1], along[:, 0]]) * self.side
        rise = np.full(len(path), self.height_scale)
        if self.kind == "bank":
            # The height of the cutting falls to 0 at its end.
            step = np.hypot(*np.diff(path, axis=0).T)
            rise *= smoothstep(
                0, 80, np.concatenate([np.cumsum(step[::-1])[::-1], [0]])
            )
        profile = WALLS[self.kind].lines
        return np.stack(
            [
                np.column_stack([path + outward * out, up * rise + ground_height_m])
                for out, up in profile
            ]
        )

    def shadows(self, offset_per_m: np.ndarray) -> list[np.ndarray]:
        """Shadow on the ground as quadrilaterals; none for a bank (ground) and a wood (transparent)."""
        if self.kind in ("bank", "wood"):
            return []
        lines = self.lines()[:, :: max(1, len(self.path_m) // 40)]
        cast = lines[..., :2] + (lines[..., 2:] - lines[0, :, 2:]) * offset_per_m
        return [
            quad
            for low, high in zip(cast[:-1], cast[1:], strict=True)
            for quad in _quads(low, high)
        ]

    def paint_over(
        self, canvas: Canvas, sun: np.ndarray, air: Atmosphere, light: np.ndarray
    ) -> None:
        """Paint the wall from far to near; `light` (N, 3) is the share of open daylight along the path."""
        kind, lines = WALLS[self.kind], self.lines()
        panel = ((self.start_m + _arc_lengths(self.path_m)) / PANEL_M).astype(
            int
        ) % PANELS
        rng = np.random.default_rng([self.seed, 5])
        lines[1:, :, 2] += (
            (lines[1:] - lines[0])[..., 2]
            * kind.ragged
            * rng.standard_normal(PANELS)[panel]
        )
        faces, colours = [], []
        for strip, low, high, colour in kind.parts:
            rise = lines[strip + 1] - lines[strip]
            faces.append(_quads(lines[strip] + low * rise, lines[strip] + high * rise))
            tone = np.maximum(1 + kind.uneven * rng.standard_normal(PANELS), 0.2)[
                panel[:-1], None
            ]
            colours.append(
                tone
                * colour
                * irradiance(face_normals(faces[-1]) * self.side, sun)
                / 0.8
                * light[:-1]
            )
        corners = np.concatenate(faces)
        order = np.argsort(-np.linalg.norm(corners.mean(axis=1), axis=1), kind="stable")
        paint_polygons(
            canvas,
            canvas.project_faces(corners[order]),
            np.concatenate(colours)[order],
            atmosphere=air,
        )


def _arc_lengths(path: np.ndarray) -> np.ndarray:
    return np.concatenate(
        [[0], np.cumsum(np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1))]
    )


def _quads(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Quadrilaterals (N - 1, 4, ...) between two lines (N, ...)."""
    return np.stack([low[:-1], low[1:], high[1:], high[:-1]], axis=1)


def _resample(path: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points along a path, denser near the camera, and their arc lengths."""
    length = _arc_lengths(path)
    # Complex numbers need one interpolation instead of two.
    places = path[:, 0] + 1j * path[:, 1]
    stations, s = [0.0], 0.0
    while s < length[-1]:
        s += max(0.5, 0.04 * float(abs(np.interp(s, length, places))))
        stations.append(min(s, length[-1]))
    along = np.array(stations)
    return np.column_stack(
        [np.interp(along, length, column) for column in path.T]
    ), along


BRIDGE = np.array([0.36, 0.345, 0.315])
SLICE_M = 5.0
# Height of the deck with its railing, and length of the approach walls on either side of the opening.
DECK_M, APPROACH_M = 1.8, 54.0
# Light below the deck is reflected by the road: about the mean reflectance of asphalt, more near the edges.
FROM_ROAD = 0.08
MAX_BRIDGE_M = 420.0


@dataclass(frozen=True)
class Overpass:
    """Bridge from arc length `start_m` to `end_m`, with an opening from lateral `low_m` to `high_m`.

    `skew` is ds/dd of its edges, as in `BridgeShade`.
    """

    start_m: float
    end_m: float
    low_m: float
    high_m: float
    skew: float = 0.0

    def shade(self) -> BridgeShade:
        """Shadow of the bridge for a high sun, including the skylight that it blocks."""
        return BridgeShade(self.start_m, self.end_m, self.skew)

    def slices_at(self, road: RoadGeometry, pose: VehiclePose) -> list[BridgeSlice]:
        """Slices of the bridge in the car's road frame, which can be sorted by distance."""
        if self.end_m < pose.s_m - 2 or self.start_m > pose.s_m + MAX_BRIDGE_M:
            return []
        low, high, under, top = (
            self.low_m,
            self.high_m,
            CLEARANCE_M,
            CLEARANCE_M + DECK_M,
        )
        front = [
            self._sheet(
                (low - APPROACH_M, low), (self.start_m, self.start_m), (0.0, top)
            ),
            self._sheet(
                (high, high + APPROACH_M), (self.start_m, self.start_m), (0.0, top)
            ),
            self._sheet((low, high), (self.start_m, self.start_m), (under, top)),
        ]
        parts = [
            BridgeSlice(
                np.concatenate(front), np.ones(sum(map(len, front))), front=True
            )
        ]
        edges = np.linspace(
            self.start_m,
            self.end_m,
            max(2, round((self.end_m - self.start_m) / SLICE_M)) + 1,
        )
        # Slices overlap, because their anti-aliased edges would show what is behind.
        parts += [
            self._below((start - 0.5, end))
            for start, end in zip(edges[:-1], edges[1:], strict=True)
        ]
        return [
            BridgeSlice(_in_car(part.faces_m, road, pose), part.light, part.front)
            for part in parts
        ]

    def _sheet(
        self, d: tuple[float, float], s: tuple[float, float], z: tuple[float, float]
    ) -> np.ndarray:
        """Faces (F, 4, 3) across the road in (s, d, z), 3 m wide, because the lens bends straight lines."""
        edges = np.linspace(*d, max(2, round((d[1] - d[0]) / 3)) + 1)
        return self._skewed([[(s[0], a, z[0]), (s[1], a, z[1]), (s[1], b, z[1]), (s[0], b, z[0])]
                             for a, b in zip(edges[:-1], edges[1:], strict=True)])  # fmt: skip

    def _below(self, s: tuple[float, float]) -> BridgeSlice:
        """Underside of the deck and the side walls below it; light as a share of open sky."""
        top = CLEARANCE_M
        deck = self._sheet((self.low_m, self.high_m), s, (top, top))
        sides = [
            [(s[0], d, 0.0), (s[0], d, top), (s[1], d, top), (s[1], d, 0.0)]
            for d in (self.low_m, self.high_m)
        ]
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

    def paint_over(
        self, canvas: Canvas, sun: np.ndarray, air: Atmosphere, light: np.ndarray
    ) -> None:
        """Paint the slice."""
        daylight = (
            irradiance(np.array([[-1.0, 0, 0]]), sun)[0] if self.front else np.ones(3)
        )
        colours = self.light[:, None] * BRIDGE * daylight / 0.8
        paint_polygons(
            canvas, canvas.project_faces(self.faces_m), colours, atmosphere=air
        )


def _in_car(faces: np.ndarray, road: RoadGeometry, pose: VehiclePose) -> np.ndarray:
    """Convert faces (F, 4, 3) from (s, d, z) to the car's road frame (x, y, z)."""
    return surface_points(road, pose, faces[..., 0], faces[..., 1]) + faces[..., 2:] * [
        0,
        0,
        1,
    ]
