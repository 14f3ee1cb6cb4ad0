"""One model for both lines: where the lane is, which way it goes and bends, and how tilted the camera looks at it.

Seven numbers describe the lane. The lane's middle is an arc that passes the car at `centre` with `heading` and
`curvature`, which changes by `rate` for each metre ahead; the two lines run half a `width` to its left and right.
`pitch` is how much farther down than its mount says the camera looks in this frame (bumps, brakes), and `vertical` the
curvature of the road upwards (crests and dips): both show in that the lines do not look parallel.

A stripe's distance from the middle arc, taken at right angles, needs no x as the running variable, so that hairpins
that fold back are as good as straight roads:

    a (1 - k a / 2) = y cos h - x sin h - k (x^2 + y^2) / 2        for heading h and curvature k,

which follows from |P - C| = 1/k - a for a circle of centre C; concentric lines then differ in `a` alone. The derivatives
are as short: da = (1 - k a)^-1 (...), with the direction of the road at the stripe as sine and cosine.

All functions are written for several lanes at once, parameters (..., 7), so that rival hypotheses share one pass.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lanes.evidence import Stripes

CENTRE, WIDTH, HEADING, CURVATURE, RATE, PITCH, VERTICAL = range(7)
LEFT, RIGHT = 1.0, -1.0
SIDES = np.array([LEFT, RIGHT])

# What is known of any lane before looking, and its standard deviation: lanes are 2.5 to 4.5 m wide, cars drive near
# their middle and along them, mountain hairpins have radii down to 12 m, cars nod by a degree, crests have radii of
# hundreds of metres.
PRIOR_MEAN = np.array([0.0, 3.5, 0.0, 0.0, 0.0, 0.0, 0.0])
PRIOR_STD = np.array([0.8, 0.5, 0.15, 0.05, 1e-4, 0.015, 2e-4])
# A clothoid takes at least about this far from straight to its bend.
TRANSITION_M = 15.0
LIMIT = np.array([3.0, 6.0, 0.7, 0.12, 0.01, 0.06, 5e-3])

# Strength (times the noise) at which a stripe counts half, and angle by which half a stripe's vote is lost.
HALF_STRENGTH = 6.0
ANGLE_STD_RAD = 0.1
# The fit follows the lines outwards: (how far it looks, how many standard deviations still pull).
START = ((16, 6), (20, 4), (26, 4))
FOLLOW = ((70, 1.5), (70, 1), (70, 1))
GROW = ((34, 3), (44, 3), (56, 2), (70, 2), (70, 1.5), (70, 1))


def flatten(stripes: Stripes, pitch, vertical, height_m: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stripes seen with another pitch, on a road that bends up or down: x, y in metres and angle in radians.

    The ray to a stripe at the flat distance x falls by h / x; a camera that looks `pitch` farther down makes that
    h / x + pitch, and a road that has risen by v x^2 / 2 is met v x / 2 earlier.
    """
    pitch, vertical = np.asarray(pitch)[..., None], np.asarray(vertical)[..., None]
    share = stripes.x_m / height_m
    stretch = np.maximum(1 + pitch * share, 0.2)
    bend = vertical * np.minimum(stripes.x_m / stretch, 80)
    stretch = np.clip(stretch + bend / 2 * share, 0.2, 5)
    change = (pitch + bend) * share
    slope = (stretch * np.tan(stripes.angle) - change * stripes.y_m / stripes.x_m) / np.maximum(stretch - change, 0.1)
    return stripes.x_m / stretch, stripes.y_m / stretch, np.arctan(slope)


def on_view(lane: np.ndarray, side: float, x_m: np.ndarray, height_m: float) -> np.ndarray:
    """Lateral place of a line of the lane (7,) on the flat grid of a view, at the view's distances x (N,)."""
    share = x_m / height_m
    stretch = np.maximum(1 + lane[PITCH] * share, 0.2)
    stretch = np.clip(stretch + lane[VERTICAL] * np.minimum(x_m / stretch, 80) / 2 * share, 0.2, 5)
    return line_y(x_m / stretch, lane, side) * stretch


