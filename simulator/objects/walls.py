"""Walls along the road: concrete barriers, guard rails, parapets, kerbs, rock, woods and grassy banks.

A wall is a stack of strips between lines that follow a path at given lateral offsets and heights. Each strip is
textured column by column.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from lanes.camera import Camera
from simulator.light.shading import irradiance
from simulator.objects.wall_textures import TEXTURE_PX_PER_M, wall_texture
from simulator.painting.brush import (
    Atmosphere,
    composite_behind,
    frustum_planes,
    inside_planes,
    split_channels,
    uncovered_window,
)
from simulator.painting.noise import smoothstep

# Sorting distance of a fully visible bank: behind everything.
BANK_DISTANCE_M = 590.0
# Largest width of a block of columns painted at once.
MAX_RUN_PX = 128
# Kinds whose upper lines can be above the view of the lens while their feet are visible.
TALL_KINDS = ("rock", "wood")


@dataclass(frozen=True)
class WallProfile:
    """Cross section of a kind of wall: lines (lateral offset, height) in metres, and textures of the strips between."""

    lines: tuple[tuple[float, float], ...]
    textures: tuple[str, ...]


WALLS = {
    "jersey": WallProfile(((0.0, 0.0), (0.20, 0.81), (0.36, 0.81)), ("concrete", "top")),
    "rail": WallProfile(((0.0, 0.0), (0.0, 0.80)), ("rail",)),
    "parapet": WallProfile(((0.0, 0.0), (0.05, 0.62), (0.30, 0.62), (0.30, 1.02)), ("concrete", "top", "handrail")),
    # The rounded edge gets more light than the face.
    "kerb": WallProfile(((0.0, 0.0), (0.02, 0.11), (0.05, 0.14), (0.20, 0.14)), ("kerb", "kerb top", "kerb top")),
    "rock": WallProfile(((0.0, 0.0), (2.2, 6.5)), ("rock",)),
    # Trunks and crowns at the edge of a wood, with sky between the tops.
    "wood": WallProfile(((0.0, 0.0), (0.6, 15.0)), ("wood",)),
    "bank": WallProfile(((0.0, 0.0), (2.5, 0.5), (7.0, 2.6), (13.0, 5.6), (19.0, 7.6), (25.0, 8.4)), ("grass",) * 5),
}


@dataclass(frozen=True, eq=False)
class Wall:
    """Wall along a path (N, 2) or (N, 3) in the car's frame: the foot of the traffic face, in the road's direction.

    `kind` is a name in `WALLS`, `side` +1 on the left (the back is farther left) and -1 on the right, `height_scale`
    the height relative to the profile. The arc length `start_m` of the first point fixes joints and stains to the road.
    `light` (N, 3) is the share of open daylight along the path.
    """

    path_m: np.ndarray
    kind: str = "jersey"
    side: int = 1
    height_scale: float = 1.0
    start_m: float = 0.0
    seed: int = 0
    light: np.ndarray | None = None

    def distance_m(self) -> float:
        """Sorting distance in metres: that of the middle of the path.

        A bank is behind all objects on it, up to the bend where it turns out of view.
        """
        path = np.asarray(self.path_m, float)[:, :2]
        if self.kind == "wood":
            # Objects in front of the edge of the wood must be painted over it.
            return float(np.hypot(*path.T).max())
        if self.kind != "bank":
            return float(np.hypot(*path[len(path) // 2]))
        ahead = path[path[:, 0] > 1]
        turn = np.argmin(self.side * np.arctan2(ahead[:, 1], ahead[:, 0])) if len(ahead) else 0
        return float(np.hypot(*ahead[turn])) if 0 < turn < len(ahead) - 1 else BANK_DISTANCE_M

    def segments(self, *, growth: float) -> list[Wall]:
        """Segments of the wall for sorting by distance; distances grow by the factor `growth`."""
        points, along = _resample(np.asarray(self.path_m, float))
        if self.kind == "bank":
            return [replace(self, path_m=points)]
        distance = np.hypot(points[:, 0], points[:, 1])
        band = np.floor(np.log(np.maximum(distance, 1.0)) / np.log(growth)).astype(int)
        cuts = [0, *(np.flatnonzero(np.diff(band)) + 1), len(points) - 1]
        # Segments overlap, because foot and top of one point are seen in different columns.
        spans = [(max(0, a - 8), b + 9) for a, b in zip(cuts[:-1], cuts[1:], strict=True) if b > a]
        return [replace(self, path_m=points[a:b], start_m=self.start_m + float(along[a])) for a, b in spans]

    def lines(self) -> np.ndarray:
        """Points (K, N, 3) of the lines of the profile along the path, road frame."""
        path = np.asarray(self.path_m, float)
        path, ground_height_m = path[:, :2], path[:, 2] if path.shape[1] == 3 else 0.0
        along = np.gradient(path, axis=0)
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
        outward = np.column_stack([-along[:, 1], along[:, 0]]) * self.side
        rise = np.full(len(path), self.height_scale)
        if self.kind == "bank":
            # The height of the cutting falls to 0 at its end.
            step = np.hypot(*np.diff(path, axis=0).T)
            rise *= smoothstep(0, 80, np.concatenate([np.cumsum(step[::-1])[::-1], [0]]))
        return np.stack(
            [
                np.column_stack([path + outward * lateral, height * rise + ground_height_m])
                for lateral, height in WALLS[self.kind].lines
            ]
        )

    def shadows(self, offset_per_m: np.ndarray) -> list[np.ndarray]:
        """Shadow on the ground as quadrilaterals; none for a bank (ground) and a wood (transparent)."""
        if self.kind in ("bank", "wood"):
            return []
        lines = self.lines()[:, :: max(1, len(self.path_m) // 40)]
        cast = lines[..., :2] + (lines[..., 2:] - lines[0, :, 2:]) * offset_per_m
        shadows = []
        for low, high in zip(cast[:-1], cast[1:], strict=True):
            shadows += [np.array([low[i], low[i + 1], high[i + 1], high[i]]) for i in range(len(low) - 1)]
        return shadows


def _resample(path: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points along a path, denser near the camera, and their arc lengths."""
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1))])
    # Complex numbers need one interpolation instead of two.
    places = path[:, 0] + 1j * path[:, 1]
    stations, s = [0.0], 0.0
    while s < length[-1]:
        s += max(0.15, 0.02 * float(abs(np.interp(s, length, places))))
        stations.append(min(s, length[-1]))
    along = np.array(stations)
    return np.column_stack([np.interp(along, length, column) for column in path.T]), along


