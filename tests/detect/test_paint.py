"""Stripe candidates: where they lie, how sure they are, and what is none."""

from __future__ import annotations

import numpy as np
import pytest

from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.paint import find_stripes, marking_response
from tests.support.painted_roads import WHITE, Road, dashcam

CAMERA = dashcam()
VIEW = BirdsEyeView(CAMERA)
# Weight of a stripe six times as strong as the noise.
STRONG = 0.45


def stripes_of(road):
    return find_stripes(marking_response(VIEW.warp(road.image()), VIEW), VIEW)


def near(stripes, y_of_x, within_m=0.3, far_m=30.0):
    return stripes.select((np.abs(stripes.y_m - y_of_x(stripes.x_m)) < within_m) & (stripes.x_m < far_m))


@pytest.mark.parametrize("y", [1.52, -1.87, 0.31])
def test_stripe_is_placed_between_the_columns(y):
    stripes = near(stripes_of(Road(CAMERA).line(lambda x: y - 0.02 * x)), lambda x: y - 0.02 * x)
    strong = stripes.select(stripes.weight > STRONG)
    rows = (VIEW.x_m < 30).sum()
    assert len(np.unique(strong.row)) > 0.95 * rows
    error = strong.y_m - (y - 0.02 * strong.x_m)
    assert abs(np.median(error)) < 0.005 and np.std(error) < 0.02


def test_both_stripes_of_a_double_line_are_seen():
    """The gap is painted black, as on motorways of concrete, and as wide as a stripe: 0.12 m."""
    road = Road(CAMERA).lines(1.8, width_m=0.12, colour=(30, 30, 30))
    stripes = stripes_of(road.lines(1.68, 1.92, width_m=0.12, colour=WHITE))
    for across in (-0.12, 0.12):
        seen = near(stripes, lambda x, a=across: 0 * x + 1.8 + a, within_m=0.04, far_m=12)
        assert np.median(seen.weight) > 0.27
        assert len(np.unique(seen.row)) > 0.9 * (VIEW.x_m < 12).sum()


@pytest.mark.parametrize("light", [1.0, 0.35])
def test_paint_counts_in_shade_and_at_night_as_in_sun(light):
    # no brightness threshold: what counts is contrast over noise
    road = Road(CAMERA, noise=3.0).lines(1.7).shade(lambda x, y: x > 0, light)
    stripes = near(stripes_of(road), lambda x: 0 * x + 1.7)
    assert np.median(stripes.weight) > STRONG


def clutter():
    # not paint: each of these is an edge or dark
    yield "shadow edge", Road(CAMERA).shade(lambda x, y: y > 0.4 - 0.03 * x, 0.4)
    yield "tar seam", Road(CAMERA).line(lambda x: 0.4 - 0.03 * x, colour=(45, 45, 45))
    yield "asphalt joint", Road(CAMERA).paint(lambda x, y: y > 0.4 - 0.03 * x, (140, 140, 142))
    yield "barrier foot", Road(CAMERA).paint(lambda x, y: y > 0.4 - 0.03 * x, (215, 213, 205))
    yield "verge", Road(CAMERA).paint(lambda x, y: y > 0.4 - 0.03 * x, (120, 125, 60))
    yield "shadow across", Road(CAMERA).shade(lambda x, y: (x > 10) & (x < 14), 0.4)


@pytest.mark.parametrize(("name", "road"), [pytest.param(*c, id=c[0]) for c in clutter()])
def test_what_is_no_stripe_scores_nothing(name, road):
    stripes = near(stripes_of(road), lambda x: 0.4 - 0.03 * x, within_m=1.0)
    assert len(stripes) <= 3, f"{name}: {len(stripes)} stripes, weights up to {stripes.weight.max():.1f}"


def test_the_edge_of_the_picture_is_no_stripe():
    image = np.full((CAMERA.height, CAMERA.width, 3), 210, np.uint8)
    assert len(find_stripes(marking_response(VIEW.warp(image), VIEW), VIEW)) == 0


@pytest.mark.parametrize("degrees", [-50, -25, 40])
def test_direction_of_a_line_that_runs_across(degrees):
    # as in hairpins; from row to row it moves aside by more than a window of single columns
    slope = np.tan(np.radians(degrees))
    stripes = near(stripes_of(Road(CAMERA).line(lambda x: slope * (x - 11), width_m=0.2)), lambda x: slope * (x - 11))
    assert len(stripes) > 5
    assert np.median(np.abs(stripes.angle - np.radians(degrees))) < 0.15


def test_a_distant_stripe_is_less_certain():
    """Four centimetres nearby, one pixel far away, which is 0.1 m at 56 m for a focal length of 575 px."""
    stripes = stripes_of(Road(CAMERA).lines(1.7))
    std_m = np.interp([6.0, 56.0], stripes.x_m[::-1], stripes.std_m[::-1])
    assert std_m == pytest.approx([0.041, 0.105], abs=0.003)


def test_noise_at_the_border_of_the_image_is_that_in_the_middle():
    """What lies outside has no noise, and must not make that of the border look like paint."""
    strength = marking_response(VIEW.warp(Road(CAMERA, noise=6.0).image()), VIEW).strength
    inner = np.roll(VIEW.seen, 8, axis=1) & np.roll(VIEW.seen, -8, axis=1)
    near, border = VIEW.seen & (VIEW.x_m < 9)[:, None], VIEW.seen & ~inner
    assert strength[near & border].mean() < strength[near & inner].mean()
