"""All systems behind one interface, with the same meaning for the same picture; a
finder of one's own is one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import count

import numpy as np
import pytest

from benchmark.errors import LaneTruth, frame_errors
from benchmark.estimates import AHEAD_M, ALONG_M, DriveEstimates, LaneEstimate
from benchmark.evaluation import PROJECT_ROOT, score_systems
from benchmark.systems import (
    RECIPE_SYSTEMS,
    SYSTEMS,
    column_detector,
    recipe_estimate,
    source_files,
    start_system,
)
from helpers import RoadLine
from lanes.camera.model import Camera, CameraPose
from lanes.detect.road import CENTRE, HEADING
from lanes.detect.search import find_lane
from lanes.files import read_telemetry
from simulator.road.truth import truth_row
from tests.support.classic_lane import lane_result
from tests.support.painted_drive import BENDS, SMALL, lane_lines
from tests.support.painted_roads import LaneRoad, paint_lane

DRIVE = replace(BENDS, lines=lane_lines(right={"dash_m": None}))
BLACK = np.zeros((360, 640, 3), np.uint8)
ROWS = np.arange(240, 311, 10)


def estimator(
    system: str, camera: Camera = SMALL
) -> Callable[[np.ndarray], LaneEstimate]:
    """A started system as a function from a frame to its estimate."""
    find, to_estimate = start_system(system, camera, 25.0)
    return lambda image: to_estimate(find(image))


@pytest.mark.parametrize("system", SYSTEMS)
def test_estimates_are_in_metres_on_the_road(system):
    estimate = estimator(system)
    row = truth_row(DRIVE.truth(0.0), frame=0)
    estimates = DriveEstimates.from_frames([estimate(DRIVE.frame(0.0))], [1.0])
    errors = frame_errors(
        estimates,
        LaneTruth.from_columns(
            {name: np.array([value]) for name, value in row.items()}
        ),
    )
    assert errors.lateral_m[0, AHEAD_M == 10] < 0.3
    states = system in ("tracker", "detector")
    for name in ("confidence", "width_m", "covariance", "lines_std_m"):
        assert np.isfinite(getattr(estimates, name)[0]).all() == states, name
    if states:
        lateral_m = [np.interp(AHEAD_M, *line.T) for line in estimates.lines_m[0]]
        np.testing.assert_allclose(estimates.lines_y_m[0], lateral_m, atol=0.001)
    assert estimate(BLACK) is not None
    assert system == "tracker" or not estimator(system)(BLACK)


@pytest.mark.parametrize("system", RECIPE_SYSTEMS)
def test_stills_give_columns_of_the_raw_picture(system):
    columns = column_detector(system, SMALL)(DRIVE.frame(0.0), ROWS)
    x = np.geomspace(3, 60, 300)
    for side in (0, 1):
        u, v = SMALL.road_to_pixels(
            np.column_stack([x, DRIVE.truth(0.0).line_y(side, x)])
        ).T
        true = np.interp(ROWS, v[::-1], u[::-1])
        assert np.abs(columns[side] - true).max() < 8, system
    # a recipe sees a line up to the upper end of its view
    assert (
        column_detector(system, SMALL)(DRIVE.frame(0.0), np.array([215])) == -2
    ).all()
    # no line below and above the picture, and none in a black picture
    assert (
        column_detector(system, SMALL)(DRIVE.frame(0.0), np.array([20, 359 + 200]))
        == -2
    ).all()
    assert (column_detector(system, SMALL)(BLACK, ROWS) == -2).all()


@pytest.mark.parametrize("system", ["hls_sobel", "hls_sobel_pose"])
def test_a_recipe_sees_the_road_through_a_fisheye_lens(system):
    """Which helpers.py does not know: it gets the undistorted image."""
    pose = CameraPose(1.2, pitch_rad=-0.026)
    fisheye = Camera.from_fov((1280, 720), 75, pose, lens="equidistant")
    pinhole = Camera(1280, 720, fisheye.matrix, np.zeros(5), pose)
    road = LaneRoad(curvature_per_m=1 / 500, offset_m=0.3)
    seen = estimator(system, fisheye)(paint_lane(road, fisheye))
    expected = estimator(system, pinhole)(paint_lane(road, pinhole))
    assert expected["offset_m"] == pytest.approx(0.3, abs=0.05)
    at_10_m = np.s_[:, ALONG_M == 10]
    np.testing.assert_allclose(
        seen["lines_m"][at_10_m], expected["lines_m"][at_10_m], atol=0.05
    )


def test_stated_uncertainties_are_those_of_the_lane():
    lane = find_lane(DRIVE.frame(0.0), SMALL)
    estimate = estimator("detector")(DRIVE.frame(0.0))
    stds = (
        lane.offset_std_m,
        lane.heading_std_rad,
        lane.curvature_std_per_m,
        lane.width_std_m,
    )
    assert np.sqrt(np.diag(estimate["covariance"])) == pytest.approx(stds)
    assert estimate["width_m"] == lane.width_m
    np.testing.assert_array_equal(estimate["lines_std_m"], lane.lateral_std_m(AHEAD_M))
    # a lane that is farther to the left has the car farther to the right
    assert estimate["covariance"][0, 1] == -lane.covariance[CENTRE, HEADING] != 0


def test_estimates_of_a_recipe_have_the_signs_of_the_conventions():
    lane = lane_result(RoadLine(1.6, 0.05, 0.002), RoadLine(-2.0, 0.05, 0.002), "kept")
    estimate = recipe_estimate(lane)
    assert estimate["offset_m"] == pytest.approx(0.2)
    assert estimate["heading_rad"] == pytest.approx(np.arctan(0.05))
    assert estimate["curvature_per_m"] == pytest.approx(0.002, rel=0.01)
    assert estimate["lines_m"][:, ALONG_M == 10].ravel() == pytest.approx(
        [10.0, 2.2, 10.0, -1.4]
    )
    assert "confidence" not in estimate


LEVEL = Camera.from_fov((1280, 720), 60, CameraPose(1.4, pitch_rad=0.0))
VIDEO = PROJECT_ROOT / "test_videos" / "project_video.mp4"
IMAGE = np.zeros((720, 1280, 3), np.uint8)
# Its lane is one metre farther to the left in each further frame.
COUNTING = """
frames = []

