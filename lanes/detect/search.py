"""Detection without memory: the ego lane in the evidence of one image, and what the image shows of its lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lanes.detect.error_covariance import fit_errors
from lanes.detect.fit import LaneFit, fit_starts, near_stripes
from lanes.detect.lane import Lane, LineObservation, Observations
from lanes.detect.line_type import MarkingProfile, marking_profile
from lanes.detect.paint import FrameEvidence, marking_weight, position_std
from lanes.detect.residuals import stripe_residuals
from lanes.detect.road import CENTRE, PARAMETERS, SIDES, WIDTH
from lanes.detect.votes import vote_lanes

# Lanes whose centre or width differs by more than this are different lanes; tuned on the labelled Udacity stills.
RIVAL_M = 0.5
# Stripes between the lines of a lane: those farther from the lines than this, up to the distance ahead in which lanes
# are rated. This number of stripes on the lines is added, so that a few dots of a worn line are no clutter.
BETWEEN_M, BETWEEN_FAR_M, BETWEEN_STRIPES = 0.5, 30.0, 5.0


def search_lane(evidence: FrameEvidence) -> Lane | None:
    """The ego lane in the evidence of one frame; None if it is not seen."""
    stripes, view = evidence.stripes, evidence.view
    if not len(near_stripes(stripes)):
        return None
    _, starts = vote_lanes(stripes, view)
    fit = fit_starts(starts, stripes, view)
    return choose_lane(fit, evidence)


def choose_lane(fit: LaneFit, evidence: FrameEvidence) -> Lane | None:
    """The fitted lane with the best score; None if it is not seen."""
    score = fit.score
    best = int(score.argmax())
    if not fit.seen[best]:
        return None
    rivals = np.abs(fit.lane - fit.lane[best])[:, [CENTRE, WIDTH]].max(axis=1) > RIVAL_M
    observations = observe_lines(fit, evidence, (LineObservation(), LineObservation()), index=best)
    left, right = observations
    model = fit.lane[best] + inner_stripe_shift([line.profile for line in observations])
    return Lane(
        model=model,
        centres=model - inner_stripe_shift([line.double_profile for line in observations]),
        covariance=fit_errors(fit, best),
        assumed_covariance=fit.covariance[best],
        # rows are counted again in the next frame, because its view may be narrower
        observations=(replace(left, rows=None), replace(right, rows=None)),
        score=float(score[best]),
        margin=float(score[best] - score[rivals].max(initial=0.0)),
        explained_share=float(fit.explained_share[best]),
        clear_share=clear_share(fit, best),
    )


def clear_share(fit: LaneFit, index: int) -> float:
    """Of the stripes along the fitted lane `index`, on its lines and between them, the share on its lines, 0 to 1."""
    stripes = fit.stripes.select(fit.stripes.x_m < BETWEEN_FAR_M)
    residuals = stripe_residuals(fit.lane[index][None], stripes, fit.view.height_m)
    side, weight = residuals.side[0], marking_weight(stripes)
    between = np.isin(side, SIDES) & (-side * residuals.residual_m[0] > BETWEEN_M)
    between_weight = float(weight @ (between * residuals.weights(np.array(np.inf))[0]))
    position = residuals.weights(position_std(stripes, fit.view.focal_px))[0]
    on_lines = BETWEEN_STRIPES + float(weight @ (np.isin(side, SIDES) * position))
    return on_lines / (on_lines + between_weight)


def observe_lines(
    fit: LaneFit,
    evidence: FrameEvidence,
    previous: Observations,
    *,
    index: int = 0,
    profiles_of: Sequence[int] = (0, 1),
) -> Observations:
    """Observations of the left and the right line of the fitted lane `index` in one frame.

    The profiles of the lines `profiles_of` are measured, and vote. If there are any, the visible rows of both lines are
    counted, too: they change slowly. Profiles and rows that are not measured are those of the `previous` frame.
    """
    rows = [line.rows for line in previous]
    if len(profiles_of) or None in rows:
        rows = fit.visible_rows[index].tolist()
    support = (fit.marked_rows[index] / rows).tolist()
    profiles, votes = [line.profile for line in previous], [line.votes for line in previous]
    for k in profiles_of:
        profiles[k] = _measure_profile(fit, evidence, index, k) or profiles[k]
        votes[k] = votes[k].add_profile(profiles[k])
    left, right = map(LineObservation, support, fit.reach_m[index].tolist(), profiles, rows, votes)
    return left, right


def _measure_profile(fit: LaneFit, evidence: FrameEvidence, index: int, k: int) -> MarkingProfile | None:
    """Cross-section of the left (k = 0) or right (1) line, over the rows with stripes; None if there are too few."""
    rows = fit.stripes.row[fit.members[index, k]]
    line_y_m = np.full(len(fit.view.x_m), np.nan)
    line_y_m[rows] = fit.lines_y_m[index, k, rows]
    return marking_profile(evidence.response, fit.view, line_y_m)


def inner_stripe_shift(profiles: Sequence[MarkingProfile | None]) -> np.ndarray:
    """Shift (15,) of the parameters from the fitted lines to the stripes next to the lane.

    Fits follow the centre of a double line. `profiles` are those of the left and the right line; None shifts nothing.
    """
    left, right = (p.stripe_m(side) if p else 0.0 for p, side in zip(profiles, SIDES, strict=True))
    shift = np.zeros(PARAMETERS)
    shift[[CENTRE, WIDTH]] = (left + right) / 2, left - right
    return shift
