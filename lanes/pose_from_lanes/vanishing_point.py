"""Vanishing point of the lane lines of one picture, from straight and from curved lines.

Measure y downward from the horizon, in ray coordinates, and all lengths in camera heights. On a flat road the picture
row y then shows the distance X = 1 / y. A lane line with lateral position q (positive right), heading a and curvature b
runs along Q = q + a X + b X^2 / 2. It appears at x = Q / X, that is

    x = x0 + k (y - y0) + c / (y - y0)

with k = q, x0 = a (plus the yaw of the camera) and c = b / 2. Parallel lines share x0, y0 and c; only k differs between
lines. A curve therefore does not bias the horizon y0: its curvature goes into c. Among parallel arcs the inner one has
the larger curvature b / (1 - b q). The fit approximates this by c (1 + 2 c k); without it, a curve of 60 m radius
causes an error of 0.2 degrees.

The derivative of the equation eliminates k. Each segment (x, y, slope) then votes for

    x0 = x - slope (y - y0) - 2 c / (y - y0)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lanes.pose_from_lanes.segments import Segments

# Bins of the Hough accumulator. y0: camera pitches from -14 to 19 degrees. x0: directions within 27 degrees. c: curve
# radii down to 33 m at a camera height of 1.3 m (c = height / 2R), with finer steps for nearly straight roads.
Y0_BINS = np.arange(-0.34, 0.25, 0.005)
X0_BINS = np.arange(-0.5, 0.5, 0.006)
HALF_CURVATURE_BINS = 2e-4 * np.arange(-10, 11) * np.abs(np.arange(-10, 11))
# Segments closer to the horizon (beyond about 40 m) are not used: hills and changes of curvature dominate there.
MIN_BELOW_HORIZON = 0.03
# Lines farther to the side, in camera heights, do not belong to the ego lane or to its neighbours.
MAX_LATERAL = 6.0
# Segments closer than this (about 0.25 m) belong to one line: a double line, or two segments of one line.
SAME_LINE_DISTANCE = 0.18
# Standard deviation of the model. Near: half a pixel at a focal length of 1000 px. Far: hills and changes of curvature,
# whose effect grows with the square of the distance in camera heights: 2 px at 25 m, 8 px at 50 m.
NEAR_STD, FAR_STD = 5e-4, 5e-6
# Prior standard deviation of c; a radius of about 60 m is one standard deviation.
HALF_CURVATURE_STD = 0.01
# Segments with a larger residual, in standard deviations, are outliers.
GATE_STDS = 3.0
# A long segment votes with no more rows than this, because its rows are not independent.
MAX_VOTING_ROWS = 12
# Share of a vote that also goes to both neighbouring bins of x0.
NEIGHBOUR_VOTE = 0.7


@dataclass(frozen=True)
class RoadLines:
    """Parallel lines of one picture, in the symbols of the module docstring; standard deviations include the prior."""

    x0: float
    y0: float
    half_curvature: float  # c
    x0_std: float
    y0_std: float
    lateral: np.ndarray  # k of each line (M,), from left to right
    rows: np.ndarray  # number of picture rows that support each line (M,)


def hough_votes(segments: Segments, y0_bins: np.ndarray = Y0_BINS) -> np.ndarray:
    """Hough accumulator of one picture over y0, c and x0: the number of stripe rows that agree with each bin.

    Its shape is (len(y0_bins), len(HALF_CURVATURE_BINS), len(X0_BINS)).
    """
    t = segments.y - y0_bins[:, None, None]
    below = t > MIN_BELOW_HORIZON
    t = np.where(below, t, 1.0)
    x0 = segments.x - segments.slope * t - 2 * HALF_CURVATURE_BINS[:, None] / t
    k = segments.slope + HALF_CURVATURE_BINS[:, None] / t**2
    step = X0_BINS[1] - X0_BINS[0]
    x0_bin = np.round((x0 - X0_BINS[0]) / step).astype(int)
    valid = below & (np.abs(k) < MAX_LATERAL) & (x0_bin >= 0) & (x0_bin < len(X0_BINS))
    std = np.hypot(_model_std(segments, t), t * segments.slope_std)
    # An uncertain segment would spread over many bins; it votes for one, with a proportionally smaller weight.
    weight = np.broadcast_to(np.minimum(segments.rows, MAX_VOTING_ROWS) * step / np.maximum(std, step), x0_bin.shape)
    shape = (len(y0_bins), len(HALF_CURVATURE_BINS), len(X0_BINS))
    flat_bin = x0_bin + len(X0_BINS) * np.arange(shape[0] * shape[1]).reshape(shape[0], -1, 1)
    votes = np.bincount(flat_bin[valid], weight[valid], np.prod(shape)).reshape(shape)
    neighbours = np.zeros(shape)
    neighbours[..., 1:] += votes[..., :-1]
    neighbours[..., :-1] += votes[..., 1:]
    return votes + NEIGHBOUR_VOTE * neighbours


def fit_parallel_lines(segments: Segments, y0: float, y0_std: float) -> RoadLines | None:
    """Fit one set of parallel lines to the segments of one picture; None if fewer than two lines agree.

    The start comes from Hough votes; then outlier rejection and robust least squares alternate. `y0` and `y0_std` are
    the prior mean and standard deviation of the horizon.
    """
    s = segments.select(segments.y - y0 > MIN_BELOW_HORIZON)
    y0_bins = y0 + y0_std * np.linspace(-2, 2, 9)
    votes = hough_votes(s, y0_bins) * np.exp(-0.5 * ((y0_bins - y0) / y0_std) ** 2)[:, None, None]
    if votes.max() <= 0:
        return None
    best = np.unravel_index(votes.argmax(), votes.shape)
    start = np.array([X0_BINS[best[2]], y0_bins[best[0]], HALF_CURVATURE_BINS[best[1]]])
    # The start is only as accurate as the bins; later iterations do not need this tolerance.
    x0_tolerance = X0_BINS[1] - X0_BINS[0]
    for _ in range(5):
        inliers, line = _assign_to_lines(s, start, x0_tolerance)
        if line.max(initial=-1) < 1:
            return None
        solution, covariance = _solve(s.select(inliers), line, start, (y0, y0_std))
        start, x0_tolerance = solution[:3], 0.0
    x0, y0, half_curvature = solution[:3]
    x0_std, y0_std = np.sqrt(np.diag(covariance)[:2])
    return RoadLines(x0, y0, half_curvature, x0_std, y0_std, solution[3:], np.bincount(line, s.rows[inliers]))


def _model_std(s: Segments, t: np.ndarray) -> np.ndarray:
    return np.sqrt(s.x_std**2 + NEAR_STD**2 + (FAR_STD / t**2) ** 2)


def _assign_to_lines(s: Segments, start: np.ndarray, x0_tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the segments that agree with (x0, y0, c), and for each the index of its line, from left to right."""
    x0, y0, c = start
    t = s.y - y0
    below = t > MIN_BELOW_HORIZON / 2
    t = np.where(below, t, 1.0)
    k = (s.x - x0 - c / t) / t
    line_c = c * (1 + 2 * c * k)
    k = (s.x - x0 - line_c / t) / t
    residual = s.slope + line_c / t**2 - k
    std = np.hypot(_model_std(s, t) / t, s.slope_std) + x0_tolerance / t
    inliers = np.flatnonzero(below & (np.abs(residual) < GATE_STDS * std) & (np.abs(k) < MAX_LATERAL))
    inliers = inliers[np.argsort(k[inliers])]
    return inliers, np.cumsum(np.diff(k[inliers], prepend=-np.inf) > SAME_LINE_DISTANCE) - 1


