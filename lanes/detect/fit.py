"""Robust fit of both lines of a lane to the stripes: the one estimator of a search and of the tracker.

Iteratively reweighted least squares: each stripe belongs to the nearest line, with a weight that grows with its
strength and falls with its distance (Geman-McClure) and with the difference of the directions. A search begins near the
car and extends outwards step by step, so that it stays on lines that bend. The prior is that of roads, or the tracker's
prediction. Because of it one line or a few dashes are sufficient.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.paint import PAINT, Stripes
from lanes.detect.residuals import StripeResiduals, intersect_ground, stripe_residuals
from lanes.detect.road import PARAMETERS, SIDES, RoadPrior, is_ego_lane, lines_on_view

# Steps of a fit: (far_m, scale) uses the stripes nearer than `far_m`, with standard deviations times `scale`.
Schedule = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class FitSettings:
    """Prior, schedules, weights and thresholds; tuned on the labelled Udacity stills and the rendered suite."""

    prior: RoadPrior = field(default_factory=RoadPrior)
    # First steps from a start hypothesis, and the steps that follow them.
    start: Schedule = ((16, 6), (20, 4), (26, 4))
    extend: Schedule = ((34, 3), (44, 3), (56, 2), (70, 1.5), (70, 1))
    # Smaller steps, for roads so curved or hilly that distant stripes are far from where they are expected.
    outwards: Schedule = (
        *((far_m, 3.0) for far_m in (9.0, 11.0, 13.0, 16.0, 19.0, 23.0)),
        *((28.0, 2.0), (35.0, 2.0), (45.0, 2.0), (70.0, 1.0), (70.0, 1.0)),
    )
    # Start hypotheses that are fitted to all stripes.
    finalists: int = 3
    # Variance inflation of the tracker's fits: the errors of stripes in one frame are correlated (same paint and lens).
    variance_inflation: float = 4.0
    # A stripe belongs to a line if its weight is larger than this.
    min_weight: float = 0.25
    # Stripes nearer to a line than this, in distance (m) and direction (rad), and up to this distance ahead. If a fit
    # explains less weight than theirs by a larger share than `max_unexplained`, the road may bend or undulate more.
    nearby: tuple[float, float, float] = (0.5, 0.3, 45.0)
    max_unexplained: float = 0.2
    # Vertical curvature added to the prior's standard deviation for roads that undulate, and the weight of stripes that
    # such a fit must gain.
    undulation_std_per_m: float = 4e-3
    undulation_gain: float = 6.0
    # Support of a line is counted up to this distance, over at least this many rows: three rows are no reliable share.
    support_far_m: float = 50.0
    min_support_rows: int = 30
    # A line ends, for `Fit.extent_m`, before a longer gap in its stripes: German dashes are 12 m apart, and may be half
    # seen at either end. Stripes behind such a gap are often on a vehicle that hides the road.
    max_gap_m: float = 16.0
    # A line is seen if its support is at least this. A lane is seen if its lines and the far lines of adjacent lanes
    # together have this support.
    min_support: float = 0.03


FIT = FitSettings()


@dataclass(frozen=True, eq=False)
class Fit:
    """K lanes fitted to the stripes of one image."""

    # (K, 15) parameters as in `lanes.detect.road`, and (K, 15, 15) their inverse covariance, prior included.
    lanes: np.ndarray
    information: np.ndarray
    residuals: StripeResiduals
    stripes: Stripes
    view: BirdsEyeView
    settings: FitSettings

    @cached_property
    def covariance(self) -> np.ndarray:
        """(K, 15, 15) covariance of the parameters for the noise that the fit assumes."""
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
        """(K,) bool: many stripes near the lines are not explained, so the road may bend or undulate more."""
        distance_m, angle_rad, far_m = self.settings.nearby
        nearby = (np.abs(self.residuals.residual_m) < distance_m) & (self.stripes.x_m < far_m)
        nearby &= np.abs(self.residuals.angle_residual_rad) < angle_rad
        return self.explained < (1 - self.settings.max_unexplained) * (nearby @ self.stripes.weight)

    @cached_property
    def on_line(self) -> np.ndarray:
        """(K, 2, stripes) bool: the stripe is nearest to the left or to the right line of the lane."""
        return self.residuals.side[:, None] == SIDES[:, None]

    @cached_property
    def members(self) -> np.ndarray:
        """(K, 2, stripes) bool: the stripe belongs to the left or to the right line of the lane."""
        min_weight = self.settings.min_weight * np.where(self.stripes.edge, PAINT.edge_weight, 1.0)
        return self.on_line & (self.weight > min_weight)[:, None]

    @cached_property
    def extent_m(self) -> np.ndarray:
        """(K, 2, 2) distance of the nearest and the farthest stripe of each line on the lane's road; 0 without any.

        The farthest one is the last before a gap of more than `max_gap_m`.
        """
        beyond_m = np.full((*self.members.shape[:2], 1), 1e6)
        x_m = np.sort(np.where(self.members, self.stripes.x_m, beyond_m), axis=-1)
        x_m = np.concatenate([x_m, beyond_m], axis=-1)
        last = (np.diff(x_m, append=2 * beyond_m) > self.settings.max_gap_m).argmax(axis=-1)
        ends_m = np.stack([x_m[..., 0], np.take_along_axis(x_m, last[..., None], axis=-1)[..., 0]], axis=-1)
        marked = self.members.any(axis=-1, keepdims=True)
        flat_m = np.where(marked, ends_m, 1.0).reshape(len(self.lanes), -1)
        on_road_m = intersect_ground(flat_m, self.lanes, self.view.height_m).x_m
        return np.where(marked, on_road_m.reshape(ends_m.shape), 0.0)

    @cached_property
    def lines_y_m(self) -> np.ndarray:
        """(K, 2, rows) lateral positions of both lines in the rows of the view; NaN where a line does not pass."""
        return lines_on_view(self.lanes, self.view.x_m, self.view.height_m)

    @cached_property
    def marked_rows(self) -> np.ndarray:
        """(K, 2) rows up to `support_far_m` with markings on each line: the sum of its stripes' weights."""
        weight = self.weight * (self.stripes.x_m < self.settings.support_far_m)
        return (weight[:, None] * self.on_line).sum(axis=-1)

    @cached_property
    def visible_rows(self) -> np.ndarray:
        """(K, 2) visible rows of each line up to `support_far_m`, at least `min_support_rows`."""
        view = self.view
        rows = np.flatnonzero(view.x_m < self.settings.support_far_m)
        column = (view.y_m[0] - self.lines_y_m[..., rows]) / view.cell_m
        inside = (column >= 0) & (column <= len(view.y_m) - 1)
        seen = inside & view.seen[rows, np.where(inside, column, 0).astype(int)]
        return np.maximum(seen.sum(axis=-1), self.settings.min_support_rows)

    @property
    def support(self) -> np.ndarray:
        """(K, 2) support of each line: share of its visible rows with markings on it."""
        return self.marked_rows / self.visible_rows

    @property
    def seen(self) -> np.ndarray:
        """(K,) bool: the lines of the lane and the far lines of adjacent lanes have enough support together.

        Worn lines and raised dots can be too faint to be seen one by one. They lie parallel, a lane apart.
        """
        marked = self.weight @ (self.stripes.x_m < self.settings.support_far_m)
        return marked >= self.settings.min_support * self.visible_rows.max(axis=1)


