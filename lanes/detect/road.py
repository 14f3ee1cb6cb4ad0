"""Lane model: 15 parameters for both lines of a lane, the geometry of the lines, and
the prior of the parameters.

The path that passes the car parallel to the lane begins with `heading` and `curvature`,
which changes by `rate` per metre. Three rate steps change the rate at `KNOTS_M` along
the road: the curvature is piecewise linear in arc length, as on roads built of
straights, arcs and clothoids, and a bend may begin and end within the view (hairpins).
The centre of the lane is `centre` to the left of the path, and the two lines run half a
`width` to either side of it.

`pitch` is the camera's pitch in this frame minus that of its pose (bumps, brakes). Four
parameters are the vertical curvature of the road at `VERTICAL_KNOTS_M`, linear in
between and fading beyond: crests, dips, and undulations shorter than the view. Pitch
and vertical curvature both make the lines look as if they were not parallel.

The last two parameters are the widths of the adjacent lanes to the left and to the
right, minus this lane's width. The far lines of adjacent lanes run parallel, too, and
are often visible where a line of the ego lane is not.

Parameters are arrays (..., 15), so that competing hypotheses share one pass.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

# Indices of the parameters.
CENTRE, WIDTH, HEADING, CURVATURE, RATE, PITCH = range(6)
VERTICAL_CURVATURE = slice(6, 10)
RATE_STEPS = slice(10, 13)
ADJACENT = slice(13, 15)
PARAMETERS = 15
# Parameters that the direction of the path depends on.
BEND = np.array([HEADING, CURVATURE, RATE, 10, 11, 12])
# Arc lengths at which the rate may change, metres: a transition curve takes ten metres
# or more.
KNOTS_M = np.array([7.0, 14.0, 24.0])
# Arc lengths at which the path is tabulated, metres: so close that it is an arc in
# between, and out to the end of an outline. The knots are among them.
NODES_M = np.concatenate(
    [
        np.arange(0.0, 50.0, 1.0),
        np.arange(50.0, 80.0, 2.0),
        np.geomspace(80.0, 450.0, 16),
    ]
)
NODE_GAPS_M = np.diff(NODES_M)
# The view ends here (metres); beyond it the grade is constant.
VIEW_END_M = 70.0
# Distances of the vertical curvatures, metres. Closer knots could not be distinguished
# from pitch motion.
VERTICAL_KNOTS_M = np.array([0.0, 12.0, 24.0, 40.0])
LEFT_SIDE = 1.0
RIGHT_SIDE = -1.0
SIDES = np.array([LEFT_SIDE, RIGHT_SIDE])
# The far lines of the adjacent lanes have the sides `FAR_LINE * LEFT_SIDE` and
# `FAR_LINE * RIGHT_SIDE`.
FAR_LINE = 3.0

# Largest curvature of motorways; roads that bend more have transition curves, undulate
# and change abruptly.
MOTORWAY_CURVATURE_PER_M = 0.002
# A line that advances by less than this per metre of the path runs across; it is not
# followed further.
MIN_ADVANCE = 0.1

# The vertical curvature is linear between these distances: its slope changes there.
_VERTICAL_BREAKS_M = np.array([*VERTICAL_KNOTS_M, VIEW_END_M])


def _slope_changes() -> np.ndarray:
    """(4, 6) matrix from the vertical curvatures to what describes them piecewise.

    That is the curvature at the car, and the change of its slope at each break.
    """
    at_breaks = np.eye(4, 5)
    slopes = np.diff(at_breaks) / np.diff(_VERTICAL_BREAKS_M)
    flat = np.zeros((4, 1))
    changes = np.diff(slopes, prepend=flat, append=flat)
    return np.column_stack([np.eye(4, 1), changes])


# To heights and grades, by powers of the distance beyond the car and beyond each break.
_TO_HEIGHTS = _slope_changes() / [2, 6, 6, 6, 6, 6]
_TO_GRADES = _slope_changes() / [1, 2, 2, 2, 2, 2]


def height_and_grade(x_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Height and grade at x (...) per unit of each vertical curvature, (..., 4) each.

    They are the two integrals of a piecewise linear curvature.
    """
    x = np.ravel(x_m)
    beyond = np.maximum(x - _VERTICAL_BREAKS_M[:, None], 0)
    square = beyond * beyond
    heights = _TO_HEIGHTS @ np.concatenate([[x * x], square * beyond])
    grades = _TO_GRADES @ np.concatenate([[x], square])
    shape = (*np.shape(x_m), len(VERTICAL_KNOTS_M))
    return heights.T.reshape(shape), grades.T.reshape(shape)