def find(image, camera):
    frames.append(image)
    return (0.0, len(frames) + 1.8), (0.0, len(frames) - 1.8)
"""


def test_a_finder_in_a_file_is_a_system_as_it_is_now(tmp_path):
    """Each drive starts without memory."""
    file = tmp_path / "mine.py"
    file.write_text(COUNTING)
    system = f"{file}:find"
    for _ in range(2):
        assert estimator(system, LEVEL)(IMAGE)["offset_m"] == pytest.approx(-1.0)
    file.write_text(
        "def find(image, camera):\n    return (0.001, 0.02, 1.9), (0.001, 0.02, -1.7)\n"
    )
    estimate = estimator(system, LEVEL)(IMAGE)
    assert estimate["lines_m"][:, ALONG_M == 10].ravel() == pytest.approx(
        [10.0, 2.2, 10.0, -1.4]
    )
    assert (estimate["offset_m"], estimate["heading_rad"]) == pytest.approx(
        (-0.1, 0.02), abs=1e-4
    )
    assert estimate["curvature_per_m"] == pytest.approx(0.002, rel=1e-3)
    u, v = LEVEL.road_to_pixels([[10.0, 2.2]])[0]
    columns = column_detector(system, LEVEL)(IMAGE, np.array([300, v]))
    assert columns[0] == pytest.approx([-2, u], abs=0.5)
    assert file in source_files(system)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "no such file"),
        ("1 / 0", "ZeroDivisionError"),
        ("find = 3", "no function 'find'"),
        (
            "find = lambda image, camera: [(0.0, 1.0)]",
            "two lines or None, but this one returned 1",
        ),
    ],
)
def test_a_wrong_finder_is_named(tmp_path, content, message):
    file = tmp_path / "wrong.py"
    if content:
        file.write_text(content)
    with pytest.raises(ValueError, match=message):
        estimator(f"{file}:find", LEVEL)(IMAGE)


def test_the_score_of_the_truth_is_full_and_of_a_shifted_lane_is_none():
    truth = read_telemetry(VIDEO.with_suffix(".csv"))

    def finder(shift_m: float):
        frames = count(step=5)

        def find(image, camera):
            k = next(frames)
            x_m = (5, 10, 15, 20)
            lines_m = (
                [truth[f"{side}_y{x:02d}_m"][k] + shift_m for x in x_m]
                for side in ("left", "right")
            )
            return [np.polyfit(x_m, line_m, 3) for line_m in lines_m]

        return find

    systems = {"truth": (finder(0.0), 5), "shifted": (finder(0.4), 5)}
    row, shifted = score_systems(VIDEO, systems, end_s=2)
    assert (row["system"], row["frames"], row["accuracy"]) == ("truth", 10, 1.0)
    assert row["lateral_5_20m_p95_m"] < 0.005
    assert shifted["accuracy"] == 0
