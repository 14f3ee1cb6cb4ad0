"""Walls along the road, and bridges across it.

A wall is a stack of strips between lines that follow a path at given lateral offsets
and heights: concrete barriers, guard rails, parapets, kerbs, rock, woods and grassy
banks. A bridge has a front, a deck, side walls, and a shadow.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from simulator.light.sunlight import (
    BOUNCED_SHARE,
    CLEARANCE_M,
    BridgeShade,
    irradiance,
)
from simulator.objects.standing import FACING_REAR
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
# The height of a bank falls to 0 over this length at its end.
BANK_END_M = 80
# Panels along a wall differ in tone.
PANEL_M = 3.0
PANELS = 64
# Points of a wall that cast its shadow.
SHADOW_POINTS = 40
CONCRETE = (0.350, 0.340, 0.316)
KERB = (0.391, 0.380, 0.353)
STEEL = (0.38, 0.39, 0.39)
DARK_STEEL = (0.23, 0.23, 0.23)
GRASS = (0.28, 0.20, 0.115)
ROCK = (0.25, 0.205, 0.15)
LEAVES = (0.040, 0.046, 0.020)

Part = tuple[int, float, float, tuple[float, float, float]]


@dataclass(frozen=True)
class WallProfile:
    """Cross section of a kind of wall.

    It has lines (lateral offset, height) in metres, and parts of the strips between
    them. A part is (strip, lower edge, upper edge, colour), the edges as shares of the
    strip's height; the rest is open. `uneven` is the standard deviation of the tone of
    panels, `ragged` that of their height, as a share.
    """

    lines: tuple[tuple[float, float], ...]
    parts: tuple[Part, ...]
    uneven: float = 0.06
    ragged: float = 0.0


def _stacked(
    parts: int,
    colour: tuple[float, float, float],
) -> tuple[Part, ...]:
    """A strip in several parts, because the lens bends tall edges."""
    edges = [k / parts for k in range(parts + 1)]
    return tuple((0, low, high, colour) for low, high in pairwise(edges))


WALLS = {
    "jersey": WallProfile(
        lines=((0.0, 0.0), (0.20, 0.81), (0.36, 0.81)),
        parts=(
            (0, 0, 1, CONCRETE),
            (1, 0, 1, KERB),
        ),
    ),
    "rail": WallProfile(
        lines=((0.0, 0.0), (0.0, 0.80)),
        parts=(
            (0, 0.57, 0.77, DARK_STEEL),
            (0, 0.77, 0.97, STEEL),
        ),
    ),
    "parapet": WallProfile(
        lines=(
            (0.0, 0.0),
            (0.05, 0.62),
            (0.30, 0.62),
            (0.30, 1.02),
        ),
        parts=(
            (0, 0, 1, CONCRETE),
            (1, 0, 1, KERB),
            (2, 0.5, 1, STEEL),
        ),
    ),
    # The rounded edge gets more light than the face.
    "kerb": WallProfile(
        lines=(
            (0.0, 0.0),
            (0.02, 0.11),
            (0.05, 0.14),
            (0.20, 0.14),
        ),
        parts=(
            (0, 0, 1, KERB),
            (1, 0, 1, KERB),
            (2, 0, 1, KERB),
        ),
    ),
    "rock": WallProfile(
        lines=((0.0, 0.0), (2.2, 6.5)),
        parts=_stacked(3, ROCK),
        uneven=0.3,
    ),
    "wood": WallProfile(
        lines=((0.0, 0.0), (0.6, 15.0)),
        parts=_stacked(4, LEAVES),
        uneven=0.35,
        ragged=0.15,
    ),
    "bank": WallProfile(
        lines=(
            (0.0, 0.0),
            (2.5, 0.5),
            (7.0, 2.6),
            (13.0, 5.6),
            (19.0, 7.6),
            (25.0, 8.4),
        ),
        parts=(
            (0, 0, 1, GRASS),
            (1, 0, 1, GRASS),
            (2, 0, 1, GRASS),
            (3, 0, 1, GRASS),
            (4, 0, 1, GRASS),
        ),
    ),
}


@dataclass(frozen=True, eq=False)
class Wall:
    """Wall along a path (N, 3) in the car's frame.

    The path is the foot of the traffic face, in the road's direction. `kind` is a name
    in `WALLS`, `side` +1 on the left (the back is farther left) and -1 on the right,
    `height_scale` the height relative to the profile. The arc length `start_m` of the
    first point fixes panels to the road.
    """

    path_m: np.ndarray
    kind: str
    side: int
    height_scale: float
    start_m: float
    seed: int

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
        distance = np.hypot(*path.T)
        if self.kind == "wood":
            # Objects in front of the edge of the wood must be painted over it.
            return float(distance.max())
        if self.kind != "bank":
            return float(distance[len(path) // 2])

        ahead = path[path[:, 0] > 1]
        if not len(ahead):
            return BANK_DISTANCE_M
        x, y = ahead.T
        turn = np.argmin(self.side * np.arctan2(y, x))
        if not 0 < turn < len(ahead) - 1:
            return BANK_DISTANCE_M
        return float(np.hypot(*ahead[turn]))

    def segments(self, *, growth: float) -> list[Wall]:
        """Segments of the wall for sorting by distance.

        Distances grow by the factor `growth`.
        """
        points, along = _resample(self.path_m)
        if self.kind == "bank":
            return [replace(self, path_m=points)]
        distance = np.hypot(points[:, 0], points[:, 1])
        growths = np.log(np.maximum(distance, 1.0)) / np.log(growth)
        band = np.floor(growths).astype(int)
        changes = np.flatnonzero(np.diff(band)) + 1

        segments = []
        for start, end in pairwise([0, *changes, len(points) - 1]):
            if end > start:
                # Segments overlap, because their anti-aliased ends would show what is
                # behind.
                first = max(0, start - 1)
                path = points[first : end + 2]
                start_m = self.start_m + float(along[first])
                segments.append(replace(self, path_m=path, start_m=start_m))
        return segments

    def lines(self) -> np.ndarray:
        """Points (K, N, 3) of the lines of the profile along the path, road frame."""
        path = self.places_m
        along = np.gradient(path, axis=0)
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
        outward = np.column_stack([-along[:, 1], along[:, 0]]) * self.side

        rise = np.full(len(path), self.height_scale)
        if self.kind == "bank":
            steps = np.hypot(*np.diff(path, axis=0).T)
            from_end = np.cumsum(steps[::-1])
            to_end = np.concatenate([from_end[::-1], [0]])
            rise *= smoothstep(0, BANK_END_M, to_end)

        lines = []
        for out_m, up_m in WALLS[self.kind].lines:
            height = up_m * rise + self.path_m[:, 2]
            lines.append(np.column_stack([path + outward * out_m, height]))
        return np.stack(lines)

    def shadows(self, offset_per_m: np.ndarray) -> list[np.ndarray]:
        """Shadow on the ground as quadrilaterals.

        There is none for a bank (ground) and a wood (transparent).
        """
        if self.kind in ("bank", "wood"):
            return []
        lines = self.lines()[:, :: max(1, len(self.path_m) // SHADOW_POINTS)]
        height = lines[..., 2:] - lines[0, :, 2:]
        cast = lines[..., :2] + height * offset_per_m
        polygons: list[np.ndarray] = []
        for low, high in pairwise(cast):
            polygons.extend(_quads(low, high))
        return polygons

    def paint_over(
        self,
        canvas: Canvas,
        sun: np.ndarray,
        air: Atmosphere,
        light: np.ndarray,
    ) -> None:
        """Paint the wall from far to near.

        `light` (N, 3) is the share of open daylight along the path.
        """
        kind = WALLS[self.kind]
        lines = self.lines()
        station = self.start_m + _arc_lengths(self.path_m)
        panel = (station / PANEL_M).astype(int) % PANELS
        rng = np.random.default_rng([self.seed, 5])
        ragged = kind.ragged * rng.standard_normal(PANELS)[panel]
        height = lines[1:, :, 2] - lines[0, :, 2]
        lines[1:, :, 2] += height * ragged

        faces = []
        colours = []
        for strip, low, high, colour in kind.parts:
            foot = lines[strip]
            rise = lines[strip + 1] - foot
            quads = _quads(foot + low * rise, foot + high * rise)
            tones = np.maximum(1 + kind.uneven * rng.standard_normal(PANELS), 0.2)
            tone = tones[panel[:-1], None]
            daylight = irradiance(face_normals(quads) * self.side, sun)
            faces.append(quads)
            colours.append(tone * colour * daylight / 0.8 * light[:-1])

        corners = np.concatenate(faces)
        distance = np.linalg.norm(corners.mean(axis=1), axis=1)
        order = np.argsort(-distance, kind="stable")
        pixels = canvas.project_faces(corners[order])
        paint_polygons(canvas, pixels, np.concatenate(colours)[order], atmosphere=air)


def _arc_lengths(path: np.ndarray) -> np.ndarray:
    steps = np.diff(path[:, :2], axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    return np.concatenate([[0], np.cumsum(lengths)])


def _quads(
    low: np.ndarray,
    high: np.ndarray,
) -> np.ndarray:
    """Quadrilaterals (N - 1, 4, ...) between two lines (N, ...)."""
    corners = [low[:-1], low[1:], high[1:], high[:-1]]
    return np.stack(corners, axis=1)


def _resample(path: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points along a path, denser near the camera, and their arc lengths."""
    length = _arc_lengths(path)
    # Complex numbers need one interpolation instead of two.
    places = path[:, 0] + 1j * path[:, 1]
    stations = [0.0]
    s = 0.0
    while s < length[-1]:
        distance = float(abs(np.interp(s, length, places)))
        s += max(0.5, 0.04 * distance)
        stations.append(min(s, length[-1]))
    along = np.array(stations)
    columns = [np.interp(along, length, column) for column in path.T]
    return np.column_stack(columns), along