def near_stripes(stripes: Stripes, settings: FitSettings = FIT) -> Stripes:
    """The stripes that a search begins with: those within the last step of `settings.start`."""
    return stripes.select(stripes.x_m < settings.start[-1][0])


def fit_starts(
    starts: np.ndarray, stripes: Stripes, view: BirdsEyeView, settings: FitSettings = FIT
) -> tuple[Fit, Fit]:
    """Fit start hypotheses (K, 15) to the near stripes, and the best of them to all: both fits, the second of one lane.

    The best lane has the largest sum of the square roots of its lines' supports; lanes that the car is not in come
    last. If it leaves many stripes nearby unexplained, it is also fitted as a road that undulates.
    """
    s = settings
    near = fit_lanes(starts, near_stripes(stripes, s), view, s, schedule=s.start)
    marked = np.sqrt((near.weight[:, None] * near.on_line).sum(-1)).sum(-1)
    order = np.lexsort((-marked, ~is_ego_lane(near.lanes)))[: s.finalists]
    fits = fit_lanes(near.lanes[order], stripes, view, s)
    best = np.lexsort((-np.sqrt(fits.support).sum(1), ~is_ego_lane(fits.lanes)))[:1]
    residuals = stripe_residuals(fits.lanes[best], stripes, view.height_m)
    fit = Fit(fits.lanes[best], fits.information[best], residuals, stripes, view, s)
    if not fit.unexplained[0]:
        return near, fit
    hills = s.undulation_std_per_m
    undulating = fit_lanes(fit.lanes, stripes, view, s, schedule=s.outwards, extra_vertical_per_m=hills)
    return near, undulating if undulating.explained[0] > fit.explained[0] + s.undulation_gain else fit


