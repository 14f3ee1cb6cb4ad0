"""Roads that wave up and down: the lane is found on them, from one picture and from the last, and waves come nearer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.fit import FIT, fit_lanes
from lanes.detect.paint import Stripes
from lanes.detect.road import (
    ADJACENT,
    FAR_LINE,
    PITCH,
    RATE_STEPS,
    SIDES,
    VERTICAL_CURVATURE,
    VERTICAL_KNOTS_M,
    WIDTH,
    line_y,
    road_height,
)
from lanes.track.filter import CAMERA_YAW, PATH, SPEED, initial_state, predict, update_lane
from tests.support.painted_drive import CAMERA
from tests.support.shapes import a_lane, stripes_at

VIEW = BirdsEyeView(CAMERA)
HEIGHT_M = VIEW.height_m
# Waves 52 m long and 1 m high, from trough to crest.
LENGTH_M, HALF_HEIGHT_M = 52.0, 0.5
AT_M = np.array([6.0, 9.0, 13.0, 16.0, 20.0])
STD = a_lane(centre=0.1, width=0.05, heading=0.01, curvature=5e-4, rate=1e-5, pitch=0.003, vertical=2e-4, adjacent=0.05)
STD[RATE_STEPS] = 1e-5
PHASES = np.radians([0, 45, 90, 135, 180, 225, 270, 315])
LINES = (1.85, -1.65)


def wave_m(x_m: np.ndarray, phase: float) -> np.ndarray:
    """Height of the waves above the plane on which a car stands at `phase` of them."""
    k = 2 * np.pi / LENGTH_M
    return HALF_HEIGHT_M * (np.sin(k * x_m + phase) - np.sin(phase) - k * x_m * np.cos(phase))


def seen(
    lines_m: tuple[float, ...], rise_m=np.zeros_like, *, pitch: float = 0.0, noise_m: float = 0.01, seed: int = 4
) -> Stripes:
    """Stripes of straight lines on a road of the given height, row by row, as far as nothing hides them."""
    rng, x = np.random.default_rng(seed), np.arange(4.0, 90.0, 0.02)
    fall = (HEIGHT_M - rise_m(x)) / x - pitch
    flat_x = HEIGHT_M / np.maximum(fall, 1e-3)
    open_ = np.concatenate([[True], flat_x[1:] > np.maximum.accumulate(flat_x)[:-1]])
    rows = np.flatnonzero((VIEW.x_m > flat_x[open_][0]) & (VIEW.x_m < min(flat_x[open_][-1], 60.0)))
    parts = []
    for y in lines_m:
        side = y / x * flat_x
        slope = np.gradient(side[open_], flat_x[open_])
        place, angle = (np.interp(VIEW.x_m[rows], flat_x[open_], v) for v in (side[open_], np.arctan(slope)))
        noise, turn = rng.normal(0, noise_m, len(rows)), rng.normal(0, 0.02, len(rows))
        parts.append((rows, VIEW.x_m[rows], place + noise, angle + turn))
    row, *places = (np.concatenate(part) for part in zip(*parts, strict=True))
    return stripes_at(row, *places, growth=VIEW.growth, cell_m=VIEW.cell_m)


def error_m(lane: np.ndarray, lines_m: tuple[float, float]) -> float:
    """How far the lines are from where they are, at most, up to 20 m ahead."""
    return max(np.abs(line_y(AT_M, lane, side) - y).max() for side, y in zip(SIDES, lines_m, strict=True))


@pytest.mark.parametrize("phase", PHASES, ids=np.degrees(PHASES).round().astype(int).astype(str))
def test_lane_of_an_undulating_road_from_one_picture(phase):
    stripes, start = seen(LINES, lambda x: wave_m(x, phase)), a_lane(centre=0.1)[None]
    fit = fit_lanes(start, stripes, VIEW, schedule=FIT.outwards, extra_vertical_per_m=FIT.undulation_std_per_m)
    assert error_m(fit.lane[0], LINES) < 0.05
    assert np.abs(road_height(fit.lane[0], AT_M) - wave_m(AT_M, phase)).max() < 0.15


def test_a_fit_without_undulations_fails_on_undulating_roads():
    """Of the eight phases the fit that expects no waves loses the lane at most."""
    errors = []
    for phase in PHASES:
        stripes = seen(LINES, lambda x, phase=phase: wave_m(x, phase))
        errors.append(error_m(fit_lanes(a_lane(centre=0.1)[None], stripes, VIEW).lane[0], LINES))
    assert np.median(errors) > 0.3


@pytest.mark.parametrize("phase", PHASES, ids=np.degrees(PHASES).round().astype(int).astype(str))
def test_unpredicted_undulations_are_tracked(phase):
    """The road was flat in the last picture. Kept near the prediction, the lane explains hardly any of the paint.

    The noise of the stripes alone moves the lines by up to 0.1 m where the road falls away, so nine draws are made.
    """
    estimate = initial_state(a_lane(centre=0.1), np.diag(STD**2), 15.0)
    errors = []
    for seed in range(9):
        stripes = seen(LINES, lambda x: wave_m(x, phase), seed=seed)
        near, far = (update_lane(stripes, estimate, VIEW, outwards=outwards) for outwards in (False, True))
        assert far.weight.sum() > 3 * near.weight.sum()
        errors.append(error_m(far.lane[0], LINES))
        off, near_off = (np.abs(road_height(f.lane[0], AT_M) - wave_m(AT_M, phase)).max() for f in (far, near))
        assert off < 0.1 < near_off
    assert np.median(errors) < 0.05


@pytest.mark.parametrize("side", SIDES)
def test_the_far_line_of_the_adjacent_lane_determines_the_pitch(side):
    """One line of the lane is out of sight; the next lane's far one runs parallel, as a nodding camera cannot show."""
    pitch, start = 0.009, a_lane()[None]
    own, far = side * 1.8, side * 1.8 * FAR_LINE + side * 0.1
    fits = [fit_lanes(start, seen(y, pitch=pitch), VIEW) for y in ((own, far), (own,))]
    both, alone = (np.sqrt(np.linalg.inv(f.information[0])[PITCH, PITCH]) for f in fits)
    assert both < 0.002 and alone > 5 * both
    assert fits[0].lane[0][PITCH] == pytest.approx(pitch, abs=0.0005)
    assert abs(fits[1].lane[0][PITCH] - pitch) > 0.002
    assert set(np.unique(fits[0].side[0])) == {side, FAR_LINE * side}
    x = np.array([8.0, 15.0, 25.0])
    np.testing.assert_allclose(line_y(x, fits[0].lane[0], side), own, atol=0.02)


