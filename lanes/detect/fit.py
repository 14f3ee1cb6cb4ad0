"""Robust fit of both lines of a lane to the stripes: the one estimator of a search and of the tracker.

Iteratively reweighted least squares: each stripe belongs to the nearest line, with a weight that grows with its
strength and falls with its distance (Geman-McClure) and with the difference of the directions. A search begins near the
car and extends outwards step by step, so that it stays on lines that bend. The prior is that of roads, or the tracker's
prediction. Because of it one line or a few dashes are sufficient.

The residuals are the distances of the stripes from the lines, with their derivatives by the lane's parameters. The path
that passes the car parallel to the lane is tabulated at nodes, and near a node it is an arc. The distance `a` of a
point from an arc, at right angles, needs no function y(x). Hairpins that fold back need no special case:

    a (1 - k a / 2) = y - k (x^2 + y^2) / 2        for an arc of curvature k that begins along the x axis,

which follows from ``|P - C| = 1/k - a`` for a circle of centre C. Parallel lines differ in `a` alone. Points of the
plane are complex numbers x + iy: a product with a unit vector turns them.

The stripes come from the flat grid of the view. They are first moved along their rays onto the lane's own road, which
is pitched and curved vertically.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.evidence import PAINT, Stripes
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
    RoadPrior,
    height_and_grade,
    is_ego_lane,
    lines_on_view,
    path_at_nodes,
)

# Distances of the lookup table for intersections of rays with the road, farthest first; the error is below a
# millimetre of height.
ROAD_M = np.geomspace(350.0, 2.0, 160)
# Lower bound for |1 - k a|: near the centre of the arc a point has no side.
MIN_SCALE = 0.1
# Lateral movement of a stripe from row to row, in columns, that doubles the standard deviation of its direction. At
# twice as many columns the direction carries almost no information.
BLIND_COLUMNS = 8.0
_NODE_BORDERS_M = (NODES_M[1:] + NODES_M[:-1]) / 2
_INVERSE_ROAD_M = 1 / ROAD_M
_ROAD_HEIGHTS = height_and_grade(ROAD_M)[0]


class Ground(NamedTuple):
    """Intersections of rays with the roads of lanes (..., 15)."""

    # (..., N) distance ahead, and how fast the ray approaches the road there, metres of height per metre ahead.
    x_m: np.ndarray
    fall: np.ndarray
    # (..., N, 4) height of the road there per unit of each vertical curvature.
    heights: np.ndarray


class PathCoordinates(NamedTuple):
    """Points relative to the paths of lanes (K, 15), (K, N) each."""

    # Distance to the left of the path, at right angles; arc length, direction and tangent of the path there.
    a: np.ndarray
    along_m: np.ndarray
    direction: np.ndarray
    tangent: np.ndarray


def intersect_ground(x_m: np.ndarray, lanes: np.ndarray, height_m: float) -> Ground:
    """Intersections of rays, given by their distances x (N,) on a flat road, with the roads of lanes (..., 15).

    The ray to the flat distance x falls by h / x per metre. With additional camera pitch it falls by h / x + pitch, and
    it meets the road of height z where z + (h / x + pitch) X = h. For a flat road 1/X is linear in 1/x, for others
    nearly so; it is interpolated in a table.
    """
    lanes = np.asarray(lanes)
    ray_fall = height_m / x_m + lanes[..., PITCH, None]
    # road that is lower in the image than nearer road is hidden behind it
    falls = _INVERSE_ROAD_M * (height_m - lanes[..., VERTICAL_CURVATURE] @ _ROAD_HEIGHTS.T)
    falls = np.minimum.accumulate(falls[..., ::-1], axis=-1)[..., ::-1]
    inverse_x = np.empty(ray_fall.shape)
    for index in np.ndindex(ray_fall.shape[:-1]):
        inverse_x[index] = np.interp(ray_fall[index], falls[index], _INVERSE_ROAD_M)
    x = 1 / inverse_x
    heights, grades = height_and_grade(x)
    fall = ray_fall + (grades * lanes[..., None, VERTICAL_CURVATURE]).sum(axis=-1)
    # at least a fifth of the fall towards a flat road, for rays that graze a crest
    return Ground(x, np.maximum(fall, 0.2 * height_m * inverse_x), heights)


def flatten(
    x_m: np.ndarray, y_m: np.ndarray, angle: np.ndarray, ground: Ground, height_m: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stripes of the flat view on the ground: x, y in metres and angle in radians, (..., N) each."""
    scale = ground.x_m / x_m
    # derivative of the distance on the ground with respect to that on the flat view
    stretch = scale * height_m / (x_m * ground.fall)
    slope = (scale * np.tan(angle) + (stretch - scale) * y_m / x_m) / stretch
    return ground.x_m, y_m * scale, np.arctan(slope)


