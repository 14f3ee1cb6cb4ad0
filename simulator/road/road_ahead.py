"""Fast conversion of ground points in the car's frame to road coordinates."""

from __future__ import annotations

from functools import cached_property

import cv2
import numpy as np

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
        angle = road.heading(pose.s_m + s) - pose.absolute_heading(road)
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
