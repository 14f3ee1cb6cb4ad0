"""Where the lines of one road meet: a vanishing point from straight and from curved stripes.

On a flat road, with y measured down from the horizon and all lengths in camera heights, a row y shows the distance
X = 1 / y. A lane line of lateral position q (right), heading a and curvature b runs through Q = q + a X + b X^2 / 2
and appears at x = Q / X, that is

    x = x0 + k (y - y0) + c / (y - y0)

with k = q, x0 = a (plus the camera's yaw) and c = b / 2. Parallel lines share x0, y0 and c; only k is each line's own.
So a curve does no harm: its c carries the curvature, and y0 stays the horizon. (Of parallel arcs the inner one bends
more, b / (1 - b q), which the fit takes as c (1 + 2 c k); without that, a bend of 60 m radius costs 0.2 degrees.)
Differentiated, and with k eliminated, a piece of stripe (x, y, slope) alone votes for

    x0 = x - slope (y - y0) - 2 c / (y - y0)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lanes.camera.pose_from_lanes.segments import Segments

# Votes: horizons of cameras pitched -14 to 19 degrees, directions within 27 degrees, curves down to a radius of 33 m
# below a camera at 1.3 m (c = height / 2R), finer where roads are nearly straight.
HORIZONS = np.arange(-0.34, 0.25, 0.005)
DIRECTIONS = np.arange(-0.5, 0.5, 0.006)
BENDS = 2e-4 * np.arange(-10, 11) * np.abs(np.arange(-10, 11))
# Nearer to the horizon than this (beyond about 40 m) hills and changing curvature rule.
NEAREST_TO_HORIZON = 0.03
# Lines further to the side than this many camera heights are not the ego lane's or its neighbours'.
WIDEST_LINE = 6.0
# Stripes closer than this (about 0.25 m) are one line: a double line, or two pieces of one.
SAME_LINE = 0.18
# How far off a line may be without being wrong: half a pixel at a focal length of 1000, and the share of hills and of
# changing curvature, which grows with the square of the distance (in camera heights): 2 px at 25 m, 8 px at 50 m.
NEAR_STD, FAR_STD = 5e-4, 5e-6
# Bends of lanes, as c: a radius of about 60 m is one standard deviation.
BEND_STD = 0.01
# Beyond this many standard deviations a piece does not belong.
GATE = 3.0


@dataclass(frozen=True)
class RoadLines:
    """The parallel lines found in one picture.

    Attributes
    ----------
    x0, y0, bend : float
        Vanishing point in ray coordinates, and c of the module docstring.
    x0_std, y0_std : float
        Standard deviations, the prior included.
    k : ndarray of shape (M,)
        The lines from left to right: lateral position (right) in camera heights.
    rows : ndarray of shape (M,)
        Frame rows that carry each line.
    """

    x0: float
    y0: float
    bend: float
    x0_std: float
    y0_std: float
    k: np.ndarray
    rows: np.ndarray


def vote(segments: Segments, horizons: np.ndarray = HORIZONS) -> np.ndarray:
    """Votes of one picture's pieces for every horizon, bend and direction.

    Parameters
    ----------
    segments : Segments
        Pieces of stripes of one picture.
    horizons : ndarray of shape (H,)
        Values of y0 to try.

    Returns
    -------
    ndarray of shape (H, len(BENDS), len(DIRECTIONS)), float
        Frame rows of stripe that agree.
    """
    t = segments.y - horizons[:, None, None]
    below = t > NEAREST_TO_HORIZON
    t = np.where(below, t, 1.0)
    x0 = segments.x - segments.slope * t - 2 * BENDS[:, None] / t
    k = segments.slope + BENDS[:, None] / t**2
    step = DIRECTIONS[1] - DIRECTIONS[0]
    cell = np.round((x0 - DIRECTIONS[0]) / step).astype(int)
    heard = below & (np.abs(k) < WIDEST_LINE) & (cell >= 0) & (cell < len(DIRECTIONS))
    std = np.hypot(_model_std(segments, t), t * segments.slope_std)
    # A long line is one witness, not a hundred; a vague one spreads over more cells than it is given here.
    weight = np.broadcast_to(np.minimum(segments.rows, 12) * step / np.maximum(std, step), cell.shape)
    ballot = cell + len(DIRECTIONS) * np.arange(len(horizons) * len(BENDS)).reshape(len(horizons), -1, 1)
    shape = (len(horizons), len(BENDS), len(DIRECTIONS))
    votes = np.bincount(ballot[heard], weight[heard], np.prod(shape)).reshape(shape)
    beside = np.zeros(shape)
    beside[..., 1:] += votes[..., :-1]
    beside[..., :-1] += votes[..., 1:]
    return votes + 0.7 * beside


def _model_std(s: Segments, t: np.ndarray) -> np.ndarray:
    return np.sqrt(s.x_std**2 + NEAR_STD**2 + (FAR_STD / t**2) ** 2)


def fit_lines(segments: Segments, y0: float, y0_std: float) -> RoadLines | None:
    """Fit one set of parallel lines to the pieces of one picture.

    Parameters
    ----------
    segments : Segments
        Pieces of stripes of one picture.
    y0, y0_std : float
        What is known about the horizon.

    Returns
    -------
    RoadLines or None
        None if fewer than two lines agree.
    """
    s = segments.select(segments.y - y0 > NEAREST_TO_HORIZON)
    near = y0 + y0_std * np.linspace(-2, 2, 9)
    votes = vote(s, near) * np.exp(-0.5 * ((near - y0) / y0_std) ** 2)[:, None, None]
    if votes.max() <= 0:
        return None
    at = np.unravel_index(votes.argmax(), votes.shape)
    start, slack = np.array([DIRECTIONS[at[2]], near[at[0]], BENDS[at[1]]]), DIRECTIONS[1] - DIRECTIONS[0]
    for _ in range(5):
        chosen, line = _assign(s, start, slack)
        if line.max(initial=-1) < 1:
            return None
        solution, covariance = _solve(s.select(chosen), line, start, (y0, y0_std))
        start, slack = solution[:3], 0.0
    x0, y0, bend = solution[:3]
    x0_std, y0_std = np.sqrt(np.diag(covariance)[:2])
    return RoadLines(x0, y0, bend, x0_std, y0_std, solution[3:], np.bincount(line, s.rows[chosen]))


def _assign(s: Segments, start: np.ndarray, slack: float) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the pieces that fit (x0, y0, c), and the number of the line each belongs to, from left to right."""
    x0, y0, bend = start
    t = s.y - y0
    below = t > NEAREST_TO_HORIZON / 2
    t = np.where(below, t, 1.0)
    k = (s.x - x0 - bend / t) / t
    own_bend = bend * (1 + 2 * bend * k)
    k = (s.x - x0 - own_bend / t) / t
    miss = s.slope + own_bend / t**2 - k
    std = np.hypot(_model_std(s, t) / t, s.slope_std) + slack / t
    chosen = np.flatnonzero(below & (np.abs(miss) < GATE * std) & (np.abs(k) < WIDEST_LINE))
    chosen = chosen[np.argsort(k[chosen])]
    return chosen, np.cumsum(np.diff(k[chosen], prepend=-np.inf) > SAME_LINE) - 1