def road_height(lane: np.ndarray, x_m: np.ndarray) -> np.ndarray:
    """Height (N,) of the road of a lane (15,) at distances x (N,) above the plane that
    the car stands on, metres.
    """
    return height_and_grade(x_m)[0] @ lane[VERTICAL_CURVATURE]


def lines_on_view(lanes: np.ndarray, x_m: np.ndarray, height_m: float) -> np.ndarray:
    """Lateral positions (K, 2, N) of both lines of lanes (K, 15) on the flat grid of a
    view.

    They are at distances x (N,), left line first. NaN where a line does not pass,
    because it has turned back before or lies behind a crest.
    """
    lanes = np.asarray(lanes)[:, None]
    along_m = np.geomspace(0.5 * x_m.min(), 1.5 * x_m.max(), 120)
    points = line_points(lanes, SIDES, along_m)
    x = np.maximum(points[..., 0], 0.1)
    y = points[..., 1]

    # the ray to the road at x, and its intersection with a flat road in a view without
    # the pitch
    heights, _ = height_and_grade(x)
    height = (heights @ lanes[..., VERTICAL_CURVATURE, None])[..., 0]
    fall = (height_m - height) / x - lanes[..., PITCH, None]
    flat_x = height_m / np.maximum(fall, 1e-3)
    flat_y = y / x * flat_x

    # each line up to where it turns back
    back = flat_x[..., 1:] <= flat_x[..., :-1]
    count = flat_x.shape[-1]
    ends = np.where(back.any(axis=-1), back.argmax(axis=-1) + 1, count)
    lines = np.empty((*ends.shape, len(x_m)))
    for line, end in np.ndenumerate(ends):
        known_x = flat_x[line][:end]
        known_y = flat_y[line][:end]
        lines[line] = np.interp(x_m, known_x, known_y, left=np.nan, right=np.nan)
    return lines


def adjacent_lane_matrix(side: float) -> np.ndarray:
    """(15, 15) matrix from a lane's parameters to those of an adjacent lane.

    It is the lane to the left (+1) or right (-1). The two lanes share a line. The lane
    beyond the adjacent one is taken to be as wide as it.
    """
    to_left = ADJACENT.start
    to_right = ADJACENT.start + 1
    there, back = (to_left, to_right) if side > 0 else (to_right, to_left)
    matrix = np.eye(PARAMETERS)
    matrix[CENTRE, WIDTH] = side
    matrix[CENTRE, there] = side / 2
    matrix[WIDTH, there] = 1
    matrix[[there, back]] = 0
    matrix[back, there] = -1
    return matrix


def is_ego_lane(lanes: np.ndarray) -> np.ndarray:
    """(K,) bool: the two lines of a lane (K, 15) pass the car on different sides."""
    return np.abs(lanes[:, CENTRE]) <= lanes[:, WIDTH] / 2


def bend_gradients(along_m: np.ndarray) -> np.ndarray:
    """(2, 6, N) derivatives of a lane's direction and curvature at arc lengths (N,).

    They are by the parameters `BEND`. The direction is the integral of the curvature.
    """
    gradients = np.zeros((2, len(BEND), len(along_m)))
    direction, curvature = gradients
    beyond_knots = np.maximum(along_m - KNOTS_M[:, None], 0)
    curvature[1] = 1
    curvature[2] = along_m
    curvature[3:] = beyond_knots
    direction[0] = 1
    direction[1] = along_m
    direction[2:] = curvature[2:] ** 2 / 2
    return gradients