def place(x, y, heading, curvature) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Distance of points left of an arc, at right angles, with the arc's direction there: (a, sin, cos, 1 - k a)."""
    heading, curvature = np.asarray(heading)[..., None], np.asarray(curvature)[..., None]
    sin, cos = np.sin(heading), np.cos(heading)
    twice = 2 * (y * cos - x * sin) - curvature * (x * x + y * y)
    scale = np.sqrt(np.maximum(1 - curvature * twice, 1e-2))
    return twice / (1 + scale), (sin + curvature * x) / scale, (cos - curvature * y) / scale, scale


def line_points(lane: np.ndarray, side: float, along_m: np.ndarray) -> np.ndarray:
    """Points (N, 2) of a line of the lane (7,), metres, where the lane's middle has run `along_m` (N,)."""
    centre, width, heading, curvature, rate = lane[:PITCH]
    turn = curvature * along_m
    chord = along_m * np.sinc(turn / (2 * np.pi))
    offset = centre + side * width / 2 + rate * along_m**3 / 6
    x = chord * np.cos(heading + turn / 2) - offset * np.sin(heading + turn)
    y = chord * np.sin(heading + turn / 2) + offset * np.cos(heading + turn)
    return np.stack([x, y], axis=-1)


def line_y(x_m: np.ndarray, lane: np.ndarray, side: float) -> np.ndarray:
    """Lateral place of a line of the lane (7,) at distances x (N,); NaN where it has turned back before."""
    centre, width, heading, curvature, rate = lane[:PITCH]
    along = np.array(x_m, float)
    # Newton's method for the place along the middle that lies beside x; straight roads need one step
    for _ in range(6):
        direction = heading + curvature * along
        offset = centre + side * width / 2 + rate * along**3 / 6
        pace = (1 - curvature * offset) * np.cos(direction) - rate * along**2 / 2 * np.sin(direction)
        along = along + np.clip((x_m - line_points(lane, side, along)[..., 0]) / np.maximum(pace, 0.1), -5, 5)
    points = line_points(lane, side, along)
    return np.where((np.abs(points[..., 0] - x_m) < 1e-3) & (pace > 0.1), points[..., 1], np.nan)


def line_coefficients(lane: np.ndarray, side: float) -> tuple[float, float, float, float]:
    """(c0, c1, c2, c3) of y = c0 + c1 x + c2 x^2 / 2 + c3 x^3 / 6: the line's Taylor series where it passes the car."""
    centre, width, heading, curvature, rate = lane[:PITCH]
    (c0,) = line_y(np.zeros(1), lane, side)
    offset = centre + side * width / 2
    curvature = curvature / (1 - curvature * offset)
    sin = np.sin(heading) * curvature * offset + np.sin(heading)
    cos = np.sqrt(1 - sin * sin)
    return float(c0), float(sin / cos), float(curvature / cos**3), float(rate + 3 * curvature**2 * sin / cos**5)


@dataclass(frozen=True)
class LaneFit:
    """Lanes fitted to the stripes of one frame; K of them, or one.

    Attributes
    ----------
    lane : ndarray (..., 7)
        The parameters, in the order of the module's constants.
    information : ndarray (..., 7, 7)
        Inverse covariance, prior included.
    weight : ndarray (..., stripes)
        How much each stripe supports the lane, 0 to 1.
    side : ndarray (..., stripes)
        `LEFT` or `RIGHT`: the line that the stripe is nearer to.
    residual_m : ndarray (..., stripes)
        Distance of each stripe to the left of that line.
    """

    lane: np.ndarray
    information: np.ndarray
    weight: np.ndarray
    side: np.ndarray
    residual_m: np.ndarray


def paint_weight(stripes: Stripes) -> np.ndarray:
    """How likely a stripe is paint, from its strength: 0 to 1."""
    return stripes.strength**2 / (stripes.strength**2 + HALF_STRENGTH**2)


def position_std(stripes: Stripes, focal_px: float) -> np.ndarray:
    """Standard deviation of a stripe's lateral place: worn paint and half a cell near by, one pixel far away."""
    return np.hypot(0.04, stripes.x_m / focal_px)


