"""Start hypotheses for the fit: the histogram of the course's first half, generalised to roads that bend.

For each hypothesis of heading, curvature and pitch the stripes are counted in bins of their distance from its arc: a
line that follows the hypothesis adds up in one bin, whatever its shape on the road. Stripes whose own direction
contradicts the hypothesis have no weight (votes with directions: Ballard's generalised Hough transform, 1981). Peaks to
the left and to the right of the car are then paired to lanes, with a prior for lane width and position.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.paint import Stripes
from lanes.detect.residuals import MIN_SCALE, flatten, intersect_ground
from lanes.detect.road import CENTRE, CURVATURE, HEADING, PARAMETERS, PITCH, WIDTH, RoadPrior, parameter_vector


@dataclass(frozen=True)
class VoteSettings:
    """Hypotheses, bins and pairing; tuned on the labelled Udacity stills where no source is given."""

    # Votes come from stripes nearer than this, where one arc is enough; the fit continues outwards.
    far_m: float = 22.0
    # Hypotheses of heading (rad) and curvature (1/m) to either side of 0: number, first step, relative growth of the
    # steps. They are dense where roads usually are; radii go down to 15 m.
    headings: tuple[int, float, float] = (6, 0.03, 0.18)
    curvatures: tuple[int, float, float] = (11, 0.0015, 0.24)
    # Pitch hypotheses are 0 and plus or minus this.
    pitch_step_rad: float = 0.018
    bin_m: float = 0.15
    bins: int = 60
    # Share of a bin's votes that both its neighbours get, for stripes between two bins.
    neighbour_share: float = 0.6
    # Distances from the car to either side between which lines are searched.
    line_m: tuple[float, float] = (0.3, 3.6)
    # Cost of one squared standard deviation from the prior, relative to the square root of a line's share of votes.
    prior_weight: float = 0.05
    # Hypotheses whose lines are paired, and lanes that are returned.
    paired: int = 300
    lanes: int = 5
    # Two lanes are duplicates, because they lead to the same fit, if centre and width differ by less than this. Their
    # curvatures must also differ by less than this value (1/m) plus this share of them.
    duplicate_m: float = 0.35
    duplicate_curvature: tuple[float, float] = (0.002, 0.3)

    @cached_property
    def hypotheses(self) -> np.ndarray:
        """(H, 3): heading, curvature and pitch."""
        pitches = np.arange(-1, 2) * self.pitch_step_rad
        values = _spread(*self.headings), _spread(*self.curvatures), pitches
        return np.stack(np.meshgrid(*values, indexing="ij"), axis=-1).reshape(-1, 3)

    @cached_property
    def bin_centres_m(self) -> np.ndarray:
        """(bins,) distance of the centre of each bin to the left of a hypothesis' arc."""
        return (np.arange(self.bins) + 0.5 - self.bins / 2) * self.bin_m


def _spread(count: int, step: float, growth: float) -> np.ndarray:
    """Zero and `count` values to either side, first a `step` apart, then at growing distances."""
    k = np.arange(-count, count + 1)
    return np.sign(k) * step * np.expm1(np.abs(k) * growth) / growth


VOTES = VoteSettings()


def vote_lanes(
    stripes: Stripes, view: BirdsEyeView, prior: RoadPrior, settings: VoteSettings = VOTES
) -> tuple[np.ndarray, np.ndarray]:
    """The vote table (hypotheses, bins) of the stripes, and the lanes (K, 15) that it suggests, best first."""
    votes = count_votes(stripes, view.height_m, settings)
    return votes, best_pairs(votes, int((view.x_m < settings.far_m).sum()), prior, settings)


def count_votes(stripes: Stripes, height_m: float, settings: VoteSettings = VOTES) -> np.ndarray:
    """Histogram (H, bins) of the stripes, weighted, by their distance to the left of each hypothesis' arc.

    The bins are centred on `settings.bin_centres_m`.
    """
    near = stripes.select(stripes.x_m < settings.far_m)
    weight = near.weight.astype(np.float32)
    heading, curvature, pitch = settings.hypotheses.T
    votes = np.zeros((len(heading), settings.bins))
    for angle_rad in np.unique(pitch):
        of = np.flatnonzero(pitch == angle_rad)
        ground = intersect_ground(near.x_m, parameter_vector(pitch=angle_rad), height_m)
        x, y, angle = flatten(near.x_m, near.y_m, near.angle, ground, height_m)
        a, agreement = _distances_and_agreement(x, y, angle, near.angle_std_rad, heading[of], curvature[of])
        # in place: half of the time is memory allocation
        a *= 1 / settings.bin_m
        a += settings.bins / 2
        bins = np.clip(a, 0, settings.bins - 1, out=a).astype(np.intp)
        bins += settings.bins * np.arange(len(of))[:, None]
        counts = np.bincount(bins.ravel(), (agreement * weight).ravel(), len(of) * settings.bins)
        votes[of] = counts.reshape(-1, settings.bins)
    # the outermost bins also hold everything beyond them
    votes[:, [0, -1]] = 0
    return votes


