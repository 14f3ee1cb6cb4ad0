"""The measurement update, with synthetic stripes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.paint import Stripes
from lanes.detect.road import CENTRE, CURVATURE, SIDES, WIDTH, line_points, line_y
from lanes.track.filter import KalmanState, initial_state, update_lane
from tests.support.painted_drive import CAMERA
from tests.support.shapes import a_lane, stripes_at

VIEW = BirdsEyeView(CAMERA)
SMALL = dict(pitch=0.003, vertical=5e-5, adjacent=0.05)
STD = a_lane(centre=0.1, width=0.05, heading=0.01, curvature=5e-4, rate=1e-5, rate_steps=1e-5, **SMALL)
# Where the road bends, kinks of a hairpin's size are expected.
KINKED_STD = a_lane(centre=0.1, width=0.05, heading=0.02, curvature=5e-3, rate=5e-4, rate_steps=2e-3, **SMALL)
LANE = a_lane(centre=0.2, width=3.6, heading=0.01, curvature=1 / 500)


def stripes_on(lane: np.ndarray, *, aside_m: float = 0.0, far_m: float = 40.0) -> Stripes:
    """Strong stripes along both lines of a lane, in each row of a flat view."""
    along = VIEW.x_m[VIEW.x_m < far_m]
    points, angles = [], []
    for side in SIDES:
        line = line_points(lane, side, along)
        points.append(line + [0, aside_m])
        angles.append(np.arctan2(*np.gradient(line, axis=0).T[::-1]) if len(line) else [])
    x, y = np.vstack(points).T
    angle = np.concatenate(angles)
    # rows count from the far end, so that the gradient runs backwards along the line
    angle = np.arctan(np.tan(angle))
    row = np.tile(np.flatnonzero(VIEW.x_m < far_m), 2)
    return stripes_in_view(row, x, y, angle)


def stripes_in_view(*places: np.ndarray) -> Stripes:
    return stripes_at(*places, growth=VIEW.growth, cell_m=VIEW.cell_m)


def weight_of(stripes: Stripes, estimate: KalmanState) -> float:
    """Mean weight of stripes in the update."""
    return float(update_lane(stripes, estimate, VIEW).weight.mean())


def test_large_innovations_have_little_weight():
    estimate = initial_state(LANE, np.diag(STD**2), 20.0)
    assert weight_of(stripes_on(LANE, aside_m=0.02), estimate) > 0.5
    assert weight_of(stripes_on(LANE, aside_m=0.6, far_m=12.0), estimate) < 1e-3


def test_update_finds_the_lane_and_reduces_the_covariance():
    estimate = initial_state(LANE, np.diag(STD**2), 20.0)
    true = LANE + 0.7 * STD * a_lane(centre=1, width=-1, heading=1, curvature=1)
    fit = update_lane(stripes_on(true), estimate, VIEW)
    x = np.array([5.0, 15, 30])
    for side in SIDES:
        np.testing.assert_allclose(line_points(fit.lane[0], side, x), line_points(true, side, x), atol=0.06)
    covariance = np.linalg.inv(fit.information[0])
    assert np.all(np.diag(covariance) <= STD**2 * (1 + 1e-9))
    assert covariance[CENTRE, CENTRE] < 0.25 * STD[0] ** 2


def test_one_line_moves_the_other_with_it():
    """The width is known better than the place, so that the line that is not seen keeps its distance."""
    estimate = initial_state(LANE, np.diag(STD**2), 20.0)
    true = LANE + a_lane(centre=0.15, width=0.0)
    stripes = stripes_on(true)
    right = stripes.select(np.arange(len(stripes)) >= len(stripes) // 2)
    lane = update_lane(right, estimate, VIEW).lane[0]
    assert 0.08 < lane[CENTRE] - LANE[CENTRE] < 0.16
    assert abs(lane[WIDTH] - LANE[WIDTH]) < 0.03


def test_a_transition_far_ahead_does_not_bend_the_road_beside_the_car():
    """Straight for 25 m, then a clothoid: the curvature here stays that of the straight."""
    estimate = initial_state(a_lane(width=3.6), np.diag(STD**2), 20.0)
    stripes = stripes_on(estimate.lane, far_m=60.0)
    ahead = np.maximum(stripes.x_m - 25, 0)
    bent = replace(stripes, y_m=stripes.y_m + 5e-5 * ahead**3 / 6, angle=np.arctan(5e-5 * ahead**2 / 2))
    lane = update_lane(bent, estimate, VIEW).lane[0]
    assert abs(lane[CURVATURE]) < 1 / 5000
    assert abs(lane[CENTRE]) < 0.02


def test_no_stripes_leave_the_prediction():
    estimate = initial_state(LANE, np.diag(STD**2), 20.0)
    fit = update_lane(stripes_on(LANE, far_m=0.0), estimate, VIEW)
    np.testing.assert_allclose(fit.lane[0], LANE, atol=1e-12)
    np.testing.assert_allclose(np.linalg.inv(fit.information[0]), np.diag(STD**2), rtol=1e-6, atol=1e-15)


def test_a_bend_that_begins_ahead_is_tracked():
    """Predicted is a gentle bend; from 11 m on the road tightens to R 25 m, by up to 1.5 m at 22 m."""
    estimate = initial_state(a_lane(width=3.4, curvature=4e-3), np.diag(KINKED_STD**2), 8.0)
    along = np.arange(0.0, 40.0, 0.02)
    turned = np.cumsum(np.interp(along, [0.0, 11.0, 20.0], [4e-3, 4e-3, 1 / 25])) * 0.02
    middle = np.cumsum(np.stack([np.cos(turned), np.sin(turned)]), axis=1) * 0.02
    x, lines = VIEW.x_m[VIEW.x_m < 22], []
    for side in SIDES:
        points = middle + side * 1.7 * np.stack([-np.sin(turned), np.cos(turned)])
        lines.append(np.interp(x, *points))
    angles = [np.arctan(np.gradient(y, x)) for y in lines]
    row = np.tile(np.flatnonzero(VIEW.x_m < 22), 2)
    stripes = stripes_in_view(row, np.tile(x, 2), np.hstack(lines), np.hstack(angles))
    at = np.array([8.0, 14.0, 20.0])
    true = np.array([np.interp(at, x[::-1], y[::-1]) for y in lines])
    off, foretold_off = (
        np.abs([line_y(at, lane, side) for side in SIDES] - true).max(axis=0)
        for lane in (update_lane(stripes, estimate, VIEW).lane[0], estimate.lane)
    )
    assert foretold_off[2] > 0.4
    assert off[0] < 0.03 and off[1] < 0.05 and off[2] < foretold_off[2] / 2
