"""All systems behind one interface: their results have the same meaning for the same picture."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from benchmark.errors import LaneTruth, frame_errors
from benchmark.estimates import AHEAD_M, ALONG_M, DriveEstimates, LaneEstimate
from benchmark.systems import SYSTEMS, column_detector, recipe_estimate, start_system
from classic.fit import RoadLine
from lanes.camera import Camera
from lanes.detect.road import CENTRE, HEADING
from lanes.stills import find_lane
from simulator.rendering.drive import Motion
from simulator.road.truth import truth_row
from tests.support.classic_lane import lane_result
from tests.support.painted_drive import CAMERA, PaintedDrive, lane_lines, s_bend

SMALL = CAMERA.scaled((640, 360))
SOLID = lane_lines(right={"dash_m": None})
DRIVE = PaintedDrive(s_bend(), SOLID, motion=Motion(60.0, 25.0, offset_m=0.3), camera=SMALL)
BLACK = np.zeros((360, 640, 3), np.uint8)
ROWS = np.arange(240, 311, 10)


def estimator(system: str, camera: Camera = SMALL) -> Callable[[np.ndarray], LaneEstimate]:
    """A started system as a function from a frame to its estimate."""
    find, to_estimate = start_system(system, camera, 25.0)
    return lambda image: to_estimate(find(image))


@pytest.mark.parametrize("system", SYSTEMS)
def test_estimates_are_in_metres_on_the_road(system):
    estimate, row = estimator(system), truth_row(DRIVE.truth(0.0), frame=0)
    estimates = DriveEstimates.from_frames([estimate(DRIVE.frame(0.0))], [1.0])
    errors = frame_errors(estimates, LaneTruth.from_columns({name: np.array([value]) for name, value in row.items()}))
    assert errors.lateral_m[0, AHEAD_M == 10] < 0.3
    states = system in ("tracker", "detector")
    for name in ("confidence", "width_m", "covariance", "lines_std_m"):
        assert np.isfinite(getattr(estimates, name)[0]).all() == states, name
    if states:
        lateral_m = [np.interp(AHEAD_M, *line.T) for line in estimates.lines_m[0]]
        np.testing.assert_allclose(estimates.lines_y_m[0], lateral_m, atol=0.001)
    assert estimate(BLACK) is not None


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
    assert (column_detector(system, SMALL)(BLACK, ROWS) == -2).all()


def test_stated_uncertainties_are_those_of_the_lane():
    lane = find_lane(DRIVE.frame(0.0), SMALL)
    estimate = estimator("detector")(DRIVE.frame(0.0))
    stds = lane.offset_std_m, lane.heading_std_rad, lane.curvature_std_per_m, lane.width_std_m
    assert np.sqrt(np.diag(estimate.covariance)) == pytest.approx(stds)
    assert estimate.width_m == lane.width_m
    np.testing.assert_array_equal(estimate.lines_std_m, lane.lateral_std_m(AHEAD_M))
    # a lane that is farther to the left has the car farther to the right
    assert estimate.covariance[0, 1] == -lane.covariance[CENTRE, HEADING] != 0


def test_the_detector_has_no_memory():
    estimate = estimator("detector")
    first = estimate(DRIVE.frame(0.0))
    assert estimate(BLACK).offset_m is None
    assert estimate(DRIVE.frame(0.0)).offset_m == first.offset_m


def test_estimates_of_a_recipe_have_the_signs_of_the_conventions():
    lane = lane_result(RoadLine(1.6, 0.05, 0.002), RoadLine(-2.0, 0.05, 0.002), "kept")
    estimate = recipe_estimate(lane)
    assert estimate.offset_m == pytest.approx(0.2)
    assert estimate.heading_rad == pytest.approx(np.arctan(0.05))
    assert estimate.curvature_per_m == pytest.approx(0.002, rel=0.01)
    assert estimate.lines_m[:, ALONG_M == 10].ravel() == pytest.approx([10.0, 2.2, 10.0, -1.4])
    assert estimate.confidence is None


def test_unknown_systems_are_refused():
    for start in (lambda: start_system("yolo", SMALL, 25.0), lambda: column_detector("yolo", SMALL)):
        with pytest.raises(ValueError, match="there is no system 'yolo'; the systems are hls_sobel"):
            start()
