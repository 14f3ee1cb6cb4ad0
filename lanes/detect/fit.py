"""Robust fit of both lines of a lane to the stripes: the one estimator of a search and
of the tracker.

Iteratively reweighted least squares: each stripe belongs to the nearest line, with a
weight that grows with its strength and falls with its distance (Geman-McClure) and with
the difference of the directions. A search begins near the car and extends outwards step
by step, so that it stays on lines that bend. The prior is that of roads, or the
tracker's prediction. Because of it one line or a few dashes are sufficient.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.evidence import Stripes
from lanes.detect.residuals import StripeResiduals, intersect_ground, stripe_residuals
from lanes.detect.road import (
    PARAMETERS,
    SIDES,
    WIDTH,
    RoadPrior,
    UsualWidth,
    is_ego_lane,
    lines_on_view,
)

# Steps of a fit: (far_m, scale) uses the stripes nearer than `far_m`, with standard
# deviations times `scale`.
Schedule = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class FitSettings:
    """Prior, schedules, weights and thresholds.

    Tuned on the labelled Udacity stills and the rendered suite.
    """

    prior: RoadPrior = field(default_factory=RoadPrior)
    # First steps from a start hypothesis, and the steps that follow them.
    start: Schedule = ((16, 6), (20, 4), (26, 4))
    extend: Schedule = ((34, 3), (44, 3), (56, 2), (70, 1.5), (70, 1))
    # Smaller steps, for roads so curved or hilly that distant stripes are far from
    # where they are expected.
    outwards: Schedule = (
        (9, 3),
        (11, 3),
        (13, 3),
        (16, 3),
        (19, 3),
        (23, 3),
        (28, 2),
        (35, 2),
        (45, 2),
        (70, 1),
        (70, 1),
    )
    # Variance inflation of the tracker's fits: the errors of stripes in one frame are
    # correlated (same paint and lens).
    variance_inflation: float = 4.0
    # Stripes nearer to a line than this, in distance (m) and direction (rad), and up to
    # this distance ahead. If a fit explains less weight than theirs by a larger share
    # than `max_unexplained`, the road may bend or undulate more.
    nearby: tuple[float, float, float] = (0.5, 0.3, 45.0)
    max_unexplained: float = 0.2
    # Weight of stripes that the fit of a road that undulates must gain.
    undulation_gain: float = 6.0
    # Support of a line is counted up to this distance.
    support_far_m: float = 50.0
    # A line is seen if its support is at least this. A lane is seen if its lines and
    # the far lines of adjacent lanes together have this support.
    min_support: float = 0.03


@dataclass(frozen=True, eq=False)
class Fit:
    """K lanes fitted to the stripes of one image."""

    # (K, 15) parameters as in `lanes.detect.road`, and (K, 15, 15) their inverse
    # covariance, prior included.
    lanes: np.ndarray
    information: np.ndarray
    residuals: StripeResiduals
    stripes: Stripes
    view: BirdsEyeView
    settings: FitSettings

    @cached_property
    def covariance(self) -> np.ndarray:
        """(K, 15, 15) covariance of the parameters for the noise that the fit
        assumes.
        """
        return np.linalg.inv(self.information)

    @cached_property
    def weight(self) -> np.ndarray:
        """(K, stripes) weight of each stripe, 0 to 1."""
        return self.residuals.weights(self.stripes.std_m) * self.stripes.weight

    @cached_property
    def explained(self) -> np.ndarray:
        """(K,) sum of the weights of the stripes."""
        return self.weight.sum(axis=1)

    @cached_property
    def unexplained(self) -> np.ndarray:
        """(K,) bool: many stripes near the lines are not explained.

        The road may bend or undulate more.
        """
        distance_m, angle_rad, far_m = self.settings.nearby
        is_close = np.abs(self.residuals.residual_m) < distance_m
        is_parallel = np.abs(self.residuals.angle_residual_rad) < angle_rad
        nearby = is_close & (self.stripes.x_m < far_m) & is_parallel
        least_share = 1 - self.settings.max_unexplained
        return self.explained < least_share * (nearby @ self.stripes.weight)

    @cached_property
    def on_line(self) -> np.ndarray:
        """(K, 2, stripes) bool: the stripe is nearest to the left or to the
        right line.
        """
        return self.residuals.side[:, None] == SIDES[:, None]

    @cached_property
    def members(self) -> np.ndarray:
        """(K, 2, stripes) bool: the stripe belongs to the left or to the right line."""
        least_weight = 0.25 * self.stripes.full_weight
        return self.on_line & (self.weight > least_weight)[:, None]

    @cached_property
    def extent_m(self) -> np.ndarray:
        """(K, 2, 2) distance of the nearest and the farthest stripe of each line.

        It is on the lane's road, and 0 without any stripe. The farthest one is the last
        before a gap of more than 16 m: German dashes are 12 m apart, and may be half
        seen at either end. Stripes behind such a gap are often on a vehicle that hides
        the road.
        """
        beyond_m = np.full((*self.members.shape[:2], 1), 1e6)
        x_m = np.sort(np.where(self.members, self.stripes.x_m, beyond_m), axis=-1)
        x_m = np.concatenate([x_m, beyond_m], axis=-1)
        gaps_m = np.diff(x_m, append=2 * beyond_m)
        last = (gaps_m > 16.0).argmax(axis=-1)
        last_m = np.take_along_axis(x_m, last[..., None], axis=-1)
        ends_m = np.stack([x_m[..., 0], last_m[..., 0]], axis=-1)

        marked = self.members.any(axis=-1, keepdims=True)
        flat_m = np.where(marked, ends_m, 1.0).reshape(len(self.lanes), -1)
        ground = intersect_ground(flat_m, self.lanes, self.view.height_m)
        return np.where(marked, ground.x_m.reshape(ends_m.shape), 0.0)

    @cached_property
    def lines_y_m(self) -> np.ndarray:
        """(K, 2, rows) lateral positions of both lines in the rows of the view.

        NaN where a line does not pass.
        """
        return lines_on_view(self.lanes, self.view.x_m, self.view.height_m)

    @cached_property
    def marked_rows(self) -> np.ndarray:
        """(K, 2) rows up to `support_far_m` with markings on each line.

        It is the sum of the weights of the line's stripes.
        """
        is_near = self.stripes.x_m < self.settings.support_far_m
        weight = self.weight * is_near
        return (weight[:, None] * self.on_line).sum(axis=-1)

    @cached_property
    def visible_rows(self) -> np.ndarray:
        """(K, 2) visible rows of each line up to `support_far_m`.

        At least 30: three rows are no reliable share.
        """
        view = self.view
        rows = np.flatnonzero(view.x_m < self.settings.support_far_m)
        column = (view.y_m[0] - self.lines_y_m[..., rows]) / view.cell_m
        inside = (column >= 0) & (column <= len(view.y_m) - 1)
        cell = np.where(inside, column, 0).astype(int)
        seen = inside & view.seen[rows, cell]
        return np.maximum(seen.sum(axis=-1), 30)

    @property
    def support(self) -> np.ndarray:
        """(K, 2) support of each line: share of its visible rows with markings
        on it.
        """
        return self.marked_rows / self.visible_rows

    @property
    def seen(self) -> np.ndarray:
        """(K,) bool: the lines of the lane and the far lines have enough support
        together.

        Worn lines and raised dots can be too faint to be seen one by one. They lie
        parallel, a lane apart.
        """
        is_near = self.stripes.x_m < self.settings.support_far_m
        marked = self.weight @ is_near
        least = self.settings.min_support * self.visible_rows.max(axis=1)
        return marked >= least


class LanePrior(NamedTuple):
    """A Gaussian prior of lanes: mean (15,), inverse covariance (..., 15, 15).

    `inflation` is the factor on the variances of the stripes that are combined with it.
    """

    mean: np.ndarray
    information: np.ndarray
    inflation: float = 1.0


def road_prior(
    lanes: np.ndarray, settings: FitSettings, extra_vertical_per_m: float
) -> LanePrior:
    """The prior of roads that bend as the lanes (K, 15) do.

    `extra_vertical_per_m` is added to the standard deviation of the vertical curvature.
    """
    prior = settings.prior
    std = prior.std_at(lanes, extra_vertical_per_m=extra_vertical_per_m)
    information = np.eye(PARAMETERS) / np.square(std)[..., None]
    return LanePrior(prior.mean, information)


def predicted_prior(
    mean: np.ndarray, covariance: np.ndarray, settings: FitSettings
) -> LanePrior:
    """The prior of a prediction (15,) with covariance (15, 15).

    A fit with it is the measurement update of an extended Kalman filter.
    """
    return LanePrior(mean, np.linalg.inv(covariance), settings.variance_inflation)


def near_stripes(stripes: Stripes, settings: FitSettings) -> Stripes:
    """The stripes that a search begins with: those within the last step of `start`."""
    far_m, _ = settings.start[-1]
    return stripes.select(stripes.x_m < far_m)


def fit_starts(
    starts: np.ndarray,
    near: Stripes,
    stripes: Stripes,
    view: BirdsEyeView,
    settings: FitSettings,
    usual_width: UsualWidth | None = None,
) -> tuple[Fit, Fit]:
    """Fit start hypotheses (K, 15) to the `near` stripes, and the best to all: both
    fits.

    The second is that of one lane, the best of three. The best lane has the largest sum
    of the square roots of its lines' supports, less the cost of a width that is odd in
    the drive, if `usual_width` is known; lanes that the car is not in come last. If it
    leaves many stripes nearby unexplained, it is also fitted as a road that undulates.
    """
    # all hypotheses near the car
    begun = fit_lanes(starts, near, view, settings, schedule=settings.start)
    marked = (begun.weight[:, None] * begun.on_line).sum(-1)
    near_rows = int((view.x_m < settings.start[-1][0]).sum())
    cost = np.sqrt(near_rows) * _width_costs(begun.lanes, usual_width)
    order = _best_first(begun.lanes, np.sqrt(marked).sum(-1) - cost)

    # the best three outwards
    fits = fit_lanes(begun.lanes[order[:3]], stripes, view, settings)
    scores = np.sqrt(fits.support).sum(1) - _width_costs(fits.lanes, usual_width)
    best = _best_first(fits.lanes, scores)[:1]
    residuals = stripe_residuals(fits.lanes[best], stripes, view.height_m)
    fit = Fit(
        lanes=fits.lanes[best],
        information=fits.information[best],
        residuals=residuals,
        stripes=stripes,
        view=view,
        settings=settings,
    )
    if not fit.unexplained[0]:
        return begun, fit

    # a standard deviation of 4e-3 1/m: crests and dips with a radius of 250 m
    undulating = fit_lanes(
        fit.lanes,
        stripes,
        view,
        settings,
        schedule=settings.outwards,
        extra_vertical_per_m=4e-3,
    )
    gain = undulating.explained[0] - fit.explained[0]
    return begun, undulating if gain > settings.undulation_gain else fit


def _width_costs(lanes: np.ndarray, usual: UsualWidth | None) -> np.ndarray:
    """(K,) costs of widths of lanes (K, 15) that are odd in a drive."""
    if usual is None:
        return np.zeros(len(lanes))
    return usual.cost(lanes[:, WIDTH])


def _best_first(lanes: np.ndarray, scores: np.ndarray) -> np.ndarray:
    """Indices of lanes (K, 15) by falling score; those that the car is not in come
    last.
    """
    return np.lexsort((-scores, ~is_ego_lane(lanes)))


def fit_lanes(
    lanes: np.ndarray,
    stripes: Stripes,
    view: BirdsEyeView,
    settings: FitSettings,
    *,
    schedule: Schedule | None = None,
    prior: LanePrior | None = None,
    extra_vertical_per_m: float = 0.0,
) -> Fit:
    """Refine lanes (K, 15) outwards: robust least squares together with a prior.

    Each step of the schedule weights the stripes and solves the normal equations.

    Parameters
    ----------
    schedule : Schedule, optional
        Steps (far_m, scale); `settings.extend` by default.
    prior : LanePrior, optional
        By default that of roads that bend as the lane of each step.
    extra_vertical_per_m : float
        Vertical curvature added to the standard deviation of the prior of roads.
    """
    lanes = np.array(lanes, float)
    information = np.empty(0)
    for far_m, scale in schedule or settings.extend:
        used = stripes.select(stripes.x_m < far_m)
        residuals = stripe_residuals(lanes, used, view.height_m)
        step_prior = prior
        if step_prior is None:
            step_prior = road_prior(lanes, settings, extra_vertical_per_m)
        jacobian = residuals.jacobian()
        information, gradient = normal_equations(
            jacobian, lanes, residuals, used, step_prior, scale
        )
        lanes = _step(lanes, information, gradient, settings)

    residuals = stripe_residuals(lanes, stripes, view.height_m)
    return Fit(lanes, information, residuals, stripes, view, settings)


def fit_near_prediction(
    lanes: np.ndarray,
    stripes: Stripes,
    view: BirdsEyeView,
    settings: FitSettings,
    *,
    schedule: Schedule,
    prior: LanePrior,
) -> Fit:
    """Refine lanes (K, 15) near a prediction: the residuals are linearised there once.

    The steps are small, so all stripes are used in each.
    """
    information = np.empty(0)
    residuals = stripe_residuals(lanes, stripes, view.height_m)
    jacobian = residuals.jacobian()
    for _, scale in schedule:
        information, gradient = normal_equations(
            jacobian, lanes, residuals, stripes, prior, scale
        )
        refined = _step(lanes, information, gradient, settings)
        residuals = residuals.moved(refined - lanes, jacobian)
        lanes = refined
    return Fit(lanes, information, residuals, stripes, view, settings)


def normal_equations(
    jacobian: np.ndarray,
    lanes: np.ndarray,
    residuals: StripeResiduals,
    stripes: Stripes,
    prior: LanePrior,
    scale: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Information matrix (K, 15, 15) and gradient (K, 15, 1) of the cost at lanes (K,
    15).

    `jacobian` J (K, 15, stripes) is that of the residuals, W the diagonal matrix of the
    robust weights over the variances; the terms of stripes and prior add up. The
    standard deviations of the stripes are multiplied by `scale`.
    """
    std_m = scale * stripes.std_m
    robust = residuals.weights(std_m, angle_scale=scale)
    W = robust * stripes.weight / std_m**2
    JW = jacobian * W[:, None]
    JW /= prior.inflation

    from_mean = (lanes - prior.mean)[..., None]
    information = JW @ np.swapaxes(jacobian, -1, -2) + prior.information
    gradient = JW @ residuals.residual_m[..., None] + prior.information @ from_mean
    return information, gradient


def _step(
    lanes: np.ndarray,
    information: np.ndarray,
    gradient: np.ndarray,
    settings: FitSettings,
) -> np.ndarray:
    """The lanes (K, 15) after one Gauss-Newton step, within the limits of roads."""
    step = np.linalg.solve(information, gradient)[..., 0]
    limit = settings.prior.limit
    return np.clip(lanes - step, -limit, limit)
