"""All lane finders behind one door: the same picture, the same meaning of what they say."""

from __future__ import annotations

import numpy as np
import pytest

from benchmark.errors import LaneTruth, frame_errors
from benchmark.estimates import AT_M, Readings
from benchmark.systems import SYSTEMS, find_with, follow_with, read_classic
from lanes.classic.measure import RoadLine
from lanes.classic.result import LaneResult
from simulator.rendering.drive import Motion
from simulator.road.truth import truth_row
from tests.support.painted_drive import CAMERA, PaintedDrive, lane_lines, s_bend

SMALL = CAMERA.scaled((640, 360))
DRIVE = PaintedDrive(
    s_bend(), lane_lines(right={"dash_m": None}), motion=Motion(60.0, 25.0, offset_m=0.3), camera=SMALL
)
ROWS = np.arange(240, 311, 10)


@pytest.mark.parametrize("system", SYSTEMS)
def test_followed_lanes_are_in_metres_of_the_road(system):
    follow = follow_with(system, SMALL, 25.0)
    readings = Readings.of([follow(DRIVE.frame(0.0))], [1.0])
    truth = LaneTruth.of({name: np.array([value]) for name, value in truth_row(DRIVE.truth(0.0), frame=0).items()})
    errors = frame_errors(readings, truth)
    assert errors.lateral_m[0, AT_M == 10] < 0.3
    assert np.isnan(readings.confidence[0]) == (system != "tracker")
    assert follow(np.zeros((360, 640, 3), np.uint8)) is not None


@pytest.mark.parametrize("system", SYSTEMS)
def test_stills_give_columns_of_the_raw_picture(system):
    columns = find_with(system, SMALL)(DRIVE.frame(0.0), ROWS)
    x = np.geomspace(3, 60, 300)
    for side in (0, 1):
        u, v = SMALL.road_to_pixels(np.column_stack([x, DRIVE.truth(0.0).line_y(side, x)])).T
        true = np.interp(ROWS, v[::-1], u[::-1])
        assert np.abs(columns[side] - true).max() < 8, system
    # below and above the picture there is no line, nor in a picture of nothing
    assert (find_with(system, SMALL)(DRIVE.frame(0.0), np.array([20, 359 + 200])) == -2).all()
    assert (find_with(system, SMALL)(np.zeros((360, 640, 3), np.uint8), ROWS) == -2).all()


def test_what_a_recipe_says_has_the_signs_of_everything_else():
    lane = LaneResult(None, None, RoadLine(1.6, 0.05, 0.002), RoadLine(-2.0, 0.05, 0.002), "kept", None)
    said = read_classic(lane)
    assert said.offset_m == pytest.approx(0.2)
    assert said.heading_rad == pytest.approx(np.arctan(0.05))
    assert said.curvature_per_m == pytest.approx(0.002, rel=0.01)
    assert said.lines_y_m[:, AT_M == 10].ravel() == pytest.approx([2.2, -1.4])
    assert said.confidence is None


def test_one_line_is_no_lane():
    said = read_classic(LaneResult(None, None, RoadLine(1.6, 0, 0), None, "lost", None))
    assert (said.lines_y_m, said.offset_m, said.curvature_per_m) == (None, None, None)


def test_unknown_systems_are_refused():
    for ask in (lambda: follow_with("yolo", SMALL, 25.0), lambda: find_with("yolo", SMALL)):
        with pytest.raises(ValueError, match="there is no system 'yolo'; the systems are hls_sobel"):
            ask()
