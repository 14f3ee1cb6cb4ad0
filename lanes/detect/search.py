"""Search without memory: the ego lane in the evidence of one image, and what is seen of its lines.

stripes -> vote_lanes (start hypotheses) -> fit_starts -> Lane
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from lanes.camera import Camera
from lanes.detect.evidence import Evidence
from lanes.detect.fit import Fit, FitSettings, fit_starts, near_stripes
from lanes.detect.lane import FarEvidence, Lane, LineEvidence
from lanes.detect.line_type import MIN_ROAD_M, MarkingProfile, marking_profile
from lanes.detect.paint import PaintSettings
from lanes.detect.residuals import stripe_residuals
from lanes.detect.road import CENTRE, PARAMETERS, SIDES, WIDTH, adjacent_lane_matrix, is_ego_lane
from lanes.detect.votes import VoteSettings, vote_lanes

# Stripes between the lines of a lane: those farther from the lines than this, up to the distance ahead in which lanes
# are rated. This number of stripes on the lines is added, so that a few dots of a worn line are no clutter.
BETWEEN_M, BETWEEN_FAR_M, BETWEEN_STRIPES = 0.5, 30.0, 5.0
# Smallest support of a far line that is seen, and smallest distance from its first to its last stripe: one dash, an
# arrow or a car is shorter. On the eight stills and 36 scenes of the rendered suite, variants 3 to 6, 89 far lines are
# seen. Two are wrong, as are their ego lanes.
FAR_SUPPORT, FAR_SPAN_M = 0.05, 10.0


@dataclass(frozen=True)
class DetectorSettings:
    """Settings of the steps of a detection."""

    paint: PaintSettings = field(default_factory=PaintSettings)
    votes: VoteSettings = field(default_factory=VoteSettings)
    fit: FitSettings = field(default_factory=FitSettings)
    # The views of single images and searches begin where images do, and are so wide that they hold the adjacent lines:
    # in a wider one the network finds more that is no lane.
    near_m: float = 2.5
    half_width_m: float = 6.5
    # Heights tried where the height is uncertain: steps of its logarithm, in standard deviations.
    tried_heights: tuple[float, ...] = (0.0, -1.0, 1.0)


DETECTOR = DetectorSettings()


@dataclass(frozen=True, eq=False)
class Search:
    """The steps of a search: vote table, fit of all start hypotheses to the near stripes, and the final fit.

    `lane` is None if the fitted lane is not seen.
    """

    votes: np.ndarray
    starts: Fit
    fit: Fit
    lane: Lane | None


@dataclass(frozen=True, eq=False)
class StillDetection:
    """What was found in an image, and what it was found in.

    `search` is None without stripes near the car, or if a tracker made none; `lane` is None if no lane is seen.
    """

    evidence: Evidence
    search: Search | None = None
    lane: Lane | None = None

    @property
    def camera(self) -> Camera:
        """The camera with the pose that the lane was found with."""
        return self.evidence.view.camera

    @property
    def confidence(self) -> float:
        """Confidence of the lane; 0 without one."""
        return self.lane.confidence if self.lane else 0.0


def search_lane(evidence: Evidence, settings: DetectorSettings = DETECTOR) -> Search | None:
    """Search the ego lane in the evidence of one image; None without stripes near the car."""
    stripes, view = evidence.stripes, evidence.view
    if not len(near_stripes(stripes, settings.fit)):
        return None
    votes, starts = vote_lanes(stripes, view, settings.fit.prior, settings.votes)
    near, fit = fit_starts(starts, stripes, view, settings.fit)
    if not fit.seen[0]:
        return Search(votes, near, fit, None)
    left, right = observe_lines(fit, evidence, (LineEvidence(), LineEvidence()))
    model = fit.lanes[0] + inner_stripe_shift([left.profile, right.profile])
    lane = Lane(
        model=model,
        centres=model - inner_stripe_shift([left.double_profile, right.double_profile]),
        fit_covariance=fit.covariance[0],
        # rows are counted again in the next frame, because its view may be narrower
        evidence=(replace(left, rows=None), replace(right, rows=None)),
        # a lane that the car is not in starts no track
        score=lane_score((left, right)) - (not is_ego_lane(fit.lanes)[0]),
        clear_share=clear_share(fit),
        far_evidence=observe_far_lines(fit, evidence),
        confidence_shift=evidence.confidence_shift,
        camera=evidence.view.camera,
    )
    return Search(votes, near, fit, lane)


def lane_score(lines: Sequence[LineEvidence]) -> float:
    """Sum of the square roots of both lines' supports."""
    return float(sum(np.sqrt(line.support) for line in lines))


