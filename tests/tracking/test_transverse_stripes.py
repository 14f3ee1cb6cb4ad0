"""Stripes across the lane: how many are counted, and what is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lanes.tracking.birdseye import BirdsEyeView
from lanes.tracking.confidence import rate_lane
from lanes.tracking.detector import find_lane
from lanes.tracking.transverse_stripes import TRANSVERSE, count_transverse_stripes
from tests.support.painted_roads import Road, dashcam

CAMERA = dashcam(width=1280)
VIEW = BirdsEyeView(CAMERA)
WHITE, DARK = (225, 225, 222), (40, 40, 42)


def lane_road(noise: float = 4.0) -> Road:
    road = Road(CAMERA, noise=noise)
    for lateral_m in (1.8, -1.8):
        road.line(lambda x, y=lateral_m: y + 0 * x)
    return road


def across(*at_m: float, depth_m: float = 0.4, colour=WHITE, from_m: float = -9.0, to_m: float = 9.0) -> Road:
    road = lane_road()
    for x_m in at_m:
        road.paint(lambda x, y, a=x_m: (x > a) & (x < a + depth_m) & (y > from_m) & (y < to_m), colour)
    return road


@pytest.mark.parametrize("at_m", [(), (9.0,), (7.0, 12.0), (6.5, 9.0, 13.0, 19.0, 26.0)])
def test_all_stripes_up_to_30_m_are_counted(at_m):
    lane = find_lane(across(*at_m, 40.0).image(), VIEW)
    assert lane.transverse_stripes == len(at_m)


def test_they_are_counted_in_a_bend_and_in_noise():
    road = Road(CAMERA, noise=10.0)
    for lateral_m in (1.8, -1.8):
        road.line(lambda x, y=lateral_m: y + x**2 / 400)
    road.paint(lambda x, y: (np.abs(x - 9) < 0.2) | (np.abs(x - 15) < 0.3), WHITE)
    assert find_lane(road.image(), VIEW).transverse_stripes == 2


@pytest.mark.parametrize(
    "road",
    [
        across(7.0, 12.0, depth_m=0.1, colour=DARK),
        across(8.0, 14.0, from_m=-0.7, to_m=0.7),
        across(8.0, 14.0, from_m=0.0),
        across(10.0, depth_m=40.0, colour=(150, 150, 150)),
        across(0.0, depth_m=10.0, colour=(40, 40, 42)),
    ],
    ids=["dark joints", "arrows", "half a stop line", "pale asphalt ahead", "shadow behind"],
)
def test_other_things_in_the_lane_are_none(road):
    lane = find_lane(road.image(), VIEW)
    assert lane is not None and lane.transverse_stripes == 0


def test_lines_that_leave_the_view_have_none_between_them():
    image = VIEW.warp(across(7.0, 12.0).image())
    nowhere = np.full((2, len(VIEW.x_m)), np.nan)
    aside = np.array([[40.0], [36.0]]) + np.zeros(len(VIEW.x_m))
    touching = np.array([[0.1], [-0.1]]) + np.zeros(len(VIEW.x_m))
    for lines_y_m in (nowhere, aside, touching):
        assert count_transverse_stripes(image, VIEW, lines_y_m) == 0


def test_a_short_view_has_too_few_rows():
    view = replace(VIEW, near_m=28.5, far_m=31.0)
    assert 0 < (view.x_m < TRANSVERSE.far_m).sum() <= 2 * max(TRANSVERSE.reaches)
    lines_y_m = np.array([[1.8], [-1.8]]) + np.zeros(len(view.x_m))
    assert count_transverse_stripes(view.warp(across(29.0).image()), view, lines_y_m) == 0


def test_several_stripes_lower_the_confidence_and_a_stop_line_does_not():
    lane = find_lane(across(9.0).image(), VIEW)
    for found in (lane, replace(lane, same_lane_share=0.9)):
        none, tiles = replace(found, transverse_stripes=0), replace(found, transverse_stripes=4)
        assert rate_lane(found) == rate_lane(none)
        assert rate_lane(tiles) < rate_lane(found) - 0.1