def paint_wall(picture: np.ndarray, camera: Camera, wall: Wall, sun: np.ndarray, air: Atmosphere) -> None:
    """Paint a segment of a wall behind the content of a canvas (4, H, W), in place. Back faces are skipped."""
    lines = wall.lines()
    seen = inside_planes(lines, frustum_planes(camera))
    if not seen.any():
        return
    pixels = np.full((*lines.shape[:2], 2), np.nan)
    pixels[seen] = camera.road_to_pixels(lines[seen])
    if wall.kind in TALL_KINDS:
        _extend_upwards(pixels, lines, camera)
    path = np.asarray(wall.path_m)[:, :2]
    along = wall.start_m + np.concatenate([[0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    share = 1.0 if wall.light is None else wall.light
    normals = _strip_normals(lines, wall.side)
    light = irradiance(normals.reshape(-1, 3), sun).reshape(normals.shape) / 0.8 * share
    for strip in range(len(lines) - 1):
        texture = wall_texture(WALLS[wall.kind].textures[strip], wall.seed + strip)
        low, high = (_ProjectedLine(pixels[line], along, light[strip]) for line in (strip, strip + 1))
        (_paint_slope if wall.kind == "bank" else _paint_strip)(picture, low, high, texture, air)


def _extend_upwards(pixels: np.ndarray, lines: np.ndarray, camera: Camera) -> None:
    """Extrapolate, from the foot, the pixels of lines above the view of the lens, in place."""
    share = 0.08
    for line in range(1, len(lines)):
        blind = np.isnan(pixels[line, :, 0]) & np.isfinite(pixels[0, :, 0])
        above = lines[0, blind] + share * (lines[line, blind] - lines[0, blind])
        if blind.any():
            pixels[line, blind] = pixels[0, blind] + (camera.road_to_pixels(above) - pixels[0, blind]) / share


def _strip_normals(lines: np.ndarray, side: int) -> np.ndarray:
    """Unit normals (K - 1, N, 3), towards the road and up, of the strips between lines (K, N, 3)."""
    along, up = np.gradient(lines[:-1], axis=1), lines[1:] - lines[:-1]
    (a, b, c), (d, e, f) = np.moveaxis(along, -1, 0), np.moveaxis(up, -1, 0)
    # Cross product written out, because np.cross takes three times as long.
    normal = np.stack([b * f - c * e, c * d - a * f, a * e - b * d], axis=-1) * side
    return normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-9)


@dataclass(frozen=True)
class _ProjectedLine:
    """Projected line of a wall: pixels (N, 2), arc lengths (N,), light (N, 3)."""

    pixels: np.ndarray
    along: np.ndarray
    light: np.ndarray

    def part(self, order: slice | np.ndarray) -> _ProjectedLine:
        """Points selected by a slice or a mask."""
        return _ProjectedLine(self.pixels[order], self.along[order], self.light[order])

    def seen(self) -> _ProjectedLine:
        """Points in the view of the lens."""
        return self.part(np.isfinite(self.pixels[:, 0]))

    def turns(self) -> np.ndarray:
        """Indices at which the columns change between increasing and decreasing."""
        direction = np.sign(np.diff(self.pixels[:, 0]))
        return np.flatnonzero(direction[1:] * direction[:-1] < 0) + 1

    def rising(self) -> _ProjectedLine:
        """The line ordered from left to right."""
        line = self if self.pixels[-1, 0] > self.pixels[0, 0] else self.part(slice(None, None, -1))
        return _ProjectedLine(
            np.maximum.accumulate(line.pixels, axis=0) * [1, 0] + line.pixels * [0, 1], line.along, line.light
        )


def _paint_strip(
    picture: np.ndarray, low: _ProjectedLine, high: _ProjectedLine, texture: tuple[np.ndarray, ...], air: Atmosphere
) -> None:
    """Paint between two lines of a vertical wall, in runs of monotonic columns, from near to far.

    Both lines turn at the same point, because one is above the other.
    """
    both = np.isfinite(low.pixels[:, 0]) & np.isfinite(high.pixels[:, 0])
    if both.sum() < 2:
        return
    low, high = low.part(both), high.part(both)
    bounds = [0, *low.turns(), len(low.along) - 1]
    for a, b in zip(bounds[:-1], bounds[1:], strict=True):
        run = slice(a, b + 1)
        _paint_run(picture, low.part(run).rising(), high.part(run).rising(), texture, air)


def _paint_slope(
    picture: np.ndarray, low: _ProjectedLine, high: _ProjectedLine, texture: tuple[np.ndarray, ...], air: Atmosphere
) -> None:
    """Paint between two lines of a bank up to where it turns out of view; the near part hides the rest."""
    low, high = low.seen(), high.seen()
    if min(len(low.along), len(high.along)) < 2:
        return
    low, high = (x.part(slice(0, x.turns()[0] + 1 if len(x.turns()) else None)) for x in (low, high))
    # Both lines end at the end of the longer one: the outline of the bank connects their ends.
    forward = np.sign(low.pixels[-1, 0] - low.pixels[0, 0])
    ends = sorted((low, high), key=lambda line: forward * line.pixels[-1, 0])
    last = ends[1].part(slice(-1, None))
    longer = _ProjectedLine(
        *(np.concatenate([getattr(ends[0], n), getattr(last, n)]) for n in ("pixels", "along", "light"))
    )
    low, high = (longer if line is ends[0] else line for line in (low, high))
    _paint_run(picture, low.rising(), high.rising(), texture, air)


def _paint_run(
    picture: np.ndarray, low: _ProjectedLine, high: _ProjectedLine, texture: tuple[np.ndarray, ...], air: Atmosphere
) -> None:
    """Paint a run of columns: each column interpolates both lines, each pixel samples the texture between them."""
    height, width = picture.shape[1:]
    (low_u, low_v), (high_u, high_v) = low.pixels.T, high.pixels.T
    start = max(0, int(np.ceil(max(low_u[0], high_u[0]))))
    stop = min(width, int(np.ceil(min(low_u[-1], high_u[-1]))))
    if stop <= start:
        return
    u = np.arange(start, stop, dtype=float)
    bottom, top = np.interp(u, low_u, low_v), np.interp(u, high_u, high_v)
    last = min(height, int(bottom.max()) + 2)
    if last <= max(0, int(top.min()) - 1) or (bottom - top).max() <= -1:
        return
    s_low, s_high = np.interp(u, low_u, low.along), np.interp(u, high_u, high.along)
    lit = np.stack([np.interp(u, low_u, low.light[:, c]) for c in range(3)]).astype(np.float32)
    foot = s_low + (s_high - s_low) * np.clip((bottom - (last - 1)) / np.maximum(bottom - top, 1e-3), 0, 1)
    for level, columns in _columns_by_level(foot, len(texture)):
        edges = _StripColumns(*(x[..., columns] for x in (top, bottom, s_low, s_high, lit)))
        first, left = max(0, int(edges.top.min()) - 1), start + columns.start
        seen = uncovered_window(
            picture[3, first : max(first, int(edges.bottom.max()) + 2), left : start + columns.stop]
        )
        if seen is not None:
            rows, columns = seen
            edges = _StripColumns(*(x[..., columns] for x in vars(edges).values()))
            v = np.arange(first + rows.start, first + rows.stop, dtype=np.float32)[:, None]
            planes = _texture_between(edges, v, texture[level], level)
            composite_behind(picture, planes, left + columns.start, first + rows.start, atmosphere=air)


@dataclass(frozen=True)
class _StripColumns:
    """Columns of a strip: rows and arc lengths of its edges (columns,), and light (3, columns)."""

    top: np.ndarray
    bottom: np.ndarray
    s_low: np.ndarray
    s_high: np.ndarray
    lit: np.ndarray


def _columns_by_level(foot_m: np.ndarray, levels: int) -> list[tuple[int, slice]]:
    """Runs of columns with the same pyramid level; `foot_m` is the arc length seen in each column.

    Runs are short, because each is painted in its bounding rectangle, and an inclined strip fills little of that.
    """
    step = np.abs(np.gradient(foot_m)) if len(foot_m) > 1 else np.ones(1)
    level = np.clip(np.log2(np.maximum(step * TEXTURE_PX_PER_M, 1)), 0, levels - 1).astype(int)
    cuts = [0, *(np.flatnonzero(np.diff(level)) + 1).tolist(), len(level)]
    return [
        (int(level[a]), slice(i, min(i + MAX_RUN_PX, b)))
        for a, b in zip(cuts[:-1], cuts[1:], strict=True)
        for i in range(a, b, MAX_RUN_PX)
    ]


def _texture_between(edges: _StripColumns, v: np.ndarray, picture: np.ndarray, level: int) -> list[np.ndarray]:
    """Lit texture between the edges in rows `v` (rows, 1): planes of RGB times coverage, and coverage."""
    # Single precision and in place, because a wood fills much of the image. Arc lengths are wrapped first, because
    # they can be kilometres.
    scale = TEXTURE_PX_PER_M / 2**level
    place = np.mod(edges.s_low * scale, picture.shape[1])
    columns = (edges.top, edges.bottom, edges.bottom - edges.top, place, (edges.s_high - edges.s_low) * scale)
    top, bottom, tall, place, lean = (column.astype(np.float32) for column in columns)
    above = bottom - v
    share = above / np.maximum(tall, np.float32(1e-3))
    np.clip(share, 0, 1, out=share)
    alpha = v - (top - np.float32(0.5))
    above += np.float32(0.5)
    for from_edge in (alpha, above):
        np.clip(from_edge, 0, 1, out=from_edge)
    alpha *= above
    map_x = np.multiply(lean, share, out=above)
    map_x += place
    map_y = np.subtract(1, share, out=share)
    map_y *= np.float32(picture.shape[0] - 1)
    *colours, cover = split_channels(cv2.remap(picture, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP))
    for colour, lit in zip(colours, edges.lit, strict=True):
        colour *= alpha
        colour *= lit
    return [*colours, cover * alpha]
