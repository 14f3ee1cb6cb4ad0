"""The lane of a frame put into words of `lanes.tracking.lane`, when it was followed rather than found.

What is known comes from the belief, what was seen from this picture; a line's paint is looked at now and then only,
because it seldom changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lanes.tracking.birdseye import BirdsEyeView
from lanes.tracking.fitting import LaneFit
from lanes.tracking.lane import Lane, LaneLine, MarkingProfile
from lanes.tracking.marking_profile import marking_profile
from lanes.tracking.markings import FrameEvidence, Stripes
from lanes.tracking.model import (
    CENTRE,
    PARAMETERS,
    SIDES,
    VOTE_PRIOR_WEIGHT,
    WIDTH,
    intersect_ground,
    line_coefficients,
    lines_on_view,
    squared_mahalanobis,
)
from lanes.tracking.state import KalmanState

# Support is counted up to this distance, against at least so many rows, that a line just leaving the picture is not
# thought perfect for the three rows it has.
SUPPORT_FAR_M, LEAST_ROWS = 50.0, 30
# A stripe belongs to a line from this weight on; a line is seen from this support on.
LEAST_WEIGHT, LEAST_SUPPORT = 0.25, 0.03


@dataclass(frozen=True)
class LineObservation:
    """What was seen of a line: share of its rows with paint, how far ahead, and what the paint is like.

    `rows` is in how many rows of the view the line is in sight; None where that is not known.
    """

    support: float = 0.0
    reach_m: float = 0.0
    profile: MarkingProfile | None = None
    rows: int | None = None

    def behind(self, distance_m: float) -> LineObservation:
        """The same after driving on without seeing anything: evidence comes nearer and counts no more."""
        return LineObservation(0.0, max(self.reach_m - distance_m, 0.0), self.profile)


def observe_lines(
    fit: LaneFit,
    evidence: FrameEvidence,
    view: BirdsEyeView,
    before: tuple[LineObservation, LineObservation],
    look_at: int | None,
) -> tuple[LineObservation, LineObservation]:
    """What a picture shows of the two lines of a fitted lane (1, 15).

    Parameters
    ----------
    fit, sight, view
        Of this picture.
    before : (Seen, Seen)
        Of the picture before; its paint and rows are kept.
    look_at : {0, 1, None}
        The line whose paint is looked at again; the rows of both are counted again then, too.
    """
    mine = [(fit.side[0] == side) & (fit.weight[0] > LEAST_WEIGHT) for side in SIDES]
    reach_m = reach_of(evidence.stripes, mine, fit.lane[0], view.height_m)
    rows, profile = [line.rows for line in before], [line.profile for line in before]
    # how many rows a line is in sight in changes slowly, and where exactly it runs is needed for its paint alone
    if look_at is not None or None in rows:
        lines = lines_on_view(fit.lane, view.x_m, view.height_m)
        rows = rows_in_sight(lines, view)[0].tolist()
        if look_at is not None and mine[look_at].any():
            line, painted = np.full(len(view.x_m), np.nan), evidence.stripes.row[mine[look_at]]
            line[painted] = lines[0, look_at, painted]
            profile[look_at] = marking_profile(evidence.response, view, line) or profile[look_at]
    support = (painted_rows(fit, evidence.stripes)[0] / rows).tolist()
    left, right = map(LineObservation, support, reach_m, profile, rows)
    return left, right


def describe_tracked_lane(
    estimate: KalmanState, seen: tuple[LineObservation, LineObservation], double: tuple[bool, bool], margin: float
) -> Lane:
    """The lane that is believed in, with what was seen of its lines.

    Of `double` lines the stripe beside the lane bounds it. (For single ones the filter knows the middle of the paint
    better than one look at it.)
    """
    doubles = [
        s.profile if twice and s.profile and s.profile.double else None for s, twice in zip(seen, double, strict=True)
    ]
    model, covariance = estimate.lane + inner_stripes(doubles), estimate.lane_covariance
    lines = tuple(_line(model, covariance, side, s) for side, s in zip(SIDES, seen, strict=True))
    score = sum(np.sqrt(s.support) for s in seen) - VOTE_PRIOR_WEIGHT * squared_mahalanobis(estimate.lane[None])[0]
    return Lane.from_model(model, covariance, lines, score=float(score), margin=margin)


def _line(model: np.ndarray, covariance: np.ndarray, side: float, seen: LineObservation) -> LaneLine:
    variance = covariance[CENTRE, CENTRE] + side * covariance[CENTRE, WIDTH] + covariance[WIDTH, WIDTH] / 4
    return LaneLine(
        *line_coefficients(model, side),
        c0_std_m=float(np.sqrt(variance)),
        support=seen.support,
        reach_m=seen.reach_m,
        seen=seen.support >= LEAST_SUPPORT,
        profile=seen.profile,
    )


def reach_of(stripes: Stripes, mine: Sequence[np.ndarray], lane: np.ndarray, height_m: float) -> list[float]:
    """How far ahead the stripes of each line, `mine` (stripes,) bool, go on the road of a lane (15,); 0 without any."""
    nearest = float(stripes.x_m.min(initial=1.0))
    flat_m = np.array([stripes.x_m[m].max(initial=nearest) for m in mine])
    met_m = intersect_ground(flat_m, lane, height_m).x_m
    return [float(x) if m.any() else 0.0 for x, m in zip(met_m, mine, strict=True)]


def inner_stripes(profile: Sequence[MarkingProfile | None]) -> np.ndarray:
    """What leads from a fitted lane to the one between the stripes next to it, (15,): fits follow a double's middle.

    `profile` is that of the left and the right line; None moves nothing.
    """
    left, right = (p.stripe_m(side) if p else 0.0 for p, side in zip(profile, SIDES, strict=True))
    shift = np.zeros(PARAMETERS)
    shift[[CENTRE, WIDTH]] = (left + right) / 2, left - right
    return shift


def support_of(fit: LaneFit, lines_y_m: np.ndarray, stripes: Stripes, view: BirdsEyeView) -> np.ndarray:
    """(K, 2): share of each line's rows in sight, up to `SUPPORT_FAR_M`, that have paint on it; left, right."""
    return painted_rows(fit, stripes) / rows_in_sight(lines_y_m, view)


def painted_rows(fit: LaneFit, stripes: Stripes) -> np.ndarray:
    """(K, 2): in how many rows up to `SUPPORT_FAR_M` there is paint on each line, by the weight of its stripes."""
    weight = fit.weight * (stripes.x_m < SUPPORT_FAR_M)
    return (weight[:, None] * (fit.side[:, None] == SIDES[:, None])).sum(axis=-1)


def rows_in_sight(lines_y_m: np.ndarray, view: BirdsEyeView) -> np.ndarray:
    """(K, 2): in how many rows up to `SUPPORT_FAR_M` each line is in sight; at least `LEAST_ROWS`."""
    rows = np.flatnonzero(view.x_m < SUPPORT_FAR_M)
    column = (view.y_m[0] - lines_y_m[..., rows]) / view.cell_m
    inside = (column >= 0) & (column <= len(view.y_m) - 1)
    seen = inside & view.seen[rows, np.where(inside, column, 0).astype(int)]
    return np.maximum(seen.sum(axis=-1), LEAST_ROWS)
