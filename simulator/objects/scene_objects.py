"""Objects on and beside the road, and their shadows.

Objects are placed in road coordinates and converted to the frame of the car.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import cv2
import numpy as np

from lanes.camera.model import Camera
from simulator.objects.standing import Post, Tree
from simulator.objects.vehicles import Car
from simulator.objects.walls import BridgeSlice, Overpass, Wall
from simulator.road.geometry import RoadGeometry, VehiclePose, surface_points
from simulator.road.ground import Ground, RoadAhead

# Objects farther than this are not painted: a car is 4 pixels wide there.
MAX_OBJECT_M = 600.0
# Length of walls behind and ahead: a barrier is a pixel high at 450 m.
WALL_BEHIND_M = 6
WALL_AHEAD_M = 450.0
WALL_STEP_M = 2.0
# A wall ends where the road has turned by this angle.
WALL_TURNS_RAD = np.radians(200)
# Tangent of half the field of view of a wide dashcam (120 degrees).
WIDEST_VIEW = 1.73
# Half the time step of the derivative of a path.
PATH_STEP_S = 0.02


SceneObject = Car | Tree | Post | Wall | BridgeSlice


@dataclass(frozen=True)
class PlacedObject:
    """Object at arc length `s_m` and lateral position `lateral_m` at time 0.

    It moves along the road at `speed_mps`. The heading of a car is relative to the
    road. `path` holds knots (time in s, lateral position in m) of a car that moves
    sideways: the position is interpolated smoothly, and the heading follows.
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
        before = np.searchsorted(times, time_s) - 1
        i = np.clip(before, 0, len(times) - 2)
        seconds = times[i + 1] - times[i]
        share = np.clip((time_s - times[i]) / seconds, 0, 1)
        step = laterals[i + 1] - laterals[i]
        return float(laterals[i] + step * share * share * (3 - 2 * share))

    def path_heading_rad(self, time_s: float) -> float:
        """Heading relative to the road that follows from `path`, radians, > 0 left."""
        if not self.path or not self.speed_mps:
            return 0.0
        before = self.lateral_at(time_s - PATH_STEP_S)
        after = self.lateral_at(time_s + PATH_STEP_S)
        across_mps = (after - before) / (2 * PATH_STEP_S)
        return float(np.arctan(across_mps / self.speed_mps))


@dataclass(frozen=True)
class PlacedWall:
    """Wall from `start_m` to `end_m` along the road.

    `lateral_m` is its foot on the side of the traffic.
    """

    lateral_m: float
    kind: str
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
    """Objects in view in the road frame of the car at a time.

    Walls are cut to the visible length.
    """
    walls: list[SceneObject] = []
    bridges: list[SceneObject] = []
    others = []
    for item in placed:
        if isinstance(item, PlacedObject):
            others.append(item)
        elif isinstance(item, Overpass):
            bridges += item.slices_at(road, pose)
        elif wall := _visible_wall(item, road, pose):
            walls.append(wall)
    return walls + bridges + _visible_objects(others, road, pose, time_s)


def _visible_objects(
    placed: list[PlacedObject], road: RoadGeometry, pose: VehiclePose, time_s: float
) -> list[SceneObject]:
    # One call for all positions, because there are hundreds of objects.
    s = np.array([p.s_m + p.speed_mps * time_s for p in placed])
    lateral = np.array([p.lateral_at(time_s) for p in placed])
    points = surface_points(road, pose, s, lateral)
    headings = pose.turn_to(road, s)

    visible: list[SceneObject] = []
    for p, point, heading in zip(placed, points, headings, strict=True):
        x, y, ground_height = point.tolist()
        if not _in_reach(p.item, x, y):
            continue
        item = replace(p.item, x_m=x, y_m=y, ground_height_m=ground_height)
        if isinstance(item, Car):
            turned = float(heading + p.path_heading_rad(time_s))
            item = replace(item, heading_rad=item.heading_rad + turned)
        visible.append(item)
    return visible


