"""Observations of the two lines of a lane in one frame, and the `Lane` of parameters and observations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lanes.tracking.fitting import LaneFit
from lanes.tracking.lane import Lane, LaneLine, MarkingProfile
from lanes.tracking.marking_profile import marking_profile
from lanes.tracking.markings import FrameEvidence
from lanes.tracking.model import (
    CENTRE,
    CURVATURE,
    HEADING,
    PARAMETERS,
    PITCH,
    RATE,
    SIDES,
    VERTICAL_CURVATURE,
    WIDTH,
    lateral_std_m,
    line_coefficients,
)


@dataclass(frozen=True)
class LineParameters:
    """Support of lines; tuned on the labelled Udacity stills."""

    # Support is counted up to this distance, over at least this many rows: three rows are no reliable share.
    support_far_m: float = 50.0
    min_rows: int = 30
    # A line is seen if its support is at least this.
    min_support: float = 0.03


LINES = LineParameters()


@dataclass(frozen=True)
class LineObservation:
    """Evidence for one line in a frame.

    Attributes
    ----------
    support : float
        Share of the line's visible rows that have markings on it.
    reach_m : float
        Distance of its farthest stripe.
    profile : MarkingProfile, optional
        Latest cross-section of the marking.
    rows : int, optional
        Number of visible rows of the line; None if not counted yet.
    """

    support: float = 0.0
    reach_m: float = 0.0
    profile: MarkingProfile | None = None
    rows: int | None = None

    def coast(self, distance_m: float) -> LineObservation:
        """The observation after driving on without detection: no support, and the reach comes nearer."""
        return LineObservation(0.0, max(self.reach_m - distance_m, 0.0), self.profile)


Observations = tuple[LineObservation, LineObservation]


def observe_lines(
    fit: LaneFit,
    evidence: FrameEvidence,
    *,
    index: int = 0,
    previous: Observations = (LineObservation(), LineObservation()),
    profiles_of: Sequence[int] = (0, 1),
) -> Observations:
    """Observations of the left and the right line of a fitted lane in one frame.

    Parameters
    ----------
    fit : LaneFit
    evidence : FrameEvidence
        The evidence that the lane was fitted to.
    index : int
        Which lane of the fit.
    previous : (LineObservation, LineObservation)
        Of the previous frame; its profiles and rows are kept where they are not measured again.
    profiles_of : sequence of {0, 1}
        Lines whose profile is measured. If there are any, the visible rows of both lines are counted again, too:
        they change slowly.
    """
    rows = [line.rows for line in previous]
    if len(profiles_of) or None in rows:
        rows = visible_rows(fit)[index].tolist()
    support = (marked_rows(fit)[index] / rows).tolist()
    profiles = [line.profile for line in previous]
    for k in profiles_of:
        profiles[k] = _measure_profile(fit, evidence, index, k) or profiles[k]
    left, right = map(LineObservation, support, fit.reach_m[index].tolist(), profiles, rows)
    return left, right


def _measure_profile(fit: LaneFit, evidence: FrameEvidence, index: int, k: int) -> MarkingProfile | None:
    """Cross-section of the left (k = 0) or right (1) line, over the rows with stripes; None if there are too few."""
    rows = fit.stripes.row[fit.members[index, k]]
    line_y_m = np.full(len(fit.view.x_m), np.nan)
    line_y_m[rows] = fit.lines_y_m[index, k, rows]
    return marking_profile(evidence.response, fit.view, line_y_m)


def line_support(fit: LaneFit) -> np.ndarray:
    """(K, 2) support of each line: share of its visible rows, up to `LINES.support_far_m`, with markings on it."""
    return marked_rows(fit) / visible_rows(fit)


def marked_rows(fit: LaneFit) -> np.ndarray:
    """(K, 2) number of rows up to `LINES.support_far_m` with markings on each line: the sum of its stripes' weights."""
    weight = fit.weight * (fit.stripes.x_m < LINES.support_far_m)
    return (weight[:, None] * fit.on_line).sum(axis=-1)


def visible_rows(fit: LaneFit) -> np.ndarray:
    """(K, 2) number of visible rows of each line up to `LINES.support_far_m`, at least `LINES.min_rows`."""
    view = fit.view
    rows = np.flatnonzero(view.x_m < LINES.support_far_m)
    column = (view.y_m[0] - fit.lines_y_m[..., rows]) / view.cell_m
    inside = (column >= 0) & (column <= len(view.y_m) - 1)
    seen = inside & view.seen[rows, np.where(inside, column, 0).astype(int)]
    return np.maximum(seen.sum(axis=-1), LINES.min_rows)


def inner_stripe_shift(profiles: Sequence[MarkingProfile | None]) -> np.ndarray:
    """Shift (15,) of the parameters from the fitted lines to the stripes next to the lane.

    Fits follow the centre of a double line. `profiles` are those of the left and the right line; None shifts nothing.
    """
    left, right = (p.stripe_m(side) if p else 0.0 for p, side in zip(profiles, SIDES, strict=True))
    shift = np.zeros(PARAMETERS)
    shift[[CENTRE, WIDTH]] = (left + right) / 2, left - right
    return shift


def describe_lane(
    model: np.ndarray, covariance: np.ndarray, observations: Observations, *, score: float, margin: float
) -> Lane:
    """The lane of parameters (15,) and covariance (15, 15), with the observations of its lines."""
    std = np.sqrt(np.diag(covariance))
    left, right = (
        LaneLine(
            *line_coefficients(model, side),
            c0_std_m=line_std,
            support=seen.support,
            reach_m=seen.reach_m,
            seen=seen.support >= LINES.min_support,
            profile=seen.profile,
        )
        for side, line_std, seen in zip(SIDES, lateral_std_m(covariance, 0.0).tolist(), observations, strict=True)
    )
    return Lane(
        offset_m=float(-model[CENTRE]),
        offset_std_m=float(std[CENTRE]),
        heading_rad=float(model[HEADING]),
        # of the concentric arc through the car
        curvature_per_m=float(model[CURVATURE] / (1 - model[CURVATURE] * model[CENTRE])),
        curvature_std_per_m=float(std[CURVATURE]),
        curvature_rate_per_m2=float(model[RATE]),
        width_m=float(model[WIDTH]),
        width_std_m=float(std[WIDTH]),
        pitch_rad=float(model[PITCH]),
        vertical_per_m=float(model[VERTICAL_CURVATURE][0]),
        left=left,
        right=right,
        score=score,
        margin=margin,
        model=model,
        covariance=covariance,
    )