# Tabulated, because every fit asks for them.
BENDS_AT_NODES = bend_gradients(NODES_M)
# Derivatives of the curvatures at the car, at the knots of the rate, and just behind
# the last one. Between these places the curvature is linear.
_CURVATURES_AHEAD = bend_gradients(np.array([0.0, *KNOTS_M, KNOTS_M[-1] + 1]))[1]


def max_curvature(lane: np.ndarray) -> float:
    """Largest curvature of the road (15,) between the car and 25 m ahead, 1/m."""
    return float(np.abs(lane[BEND] @ _CURVATURES_AHEAD).max())


def max_vertical_curvature(lane: np.ndarray) -> float:
    """Largest vertical curvature of the road (15,) in view, 1/m."""
    return float(np.abs(lane[VERTICAL_CURVATURE]).max())


class Path(NamedTuple):
    """Paths of lanes (..., 15) at the first M of `NODES_M`, (..., M) each.

    Points and unit tangents are complex numbers x + iy, metres. Directions are in
    radians, curvatures in 1/metre.
    """

    points: np.ndarray
    tangents: np.ndarray
    directions: np.ndarray
    curvatures: np.ndarray


def path_at_nodes(lanes: np.ndarray, count: int = len(NODES_M)) -> Path:
    """The paths of lanes (..., 15) at the first `count` nodes.

    A path passes the car parallel to its lane.
    """
    direction, curvature, tangents = _bends(lanes, BENDS_AT_NODES[..., :count])
    turns = 1j * curvature * tangents
    chords = _chords(
        NODE_GAPS_M[: count - 1],
        before=tangents[..., :-1],
        after=tangents[..., 1:],
        turn_difference=turns[..., :-1] - turns[..., 1:],
    )
    points = np.zeros_like(tangents)
    np.cumsum(chords, axis=-1, out=points[..., 1:])
    return Path(points, tangents, direction, curvature)


