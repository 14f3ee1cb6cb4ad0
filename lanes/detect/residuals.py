"""Residuals: distances of stripes from the lines of lanes, with their derivatives by
the lanes' parameters.

The path that passes the car parallel to the lane is tabulated at nodes, and near a node
it is an arc. The distance `a` of a point from an arc, at right angles, needs no
function y(x). Hairpins that fold back need no special case:

    a (1 - k a / 2) = y - k (x^2 + y^2) / 2        for an arc of curvature k that begins
    along the x axis,

which follows from ``|P - C| = 1/k - a`` for a circle of centre C. Parallel lines differ
in `a` alone. Points of the plane are complex numbers x + iy: a product with a unit
vector turns them.

The stripes come from the flat grid of the view. They are first moved along their rays
onto the lane's own road, which is pitched and curved vertically.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from lanes.detect.evidence import Stripes
from lanes.detect.road import (
    ADJACENT,
    BEND,
    BENDS_AT_NODES,
    CENTRE,
    FAR_LINE,
    HEADING,
    NODE_GAPS_M,
    NODES_M,
    PARAMETERS,
    PITCH,
    RATE,
    RATE_STEPS,
    SIDES,
    VERTICAL_CURVATURE,
    WIDTH,
    Path,
    height_and_grade,
    path_at_nodes,
)

# Distances of the lookup table for intersections of rays with the road, farthest first;
# the error is below a millimetre of height.
ROAD_M = np.geomspace(350.0, 2.0, 160)
# Lower bound for |1 - k a|: near the centre of the arc a point has no side.
MIN_SCALE = 0.1
# Lateral movement of a stripe from row to row, in columns, that doubles the standard
# deviation of its direction. At twice as many columns the direction carries almost no
# information.
BLIND_COLUMNS = 8.0
# Lower bound for the cosine of the direction of a line that runs across.
MIN_COSINE = 0.05
_NODE_BORDERS_M = (NODES_M[1:] + NODES_M[:-1]) / 2
_INVERSE_ROAD_M = 1 / ROAD_M
_ROAD_HEIGHTS = height_and_grade(ROAD_M)[0]


class Ground(NamedTuple):
    """Intersections of rays with the roads of lanes (..., 15)."""

    # (..., N) distance ahead, and how fast the ray approaches the road there, metres of
    # height per metre ahead.
    x_m: np.ndarray
    fall: np.ndarray
    # (..., N, 4) height of the road there per unit of each vertical curvature.
    heights: np.ndarray


class PathCoordinates(NamedTuple):
    """Points relative to the paths of lanes (K, 15), (K, N) each."""

    # Distance to the left of the path, at right angles; arc length, direction and
    # tangent of the path there.
    a: np.ndarray
    along_m: np.ndarray
    direction: np.ndarray
    tangent: np.ndarray


def intersect_ground(x_m: np.ndarray, lanes: np.ndarray, height_m: float) -> Ground:
    """Intersections of rays with the roads of lanes (..., 15).

    The rays are given by their distances x (N,) on a flat road. The ray to the flat
    distance x falls by h / x per metre. With additional camera pitch it falls by h / x
    + pitch, and it meets the road of height z where z + (h / x + pitch) X = h. For a
    flat road 1/X is linear in 1/x, for others nearly so; it is interpolated in a table.
    """
    lanes = np.asarray(lanes)
    vertical = lanes[..., VERTICAL_CURVATURE]
    ray_fall = height_m / x_m + lanes[..., PITCH, None]

    # road that is lower in the image than nearer road is hidden behind it
    road_heights = vertical @ _ROAD_HEIGHTS.T
    falls = _INVERSE_ROAD_M * (height_m - road_heights)
    falls = np.minimum.accumulate(falls[..., ::-1], axis=-1)[..., ::-1]
    inverse_x = np.empty(ray_fall.shape)
    for index in np.ndindex(ray_fall.shape[:-1]):
        inverse_x[index] = np.interp(ray_fall[index], falls[index], _INVERSE_ROAD_M)

    x = 1 / inverse_x
    heights, grades = height_and_grade(x)
    grade = (grades * vertical[..., None, :]).sum(axis=-1)
    # at least a fifth of the fall towards a flat road, for rays that graze a crest
    least_fall = 0.2 * height_m * inverse_x
    return Ground(x, np.maximum(ray_fall + grade, least_fall), heights)


def flatten(
    x_m: np.ndarray,
    y_m: np.ndarray,
    angle: np.ndarray,
    ground: Ground,
    height_m: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stripes of the flat view on the ground: x, y in metres and angle in radians.

    All are (..., N).
    """
    scale = ground.x_m / x_m
    # derivative of the distance on the ground with respect to that on the flat view
    stretch = scale * height_m / (x_m * ground.fall)
    slope = (scale * np.tan(angle) + (stretch - scale) * y_m / x_m) / stretch
    return ground.x_m, y_m * scale, np.arctan(slope)


