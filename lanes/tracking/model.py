"""The shape of a lane: fifteen numbers for both of its lines, and how they lie on the road and in the view.

The lane's middle is an arc that passes the car at `centre` with `heading` and `curvature`, which changes by `rate` for
each metre along it; the two lines run half a `width` to its left and right. Three kinks say by how much the rate
changes where the road has run `KNOTS_M`: with them the curvature is a chain of straight pieces over the length of the
road, and a bend may begin and end within the view, as hairpins do.

`pitch` is how much farther down than its pose says the camera looks in this frame (bumps, brakes). Four numbers are
the curvature of the road upwards at `VERTICAL_KNOTS_M`, straight in between and fading beyond: crests, dips, and waves
shorter than the view. Both show in that the lines do not look parallel.

The last two say how much wider than this lane the next ones to the left and to the right are. Their far lines run
parallel, too, and often are in sight where a line of the lane itself is not.

A point's distance from the arc, taken at right angles, needs no x as the running variable, so that hairpins that fold
back are as good as straight roads:

    a (1 - k a / 2) = y cos h - x sin h - k (x^2 + y^2) / 2        for heading h and curvature k,

which follows from |P - C| = 1/k - a for a circle of centre C; concentric lines then differ in `a` alone.

All parameters are arrays (..., 15), so that rival lanes share one pass.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

CENTRE, WIDTH, HEADING, CURVATURE, RATE, PITCH = range(6)
VERTICAL_CURVATURE, RATE_STEPS, ADJACENT = slice(6, 10), slice(10, 13), slice(13, 15)
PARAMETERS = 15
# Where the rate may change, metres: a bend's transition takes ten metres or more, and a kink shows a few metres later.
KNOTS_M = np.array([7.0, 14.0, 24.0])
# Where the road's curvature upwards is known, metres; closer together it could not be told from a nodding camera.
VERTICAL_KNOTS_M = np.array([0.0, 12.0, 24.0, 40.0])
# From where the view ends nothing is known: there the grade goes on as it is.
STRAIGHT_FROM_M = 70.0
LEFT_SIDE, RIGHT_SIDE = 1.0, -1.0
SIDES = np.array([LEFT_SIDE, RIGHT_SIDE])
# The far lines of the lanes beside are `FAR_LINE * LEFT_SIDE` and `FAR_LINE * RIGHT_SIDE`.
FAR_LINE = 3.0

# Distances between which it is looked up where rays meet the road, farthest first: so close together that the error is
# below a millimetre of height.
ROAD_M = np.geomspace(350.0, 2.0, 160)
# A ray that grazes the road still falls towards it by this share of what it falls towards a flat one.
LEAST_FALL = 0.2
# A point next to the arc's centre is on no side of it; this keeps roots and divisions there in bounds.
LEAST_SCALE = 1e-2
# Sine of the largest angle at which a line passes the car: 64 degrees, half as much again as the largest heading.
STEEPEST = 0.9
# How much one squared standard deviation from the prior costs, beside the square roots of the two supports.
VOTE_PRIOR_WEIGHT = 0.01

# What is known of any lane before looking, and its standard deviation, in the order of `lanemodel`: lanes are 2.5
# to 4.5 m wide, cars drive near their middle and along them, hairpins have radii down to 12 m, cars nod by a degree,
# and the lanes of one road are about as wide.
PRIOR_MEAN = np.array([0.0, 3.5, *[0.0] * 13])
PRIOR_STD = np.array([0.8, 0.5, 0.15, 0.05, 1e-4, 0.015, *[2e-4] * 4, *[1e-4] * 3, 0.15, 0.15])
LIMIT = np.array([3.0, 6.0, 0.7, 0.12, 0.01, 0.06, *[0.015] * 4, *[0.01] * 3, 0.5, 0.5])
# A bend takes at least about this far from nothing to all of it.
TRANSITION_M = 15.0
# Kinks are as large as what they end or begin, and a little more; the prior of a sharp bend is wider, so that it is
# not drawn towards the straight. Roads that bend more than motorways do also wave, a little; and where they do, as much
# everywhere.
KINK_SHARE = 1.5
CURVATURE_SHARE = 1.0
VERTICAL_SHARE, GENTLE_PER_M = 0.03, 0.002
WAVE_SHARE = 1.0


def _slopes_of_knots() -> np.ndarray:
    """(6, 4): the curvature at the car, and by how much its slope changes at each knot, from the curvatures there."""
    knots = len(VERTICAL_KNOTS_M)
    curvatures = np.vstack([np.eye(knots), np.zeros((1, knots))])
    slopes = np.diff(curvatures, axis=0) / np.diff([*VERTICAL_KNOTS_M, STRAIGHT_FROM_M])[:, None]
    level = np.zeros((1, knots))
    return np.vstack([curvatures[:1], np.diff(slopes, axis=0, prepend=level, append=level)])


_TO_SLOPES = _slopes_of_knots()


def height_and_grade(x_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How much height and how much slope at x (...) each number of `VERTICAL_CURVATURE` makes: (..., 4) each.

    The two integrals of a curvature that is straight between knots.
    """
    x = np.asarray(x_m, float)[..., None]
    beyond = np.maximum(x - [*VERTICAL_KNOTS_M, STRAIGHT_FROM_M], 0)
    square = beyond * beyond
    rises = np.concatenate([x * x / 2, square * beyond / 6], axis=-1) @ _TO_SLOPES
    return rises, np.concatenate([x, square / 2], axis=-1) @ _TO_SLOPES