def _distances_and_agreement(x, y, angle, angle_std, heading, curvature) -> tuple[np.ndarray, np.ndarray]:
    """For each hypothesis and stripe: the stripe's distance from the arc, and the agreement of the directions, 0 to 1.

    The geometry is that of `lanes.detect.residuals.arc_coordinates`, written as two products of matrices in float32:
    bins are coarse, and this table takes most of the time of a search.
    """
    sin, cos = np.sin(heading), np.cos(heading)
    across, front = np.sin(angle), np.cos(angle)
    twice = sums_of_products((2 * cos, -2 * sin, -curvature), (y, x, x * x + y * y))
    of_stripes = front / angle_std, across / angle_std, (x * front + y * across) / angle_std
    angle_residual = sums_of_products((sin, -cos, curvature), of_stripes)
    squared_scale = np.maximum(1 - curvature.astype(np.float32)[:, None] * twice, MIN_SCALE**2)
    return twice / (1 + np.sqrt(squared_scale)), np.square(squared_scale / (angle_residual**2 + squared_scale))


def sums_of_products(of_hypotheses: tuple, of_stripes: tuple) -> np.ndarray:
    """(hypotheses, stripes) float32: sums over pairs of factors, one of each hypothesis, the other of each stripe."""
    return np.stack(of_hypotheses, axis=1).astype(np.float32) @ np.stack(of_stripes).astype(np.float32)


def best_pairs(votes: np.ndarray, rows: int, prior: RoadPrior, settings: VoteSettings = VOTES) -> np.ndarray:
    """At most `settings.lanes` lanes (K, 15), best first, without duplicates, from pairs of lines in the votes.

    The score of a lane is the sum of the square roots of its lines' shares of `rows`, the votes of a solid line. Two
    fair lines therefore beat one good line alone.
    """
    hypothesis, middle = settings.hypotheses, settings.bin_centres_m
    shared = votes.copy()
    shared[:, 1:-1] += settings.neighbour_share * (votes[:, :-2] + votes[:, 2:])
    # float32, because there are 145,000 pairs of bins
    support = np.sqrt(shared / rows).astype(np.float32)
    beside = (np.abs(middle) > settings.line_m[0]) & (np.abs(middle) < settings.line_m[1])
    left, right = np.flatnonzero(beside & (middle > 0)), np.flatnonzero(beside & (middle < 0))
    distance = ((hypothesis / prior.std[[HEADING, CURVATURE, PITCH]]) ** 2).sum(1)
    bound = support[:, left].max(1) + support[:, right].max(1) - settings.prior_weight * distance
    kept = np.argsort(-bound, kind="stable")[: settings.paired]
    width, centre = middle[left, None] - middle[right], (middle[left, None] + middle[right]) / 2
    pair_distance = ((width - prior.mean[WIDTH]) / prior.std[WIDTH]) ** 2 + (centre / prior.std[CENTRE]) ** 2
    score = support[kept][:, left, None] + support[kept][:, None, right]
    score -= (settings.prior_weight * pair_distance).astype(np.float32)
    score = score.reshape(len(kept), -1)
    pair = score.argmax(axis=1)
    best = score[np.arange(len(kept)), pair] - settings.prior_weight * distance[kept]
    lanes = np.zeros((len(kept), PARAMETERS))
    lanes[:, CENTRE], lanes[:, WIDTH] = centre.ravel()[pair], width.ravel()[pair]
    lanes[:, [HEADING, CURVATURE, PITCH]] = hypothesis[kept]
    return suppress_non_maxima(lanes[np.argsort(-best, kind="stable")], settings)


def suppress_non_maxima(lanes: np.ndarray, settings: VoteSettings = VOTES) -> np.ndarray:
    """The first `settings.lanes` of the lanes (N, 15), best first, that are no duplicates of an earlier one."""
    chosen: list[int] = []
    free = np.ones(len(lanes), bool)
    tolerance_per_m, share = settings.duplicate_curvature
    while len(chosen) < settings.lanes and free.any():
        chosen.append(int(free.argmax()))
        difference = np.abs(lanes - lanes[chosen[-1]])
        moved = np.maximum(difference[:, CENTRE], difference[:, WIDTH]) > settings.duplicate_m
        free &= moved | (difference[:, CURVATURE] > tolerance_per_m + share * np.abs(lanes[:, CURVATURE]))
    return lanes[chosen]
