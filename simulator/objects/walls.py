"""Walls along the road: concrete barriers, guard rails, parapets, kerbs, rock, woods and grassy banks.

A wall is a stack of strips between lines that follow a path at given lateral offsets and heights.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from simulator.painting.noise import smoothstep

# Sorting distance of a fully visible bank: behind everything.
BANK_DISTANCE_M = 590.0


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
    """Wall along a path.

    Parameters
    ----------
    path_m : ndarray of shape (N, 2) or (N, 3)
        Foot of the traffic face in the road frame, in the road's direction, metres.
    kind : str
        A name in `WALLS`.
    side : int
        +1 for a wall on the left (its back is further left), -1 on the right.
    height_scale : float
        Height relative to the profile.
    start_m : float
        Arc length of the first point, which fixes joints and stains to the road.
    light : ndarray of shape (N, 3), optional
        Share of open daylight at the points of the path.

    Raises
    ------
    ValueError
        If the kind, the side or the shape of the path is wrong.
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
            raise ValueError(f"unknown wall {self.kind!r}; choose one of {', '.join(sorted(WALLS))}.")
        if self.side not in (-1, 1):
            raise ValueError(f"side is +1 (left) or -1 (right), not {self.side}.")
        path = np.asarray(self.path_m, float)
        if path.ndim != 2 or path.shape[1] not in (2, 3) or len(path) < 2:
            raise ValueError(f"a wall's path has the shape (points, 2 or 3), two points at least, not {path.shape}.")

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