_ROAD_HEIGHTS = height_and_grade(ROAD_M)[0]


def road_height(lane: np.ndarray, x_m: np.ndarray) -> np.ndarray:
    """Height (N,) of the road of a lane (15,) at distances x (N,), above the plane that the car stands on."""
    return height_and_grade(x_m)[0] @ lane[VERTICAL_CURVATURE]


@dataclass(frozen=True, eq=False)
class Ground:
    """Where the rays to places of the flat view meet the roads of lanes (..., 15).

    Attributes
    ----------
    x_m : ndarray (..., N)
        Distance ahead.
    fall : ndarray (..., N)
        By how much a ray comes nearer to the road there, for each metre ahead.
    rises : ndarray (..., N, 4)
        How much height each number of `VERTICAL_CURVATURE` makes there.
    """

    x_m: np.ndarray
    fall: np.ndarray
    rises: np.ndarray


def intersect_ground(x_m: np.ndarray, lanes: np.ndarray, height_m: float) -> Ground:
    """Where the rays that would meet a flat road at x (N,) meet those of lanes (..., 15).

    The ray to the flat distance x falls by h / x. A camera that looks `pitch` farther down makes that h / x + pitch,
    and the ray meets the road of height z where z + (h / x + pitch) X = h: for a flat road 1/X is straight in 1/x, for
    others nearly so, and looked up.
    """
    lanes = np.asarray(lanes)
    fall, inverse = height_m / x_m + lanes[..., PITCH, None], 1 / ROAD_M
    # what lies lower in the picture than something nearer is hidden behind it
    falls = inverse * (height_m - lanes[..., VERTICAL_CURVATURE] @ _ROAD_HEIGHTS.T)
    falls = np.minimum.accumulate(falls[..., ::-1], axis=-1)[..., ::-1]
    met = np.empty(fall.shape)
    for index in np.ndindex(fall.shape[:-1]):
        met[index] = np.interp(fall[index], falls[index], inverse)
    x = 1 / met
    rises, grades = height_and_grade(x)
    steep = fall + (grades @ lanes[..., VERTICAL_CURVATURE, None])[..., 0]
    return Ground(x, np.maximum(steep, LEAST_FALL * height_m * met), rises)


