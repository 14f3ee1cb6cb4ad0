"""Road coordinates of ground points, and the ground seen by each pixel with the footprint of the pixel on it.

On a road with a vertical profile the rays are cast onto the relief, where crests hide the ground behind them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from typing import Any

import cv2
import numpy as np

from lanes.camera.model import Camera
from simulator.painting import fade, sample_noise
from simulator.road.geometry import MAX_TURN_RAD, RoadGeometry, VehiclePose

# A road with curvature above this is winding: mountain roads are, motorways and country roads are not.
WINDING_PER_M = 1 / 120
# Range of the tables.
BEHIND_M, AHEAD_M = 40.0, 900.0
# Length of a winding road that is drawn; the rest is behind trees.
WINDING_AHEAD_M = 220.0
# Range of the search for crests, and the smallest slope (2 pixels of a dashcam) that a crest must hide.
CREST_RANGE_M, MIN_HIDDEN_SLOPE = 200.0, 0.002
# Extent and cell size, in the car's frame, of the nearest-node map of a winding road.
MAP_X_M, MAP_Y_M, MAP_CELL_M = (-40.0, 160.0), (-120.0, 120.0), 0.5


class RoadAhead:
    """Tables of the road in the car's frame, for road coordinates (s, d) of many ground points (float32).

    Arc lengths are relative to `pose.s_m`, which keeps float32 exact to 0.1 mm. Unless the road is `winding`, the
    tables end where it has turned by 80 degrees, because one x has two points on the road beyond that.

    Attributes
    ----------
    winding : bool
        Whether the road turns by more than 80 degrees in sharp bends. A ground point is then assigned to the nearest
        point of the road, by a map.
    """

    STEP_M = 0.5

    def __init__(self, road: RoadGeometry, pose: VehiclePose) -> None:
        s = np.arange(-BEHIND_M, AHEAD_M + self.STEP_M, self.STEP_M)
        angle = pose.turn_to(road, pose.s_m + s)
        turned = np.flatnonzero((np.abs(angle) > MAX_TURN_RAD) & (s > 0))
        sharpest = np.abs(road.curvature(pose.s_m + s[s < WINDING_AHEAD_M])).max()
        self.winding = bool(len(turned)) and sharpest > WINDING_PER_M
        end = int(np.argmax(s > WINDING_AHEAD_M)) if self.winding else turned[0] if len(turned) else len(s)
        s, angle = s[:end], angle[:end]
        points = pose.to_car(road, road.position(pose.s_m + s))
        table = (points[:, 0], points[:, 1], np.cos(angle), np.sin(angle), road.curvature(pose.s_m + s))
        self.profile = road.profile
        self.pose = pose
        self._s0 = np.float32(s[0])
        self._table = [column.astype(np.float32) for column in table]
        if self.winding:
            self._map = _nearest_nodes(points)
        else:
            # First guess: the point of the road at the same x, tabulated at steps of x.
            self._x0 = np.float32(points[0, 0])
            x = np.arange(points[0, 0], points[-1, 0], self.STEP_M)
            self._guess = np.rint((np.interp(x, points[:, 0], s) - s[0]) / self.STEP_M).astype(np.intp)

    def locate(self, x_m: np.ndarray, y_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Road coordinates (s, d) of ground points (x forward, y left) in the car's frame: float32, metres, any shape.

        s counts from the car's arc length, d to the left of the reference line. Each iteration projects the point onto
        the osculating circle at the nearest table node. The error is the change of curvature within half a table step.
        Three iterations are enough for points within 50 m of the reference line and radii above 50 m.
        """
        x, y = x_m.ravel(), y_m.ravel()
        node = first = self._first_node(x, y)
        s, d = self._project(x, y, node)
        for _ in range(2):
            nearest = self._nearest_node(s)
            if self.winding:
                # The map is exact to some nodes. A longer step could lead to another bend.
                nearest = np.clip(nearest, first - 4, first + 4)
            # Most points are at the right node already.
            moved = np.flatnonzero(nearest != node)
            node = nearest
            s[moved], d[moved] = self._project(x[moved], y[moved], node[moved])
        return (s + self._s0).reshape(x_m.shape), d.reshape(x_m.shape)

    def _project(self, x_m: np.ndarray, y_m: np.ndarray, node: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates (s from the table's start, d) of points (N,), by the osculating circles at nodes (N,)."""
        # All nodes are in the table; mode="clip" saves numpy the bounds check.
        px, py, cosine, sine, curvature = (column.take(node, mode="clip") for column in self._table)
        dx, dy = x_m - px, y_m - py
        along, across = cosine * dx + sine * dy, cosine * dy - sine * dx
        ahead = along / np.maximum(1 - curvature * across, np.float32(0.2))
        return node.astype(np.float32) * np.float32(self.STEP_M) + ahead, across - curvature * along * ahead / 2

    def _nearest_node(self, s: np.ndarray) -> np.ndarray:
        """Nearest table nodes of arc lengths relative to the table's start."""
        steps = s / np.float32(self.STEP_M)
        return np.clip(np.rint(steps, out=steps), 0, len(self._table[0]) - 1, out=steps).astype(np.intp)

    def directions(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Cosine and sine of the road's heading in the car's frame, and its curvature, `s` metres from the car."""
        node = np.clip((s - self._s0) / np.float32(self.STEP_M), 0, len(self._table[0]) - 1).astype(np.intp)
        return tuple(column.take(node, mode="clip") for column in self._table[2:])

    def height_above_plane(self, s: np.ndarray) -> np.ndarray:
        """Height in metres of the ground, `s` metres from the car, above the plane that touches the road below it."""
        return self.profile.height_above_plane(s + self.pose.s_m, self.pose.s_m)

    def height_and_grade(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """`height_above_plane` for many points (float32), and the slope there minus the slope below the car.

        Extrapolated from the nearest table node, at most 0.25 m away: 0.2 mm of error at a vertical radius of 150 m.
        """
        node = self._nearest_node(s - self._s0)
        height, grade = (column.take(node, mode="clip") for column in self._heights)
        return height + grade * (s - self._s0 - node.astype(np.float32) * np.float32(self.STEP_M)), grade

    @cached_property
    def _heights(self) -> tuple[np.ndarray, np.ndarray]:
        """Height above the plane, and relative slope, at the table's nodes."""
        s = self.pose.s_m + float(self._s0) + self.STEP_M * np.arange(len(self._table[0]))
        grade = self.profile.value(s) - self.profile.value(self.pose.s_m)
        return self.profile.height_above_plane(s, self.pose.s_m).astype(np.float32), grade.astype(np.float32)

    def crest_distance_m(self, height_m: float) -> float:
        """Distance in metres of the first crest that hides road from an eye `height_m` above it; infinite if none."""
        s = np.arange(2.0, CREST_RANGE_M)
        slope = (self.height_above_plane(s) - height_m) / s
        hidden = slope < np.maximum.accumulate(slope) - MIN_HIDDEN_SLOPE
        return float(s[np.argmax(hidden)]) if hidden.any() else np.inf

    def lift_to_surface(self, points_m: np.ndarray) -> np.ndarray:
        """Points (N, 3) of the ground at points (N, 2) of the car's plane, metres."""
        s, _ = self.locate(*np.asarray(points_m, np.float32).T)
        return np.column_stack([points_m, self.height_above_plane(s.astype(float))])

    def _first_node(self, x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
        """Initial table nodes near the points."""
        if self.winding:
            return _look_up(self._map, x_m, y_m)
        index = np.clip((x_m - self._x0) / np.float32(self.STEP_M), 0, len(self._guess) - 1).astype(np.intp)
        return self._guess.take(index, mode="clip")


def _nearest_nodes(points: np.ndarray) -> np.ndarray:
    """Map (rows of x, columns of y) of the index of the nearest of the points (N, 2), in cells of MAP_CELL_M."""
    shape = tuple(round((high - low) / MAP_CELL_M) + 1 for low, high in (MAP_X_M, MAP_Y_M))
    cells = np.rint((points - [MAP_X_M[0], MAP_Y_M[0]]) / MAP_CELL_M).astype(int)
    inside = np.flatnonzero(((cells >= 0) & (cells < shape)).all(axis=1))
    away = np.ones(shape, np.uint8)
    away[tuple(cells[inside].T)] = 0
    _, label = cv2.distanceTransformWithLabels(away, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    node_of_label = np.zeros(label.max() + 1, np.intp)
    node_of_label[label[tuple(cells[inside].T)]] = inside
    return node_of_label[label]


def _look_up(nodes: np.ndarray, x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
    row, column = (
        np.clip((v - np.float32(low)) / np.float32(MAP_CELL_M) + np.float32(0.5), 0, size - 1).astype(np.intp)
        for v, low, size in zip((x_m, y_m), (MAP_X_M[0], MAP_Y_M[0]), nodes.shape, strict=True)
    )
    return nodes.ravel().take(row * nodes.shape[1] + column, mode="clip")


# Beyond this distance the ground is less than 2 px below the horizon and is part of the backdrop.
MAX_GROUND_M = 800.0
MIN_GROUND_M = 1.0
# Directions out from the camera (tangents), and the distances sampled in each.
TANGENTS = np.linspace(-1.0, 1.0, 81)
DISTANCES_M = np.geomspace(MIN_GROUND_M, MAX_GROUND_M, 420)
# Slopes of rays (rise per metre ahead) in the table; the step is half a pixel of a dashcam.
SLOPES = np.arange(-1.0, 0.35, 1 / 2400)
# After steps shorter than this share of the distance, road coordinates are extrapolated and not looked up again.
SHORT_STEP = 1e-4


@dataclass(frozen=True)
class Ground:
    """Ground seen by the pixels below the horizon: arrays of shape (rows, width), float32, metres.

    The first row is image row `top`. Pixels without ground hold points at MAX_GROUND_M, and `visible` is False there.
    Arc lengths `s` count from that of the car, `station_m`; those of `along` from the start of the road. The footprint
    of a pixel in s and d is the parallelogram spanned by one step right (`_u`) and one step down (`_v`).
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
        """Indices into the raveled arrays of the pixels that overlap the strip d = low_m..high_m."""
        right, left = self._sides
        # OpenCV's stubs miss scalars
        near = cv2.compare(left, float(low_m), cv2.CMP_GE)  # type: ignore[call-overload]
        near &= cv2.compare(right, float(high_m), cv2.CMP_LE)  # type: ignore[call-overload]
        # Masks as bytes, for SIMD; true is 255 in OpenCV and 1 in numpy.
        near &= self.visible.view(np.uint8)
        return np.flatnonzero(near.view(bool))

    def rows(self, cut: slice) -> Ground:
        """Part of the rows (views, no copies)."""
        return replace(self._map(lambda array: array[cut]), top=self.top + (cut.start or 0))

    def at(self, pixels: np.ndarray) -> Ground:
        """Ground of which the arrays (K,) hold only the pixels at these indices into the raveled arrays."""
        return self._map(lambda array: array.ravel()[pixels])

    def _map(self, function: Callable[[np.ndarray], np.ndarray]) -> Ground:
        arrays: dict[str, Any] = {f.name: function(getattr(self, f.name)) for f in fields(self)[2:]}
        return replace(self, **arrays)

    def noise(
        self, seed: int, wave_m: tuple[float, float], *, octaves: int = 1, fading_m: float = 0.0, shift_m: float = 0.0
    ) -> np.ndarray:
        """`sample_noise` fixed to the road, averaged over footprints as a wave of length `fading_m` is; 0: not at all.

        Noise of one seed is independent where `shift_m`, which is added to d, differs by some wavelengths.
        """
        noise = sample_noise(seed, self.along, self.d + np.float32(shift_m), wave_m, octaves=octaves)
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
        """Right and left ends of the footprint, cached because every marking needs them."""
        return self.d - self.footprint_d / 2, self.d + self.footprint_d / 2


@lru_cache(maxsize=2)
def pixel_rays(camera: Camera, dtype: type = np.float32) -> np.ndarray:
    """Ray directions (height, width, 3) of all raw pixels, in camera axes with z = 1; cached for each lens."""
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    rays = camera.rays(np.column_stack([u.ravel(), v.ravel()]))
    return rays.reshape(camera.height, camera.width, 3).astype(dtype)


def cast_on_ground(rays: np.ndarray, camera: Camera, road: RoadAhead) -> Ground:
    """Ground that the rays (height, width, 3) of `pixel_rays` meet; `camera` has the pitch of this moment."""
    pose = camera.require_pose()
    to_road = pose.rotation.astype(np.float32)
    if road.profile.level:
        least_drop = np.float32(pose.height_m / MAX_GROUND_M)
        drop = -(rays @ to_road[:, 2])
        top = int(np.argmax((drop > least_drop).any(axis=1)))
        rays, drop = rays[top:], drop[top:]
        visible = drop > least_drop
        scale = np.float32(pose.height_m) / np.maximum(drop, least_drop)
        x, y = (rays @ to_road[:, 0]) * scale, (rays @ to_road[:, 1]) * scale
        s, d = road.locate(x, y)
    else:
        top, visible, x, y, s, d = cast_on_relief(rays @ to_road, pose.height_m, road)
    smooth = road.profile.level and not road.winding
    steps = (*_steps(s), *_steps(d)) if smooth else _steps_along(road, s, d, x, y)
    return Ground(top, road.pose.s_m, visible, np.sqrt(x * x + y * y), x, y, s, d, *steps)


def _steps_along(road: RoadAhead, s: np.ndarray, d: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple:
    """Changes of s and d per pixel to the right and down, computed from those of x and y.

    Between two bends and at crests, s and d jump from pixel to pixel. Such jumps do not count as footprint.
    """
    cosine, sine, curvature = road.directions(s)
    stretch = np.maximum(1 - curvature * d, np.float32(0.2))
    (x_u, x_v), (y_u, y_v) = _steps(x), _steps(y)
    along = [(cosine * a + sine * b) / stretch for a, b in ((x_u, y_u), (x_v, y_v))]
    across = [cosine * b - sine * a for a, b in ((x_u, y_u), (x_v, y_v))]
    return (*along, *across)


def _steps(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Change per pixel to the right and per pixel down, by central differences."""
    right, down = np.empty_like(values), np.empty_like(values)
    right[:, 1:-1] = (values[:, 2:] - values[:, :-2]) / 2
    right[:, 0], right[:, -1] = right[:, 1], right[:, -2]
    down[1:-1] = (values[2:] - values[:-2]) / 2
    down[0], down[-1] = values[1] - values[0], values[-1] - values[-2]
    return right, down


def cast_on_relief(
    rays: np.ndarray, height_m: float, road: RoadAhead
) -> tuple[int, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """First intersection of each ray with the ground.

    Ground at distance x and height h is visible if the slope (h - height_m) / x exceeds that of all nearer ground in
    the same direction. The inverse of the running maximum of this slope gives the range of each ray; two steps of
    Newton's method refine it. `rays` (height, width, 3) are directions in the car's road frame, `height_m` is that of
    the camera above the road below it. Returns the fields of `Ground` top, visible, x, y, s and d.
    """
    inverse = _inverse_distance_table(height_m, road)
    forward = np.maximum(rays[..., 0], np.float32(0.05))
    tangent, slope = rays[..., 1] / forward, rays[..., 2] / forward
    column = (tangent - np.float32(TANGENTS[0])) / np.float32(TANGENTS[1] - TANGENTS[0])
    row = (slope - np.float32(SLOPES[0])) / np.float32(SLOPES[1] - SLOPES[0])
    seen = cv2.remap(inverse, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    visible = seen > np.float32(1 / MAX_GROUND_M)
    top = int(np.argmax(visible.any(axis=1)))
    visible, tangent, slope = visible[top:], tangent[top:], slope[top:]
    x = 1 / np.maximum(seen[top:], np.float32(1 / MAX_GROUND_M))
    places = _refine(x.ravel(), tangent.ravel(), slope.ravel(), height_m, road)
    x, s, d = (place.reshape(tangent.shape) for place in places)
    return top, visible, x, x * tangent, s, d


def _inverse_distance_table(height_m: float, road: RoadAhead) -> np.ndarray:
    """Table (slopes, tangents) float32 of 1 / x of the first ground that a ray meets; 0 for no ground.

    The table holds 1 / x, because it is linear in the slope over level ground.
    """
    x, tangent = (a.astype(np.float32) for a in np.meshgrid(DISTANCES_M, TANGENTS))
    s, _ = road.locate(x, x * tangent)
    horizon = np.maximum.accumulate((road.height_above_plane(s.astype(float)) - height_m) / DISTANCES_M, axis=1)
    inverse = 1 / DISTANCES_M
    columns = [np.interp(SLOPES, line, inverse, left=inverse[0], right=0.0) for line in horizon]
    return np.column_stack(columns).astype(np.float32)


def _refine(
    x: np.ndarray, tangent: np.ndarray, slope: np.ndarray, height_m: float, road: RoadAhead
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (x, s, d) after two steps of Newton's method from x (N,).

    Steps are limited to the step of the table, and skipped where a ray grazes the ground.
    """
    s, d = road.locate(x, x * tangent)
    for _ in range(2):
        height_above_plane, grade = road.height_and_grade(s)
        above = np.float32(height_m) + slope * x - height_above_plane
        cosine, sine, curvature = road.directions(s)
        along = cosine + sine * tangent
        falling = slope - grade * along
        step = -above / np.minimum(falling, np.float32(-1e-3))
        step = np.clip(step, np.float32(-0.02) * x, np.float32(0.02) * x) * (falling < -1e-3)
        x = x + step
        # Nearly all steps are short enough to extrapolate s and d linearly.
        s += step * along / np.maximum(1 - curvature * d, np.float32(0.2))
        d += step * (cosine * tangent - sine)
        far = np.flatnonzero(np.abs(step) > np.float32(SHORT_STEP) * x)
        s[far], d[far] = road.locate(x[far], x[far] * tangent[far])
    return x, s, d


def edge_coverage(t: np.ndarray, step_u: np.ndarray, step_v: np.ndarray) -> np.ndarray:
    """Share of a square pixel on the positive side of a straight edge; exact.

    `t` is the signed distance of the pixel's centre from the edge in any unit, (2, ...) for two parallel edges;
    `step_u` and `step_v` are its changes per pixel to the right and down. Within a pixel, t is distributed as the sum
    of two uniform variables of widths |step_u| and |step_v|, a trapezoid. Its integral is a difference of four one-
    sided parabolas.
    """
    a = np.maximum(np.abs(step_u), np.float32(1e-6))
    b = np.maximum(np.abs(step_v), np.float32(1e-3) * a)
    a = np.maximum(a, np.float32(1e-3) * b)
    outer, inner = (a + b) / 2, (a - b) / 2
    # Clipping first keeps the differences of small numbers exact in float32.
    t = np.clip(t, -outer, outer)
    area = (t + outer) ** 2 - np.maximum(t + inner, 0) ** 2 - np.maximum(t - inner, 0) ** 2
    return area / (a * 2 * b)


def strip_coverage(d: np.ndarray, step_u: np.ndarray, step_v: np.ndarray, low: float, high: float) -> np.ndarray:
    """Share of each pixel between the edges d = `low` and d = `high`."""
    edges = np.array([low, high], np.float32).reshape(2, *[1] * d.ndim)
    beyond_low, beyond_high = edge_coverage(d - edges, step_u, step_v)
    return beyond_low - beyond_high


def dash_coverage(s: np.ndarray, footprint: np.ndarray, paint_m: float, period_m: float) -> np.ndarray:
    """Share of [s - footprint/2, s + footprint/2] that is painted; dashes begin at multiples of the period."""
    footprint = np.maximum(footprint, np.float32(1e-4))
    start, end = (_painted_until(s + half, paint_m, period_m) for half in (-footprint / 2, footprint / 2))
    return np.clip((end - start) / footprint, 0, 1)


def _painted_until(s: np.ndarray, paint_m: float, period_m: float) -> np.ndarray:
    """Length of paint between 0 and s."""
    whole = np.floor(s / np.float32(period_m))
    rest = s - whole * np.float32(period_m)
    return whole * np.float32(paint_m) + np.minimum(rest, np.float32(paint_m))
