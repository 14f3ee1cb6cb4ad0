"""Where could a lane be? The histogram of the course's first half, generalised to roads that bend.

For each hypothesis of heading, curvature and pitch the stripes are laid out straight, by their distance from its arc,
and counted in bins: a line that follows the hypothesis piles up in one bin, whatever its shape on the road. Stripes
whose own direction contradicts the hypothesis do not count (votes with directions: Ballard's generalised Hough
transform, 1981). Peaks to the left and to the right of the car are then paired by how wide and where lanes are.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from lanes.tracking.markings import ANGLE_STD_RAD, Stripes, marking_weight
from lanes.tracking.model import (
    CENTRE,
    CURVATURE,
    HEADING,
    LEAST_SCALE,
    PARAMETERS,
    PITCH,
    PRIOR_MEAN,
    PRIOR_STD,
    WIDTH,
    flatten,
    intersect_ground,
)

# Votes come from the near road, where one arc is enough; the fit finds its way from there.
VOTING_FAR_M = 22.0
BIN_M, BINS = 0.15, 60
# Lines are looked for so far to either side, metres.
LINE_FROM_M, LINE_TO_M = 0.3, 3.6
# A stripe between two bins counts for both: share of the neighbours' votes that a bin gets.
NEIGHBOUR = 0.6
# How much one squared standard deviation from the usual costs, beside the square roots of two lines' supports.
VOTE_PRIOR_WEIGHT = 0.05
# Hypotheses worth pairing, and two lanes that one fit would make the same.
PAIRED = 300
DUPLICATE_M, DUPLICATE_BEND, DUPLICATE_CURVATURE_PER_M = 0.35, 0.3, 0.002


@lru_cache(maxsize=1)
def hypotheses() -> np.ndarray:
    """(H, 3): heading, curvature and pitch; dense where roads usually are, down to a radius of 15 m."""
    grids = np.meshgrid(_spread(6, 0.03, 0.18), _spread(11, 0.0015, 0.24), np.arange(-1, 2) * 0.018, indexing="ij")
    return np.stack([grid.ravel() for grid in grids], axis=1)


def _spread(count: int, step: float, growth: float) -> np.ndarray:
    """Zero and `count` values to either side, first a `step` apart and then ever more."""
    k = np.arange(-count, count + 1)
    return np.sign(k) * step * np.expm1(np.abs(k) * growth) / growth


def count_votes(stripes: Stripes, height_m: float) -> np.ndarray:
    """Count the stripes by their distance left of each hypothesis' arc.

    Parameters
    ----------
    stripes : Stripes
    height_m : float
        Of the camera, because the pitch belongs to the hypothesis.

    Returns
    -------
    ndarray of shape (H, BINS)
        Weighted votes; bin b is centred on (b + 1/2 - BINS / 2) * BIN_M metres.
    """
    near = stripes.select(stripes.x_m < VOTING_FAR_M)
    paint = marking_weight(near).astype(np.float32)
    heading, curvature, pitch = hypotheses().T
    votes = np.zeros((len(heading), BINS))
    for tilt in np.unique(pitch):
        of = np.flatnonzero(pitch == tilt)
        tilted = np.zeros(PARAMETERS)
        tilted[PITCH] = tilt
        places = flatten(near.x_m, near.y_m, near.angle, intersect_ground(near.x_m, tilted, height_m), height_m)
        bins, agreement = _bins_and_agreement(*places, heading[of], curvature[of])
        bins += BINS * np.arange(len(of))[:, None]
        votes[of] = np.bincount(bins.ravel(), (agreement * paint).ravel(), len(of) * BINS).reshape(-1, BINS)
    # the outermost bins hold everything beyond
    votes[:, [0, -1]] = 0
    return votes


def _bins_and_agreement(x, y, angle, heading, curvature) -> tuple[np.ndarray, np.ndarray]:
    """For each hypothesis and stripe: the bin that it falls into, int, and how well its direction agrees, 0 to 1.

    The same geometry as `lanemodel.place`, with all sums of products made by two products of matrices, and in float32:
    bins are coarse, and this table is what a search takes longest for.
    """
    sin, cos = np.sin(heading), np.cos(heading)
    across, front = np.sin(angle), np.cos(angle)
    twice = _sums_of_products((2 * cos, -2 * sin, -curvature), (y, x, x * x + y * y))
    astray = _sums_of_products((sin, -cos, curvature), (front, across, x * front + y * across))
    astray *= 1 / ANGLE_STD_RAD
    squared_scale = np.maximum(1 - curvature.astype(np.float32)[:, None] * twice, LEAST_SCALE)
    # in place where possible: half of the time goes into finding memory
    a = np.divide(twice, 1 + np.sqrt(squared_scale), out=twice)
    a *= 1 / BIN_M
    a += BINS / 2
    agreement = np.multiply(astray, astray, out=astray)
    agreement += squared_scale
    np.divide(squared_scale, agreement, out=agreement)
    np.square(agreement, out=agreement)
    return np.clip(a, 0, BINS - 1, out=a).astype(np.intp), agreement


def _sums_of_products(of_hypotheses: tuple, of_stripes: tuple) -> np.ndarray:
    """(hypotheses, stripes) sums over pairs of factors, float32."""
    return np.stack(of_hypotheses, axis=1).astype(np.float32) @ np.stack(of_stripes).astype(np.float32)


def best_pairs(votes: np.ndarray, rows: int, *, most: int = 5) -> np.ndarray:
    """Pair lines to lanes.

    Parameters
    ----------
    votes : ndarray of shape (H, BINS)
        From `count_votes`.
    rows : int
        How many votes a perfect solid line would get.
    most : int

    Returns
    -------
    ndarray of shape (K, 15), K <= `most`
        Lanes as in `lanemodel`, best first, no two alike. The square root of each line's votes counts, so that
        two fair lines beat one good line beside nothing.
    """
    guess = hypotheses()
    shared = votes.copy()
    shared[:, 1:-1] += NEIGHBOUR * (votes[:, :-2] + votes[:, 2:])
    # float32, because all pairs of all hypotheses are 145,000 numbers
    support = np.sqrt(shared / rows).astype(np.float32)
    middle = (np.arange(BINS) + 0.5 - BINS / 2) * BIN_M
    left = np.flatnonzero((middle > LINE_FROM_M) & (middle < LINE_TO_M))
    right = np.flatnonzero((middle < -LINE_FROM_M) & (middle > -LINE_TO_M))
    unusual = (guess / PRIOR_STD[[HEADING, CURVATURE, PITCH]]) ** 2
    worth = support[:, left].max(1) + support[:, right].max(1) - VOTE_PRIOR_WEIGHT * unusual.sum(1)
    kept = np.argsort(-worth, kind="stable")[:PAIRED]
    width, centre = middle[left, None] - middle[right], (middle[left, None] + middle[right]) / 2
    odd = ((width - PRIOR_MEAN[WIDTH]) / PRIOR_STD[WIDTH]) ** 2 + (
        (centre - PRIOR_MEAN[CENTRE]) / PRIOR_STD[CENTRE]
    ) ** 2
    score = support[kept][:, left, None] + support[kept][:, None, right]
    score -= (VOTE_PRIOR_WEIGHT * odd).astype(np.float32)
    score = score.reshape(len(kept), -1)
    pair = score.argmax(axis=1)
    best = score[np.arange(len(kept)), pair] - VOTE_PRIOR_WEIGHT * unusual[kept].sum(1)
    lanes = np.zeros((len(kept), len(PRIOR_MEAN)))
    lanes[:, CENTRE], lanes[:, WIDTH] = centre.ravel()[pair], width.ravel()[pair]
    lanes[:, [HEADING, CURVATURE, PITCH]] = guess[kept]
    return suppress_non_maxima(lanes[np.argsort(-best, kind="stable")], most)


def suppress_non_maxima(lanes: np.ndarray, most: int, *, same_pitch_rad: float = np.inf) -> np.ndarray:
    """The first `most` of the lanes (N, 15) that differ from all before them, be it only by so much pitch."""
    chosen, free = [], np.ones(len(lanes), bool)
    while len(chosen) < most and free.any():
        chosen.append(free.argmax())
        off = np.abs(lanes - lanes[chosen[-1]])
        elsewhere = (np.maximum(off[:, CENTRE], off[:, WIDTH]) > DUPLICATE_M) | (off[:, PITCH] > same_pitch_rad)
        free &= elsewhere | (
            off[:, CURVATURE] > DUPLICATE_BEND * np.abs(lanes[:, CURVATURE]) + DUPLICATE_CURVATURE_PER_M
        )
    return lanes[chosen]