def flatten(x_m, y_m, angle, ground: Ground, height_m: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where stripes of the flat view lie on the ground: x, y in metres and angle in radians, (..., N) each."""
    share = ground.x_m / x_m
    pace = share * height_m / (x_m * ground.fall)
    slope = (share * np.tan(angle) + (pace - share) * y_m / x_m) / pace
    return ground.x_m, y_m * share, np.arctan(slope)


def lines_on_view(lanes: np.ndarray, x_m: np.ndarray, height_m: float) -> np.ndarray:
    """Lateral places (K, 2, N) of both lines of lanes (K, 15) on the flat grid of a view, at distances x (N,).

    Left line first; NaN where a line does not pass, because it has turned back before or lies behind a crest.
    """
    lanes = np.asarray(lanes)[:, None]
    points = line_points(lanes, SIDES, _along(0.5 * float(x_m.min()), 1.5 * float(x_m.max())))
    x, y = np.maximum(points[..., 0], 0.1), points[..., 1]
    # the ray that meets the road at x, and where it would meet a flat one seen without the pitch
    rise = (height_and_grade(x)[0] @ lanes[..., VERTICAL_CURVATURE, None])[..., 0]
    fall = (height_m - rise) / x - lanes[..., PITCH, None]
    flat_x = height_m / np.maximum(fall, 1e-3)
    flat_y = y / x * flat_x
    back = flat_x[..., 1:] <= flat_x[..., :-1]
    ends = np.where(back.any(axis=-1), back.argmax(axis=-1) + 1, flat_x.shape[-1])
    places = np.empty((*ends.shape, len(x_m)))
    for line, end in np.ndenumerate(ends):
        places[line] = np.interp(x_m, flat_x[line][:end], flat_y[line][:end], left=np.nan, right=np.nan)
    return places


@lru_cache(maxsize=4)
def _along(nearest_m: float, farthest_m: float) -> np.ndarray:
    """Where lines are drawn through: the same places for every frame of a view."""
    return np.geomspace(nearest_m, farthest_m, 120)


def never_zero(curvature: np.ndarray) -> np.ndarray:
    """Curvatures to divide by: what has turned by nothing on a straight road has run as far as the division says."""
    return np.where(curvature == 0, 1e-12, curvature)


def arc_coordinates(x, y, heading, curvature) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Points (..., N) beside arcs (...): (a, turn, 1 - k a, ahead, aside).

    `a` is the distance to the left of the arc, at right angles; `turn` by how much the arc has turned there; `ahead`
    and `aside` are the point's coordinates along and left of the direction in which the arc begins.
    """
    heading, curvature = np.asarray(heading)[..., None], np.asarray(curvature)[..., None]
    sin, cos = np.sin(heading), np.cos(heading)
    ahead, aside = x * cos + y * sin, y * cos - x * sin
    twice = 2 * aside - curvature * (ahead * ahead + aside * aside)
    scale = np.sqrt(np.maximum(1 - curvature * twice, LEAST_SCALE))
    return twice / (1 + scale), np.arctan2(curvature * ahead, 1 - curvature * aside), scale, ahead, aside


def beyond_knots(along_m: np.ndarray) -> np.ndarray:
    """(..., 3, N): how far places along roads (..., N) lie beyond each knot, 0 before it."""
    return np.maximum(along_m[..., None, :] - KNOTS_M[:, None], 0)


def arc_deviation(lanes: np.ndarray, along_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far lanes (..., 15) have left their arc at `along_m` (..., N), and how fast they do: (..., N) each."""
    rate, kinks = lanes[..., RATE, None], lanes[..., RATE_STEPS, None]
    squared = along_m * along_m
    offset, slope = rate * (squared * along_m) / 6, rate * squared / 2
    beyond = beyond_knots(along_m)
    slopes = kinks * np.square(beyond) / 2
    return offset + (slopes * beyond).sum(axis=-2) / 3, slope + slopes.sum(axis=-2)


def line_points(lanes: np.ndarray, side, along_m: np.ndarray) -> np.ndarray:
    """Points (..., N, 2) of lines of lanes (..., 15), metres, where the lanes' middles have run `along_m` (N,).

    `side` is `LEFT_SIDE`, `RIGHT_SIDE` or an array of them that goes with the lanes.
    """
    centre, width, heading, curvature = (lanes[..., k, None] for k in range(RATE))
    curvature = never_zero(curvature)
    turn = curvature * along_m
    chord = 2 * np.sin(turn / 2) / curvature
    offset, slope = arc_deviation(lanes, along_m)
    # where the lane is aslant to its arc, its lines are farther apart, measured at right angles to the arc
    offset = offset + centre + np.asarray(side)[..., None] * width / 2 * np.sqrt(1 + slope * slope)
    points = np.empty((*offset.shape, 2))
    points[..., 0] = chord * np.cos(heading + turn / 2) - offset * np.sin(heading + turn)
    points[..., 1] = chord * np.sin(heading + turn / 2) + offset * np.cos(heading + turn)
    return points


def line_y(x_m: np.ndarray, lane: np.ndarray, side: float) -> np.ndarray:
    """Lateral place of a line of the lane (15,) at distances x (N,); NaN where it has turned back before."""
    centre, width, heading, curvature = lane[:RATE]
    along = np.array(x_m, float)
    # Newton's method for the place along the middle that lies beside x; straight roads need one step
    for _ in range(8):
        direction = heading + curvature * along
        offset, slope = arc_deviation(lane, along)
        offset = offset + centre + side * width / 2 * np.sqrt(1 + slope * slope)
        pace = (1 - curvature * offset) * np.cos(direction) - slope * np.sin(direction)
        step = np.clip((x_m - line_points(lane, side, along)[..., 0]) / np.maximum(pace, 0.1), -5, 5)
        along = along + step
        if np.abs(step).max(initial=0.0) < 1e-6:
            break  # the next would be smaller than what rounding leaves
    points = line_points(lane, side, along)
    return np.where((np.abs(points[..., 0] - x_m) < 1e-3) & (pace > 0.1), points[..., 1], np.nan)


def lateral_gradient(x_m: float, side: float) -> np.ndarray:
    """(15,): how a line's lateral place `x_m` ahead moves with each number of a nearly straight lane."""
    beyond = beyond_knots(np.array([x_m]))[:, 0]
    gradient = np.zeros(PARAMETERS)
    gradient[:PITCH] = 1, side / 2, x_m, x_m**2 / 2, x_m**3 / 6
    gradient[RATE_STEPS] = beyond**3 / 6
    return gradient


def line_coefficients(lane: np.ndarray, side: float) -> tuple[float, float, float, float]:
    """(c0, c1, c2, c3) of y = c0 + c1 x + c2 x^2 / 2 + c3 x^3 / 6: the line's Taylor series where it passes the car.

    A line that turns back before it would pass the car is taken to pass it `STEEPEST`.
    """
    centre, width, heading, curvature, rate = lane[:PITCH]
    offset = centre + side * width / 2
    scale = 1 - curvature * offset
    # the concentric circle, where it crosses x = 0
    sin, curvature = min(max(np.sin(heading) / scale, -STEEPEST), STEEPEST), curvature / scale
    cos = np.sqrt(1 - sin * sin)
    c0 = offset * (1 + scale) / (np.cos(heading) + scale * cos)
    return float(c0), float(sin / cos), float(curvature / cos**3), float(rate + 3 * curvature**2 * sin / cos**5)


def prior_std(lanes: np.ndarray, *, extra_vertical_per_m: float = 0.0) -> np.ndarray:
    """Standard deviations (K, 15) of what is known before looking: a bent road may also change its bend soon.

    `extra_vertical_per_m` is by how much more than usual the road may curve up and down.
    """
    std = np.tile(PRIOR_STD, (len(lanes), 1))
    changing = np.abs(lanes[:, CURVATURE]) / TRANSITION_M
    std[:, CURVATURE] += CURVATURE_SHARE * np.abs(lanes[:, CURVATURE])
    std[:, RATE] += changing
    std[:, RATE_STEPS] += (KINK_SHARE * (changing + np.abs(lanes[:, RATE])))[:, None]
    std[:, VERTICAL_CURVATURE] += extra_vertical_per_m
    std[:, VERTICAL_CURVATURE] += VERTICAL_SHARE * np.maximum(np.abs(lanes[:, CURVATURE]) - GENTLE_PER_M, 0)[:, None]
    std[:, VERTICAL_CURVATURE] += WAVE_SHARE * np.abs(lanes[:, VERTICAL_CURVATURE]).max(axis=1, keepdims=True)
    return std


def squared_mahalanobis(lanes: np.ndarray) -> np.ndarray:
    """(K,) squared distance from what is usual, in standard deviations."""
    return np.square((lanes - PRIOR_MEAN) / prior_std(lanes)).sum(axis=1)