def _solve(
    s: Segments, line: np.ndarray, start: np.ndarray, horizon: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Robust least squares for (x0, y0, c, k of each line) by Gauss-Newton; the solution and its covariance."""
    one_hot = np.eye(line[-1] + 1)[line]
    x_std = _model_std(s, s.y - start[1])
    std = np.concatenate([x_std, np.hypot(s.slope_std, x_std)])
    parameters = np.concatenate([start, np.zeros(one_hot.shape[1])])
    # Prior of the horizon and of c; the small value keeps the normal matrix invertible.
    prior, information = np.zeros_like(parameters), np.full_like(parameters, 1e-6)
    prior[1], information[1:3] = horizon[0], (horizon[1] ** -2, HALF_CURVATURE_STD**-2)
    for _ in range(4):
        residual, jacobian = _residuals(s, parameters, line, one_hot)
        residual, jacobian = residual / std, jacobian / std[:, None]
        # Cauchy weights: a segment at two standard deviations has half the weight.
        weight = 1 / (1 + (residual / 2) ** 2)
        normal = jacobian.T @ (jacobian * weight[:, None]) + np.diag(information)
        gradient = jacobian.T @ (residual * weight) + information * (prior - parameters)
        parameters = parameters + np.linalg.solve(normal, gradient)
    return parameters, np.linalg.inv(normal)


def _residuals(
    s: Segments, parameters: np.ndarray, line: np.ndarray, one_hot: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (2N,) of the positions and slopes of N segments, and the Jacobian (2N, parameters) of the model."""
    x0, y0, c, k = parameters[0], parameters[1], parameters[2], parameters[3:][line]
    t = np.maximum(s.y - y0, MIN_BELOW_HORIZON / 2)
    # Curvature of each line, and its derivatives with respect to c and k.
    line_c, by_c, by_k = c * (1 + 2 * c * k), 1 + 4 * c * k, 2 * c**2
    residual = np.concatenate([s.x - x0 - k * t - line_c / t, s.slope - k + line_c / t**2])
    of_x = np.column_stack([np.ones_like(t), line_c / t**2 - k, by_c / t, one_hot * (t + by_k / t)[:, None]])
    of_slope = np.column_stack(
        [np.zeros_like(t), -2 * line_c / t**3, -by_c / t**2, one_hot * (1 - by_k / t**2)[:, None]]
    )
    return residual, np.vstack([of_x, of_slope])