def from_far_to_near(
    objects: list[SceneObject], *, growth: float
) -> list[tuple[float, SceneObject]]:
    """Objects up to MAX_OBJECT_M with their distances.

    Walls are cut into segments, see `Wall.segments`. Of two objects at one distance,
    the later one in the list is in front.
    """
    parts: list[SceneObject] = []
    for item in objects:
        parts += item.segments(growth=growth) if isinstance(item, Wall) else [item]
    placed = [(part.distance_m, part) for part in parts]
    near = [(distance, part) for distance, part in placed if distance < MAX_OBJECT_M]
    return sorted(near, key=lambda pair: -pair[0])


def _in_reach(
    item: Car | Tree | Post,
    x_m: float,
    y_m: float,
) -> bool:
    """Whether an object can matter at a place.

    It is in view, or a tree or street lamp that can shade or light the road ahead.
    """
    if isinstance(item, Tree) or (isinstance(item, Post) and item.arm_m):
        return -30.0 < x_m < MAX_OBJECT_M
    return 1.0 < x_m < MAX_OBJECT_M and abs(y_m) < WIDEST_VIEW * x_m + 5.0


def _visible_wall(
    placed: PlacedWall, road: RoadGeometry, pose: VehiclePose
) -> Wall | None:
    # On a grid that is fixed to the road, so that joints do not move with the car.
    behind = np.floor((pose.s_m - WALL_BEHIND_M) / WALL_STEP_M) * WALL_STEP_M
    first = max(placed.start_m, behind)
    last = min(placed.end_m, pose.s_m + WALL_AHEAD_M)
    if last - first < 2 * WALL_STEP_M:
        return None
    s = np.arange(first, last, WALL_STEP_M)
    turned = np.flatnonzero(np.abs(pose.turn_to(road, s)) > WALL_TURNS_RAD)
    if len(turned):
        s = s[: max(turned[0], 2)]
    return Wall(
        path_m=surface_points(road, pose, s, placed.lateral_m),
        kind=placed.kind,
        side=1 if placed.lateral_m > pose.lateral_m else -1,
        height_scale=placed.height_scale,
        start_m=float(first),
        seed=placed.seed,
    )


# Range of shadows ahead; the bonnet hides nearer ones.
MIN_SHADOW_M = 1.5
MAX_SHADOW_M = 160.0
LEAF_SEED = 61
# Longest edge that is not subdivided, metres, and most parts of an edge.
EDGE_M = 1.5
MAX_EDGE_PARTS = 12
# Margin for the blur of shadow edges.
PENUMBRA_PX = 6
# Share of the sunlight that a shadow takes away.
SHADOW_DEPTH = 0.97
# Bounds of the displacement of edges: standard deviations of the noise, and the
# smallest step of a row on the ground.
MAX_NOISE = 6.0
MIN_STEP_M = 1e-2
# Limit of coordinates, far outside any image.
MAX_PX = 1e6
# Fractional bits of OpenCV's polygon coordinates.
_SHIFT = 4


def shadow_polygons(
    objects: Iterable[SceneObject], sun_direction: np.ndarray
) -> list[np.ndarray]:
    """Polygons (N, 2) float32 of the shadows on the ground, metres in the road frame.

    Their union is the shadow; a tree has a polygon for each lump of leaves.
    `sun_direction` (3,) points towards the sun, in the road frame.
    """
    offset_per_m = -sun_direction[:2] / sun_direction[2]
    polygons: list[np.ndarray] = []
    for item in objects:
        polygons += item.shadows(offset_per_m)
    return [polygon.astype(np.float32, copy=False) for polygon in polygons]


