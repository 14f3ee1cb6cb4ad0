"""Objects on and beside the road: placed in road coordinates, and converted to the frame of the car."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from simulator.objects.overpass import BridgeSlice, Overpass
from simulator.objects.standing import Post
from simulator.objects.trees import Tree
from simulator.objects.vehicles import Car
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


SceneObject = Car | Tree | Post | Wall | BridgeSlice


@dataclass(frozen=True)
class PlacedObject:
    """Object at arc length `s_m` and lateral position `lateral_m` at time 0, moving along the road at `speed_mps`.

    The heading of a car is relative to the road. `path` holds knots (time in s, lateral position in m) of a car that
    moves sideways: the position is interpolated smoothly, and the heading follows.
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


def from_far_to_near(objects: list[SceneObject], *, growth: float) -> list[tuple[float, SceneObject]]:
    """Objects up to MAX_OBJECT_M with their distances; walls are cut into segments, see `Wall.segments`.

    Of two objects at one distance, the later one in the list is in front.
    """
    cut = [item.segments(growth=growth) if isinstance(item, Wall) else [item] for item in objects]
    parts = [(part.distance_m, part) for segments in cut for part in segments]
    return sorted((part for part in parts if part[0] < MAX_OBJECT_M), key=lambda part: -part[0])


def _in_reach(item: Car | Tree | Post, place_m: np.ndarray) -> bool:
    """Whether an object can matter: in view, or a tree or street lamp that can shade or light the road ahead."""
    x, y, _ = place_m
    if isinstance(item, Tree) or (isinstance(item, Post) and item.arm_m):
        return -30.0 < x < MAX_OBJECT_M
    return 1.0 < x < MAX_OBJECT_M and abs(y) < WIDEST_VIEW * x + 5.0


def _moved(item: Car | Tree | Post, place_m: np.ndarray, heading_rad: float) -> SceneObject:
    place: dict[str, Any] = dict(zip(("x_m", "y_m", "ground_height_m"), place_m.tolist(), strict=True))
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
