"""The lane in one picture: from raw pixels to metres, with an honest account of how sure that is."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from lanes.attributes import Paint, describe_paint
from lanes.camera import Camera, Mount
from lanes.evidence import Stripes, find_stripes, measure_paint
from lanes.lanefit import (
    CENTRE,
    CURVATURE,
    HEADING,
    LEFT,
    PITCH,
    PRIOR_MEAN,
    PRIOR_STD,
    RATE,
    RIGHT,
    START,
    VERTICAL,
    WIDTH,
    LaneFit,
    fit_lanes,
    line_y,
    unflatten,
)
from lanes.roadview import RoadView
from lanes.votes import FAR_M, best_pairs, count_votes, distinct

SUPPORT_FAR_M = 50.0
LEAST_ROWS = 30
PRIOR_WEIGHT = 0.01


@dataclass(frozen=True, eq=False)
class LaneLine:
    """One line of the lane: y(x) = c0 + c1 x + c2 x^2 / 2 + c3 x^3 / 6, metres, x forward, y left."""

    c0_m: float
    c1: float
    c2_per_m: float
    c3_per_m2: float
    support: float
    reach_m: float
    paint: Paint | None = None


@dataclass(frozen=True, eq=False)
class Lane:
    model: np.ndarray
    covariance: np.ndarray
    left: LaneLine
    right: LaneLine
    score: float
    margin: float

    def y_m(self, x_m, side): 
        return line_y(np.asarray(x_m, float), self.model, side)

    def pixels(self, camera: Camera, rows: np.ndarray) -> np.ndarray:
        """Column of each line, (2, rows), left first, at picture rows; -2 where it does not pass."""
        rows = np.asarray(rows, float)
        return np.stack([_cross_rows(self.outline(camera, side), rows, camera) for side in (LEFT, RIGHT)])

    def outline(self, camera: Camera, side: float, x_m: np.ndarray | None = None) -> np.ndarray:
        """Raw pixels (N, 2) along a line, nearest first, up to where it turns back or dips out of sight."""
        if x_m is None:
            x_m = np.geomspace(3.5, 400, 300)
        y = line_y(x_m, self.model, side)
        x_m, y = x_m[np.isfinite(y)], y[np.isfinite(y)]
        m = camera.mount
        seen = camera.with_mount(Mount(m.height_m, m.pitch_rad + self.model[PITCH], m.yaw_rad, m.roll_rad))
        z = self.model[VERTICAL] * np.minimum(x_m, 80) * x_m / 2
        pixels = seen.road_to_pixels(np.column_stack([x_m, y, z]))
        rising = np.flatnonzero(~(np.diff(pixels[:, 1]) < 0))
        pixels = pixels[: rising[0] + 1] if len(rising) else pixels
        return pixels[np.isfinite(pixels).all(axis=1)]


def _cross_rows(outline: np.ndarray, rows: np.ndarray, camera: Camera) -> np.ndarray:
    if len(outline) < 2:
        return np.full(len(rows), -2.0)
    columns = np.interp(rows, outline[::-1, 1], outline[::-1, 0], left=-2, right=-2)
    return np.where((columns >= 0) & (columns <= camera.width - 1), columns, -2.0)


SIDES = np.array([LEFT, RIGHT])
RIVALS = 4


def find_lane(image: np.ndarray, view: RoadView) -> Lane | None:
    view_image = view.warp(image)
    stripes = find_stripes(measure_paint(view_image, view), view)
    height, focal = view.camera.mount.height_m, view.camera.matrix[0, 0]
    starts = best_pairs(count_votes(stripes, height), int((view.x_m < FAR_M).sum()))
    near = stripes.select(stripes.x_m < START[-1][0])
    first = fit_lanes(starts, near, height, focal, schedule=START)
    support = np.sqrt((first.weight[:, None] * (first.side[:, None] == SIDES[:, None])).sum(-1)).sum(-1)
    lanes = distinct(first.lane[np.argsort(-support, kind="stable")], RIVALS)
    fit = fit_lanes(lanes, stripes, height, focal)
    return choose_lane(fit, stripes, view, view_image)


def choose_lane(fit: LaneFit, stripes: Stripes, view: RoadView, view_image: np.ndarray) -> Lane:
    support = support_of(fit, stripes, view)
    unlikely = (((fit.lane - PRIOR_MEAN) / PRIOR_STD) ** 2).sum(axis=1)
    score = np.sqrt(support).sum(axis=1) - PRIOR_WEIGHT * unlikely
    best = int(score.argmax())
    lane = fit.lane[best].copy()
    paints, reach = [], []
    for side in (LEFT, RIGHT):
        near = (fit.side[best] == side) & (fit.weight[best] > 0.25)
        y = np.full(len(view.x_m), np.nan)
        rows = np.unique(stripes.row[near])
        y[rows] = unflatten(view.x_m[rows], lane, side, view.camera.mount.height_m)
        paints.append(describe_paint(view_image, view, y))
        reach.append(float(stripes.x_m[near].max()) if near.any() else 0.0)
    shift = [p.stripe_m(s) if p else 0.0 for p, s in zip(paints, (LEFT, RIGHT), strict=True)]
    lane[WIDTH] += shift[0] - shift[1]
    lane[CENTRE] += (shift[0] + shift[1]) / 2
    lines = [LaneLine(0,0,0,0, float(support[best, k]), reach[k], paints[k]) for k in (0, 1)]
    rivals = np.abs(fit.lane - lane)[:, :2].max(axis=1) > 0.5
    margin = float(score[best] - score[rivals].max(initial=0))
    return Lane(lane, np.linalg.inv(fit.information[best]), *lines, float(score[best]), margin)


def support_of(fit: LaneFit, stripes: Stripes, view: RoadView) -> np.ndarray:
    """(K, 2): share of each line's rows in sight that have paint on it; left, right."""
    near = stripes.x_m < SUPPORT_FAR_M
    rows = np.flatnonzero(view.x_m < SUPPORT_FAR_M)
    support = np.zeros((len(fit.lane), 2))
    for k, lane in enumerate(fit.lane):
        for j, side in enumerate((LEFT, RIGHT)):
            y = unflatten(view.x_m[rows], lane, side, view.camera.mount.height_m)
            column = np.nan_to_num((view.y_m[0] - y) / view.cell_m, nan=-1)
            inside = (column >= 0) & (column < len(view.y_m) - 1)
            seen = view.seen[rows[inside], column[inside].astype(int)].sum()
            support[k, j] = fit.weight[k, near & (fit.side[k] == side)].sum() / max(seen, LEAST_ROWS)
    return support
