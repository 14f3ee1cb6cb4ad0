"""Stripes across the lane: how many are counted, and what is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.transverse_stripes import count_transverse_stripes
from lanes.stills import find_lane
from lanes.track.tracker import LaneTracker
from tests.support.painted_roads import Road, dashcam

CAMERA = dashcam(width=1280)
VIEW = BirdsEyeView(CAMERA)
WHITE, DARK = (225, 225, 222), (40, 40, 42)


def lane_road(noise: float = 4.0) -> Road:
    return Road(CAMERA, noise=noise).lines(1.8, -1.8)


def across(*at_m: float, depth_m: float = 0.4, colour=WHITE, from_m: float = -9.0, to_m: float = 9.0) -> Road:
    road = lane_road()
    for x_m in at_m:
        road.paint(lambda x, y, a=x_m: (x > a) & (x < a + depth_m) & (y > from_m) & (y < to_m), colour)
    return road


@pytest.mark.parametrize("at_m", [(), (9.0,), (7.0, 12.0), (6.5, 9.0, 13.0, 19.0, 26.0)])
def test_all_stripes_up_to_30_m_are_counted(at_m):
    lane = find_lane(across(*at_m, 40.0).image(), CAMERA)
    assert lane.transverse_stripes == len(at_m)


def test_they_are_counted_in_a_bend_and_in_noise():
    road = Road(CAMERA, noise=10.0)
    for lateral_m in (1.8, -1.8):
        road.line(lambda x, y=lateral_m: y + x**2 / 400)
    road.paint(lambda x, y: (np.abs(x - 9) < 0.2) | (np.abs(x - 15) < 0.3), WHITE)
    assert find_lane(road.image(), CAMERA).transverse_stripes == 2


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
    lane = find_lane(road.image(), CAMERA)
    assert lane is not None and lane.transverse_stripes == 0


@pytest.mark.parametrize("far_m", [29.0, 33.0])
def test_a_view_with_few_near_rows_has_none(far_m):
    view = replace(VIEW, near_m=28.5, far_m=far_m)
    lines_y_m = np.array([[1.8], [-1.8]]) + np.zeros(len(view.x_m))
    assert count_transverse_stripes(view.warp(across(29.0).image()), view, lines_y_m) == 0


@pytest.mark.parametrize(
    ("depth_m", "period_m", "share"),
    [(3.0, 5.0, 0.4), (1.0, 3.0, 0.4), (1.0, 3.0, 0.7), (0.1, 2.0, 0.4)],
    ids=["trees", "a fence", "a light fence", "joints of slabs"],
)
def test_the_road_between_shadows_and_joints_is_no_stripe(depth_m, period_m, share):
    lane = find_lane(lane_road().shade(lambda x, y: np.mod(x, period_m) < depth_m, share).image(), CAMERA)
    assert lane.transverse_stripes == 0
    assert lane.confidence > 0.9


def test_a_tracked_lane_has_none():
    tracker, image = LaneTracker(CAMERA), across(7.0, 12.0).image()
    assert tracker.update(image).transverse_stripes == 0


def test_stripes_lower_the_confidence():
    lane = find_lane(across(9.0).image(), CAMERA)
    for found in (lane, replace(lane, same_lane_share=0.9)):
        none, one, two, tiles = (replace(found, transverse_stripes=n).confidence for n in (0, 1, 2, 6))
        assert tiles == two < one < none
        assert two < none - 0.1