@dataclass(frozen=True, eq=False)
class StripeResiduals:
    """Residuals of stripes with respect to lanes (K, 15)."""

    # (K, stripes) distance to the left of the nearest line, and that line: `LEFT_SIDE` or `RIGHT_SIDE`, or `FAR_LINE`
    # times that for the far lines of adjacent lanes.
    residual_m: np.ndarray
    side: np.ndarray
    # (K, stripes) direction of that line minus direction of the stripe, positive left, and its standard deviation.
    angle_residual_rad: np.ndarray
    angle_std_rad: np.ndarray
    # The lanes' paths, and the stripes' positions on the ground (x + iy) and relative to the paths.
    path: Path
    ground: Ground
    points: np.ndarray
    coordinates: PathCoordinates

    def moved(self, steps: np.ndarray) -> StripeResiduals:
        """The residuals after small steps (K, 15) of the lanes, linearised; Jacobian and directions stay."""
        moved = replace(self, residual_m=self.residual_m + (steps[:, None] @ self.jacobian)[:, 0])
        moved.__dict__["jacobian"] = self.jacobian
        return moved

    @cached_property
    def jacobian(self) -> np.ndarray:
        """(K, 15, stripes) derivative of `residual_m` by each parameter."""
        jacobian = np.empty((len(self.points), PARAMETERS, self.points.shape[1]))
        gradients = distance_gradients(self.path, self.coordinates.along_m).swapaxes(0, 1)
        jacobian[:, CENTRE] = -1
        jacobian[:, WIDTH] = self.side / -2
        jacobian[:, HEADING : RATE + 1] = gradients[:, :3]
        jacobian[:, RATE_STEPS] = gradients[:, 3:]
        # a stripe moves along its ray by X / fall per radian of pitch; height / X is taken as 1
        by_pitch = (self.points.conj() * self.coordinates.tangent).imag / self.ground.fall
        jacobian[:, PITCH] = by_pitch
        jacobian[:, VERTICAL_CURVATURE] = self.ground.heights.swapaxes(1, 2) * (by_pitch / self.ground.x_m)[:, None]
        jacobian[:, ADJACENT] = (self.side[:, None] == FAR_LINE * SIDES[:, None]) * -SIDES[:, None]
        return jacobian

    def weights(self, std_m: np.ndarray, *, angle_scale: float = 1.0) -> np.ndarray:
        """(K, stripes) weights 0 to 1 by residual and by angle residual, each after Geman and McClure (1987).

        `std_m` (stripes,) is the standard deviation of the residuals; that of the directions is multiplied by
        `angle_scale`.
        """
        angle_std = angle_scale * self.angle_std_rad
        q = (1 + (self.residual_m / std_m) ** 2) * (1 + (self.angle_residual_rad / angle_std) ** 2)
        return 1 / (q * q)


def path_coordinates(lanes: np.ndarray, points: np.ndarray) -> tuple[Path, PathCoordinates]:
    """The paths of lanes (K, 15) as far as points x + iy (K, N) reach, and the points relative to them."""
    # first guess of the arc length: the distance from a place 20 m behind the car
    along = np.abs(points + 20) - 20
    # half a circle is 1.6 times as long as its diameter
    count = int(np.searchsorted(NODES_M[:-2], 1.6 * along.max(initial=0.0))) + 2
    path = path_at_nodes(lanes, count)
    # 1e-12 avoids division by zero
    backwards, curvatures = path.tangents.conj(), path.curvatures + 1e-12
    for _ in range(2):
        nearest = np.searchsorted(_NODE_BORDERS_M[: count - 1], along)
        node = _in_table(nearest, count)
        curvature = curvatures.take(node)
        on_arc = (points - path.points.take(node)) * backwards.take(node)
        turned = 1 + 1j * curvature * on_arc
        scale = np.maximum(np.abs(turned), MIN_SCALE)  # |1 - k a|
        a = (2 * on_arc.imag - curvature * (on_arc.real**2 + on_arc.imag**2)) / (1 + scale)
        turned /= scale
        turn = np.angle(turned)
        ahead = turn / curvature
        along = NODES_M[nearest] + ahead
        # the path is an arc to within millimetres so near a node; roads that bend little need one step
        if np.abs(ahead).max(initial=0.0) < 1.5:
            break
    return path, PathCoordinates(a, along, path.directions.take(node) + turn, path.tangents.take(node) * turned)