def _bends(
    lanes: np.ndarray, gradients: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Direction, curvature and tangent (..., N) of lanes (..., 15).

    `gradients` (2, 6, N) are those of `bend_gradients`.
    """
    bend = lanes[..., BEND]
    direction = bend @ gradients[0]
    curvature = bend @ gradients[1]
    tangent = np.cos(direction) + 1j * np.sin(direction)
    return direction, curvature, tangent


def _chords(
    length_m: np.ndarray,
    before: np.ndarray,
    after: np.ndarray,
    turn_difference: np.ndarray,
) -> np.ndarray:
    """Vectors from end to end of short pieces of a path: integrals of the tangent.

    The tangents at both ends and the difference of their derivatives are given:
    trapezoidal rule with end correction.
    """
    trapezoid = (before + after) * (length_m / 2)
    return trapezoid + turn_difference * (length_m**2 / 12)


def line_points(
    lanes: np.ndarray, side: float | np.ndarray, along_m: np.ndarray
) -> np.ndarray:
    """Points (..., N, 2) of lines of lanes (..., 15), metres.

    They are at arc lengths (N,) of the path. `side` is `LEFT_SIDE`, `RIGHT_SIDE` or an
    array of them that broadcasts with the lanes.
    """
    farthest_m = np.max(along_m, initial=0.0)
    count = int(np.searchsorted(NODES_M, farthest_m, side="right"))
    path = path_at_nodes(lanes, max(count, 1))
    offset = lanes[..., CENTRE] + np.asarray(side) * lanes[..., WIDTH] / 2
    line, _ = _line_along(path, lanes, offset, along_m)
    return line[..., None].view(float)


def _line_along(
    path: Path, lanes: np.ndarray, offset_m: np.ndarray, along_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Points x + iy (..., N) of lines, and how fast x grows along the path.

    The lines are `offset_m` (...) to the left of the paths. Lanes, offsets and paths
    broadcast; the arc lengths (N,) are within the tabulated part of the paths.
    """
    # from the node before each arc length to the foot on the path
    node = np.searchsorted(NODES_M, along_m, side="right") - 1
    node = np.maximum(node, 0)
    before = path.tangents.take(node, axis=-1)
    turn_before = path.curvatures.take(node, axis=-1) * before
    _, curvature, tangent = _bends(lanes, bend_gradients(along_m))
    chord = _chords(
        along_m - NODES_M[node],
        before=before,
        after=tangent,
        turn_difference=1j * (turn_before - curvature * tangent),
    )
    foot = path.points.take(node, axis=-1) + chord

    # at right angles to the line
    offset = np.asarray(offset_m)[..., None]
    advance = (1 - curvature * offset) * tangent.real
    return foot + 1j * offset * tangent, advance


def line_crossings(
    x_m: np.ndarray, lane: np.ndarray, side: float
) -> tuple[np.ndarray, np.ndarray]:
    """Arc lengths (N,) at which a line of the lane (15,) passes distances x (N,).

    The second result are its points (N, 2) there. NaN where the line has turned back
    before.
    """
    path = path_at_nodes(lane)
    offset = lane[CENTRE] + side * lane[WIDTH] / 2
    # Newton's method for the arc length at which the line passes x; straight roads need
    # one step
    along = np.array(x_m, float)
    for _ in range(8):
        line, advance = _line_along(path, lane, offset, along)
        step = (x_m - line.real) / np.maximum(advance, MIN_ADVANCE)
        step = np.clip(step, -5, 5)
        along = along + step
        if np.abs(step).max(initial=0.0) < 1e-6:
            break  # the next step would be below rounding errors
    line, _ = _line_along(path, lane, offset, along)

    # not beyond the place where the line turns back
    across = (1 - path.curvatures * offset) * path.tangents.real <= MIN_ADVANCE
    turns_back_at_m = NODES_M[across.argmax()] if across.any() else np.inf
    is_there = np.abs(line.real - x_m) < 1e-3
    passes = is_there & (advance > MIN_ADVANCE) & (along < turns_back_at_m)
    points = line[:, None].view(float)
    return (
        np.where(passes, along, np.nan),
        np.where(passes[:, None], points, np.nan),
    )


def line_y(x_m: np.ndarray, lane: np.ndarray, side: float) -> np.ndarray:
    """Lateral position (N,) of a line of the lane (15,) at distances x (N,).

    NaN where it has turned back before.
    """
    _, points = line_crossings(x_m, lane, side)
    return points[..., 1]


def line_y_gradients(x_m: np.ndarray, lane: np.ndarray, side: float) -> np.ndarray:
    """Derivatives (N, 15) of `line_y` by the parameters; NaN where it is NaN.

    At a fixed arc length a parameter moves the line's point by (dX, dY). At a fixed x
    it moves y by dY - dX (dY/ds) / (dX/ds); the quotient is the tangent of the path's
    direction, which the line shares.
    """
    along, _ = line_crossings(x_m, lane, side)

    def points_of(lanes: np.ndarray) -> np.ndarray:
        return line_points(lanes, side, along)

    by_parameter = parameter_gradients(points_of, lane)
    direction, _, _ = _bends(lane, bend_gradients(along))
    slope = np.tan(direction)[:, None]
    return by_parameter[:, 1] - by_parameter[:, 0] * slope


def parameter_gradients(
    positions: Callable[[np.ndarray], np.ndarray], lane: np.ndarray
) -> np.ndarray:
    """Derivatives (..., 15) of a function of lanes at a lane (15,).

    `positions` takes lanes (K, 15) and has results (K, ...). The derivatives are
    central differences.
    """
    steps = np.diag(DIFFERENCE_STEPS)
    moved = positions(lane + np.vstack([steps, -steps]))
    differences = moved[:PARAMETERS] - moved[PARAMETERS:]
    return np.moveaxis(differences, 0, -1) / (2 * DIFFERENCE_STEPS)


def propagated_std(gradients: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Standard deviations (...) of numbers with gradients (..., 15) by the parameters.

    `covariance` (15, 15) is that of the parameters.
    """
    variance = ((gradients @ covariance) * gradients).sum(axis=-1)
    return np.sqrt(variance)


def lateral_gradients(x_m: float | np.ndarray) -> np.ndarray:
    """(2, ..., 15) derivatives of both lines' lateral positions at distances x (...).

    They are those of a straight lane.
    """
    x = np.asarray(x_m, float)
    gradients = np.zeros((2, *x.shape, PARAMETERS))
    gradients[..., CENTRE] = 1
    gradients[..., WIDTH] = SIDES.reshape(2, *[1] * x.ndim) / 2
    gradients[..., HEADING] = x
    gradients[..., CURVATURE] = x**2 / 2
    gradients[..., RATE] = x**3 / 6
    beyond_knots = np.maximum(x[..., None] - KNOTS_M, 0)
    gradients[..., RATE_STEPS] = beyond_knots**3 / 6
    return gradients


def lateral_std_m(covariance: np.ndarray, x_m: float | np.ndarray) -> np.ndarray:
    """Standard deviation (2, ...) of the lateral positions of the left and right line
    at distances x (...), metres.

    `covariance` (15, 15) is that of a nearly straight lane; `Lane.lateral_std_m` holds
    in bends, too.
    """
    return propagated_std(lateral_gradients(x_m), covariance)


def line_coefficients(
    lane: np.ndarray, side: float
) -> tuple[float, float, float, float]:
    """(c0, c1, c2, c3) of y = c0 + c1 x + c2 x^2 / 2 + c3 x^3 / 6.

    This is the Taylor series of the line at the car. A line that turns back before it
    would pass the car is taken to pass it at 64 degrees (sine 0.9).
    """
    centre, width, heading, curvature, rate = lane[:PITCH]
    offset = centre + side * width / 2
    scale = 1 - curvature * offset

    # the concentric circle at x = 0
    line_curvature = curvature / scale
    line_rate = rate / scale**3
    sin = min(max(np.sin(heading) / scale, -0.9), 0.9)
    cos = np.sqrt(1 - sin * sin)
    c0 = offset * (1 + scale) / (np.cos(heading) + scale * cos)
    c1 = sin / cos
    c2 = line_curvature / cos**3
    c3 = line_rate / cos**4 + 3 * line_curvature**2 * sin / cos**5
    return float(c0), float(c1), float(c2), float(c3)


# An odd width counts as this number of standard deviations at most where a drive tells
# the usual one: the road may have changed.
MAX_WIDTH_STDS = 3.0
# Cost of one squared standard deviation, relative to the square root of a line's
# support: that of the prior in the votes.
WIDTH_COST = 0.05


class UsualWidth(NamedTuple):
    """Mean and standard deviation of lane widths, of all roads or of a drive."""

    mean_m: float
    std_m: float
    max_stds: float = MAX_WIDTH_STDS

    def squared_distance(self, width_m: float | np.ndarray) -> Any:
        """Squared distances of widths in standard deviations, limited."""
        from_mean = (width_m - self.mean_m) / self.std_m
        return np.minimum(from_mean**2, self.max_stds**2)

    def cost(self, width_m: np.ndarray) -> np.ndarray:
        """Costs of widths in the choice of a lane."""
        return WIDTH_COST * self.squared_distance(width_m)


# Mean, standard deviation, and limit of the absolute value.
MeanStdLimit = tuple[float, float, float]


@dataclass(frozen=True)
class RoadPrior:
    """Prior of the lane parameters, and how its standard deviations grow on roads that
    bend.

    Tuned on the labelled Udacity stills where no source is given.
    """

    mean: np.ndarray = field(init=False, repr=False, compare=False)
    std: np.ndarray = field(init=False, repr=False, compare=False)
    limit: np.ndarray = field(init=False, repr=False, compare=False)

    # Cars drive near the centre of their lane and along it; limits for a car that
    # leaves it.
    centre_m: MeanStdLimit = (0.0, 0.8, 3.0)
    heading_rad: MeanStdLimit = (0.0, 0.15, 0.7)
    # Lanes are 2.5 to 4.5 m wide; adjacent lanes have about the same width.
    width_m: MeanStdLimit = (3.5, 0.5, 6.0)
    adjacent_m: MeanStdLimit = (0.0, 0.15, 0.5)
    # Hairpins have radii down to 12 m.
    curvature_per_m: MeanStdLimit = (0.0, 0.05, 0.12)
    rate_per_m2: MeanStdLimit = (0.0, 1e-4, 0.01)
    rate_step_per_m2: MeanStdLimit = (0.0, 1e-4, 0.01)
    # Cars pitch by about a degree.
    pitch_rad: MeanStdLimit = (0.0, 0.015, 0.06)
    vertical_per_m: MeanStdLimit = (0.0, 2e-4, 0.015)
    # Growth of the curvature's standard deviation with the curvature, so that a sharp
    # bend is not straightened.
    curvature_share: float = 1.0
    # Shortest transition curve: the rate's standard deviation grows with curvature /
    # transition_m.
    transition_m: float = 15.0
    # Growth of the rate steps' standard deviation with the rate that they begin or end.
    rate_step_share: float = 1.5
    # Roads that bend more than motorways also undulate: growth of the vertical
    # curvature's standard deviation with the excess, and with the largest vertical
    # curvature of the lane.
    vertical_bend_share: float = 0.03
    vertical_share: float = 1.0

    def __post_init__(self) -> None:
        """Means, standard deviations and limits (15,) for a straight and level road."""
        rows: list[MeanStdLimit] = [
            self.centre_m,
            self.width_m,
            self.heading_rad,
            self.curvature_per_m,
            self.rate_per_m2,
            self.pitch_rad,
        ]
        rows += [self.vertical_per_m] * 4
        rows += [self.rate_step_per_m2] * 3
        rows += [self.adjacent_m] * 2
        mean, std, limit = np.array(rows).T
        object.__setattr__(self, "mean", mean)
        object.__setattr__(self, "std", std)
        object.__setattr__(self, "limit", limit)

    def std_at(
        self, lanes: np.ndarray, *, extra_vertical_per_m: float = 0.0
    ) -> np.ndarray:
        """Standard deviations (K, 15); larger for lanes (K, 15) that bend.

        `extra_vertical_per_m` is added to those of the vertical curvatures.
        """
        std = np.tile(self.std, (len(lanes), 1))
        # the curvature, and how it changes
        curvature = np.abs(lanes[:, CURVATURE])
        rate = np.abs(lanes[:, RATE])
        expected_rate = curvature / self.transition_m
        std[:, CURVATURE] += self.curvature_share * curvature
        std[:, RATE] += expected_rate
        std[:, RATE_STEPS] += (self.rate_step_share * (expected_rate + rate))[:, None]

        # the undulation
        excess = np.maximum(curvature - MOTORWAY_CURVATURE_PER_M, 0)
        largest = np.abs(lanes[:, VERTICAL_CURVATURE]).max(axis=1)
        vertical = self.vertical_bend_share * excess
        vertical += self.vertical_share * largest
        std[:, VERTICAL_CURVATURE] += extra_vertical_per_m + vertical[:, None]
        return std


# Names of the parameters, for `parameter_vector`.
NAMES: dict[str, int | slice] = {
    "centre": CENTRE,
    "width": WIDTH,
    "heading": HEADING,
    "curvature": CURVATURE,
    "rate": RATE,
    "pitch": PITCH,
    "vertical": VERTICAL_CURVATURE,
    "rate_steps": RATE_STEPS,
    "adjacent": ADJACENT,
}


def parameter_vector(**numbers: float | Sequence[float]) -> np.ndarray:
    """(15,) lane parameters by name (`NAMES`), 0 if not given; the last three names
    take one number or one for each.
    """
    vector = np.zeros(PARAMETERS)
    for name, number in numbers.items():
        vector[NAMES[name]] = number
    return vector


# Steps of numerical derivatives: about a thousandth of what the parameters vary by on a
# straight road.
DIFFERENCE_STEPS = parameter_vector(
    centre=1e-3,
    width=5e-4,
    heading=1e-4,
    curvature=5e-5,
    rate=1e-7,
    pitch=1e-5,
    vertical=2e-7,
    rate_steps=1e-7,
    adjacent=1e-4,
)
