"""Long things along the road: concrete barriers, guard rails, parapets, kerbs and the grassy banks of a cutting.

A wall is a stack of strips between lines that follow a path at given lateral distances and heights. A strip is painted
column by column: where its lower and upper line are seen in a column says which part of its texture is there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from lanes.camera.camera import Camera
from simulator.light.shading import irradiance
from simulator.objects.wall_textures import TEXTURE_PX_PER_M, wall_texture
from simulator.painting.brush import composite_behind, frustum_planes, inside_planes, split_channels, uncovered_window
from simulator.painting.noise import smoothstep

# Where a bank comes in the order of painting when nothing of it is hidden: behind everything.
BANK_DISTANCE_M = 590.0
# Most columns painted at a time.
MAX_RUN_PX = 128


@dataclass(frozen=True)
class WallProfile:
    """Lines of a kind of wall from the road outwards, (lateral distance, height) in metres, and the strips between."""

    lines: tuple[tuple[float, float], ...]
    textures: tuple[str, ...]


WALLS = {
    "jersey": WallProfile(((0.0, 0.0), (0.20, 0.81), (0.36, 0.81)), ("concrete", "top")),
    "rail": WallProfile(((0.0, 0.0), (0.0, 0.80)), ("rail",)),
    "parapet": WallProfile(((0.0, 0.0), (0.05, 0.62), (0.30, 0.62), (0.30, 1.02)), ("concrete", "top", "handrail")),
    # The rounded edge looks up more than the face, so it catches the light.
    "kerb": WallProfile(((0.0, 0.0), (0.02, 0.11), (0.05, 0.14), (0.20, 0.14)), ("kerb", "kerb top", "kerb top")),
    "rock": WallProfile(((0.0, 0.0), (2.2, 6.5)), ("rock",)),
    # The edge of a wood: trunks and crowns, with the sky between their tops.
    "wood": WallProfile(((0.0, 0.0), (0.6, 15.0)), ("wood",)),
    "bank": WallProfile(((0.0, 0.0), (2.5, 0.5), (7.0, 2.6), (13.0, 5.6), (19.0, 7.6), (25.0, 8.4)), ("grass",) * 5),
}


# Kinds whose upper lines may be above the picture while their feet are in it.
TALL_KINDS = ("rock", "wood")


@dataclass(frozen=True, eq=False)
class Wall:
    """A barrier along a path.

    Parameters
    ----------
    path_m : ndarray of shape (N, 2) or (N, 3)
        Foot of the traffic face in the road frame, in the road's direction, metres.
    kind : str
        A name in `WALLS`.
    side : int
        +1: it stands to the left of us (its back is further left), -1: to the right.
    height_scale : float
        1 is the kind's own height.
    start_m : float
        Place along the wall of the first point, so that its joints and stains stay where they are when we drive on.
    seed : int
    light : ndarray of shape (N, 3), optional
        Share of open daylight at the points of the path.
    """

    path_m: np.ndarray
    kind: str = "jersey"
    side: int = 1
    height_scale: float = 1.0
    start_m: float = 0.0
    seed: int = 0
    light: np.ndarray | None = None

    def __post_init__(self) -> None:
        if self.kind not in WALLS:
            raise ValueError(f"there is no wall {self.kind!r}; there are {', '.join(sorted(WALLS))}.")
        if self.side not in (-1, 1):
            raise ValueError(f"side is +1 (left) or -1 (right), not {self.side}.")
        path = np.asarray(self.path_m, float)
        if path.ndim != 2 or path.shape[1] not in (2, 3) or len(path) < 2:
            raise ValueError(f"a wall's path has the shape (points, 2 or 3), two points at least, not {path.shape}.")

    def distance_m(self) -> float:
        """Distance that painters sort by: the path's middle.

        A bank is ground, behind all that stands on it, up to where it turns out of sight in a bend.
        """
        path = np.asarray(self.path_m, float)[:, :2]
        if self.kind == "wood":
            # Whatever stands before its edge is painted over it.
            return float(np.hypot(*path.T).max())
        if self.kind != "bank":
            return float(np.hypot(*path[len(path) // 2]))
        ahead = path[path[:, 0] > 1]
        turn = np.argmin(self.side * np.arctan2(ahead[:, 1], ahead[:, 0])) if len(ahead) else 0
        return float(np.hypot(*ahead[turn])) if 0 < turn < len(ahead) - 1 else BANK_DISTANCE_M

    def segments(self, *, growth: float = 1.3) -> list[Wall]:
        """The wall cut into lengths that a painter can sort by distance; each is as far as the last times `longer`."""
        points, along = _resample(np.asarray(self.path_m, float))
        if self.kind == "bank":
            return [replace(self, path_m=points)]
        distance = np.hypot(points[:, 0], points[:, 1])
        band = np.floor(np.log(np.maximum(distance, 1.0)) / np.log(growth)).astype(int)
        cuts = [0, *(np.flatnonzero(np.diff(band)) + 1), len(points) - 1]
        # Pieces overlap, because foot and top of the same place are seen in different columns.
        spans = [(max(0, a - 8), b + 9) for a, b in zip(cuts[:-1], cuts[1:], strict=True) if b > a]
        return [replace(self, path_m=points[a:b], start_m=self.start_m + float(along[a])) for a, b in spans]

    def lines(self) -> np.ndarray:
        """(K, N, 3) points of the profile's lines along the path, road frame."""
        path = np.asarray(self.path_m, float)
        path, ground_height_m = path[:, :2], path[:, 2] if path.shape[1] == 3 else 0.0
        along = np.gradient(path, axis=0)
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
        outward = np.column_stack([-along[:, 1], along[:, 0]]) * self.side
        rise = np.full(len(path), self.height_scale)
        if self.kind == "bank":
            # The cutting ends gently, far away.
            step = np.hypot(*np.diff(path, axis=0).T)
            rise *= smoothstep(0, 80, np.concatenate([np.cumsum(step[::-1])[::-1], [0]]))
        return np.stack(
            [
                np.column_stack([path + outward * lateral, height * rise + ground_height_m])
                for lateral, height in WALLS[self.kind].lines
            ]
        )

    def shadows(self, offset_per_m: np.ndarray) -> list[np.ndarray]:
        """Ground shadow as quadrilaterals along the path; none for a bank, which is ground, and an airy wood."""
        if self.kind in ("bank", "wood"):
            return []
        lines = self.lines()[:, :: max(1, len(self.path_m) // 40)]
        cast = lines[..., :2] + (lines[..., 2:] - lines[0, :, 2:]) * offset_per_m
        shadows = []
        for low, high in zip(cast[:-1], cast[1:], strict=True):
            shadows += [np.array([low[i], low[i + 1], high[i + 1], high[i]]) for i in range(len(low) - 1)]
        return shadows


def _resample(path: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points along a path, dense where near, and their arc lengths."""
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1))])
    # Complex numbers take one look-up instead of two.
    places = path[:, 0] + 1j * path[:, 1]
    along, s = [0.0], 0.0
    while s < length[-1]:
        s += max(0.15, 0.02 * float(abs(np.interp(s, length, places))))
        along.append(min(s, length[-1]))
    along = np.array(along)
    return np.column_stack([np.interp(along, length, column) for column in path.T]), along


def paint_wall(picture: np.ndarray, camera: Camera, wall: Wall, sun: np.ndarray, air: tuple) -> None:
    """Paint a piece of a wall behind what is in a picture (4, H, W); strips that turn their back skip themselves."""
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
    """Give lines that run above the lens's sight the pixels that continue the wall's face from its foot, in place."""
    share = 0.08
    for line in range(1, len(lines)):
        blind = np.isnan(pixels[line, :, 0]) & np.isfinite(pixels[0, :, 0])
        above = lines[0, blind] + share * (lines[line, blind] - lines[0, blind])
        if blind.any():
            pixels[line, blind] = pixels[0, blind] + (camera.road_to_pixels(above) - pixels[0, blind]) / share


def _strip_normals(lines: np.ndarray, side: int) -> np.ndarray:
    """(K - 1, N, 3) unit normals towards the road and up of the strips between lines (K, N, 3)."""
    along, up = np.gradient(lines[:-1], axis=1), lines[1:] - lines[:-1]
    (a, b, c), (d, e, f) = np.moveaxis(along, -1, 0), np.moveaxis(up, -1, 0)
    # Written out: np.cross takes three times as long for so few vectors.
    normal = np.stack([b * f - c * e, c * d - a * f, a * e - b * d], axis=-1) * side
    return normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-9)


@dataclass(frozen=True)
class _ProjectedLine:
    """A line as the lens sees it: pixels (N, 2), places along the wall (N,), light (N, 3)."""

    pixels: np.ndarray
    along: np.ndarray
    light: np.ndarray

    def part(self, order: slice) -> _ProjectedLine:
        return _ProjectedLine(self.pixels[order], self.along[order], self.light[order])

    def seen(self) -> _ProjectedLine:
        which = np.isfinite(self.pixels[:, 0])
        return _ProjectedLine(self.pixels[which], self.along[which], self.light[which])

    def turns(self) -> np.ndarray:
        """Indices at which its columns change between rising and falling."""
        direction = np.sign(np.diff(self.pixels[:, 0]))
        return np.flatnonzero(direction[1:] * direction[:-1] < 0) + 1

    def rising(self) -> _ProjectedLine:
        """The line from left to right."""
        line = self if self.pixels[-1, 0] > self.pixels[0, 0] else self.part(slice(None, None, -1))
        return _ProjectedLine(
            np.maximum.accumulate(line.pixels, axis=0) * [1, 0] + line.pixels * [0, 1], line.along, line.light
        )


def _paint_strip(
    picture: np.ndarray, low: _ProjectedLine, high: _ProjectedLine, texture: tuple[np.ndarray, ...], air: tuple
) -> None:
    """Paint between two lines of an upright wall, one run of rising or falling columns at a time, the near ones first.

    Lower and upper line turn at the same place, because one stands on the other.
    """
    both = np.isfinite(low.pixels[:, 0]) & np.isfinite(high.pixels[:, 0])
    if both.sum() < 2:
        return
    low, high = (_ProjectedLine(x.pixels[both], x.along[both], x.light[both]) for x in (low, high))
    bounds = [0, *low.turns(), len(low.along) - 1]
    for a, b in zip(bounds[:-1], bounds[1:], strict=True):
        run = slice(a, b + 1)
        _paint_run(picture, low.part(run).rising(), high.part(run).rising(), texture, air)


def _paint_slope(
    picture: np.ndarray, low: _ProjectedLine, high: _ProjectedLine, texture: tuple[np.ndarray, ...], air: tuple
) -> None:
    """Paint between two lines of a bank up to where it turns out of sight; what is beyond, the near part hides."""
    low, high = low.seen(), high.seen()
    if min(len(low.along), len(high.along)) < 2:
        return
    low, high = (x.part(slice(0, x.turns()[0] + 1 if len(x.turns()) else None)) for x in (low, high))
    # Both lines end where the farther reaching one does: between their ends runs the outline of the bank.
    forward = np.sign(low.pixels[-1, 0] - low.pixels[0, 0])
    ends = sorted((low, high), key=lambda line: forward * line.pixels[-1, 0])
    last = ends[1].part(slice(-1, None))
    longer = _ProjectedLine(
        *(np.concatenate([getattr(ends[0], n), getattr(last, n)]) for n in ("pixels", "along", "light"))
    )
    low, high = (longer if line is ends[0] else line for line in (low, high))
    _paint_run(picture, low.rising(), high.rising(), texture, air)


def _paint_run(
    picture: np.ndarray, low: _ProjectedLine, high: _ProjectedLine, texture: tuple[np.ndarray, ...], air: tuple
) -> None:
    """Every column looks up both lines, which run from left to right; every pixel the texture between them."""
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
            composite_behind(picture, planes, left + columns.start, first + rows.start, through=air[0], air=air[1])


@dataclass(frozen=True)
class _StripColumns:
    """Columns of a strip: rows of its edges and places along the wall there, each (columns,), light (3, columns)."""

    top: np.ndarray
    bottom: np.ndarray
    s_low: np.ndarray
    s_high: np.ndarray
    lit: np.ndarray


def _columns_by_level(foot_m: np.ndarray, levels: int) -> list[tuple[int, slice]]:
    """Runs of columns that need the texture at the same level; `foot_m` is the place along the wall that each sees.

    A run is short, because each is painted in a rectangle of its own: a strip that is seen at a slant fills little of
    the one around all of it.
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
    """Lit texture between the edges in the picture's rows `v` (rows, 1): planes of RGB times coverage, and coverage."""
    # Single precision, in place where possible: a wood is a good part of the picture. Places along the wall are wrapped
    # first, because they can be some kilometres.
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