def distance_gradients(path: Path, along_m: np.ndarray) -> np.ndarray:
    """(6, K, N) derivatives of points' distances to the left of paths by the parameters `BEND`.

    `along_m` (K, N) are the points' arc lengths. The path moves sideways by the integral of the changes of its
    direction.
    """
    count = path.points.shape[1]
    changes = BENDS_AT_NODES[0, :, None, :count] * path.tangents
    moved = np.zeros_like(changes)
    np.cumsum((changes[..., 1:] + changes[..., :-1]) * (NODE_GAPS_M[: count - 1] / 2), axis=-1, out=moved[..., 1:])
    at_nodes = (moved * path.tangents.conj()).real.reshape(len(BEND), -1)
    # interpolated between the nodes before and behind the points
    nearest = np.searchsorted(NODES_M[1 : count - 1], along_m)
    node, share = _in_table(nearest, count), (along_m - NODES_M[nearest]) / NODE_GAPS_M[nearest]
    before, behind = at_nodes.take(node, axis=1), at_nodes.take(node + 1, axis=1)
    return (before - behind) * share - before


def _in_table(node: np.ndarray, count: int) -> np.ndarray:
    """Indices of nodes (K, N) of K paths in a flat table that has `count` nodes of each path."""
    return node + np.arange(0, count * len(node), count)[:, None]


def stripe_residuals(lanes: np.ndarray, stripes: Stripes, height_m: float) -> StripeResiduals:
    """Residuals of stripes with respect to lanes (K, 15), for a camera `height_m` above the road."""
    ground = intersect_ground(stripes.x_m, lanes, height_m)
    x, y, angle = flatten(stripes.x_m, stripes.y_m, stripes.angle, ground, height_m)
    points = x + 1j * y
    path, coordinates = path_coordinates(lanes, points)
    centre, width, extra_widths = lanes[:, CENTRE, None], lanes[:, WIDTH, None], lanes[:, ADJACENT]
    from_centre = coordinates.a - centre
    # beyond the middle of an adjacent lane the nearest line is its far line
    far = np.abs(from_centre) > width
    side = np.copysign(np.where(far, FAR_LINE, 1.0), from_centre)
    extra_width = far * np.where(side > 0, extra_widths[:, :1], -extra_widths[:, 1:])
    residual = from_centre - side * (width / 2) - extra_width
    # columns per row, with a lower bound for the cosine of a line that runs across
    columns = stripes.step * np.abs(coordinates.tangent.imag) / np.maximum(coordinates.tangent.real, 0.05)
    steepness = np.square(columns / BLIND_COLUMNS)
    angle_std = stripes.angle_std_rad * (1 + steepness * steepness * steepness)
    return StripeResiduals(residual, side, coordinates.direction - angle, angle_std, path, ground, points, coordinates)


# Steps of a fit: (far_m, scale) uses the stripes nearer than `far_m`, with standard deviations times `scale`.
Schedule = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class FitSettings:
    """Prior, schedules, weights and thresholds; tuned on the labelled Udacity stills and the rendered suite."""

    prior: RoadPrior = field(default_factory=RoadPrior)
    # First steps from a start hypothesis, and the steps that follow them.
    start: Schedule = ((16, 6), (20, 4), (26, 4))
    extend: Schedule = ((34, 3), (44, 3), (56, 2), (70, 1.5), (70, 1))
    # Smaller steps, for roads so curved or hilly that distant stripes are far from where they are expected.
    outwards: Schedule = (
        *((far_m, 3.0) for far_m in (9.0, 11.0, 13.0, 16.0, 19.0, 23.0)),
        *((28.0, 2.0), (35.0, 2.0), (45.0, 2.0), (70.0, 1.0), (70.0, 1.0)),
    )
    # Variance inflation of the tracker's fits: the errors of stripes in one frame are correlated (same paint and lens).
    variance_inflation: float = 4.0
    # Stripes nearer to a line than this, in distance (m) and direction (rad), and up to this distance ahead. If a fit
    # explains less weight than theirs by a larger share than `max_unexplained`, the road may bend or undulate more.
    nearby: tuple[float, float, float] = (0.5, 0.3, 45.0)
    max_unexplained: float = 0.2
    # Weight of stripes that the fit of a road that undulates must gain.
    undulation_gain: float = 6.0
    # Support of a line is counted up to this distance.
    support_far_m: float = 50.0
    # A line is seen if its support is at least this. A lane is seen if its lines and the far lines of adjacent lanes
    # together have this support.
    min_support: float = 0.03


FIT = FitSettings()