@dataclass(frozen=True, eq=False)
class StripeResiduals:
    """Residuals of stripes with respect to lanes (K, 15)."""

    # (K, stripes) distance to the left of the nearest line, and that line: `LEFT_SIDE`
    # or `RIGHT_SIDE`, or `FAR_LINE` times that for the far lines of adjacent lanes.
    residual_m: np.ndarray
    side: np.ndarray
    # (K, stripes) direction of that line minus direction of the stripe, positive left,
    # and its standard deviation.
    angle_residual_rad: np.ndarray
    angle_std_rad: np.ndarray
    # The lanes' paths, and the stripes' positions on the ground (x + iy) and relative
    # to the paths.
    path: Path
    ground: Ground
    points: np.ndarray
    coordinates: PathCoordinates

    def moved(self, steps: np.ndarray, jacobian: np.ndarray) -> StripeResiduals:
        """The residuals after small steps (K, 15) of the lanes, linearised.

        `jacobian` is that at the lanes before the steps. Directions stay.
        """
        change_m = (steps[:, None] @ jacobian)[:, 0]
        return replace(self, residual_m=self.residual_m + change_m)

    def jacobian(self) -> np.ndarray:
        """(K, 15, stripes) derivative of `residual_m` by each parameter."""
        count, stripes = self.points.shape
        jacobian = np.empty((count, PARAMETERS, stripes))
        jacobian[:, CENTRE] = -1
        jacobian[:, WIDTH] = self.side / -2

        gradients = distance_gradients(self.path, self.coordinates.along_m)
        by_bend = gradients.swapaxes(0, 1)
        jacobian[:, HEADING : RATE + 1] = by_bend[:, :3]
        jacobian[:, RATE_STEPS] = by_bend[:, 3:]

        # a stripe moves along its ray by X / fall per radian of pitch; height / X is
        # taken as 1
        across = (self.points.conj() * self.coordinates.tangent).imag
        by_pitch = across / self.ground.fall
        heights = self.ground.heights.swapaxes(1, 2)
        jacobian[:, PITCH] = by_pitch
        jacobian[:, VERTICAL_CURVATURE] = (
            heights * (by_pitch / self.ground.x_m)[:, None]
        )

        on_far_line = self.side[:, None] == FAR_LINE * SIDES[:, None]
        jacobian[:, ADJACENT] = on_far_line * -SIDES[:, None]
        return jacobian

    def weights(self, std_m: np.ndarray, *, angle_scale: float = 1.0) -> np.ndarray:
        """(K, stripes) weights 0 to 1 by residual and by angle residual.

        Each is after Geman and McClure (1987). `std_m` (stripes,) is the standard
        deviation of the residuals; that of the directions is multiplied by
        `angle_scale`.
        """
        angle_std = angle_scale * self.angle_std_rad
        by_distance = 1 + (self.residual_m / std_m) ** 2
        by_angle = 1 + (self.angle_residual_rad / angle_std) ** 2
        q = by_distance * by_angle
        return 1 / (q * q)


