"""Road coordinates of ground points, and the ground seen by each pixel.

With the ground of a pixel comes its footprint there. On a road with a vertical profile
the rays are cast onto the relief, where crests hide the ground behind them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import cv2
import numpy as np

from lanes.camera.model import Camera
from simulator.painting import fade, sample_noise
from simulator.road.geometry import MAX_TURN_RAD, RoadGeometry, VehiclePose

# A road with curvature above this is winding: mountain roads are, motorways and country
# roads are not.
WINDING_PER_M = 1 / 120
# Range and step of the tables.
BEHIND_M = 40.0
AHEAD_M = 900.0
STEP_M = 0.5
# Length of a winding road that is drawn; the rest is behind trees.
WINDING_AHEAD_M = 220.0
# Range of the search for crests, and the smallest slope (2 pixels of a dashcam) that a
# crest must hide.
CREST_RANGE_M = 200.0
MIN_HIDDEN_SLOPE = 0.002
# Extent and cell size, in the car's frame, of the nearest-node map of a winding road.
MAP_X_M = (-40.0, 160.0)
MAP_Y_M = (-120.0, 120.0)
MAP_CELL_M = 0.5
# Least stretch of arc length beside the road, on the inside of a sharp bend.
MIN_STRETCH = 0.2


class RoadAhead:
    """Tables of the road in the car's frame.

    They give road coordinates (s, d) of many ground points (float32). Arc lengths are
    relative to `pose.s_m`, which keeps float32 exact to 0.1 mm. Unless the road is
    `winding`, the tables end where it has turned by 80 degrees, because one x has two
    points on the road beyond that.

    Attributes
    ----------
    winding : bool
        Whether the road turns by more than 80 degrees in sharp bends. A ground point is
        then assigned to the nearest point of the road, by a map.
    """

    def __init__(self, road: RoadGeometry, pose: VehiclePose) -> None:
        s = np.arange(-BEHIND_M, AHEAD_M + STEP_M, STEP_M)
        angle = pose.turn_to(road, pose.s_m + s)

        # How far the table reaches.
        turned = np.flatnonzero((np.abs(angle) > MAX_TURN_RAD) & (s > 0))
        near = s[s < WINDING_AHEAD_M]
        sharpest = np.abs(road.curvature(pose.s_m + near)).max()
        self.winding = bool(len(turned)) and sharpest > WINDING_PER_M
        end = len(s)
        if self.winding:
            end = int(np.argmax(s > WINDING_AHEAD_M))
        elif len(turned):
            end = turned[0]
        s = s[:end]
        angle = angle[:end]

        # Columns of the table: position, direction and curvature at each node.
        points = pose.to_car(road, road.position(pose.s_m + s))
        curvature = road.curvature(pose.s_m + s)
        columns = (*points.T, np.cos(angle), np.sin(angle), curvature)
        self.profile = road.profile
        self.pose = pose
        self._s0 = np.float32(s[0])
        self._table = [column.astype(np.float32) for column in columns]

        if self.winding:
            self._map = _nearest_nodes(points)
        else:
            # First guess: the point of the road at the same x, tabulated at steps of x.
            x = points[:, 0]
            grid = np.arange(x[0], x[-1], STEP_M)
            steps = (np.interp(grid, x, s) - s[0]) / STEP_M
            self._x0 = np.float32(x[0])
            self._guess = np.rint(steps).astype(np.intp)

    def locate(
        self,
        x_m: np.ndarray,
        y_m: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Road coordinates (s, d) of ground points in the car's frame.

        The points (x forward, y left) and the result are float32, metres, of any shape.
        s counts from the car's arc length, d to the left of the reference line. Each
        iteration projects the point onto the osculating circle at the nearest table
        node. The error is the change of curvature within half a table step. Three
        iterations are enough for points within 50 m of the reference line and radii
        above 50 m.
        """
        x = x_m.ravel()
        y = y_m.ravel()
        first = self._first_node(x, y)
        node = first
        s, d = self._project(x, y, node)
        for _ in range(2):
            nearest = self._nearest_node(s)
            if self.winding:
                # The map is exact to some nodes. A longer step could lead to another
                # bend.
                nearest = np.clip(nearest, first - 4, first + 4)
            # Most points are at the right node already.
            moved = np.flatnonzero(nearest != node)
            node = nearest
            s[moved], d[moved] = self._project(x[moved], y[moved], node[moved])
        return (s + self._s0).reshape(x_m.shape), d.reshape(x_m.shape)

    def _project(
        self,
        x_m: np.ndarray,
        y_m: np.ndarray,
        node: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates (s from the table's start, d) of points (N,).

        They are those on the osculating circles at nodes (N,).
        """
        node_x, node_y, cosine, sine, curvature = _take(self._table, node)
        dx = x_m - node_x
        dy = y_m - node_y
        along = cosine * dx + sine * dy
        across = cosine * dy - sine * dx
        ahead = along / np.maximum(1 - curvature * across, MIN_STRETCH)
        s = node.astype(np.float32) * STEP_M + ahead
        return s, across - curvature * along * ahead / 2

    def _nearest_node(self, s: np.ndarray) -> np.ndarray:
        """Nearest table nodes of arc lengths relative to the table's start."""
        steps = s / STEP_M
        np.rint(steps, out=steps)
        np.clip(steps, 0, len(self._table[0]) - 1, out=steps)
        return steps.astype(np.intp)

    def directions(self, s: np.ndarray) -> list[np.ndarray]:
        """Cosine and sine of the road's heading in the car's frame, and its curvature.

        At points `s` metres from the car.
        """
        steps = (s - self._s0) / STEP_M
        last = len(self._table[0]) - 1
        node = np.clip(steps, 0, last).astype(np.intp)
        return _take(self._table[2:], node)

    def height_above_plane(self, s: np.ndarray) -> np.ndarray:
        """Height in metres of the ground, `s` metres from the car.

        It is the height above the plane that touches the road below the car.
        """
        return self.profile.height_above_plane(s + self.pose.s_m, self.pose.s_m)

    def height_and_grade(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """`height_above_plane` for many points (float32), and the relative slope.

        The slope is that at the point minus that below the car. Extrapolated from the
        nearest table node, at most 0.25 m away: 0.2 mm of error at a vertical radius of
        150 m.
        """
        node = self._nearest_node(s - self._s0)
        height, grade = _take(self._heights, node)
        beyond_node = s - self._s0 - node.astype(np.float32) * STEP_M
        return height + grade * beyond_node, grade

    @cached_property
    def _heights(self) -> list[np.ndarray]:
        """Height above the plane, and relative slope, at the table's nodes."""
        here = self.pose.s_m
        node = np.arange(len(self._table[0]))
        s = here + float(self._s0) + STEP_M * node
        height = self.profile.height_above_plane(s, here)
        grade = self.profile.value(s) - self.profile.value(here)
        return [height.astype(np.float32), grade.astype(np.float32)]

    def crest_distance_m(self, height_m: float) -> float:
        """Distance in metres of the first crest that hides road; infinite if none.

        It is seen by an eye `height_m` above the road.
        """
        s = np.arange(2.0, CREST_RANGE_M)
        slope = (self.height_above_plane(s) - height_m) / s
        hidden = slope < np.maximum.accumulate(slope) - MIN_HIDDEN_SLOPE
        return float(s[np.argmax(hidden)]) if hidden.any() else np.inf

    def lift_to_surface(self, points_m: np.ndarray) -> np.ndarray:
        """Points (N, 3) of the ground at points (N, 2) of the car's plane, metres."""
        s, _ = self.locate(*np.asarray(points_m, np.float32).T)
        return np.column_stack([points_m, self.height_above_plane(s.astype(float))])

    def _first_node(
        self,
        x_m: np.ndarray,
        y_m: np.ndarray,
    ) -> np.ndarray:
        """Initial table nodes near the points."""
        if self.winding:
            return _look_up(self._map, x_m, y_m)
        steps = (x_m - self._x0) / STEP_M
        index = np.clip(steps, 0, len(self._guess) - 1).astype(np.intp)
        return self._guess.take(index, mode="clip")


def _take(
    columns: list[np.ndarray],
    node: np.ndarray,
) -> list[np.ndarray]:
    """Entries of each column at nodes, all of which are in the table."""
    # mode="clip" saves numpy the bounds check.
    return [column.take(node, mode="clip") for column in columns]


def _nearest_nodes(points: np.ndarray) -> np.ndarray:
    """Map (rows of x, columns of y), in cells of MAP_CELL_M, of the nearest point.

    A cell holds the index of the nearest of the points (N, 2).
    """
    low = np.array([MAP_X_M[0], MAP_Y_M[0]])
    high = np.array([MAP_X_M[1], MAP_Y_M[1]])
    shape = np.rint((high - low) / MAP_CELL_M).astype(int) + 1
    cells = np.rint((points - low) / MAP_CELL_M).astype(int)
    inside = np.flatnonzero(((cells >= 0) & (cells < shape)).all(axis=1))
    rows, columns = cells[inside].T

    away = np.ones(shape, np.uint8)
    away[rows, columns] = 0
    _, label = cv2.distanceTransformWithLabels(
        away, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    node_of_label = np.zeros(label.max() + 1, np.intp)
    node_of_label[label[rows, columns]] = inside
    return node_of_label[label]


def _look_up(
    nodes: np.ndarray,
    x_m: np.ndarray,
    y_m: np.ndarray,
) -> np.ndarray:
    """Entries of a map of `_nearest_nodes` at points."""
    rows, columns = nodes.shape
    row = (x_m - MAP_X_M[0]) / MAP_CELL_M + 0.5
    column = (y_m - MAP_Y_M[0]) / MAP_CELL_M + 0.5
    row = np.clip(row, 0, rows - 1).astype(np.intp)
    column = np.clip(column, 0, columns - 1).astype(np.intp)
    return nodes.ravel().take(row * columns + column, mode="clip")


# Beyond this distance the ground is less than 2 px below the horizon and is part of the
# backdrop.
MAX_GROUND_M = 800.0
MIN_GROUND_M = 1.0
# Directions out from the camera (tangents), and the distances sampled in each.
TANGENTS = np.linspace(-1.0, 1.0, 81)
DISTANCES_M = np.geomspace(MIN_GROUND_M, MAX_GROUND_M, 420)
# Slopes of rays (rise per metre ahead) in the table; the step is half a pixel of a
# dashcam.
SLOPES = np.arange(-1.0, 0.35, 1 / 2400)
# Longest step of Newton's method, as a share of the distance.
MAX_STEP = 0.02
# After steps shorter than this share of the distance, road coordinates are extrapolated
# and not looked up again.
SHORT_STEP = 1e-4


@dataclass(frozen=True)
class Ground:
    """Ground seen by the pixels below the horizon.

    Arrays of shape (rows, width), float32, metres. The first row is image row `top`.
    Pixels without ground hold points at MAX_GROUND_M, and `visible` is False there. Arc
    lengths `s` count from that of the car, `station_m`; those of `along` from the start
    of the road. The footprint of a pixel in s and d is the parallelogram spanned by one
    step right (`_u`) and one step down (`_v`).
    """

    top: int
    station_m: float
    visible: np.ndarray
    distance: np.ndarray
    x: np.ndarray
    y: np.ndarray
    s: np.ndarray
    d: np.ndarray
    s_u: np.ndarray
    s_v: np.ndarray
    d_u: np.ndarray
    d_v: np.ndarray

    def pixels_between(self, low_m: float, high_m: float) -> np.ndarray:
        """Indices into the raveled arrays of the pixels that overlap a strip.

        The strip is d = low_m..high_m.
        """
        right, left = self._sides
        # OpenCV's stubs miss scalars
        near = cv2.compare(left, float(low_m), cv2.CMP_GE)  # type: ignore[call-overload]
        near &= cv2.compare(right, float(high_m), cv2.CMP_LE)  # type: ignore[call-overload]
        # Masks as bytes, for SIMD; true is 255 in OpenCV and 1 in numpy.
        near &= self.visible.view(np.uint8)
        return np.flatnonzero(near.view(bool))

    def rows(self, cut: slice) -> Ground:
        """Part of the rows (views, no copies)."""
        part = self._map(lambda array: array[cut])
        return replace(part, top=self.top + (cut.start or 0))

    def at(self, pixels: np.ndarray) -> Ground:
        """Ground of which the arrays (K,) hold only some pixels.

        `pixels` (K,) are indices into the raveled arrays.
        """
        return self._map(lambda array: array.ravel()[pixels])

    def _map(self, function: Callable[[np.ndarray], np.ndarray]) -> Ground:
        names = [field.name for field in fields(self)[2:]]
        arrays: dict[str, Any] = {n: function(getattr(self, n)) for n in names}
        return replace(self, **arrays)

    def noise(
        self,
        seed: int,
        wave_m: tuple[float, float],
        *,
        octaves: int = 1,
        fading_m: float = 0.0,
        shift_m: float = 0.0,
    ) -> np.ndarray:
        """`sample_noise` fixed to the road.

        It is averaged over footprints as a wave of length `fading_m` is; 0: not at all.
        Noise of one seed is independent where `shift_m`, which is added to d, differs
        by some wavelengths.
        """
        d = self.d + shift_m
        noise = sample_noise(seed, self.along, d, wave_m, octaves=octaves)
        return noise * fade(self.footprint_s, fading_m) if fading_m else noise

    @cached_property
    def along(self) -> np.ndarray:
        """Arc lengths from the start of the road."""
        return self.s + np.float32(self.station_m)

    @cached_property
    def footprint_s(self) -> np.ndarray:
        """Length of the footprint along the road, metres."""
        return np.abs(self.s_u) + np.abs(self.s_v)

    @cached_property
    def footprint_d(self) -> np.ndarray:
        """Width of the footprint across the road, metres."""
        return np.abs(self.d_u) + np.abs(self.d_v)

    @cached_property
    def _sides(self) -> tuple[np.ndarray, np.ndarray]:
        """Right and left ends of the footprint, cached: every marking needs them."""
        half = self.footprint_d / 2
        return self.d - half, self.d + half


class _Hits(NamedTuple):
    """Fields of `Ground` of the points that rays meet."""

    top: int
    visible: np.ndarray
    x: np.ndarray
    y: np.ndarray
    s: np.ndarray
    d: np.ndarray


@lru_cache(maxsize=2)
def pixel_rays(
    camera: Camera,
    dtype: type = np.float32,
) -> np.ndarray:
    """Ray directions (height, width, 3) of all raw pixels, in camera axes with z = 1.

    They are cached for each lens.
    """
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    rays = camera.rays(np.column_stack([u.ravel(), v.ravel()]))
    return rays.reshape(camera.height, camera.width, 3).astype(dtype)


def cast_on_ground(
    rays: np.ndarray,
    camera: Camera,
    road: RoadAhead,
) -> Ground:
    """Ground that the rays (height, width, 3) of `pixel_rays` meet.

    `camera` has the pitch of this moment.
    """
    pose = camera.require_pose()
    to_road = pose.rotation.astype(np.float32)
    if road.profile.level:
        hits = _cast_on_plane(rays, to_road, pose.height_m, road)
    else:
        hits = _cast_on_relief(rays @ to_road, pose.height_m, road)

    if road.profile.level and not road.winding:
        s_u, s_v = _steps(hits.s)
        d_u, d_v = _steps(hits.d)
    else:
        s_u, s_v, d_u, d_v = _steps_along(road, hits)
    return Ground(
        top=hits.top,
        station_m=road.pose.s_m,
        visible=hits.visible,
        distance=np.sqrt(hits.x * hits.x + hits.y * hits.y),
        x=hits.x,
        y=hits.y,
        s=hits.s,
        d=hits.d,
        s_u=s_u,
        s_v=s_v,
        d_u=d_u,
        d_v=d_v,
    )


def _cast_on_plane(
    rays: np.ndarray,
    to_road: np.ndarray,
    height_m: float,
    road: RoadAhead,
) -> _Hits:
    """Intersection of rays in camera axes with a level road, `height_m` below.

    `to_road` (3, 3) turns them into the road frame.
    """
    least_drop = np.float32(height_m / MAX_GROUND_M)
    drop = -(rays @ to_road[:, 2])
    top = int(np.argmax((drop > least_drop).any(axis=1)))
    rays = rays[top:]
    drop = drop[top:]
    scale = np.float32(height_m) / np.maximum(drop, least_drop)
    x = (rays @ to_road[:, 0]) * scale
    y = (rays @ to_road[:, 1]) * scale
    return _Hits(top, drop > least_drop, x, y, *road.locate(x, y))


def _steps_along(
    road: RoadAhead,
    hits: _Hits,
) -> tuple[np.ndarray, ...]:
    """Footprints s_u, s_v, d_u and d_v, computed from the steps of x and y.

    Between two bends and at crests, s and d jump from pixel to pixel. Such jumps do not
    count as footprint.
    """
    cosine, sine, curvature = road.directions(hits.s)
    stretch = np.maximum(1 - curvature * hits.d, MIN_STRETCH)
    x_u, x_v = _steps(hits.x)
    y_u, y_v = _steps(hits.y)
    s_u = (cosine * x_u + sine * y_u) / stretch
    s_v = (cosine * x_v + sine * y_v) / stretch
    d_u = cosine * y_u - sine * x_u
    d_v = cosine * y_v - sine * x_v
    return s_u, s_v, d_u, d_v


def _steps(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Change per pixel to the right and per pixel down, by central differences."""
    right = np.empty_like(values)
    right[:, 1:-1] = (values[:, 2:] - values[:, :-2]) / 2
    right[:, 0] = right[:, 1]
    right[:, -1] = right[:, -2]

    down = np.empty_like(values)
    down[1:-1] = (values[2:] - values[:-2]) / 2
    down[0] = values[1] - values[0]
    down[-1] = values[-1] - values[-2]
    return right, down


def _cast_on_relief(
    rays: np.ndarray,
    height_m: float,
    road: RoadAhead,
) -> _Hits:
    """First intersection of each ray with the ground.

    Ground at distance x and height h is visible if the slope (h - height_m) / x exceeds
    that of all nearer ground in the same direction. The inverse of the running maximum
    of this slope gives the range of each ray; two steps of Newton's method refine it.
    `rays` (height, width, 3) are directions in the car's road frame, `height_m` is that
    of the camera above the road below it.
    """
    forward = np.maximum(rays[..., 0], 0.05)
    tangent = rays[..., 1] / forward
    slope = rays[..., 2] / forward

    # Look up 1 / x of each ray.
    column = _table_position(TANGENTS, tangent)
    row = _table_position(SLOPES, slope)
    inverse = cv2.remap(
        _inverse_distance_table(height_m, road),
        column,
        row,
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )

    # Rows above the first one with ground are left out.
    visible = inverse > 1 / MAX_GROUND_M
    top = int(np.argmax(visible.any(axis=1)))
    tangent = tangent[top:]
    first_x = 1 / np.maximum(inverse[top:], 1 / MAX_GROUND_M)
    refined = _refine(
        first_x.ravel(), tangent.ravel(), slope[top:].ravel(), height_m, road
    )
    x, s, d = (place.reshape(tangent.shape) for place in refined)
    return _Hits(top, visible[top:], x, x * tangent, s, d)


def _table_position(axis: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Positions of values (float32) on an axis of equal steps, in steps."""
    first, second = axis[:2]
    return (values - np.float32(first)) / np.float32(second - first)


def _inverse_distance_table(height_m: float, road: RoadAhead) -> np.ndarray:
    """Table (slopes, tangents) float32 of 1 / x of the first ground that a ray meets.

    It is 0 for no ground. The table holds 1 / x, because it is linear in the slope over
    level ground.
    """
    distance, tangent = np.meshgrid(DISTANCES_M, TANGENTS)
    x = distance.astype(np.float32)
    s, _ = road.locate(x, x * tangent.astype(np.float32))
    slope = (road.height_above_plane(s.astype(float)) - height_m) / DISTANCES_M
    horizon = np.maximum.accumulate(slope, axis=1)

    inverse = 1 / DISTANCES_M
    columns = [
        np.interp(SLOPES, line, inverse, left=inverse[0], right=0.0) for line in horizon
    ]
    return np.column_stack(columns).astype(np.float32)


def _refine(
    x: np.ndarray,
    tangent: np.ndarray,
    slope: np.ndarray,
    height_m: float,
    road: RoadAhead,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (x, s, d) after two steps of Newton's method from x (N,).

    Steps are limited to the step of the table, and skipped where a ray grazes the
    ground.
    """
    s, d = road.locate(x, x * tangent)
    for _ in range(2):
        # Height of the ray above the ground, and its change per metre.
        ground_height, grade = road.height_and_grade(s)
        above = np.float32(height_m) + slope * x - ground_height
        cosine, sine, curvature = road.directions(s)
        along = cosine + sine * tangent
        falling = slope - grade * along

        step = -above / np.minimum(falling, -1e-3)
        step = np.clip(step, -MAX_STEP * x, MAX_STEP * x) * (falling < -1e-3)
        x = x + step

        # Nearly all steps are short enough to extrapolate s and d linearly.
        s += step * along / np.maximum(1 - curvature * d, MIN_STRETCH)
        d += step * (cosine * tangent - sine)
        far = np.flatnonzero(np.abs(step) > SHORT_STEP * x)
        s[far], d[far] = road.locate(x[far], x[far] * tangent[far])
    return x, s, d


def edge_coverage(
    t: np.ndarray,
    step_u: np.ndarray,
    step_v: np.ndarray,
) -> np.ndarray:
    """Share of a square pixel on the positive side of a straight edge; exact.

    `t` is the signed distance of the pixel's centre from the edge in any unit; `step_u`
    and `step_v` are its changes per pixel to the right and down. Within a pixel, t is
    distributed as the sum of two uniform variables of widths |step_u| and |step_v|, a
    trapezoid. Its integral is a difference of four one-sided parabolas.
    """
    a = np.maximum(np.abs(step_u), 1e-6)
    b = np.maximum(np.abs(step_v), 1e-3 * a)
    a = np.maximum(a, 1e-3 * b)
    outer = (a + b) / 2
    inner = (a - b) / 2
    # Clipping first keeps the differences of small numbers exact in float32.
    t = np.clip(t, -outer, outer)
    area = (t + outer) ** 2
    area = area - np.maximum(t + inner, 0) ** 2
    area = area - np.maximum(t - inner, 0) ** 2
    return area / (a * 2 * b)


def strip_coverage(
    d: np.ndarray,
    step_u: np.ndarray,
    step_v: np.ndarray,
    low: float,
    high: float,
) -> np.ndarray:
    """Share of each pixel between the edges d = `low` and d = `high`."""
    beyond_low = edge_coverage(d - np.float32(low), step_u, step_v)
    beyond_high = edge_coverage(d - np.float32(high), step_u, step_v)
    return beyond_low - beyond_high


def dash_coverage(
    s: np.ndarray,
    footprint: np.ndarray,
    paint_m: float,
    period_m: float,
) -> np.ndarray:
    """Share of [s - footprint/2, s + footprint/2] that is painted.

    Dashes begin at multiples of the period.
    """
    footprint = np.maximum(footprint, 1e-4)
    start = _painted_until(s - footprint / 2, paint_m, period_m)
    end = _painted_until(s + footprint / 2, paint_m, period_m)
    return np.clip((end - start) / footprint, 0, 1)


def _painted_until(
    s: np.ndarray,
    paint_m: float,
    period_m: float,
) -> np.ndarray:
    """Length of paint between 0 and s."""
    paint = np.float32(paint_m)
    period = np.float32(period_m)
    whole = np.floor(s / period)
    rest = s - whole * period
    return whole * paint + np.minimum(rest, paint)