BRIDGE = np.array([0.36, 0.345, 0.315])
SLICE_M = 5.0
# Width of a face, because the lens bends straight lines.
FACE_M = 3
# Height of the deck with its railing, and length of the approach walls on either side
# of the opening.
DECK_M = 1.8
APPROACH_M = 54.0
# Light below the deck is reflected by the road: about the mean reflectance of asphalt,
# more near the edges.
FROM_ROAD = 0.08
MAX_BRIDGE_M = 420.0


@dataclass(frozen=True)
class Overpass:
    """Bridge from arc length `start_m` to `end_m` over an opening.

    The opening is from lateral `low_m` to `high_m`. `skew` is ds/dd of its edges, as in
    `BridgeShade`.
    """

    start_m: float
    end_m: float
    low_m: float
    high_m: float
    skew: float

    def shade(self) -> BridgeShade:
        """Shadow of the bridge for a high sun, and the skylight that it blocks."""
        return BridgeShade(self.start_m, self.end_m, self.skew)

    def slices_at(
        self,
        road: RoadGeometry,
        pose: VehiclePose,
    ) -> list[BridgeSlice]:
        """Slices of the bridge in the car's road frame, for sorting by distance."""
        if self.end_m < pose.s_m - 2 or self.start_m > pose.s_m + MAX_BRIDGE_M:
            return []
        parts = [self._front()]
        count = max(2, round((self.end_m - self.start_m) / SLICE_M))
        edges = np.linspace(self.start_m, self.end_m, count + 1)
        for start, end in pairwise(edges):
            # Slices overlap, because their anti-aliased edges would show what is
            # behind.
            parts.append(self._below(start - 0.5, end))
        return [
            replace(part, faces_m=self._in_car(part.faces_m, road, pose))
            for part in parts
        ]

    def _front(self) -> BridgeSlice:
        """Approach walls, and the front of the deck, in (s, d, z)."""
        s = (self.start_m, self.start_m)
        top = CLEARANCE_M + DECK_M
        low = self.low_m
        high = self.high_m
        right = self._sheet((low - APPROACH_M, low), s, (0.0, top))
        left = self._sheet((high, high + APPROACH_M), s, (0.0, top))
        deck = self._sheet((low, high), s, (CLEARANCE_M, top))
        faces = np.concatenate([right, left, deck])
        return BridgeSlice(faces, np.ones(len(faces)), front=True)

    def _sheet(
        self,
        d: tuple[float, float],
        s: tuple[float, float],
        z: tuple[float, float],
    ) -> np.ndarray:
        """Faces (F, 4, 3) across the road in (s, d, z)."""
        near_s, far_s = s
        low, high = z
        count = max(2, round((d[1] - d[0]) / FACE_M))
        faces = []
        for right, left in pairwise(np.linspace(*d, count + 1)):
            right_side = [(near_s, right, low), (far_s, right, high)]
            left_side = [(far_s, left, high), (near_s, left, low)]
            faces.append(right_side + left_side)
        return np.array(faces)

    def _below(self, start_m: float, end_m: float) -> BridgeSlice:
        """Underside of the deck and the side walls below it, in (s, d, z).

        The light is a share of open sky.
        """
        top = CLEARANCE_M
        s = (start_m, end_m)
        deck = self._sheet((self.low_m, self.high_m), s, (top, top))
        walls = []
        for d in (self.low_m, self.high_m):
            near = [(start_m, d, 0.0), (start_m, d, top)]
            far = [(end_m, d, top), (end_m, d, 0.0)]
            walls.append(near + far)

        middle = np.float32((start_m + end_m) / 2)
        open_sky = 1 - float(self.shade().blocked_sky(middle))
        on_deck = FROM_ROAD * (0.4 + 0.5 * open_sky)
        # A vertical wall sees half of the ground's sky, and the road.
        on_wall = FROM_ROAD / 2 + 0.5 * max(open_sky, BOUNCED_SHARE) * 0.16
        light = [*np.full(len(deck), on_deck), on_wall, on_wall]
        return BridgeSlice(np.concatenate([deck, walls]), np.array(light))

    def _in_car(
        self, faces: np.ndarray, road: RoadGeometry, pose: VehiclePose
    ) -> np.ndarray:
        """Convert faces (F, 4, 3) from (s, d, z) to the car's road frame (x, y, z)."""
        d = faces[..., 1]
        s = faces[..., 0] + self.skew * d
        ground = surface_points(road, pose, s, d)
        return ground + faces[..., 2:] * [0, 0, 1]


@dataclass(frozen=True, eq=False)
class BridgeSlice:
    """Slice of a bridge: faces (F, 4, 3) in metres, and the light (F,) on them.

    Faces with `front` are in open daylight, and their `light` is a factor on the
    colour.
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
        self,
        canvas: Canvas,
        sun: np.ndarray,
        air: Atmosphere,
        light: np.ndarray,
    ) -> None:
        """Paint the slice."""
        daylight = np.ones(3)
        if self.front:
            daylight = irradiance(FACING_REAR, sun)[0]
        colours = self.light[:, None] * BRIDGE * daylight / 0.8
        pixels = canvas.project_faces(self.faces_m)
        paint_polygons(canvas, pixels, colours, atmosphere=air)