def path_coordinates(
    lanes: np.ndarray, points: np.ndarray
) -> tuple[Path, PathCoordinates]:
    """The paths of lanes (K, 15) as far as points reach, and the points relative to
    them.

    The points (K, N) are complex numbers x + iy, metres.
    """
    # first guess of the arc length: the distance from a place 20 m behind the car
    along = np.abs(points + 20) - 20
    # half a circle is 1.6 times as long as its diameter
    farthest = 1.6 * along.max(initial=0.0)
    count = int(np.searchsorted(NODES_M[:-2], farthest)) + 2
    path = path_at_nodes(lanes, count)
    backwards = path.tangents.conj()
    curvatures = path.curvatures + 1e-12  # avoids division by zero

    for _ in range(2):
        # the points in the frame of the nearest node
        nearest = np.searchsorted(_NODE_BORDERS_M[: count - 1], along)
        node = _in_table(nearest, count)
        curvature = curvatures.take(node)
        on_arc = (points - path.points.take(node)) * backwards.take(node)

        # distance from the arc, and the angle along it
        turned = 1 + 1j * curvature * on_arc
        scale = np.maximum(np.abs(turned), MIN_SCALE)  # |1 - k a|
        square = on_arc.real**2 + on_arc.imag**2
        a = (2 * on_arc.imag - curvature * square) / (1 + scale)
        turned /= scale
        turn = np.angle(turned)
        ahead = turn / curvature
        along = NODES_M[nearest] + ahead
        # the path is an arc to within millimetres so near a node; roads that bend
        # little need one step
        if np.abs(ahead).max(initial=0.0) < 1.5:
            break

    direction = path.directions.take(node) + turn
    tangent = path.tangents.take(node) * turned
    return path, PathCoordinates(a, along, direction, tangent)


def distance_gradients(path: Path, along_m: np.ndarray) -> np.ndarray:
    """(6, K, N) derivatives of points' distances to the left of paths.

    They are by the parameters `BEND`; `along_m` (K, N) are the points' arc lengths. The
    path moves sideways by the integral of the changes of its direction.
    """
    count = path.points.shape[1]
    changes = BENDS_AT_NODES[0, :, None, :count] * path.tangents
    half_gaps_m = NODE_GAPS_M[: count - 1] / 2
    pieces = (changes[..., 1:] + changes[..., :-1]) * half_gaps_m
    moved = np.zeros_like(changes)
    np.cumsum(pieces, axis=-1, out=moved[..., 1:])
    sideways = (moved * path.tangents.conj()).real
    at_nodes = sideways.reshape(len(BEND), -1)

    # interpolated between the nodes before and behind the points
    nearest = np.searchsorted(NODES_M[1 : count - 1], along_m)
    share = (along_m - NODES_M[nearest]) / NODE_GAPS_M[nearest]
    node = _in_table(nearest, count)
    before = at_nodes.take(node, axis=1)
    behind = at_nodes.take(node + 1, axis=1)
    return (before - behind) * share - before


def _in_table(node: np.ndarray, count: int) -> np.ndarray:
    """Indices of nodes (K, N) of K paths in a flat table with `count` nodes a path."""
    first_of_path = np.arange(0, count * len(node), count)
    return node + first_of_path[:, None]


def stripe_residuals(
    lanes: np.ndarray, stripes: Stripes, height_m: float
) -> StripeResiduals:
    """Residuals of stripes with respect to lanes (K, 15).

    The camera is `height_m` above the road.
    """
    ground = intersect_ground(stripes.x_m, lanes, height_m)
    x, y, angle = flatten(stripes.x_m, stripes.y_m, stripes.angle, ground, height_m)
    points = x + 1j * y
    path, coordinates = path_coordinates(lanes, points)

    # beyond the middle of an adjacent lane the nearest line is its far line
    width = lanes[:, WIDTH, None]
    from_centre = coordinates.a - lanes[:, CENTRE, None]
    far = np.abs(from_centre) > width
    side = np.copysign(np.where(far, FAR_LINE, 1.0), from_centre)
    extra_widths = lanes[:, ADJACENT]
    extra_width = far * np.where(side > 0, extra_widths[:, :1], -extra_widths[:, 1:])
    residual = from_centre - side * (width / 2) - extra_width

    # columns per row that a stripe in the direction of the line moves sideways
    tangent = coordinates.tangent
    cosine = np.maximum(tangent.real, MIN_COSINE)
    columns = stripes.step * np.abs(tangent.imag) / cosine
    steepness = np.square(columns / BLIND_COLUMNS)
    angle_std = stripes.angle_std_rad * (1 + steepness * steepness * steepness)

    return StripeResiduals(
        residual_m=residual,
        side=side,
        angle_residual_rad=coordinates.direction - angle,
        angle_std_rad=angle_std,
        path=path,
        ground=ground,
        points=points,
        coordinates=coordinates,
    )
