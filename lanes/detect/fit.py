"""Robust fit of both lines of a lane to the stripes.

Iteratively reweighted least squares: each stripe belongs to the nearest line, with a weight that grows with its
strength and falls with its distance and with the difference of the directions. The fit begins near the car and extends
outwards step by step, so that it stays on lines that bend. Because of a prior on the parameters, one line or a few
dashes are sufficient.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.paint import Stripes, marking_weight, position_std
from lanes.detect.residuals import intersect_ground, stripe_residuals
from lanes.detect.road import (
    BEND,
    LIMIT,
    PARAMETERS,
    PRIOR_MEAN,
    SIDES,
    bend_gradients,
    is_ego_lane,
    lines_on_view,
    prior_std,
    score_lanes,
)
from lanes.detect.votes import suppress_non_maxima

# Steps of a fit: (far_m, scale) uses the stripes nearer than `far_m`, with standard deviations times `scale`.
Schedule = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class FitParameters:
    """Schedules, weights and thresholds; tuned on the labelled Udacity stills and the rendered suite."""

    # First steps from a start hypothesis, and the steps that follow them.
    start: Schedule = ((16, 6), (20, 4), (26, 4))
    extend: Schedule = ((34, 3), (44, 3), (56, 2), (70, 1.5), (70, 1))
    # Smaller steps, for roads so curved or hilly that distant stripes are far from where they are expected.
    outwards: Schedule = (
        *((far_m, 3.0) for far_m in (9.0, 11.0, 13.0, 16.0, 19.0, 23.0)),
        *((28.0, 2.0), (35.0, 2.0), (45.0, 2.0), (70.0, 1.0), (70.0, 1.0)),
    )
    # Steps near a prediction.
    near: Schedule = ((70.0, 1.5), (70.0, 1.0))
    # Model error: deviation of real roads from the model at `model_error_at_m`; it grows with the cube of the distance.
    model_error_m: float = 0.08
    model_error_at_m: float = 40.0
    # A stripe belongs to a line if its weight is larger than this.
    min_weight: float = 0.25
    # Stripes nearer to a line than this, in distance and direction, and up to this distance ahead. If their marking
    # weight exceeds the weight of all stripes that the fit explains, at any distance, by `max_unexplained`, the road
    # may bend or undulate more. (To count the explained ones up to the same distance takes 40 % longer, for nothing.)
    nearby_m: float = 0.5
    nearby_rad: float = 0.3
    nearby_far_m: float = 45.0
    max_unexplained: float = 8.0
    # Vertical curvature added to the prior's standard deviation for roads that undulate, and the weight of stripes that
    # such a fit must gain.
    undulation_std_per_m: float = 4e-3
    undulation_gain: float = 6.0
    # Sharpest bend of most roads, a radius of 15 m, which few mountain roads have; its standard deviation; and the
    # distances at which it is the limit. A fit follows the rate at which a bend begins, but not far ahead: the end of
    # that transition is hidden, or too far away to be measured.
    max_bend_per_m: float = 1 / 15
    max_bend_std_per_m: float = 0.01
    max_bend_at_m: tuple[float, ...] = (24.0, 40.0)
    # Start hypotheses that are fitted to the end. Those that differ in pitch by more than this are kept apart: near the
    # car a little more pitch looks like a little less width.
    hypotheses: int = 3
    same_pitch_rad: float = 0.008
    # Variance inflation: the errors of stripes in one frame are correlated (same paint, same lens).
    variance_inflation: float = 4.0
    # Support of a line is counted up to this distance, over at least this many rows: three rows are no reliable share.
    support_far_m: float = 50.0
    min_support_rows: int = 30
    # A line is seen if its support is at least this. A lane is seen if its lines and the far lines of adjacent lanes
    # together have this support.
    min_support: float = 0.03


FIT = FitParameters()
# Derivatives of the curvatures at `FIT.max_bend_at_m` by the lane parameters.
_BENDS_AHEAD = np.zeros((len(FIT.max_bend_at_m), PARAMETERS))
_BENDS_AHEAD[:, BEND] = bend_gradients(np.array(FIT.max_bend_at_m))[1].T


@dataclass(frozen=True, eq=False)
class LaneFit:
    """K lanes fitted to the stripes of one frame."""

    # (K, 15) parameters as in `lanes.detect.road`; (K, 15, 15) their inverse covariance, prior included, and that of
    # the prior alone.
    lane: np.ndarray
    information: np.ndarray
    prior: np.ndarray
    # (K, stripes) weight of each stripe, 0 to 1, and the line that it is nearest to, as in `StripeResiduals`.
    weight: np.ndarray
    side: np.ndarray
    # (K,) sum of the marking weights of the stripes near the lines, explained by the fit or not.
    nearby_weight: np.ndarray
    # (K, stripes) residuals in assumed standard deviations.
    normalized: np.ndarray
    stripes: Stripes
    view: BirdsEyeView

    @cached_property
    def covariance(self) -> np.ndarray:
        """(K, 15, 15) covariance of the parameters for the noise that the fit assumes."""
        return np.linalg.inv(self.information)

    @cached_property
    def explained(self) -> np.ndarray:
        """(K,) sum of the weights of the stripes."""
        return self.weight.sum(axis=1)

    @property
    def explained_share(self) -> np.ndarray:
        """(K,) share of the marking weight up to `FIT.nearby_far_m` that the lines of the lanes explain."""
        near = self.stripes.x_m < FIT.nearby_far_m
        # one stripe more on either side: a picture without stripes has no clutter
        return (1 + self.weight @ near) / (1 + float(marking_weight(self.stripes) @ near))

    @cached_property
    def on_line(self) -> np.ndarray:
        """(K, 2, stripes) bool: the stripe is nearest to the left or to the right line of the lane."""
        return self.side[:, None] == SIDES[:, None]

    @cached_property
    def members(self) -> np.ndarray:
        """(K, 2, stripes) bool: the stripe belongs to the left or to the right line of the lane."""
        return self.on_line & (self.weight > FIT.min_weight)[:, None]

    @cached_property
    def reach_m(self) -> np.ndarray:
        """(K, 2) distance of the farthest stripe of each line on the lane's road; 0 without any."""
        x = self.stripes.x_m
        flat_m = np.where(self.members, x, 1.0).max(axis=-1, initial=1.0)
        return np.where(self.members.any(axis=-1), intersect_ground(flat_m, self.lane, self.view.height_m).x_m, 0.0)

    @cached_property
    def lines_y_m(self) -> np.ndarray:
        """(K, 2, rows) lateral positions of both lines in the rows of the view; NaN where a line does not pass."""
        return lines_on_view(self.lane, self.view.x_m, self.view.height_m)

    @cached_property
    def marked_rows(self) -> np.ndarray:
        """(K, 2) rows up to `FIT.support_far_m` with markings on each line: the sum of its stripes' weights."""
        weight = self.weight * (self.stripes.x_m < FIT.support_far_m)
        return (weight[:, None] * self.on_line).sum(axis=-1)

    @cached_property
    def visible_rows(self) -> np.ndarray:
        """(K, 2) visible rows of each line up to `FIT.support_far_m`, at least `FIT.min_support_rows`."""
        view = self.view
        rows = np.flatnonzero(view.x_m < FIT.support_far_m)
        column = (view.y_m[0] - self.lines_y_m[..., rows]) / view.cell_m
        inside = (column >= 0) & (column <= len(view.y_m) - 1)
        seen = inside & view.seen[rows, np.where(inside, column, 0).astype(int)]
        return np.maximum(seen.sum(axis=-1), FIT.min_support_rows)

    @property
    def support(self) -> np.ndarray:
        """(K, 2) support of each line: share of its visible rows with markings on it."""
        return self.marked_rows / self.visible_rows

    @property
    def seen(self) -> np.ndarray:
        """(K,) bool: the lines of the lane and the far lines of adjacent lanes have enough support together.

        Worn lines and raised dots can be too faint to be seen one by one. They lie parallel, a lane apart.
        """
        marked = self.weight @ (self.stripes.x_m < FIT.support_far_m)
        return marked >= FIT.min_support * self.visible_rows.max(axis=1)

    @property
    def score(self) -> np.ndarray:
        """(K,) score of the lanes, as `score_lanes`, minus 1 for lanes that the car is not in."""
        return score_lanes(self.lane, self.support) - ~is_ego_lane(self.lane)

    def joined(self, other: LaneFit) -> LaneFit:
        """The lanes of two fits to the same stripes."""
        names = ("lane", "information", "prior", "weight", "side", "nearby_weight", "normalized")
        joined: dict[str, Any] = {name: np.concatenate([getattr(self, name), getattr(other, name)]) for name in names}
        return replace(self, **joined)


