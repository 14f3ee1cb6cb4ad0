"""The lane of a frame put into words of `lanes.metric.lane`, when it was followed rather than found.

What is known comes from the belief, what was seen from this picture; a line's paint is looked at now and then only,
because it seldom changes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lanes.metric.attributes import Paint, describe_paint
from lanes.metric.lane import (
    LEAST_SUPPORT,
    LEAST_WEIGHT,
    PRIOR_WEIGHT,
    Lane,
    LaneLine,
    Sight,
    inner_stripes,
    painted_rows,
    reach_of,
    rows_in_sight,
)
from lanes.metric.lanefit import LaneFit, strangeness
from lanes.metric.lanemodel import (
    CENTRE,
    SIDES,
    WIDTH,
    line_coefficients,
    lines_on_view,
)
from lanes.metric.motion import Belief
from lanes.metric.roadview import RoadView


@dataclass(frozen=True)
class Seen:
    """What was seen of a line: share of its rows with paint, how far ahead, and what the paint is like.

    `rows` is in how many rows of the view the line is in sight; None where that is not known.
    """

    support: float = 0.0
    reach_m: float = 0.0
    paint: Paint | None = None
    rows: int | None = None

    def behind(self, distance_m: float) -> Seen:
        """The same after driving on without seeing anything: evidence comes nearer and counts no more."""
        return Seen(0.0, max(self.reach_m - distance_m, 0.0), self.paint)


def see_lines(
    fit: LaneFit, sight: Sight, view: RoadView, before: tuple[Seen, Seen], look_at: int | None
) -> tuple[Seen, Seen]:
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
    reach_m = reach_of(sight.stripes, mine, fit.lane[0], view.height_m)
    rows, paint = [line.rows for line in before], [line.paint for line in before]
    # how many rows a line is in sight in changes slowly, and where exactly it runs is needed for its paint alone
    if look_at is not None or None in rows:
        lines = lines_on_view(fit.lane, view.x_m, view.height_m)
        rows = rows_in_sight(lines, view)[0].tolist()
        if look_at is not None and mine[look_at].any():
            line, painted = np.full(len(view.x_m), np.nan), sight.stripes.row[mine[look_at]]
            line[painted] = lines[0, look_at, painted]
            paint[look_at] = describe_paint(sight.evidence, view, line) or paint[look_at]
    support = (painted_rows(fit, sight.stripes)[0] / rows).tolist()
    left, right = map(Seen, support, reach_m, paint, rows)
    return left, right


def describe_followed(belief: Belief, seen: tuple[Seen, Seen], double: tuple[bool, bool], margin: float) -> Lane:
    """The lane that is believed in, with what was seen of its lines.

    Of `double` lines the stripe beside the lane bounds it. (For single ones the filter knows the middle of the paint
    better than one look at it.)
    """
    doubles = [s.paint if twice and s.paint and s.paint.double else None for s, twice in zip(seen, double, strict=True)]
    model, covariance = belief.lane + inner_stripes(doubles), belief.lane_covariance
    lines = tuple(_line(model, covariance, side, s) for side, s in zip(SIDES, seen, strict=True))
    score = sum(np.sqrt(s.support) for s in seen) - PRIOR_WEIGHT * strangeness(belief.lane[None])[0]
    return Lane.from_model(model, covariance, lines, score=float(score), margin=margin)


def _line(model: np.ndarray, covariance: np.ndarray, side: float, seen: Seen) -> LaneLine:
    variance = covariance[CENTRE, CENTRE] + side * covariance[CENTRE, WIDTH] + covariance[WIDTH, WIDTH] / 4
    return LaneLine(
        *line_coefficients(model, side),
        c0_std_m=float(np.sqrt(variance)),
        support=seen.support,
        reach_m=seen.reach_m,
        seen=seen.support >= LEAST_SUPPORT,
        paint=seen.paint,
    )
