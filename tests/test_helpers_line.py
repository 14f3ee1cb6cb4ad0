"""What each recipe remembers of a line: means, gates, blends, and when a line is deleted."""

import numpy as np
import pytest

from helpers import LineFit, get_recipe

A = get_recipe("hls_sobel").memories[0]
B = get_recipe("equalized_hsv").memories[0]
C_LEFT, C_RIGHT = get_recipe("best_channel").memories


def line(c, a=0.0):
    return LineFit((a, 0.0, float(c)), 100)


def after(memory, fits):
    for fit in fits:
        memory = memory.update(fit)
    return memory


@pytest.mark.parametrize(("memory", "length"), [(A, 5), (B, 10), (C_LEFT, 30)])
def test_average_of_the_last_fits(memory, length):
    shown = 100 + 40 * np.random.default_rng(0).random(length + 17)
    memory = after(memory, map(line, shown))
    assert memory.state == "found"
    assert memory.average.coefficients[2] == pytest.approx(shown[-length:].mean())
    assert memory.average.coefficients[2] != pytest.approx(shown[-1], abs=0.1)
    measured = shown[-20:] if memory.measured_length else shown[-length:]  # recipe B draws ten fits and measures twenty
    assert memory.measured_average.coefficients[2] == pytest.approx(measured.mean())


@pytest.mark.parametrize("fit", [None, line(201), line(100, a=0.0011)], ids=["nothing", "jumped", "bent"])
def test_recipe_a_keeps_its_average_and_reports_kept(fit):
    memory = A.update(line(100)).update(fit)
    assert memory.state == "kept"
    assert memory.average == line(100)
    assert memory.search_prior is None  # sliding windows in the next frame; recipe B keeps to its band
    assert B.update(line(100)).update(None).search_prior == line(100)
    small = memory.scaled(0.5, 0.25)  # without fits, and with the limits of smaller pictures
    assert small.accept_limits == pytest.approx((0.008, 2.0, 50)) and small.fits == ()


@pytest.mark.parametrize(("memory", "share", "bent"), [(C_LEFT, 0.05, 1), (C_RIGHT, 0.15, 2)])
def test_recipe_c_blends_a_fit_with_a_small_weight_and_has_a_wider_curvature_gate_on_the_right(memory, share, bent):
    memory = memory.update(line(100))
    blended = memory.update(line(200))
    assert blended.state == "kept"
    assert blended.fits[-1].coefficients[2] == pytest.approx(100 + share * 100)
    assert memory.update(line(149)).fits[-1] == line(149)
    assert memory.update(line(251)).fits == memory.fits
    assert len(memory.update(line(100, a=13e-5)).fits) == bent


@pytest.mark.parametrize(("memory", "max_missed"), [(A, 25), (B, 25), (C_LEFT, 8), (C_RIGHT, 10)])
def test_a_line_missed_too_often_is_deleted(memory, max_missed):
    kept = after(memory.update(line(100)), [None] * max_missed)
    assert kept.state == "kept"
    lost = kept.update(None)
    assert lost.state == "lost"
    assert (lost.average, lost.search_prior) == (None, None)
    assert lost.update(line(900)).average == line(900)
    seen_between = after(kept.update(line(100)), [None] * max_missed)
    assert seen_between.state == "kept"