def near_stripes(stripes: Stripes) -> Stripes:
    """The stripes that a search begins with: those within the last step of `FIT.start`."""
    return stripes.select(stripes.x_m < FIT.start[-1][0])


def fit_starts(starts: np.ndarray, stripes: Stripes, view: BirdsEyeView) -> LaneFit:
    """Fit start hypotheses (K, 15) without a prediction: `FIT.hypotheses` lanes, after non-maximum suppression.

    If the best one leaves many stripes nearby unexplained, it is also fitted as a road that undulates; that lane is
    added if it explains more.
    """
    first = fit_lanes(starts, near_stripes(stripes), view, schedule=FIT.start)
    support = np.sqrt((first.weight[:, None] * first.on_line).sum(-1)).sum(-1)
    # lanes that the car is not in come last
    order = np.argsort(~is_ego_lane(first.lane) * 1e3 - support, kind="stable")
    lanes = suppress_non_maxima(first.lane[order], FIT.hypotheses, same_pitch_rad=FIT.same_pitch_rad)
    fit = fit_lanes(lanes, stripes, view)
    best = int(fit.explained.argmax())
    if fit.explained[best] > fit.nearby_weight[best] - FIT.max_unexplained:
        return fit
    undulating = fit_lanes(
        lanes[best][None], stripes, view, schedule=FIT.outwards, extra_vertical_per_m=FIT.undulation_std_per_m
    )
    gained = undulating.explained[0] > fit.explained[best] + FIT.undulation_gain
    return fit.joined(undulating) if gained else fit


