"""One picture of which nothing is known: raw pixels in, the ego lane in metres out."""

from __future__ import annotations

import numpy as np

from lanes.tracking.birdseye import BirdsEyeView
from lanes.tracking.fitting import MORE_PAINT, OUTWARDS, START, UNEXPLAINED, WAVES_PER_M, LaneFit, fit_lanes
from lanes.tracking.lane import Lane, LaneLine, MarkingProfile
from lanes.tracking.lines import LEAST_SUPPORT, LEAST_WEIGHT, inner_stripes, reach_of, support_of
from lanes.tracking.marking_profile import marking_profile
from lanes.tracking.markings import FrameEvidence, Stripes, extract_evidence
from lanes.tracking.model import (
    CENTRE,
    SIDES,
    VOTE_PRIOR_WEIGHT,
    WIDTH,
    line_coefficients,
    lines_on_view,
    squared_mahalanobis,
)
from lanes.tracking.voting import VOTING_FAR_M, best_pairs, count_votes, suppress_non_maxima

# Rival hypotheses that are followed to the end, and how near two of them are the same lane.
RIVALS, RIVAL_M = 3, 0.5
# Near by, a little more pitch looks like a little less width; only farther out do such lanes part.
SAME_PITCH_RAD = 0.008


def find_lane(image: np.ndarray, view: BirdsEyeView) -> Lane | None:
    """Find the lane in a picture of which nothing else is known.

    Parameters
    ----------
    image : ndarray of shape (height, width, 3), uint8
        RGB, as taken.
    view : BirdsEyeView
        Of the camera that took it.

    Returns
    -------
    Lane or None
        None if neither line is there.
    """
    evidence = extract_evidence(image, view)
    fit = search_lane(evidence.stripes, view)
    return describe_lane(fit, evidence, view) if fit else None


def search_lane(stripes: Stripes, view: BirdsEyeView) -> LaneFit | None:
    """Fit the lanes that the stripes vote for, `RIVALS` of them, best votes first; None if there are no stripes.

    The one with most paint is also fitted as one that waves, and joins them if that explains more.
    """
    near = near_stripes(stripes)
    if not len(near):
        return None
    _, starts = vote_lanes(near, view)
    first = fit_lanes(starts, near, view.height_m, view.focal_px, schedule=START)
    support = np.sqrt((first.weight[:, None] * (first.side[:, None] == SIDES[:, None])).sum(-1)).sum(-1)
    lanes = suppress_non_maxima(
        first.lane[np.argsort(is_other_lane(first.lane) * 1e3 - support, kind="stable")],
        RIVALS,
        same_pitch_rad=SAME_PITCH_RAD,
    )
    fit = fit_lanes(lanes, stripes, view.height_m, view.focal_px)
    best = int(fit.weight.sum(axis=1).argmax())
    if fit.weight[best].sum() > fit.beside[best] - UNEXPLAINED:
        return fit
    waved = _fit_waves(lanes[best], stripes, view)
    return fit.joined(waved) if waved.weight.sum() > fit.weight[best].sum() + MORE_PAINT else fit


def _fit_waves(start: np.ndarray, stripes: Stripes, view: BirdsEyeView) -> LaneFit:
    """One lane (15,) fitted as if the road might wave up and down."""
    return fit_lanes(
        start[None], stripes, view.height_m, view.focal_px, schedule=OUTWARDS, extra_vertical_per_m=WAVES_PER_M
    )


def near_stripes(stripes: Stripes) -> Stripes:
    """Those that votes and the beginning of the fit rest on."""
    return stripes.select(stripes.x_m < START[-1][0])


def vote_lanes(near: Stripes, view: BirdsEyeView) -> tuple[np.ndarray, np.ndarray]:
    """The vote table (hypotheses, bins) of the stripes nearby, and the lanes (K, 15) that it suggests, best first."""
    votes = count_votes(near, view.height_m)
    return votes, best_pairs(votes, int((view.x_m < VOTING_FAR_M).sum()))


def describe_lane(fit: LaneFit, evidence: FrameEvidence, view: BirdsEyeView) -> Lane | None:
    """The best of the fitted lanes in metres; None if neither of its lines is seen."""
    lines = lines_on_view(fit.lane, view.x_m, view.height_m)
    support = support_of(fit, lines, evidence.stripes, view)
    score = score_lanes(fit.lane, support)
    best = int(score.argmax())
    if support[best].max() < LEAST_SUPPORT:
        return None
    mine = [(fit.side[best] == side) & (fit.weight[best] > LEAST_WEIGHT) for side in SIDES]
    reach_m = reach_of(evidence.stripes, mine, fit.lane[best], view.height_m)
    paint = [
        marking_profile(evidence.response, view, _only(rows, line))
        for rows, line in zip((evidence.stripes.row[m] for m in mine), lines[best], strict=True)
    ]
    model, covariance = fit.lane[best] + inner_stripes(paint), np.linalg.inv(fit.information[best])
    rival = np.abs(fit.lane - fit.lane[best])[:, [CENTRE, WIDTH]].max(axis=1) > RIVAL_M
    left, right = (
        _describe_line(model, covariance, side, support[best, k], reach_m[k], paint[k]) for k, side in enumerate(SIDES)
    )
    return Lane.from_model(
        model,
        covariance,
        (left, right),
        score=float(score[best]),
        margin=float(score[best] - score[rival].max(initial=0.0)),
    )


def score_lanes(lanes: np.ndarray, support: np.ndarray) -> np.ndarray:
    """(K,) how good lanes (K, 15) with these supports (K, 2) are: paint, less how unusual, less not being the own."""
    return np.sqrt(support).sum(axis=1) - VOTE_PRIOR_WEIGHT * squared_mahalanobis(lanes) - is_other_lane(lanes)


def is_other_lane(lanes: np.ndarray) -> np.ndarray:
    """(K,) bool: lanes (K, 15) that the car is not in, because both lines pass it on the same side."""
    return np.abs(lanes[:, CENTRE]) > lanes[:, WIDTH] / 2


def _only(rows: np.ndarray, line_y_m: np.ndarray) -> np.ndarray:
    """A line's lateral places in these rows of the view, NaN in all others."""
    kept = np.full_like(line_y_m, np.nan)
    kept[rows] = line_y_m[rows]
    return kept


def _describe_line(
    model: np.ndarray, covariance: np.ndarray, side: float, support: float, reach_m: float, paint: MarkingProfile | None
) -> LaneLine:
    gradient = np.zeros(len(model))
    gradient[[CENTRE, WIDTH]] = 1, side / 2
    std = float(np.sqrt(gradient @ covariance @ gradient))
    return LaneLine(
        *line_coefficients(model, side), std, float(support), reach_m, bool(support >= LEAST_SUPPORT), paint
    )
