"""Search without memory: the ego lane in the evidence of one image, and what is seen of its lines.

stripes -> vote_lanes (start hypotheses) -> fit_starts -> Lane
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from lanes.detect.fit import Fit, FitSettings, fit_starts, near_stripes
from lanes.detect.lane import Lane, LineEvidence
from lanes.detect.line_type import MarkingProfile, marking_profile
from lanes.detect.paint import FrameEvidence, PaintSettings
from lanes.detect.road import CENTRE, PARAMETERS, SIDES, WIDTH, is_ego_lane
from lanes.detect.votes import VoteSettings, vote_lanes

# Stripes between the lines of a lane: those farther from the lines than this, up to the distance ahead in which lanes
# are rated. This number of stripes on the lines is added, so that a few dots of a worn line are no clutter.
BETWEEN_M, BETWEEN_FAR_M, BETWEEN_STRIPES = 0.5, 30.0, 5.0


@dataclass(frozen=True)
class DetectorSettings:
    """Settings of the steps of a detection."""

    paint: PaintSettings = field(default_factory=PaintSettings)
    votes: VoteSettings = field(default_factory=VoteSettings)
    fit: FitSettings = field(default_factory=FitSettings)


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


def search_lane(evidence: FrameEvidence, settings: DetectorSettings = DETECTOR) -> Search | None:
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
        inlier_share=float(fit.inlier_share[0]),
        clear_share=clear_share(fit),
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
    evidence: FrameEvidence,
    previous: Sequence[LineEvidence],
    *,
    profiles_of: Sequence[int] = (0, 1),
) -> tuple[LineEvidence, LineEvidence]:
    """What one image shows of the left and the right line of a fitted lane.

    The profiles of the lines `profiles_of` are measured, and vote. If there are any, the visible rows of both lines are
    counted, too: they change slowly. Profiles and rows that are not measured are those of the `previous` frame.
    """
    count_rows = len(profiles_of) or any(line.rows is None for line in previous)
    rows = fit.visible_rows[0].tolist() if count_rows else [line.rows for line in previous]
    lines = []
    for k, line in enumerate(previous):
        profile, votes = line.profile, line.votes
        if k in profiles_of:
            # over the rows with stripes on the line
            marked = fit.stripes.row[fit.members[0, k] & ~fit.stripes.edge]
            line_y_m = np.full(len(fit.view.x_m), np.nan)
            line_y_m[marked] = fit.lines_y_m[0, k, marked]
            profile = marking_profile(evidence.response, fit.view, line_y_m) or profile
            votes = votes.add_profile(profile)
        votes = votes.add_gaps(fit.stripes.x_m[fit.members[0, k]])
        support = float(fit.marked_rows[0, k] / rows[k])
        seen = support >= fit.settings.min_support
        edge = bool(fit.stripes.edge[fit.members[0, k]].mean() > 0.5) if fit.members[0, k].any() else False
        lines.append(LineEvidence(support, seen, float(fit.reach_m[0, k]), edge, rows[k], profile, votes))
    return lines[0], lines[1]


def inner_stripe_shift(profiles: Sequence[MarkingProfile | None]) -> np.ndarray:
    """Shift (15,) of the parameters from the fitted lines to the stripes next to the lane.

    Fits follow the centre of a double line. `profiles` are those of the left and the right line; None shifts nothing.
    """
    left, right = (p.stripe_m(side) if p else 0.0 for p, side in zip(profiles, SIDES, strict=True))
    shift = np.zeros(PARAMETERS)
    shift[[CENTRE, WIDTH]] = (left + right) / 2, left - right
    return shift
