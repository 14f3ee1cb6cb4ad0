"""Objects on and beside the road: placed in road coordinates, and converted to the frame of the car.

The frame of the car is x forward, y left, z up, metres; the camera is above the origin. `ground_height_m` is the height
of the road at the object above the plane under the car.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from simulator.objects.overpass import BridgeSlice, Overpass
from simulator.objects.walls import Wall
from simulator.road.geometry import RoadGeometry, VehiclePose, surface_points

# Objects farther than this are not painted: a car is 4 pixels wide there.
MAX_OBJECT_M = 600.0
# Length of walls ahead: a barrier is a pixel high at 450 m.
WALL_AHEAD_M = 450.0
WALL_STEP_M = 2.0
# A wall ends where the road has turned by this angle.
WALL_TURNS_RAD = np.radians(200)
# Tangent of half the field of view of a wide dashcam (120 degrees).
WIDEST_VIEW = 1.73


@dataclass(frozen=True)
class Car:
    """Vehicle with its centre at (x_m, y_m); heading 0 is the car's own direction, pi is oncoming.

    `body` is "sedan", "suv", "truck" or "motorcycle".
    """

    x_m: float
    y_m: float
    heading_rad: float = 0.0
    paint: str = "white"
    body: str = "sedan"
    ground_height_m: float = 0.0


@dataclass(frozen=True)
class Tree:
    """Tree or bush; `species` is a name in `trees.SPECIES`."""

    x_m: float
    y_m: float
    height_m: float = 10.0
    species: str = "oak"
    seed: int = 0
    base_m: float = 0.0
    ground_height_m: float = 0.0


@dataclass(frozen=True)
class Post:
    """Vertical pole: a delineator (1 m), a utility pole or, with an arm of length `arm_m`, a street lamp."""

    x_m: float
    y_m: float
    height_m: float = 1.0
    width_m: float = 0.1
    arm_m: float = 0.0
    colour: tuple[float, float, float] = (0.55, 0.55, 0.53)
    ground_height_m: float = 0.0


SceneObject = Car | Wall | BridgeSlice | Tree | Post


def yaw_rotation(heading_rad: float) -> np.ndarray:
    """Rotation matrix (3, 3) about z by a heading, > 0 turns left."""
    c, s = np.cos(heading_rad), np.sin(heading_rad)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def vertical_rectangle(x: float, y: float, left: float, right: float, bottom: float, top: float) -> np.ndarray:
    """Corners (4, 3) of a vertical rectangle across the road: lower right, upper right, upper left, lower left."""
    return np.array([[x, y - right, bottom], [x, y - right, top], [x, y + left, top], [x, y + left, bottom]])


@dataclass(frozen=True)
class PlacedObject:
    """Object at arc length `s_m` and lateral position `lateral_m` at time 0, moving along the road at `speed_mps`.

    The x and y of `item` are ignored, and the heading of a car is relative to the road. `path` holds knots (time in s,
    lateral position in m) of a car that moves sideways: the position is interpolated smoothly, and the heading follows.
    """

    s_m: float
    lateral_m: float
    item: Car | Tree | Post
    speed_mps: float = 0.0
    path: tuple[tuple[float, float], ...] = ()

    def lateral_at(self, time_s: float) -> float:
        """Lateral position at a time, metres."""
        if not self.path:
            return self.lateral_m
        times, laterals = np.array(self.path).T
        i = int(np.clip(np.searchsorted(times, time_s) - 1, 0, len(times) - 2))
        share = np.clip((time_s - times[i]) / (times[i + 1] - times[i]), 0, 1)
        return float(laterals[i] + (laterals[i + 1] - laterals[i]) * share * share * (3 - 2 * share))

    def path_heading_rad(self, time_s: float) -> float:
        """Heading relative to the road that follows from `path` at a time, radians, > 0 left."""
        if not self.path or not self.speed_mps:
            return 0.0
        across = (self.lateral_at(time_s + 0.02) - self.lateral_at(time_s - 0.02)) / 0.04
        return float(np.arctan(across / self.speed_mps))


@dataclass(frozen=True)
class PlacedWall:
    """Wall from `start_m` to `end_m` along the road; `lateral_m` is its foot on the side of the traffic."""

    lateral_m: float
    kind: str = "jersey"
    start_m: float = -100.0
    end_m: float = 1500.0
    height_scale: float = 1.0
    seed: int = 0


def objects_in_view(
    placed: tuple[PlacedObject | PlacedWall | Overpass, ...], road: RoadGeometry, pose: VehiclePose, *, time_s: float
) -> list[SceneObject]:
    """Objects in view in the road frame of the car at a time; walls are cut to the visible length."""
    walls = [_wall(p, road, pose) for p in placed if isinstance(p, PlacedWall)]
    others = [p for p in placed if isinstance(p, PlacedObject)]
    s = np.array([p.s_m + p.speed_mps * time_s for p in others])
    points = surface_points(road, pose, s, np.array([p.lateral_at(time_s) for p in others]))
    headings = road.heading(s) - pose.absolute_heading(road) + np.array([p.path_heading_rad(time_s) for p in others])
    ahead = [
        _moved(p.item, place, heading)
        for p, place, heading in zip(others, points, headings, strict=True)
        if _in_reach(p.item, place)
    ]
    bridges = [part for p in placed if isinstance(p, Overpass) for part in p.slices_at(road, pose)]
    return [wall for wall in walls if wall is not None] + bridges + ahead


def _in_reach(item: SceneObject, place_m: np.ndarray) -> bool:
    """Whether an object can matter: in view, or a tree or street lamp that can shade or light the road ahead."""
    x, y, _ = place_m
    if isinstance(item, Tree) or (isinstance(item, Post) and item.arm_m):
        return -30.0 < x < MAX_OBJECT_M
    return 1.0 < x < MAX_OBJECT_M and abs(y) < WIDEST_VIEW * x + 5.0


def _moved(item: SceneObject, place_m: np.ndarray, heading_rad: float) -> SceneObject:
    x_m, y_m, ground_height_m = place_m
    place: dict[str, Any] = {"x_m": float(x_m), "y_m": float(y_m), "ground_height_m": float(ground_height_m)}
    if isinstance(item, Car):
        place["heading_rad"] = item.heading_rad + float(heading_rad)
    return replace(item, **place)


def _wall(along: PlacedWall, road: RoadGeometry, pose: VehiclePose) -> Wall | None:
    # On a grid that is fixed to the road, so that joints do not move with the car.
    first = max(along.start_m, np.floor((pose.s_m - 6) / WALL_STEP_M) * WALL_STEP_M)
    last = min(along.end_m, pose.s_m + WALL_AHEAD_M)
    if last - first < 2 * WALL_STEP_M:
        return None
    s = np.arange(first, last, WALL_STEP_M)
    turned = np.flatnonzero(np.abs(road.heading(s) - pose.absolute_heading(road)) > WALL_TURNS_RAD)
    s = s[: max(turned[0], 2)] if len(turned) else s
    path = surface_points(road, pose, s, along.lateral_m)
    side = 1 if along.lateral_m > pose.lateral_m else -1
    return Wall(path, along.kind, side, height_scale=along.height_scale, start_m=float(first), seed=along.seed)