def _solve(
    s: Segments, line: np.ndarray, start: np.ndarray, horizon: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Robust least squares for (x0, y0, c, k of each line) by Gauss-Newton; the solution and its covariance."""
    lines = np.eye(line[-1] + 1)[line]
    position_std = _model_std(s, s.y - start[1])
    std = np.concatenate([position_std, np.hypot(s.slope_std, position_std)])
    # What is known beforehand: the horizon, that bends are gentle, and next to nothing of the rest.
    p = np.concatenate([start, np.zeros(lines.shape[1])])
    known, information = np.zeros_like(p), np.full_like(p, 1e-6)
    known[1], information[1:3] = horizon[0], (horizon[1] ** -2, BEND_STD**-2)
    for _ in range(4):
        x0, y0, c, k = p[0], p[1], p[2], p[3:][line]
        t = np.maximum(s.y - y0, NEAREST_TO_HORIZON / 2)
        own, by_c, by_k = c * (1 + 2 * c * k), 1 + 4 * c * k, 2 * c**2
        miss = np.concatenate([s.x - x0 - k * t - own / t, s.slope - k + own / t**2]) / std
        place = np.column_stack([np.ones_like(t), own / t**2 - k, by_c / t, lines * (t + by_k / t)[:, None]])
        slope = np.column_stack([np.zeros_like(t), -2 * own / t**3, -by_c / t**2, lines * (1 - by_k / t**2)[:, None]])
        design = np.vstack([place, slope]) / std[:, None]
        # Cauchy's weights: a piece two standard deviations off counts half.
        weight = 1 / (1 + (miss / 2) ** 2)
        normal = design.T @ (design * weight[:, None]) + np.diag(information)
        p = p + np.linalg.solve(normal, design.T @ (miss * weight) + information * (known - p))
    return p, np.linalg.inv(normal)
