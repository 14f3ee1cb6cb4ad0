"""Objects on and beside the road: placed in road coordinates, converted to the frame of the car, and their shadows."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np

from lanes.camera import Camera
from simulator.objects.standing import Post, Tree
from simulator.objects.vehicles import Car
from simulator.objects.walls import BridgeSlice, Overpass, Wall
from simulator.road.geometry import RoadGeometry, VehiclePose, surface_points
from simulator.road.ground import Ground, RoadAhead

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
        return float(
            laterals[i]
            + (laterals[i + 1] - laterals[i]) * share * share * (3 - 2 * share)
        )

    def path_heading_rad(self, time_s: float) -> float:
        """Heading relative to the road that follows from `path` at a time, radians, > 0 left."""
        if not self.path or not self.speed_mps:
            return 0.0
        across = (
            self.lateral_at(time_s + 0.02) - self.lateral_at(time_s - 0.02)
        ) / 0.04
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
    placed: tuple[PlacedObject | PlacedWall | Overpass, ...],
    road: RoadGeometry,
    pose: VehiclePose,
    *,
    time_s: float,
) -> list[SceneObject]:
    """Objects in view in the road frame of the car at a time; walls are cut to the visible length."""
    walls = [_wall(p, road, pose) for p in placed if isinstance(p, PlacedWall)]
    others = [p for p in placed if isinstance(p, PlacedObject)]
    s = np.array([p.s_m + p.speed_mps * time_s for p in others])
    points = surface_points(
        road, pose, s, np.array([p.lateral_at(time_s) for p in others])
    )
    headings = pose.turn_to(road, s) + np.array(
        [p.path_heading_rad(time_s) for p in others]
    )
    places = zip(others, points, headings, strict=True)
    ahead = [
        _moved(p.item, place, heading)
        for p, place, heading in places
        if _in_reach(p.item, place)
    ]
    bridges = [
        part
        for p in placed
        if isinstance(p, Overpass)
        for part in p.slices_at(road, pose)
    ]
    return [wall for wall in walls if wall is not None] + bridges + ahead


def from_far_to_near(
    objects: list[SceneObject], *, growth: float
) -> list[tuple[float, SceneObject]]:
    """Objects up to MAX_OBJECT_M with their distances; walls are cut into segments, see `Wall.segments`.

    Of two objects at one distance, the later one in the list is in front.
    """
    cut = [
        item.segments(growth=growth) if isinstance(item, Wall) else [item]
        for item in objects
    ]
    parts = [(part.distance_m, part) for segments in cut for part in segments]
    return sorted(
        (part for part in parts if part[0] < MAX_OBJECT_M), key=lambda part: -part[0]
    )


def _in_reach(item: Car | Tree | Post, place_m: np.ndarray) -> bool:
    """Whether an object can matter: in view, or a tree or street lamp that can shade or light the road ahead."""
    x, y, _ = place_m
    if isinstance(item, Tree) or (isinstance(item, Post) and item.arm_m):
        return -30.0 < x < MAX_OBJECT_M
    return 1.0 < x < MAX_OBJECT_M and abs(y) < WIDEST_VIEW * x + 5.0


def _moved(
    item: Car | Tree | Post, place_m: np.ndarray, heading_rad: float
) -> SceneObject:
    place: dict[str, Any] = dict(
        zip(("x_m", "y_m", "ground_height_m"), place_m.tolist(), strict=True)
    )
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
    turned = np.flatnonzero(np.abs(pose.turn_to(road, s)) > WALL_TURNS_RAD)
    s = s[: max(turned[0], 2)] if len(turned) else s
    path = surface_points(road, pose, s, along.lateral_m)
    side = 1 if along.lateral_m > pose.lateral_m else -1
    return Wall(
        path,
        along.kind,
        side,
        height_scale=along.height_scale,
        start_m=float(first),
        seed=along.seed,
    )


# Range of shadows ahead; the bonnet hides nearer ones.
MIN_SHADOW_M = 1.5
MAX_SHADOW_M = 160.0
LEAF_SEED = 61
# Longest edge that is not subdivided, metres.
EDGE_M = 1.5
# Margin for the blur of shadow edges.
PENUMBRA_PX = 6
# Bounds of the displacement of edges: standard deviations of the noise, and the smallest step of a row on the ground.
MAX_NOISE, MIN_STEP_M = 6.0, 1e-2
# Limit of coordinates, far outside any image.
MAX_PX = 1e6


def shadow_polygons(
    objects: Iterable[SceneObject], sun_direction: np.ndarray
) -> list[np.ndarray]:
    """Polygons (N, 2) of the shadows on the ground, metres in the road frame, float32; their union is the shadow.

    A tree has a polygon for each lump of leaves. `sun_direction` (3,) points towards the sun, in the road frame.
    """
    offset_per_m = -sun_direction[:2] / sun_direction[2]
    return [
        polygon.astype(np.float32, copy=False)
        for item in objects
        for polygon in item.shadows(offset_per_m)
    ]


def cast_shadows(
    sun: np.ndarray,
    polygons_m: list[np.ndarray],
    camera: Camera,
    ground: Ground,
    road: RoadAhead,
    *,
    edge_noise_m: float = 0.0,
) -> None:
    """Remove the sunlight `sun` (rows, width) inside shadow polygons (N, 2), metres in the car's road frame, in place.

    `ground` is that of the same rows; the vertical profile of the road carries the shadows. `edge_noise_m` is the
    displacement of the outlines by leaves; 0 keeps them sharp.
    """
    near = [
        p
        for p in polygons_m
        if p[:, 0].max() > MIN_SHADOW_M and p[:, 0].min() < MAX_SHADOW_M
    ]
    if not near:
        return
    points, ends = _densify(near)
    points = points if road.profile.level else road.lift_to_surface(points)
    outlines = camera.road_to_pixels(points) - [0, ground.top]
    starts = np.concatenate([[0], ends[:-1]])
    out_of_sight = np.logical_or.reduceat(np.isnan(outlines[:, 0]), starts)
    # points close to the camera are projected so far away that 32 bits do not hold them
    corners = np.rint(np.nan_to_num(outlines).clip(-MAX_PX, MAX_PX) * 16).astype(
        np.int32
    )
    mask = np.zeros(sun.shape, np.uint8)
    for first, last in zip(
        starts[~out_of_sight].tolist(), ends[~out_of_sight].tolist(), strict=True
    ):
        cv2.fillPoly(mask, [corners[first:last]], 255, cv2.LINE_AA, 4)
    shaded = np.flatnonzero(mask.any(axis=1))
    if not len(shaded):
        return
    margin = PENUMBRA_PX + int(MAX_NOISE * edge_noise_m / MIN_STEP_M)
    rows = slice(max(shaded[0] - margin, 0), shaded[-1] + margin + 1)
    shadow = (
        _perturb_edges(mask, ground, rows, edge_noise_m) if edge_noise_m else mask[rows]
    )
    # A penumbra of about a pixel; it is a few centimetres wide at car height.
    sun[rows] *= 1 - cv2.GaussianBlur(shadow, (0, 0), 0.8).astype(
        np.float32
    ) * np.float32(0.97 / 255)


def _perturb_edges(
    mask: np.ndarray, ground: Ground, rows: slice, shift_m: float
) -> np.ndarray:
    """Rows of the mask, with edges displaced by noise of about `shift_m` on the ground, as by twigs and leaves."""
    part = ground.rows(rows)
    shift_d, shift_s = (
        part.noise(LEAF_SEED, (0.20, 0.15), octaves=3, shift_m=add) for add in (0, 7)
    )
    v, u = np.indices(part.s.shape, np.float32)
    u += np.float32(shift_m) * shift_d / np.maximum(np.abs(part.d_u), 1e-3)
    v += rows.start + np.float32(shift_m) * shift_s / np.maximum(
        part.footprint_s, MIN_STEP_M
    )
    return cv2.remap(mask, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def _densify(polygons: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 2) of all polygons, one after the other, and the index after the last point of each.

    Long edges are subdivided, because the lens distorts straight lines. Points are clipped to MIN_SHADOW_M ahead.
    """
    points = np.concatenate(polygons).astype(float)
    last = np.cumsum([len(p) for p in polygons]) - 1
    following = np.arange(1, len(points) + 1)
    following[last] = np.concatenate([[0], last[:-1] + 1])
    edges = points[following] - points
    parts = np.clip(np.hypot(*edges.T) / EDGE_M, 1, 12).astype(int)
    until = np.cumsum(parts)
    share = (np.arange(until[-1]) - np.repeat(until - parts, parts)) / np.repeat(
        parts, parts
    )
    dense = np.repeat(points, parts, axis=0) + share[:, None] * np.repeat(
        edges, parts, axis=0
    )
    dense[:, 0] = np.maximum(dense[:, 0], MIN_SHADOW_M)
    return dense, until[last]