def fit_near(stripes: Stripes, mean: np.ndarray, covariance: np.ndarray, view: BirdsEyeView) -> LaneFit:
    """The lane near a prediction (15,) with covariance (15, 15): the update of an extended Kalman filter.

    The weights reject outliers, so there is no separate gate. The step is small, so that the residuals are linearised
    once, at the prediction.
    """
    std, marking, model_error = position_std(stripes, view.focal_px), marking_weight(stripes), model_error_m(stripes)
    predicted = stripe_residuals(mean[None], stripes, view.height_m)
    jacobian = predicted.jacobian[0]
    prior_information = np.linalg.inv(covariance)
    residuals, step = predicted, np.zeros_like(mean)
    for far_m, scale in FIT.near:
        weight = residuals.weights(std * scale)[0] * marking * (stripes.x_m < far_m)
        weighted = jacobian * (weight / (FIT.variance_inflation * ((std * scale) ** 2 + model_error**2)))
        information = weighted @ jacobian.T + prior_information
        step = step - np.linalg.solve(information, weighted @ residuals.residual_m[0] + prior_information @ step)
        step = limit_bends((mean + step)[None], information[None])[0] - mean
        residuals = replace(predicted, residual_m=predicted.residual_m + step @ jacobian)
    nearby = (predicted.near(FIT.nearby_m, FIT.nearby_rad) & (stripes.x_m < FIT.nearby_far_m)) @ marking
    normalized = residuals.residual_m / np.sqrt(std**2 + model_error_m(stripes) ** 2)
    # the weights are those before the last step, which is small
    return LaneFit(
        (mean + step)[None],
        information[None],
        prior_information[None],
        weight[None],
        predicted.side,
        nearby,
        normalized,
        stripes,
        view,
    )