def fit_lanes(
    lanes: np.ndarray,
    stripes: Stripes,
    view: BirdsEyeView,
    settings: FitSettings = FIT,
    *,
    schedule: Schedule | None = None,
    prior: tuple[np.ndarray, np.ndarray] | None = None,
    extra_vertical_per_m: float = 0.0,
    linear: bool = False,
) -> Fit:
    """Refine lanes (K, 15): each step weights the stripes and solves the normal equations together with the prior.

    Parameters
    ----------
    schedule : Schedule, optional
        Steps (far_m, scale); `settings.extend` by default.
    prior : (ndarray (15,), ndarray (15, 15)), optional
        Mean and covariance of a prediction: this is then the measurement update of an extended Kalman filter, and the
        stripes' variances are inflated. By default the prior is that of roads that bend as the lane of each step.
    extra_vertical_per_m : float
        Vertical curvature added to the standard deviation of the prior of roads.
    linear : bool
        Linearise the residuals once, at the given lanes: near a prediction the steps are small.
    """
    s = settings
    lanes, inflation = np.array(lanes, float), 1.0
    mean, prior_information = s.prior.mean, np.empty(0)
    if prior is not None:
        mean, prior_information, inflation = prior[0], np.linalg.inv(prior[1]), s.variance_inflation
    residuals = stripe_residuals(lanes, stripes, view.height_m) if linear else None
    for far_m, scale in schedule or s.extend:
        used = stripes if linear else stripes.select(stripes.x_m < far_m)
        at_lanes = residuals if linear and residuals else stripe_residuals(lanes, used, view.height_m)
        if prior is None:
            std = s.prior.std_at(lanes, extra_vertical_per_m=extra_vertical_per_m)
            prior_information = np.eye(PARAMETERS) / np.square(std)[..., None]
        std_m = scale * used.std_m
        weighted = at_lanes.jacobian * (at_lanes.weights(std_m, angle_scale=scale) * used.weight / std_m**2)[:, None]
        weighted /= inflation
        information = weighted @ np.swapaxes(at_lanes.jacobian, -1, -2) + prior_information
        gradient = weighted @ at_lanes.residual_m[..., None] + prior_information @ (lanes - mean)[..., None]
        before, step = lanes, np.linalg.solve(information, gradient)[..., 0]
        lanes = np.clip(lanes - step, -s.prior.limit, s.prior.limit)
        residuals = at_lanes.moved(lanes - before) if linear else None
    return Fit(lanes, information, residuals or stripe_residuals(lanes, stripes, view.height_m), stripes, view, s)