def cast_shadows(
    sun: np.ndarray,
    polygons_m: list[np.ndarray],
    camera: Camera,
    ground: Ground,
    road: RoadAhead,
    *,
    edge_noise_m: float = 0.0,
) -> None:
    """Remove the sunlight `sun` (rows, width) inside shadow polygons, in place.

    The polygons (N, 2) are metres in the car's road frame. `ground` is that of the same
    rows; the vertical profile of the road carries the shadows. `edge_noise_m` is the
    displacement of the outlines by leaves; 0 keeps them sharp.
    """
    near = []
    for polygon in polygons_m:
        x = polygon[:, 0]
        if x.max() > MIN_SHADOW_M and x.min() < MAX_SHADOW_M:
            near.append(polygon)
    if not near:
        return

    mask = _shadow_mask(near, camera, ground, road)
    shaded = np.flatnonzero(mask.any(axis=1))
    if not len(shaded):
        return
    margin = PENUMBRA_PX + int(MAX_NOISE * edge_noise_m / MIN_STEP_M)
    rows = slice(max(shaded[0] - margin, 0), shaded[-1] + margin + 1)
    shadow = mask[rows]
    if edge_noise_m:
        shadow = _perturb_edges(mask, ground, rows, edge_noise_m)
    # A penumbra of about a pixel; it is a few centimetres wide at car height.
    soft = cv2.GaussianBlur(shadow, (0, 0), 0.8).astype(np.float32)
    sun[rows] *= 1 - soft * (SHADOW_DEPTH / 255)


def _shadow_mask(
    polygons_m: list[np.ndarray],
    camera: Camera,
    ground: Ground,
    road: RoadAhead,
) -> np.ndarray:
    """Mask (rows, width) uint8 of shadow polygons (N, 2), anti-aliased."""
    points, ends = _densify(polygons_m)
    if not road.profile.level:
        points = road.lift_to_surface(points)
    outlines = camera.road_to_pixels(points) - [0, ground.top]

    # Points close to the camera are projected so far away that 32 bits do not hold
    # them.
    limited = np.nan_to_num(outlines).clip(-MAX_PX, MAX_PX)
    corners = np.rint(limited * (1 << _SHIFT)).astype(np.int32)
    mask = np.zeros(ground.s.shape, np.uint8)
    out_of_sight = np.isnan(outlines[:, 0])
    first = 0
    for last in ends.tolist():
        if not out_of_sight[first:last].any():
            cv2.fillPoly(mask, [corners[first:last]], 255, cv2.LINE_AA, _SHIFT)
        first = last
    return mask


def _perturb_edges(
    mask: np.ndarray, ground: Ground, rows: slice, shift_m: float
) -> np.ndarray:
    """Rows of the mask with irregular edges, as of twigs and leaves.

    The edges are displaced by noise of about `shift_m` on the ground.
    """
    part = ground.rows(rows)
    shift_d = part.noise(LEAF_SEED, (0.20, 0.15), octaves=3)
    shift_s = part.noise(LEAF_SEED, (0.20, 0.15), octaves=3, shift_m=7)
    v, u = np.indices(part.s.shape, np.float32)
    u += np.float32(shift_m) * shift_d / np.maximum(np.abs(part.d_u), 1e-3)
    along_px = np.float32(shift_m) * shift_s / np.maximum(part.footprint_s, MIN_STEP_M)
    v += rows.start + along_px
    return cv2.remap(mask, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def _densify(polygons: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 2) of all polygons, and the index after the last point of each.

    Long edges are subdivided, because the lens distorts straight lines. Points are
    clipped to MIN_SHADOW_M ahead.
    """
    points = np.concatenate(polygons).astype(float)
    last = np.cumsum([len(polygon) for polygon in polygons]) - 1
    following = np.arange(1, len(points) + 1)
    following[last] = np.concatenate([[0], last[:-1] + 1])
    edges = points[following] - points

    # Number of parts of each edge, and the share of the edge before each part.
    length = np.hypot(*edges.T)
    parts = np.clip(length / EDGE_M, 1, MAX_EDGE_PARTS).astype(int)
    until = np.cumsum(parts)
    part_number = np.arange(until[-1]) - np.repeat(until - parts, parts)
    share = part_number / np.repeat(parts, parts)

    dense = np.repeat(points, parts, axis=0)
    dense = dense + share[:, None] * np.repeat(edges, parts, axis=0)
    dense[:, 0] = np.maximum(dense[:, 0], MIN_SHADOW_M)
    return dense, until[last]
