"""Lines of one frame: exact, robust, refused if undetermined; lines on the road."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from pytest import approx

from helpers import (
    fit_line,
    line_points,
    mean_distance_px,
    ransac_line,
    road_line,
    scale_to_road,
)
from tests.support.classic_lane import USUAL_SCALES

parametrize = pytest.mark.parametrize

ROWS = np.arange(0, 720)
TO_ROAD = partial(scale_to_road, metres_per_px=USUAL_SCALES, birdseye_size=(1280, 720))
BENT = (3e-4, -0.2, 300)
both_fitters = parametrize("fitter", [fit_line, ransac_line])


def line_pixels(line, rows=ROWS):
    return np.column_stack([np.polyval(line, rows), rows])


def noise(size_px, count, seed):
    """Noise along the row."""
    random = np.random.default_rng(seed)
    columns = random.normal(0, size_px, count)
    return np.column_stack([columns, np.zeros(count)])


@given(
    st.floats(-1e-3, 1e-3),
    st.floats(-1, 1),
    st.floats(0, 1280),
    st.sampled_from([0, 4]),
)
def test_the_fit_is_the_parabola_of_least_squares(a, b, c, noise_px):
    pixels = line_pixels((a, b, c)) + noise(noise_px, 720, seed=3)
    least_squares = np.polyfit(pixels[:, 1], pixels[:, 0], 2)
    found = np.polyval(fit_line(pixels), ROWS)
    assert_allclose(found, np.polyval(least_squares, ROWS), atol=1e-6)


@both_fitters
@parametrize(
    "pixels",
    [
        np.empty((0, 2)),
        [[5, 5]],
        [[5, 1], [6, 2]],
        [
            [1, 7],
            [2, 7],
            [3, 7],
            [4, 7],
        ],
        [
            [1, 0],
            [2, 9],
            [3, 9],
            [4, 0],
        ],
    ],
    ids=["none", "one", "two", "one row", "two rows"],
)
def test_too_little_for_a_parabola_is_none(fitter, pixels):
    assert fitter(np.array(pixels)) is None


@both_fitters
def test_a_stub_shorter_than_the_required_span_is_no_line(fitter):
    stub = line_pixels((0, 0, 300), np.arange(600, 700))
    assert fitter(stub) is not None
    assert fitter(stub, min_span_px=160) is None


def test_clutter_that_ransac_leaves_out_does_not_make_a_stub_longer():
    stub = line_pixels((0, 0, 300), np.arange(600, 700))
    columns = np.linspace(1000, 1280, 40)
    clutter = np.column_stack([columns, np.arange(40)])
    pixels = np.vstack([stub, clutter])
    assert ransac_line(pixels, samples=5, residual_px=1, min_span_px=160) is None


def bent_line_with_shadow():
    """Ten pixels a row, and across the upper view one wide block on one side."""
    line = np.repeat(line_pixels(BENT), 10, axis=0)
    line = line + noise(2, len(line), seed=4)
    random = np.random.default_rng(4)
    block_u = random.uniform(320, 420, 3000)
    block_v = random.integers(0, 120, 3000)
    block = np.column_stack([block_u, block_v])
    return np.vstack([line, block])


def test_ransac_ignores_a_third_of_outliers_that_bend_least_squares():
    pixels = bent_line_with_shadow()
    true_columns = np.polyval(BENT, ROWS)
    least_squares = np.polyval(fit_line(pixels), ROWS)
    robust = np.polyval(ransac_line(pixels, samples=12), ROWS)
    assert np.abs(least_squares - true_columns).max() > 25
    assert np.abs(robust - true_columns).max() < 8


def test_ransac_with_150_samples_is_nearly_least_squares():
    """Recipe C's number: there is an outlier in every sample."""
    pixels = bent_line_with_shadow()
    true_columns = np.polyval(BENT, ROWS)
    errors_px = {}
    for samples in (3, 150):
        found = np.polyval(ransac_line(pixels, samples=samples), ROWS)
        errors_px[samples] = np.abs(found - true_columns).max()
    assert errors_px[3] < errors_px[150]


def test_the_same_pixels_of_any_type_and_seed_give_the_same_line():
    pixels = line_pixels((1e-4, 0, 300)) + noise(12, 720, seed=5)
    first = ransac_line(pixels, samples=3, seed=1)
    again = ransac_line(pixels.tolist(), samples=3, seed=1)
    other = ransac_line(pixels, samples=3, seed=2)
    assert first.tolist() == again.tolist() != other.tolist()
    whole = np.round(pixels).astype(np.uint16)
    assert fit_line(whole).tolist() == fit_line(whole + 0.0).tolist()
    assert ransac_line(whole).tolist() == ransac_line(whole + 0.0).tolist()


def test_points_of_a_line_go_from_far_to_near():
    points = line_points(BENT, 720)
    assert points[[0, -1], 1].tolist() == [0, 719]
    assert_allclose(points[:, 0], np.polyval(BENT, points[:, 1]))


def test_the_distance_of_two_lines_is_a_mean_of_absolute_values():
    """Lines that cross in the middle of the view are apart, although the mean is 0."""
    assert mean_distance_px((0, 0, 300), (0, 0, 310), 720) == approx(10)
    crossing = mean_distance_px((0, 0, 300), (0, 1, 300 - 359.5), 720)
    assert crossing == approx(180, rel=0.01)


def circle_in_view(radius_m, y0_m=0.0):
    """Pixels of a circle that touches the car's direction; radius > 0 bends left."""
    x = (719 - ROWS) * USUAL_SCALES[1]
    side = np.sign(radius_m)
    y = y0_m + radius_m - side * np.sqrt(radius_m**2 - x**2)
    return np.column_stack([639.5 - y / USUAL_SCALES[0], ROWS])


@given(st.floats(200, 2500), st.sampled_from([-1, 1]), st.floats(-2, 2))
def test_a_circle_of_radius_r_measures_r(radius, side, y0):
    line = road_line(fit_line(circle_in_view(side * radius, y0)), TO_ROAD, 720)
    # a parabola through 30 m of a circle of 200 m is off by 1 %
    assert 1 / line.curvature_per_m() == approx(side * radius, rel=0.012)
    assert line.c0_m == approx(y0, abs=0.01)


def test_points_above_the_horizon_are_left_out():
    def half_sky(points):
        road = TO_ROAD(points)
        road[points[:, 1] < 360] = np.nan
        return road

    def all_sky(points):
        return np.full((len(points), 2), np.nan)

    fit = fit_line(circle_in_view(400))
    measured = road_line(fit, half_sky, 720).c2_per_m
    assert measured == approx(1 / 400, rel=0.02)
    assert road_line(fit, all_sky, 720) is None
    assert road_line(fit, TO_ROAD, 1) is None