@dataclass(frozen=True, eq=False)
class Fit:
    """K lanes fitted to the stripes of one image."""

    # (K, 15) parameters as in `lanes.detect.road`, and (K, 15, 15) their inverse covariance, prior included.
    lanes: np.ndarray
    information: np.ndarray
    residuals: StripeResiduals
    stripes: Stripes
    view: BirdsEyeView
    settings: FitSettings

    @cached_property
    def covariance(self) -> np.ndarray:
        """(K, 15, 15) covariance of the parameters for the noise that the fit assumes."""
        return np.linalg.inv(self.information)

    @cached_property
    def weight(self) -> np.ndarray:
        """(K, stripes) weight of each stripe, 0 to 1."""
        return self.residuals.weights(self.stripes.std_m) * self.stripes.weight

    @cached_property
    def explained(self) -> np.ndarray:
        """(K,) sum of the weights of the stripes."""
        return self.weight.sum(axis=1)

    @cached_property
    def unexplained(self) -> np.ndarray:
        """(K,) bool: many stripes near the lines are not explained, so the road may bend or undulate more."""
        distance_m, angle_rad, far_m = self.settings.nearby
        nearby = (np.abs(self.residuals.residual_m) < distance_m) & (self.stripes.x_m < far_m)
        nearby &= np.abs(self.residuals.angle_residual_rad) < angle_rad
        return self.explained < (1 - self.settings.max_unexplained) * (nearby @ self.stripes.weight)

    @cached_property
    def on_line(self) -> np.ndarray:
        """(K, 2, stripes) bool: the stripe is nearest to the left or to the right line of the lane."""
        return self.residuals.side[:, None] == SIDES[:, None]

    @cached_property
    def members(self) -> np.ndarray:
        """(K, 2, stripes) bool: the stripe belongs to the left or to the right line of the lane."""
        least = 0.25 * np.where(self.stripes.edge, PAINT.edge_weight, 1.0)
        return self.on_line & (self.weight > least)[:, None]

    @cached_property
    def extent_m(self) -> np.ndarray:
        """(K, 2, 2) distance of the nearest and the farthest stripe of each line on the lane's road; 0 without any.

        The farthest one is the last before a gap of more than 16 m: German dashes are 12 m apart, and may be half seen
        at either end. Stripes behind such a gap are often on a vehicle that hides the road.
        """
        beyond_m = np.full((*self.members.shape[:2], 1), 1e6)
        x_m = np.sort(np.where(self.members, self.stripes.x_m, beyond_m), axis=-1)
        x_m = np.concatenate([x_m, beyond_m], axis=-1)
        last = (np.diff(x_m, append=2 * beyond_m) > 16.0).argmax(axis=-1)
        ends_m = np.stack([x_m[..., 0], np.take_along_axis(x_m, last[..., None], axis=-1)[..., 0]], axis=-1)
        marked = self.members.any(axis=-1, keepdims=True)
        flat_m = np.where(marked, ends_m, 1.0).reshape(len(self.lanes), -1)
        on_road_m = intersect_ground(flat_m, self.lanes, self.view.height_m).x_m
        return np.where(marked, on_road_m.reshape(ends_m.shape), 0.0)

    @cached_property
    def lines_y_m(self) -> np.ndarray:
        """(K, 2, rows) lateral positions of both lines in the rows of the view; NaN where a line does not pass."""
        return lines_on_view(self.lanes, self.view.x_m, self.view.height_m)

    @cached_property
    def marked_rows(self) -> np.ndarray:
        """(K, 2) rows up to `support_far_m` with markings on each line: the sum of its stripes' weights."""
        weight = self.weight * (self.stripes.x_m < self.settings.support_far_m)
        return (weight[:, None] * self.on_line).sum(axis=-1)

    @cached_property
    def visible_rows(self) -> np.ndarray:
        """(K, 2) visible rows of each line up to `support_far_m`, at least 30: three rows are no reliable share."""
        view = self.view
        rows = np.flatnonzero(view.x_m < self.settings.support_far_m)
        column = (view.y_m[0] - self.lines_y_m[..., rows]) / view.cell_m
        inside = (column >= 0) & (column <= len(view.y_m) - 1)
        seen = inside & view.seen[rows, np.where(inside, column, 0).astype(int)]
        return np.maximum(seen.sum(axis=-1), 30)

    @property
    def support(self) -> np.ndarray:
        """(K, 2) support of each line: share of its visible rows with markings on it."""
        return self.marked_rows / self.visible_rows

    @property
    def seen(self) -> np.ndarray:
        """(K,) bool: the lines of the lane and the far lines of adjacent lanes have enough support together.

        Worn lines and raised dots can be too faint to be seen one by one. They lie parallel, a lane apart.
        """
        marked = self.weight @ (self.stripes.x_m < self.settings.support_far_m)
        return marked >= self.settings.min_support * self.visible_rows.max(axis=1)