def usual_information(lanes: np.ndarray) -> np.ndarray:
    """Inverse covariance (K, 7, 7) of what is known before looking: a bent road may also change its bend soon."""
    std = np.broadcast_to(PRIOR_STD, lanes.shape).copy()
    std[:, RATE] += np.abs(lanes[:, CURVATURE]) / TRANSITION_M
    return std[..., None] ** -2 * np.eye(lanes.shape[1])


def strangeness(lanes: np.ndarray) -> np.ndarray:
    """(K,) squared distance from what is usual, in standard deviations."""
    off = lanes - PRIOR_MEAN
    return (off[:, None] @ usual_information(lanes) @ off[..., None])[:, 0, 0]


def fit_lanes(
    lanes: np.ndarray,
    stripes: Stripes,
    height_m: float,
    focal_px: float,
    *,
    prior_mean: np.ndarray = PRIOR_MEAN,
    prior_information: np.ndarray | None = None,
    schedule: tuple = GROW,
) -> LaneFit:
    """Refine lanes (K, 7) by reweighted least squares, following both lines outwards.

    Each step weighs a stripe by its strength, by its distance from the nearer line (Geman-McClure) and by how well its
    direction agrees with the line's, then solves the normal equations together with the prior.

    Parameters
    ----------
    lanes : ndarray (K, 7)
        Starts.
    stripes : Stripes
    height_m, focal_px : float
        Of the camera.
    prior_mean : ndarray (7,)
    prior_information : ndarray (7, 7), optional
        Inverse covariance of the prior; by default `usual_information`.
    schedule : sequence of (far_m, scale)

    Returns
    -------
    LaneFit
    """
    lanes, std, paint = np.array(lanes, float), position_std(stripes, focal_px), paint_weight(stripes)
    information = None
    for far_m, scale in schedule:
        weight, residual, _, derivative = compare(lanes, stripes, height_m, std * scale)
        weight = weight * paint * (stripes.x_m < far_m) / (std * scale) ** 2
        weighted = derivative * weight[..., None]
        prior = usual_information(lanes) if prior_information is None else prior_information
        information = np.swapaxes(derivative, -1, -2) @ weighted + prior
        gradient = (weighted * residual[..., None]).sum(-2) + ((lanes - prior_mean)[:, None] @ prior)[:, 0]
        lanes = lanes - np.linalg.solve(information, gradient[..., None])[..., 0]
        lanes = np.clip(lanes, -LIMIT, LIMIT)
    weight, residual, side, _ = compare(lanes, stripes, height_m, std)
    return LaneFit(lanes, information, weight * paint, side, residual)


def compare(lanes, stripes: Stripes, height_m: float, std_m):
    """How stripes agree with lanes (K, 7): weight 0..1, residual in metres, side, and derivative (K, stripes, 7)."""
    _, _, heading, curvature, rate, pitch, vertical = np.moveaxis(lanes, -1, 0)
    x, y, angle = flatten(stripes, pitch, vertical, height_m)
    a, sin, cos, scale = place(x, y, heading, curvature)
    heading, curvature, rate = heading[..., None], curvature[..., None], rate[..., None]
    sin_0, cos_0 = np.sin(heading), np.cos(heading)
    turn = np.arctan2(sin * cos_0 - cos * sin_0, cos * cos_0 + sin * sin_0)
    bent = np.abs(curvature) > 1e-6
    along = np.where(bent, turn / np.where(bent, curvature, 1), x * cos_0 + y * sin_0)
    from_middle = a - rate * along**3 / 6 - lanes[..., CENTRE, None]
    side = np.where(from_middle >= 0, LEFT, RIGHT)
    residual = from_middle - side * lanes[..., WIDTH, None] / 2
    astray = heading + turn + rate * along**2 / 2 - angle
    weight = ((1 + (residual / std_m) ** 2) * (1 + (astray / ANGLE_STD_RAD) ** 2)) ** -2.0
    tilt = x / height_m * (x * sin - y * cos)
    derivative = np.stack(
        [
            -np.ones_like(a),
            -side / 2,
            -(y * sin_0 + x * cos_0) / scale,
            (a * a - x * x - y * y) / (2 * scale),
            -(along**3) / 6,
            tilt,
            tilt * x / 2,
        ],
        axis=-1,
    )
    return weight, residual, side, derivative
