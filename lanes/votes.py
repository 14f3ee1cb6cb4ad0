"""Where could a lane be? Votes over heading, curvature and pitch: the histogram of the course's first half, generalised.

For each hypothesis the stripes are laid out straight, by their distance from its arc, and counted in bins: a line that
follows the hypothesis piles up in one bin, whatever its shape on the road. Stripes whose own direction contradicts the
hypothesis do not count. Peaks left and right of the car are then paired by how a lane is wide.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from lanes.evidence import Stripes
from lanes.lanefit import ANGLE_STD_RAD, PRIOR_MEAN, PRIOR_STD, paint_weight
from lanes.lanemodel import flatten, place

FAR_M = 22.0
BIN_M = 0.15
BINS = 60
PRIOR_WEIGHT = 0.1
HG, KG, PG = (6, 0.03, 0.18), (9, 0.0015, 0.44), np.arange(-1, 2) * 0.018


def _spread(count: int, step: float, growth: float) -> np.ndarray:
    """Values around zero, `count` on either side, whose spacing grows outwards."""
    k = np.arange(-count, count + 1)
    return np.sign(k) * step * np.expm1(np.abs(k) * growth) / growth


@lru_cache(maxsize=1)
def hypotheses() -> np.ndarray:
    """(H, 3): heading, curvature, pitch."""
    heading, curvature, pitch = _spread(*HG), _spread(*KG), PG
    return np.stack([g.ravel() for g in np.meshgrid(heading, curvature, pitch, indexing="ij")], axis=1)


def count_votes(stripes: Stripes, height_m: float) -> np.ndarray:
    """(H, BINS) votes: paint at each distance left of each hypothesis' arc."""
    heading, curvature, pitch = hypotheses().T
    near = stripes.select(stripes.x_m < FAR_M)
    paint = paint_weight(near).astype(np.float32)
    votes = np.zeros((len(heading), BINS))
    for tilt in np.unique(pitch):
        of = np.flatnonzero(pitch == tilt)
        x, y, angle = (q.astype(np.float32) for q in flatten(near.x_m, near.y_m, near.angle, tilt, 0.0, height_m))
        a, sin, cos, _ = place(x, y, heading[of].astype(np.float32), curvature[of].astype(np.float32))
        astray = (sin * np.cos(angle) - cos * np.sin(angle)) / np.float32(ANGLE_STD_RAD)
        weight = paint / np.square(1 + astray * astray)
        index = np.clip(a / BIN_M + BINS / 2, 0, BINS - 1).astype(np.int32)
        index += np.arange(len(of), dtype=np.int32)[:, None] * BINS
        votes[of] = np.bincount(index.ravel(), weight.ravel(), minlength=len(of) * BINS).reshape(-1, BINS)
    votes[:, [0, -1]] = 0
    return votes


def best_pairs(votes: np.ndarray, rows: int, *, most: int = 8) -> np.ndarray:
    """The lanes (K, 7), best first, that the votes speak for; `rows` is how many a solid line would get."""
    guess = hypotheses()
    smooth = votes.copy()
    smooth[:, 1:-1] += 0.6 * (votes[:, :-2] + votes[:, 2:])
    support = np.sqrt(smooth / rows)
    middle = (np.arange(BINS) + 0.5 - BINS / 2) * BIN_M
    left, right = np.flatnonzero((middle > 0.3) & (middle < 3.6)), np.flatnonzero((middle < -0.3) & (middle > -3.6))
    width = middle[left][:, None] - middle[right]
    centre = (middle[left][:, None] + middle[right]) / 2
    pair_prior = ((width - PRIOR_MEAN[1]) / PRIOR_STD[1]) ** 2 + ((centre - PRIOR_MEAN[0]) / PRIOR_STD[0]) ** 2
    guess_prior = ((guess / PRIOR_STD[[2, 3, 5]]) ** 2).sum(1)
    bound = support[:, left].max(1) + support[:, right].max(1) - PRIOR_WEIGHT / 2 * guess_prior
    best = np.argsort(-bound, kind="stable")[:300]
    score = support[best][:, left, None] + support[best][:, None, right]
    score -= PRIOR_WEIGHT / 2 * (pair_prior + guess_prior[best, None, None])
    score = score.reshape(len(best), -1)
    pair = score.argmax(1)
    value = score[np.arange(len(best)), pair]
    lanes = np.zeros((len(best), 7))
    lanes[:, 0], lanes[:, 1] = centre.ravel()[pair], width.ravel()[pair]
    lanes[:, [2, 3, 5]] = guess[best]
    return distinct(lanes[np.argsort(-value, kind="stable")], most)


def distinct(lanes: np.ndarray, most: int) -> np.ndarray:
    chosen: list[np.ndarray] = []
    for lane in lanes:
        if all(
            np.any(np.abs(lane - other)[:2] > 0.35) or abs(lane[3] - other[3]) > 0.3 * abs(lane[3]) + 0.002
            for other in chosen
        ):
            chosen.append(lane)
        if len(chosen) == most:
            break
    return np.array(chosen)
