"""The search in a single image: lanes on painted roads, one line missing, neighbours,
no lane.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.evidence import PAINT, PaintSettings, find_evidence
from lanes.detect.fit import FitSettings
from lanes.detect.lane import Lane
from lanes.detect.search import (
    DetectorSettings,
    detect_still,
    find_lane,
    search_at_heights,
    search_lane,
)
from tests.support.painted_roads import ASPHALT, YELLOW, Arc, Road, dashcam

CAMERA = dashcam()
VIEW = BirdsEyeView(CAMERA)
X_M = np.array([5.0, 10.0, 15.0, 20.0, 25.0, 30.0])


def bend(offset, width, slope, curvature):
    """The two lines of a lane whose middle lies `offset` to the right of the car."""
    return [
        lambda x, s=s: -offset + s * width / 2 + slope * x + curvature * x * x / 2
        for s in (1, -1)
    ]


def test_shaded_bend_off_centre():
    left, right = bend(0.35, 3.5, 0.015, 1 / 420)
    road = Road(CAMERA).line(left, colour=YELLOW).line(right, dash_m=(3, 12))
    road.paint(lambda x, y: y > left(x) + 0.6, (130, 130, 128)).line(
        lambda x: left(x) - 1.4, colour=(50, 50, 50)
    )
    lane = find_lane(
        road.shade(lambda x, y: (x > 11) & (x < 16) & (y > -1), 0.35).image(), CAMERA
    )
    np.testing.assert_allclose(lane.left.y(X_M), left(X_M), atol=0.02)
    np.testing.assert_allclose(lane.right.y(X_M), right(X_M), atol=0.04)
    assert lane.offset_m == pytest.approx(0.35, abs=0.02)
    assert lane.width_m == pytest.approx(3.5, abs=0.03)
    assert lane.heading_rad == pytest.approx(0.015, abs=0.003)
    assert lane.curvature_per_m == pytest.approx(1 / 420, rel=0.06)
    assert (lane.left.colour, lane.right.colour) == ("yellow", "white")
    assert (lane.left.kind, lane.right.kind) == ("solid", "dashed")
    assert lane.left.seen
    assert lane.right.seen
    assert abs(lane.offset_m - 0.35) < 3 * lane.offset_std_m < 0.5


def search_quickly(image: np.ndarray) -> Lane | None:
    """The lane that a search finds in what the band filter sees."""
    evidence = find_evidence(image, VIEW, PAINT, quick=True)
    return search_lane(evidence, DetectorSettings()).lane


@pytest.mark.parametrize("radius", [-18.0, 22.0])
def test_hairpin(radius):
    camera = dashcam(yaw_rad=0.0)
    road = Road(camera, arc=Arc(1 / radius)).lines(1.75, colour=YELLOW).lines(-1.65)
    lane = find_lane(road.image(), camera)
    assert 1 / lane.curvature_per_m == pytest.approx(radius, rel=0.08)
    assert lane.width_m == pytest.approx(3.4, abs=0.12)
    assert lane.offset_m == pytest.approx(-0.05, abs=0.08)


@pytest.mark.parametrize("k", [0, 1])
def test_one_line_missing(k):
    painted = bend(-0.2, 3.6, -0.01, -1 / 600)[k]
    lane = detect_still(Road(CAMERA).line(painted).image(), CAMERA).lane
    seen = lane.lines[k]
    guessed = lane.lines[1 - k]
    # one line does not show the pitch, which moves it by centimetres nearby and by
    # decimetres far away
    error_m = np.abs(seen.y(X_M) - painted(X_M))
    assert (error_m < seen.std_m(X_M)).all()
    assert lane.confidence < 0.5
    assert error_m[0] < 0.1
    assert seen.seen
    assert not guessed.seen
    assert guessed.offset_std_m > 0.3
    assert guessed.reach_m == 0
    assert guessed.describe().endswith("inferred from other lines")
    assert 2.9 < lane.width_m < 4.1


@pytest.mark.parametrize("offset", [-0.5, 1.0])
def test_the_car_is_in_its_lane_whatever_the_neighbours_look_like(offset):
    # the own lane is dashed on both sides; the neighbouring lanes have a solid line
    # each, which is much more paint
    road = Road(CAMERA)
    for number, dash in ((1.5, None), (0.5, (3, 12)), (-0.5, (3, 12)), (-1.5, None)):
        road.lines(3.6 * number - offset, dash_m=dash)
    lane = find_lane(road.image(), CAMERA)
    assert lane.left.offset_m > 0 > lane.right.offset_m
    assert lane.offset_m == pytest.approx(offset, abs=0.3)
    assert lane.width_m == pytest.approx(3.6, abs=0.1)
    np.testing.assert_allclose(
        lane.left.y(np.array([13.0, 25.0])), 1.8 - offset, atol=0.06
    )
    beside = search_quickly(Road(CAMERA).lines(0.3, 3.9).image())
    assert beside.score < 0.9  # less by one


@pytest.mark.parametrize("between_m", [(), (0.0,), (-0.9, 0.0, 0.9)])
def test_lines_between_those_of_the_lane_count(between_m):
    """Tiles have lines along the whole lane. A double line is one line of the lane."""
    image = Road(CAMERA).lines(1.95, 1.7, -1.75, *between_m).image()
    lane = search_quickly(image)
    assert lane.width_m == pytest.approx(3.5, abs=0.1)
    assert lane.clear_share == pytest.approx(2 / (2 + len(between_m)), abs=0.08)


def test_each_step_has_the_given_settings_and_height():
    """Here settings that find nothing. All lengths grow with the height."""
    image = Road(CAMERA).lines(1.8, -1.8).image()
    evidence = find_evidence(image, VIEW, PAINT, quick=True)
    higher = evidence.at_height(1.2 * VIEW.height_m)
    for name in ("x_m", "y_m", "std_m"):
        np.testing.assert_allclose(
            getattr(higher.stripes, name), 1.2 * getattr(evidence.stripes, name)
        )
    for name in ("x_m", "y_m", "pixels"):
        np.testing.assert_allclose(
            getattr(higher.view, name), getattr(replace(higher.view), name), rtol=1e-9
        )
    fits = [
        DetectorSettings(fit=fit)
        for fit in (FitSettings(min_support=9.0), FitSettings(start=((2, 6),)))
    ]
    for blind in (
        *fits,
        DetectorSettings(PaintSettings(min_strength=99.0)),
        DetectorSettings(near_m=60.0),
    ):
        (at_height,) = search_at_heights(image, CAMERA, np.array([1.3]), blind)
        assert find_lane(image, CAMERA, blind) is at_height.lane is None
    assert not len(
        find_evidence(image, VIEW, PaintSettings(noise_floor=1e4), quick=True).stripes
    )


def test_a_lane_too_faint_for_the_band_filter_is_found_and_none_on_a_bare_road():
    assert not any(
        find_lane(Road(CAMERA, noise=noise).image(), CAMERA)
        for noise in (0.0, 2.0, 15.0)
    )
    road = Road(CAMERA, noise=5.0).lines(1.8, -1.8, colour=tuple(np.add(ASPHALT, 8)))
    assert search_quickly(road.image()) is None
    lane = find_lane(road.image(), CAMERA)
    assert lane.confidence > 0.5
    assert lane.width_m == pytest.approx(3.6, abs=0.15)


def test_support_is_the_share_of_the_visible_rows_that_are_painted():
    camera = dashcam(1280)
    lane = find_lane(
        Road(camera, noise=1.0).lines(1.8).lines(-1.8, dash_m=(3, 12)).image(), camera
    )
    assert 0.93 < lane.left.support < 1.03
    assert lane.right.support == pytest.approx(0.25, abs=0.06)
    # near the car the right line is outside of the image
    camera = dashcam(1280, yaw_rad=0.25)
    lane = find_lane(Road(camera, noise=1.0).lines(1.8, -1.8).image(), camera)
    assert 0.9 < lane.left.support < 1.03
    assert 0.9 < lane.right.support < 1.03


def test_a_kerb_of_grass_is_a_road_edge_and_a_faint_line_is_not():
    """The network takes the faint line for an edge, but the band filter sees paint in
    most of its rows.
    """
    grass = Road(CAMERA).lines(1.8).paint(lambda x, y: y < -1.7, (96, 120, 60))
    faint = (
        Road(CAMERA, noise=5.0)
        .lines(1.8)
        .line(lambda x: -1.7 + 0 * x, colour=tuple(np.add(ASPHALT, 10)))
    )
    kinds = [
        [line.kind for line in find_lane(road.image(), CAMERA).lines]
        for road in (grass, faint)
    ]
    assert kinds == [["solid", "road edge"], ["solid", None]]
