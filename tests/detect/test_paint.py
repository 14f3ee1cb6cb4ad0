"""Candidates for paint: of the band filter alone, as in most frames of a drive, and
with the network, as in stills.
"""

from __future__ import annotations

import numpy as np
import pytest

from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.evidence import PAINT, Stripes, find_evidence, marking_response
from tests.support.painted_roads import ASPHALT, WHITE, YELLOW, Road, dashcam

CAMERA = dashcam()
VIEW = BirdsEyeView(CAMERA)
# Weight of a stripe six times as strong as the noise.
STRONG = 0.45
SOURCES = pytest.mark.parametrize(
    "quick", [True, False], ids=["band filter", "with network"]
)


def stripes_near(
    road: Road,
    y_of_x,
    within_m: float = 0.3,
    far_m: float = 30.0,
    *,
    quick: bool = True,
) -> Stripes:
    """The candidates near a line, nearer than `far_m`, that are no edges of
    the road.
    """
    stripes = find_evidence(road.image(), VIEW, PAINT, quick=quick).stripes
    near = np.abs(stripes.y_m - y_of_x(stripes.x_m)) < within_m
    return stripes.select(near & (stripes.x_m < far_m) & ~stripes.edge)


def slanted(x_m: np.ndarray) -> np.ndarray:
    return 0.4 - 0.03 * x_m


@SOURCES
@pytest.mark.parametrize("look", [{}, {"colour": YELLOW}, {"width_m": 0.2}], ids=str)
def test_stripes_are_placed_between_the_columns(look, quick):
    strong = stripes_near(Road(CAMERA).line(slanted, **look), slanted, 9.0, quick=quick)
    strong = strong.select(strong.weight > STRONG)
    assert len(np.unique(strong.row)) > 0.9 * (VIEW.x_m < 30).sum()
    error = strong.y_m - slanted(strong.x_m)
    assert abs(np.median(error)) < 0.006
    assert np.quantile(np.abs(error), 0.95) < 0.015


@pytest.mark.parametrize("degrees", [-50, -25, 40])
def test_direction_of_a_line_that_runs_across(degrees):
    # as in hairpins; from row to row it moves aside by more than a window of single
    # columns
    slope = np.tan(np.radians(degrees))
    stripes = stripes_near(
        Road(CAMERA).line(lambda x: slope * (x - 11), width_m=0.2),
        lambda x: slope * (x - 11),
    )
    assert len(stripes) > 5
    assert np.median(np.abs(stripes.angle - np.radians(degrees))) < 0.15


def test_both_stripes_of_a_double_line_are_seen():
    """The gap is painted black, as on motorways of concrete, and as wide as a stripe:
    0.12 m.
    """
    road = (
        Road(CAMERA)
        .lines(1.8, width_m=0.12, colour=(30, 30, 30))
        .lines(1.68, 1.92, width_m=0.12, colour=WHITE)
    )
    for y_m in (1.68, 1.92):
        seen = stripes_near(road, lambda x, y=y_m: 0 * x + y, within_m=0.04, far_m=12)
        assert np.median(seen.weight) > 0.27
        assert len(np.unique(seen.row)) > 0.9 * (VIEW.x_m < 12).sum()


@SOURCES
def test_paint_counts_in_shade_as_in_sun(quick):
    # no brightness threshold: what counts is contrast over noise
    road = Road(CAMERA, noise=3.0).line(slanted).shade(lambda x, y: x > 0, 0.35)
    assert np.median(stripes_near(road, slanted, far_m=20, quick=quick).weight) > STRONG


# Each of these is an edge, or dark.
NO_PAINT = {
    "shadow edge": lambda road: road.shade(lambda x, y: y > slanted(x), 0.4),
    "tar seam": lambda road: road.line(slanted, colour=(45, 45, 45)),
    "barrier foot": lambda road: road.paint(
        lambda x, y: y > slanted(x), (215, 213, 205)
    ),
    "verge": lambda road: road.paint(lambda x, y: y > slanted(x), (120, 125, 60)),
    "shadow across": lambda road: road.shade(lambda x, y: (x > 10) & (x < 14), 0.4),
}


@SOURCES
@pytest.mark.parametrize("name", NO_PAINT)
def test_what_is_no_paint_has_no_weight(name, quick):
    stripes = stripes_near(
        NO_PAINT[name](Road(CAMERA)), slanted, within_m=1.0, quick=quick
    )
    assert stripes.weight.sum() < 2, len(stripes)


def test_the_network_sees_faint_lines_but_no_faint_streak_on_a_smooth_road():
    """A streak is as clear relative to the noise as paint, but hardly brighter than the
    road.
    """

    def weight(noise: float, brighter: int, quick: bool = False) -> float:
        road = Road(CAMERA, noise=noise).line(
            slanted, colour=tuple(np.add(ASPHALT, brighter))
        )
        return stripes_near(road, slanted, 0.1, 20, quick=quick).weight.sum()

    assert weight(5.0, 9) > 1.5 * weight(5.0, 9, quick=True)
    assert weight(0.3, 3) < 0.4 * weight(0.3, 120)


def test_the_end_of_the_pavement_is_an_edge_of_the_road_and_no_paint():
    """Grass from 1.7 m to the right on. Nothing is found outside of the image."""
    road = Road(CAMERA).lines(1.8).paint(lambda x, y: y < -1.7, (96, 120, 60))
    evidence = find_evidence(road.image(), VIEW, PAINT)
    near = evidence.stripes.select(
        (evidence.stripes.x_m < 20) & (np.abs(evidence.stripes.y_m + 1.7) < 0.3)
    )
    assert near.weight @ near.edge > 0.9 * near.weight.sum() > 3
    assert (near.std_m[near.edge] > 0.4).all()
    assert not evidence.response.strength[~VIEW.seen].any()


def test_a_distant_stripe_is_less_certain():
    """Four centimetres nearby, one pixel far away, which is 0.1 m at 56 m for a focal
    length of 575 px.
    """
    stripes = stripes_near(Road(CAMERA).line(slanted), slanted, far_m=99)
    std_m = np.interp([6.0, 56.0], stripes.x_m[::-1], stripes.std_m[::-1])
    assert std_m == pytest.approx([0.041, 0.105], abs=0.003)


def test_noise_at_the_border_of_the_image_is_that_in_the_middle():
    """What lies outside has no noise, and must not make that of the border look like
    paint.
    """
    strength = marking_response(
        VIEW.warp(Road(CAMERA, noise=6.0).image()), VIEW, PAINT
    ).strength
    inner = np.roll(VIEW.seen, 8, axis=1) & np.roll(VIEW.seen, -8, axis=1)
    near = VIEW.seen & (VIEW.x_m < 9)[:, None]
    border = VIEW.seen & ~inner
    assert strength[near & border].mean() < strength[near & inner].mean()
