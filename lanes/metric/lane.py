"""The lane in one picture: from raw pixels to metres, with an account of how sure that is.

    raw picture -> observe -> Sight -> search_lane or follow.correct_lane -> LaneFit -> describe_lane -> Lane

`find_lane` runs through all of it for a picture of which nothing is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lanes.camera import Camera
from lanes.metric.attributes import Paint, describe_paint
from lanes.metric.evidence import Evidence, Stripes, find_stripes, measure_paint
from lanes.metric.lanefit import (
    MORE_PAINT,
    OUTWARDS,
    START,
    UNEXPLAINED,
    WAVES_PER_M,
    LaneFit,
    fit_lanes,
    strangeness,
)
from lanes.metric.lanemodel import (
    CENTRE,
    CURVATURE,
    HEADING,
    NUMBERS,
    PITCH,
    RATE,
    SIDES,
    VERTICAL,
    WIDTH,
    line_coefficients,
    line_points,
    line_y,
    lines_on_view,
    meet_ground,
    road_rise,
)
from lanes.metric.roadview import RoadView
from lanes.metric.votes import FAR_M, best_pairs, count_votes, distinct
from lanes.words import describe_bend, describe_heading, describe_offset, html_table

# Rival hypotheses that are followed to the end, and how near two of them are the same lane.
RIVALS, SAME_M = 3, 0.5
# Near by, a little more pitch looks like a little less width; only farther out do such lanes part.
SAME_PITCH_RAD = 0.008
# Support is counted up to this distance, against at least so many rows, that a line just leaving the picture is not
# thought perfect for the three rows it has.
SUPPORT_FAR_M, LEAST_ROWS = 50.0, 30
# How much one squared standard deviation from the prior costs, beside the square roots of the two supports.
PRIOR_WEIGHT = 0.01
# A stripe belongs to a line from this weight on; a line is seen from this support on.
LEAST_WEIGHT, LEAST_SUPPORT = 0.25, 0.03
# Where a line is drawn through, unless asked otherwise: from below the picture to the horizon.
OUTLINE_M = np.geomspace(3.0, 400.0, 120)


@dataclass(frozen=True, eq=False)
class Sight:
    """What one picture shows: its `RoadView.warp`, (rows, columns, 3) uint8, the evidence there and its stripes."""

    view_image: np.ndarray
    evidence: Evidence
    stripes: Stripes


@dataclass(frozen=True, eq=False)
class LaneLine:
    """One line of the lane: y(x) = c0 + c1 x + c2 x^2 / 2 + c3 x^3 / 6 near the car, metres, x forward, y left.

    Attributes
    ----------
    c0_m, c1, c2_per_m, c3_per_m2 : float
    c0_std_m : float
        Standard deviation of `c0_m`.
    support : float
        Share of the line's rows in sight, up to 50 m, that have paint on it: 0.3 is a good dashed line.
    reach_m : float
        How far the evidence goes.
    seen : bool
        False if the line was only inferred from the other one and the usual width of lanes.
    paint : Paint, optional
    """

    c0_m: float
    c1: float
    c2_per_m: float
    c3_per_m2: float
    c0_std_m: float
    support: float
    reach_m: float
    seen: bool
    paint: Paint | None = None

    def in_words(self) -> str:
        """Where the line runs beside the car, and what it rests on."""
        beside = f"{abs(self.c0_m):.2f} ± {self.c0_std_m:.2f} m {'left' if self.c0_m > 0 else 'right'}"
        if not self.seen:
            return f"{beside}, inferred from the other line"
        return f"{beside}, paint on {min(self.support, 1):.0%} of its rows, up to {self.reach_m:.0f} m"


@dataclass(frozen=True, eq=False)
class Lane:
    """The lane that the car is in; SI units, signs as everywhere (offset > 0: car left of the middle).

    Attributes
    ----------
    offset_m, offset_std_m, heading_rad, curvature_per_m, curvature_std_per_m, curvature_rate_per_m2, width_m,
    width_std_m, pitch_rad, vertical_per_m : float
        `heading_rad` is the road's direction seen from the car, positive to the left; `pitch_rad` what the camera looks
        farther down than its mount says; `vertical_per_m` the road's curvature upwards below the car.
    left, right : LaneLine
    score, margin : float
        Sum of the square roots of the supports less what the lane is unusual; and how much better than the next lane.
    model : ndarray (15,)
        Parameters as in `lanes.metric.lanefit`, for the stripes next to the lane.
    covariance : ndarray (15, 15)
    """

    offset_m: float
    offset_std_m: float
    heading_rad: float
    curvature_per_m: float
    curvature_std_per_m: float
    curvature_rate_per_m2: float
    width_m: float
    width_std_m: float
    pitch_rad: float
    vertical_per_m: float
    left: LaneLine
    right: LaneLine
    score: float
    margin: float
    model: np.ndarray
    covariance: np.ndarray

    @classmethod
    def from_model(
        cls,
        model: np.ndarray,
        covariance: np.ndarray,
        lines: tuple[LaneLine, LaneLine],
        *,
        score: float,
        margin: float,
    ) -> Lane:
        """The lane of a fitted model (15,) and its covariance (15, 15), with its left and right line."""
        std = np.sqrt(np.diag(covariance))
        return cls(
            offset_m=float(-model[CENTRE]),
            offset_std_m=float(std[CENTRE]),
            heading_rad=float(model[HEADING]),
            curvature_per_m=float(model[CURVATURE] / (1 - model[CURVATURE] * model[CENTRE])),
            curvature_std_per_m=float(std[CURVATURE]),
            curvature_rate_per_m2=float(model[RATE]),
            width_m=float(model[WIDTH]),
            width_std_m=float(std[WIDTH]),
            pitch_rad=float(model[PITCH]),
            vertical_per_m=float(model[VERTICAL][0]),
            left=lines[0],
            right=lines[1],
            score=score,
            margin=margin,
            model=model,
            covariance=covariance,
        )

    def in_words(self) -> dict[str, str]:
        """What is known of the lane, by name: offset, bend, heading, width and both lines."""
        return {
            "offset": describe_offset(self.offset_m, self.offset_std_m),
            "bend": f"{describe_bend(self.curvature_per_m)} "
            f"({1e3 * self.curvature_per_m:.2f} ± {1e3 * self.curvature_std_per_m:.2f} per km)",
            "heading": describe_heading(self.heading_rad),
            "width": f"{self.width_m:.2f} ± {self.width_std_m:.2f} m",
            "left line": self.left.in_words(),
            "right line": self.right.in_words(),
        }

    def __repr__(self) -> str:
        words = self.in_words()
        return f"Lane({words['offset']}, {describe_bend(self.curvature_per_m)}, {words['width']} wide)"

    def _repr_html_(self) -> str:
        return html_table("Lane", self.in_words())

    def lateral_m(self, x_m: np.ndarray) -> np.ndarray:
        """Lateral places (2, N) of the left and right line at distances (N,), metres; NaN where one has turned back."""
        return np.array([self.line_y(x_m, side) for side in SIDES])

    def line_y(self, x_m: np.ndarray, side: float) -> np.ndarray:
        """Lateral place of the left (side +1) or right (-1) line at distances (N,); NaN where it has turned back."""
        return line_y(np.asarray(x_m, float), self.model, side)

    def rise_m(self, x_m: np.ndarray) -> np.ndarray:
        """Height (N,) of the road at distances (N,) above the plane that the car stands on, metres."""
        return road_rise(self.model, x_m)

    def outline(self, camera: Camera, side: float, *, along_m: np.ndarray = OUTLINE_M) -> np.ndarray:
        """Raw pixels (N, 2) of a line where the lane has run `along_m`, ascending, up to where it is out of sight.

        That is where it turns back or dips behind a crest, or goes out of the lens.
        """
        x, y = line_points(self.model, side, along_m).T
        mount = replace(camera.mount, pitch_rad=camera.mount.pitch_rad + self.pitch_rad)
        points = np.column_stack([x, y, self.rise_m(x)])
        pixels = camera.with_mount(mount).road_to_pixels(points)
        pixels = pixels[np.isfinite(pixels).all(axis=1)]
        back = np.flatnonzero(~(np.diff(pixels[:, 1]) < 0))
        return pixels[: back[0] + 1] if len(back) else pixels

    def pixels(self, camera: Camera, rows: np.ndarray) -> np.ndarray:
        """Columns (2, rows) of the left and the right line at picture rows; -2 where they do not pass."""
        rows = np.asarray(rows, float)
        columns = np.full((2, len(rows)), -2.0)
        for k, side in enumerate(SIDES):
            outline = self.outline(camera, side)
            if len(outline) > 1:
                columns[k] = np.interp(rows, outline[::-1, 1], outline[::-1, 0], left=-2, right=-2)
        return np.where((columns >= 0) & (columns <= camera.width - 1), columns, -2.0)


def find_lane(image: np.ndarray, view: RoadView) -> Lane | None:
    """Find the lane in a picture of which nothing else is known.

    Parameters
    ----------
    image : ndarray of shape (height, width, 3), uint8
        RGB, as taken.
    view : RoadView
        Of the camera that took it.

    Returns
    -------
    Lane or None
        None if neither line is there.
    """
    sight = observe(image, view)
    fit = search_lane(sight.stripes, view)
    return describe_lane(fit, sight, view) if fit else None


def observe(image: np.ndarray, view: RoadView) -> Sight:
    """Look at the road in a raw picture."""
    view_image = view.warp(image)
    evidence = measure_paint(view_image, view)
    return Sight(view_image, evidence, find_stripes(evidence, view))


def search_lane(stripes: Stripes, view: RoadView) -> LaneFit | None:
    """Fit the lanes that the stripes vote for, `RIVALS` of them, best votes first; None if there are no stripes.

    The one with most paint is also fitted as one that waves, and joins them if that explains more.
    """
    near = near_stripes(stripes)
    if not len(near):
        return None
    _, starts = vote_lanes(near, view)
    first = fit_lanes(starts, near, view.height_m, view.focal_px, schedule=START)
    support = np.sqrt((first.weight[:, None] * (first.side[:, None] == SIDES[:, None])).sum(-1)).sum(-1)
    lanes = distinct(
        first.lane[np.argsort(elsewhere(first.lane) * 1e3 - support, kind="stable")],
        RIVALS,
        same_pitch_rad=SAME_PITCH_RAD,
    )
    fit = fit_lanes(lanes, stripes, view.height_m, view.focal_px)
    best = int(fit.weight.sum(axis=1).argmax())
    if fit.weight[best].sum() > fit.beside[best] - UNEXPLAINED:
        return fit
    waved = _fit_waves(lanes[best], stripes, view)
    return fit.joined(waved) if waved.weight.sum() > fit.weight[best].sum() + MORE_PAINT else fit


def _fit_waves(start: np.ndarray, stripes: Stripes, view: RoadView) -> LaneFit:
    """One lane (15,) fitted as if the road might wave up and down."""
    return fit_lanes(start[None], stripes, view.height_m, view.focal_px, schedule=OUTWARDS, waves_per_m=WAVES_PER_M)


def near_stripes(stripes: Stripes) -> Stripes:
    """Those that votes and the beginning of the fit rest on."""
    return stripes.select(stripes.x_m < START[-1][0])


def vote_lanes(near: Stripes, view: RoadView) -> tuple[np.ndarray, np.ndarray]:
    """The vote table (hypotheses, bins) of the stripes nearby, and the lanes (K, 15) that it suggests, best first."""
    votes = count_votes(near, view.height_m)
    return votes, best_pairs(votes, int((view.x_m < FAR_M).sum()))


def describe_lane(fit: LaneFit, sight: Sight, view: RoadView) -> Lane | None:
    """The best of the fitted lanes in metres; None if neither of its lines is seen."""
    lines = lines_on_view(fit.lane, view.x_m, view.height_m)
    support = support_of(fit, lines, sight.stripes, view)
    score = score_lanes(fit.lane, support)
    best = int(score.argmax())
    if support[best].max() < LEAST_SUPPORT:
        return None
    mine = [(fit.side[best] == side) & (fit.weight[best] > LEAST_WEIGHT) for side in SIDES]
    reach_m = reach_of(sight.stripes, mine, fit.lane[best], view.height_m)
    paint = [
        describe_paint(sight.evidence, view, _only(rows, line))
        for rows, line in zip((sight.stripes.row[m] for m in mine), lines[best], strict=True)
    ]
    model, covariance = fit.lane[best] + inner_stripes(paint), np.linalg.inv(fit.information[best])
    rival = np.abs(fit.lane - fit.lane[best])[:, [CENTRE, WIDTH]].max(axis=1) > SAME_M
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


def reach_of(stripes: Stripes, mine: Sequence[np.ndarray], lane: np.ndarray, height_m: float) -> list[float]:
    """How far ahead the stripes of each line, `mine` (stripes,) bool, go on the road of a lane (15,); 0 without any."""
    nearest = float(stripes.x_m.min(initial=1.0))
    flat_m = np.array([stripes.x_m[m].max(initial=nearest) for m in mine])
    met_m = meet_ground(flat_m, lane, height_m).x_m
    return [float(x) if m.any() else 0.0 for x, m in zip(met_m, mine, strict=True)]


def inner_stripes(paint: Sequence[Paint | None]) -> np.ndarray:
    """What leads from a fitted lane to the one between the stripes next to it, (15,): fits follow a double's middle.

    `paint` is that of the left and the right line; None moves nothing.
    """
    left, right = (p.stripe_m(side) if p else 0.0 for p, side in zip(paint, SIDES, strict=True))
    shift = np.zeros(NUMBERS)
    shift[[CENTRE, WIDTH]] = (left + right) / 2, left - right
    return shift


def score_lanes(lanes: np.ndarray, support: np.ndarray) -> np.ndarray:
    """(K,) how good lanes (K, 15) with these supports (K, 2) are: paint, less how unusual, less not being the own."""
    return np.sqrt(support).sum(axis=1) - PRIOR_WEIGHT * strangeness(lanes) - elsewhere(lanes)


def elsewhere(lanes: np.ndarray) -> np.ndarray:
    """(K,) bool: lanes (K, 15) that the car is not in, because both lines pass it on the same side."""
    return np.abs(lanes[:, CENTRE]) > lanes[:, WIDTH] / 2


def support_of(fit: LaneFit, lines_y_m: np.ndarray, stripes: Stripes, view: RoadView) -> np.ndarray:
    """(K, 2): share of each line's rows in sight, up to `SUPPORT_FAR_M`, that have paint on it; left, right."""
    return painted_rows(fit, stripes) / rows_in_sight(lines_y_m, view)