def fit_lanes(
    lanes: np.ndarray,
    stripes: Stripes,
    view: BirdsEyeView,
    *,
    prior_mean: np.ndarray = PRIOR_MEAN,
    prior_information: np.ndarray | None = None,
    schedule: Schedule = FIT.extend,
    extra_vertical_per_m: float = 0.0,
    variance_inflation: float = 1.0,
) -> LaneFit:
    """Refine lanes (K, 15) by iteratively reweighted least squares.

    Each step weights a stripe by its strength, by its distance from the nearest line (Geman-McClure) and by the
    difference of the directions, then solves the normal equations together with the prior.

    `schedule` holds steps (far_m, scale). The prior has the mean (15,) and the inverse covariance (15, 15) of a
    prediction, by default those of `prior_std` at the lane of each step. The stripes' variances are multiplied by
    `variance_inflation`.
    """
    lanes = np.array(lanes, float)
    for far_m, scale in schedule:
        used = stripes.select(stripes.x_m < far_m)
        residuals, std = stripe_residuals(lanes, used, view.height_m), scale * position_std(used, view.focal_px)
        precision = marking_weight(used) / (variance_inflation * (std**2 + model_error_m(used) ** 2))
        weighted = residuals.jacobian * (residuals.weights(std, angle_scale=scale) * precision)[:, None]
        prior = prior_information
        if prior is None:
            prior_variance = np.square(prior_std(lanes, extra_vertical_per_m=extra_vertical_per_m))
            prior = np.eye(PARAMETERS) / prior_variance[..., None]
        information = weighted @ np.swapaxes(residuals.jacobian, -1, -2) + prior
        gradient = weighted @ residuals.residual_m[..., None] + prior @ (lanes - prior_mean)[..., None]
        lanes = limit_bends(lanes - np.linalg.solve(information, gradient)[..., 0], information)
        lanes = np.clip(lanes, -LIMIT, LIMIT)
    residuals, std = stripe_residuals(lanes, stripes, view.height_m), position_std(stripes, view.focal_px)
    marking = marking_weight(stripes)
    nearby = (residuals.near(FIT.nearby_m, FIT.nearby_rad) & (stripes.x_m < FIT.nearby_far_m)) @ marking
    weight = residuals.weights(std) * marking
    normalized = residuals.residual_m / np.sqrt(std**2 + model_error_m(stripes) ** 2)
    prior = np.broadcast_to(np.asarray(prior), information.shape)
    return LaneFit(lanes, information, prior, weight, residuals.side, nearby, normalized, stripes, view)


def limit_bends(lanes: np.ndarray, information: np.ndarray) -> np.ndarray:
    """Lanes (K, 15) with this information (K, 15, 15) that bend about as much as roads do, at most.

    Where a lane bends more than `FIT.max_bend_per_m`, that limit is a measurement of the curvature: the update of a
    Kalman filter moves the lane towards it, along the parameters that are least certain.
    """
    if np.abs(lanes @ _BENDS_AHEAD.T).max() <= FIT.max_bend_per_m:
        return lanes
    for gradient in _BENDS_AHEAD:
        curvature = lanes @ gradient
        excess = curvature - np.clip(curvature, -FIT.max_bend_per_m, FIT.max_bend_per_m)
        spread = np.linalg.solve(information, gradient[:, None])[..., 0]
        gain = spread / (spread @ gradient + FIT.max_bend_std_per_m**2)[:, None]
        lanes = lanes - gain * excess[:, None]
    return lanes


def model_error_m(stripes: Stripes) -> np.ndarray:
    """(stripes,) standard deviation of the road's distance from the model at each stripe, metres."""
    share = stripes.x_m / FIT.model_error_at_m
    return FIT.model_error_m * (share * share * share)
