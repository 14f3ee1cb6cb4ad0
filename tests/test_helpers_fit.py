"""Parabolas of one line: exact, robust, refused if the pixels do not determine them; and the line on the road."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers import fit_line, ransac_line, road_line, scale_to_road

ROWS = np.arange(0, 720)
SCALES = (3.7 / 700, 30 / 720)
TO_ROAD = partial(scale_to_road, metres_per_px=SCALES, birdseye_size=(1280, 720))
BENT = (3e-4, -0.2, 300)
both_fitters = pytest.mark.parametrize("fitter", [fit_line, ransac_line])


def line_pixels(a, b, c, rows=ROWS):
    return np.column_stack([a * rows**2 + b * rows + c, rows])


@given(st.floats(-1e-3, 1e-3), st.floats(-1, 1), st.floats(0, 1280), st.sampled_from([0, 4]))
def test_the_fit_is_the_parabola_of_least_squares(a, b, c, noise_px):
    pixels = line_pixels(a, b, c) + np.random.default_rng(3).normal(0, noise_px, (720, 2)) * [1, 0]
    fit = fit_line(pixels)
    np.testing.assert_allclose(fit.columns(ROWS), np.polyval(np.polyfit(*pixels.T[::-1], 2), ROWS), atol=1e-6)
    assert fit.pixels == 720


@both_fitters
@pytest.mark.parametrize(
    "pixels",
    [np.empty((0, 2)), [[5, 5]], [[5, 1], [6, 2]], [[1, 7], [2, 7], [3, 7], [4, 7]], [[1, 0], [2, 9], [3, 9], [4, 0]]],
    ids=["none", "one", "two", "one row", "two rows"],
)
def test_too_little_for_a_parabola_is_none(fitter, pixels):
    assert fitter(np.array(pixels)) is None


@both_fitters
def test_a_stub_shorter_than_the_required_span_is_no_line(fitter):
    stub = line_pixels(0, 0, 300, np.arange(600, 700))
    assert fitter(stub) is not None
    assert fitter(stub, min_span_px=160) is None
    # clutter that RANSAC leaves out does not make it longer
    clutter = np.column_stack([np.linspace(1000, 1280, 40), np.arange(40)])
    assert ransac_line(np.vstack([stub, clutter]), samples=5, residual_px=1, min_span_px=160) is None


def test_ransac_ignores_a_third_of_outliers_that_bend_least_squares():
    rng = np.random.default_rng(4)
    line = np.repeat(line_pixels(*BENT), 10, axis=0) + rng.normal(0, 2, (7200, 2)) * [1, 0]
    # A shadow across the upper view: one wide block on one side.
    block = np.column_stack([rng.uniform(320, 420, 3000), rng.integers(0, 120, 3000)])
    pixels = np.vstack([line, block])
    assert np.abs(fit_line(pixels).columns(ROWS) - np.polyval(BENT, ROWS)).max() > 25
    assert np.abs(ransac_line(pixels, samples=12).columns(ROWS) - np.polyval(BENT, ROWS)).max() < 8


def test_ransac_counts_inliers_among_pixels_from_everywhere():
    """Of 6000 pixels every third has a vote; the first ones are a speck beside the line."""
    line = np.repeat(line_pixels(0.0, 0.3, 300.0), 8, axis=0)
    speck = np.column_stack([np.tile([700, 702], 120), np.repeat(np.arange(40), 6)])
    fit = ransac_line(np.vstack([speck, line]), samples=12)
    assert fit.pixels == len(line)
    np.testing.assert_allclose(fit.columns(ROWS), 300 + 0.3 * ROWS, atol=1e-6)


def test_the_same_pixels_of_any_type_and_seed_give_the_same_line():
    pixels = line_pixels(1e-4, 0, 300) + np.random.default_rng(5).normal(0, 12, (720, 2)) * [1, 0]
    assert ransac_line(pixels, seed=1) == ransac_line(pixels.tolist(), seed=1) != ransac_line(pixels, seed=2)
    whole = np.round(pixels).astype(np.uint16)
    assert fit_line(whole) == fit_line(whole + 0.0) and ransac_line(whole) == ransac_line(whole + 0.0)


def circle_in_view(radius_m, y0_m=0.0):
    """Pixels of a circle that touches the car's direction `y0_m` left of the car; radius > 0 bends left."""
    x = (719 - ROWS) * SCALES[1]
    y = y0_m + radius_m - np.sign(radius_m) * np.sqrt(radius_m**2 - x**2)
    return np.column_stack([639.5 - y / SCALES[0], ROWS])


@given(st.floats(200, 2500), st.sampled_from([-1, 1]), st.floats(-2, 2))
def test_a_circle_of_radius_r_measures_r(radius, side, y0):
    line = road_line(fit_line(circle_in_view(side * radius, y0)), TO_ROAD, 720)
    # A parabola through 30 m of a circle of 200 m is off by 1 %.
    assert 1 / line.curvature_per_m() == pytest.approx(side * radius, rel=0.012)
    assert line.c0_m == pytest.approx(y0, abs=0.01)


def test_points_above_the_horizon_are_left_out():
    def half_sky(points):
        road = TO_ROAD(points)
        road[points[:, 1] < 360] = np.nan
        return road

    fit = fit_line(circle_in_view(400))
    assert road_line(fit, half_sky, 720).c2_per_m == pytest.approx(1 / 400, rel=0.02)
    assert road_line(fit, lambda points: np.full((len(points), 2), np.nan), 720) is None
    assert road_line(fit, TO_ROAD, 1) is None