def painted_rows(fit: LaneFit, stripes: Stripes) -> np.ndarray:
    """(K, 2): in how many rows up to `SUPPORT_FAR_M` there is paint on each line, by the weight of its stripes."""
    weight = fit.weight * (stripes.x_m < SUPPORT_FAR_M)
    return (weight[:, None] * (fit.side[:, None] == SIDES[:, None])).sum(axis=-1)


def rows_in_sight(lines_y_m: np.ndarray, view: RoadView) -> np.ndarray:
    """(K, 2): in how many rows up to `SUPPORT_FAR_M` each line is in sight; at least `LEAST_ROWS`."""
    rows = np.flatnonzero(view.x_m < SUPPORT_FAR_M)
    column = (view.y_m[0] - lines_y_m[..., rows]) / view.cell_m
    inside = (column >= 0) & (column <= len(view.y_m) - 1)
    seen = inside & view.seen[rows, np.where(inside, column, 0).astype(int)]
    return np.maximum(seen.sum(axis=-1), LEAST_ROWS)


def _only(rows: np.ndarray, line_y_m: np.ndarray) -> np.ndarray:
    """A line's lateral places in these rows of the view, NaN in all others."""
    kept = np.full_like(line_y_m, np.nan)
    kept[rows] = line_y_m[rows]
    return kept


def _describe_line(
    model: np.ndarray, covariance: np.ndarray, side: float, support: float, reach_m: float, paint: Paint | None
) -> LaneLine:
    gradient = np.zeros(len(model))
    gradient[[CENTRE, WIDTH]] = 1, side / 2
    std = float(np.sqrt(gradient @ covariance @ gradient))
    return LaneLine(
        *line_coefficients(model, side), std, float(support), reach_m, bool(support >= LEAST_SUPPORT), paint
    )
