import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from classic.fit import LineFit, fit_line, mean_distance_px, mean_fit, ransac_line

ROWS = np.arange(0, 720)


def line_pixels(a, b, c, rows=ROWS):
    return np.column_stack([a * rows**2 + b * rows + c, rows])


@given(st.floats(-1e-3, 1e-3), st.floats(-1, 1), st.floats(0, 1280))
def test_exact_pixels_give_their_parabola_back(a, b, c):
    fit = fit_line(line_pixels(a, b, c))
    np.testing.assert_allclose(fit.columns(ROWS), a * ROWS**2 + b * ROWS + c, atol=1e-6)
    assert fit.pixels == 720
    assert fit.rows_px == (0, 719)


def test_fit_agrees_with_numpy_polyfit():
    rng = np.random.default_rng(3)
    pixels = line_pixels(2e-4, -0.3, 400) + rng.normal(0, 4, (720, 2)) * [1, 0]
    np.testing.assert_allclose(fit_line(pixels).coefficients, np.polyfit(pixels[:, 1], pixels[:, 0], 2), rtol=1e-8)


@pytest.mark.parametrize("fitter", [fit_line, ransac_line])
@pytest.mark.parametrize(
    "pixels",
    [np.empty((0, 2)), [[5, 5]], [[5, 1], [6, 2]], [[1, 7], [2, 7], [3, 7], [4, 7]], [[1, 0], [2, 9], [3, 9], [4, 0]]],
    ids=["none", "one", "two", "one row", "two rows"],
)
def test_too_little_for_a_parabola_is_none(fitter, pixels):
    assert fitter(np.array(pixels)) is None


@pytest.mark.parametrize("fitter", [fit_line, ransac_line])
def test_a_short_stub_is_no_line_when_a_span_is_asked_for(fitter):
    stub = line_pixels(0, 0, 300, np.arange(600, 700))
    assert fitter(stub) is not None
    assert fitter(stub, min_span_px=160) is None


def test_ransac_ignores_a_third_of_outliers_that_bend_least_squares():
    rng = np.random.default_rng(4)
    line = np.repeat(line_pixels(3e-4, -0.2, 300), 10, axis=0) + rng.normal(0, 2, (7200, 2)) * [1, 0]
    # A shadow across the upper view: one wide block on one side.
    block = np.column_stack([rng.uniform(320, 420, 3000), rng.integers(0, 120, 3000)])
    pixels = np.vstack([line, block])
    truth = np.polyval([3e-4, -0.2, 300], ROWS)
    assert np.abs(fit_line(pixels).columns(ROWS) - truth).max() > 25
    assert np.abs(ransac_line(pixels, samples=12).columns(ROWS) - truth).max() < 8


def test_ransac_with_minimal_samples_is_robust_and_with_150_is_not():
    """With 10 % of outliers, a sample of 150 pixels is free of them with a probability of 1e-7."""
    truth = np.polyval([3e-4, -0.2, 300], ROWS)
    worst = {3: 0.0, 150: 0.0}
    for seed in range(5):
        rng = np.random.default_rng(seed)
        line = line_pixels(3e-4, -0.2, 300) + rng.normal(0, 1, (720, 2)) * [1, 0]
        outliers = np.column_stack([rng.uniform(800, 1280, 80), rng.integers(0, 720, 80)])
        pixels = np.vstack([line, outliers])
        for samples in worst:
            fit = ransac_line(pixels, samples=samples)
            worst[samples] = max(worst[samples], np.abs(fit.columns(ROWS) - truth).max())
        assert ransac_line(pixels) == ransac_line(pixels, samples=3)
    assert worst[3] < 0.5
    assert worst[150] > 10


def test_ransac_refuses_a_short_stub_among_pixels_that_span_enough():
    rng = np.random.default_rng(6)
    clutter = np.column_stack([rng.uniform(1000, 1280, 40), rng.integers(0, 50, 40)])
    pixels = np.vstack([np.repeat(line_pixels(0, 0, 300, np.arange(600, 700)), 5, axis=0), clutter])
    assert ransac_line(pixels, samples=5, residual_px=1) is not None
    assert ransac_line(pixels, samples=5, residual_px=1, min_span_px=160) is None


def test_ransac_asks_pixels_from_everywhere():
    """Of 6000 pixels every third has a vote; the first ones are a speck beside the line."""
    line = np.repeat(line_pixels(0.0, 0.3, 300.0), 8, axis=0)
    speck = np.column_stack([np.tile([700, 702], 120), np.repeat(np.arange(40), 6)])
    fit = ransac_line(np.vstack([speck, line]), samples=12)
    assert fit.pixels == len(line)
    np.testing.assert_allclose(fit.columns(ROWS), 300 + 0.3 * ROWS, atol=1e-6)


def test_ransac_takes_whole_numbers_and_lists():
    """As `binary_pixels` gives them, and as they may be typed."""
    pixels = line_pixels(0, 1, 300, np.arange(0, 100))
    assert pixels.dtype.kind == "i"
    assert ransac_line(pixels) == ransac_line(pixels.tolist()) == ransac_line(pixels.astype(float))
    assert fit_line(pixels.astype(np.uint16)) == fit_line(pixels)


def test_ransac_gives_the_same_line_for_the_same_seed():
    pixels = line_pixels(1e-4, 0, 300) + np.random.default_rng(5).normal(0, 12, (720, 2)) * [1, 0]
    assert ransac_line(pixels, seed=1) == ransac_line(pixels, seed=1)
    assert ransac_line(pixels, seed=1) != ransac_line(pixels, seed=2)


def test_mean_is_a_mean():
    fits = [LineFit((1.0, 2.0, 3.0), 10, (0, 50)), LineFit((3.0, 4.0, 9.0), 20, (10, 90))]
    assert mean_fit(fits) == LineFit((2.0, 3.0, 6.0), 30, (0, 90))
    assert mean_fit([]) is None


def test_distance_is_the_mean_gap():
    upright, shifted = LineFit((0, 0, 100.0), 1, (0, 1)), LineFit((0, 0, 107.0), 1, (0, 1))
    crossing = LineFit((0, 2.0, 100.0 - 2 * 50), 1, (0, 1))
    assert mean_distance_px(upright, shifted, 101) == pytest.approx(7)
    assert mean_distance_px(upright, crossing, 101) == pytest.approx(2 * np.abs(np.arange(101) - 50).mean())


def test_points_run_from_the_top_row_to_the_bottom_row():
    points = LineFit((0.0, 2.0, 100.0), 1, (0, 20)).points(21)
    assert points.tolist() == [[100, 0], [116, 8], [132, 16], [140, 20]]
    assert len(LineFit((0.0, 2.0, 100.0), 1, (0, 0)).points(1)) == 1
    # the last row is drawn once, also where a step ends there
    assert LineFit((0.0, 0.0, 5.0), 1, (0, 0)).points(18)[:, 1].tolist() == [0, 8, 16, 17]
    assert LineFit((0.0, 0.0, 5.0), 1, (0, 0)).points(17)[:, 1].tolist() == [0, 8, 16]