def near_stripes(stripes: Stripes, settings: FitSettings = FIT) -> Stripes:
    """The stripes that a search begins with: those within the last step of `settings.start`."""
    return stripes.select(stripes.x_m < settings.start[-1][0])


def fit_starts(
    starts: np.ndarray, stripes: Stripes, view: BirdsEyeView, settings: FitSettings = FIT
) -> tuple[Fit, Fit]:
    """Fit start hypotheses (K, 15) to the near stripes, and the best three of them to all stripes: both fits.

    The second is that of one lane.
    The best lane has the largest sum of the square roots of its lines' supports; lanes that the car is not in come
    last. If it leaves many stripes nearby unexplained, it is also fitted as a road that undulates.
    """
    s = settings
    near = fit_lanes(starts, near_stripes(stripes, s), view, s, schedule=s.start)
    marked = np.sqrt((near.weight[:, None] * near.on_line).sum(-1)).sum(-1)
    order = np.lexsort((-marked, ~is_ego_lane(near.lanes)))[:3]
    fits = fit_lanes(near.lanes[order], stripes, view, s)
    best = np.lexsort((-np.sqrt(fits.support).sum(1), ~is_ego_lane(fits.lanes)))[:1]
    residuals = stripe_residuals(fits.lanes[best], stripes, view.height_m)
    fit = Fit(fits.lanes[best], fits.information[best], residuals, stripes, view, s)
    if not fit.unexplained[0]:
        return near, fit
    # a standard deviation of 4e-3 1/m: crests and dips with a radius of 250 m
    undulating = fit_lanes(fit.lanes, stripes, view, s, schedule=s.outwards, extra_vertical_per_m=4e-3)
    return near, undulating if undulating.explained[0] > fit.explained[0] + s.undulation_gain else fit


def fit_lanes(
    lanes: np.ndarray,
    stripes: Stripes,
    view: BirdsEyeView,
    settings: FitSettings = FIT,
    *,
    schedule: Schedule | None = None,
    prior: tuple[np.ndarray, np.ndarray] | None = None,
    extra_vertical_per_m: float = 0.0,
    linear: bool = False,
) -> Fit:
    """Refine lanes (K, 15): each step weights the stripes and solves the normal equations together with the prior.

    Parameters
    ----------
    schedule : Schedule, optional
        Steps (far_m, scale); `settings.extend` by default.
    prior : (ndarray (15,), ndarray (15, 15)), optional
        Mean and covariance of a prediction: this is then the measurement update of an extended Kalman filter, and the
        stripes' variances are inflated. By default the prior is that of roads that bend as the lane of each step.
    extra_vertical_per_m : float
        Vertical curvature added to the standard deviation of the prior of roads.
    linear : bool
        Linearise the residuals once, at the given lanes: near a prediction the steps are small.
    """
    s = settings
    lanes, inflation = np.array(lanes, float), 1.0
    mean, prior_information = s.prior.mean, np.empty(0)
    if prior is not None:
        mean, prior_information, inflation = prior[0], np.linalg.inv(prior[1]), s.variance_inflation
    residuals = stripe_residuals(lanes, stripes, view.height_m) if linear else None
    for far_m, scale in schedule or s.extend:
        used = stripes if linear else stripes.select(stripes.x_m < far_m)
        at_lanes = residuals if linear and residuals else stripe_residuals(lanes, used, view.height_m)
        if prior is None:
            std = s.prior.std_at(lanes, extra_vertical_per_m=extra_vertical_per_m)
            prior_information = np.eye(PARAMETERS) / np.square(std)[..., None]
        std_m = scale * used.std_m
        weighted = at_lanes.jacobian * (at_lanes.weights(std_m, angle_scale=scale) * used.weight / std_m**2)[:, None]
        weighted /= inflation
        information = weighted @ np.swapaxes(at_lanes.jacobian, -1, -2) + prior_information
        gradient = weighted @ at_lanes.residual_m[..., None] + prior_information @ (lanes - mean)[..., None]
        before, step = lanes, np.linalg.solve(information, gradient)[..., 0]
        lanes = np.clip(lanes - step, -s.prior.limit, s.prior.limit)
        residuals = at_lanes.moved(lanes - before) if linear else None
    return Fit(lanes, information, residuals or stripe_residuals(lanes, stripes, view.height_m), stripes, view, s)