def test_a_wider_adjacent_lane_is_not_mistaken_for_pitch():
    """Three lines show the nod; the fourth then shows that the lane to the right is wider than this by 0.3 m."""
    fit = fit_lanes(a_lane()[None], seen((5.25, 1.75, -1.75, -5.55), pitch=0.006), VIEW)
    lane = fit.lane[0]
    assert lane[PITCH] == pytest.approx(0.006, abs=5e-4)
    assert lane[ADJACENT] == pytest.approx([0.0, 0.3], abs=0.05)
    assert lane[WIDTH] == pytest.approx(3.5, abs=0.03)


WAVED = a_lane(width=3.6, vertical=(2e-3, -5e-3, 4e-3, -1e-3))


def standing_on(lane: np.ndarray, speed: float):
    estimate = initial_state(lane, np.diag(STD**2), speed)
    estimate.mean[[PATH, CAMERA_YAW]] = 0.0
    return estimate


@pytest.mark.parametrize("steps", [1, 8], ids=["at once", "in eight steps"])
def test_undulations_come_nearer_as_the_car_drives_on(steps):
    """The plane that the car stands on tilts with the road: h'(x) = h(x + d) - h(d) - h'(d) x."""
    distance, tiny, k = 2.0, np.array([-1e-4, 1e-4]), 2 * np.pi / LENGTH_M
    x, found_off, stale_off = np.array([10.0, 15.0, 20.0]), [], []
    for phase in PHASES:
        before = a_lane(vertical=tuple(-HALF_HEIGHT_M * k**2 * np.sin(k * VERTICAL_KNOTS_M + phase)))
        estimate = standing_on(before, 10.0)
        for _ in range(steps):
            estimate = predict(estimate, distance / steps / 10.0)
        grade = np.diff(road_height(before, distance + tiny)) / np.ptp(tiny)
        expected = road_height(before, x + distance) - road_height(before, np.array([distance])) - grade * x
        found_off.append(np.abs(road_height(estimate.lane, x) - expected))
        stale_off.append(np.abs(road_height(before, x) - expected))
    assert np.mean(stale_off, axis=0)[2] > 0.15
    # between knots that move with the car the road's corners get rounder, but by less than it moves
    assert (np.mean(found_off, axis=0) < 0.6 * np.mean(stale_off, axis=0)).all()
    assert np.max(found_off) < 0.16


def test_driving_one_knot_gap_moves_every_vertical_curvature_by_one():
    gap = VERTICAL_KNOTS_M[1]
    after = predict(standing_on(WAVED, 10.0), gap / 10.0).lane[VERTICAL_CURVATURE]
    first, second, third, last = WAVED[VERTICAL_CURVATURE]
    assert after[:2] == pytest.approx([second, third])
    assert after[2] == pytest.approx(third + (last - third) * gap / 16.0)
    # behind the last knot nothing is known but that waves end
    assert 0 < after[3] / last < 1


def test_jacobian_of_the_prediction():
    """Its covariance is J P J', with J the finite differences of its mean, and noise that shares nothing."""
    lane = a_lane(centre=0.2, heading=0.02, curvature=2e-3, rate=1e-4, pitch=0.004, rate_steps=2e-4, adjacent=0.1)
    lane[VERTICAL_CURVATURE] = WAVED[VERTICAL_CURVATURE]
    estimate = initial_state(lane, np.diag(STD**2), 14.0)
    jacobian = np.empty(estimate.covariance.shape)
    for k, row in enumerate(np.eye(len(estimate.mean)) * 1e-6):
        above, below = (predict(replace(estimate, mean=estimate.mean + s), 0.2).mean for s in (row, -row))
        jacobian[:, k] = (above - below) / 2e-6
    noise = predict(estimate, 0.2).covariance - jacobian @ estimate.covariance @ jacobian.T
    std = np.sqrt(np.diag(predict(estimate, 0.2).covariance))
    correlated = noise / std / std[:, None]
    assert (np.diag(noise) >= -1e-12).all()
    # how the kinks' fading depends on the speed is left out: it is small beside their noise
    off = np.abs(correlated - np.diag(np.diag(correlated)))
    lane_and_car = np.delete(np.arange(len(std)), SPEED)
    assert off[np.ix_(lane_and_car, lane_and_car)].max() < 0.02
