"""Process noise: variances that are added to the Kalman state between two frames."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp

import numpy as np

from lanes.tracking.car import CAMERA_YAW, PATH, REST_PITCH, SPEED, STATES
from lanes.tracking.model import (
    ADJACENT,
    CENTRE,
    CURVATURE,
    HEADING,
    KNOTS_M,
    PARAMETERS,
    PITCH,
    PRIOR,
    RATE,
    RATE_STEPS,
    VERTICAL_CURVATURE,
    WIDTH,
)

# The rate at the car and its steps at the knots: the curvature in x metres is the sum of their integrals.
RATE_CHAIN = np.array([RATE, *range(PARAMETERS)[RATE_STEPS]])


@dataclass(frozen=True)
class ProcessNoise:
    """Standard deviations added in one second (`_per_s`) or in one metre of road (`_per_m`); their squares add up.

    A `_share` multiplies a curvature of the road, 1/m. Tuned on the rendered suite where no source is given.
    """

    # Crosswind and banked roads; bumps; slow changes of load and of the camera's mounting.
    centre_m_per_s: float = 0.015
    heading_rad_per_s: float = 0.003
    pitch_rad_per_s: float = 0.01
    rest_pitch_rad_per_s: float = 1e-3
    camera_yaw_rad_per_s: float = 1e-4
    # Steering, on a straight road and in a bend; pedals.
    path_per_m_per_s: float = 1e-3
    path_share_per_s: float = 0.3
    speed_mps_per_s: float = 1.0
    # Varying tyre slip in bends.
    camera_yaw_share_per_s: float = 0.15
    centre_share_per_m: float = 0.3
    # Width of this lane and of the adjacent ones.
    width_m_per_m: float = 0.004
    # Curvature, and its rate: 5e-5 1/m^2 within 70 m on motorways; on mountain roads more, as the square of the
    # curvature (a transition curve is about as long as the radius of its bend allows).
    curvature_per_m_per_m: float = 3e-6
    rate_per_m2_per_m: float = 6e-6
    rate_square_share: float = 1.0
    # Rate steps: small on motorways, up to those of a hairpin where the road bends more.
    rate_step_per_m2_per_m: float = 5e-5
    rate_step_share: float = 0.2
    max_rate_step_per_m2_per_m: float = 4e-3
    # Vertical curvature that comes into view beyond the last knot: base value, growth with the curvature and with the
    # largest vertical curvature of the lane; the maximum is a radius of 170 m, at which cars leave the ground.
    vertical_per_m: float = 3e-4
    vertical_bend_share: float = 0.03
    vertical_share: float = 1.0
    max_vertical_per_m: float = 6e-3
    # Distance over which it is forgotten, and the share of the noise at each knot: at the nearer ones it is known from
    # before, and the noise accounts for the interpolation between knots.
    vertical_decay_m: float = 20.0
    vertical_knot_shares: tuple[float, ...] = (0.3, 0.3, 0.5, 1.0)
    # A bend within this distance counts as if the car were in it.
    bend_ahead_m: float = 25.0
    # Extra noise for abrupt changes of vertical curvature, curvature rate and pitch, see `KalmanState.inflated`.
    inflated_vertical_per_m: float = 6e-3
    inflated_rate_step_per_m2: float = 3e-3
    inflated_pitch_rad: float = 0.015


PROCESS_NOISE = ProcessNoise()
_VERTICAL_KNOT_SHARES = np.array(PROCESS_NOISE.vertical_knot_shares)


def max_curvature(lane: np.ndarray) -> float:
    """Largest curvature of the road (15,) here or soon, 1/m: expected changes are proportional to it."""
    ahead = PROCESS_NOISE.bend_ahead_m - np.concatenate([[0.0], KNOTS_M])
    return float(max(abs(lane[CURVATURE]), abs(lane[CURVATURE] + np.maximum(ahead, 0) @ lane[RATE_CHAIN])))


def max_vertical_curvature(lane: np.ndarray) -> float:
    """Largest vertical curvature of the road (15,) in view, 1/m."""
    return float(np.abs(lane[VERTICAL_CURVATURE]).max())


def process_noise(lane: np.ndarray, distance_m: float, elapsed_s: float, *, steady_speed: bool) -> np.ndarray:
    """(19,) variances that one prediction adds.

    Parameters
    ----------
    lane : ndarray (15,)
    distance_m, elapsed_s : float
        Since the last frame.
    steady_speed : bool
        The speed is given: no noise is added to it.
    """
    n = PROCESS_NOISE
    per_s, per_m = np.zeros(STATES), np.zeros(STATES)
    curvature = max_curvature(lane)
    excess = max(curvature - PRIOR.motorway_curvature_per_m, 0.0)
    per_s[CENTRE], per_s[HEADING], per_s[PITCH] = n.centre_m_per_s, n.heading_rad_per_s, n.pitch_rad_per_s
    per_s[REST_PITCH] = n.rest_pitch_rad_per_s
    per_s[CAMERA_YAW] = n.camera_yaw_rad_per_s + n.camera_yaw_share_per_s * excess
    per_s[PATH] = n.path_per_m_per_s + n.path_share_per_s * curvature
    per_s[SPEED] = 0.0 if steady_speed else n.speed_mps_per_s
    per_m[CENTRE] = n.centre_share_per_m * excess
    per_m[WIDTH] = per_m[ADJACENT] = n.width_m_per_m
    per_m[CURVATURE] = n.curvature_per_m_per_m
    per_m[RATE] = n.rate_per_m2_per_m + n.rate_square_share * curvature**2
    per_m[RATE_STEPS] = min(n.rate_step_per_m2_per_m + n.rate_step_share * excess, n.max_rate_step_per_m2_per_m)
    variance = per_s**2 * elapsed_s + per_m**2 * abs(distance_m)
    vertical = n.vertical_per_m + n.vertical_bend_share * excess + n.vertical_share * max_vertical_curvature(lane)
    vertical_std = min(vertical, n.max_vertical_per_m) * _VERTICAL_KNOT_SHARES
    variance[VERTICAL_CURVATURE] = np.square(vertical_std) * (1 - exp(-2 * abs(distance_m) / n.vertical_decay_m))
    return variance
