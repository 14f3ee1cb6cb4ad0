import numpy as np
import pytest

from lanes.classic.finder import get_recipe
from lanes.classic.fit import LineFit
from lanes.classic.memory import LineMemory

A = get_recipe("hls_sobel").memories[0]
B = get_recipe("equalized_hsv").memories[0]
C_LEFT, C_RIGHT = get_recipe("best_channel").memories


def line(c, a=0.0):
    return LineFit((a, 0.0, float(c)), 100, (0, 719))


def after(memory, fits):
    for fit in fits:
        memory = memory.update(fit)
    return memory


@pytest.mark.parametrize(("memory", "length"), [(A, 5), (B, 10), (C_LEFT, 30)])
def test_mean_of_the_last_fits_is_a_mean_not_the_last_one(memory, length):
    shown = 100 + 40 * np.random.default_rng(0).random(length + 7)
    memory = after(memory, map(line, shown))
    assert memory.state == "found"
    assert memory.best.coefficients[2] == pytest.approx(shown[-length:].mean())
    assert memory.best.coefficients[2] != pytest.approx(shown[-1], abs=0.1)


def test_recipe_b_measures_over_twenty_fits_and_draws_ten():
    memory = after(B, (line(c) for c in range(40)))
    assert memory.best.coefficients[2] == pytest.approx(np.mean(range(30, 40)))
    assert memory.smoothest.coefficients[2] == pytest.approx(np.mean(range(20, 40)))


def test_an_update_leaves_the_old_memory_alone():
    before = A.update(line(100))
    before.update(line(120))
    assert before.best == line(100)
    assert A.best is None


@pytest.mark.parametrize("fit", [None, line(201), line(100, a=0.0011)], ids=["nothing", "jumped", "bent"])
def test_recipe_a_keeps_its_best_fit_and_says_so(fit):
    memory = A.update(line(100)).update(fit)
    assert memory.state == "kept"
    assert memory.best == line(100)
    assert memory.near is None  # asks for windows


def test_recipe_b_looks_again_near_the_last_fit():
    memory = B.update(line(100)).update(None)
    assert memory.state == "kept"
    assert memory.near == line(100)


@pytest.mark.parametrize(("memory", "share"), [(C_LEFT, 0.05), (C_RIGHT, 0.15)])
def test_recipe_c_lets_a_doubtful_fit_in_at_a_small_share(memory, share):
    memory = after(memory, [line(100)])
    doubtful = memory.update(line(200))
    assert doubtful.state == "kept"
    assert doubtful.fits[-1].coefficients[2] == pytest.approx(100 + share * 100)
    assert memory.update(line(149)).fits[-1] == line(149)
    assert memory.update(line(251)).fits == memory.fits


def test_recipe_c_judges_the_bend_more_kindly_on_the_right():
    bent = line(100, a=13e-5)
    assert len(C_LEFT.update(line(100)).update(bent).fits) == 1
    assert len(C_RIGHT.update(line(100)).update(bent).fits) == 2


@pytest.mark.parametrize(("memory", "patience"), [(A, 25), (B, 25), (C_LEFT, 8), (C_RIGHT, 10)])
def test_a_line_not_seen_for_long_is_forgotten(memory, patience):
    kept = after(memory.update(line(100)), [None] * patience)
    assert kept.state == "kept"
    lost = kept.update(None)
    assert lost.state == "lost"
    assert lost.best is None
    assert lost.update(line(900)).best == line(900)


def test_a_frame_with_the_line_ends_the_count():
    memory = after(C_LEFT.update(line(100)), [None] * 8 + [line(100)] + [None] * 8)
    assert memory.state == "kept"


def test_nothing_at_all_is_lost():
    memory = LineMemory(length=5).update(None)
    assert (memory.state, memory.best, memory.near) == ("lost", None, None)


def test_limits_scale_with_the_picture():
    half = A.update(line(100)).scaled(0.5, 0.5)
    assert half.good == pytest.approx((0.002, 1.0, 50))
    assert half.fits == ()
