"""All systems behind one interface: their results have the same meaning for the same picture."""

from __future__ import annotations

import numpy as np
import pytest

from benchmark.errors import LaneTruth, frame_errors
from benchmark.estimates import AHEAD_M, DriveEstimates
from benchmark.systems import SYSTEMS, column_detector, recipe_estimate, start_system
from lanes.classic.result import LaneResult, RoadLine
from simulator.rendering.drive import Motion
from simulator.road.truth import truth_row
from tests.support.painted_drive import CAMERA, PaintedDrive, lane_lines, s_bend

SMALL = CAMERA.scaled((640, 360))
DRIVE = PaintedDrive(
    s_bend(), lane_lines(right={"dash_m": None}), motion=Motion(60.0, 25.0, offset_m=0.3), camera=SMALL
)
ROWS = np.arange(240, 311, 10)


@pytest.mark.parametrize("system", SYSTEMS)
def test_estimates_are_in_metres_on_the_road(system):
    estimate = start_system(system, SMALL, 25.0)
    estimates = DriveEstimates.from_frames([estimate(DRIVE.frame(0.0))], [1.0])
    truth = LaneTruth.from_columns(
        {name: np.array([value]) for name, value in truth_row(DRIVE.truth(0.0), frame=0).items()}
    )
    errors = frame_errors(estimates, truth)
    assert errors.lateral_m[0, AHEAD_M == 10] < 0.3
    assert np.isnan(estimates.confidence[0]) == (system != "tracker")
    assert estimate(np.zeros((360, 640, 3), np.uint8)) is not None


@pytest.mark.parametrize("system", SYSTEMS)
def test_stills_give_columns_of_the_raw_picture(system):
    columns = column_detector(system, SMALL)(DRIVE.frame(0.0), ROWS)
    x = np.geomspace(3, 60, 300)
    for side in (0, 1):
        u, v = SMALL.road_to_pixels(np.column_stack([x, DRIVE.truth(0.0).line_y(side, x)])).T
        true = np.interp(ROWS, v[::-1], u[::-1])
        assert np.abs(columns[side] - true).max() < 8, system
    # no line below and above the picture, and none in a black picture
    assert (column_detector(system, SMALL)(DRIVE.frame(0.0), np.array([20, 359 + 200])) == -2).all()
    assert (column_detector(system, SMALL)(np.zeros((360, 640, 3), np.uint8), ROWS) == -2).all()


def test_estimates_of_a_recipe_have_the_signs_of_the_conventions():
    lane = LaneResult(None, None, RoadLine(1.6, 0.05, 0.002), RoadLine(-2.0, 0.05, 0.002), "kept", None)
    estimate = recipe_estimate(lane)
    assert estimate.offset_m == pytest.approx(0.2)
    assert estimate.heading_rad == pytest.approx(np.arctan(0.05))
    assert estimate.curvature_per_m == pytest.approx(0.002, rel=0.01)
    assert estimate.lines_y_m[:, AHEAD_M == 10].ravel() == pytest.approx([2.2, -1.4])
    assert estimate.confidence is None


def test_one_line_is_no_lane():
    estimate = recipe_estimate(LaneResult(None, None, RoadLine(1.6, 0, 0), None, "lost", None))
    assert (estimate.lines_y_m, estimate.offset_m, estimate.curvature_per_m) == (None, None, None)


def test_unknown_systems_are_refused():
    for start in (lambda: start_system("yolo", SMALL, 25.0), lambda: column_detector("yolo", SMALL)):
        with pytest.raises(ValueError, match="there is no system 'yolo'; the systems are hls_sobel"):
            start()