def clear_share(fit: Fit) -> float:
    """Of the stripes along the fitted lane, on its lines and between them, the share on its lines, 0 to 1."""
    residual_m, near = fit.residuals.residual_m[0], fit.stripes.x_m < BETWEEN_FAR_M
    side = fit.residuals.side[0]
    of_lane = near & (np.abs(side) == 1)
    between = of_lane & (-side * residual_m > BETWEEN_M)
    # stripes that run across the lane do not count
    along = fit.residuals.weights(np.full(len(side), np.inf))[0]
    between_weight = float(fit.stripes.weight @ (between * along))
    on_lines = BETWEEN_STRIPES + float(fit.weight[0] @ of_lane)
    return on_lines / (on_lines + between_weight)


def observe_lines(
    fit: Fit,
    evidence: Evidence,
    previous: Sequence[LineEvidence],
    *,
    profiles_of: Sequence[int] = (0, 1),
) -> tuple[LineEvidence, LineEvidence]:
    """What one image shows of the left and the right line of a fitted lane.

    The profiles of the lines `profiles_of` are measured, and vote. If there are any, the visible rows of both lines are
    counted, too: they change slowly. Profiles and rows that are not measured are those of the `previous` frame.
    """
    count_rows = len(profiles_of) or any(line.rows is None for line in previous)
    rows: list[Any] = fit.visible_rows[0].tolist() if count_rows else [line.rows for line in previous]
    left, right = (
        _observe_line(fit, (0, k), rows[k], line, evidence if k in profiles_of else None)
        for k, line in enumerate(previous)
    )
    return left, right


def observe_far_lines(fit: Fit, evidence: Evidence) -> FarEvidence:
    """What one image shows of the far lines of the lanes to the left and right of a fitted lane; None if not seen."""
    lanes = np.array([adjacent_lane_matrix(side) @ fit.lanes[0] for side in SIDES])
    adjacent = replace(fit, lanes=lanes, residuals=stripe_residuals(lanes, fit.stripes, fit.view.height_m))
    # the left line of the lane to the left, and the right line of the lane to the right
    lines: list[LineEvidence | None] = [None, None]
    for k in range(2):
        marked_m = fit.stripes.x_m[adjacent.members[k, k]]
        if len(marked_m) and np.ptp(marked_m) >= FAR_SPAN_M and adjacent.support[k, k] >= FAR_SUPPORT:
            rows = int(adjacent.visible_rows[k, k])
            lines[k] = _observe_line(adjacent, (k, k), rows, LineEvidence(), evidence)
    return lines[0], lines[1]


def _observe_line(
    fit: Fit, line: tuple[int, int], rows: int, previous: LineEvidence, evidence: Evidence | None
) -> LineEvidence:
    """What one image shows of the `line` (lane, side) of a fit; without `evidence` no profile is measured."""
    members, profile, votes, seen = fit.members[line], previous.profile, previous.votes, None
    if evidence is not None:
        stripe_rows = fit.stripes.row[members & fit.stripes.measurable & ~fit.stripes.edge]
        seen = marking_profile(evidence.response, fit.view, fit.lines_y_m[line], stripe_rows, float(SIDES[line[1]]))
    if seen is not None:
        profile, votes = seen, votes.add(seen)
    support, (start_m, reach_m) = float(fit.marked_rows[line] / rows), fit.extent_m[line].tolist()
    start_m = min(filter(None, (start_m, previous.start_m)), default=0.0)
    # by weight, because there are edges beside painted lines, too, and between dashes
    weight = fit.weight[line[0]] * members
    edge = bool(weight @ fit.stripes.edge > weight @ ~fit.stripes.edge)
    edge = edge and (seen is None or seen.painted_m < MIN_ROAD_M)
    return LineEvidence(support, support >= fit.settings.min_support, reach_m, edge, rows, profile, votes, start_m)


def inner_stripe_shift(profiles: Sequence[MarkingProfile | None]) -> np.ndarray:
    """Shift (15,) of the parameters from the fitted lines to the stripes next to the lane.

    Fits follow the centre of a double line. `profiles` are those of the left and the right line; None shifts nothing.
    """
    left, right = (p.stripe_m(side) if p else 0.0 for p, side in zip(profiles, SIDES, strict=True))
    shift = np.zeros(PARAMETERS)
    shift[[CENTRE, WIDTH]] = (left + right) / 2, left - right
    return shift
