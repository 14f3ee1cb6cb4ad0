"""What each recipe remembers of a line: means, gates, misses, and our restart."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from pytest import approx

from helpers import get_recipe

parametrize = pytest.mark.parametrize

A = get_recipe("hls_sobel").left_line
B = get_recipe("equalized_hsv").left_line
C_LEFT = get_recipe("best_channel").left_line
C_RIGHT = get_recipe("best_channel").right_line
MEMORIES = {"A": A, "B": B, "C left": C_LEFT, "C right": C_RIGHT}
every_memory = parametrize("rules", MEMORIES.values(), ids=MEMORIES)


def fit(c, a=0.0):
    return np.array([a, 0.0, c])


def remember(rules, fits):
    """The memory after these fits; a number is the column of a fit."""
    line = rules.fresh()
    for one in fits:
        line.update(fit(one) if isinstance(one, int | float) else one)
    return line


def column(line):
    return line.mean()[2]


@parametrize(
    ("rules", "length"),
    [
        (A, 5),
        (B, 10),
        (C_LEFT, 30),
    ],
)
def test_the_mean_is_over_the_last_fits(rules, length):
    """Not the newest alone, as in A and C, whose lists were filled anew."""
    shown = 100 + 40 * np.random.default_rng(0).random(length + 17)
    line = remember(rules, shown.tolist())
    assert line.state == "found"
    assert len(line.fits) == length
    assert column(line) == approx(shown[-length:].mean())
    assert column(line) != approx(shown[-1], abs=0.1)


@every_memory
def test_without_fits_there_is_no_line(rules):
    line = rules.fresh()
    assert line.update(None) is None
    assert (line.state, line.search_near()) == ("lost", None)
    assert_array_equal(line.update(fit(100)), fit(100))


@parametrize("wrong", [fit(201), fit(100, a=0.0011)], ids=["jumped", "bent"])
def test_recipe_a_refuses_a_fit_far_from_the_mean(wrong):
    line = remember(A, [100, wrong])
    assert (line.state, line.missed) == ("kept", 1)
    assert_array_equal(line.mean(), fit(100))
    assert line.search_near() is None


def test_recipe_a_compares_with_the_mean_and_not_with_the_newest_fit():
    line = remember(A, [100, 190, 199])
    assert line.state == "found"
    refused = remember(A, [100, 190, 250])  # 60 from the newest, 105 from the mean
    assert refused.state == "kept"


def test_recipe_a_drops_its_newest_fit_in_a_frame_without_one():
    line = remember(A, [100, 110, 190])
    assert len(line.fits) == 3
    line.update(None)
    assert column(line) == 105
    # a refused fit drops none, and the last fit is kept
    line.update(fit(900))
    assert column(line) == 105
    for _ in range(5):
        line.update(None)
    assert column(line) == 100


def test_recipe_b_repeats_its_last_fit():
    line = remember(B, [100, 160])
    line.update(None)
    assert (line.state, line.missed) == ("kept", 1)
    assert column(line) == approx((100 + 160 + 160) / 3)


def test_recipe_b_searches_around_its_last_fit_and_a_around_the_mean():
    assert remember(B, [100, 160]).search_near()[2] == 160
    assert remember(A, [100, 160]).search_near()[2] == 130


def test_recipe_b_accepts_everything():
    line = remember(B, [100, fit(900, a=0.5)])
    assert line.state == "found"


@parametrize(
    ("rules", "weight"), [(C_LEFT, 0.05), (C_RIGHT, 0.15)], ids=["left", "right"]
)
def test_recipe_c_averages_a_doubtful_fit_in_but_searches_with_windows(rules, weight):
    line = remember(rules, [100, 200])
    assert line.fits[-1][2] == approx(100 + weight * 100)
    assert (line.state, line.missed) == ("kept", 1)
    assert line.search_near() is None
    line.update(fit(110))
    assert (line.state, line.missed) == ("found", 0)
    assert line.search_near() is not None


@parametrize("rules", [C_LEFT, C_RIGHT], ids=["left", "right"])
@parametrize(
    ("new", "fits"),
    [
        (fit(149), 2),
        (fit(251), 1),
        (fit(100, a=6e-5), 2),
    ],
)
def test_recipe_c_refuses_bad_fits_only(rules, new, fits):
    assert len(remember(rules, [100, new]).fits) == fits


@parametrize("rules", [C_LEFT, C_RIGHT], ids=["left", "right"])
def test_recipe_c_counts_a_fit_nearby_fully(rules):
    line = remember(rules, [100, 149])
    assert_array_equal(line.fits[-1], fit(149))


def test_recipe_c_has_a_wider_gate_for_bends_on_the_right():
    bent = fit(100, a=13e-5)
    assert len(remember(C_LEFT, [100, bent]).fits) == 1
    assert len(remember(C_RIGHT, [100, bent]).fits) == 2


@every_memory
def test_a_line_missed_too_often_begins_again(rules):
    """Our restart: a wrong line must not persist."""
    line = remember(rules, [100] + [None] * rules.max_missed)
    assert line.state == "kept"
    line.update(None)
    assert line.state == "lost"
    assert line.mean() is None
    assert line.search_near() is None
    assert line.update(fit(900))[2] == 900


@every_memory
def test_a_line_may_be_missed_in_25_frames(rules):
    assert rules.max_missed == 25


@every_memory
def test_a_fit_in_between_starts_the_count_again(rules):
    misses = [None] * rules.max_missed
    line = remember(rules, [100, *misses, 100, *misses])
    assert line.state == "kept"


def test_limits_are_scaled_with_the_image_and_fits_are_not_copied():
    line = remember(A, [100])
    small = line.fresh(0.5, 0.25)
    assert small.accept == approx([0.008, 2.0, 50])
    assert small.fits == []
    assert small.state == "lost"
    # the recipe's own line was not used
    assert A.fits == []
