"""All systems behind one interface, with the same meaning for the same picture; a
finder of one's own is one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import count
from pathlib import Path

import numpy as np
import pytest

from benchmark.errors import FrameErrors, LaneTruth, frame_errors
from benchmark.estimates import AHEAD_M, ALONG_M, DriveEstimates, LaneEstimate
from benchmark.evaluation import PROJECT_ROOT, score_systems
from benchmark.scores import Row
from benchmark.systems import (
    DETECTOR,
    RECIPE_SYSTEMS,
    SYSTEMS,
    TRACKER,
    column_detector,
    recipe_estimate,
    source_files,
    start_system,
)
from helpers import RoadLine
from lanes.camera.model import Camera, CameraPose
from lanes.detect.lane import Lane
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
STATED = ("confidence", "width_m", "covariance", "lines_std_m")


def estimator(
    system: str, camera: Camera = SMALL
) -> Callable[[np.ndarray], LaneEstimate]:
    """A started system as a function from a frame to its estimate."""
    find, to_estimate = start_system(system, camera, 25.0)
    return lambda image: to_estimate(find(image))


@cache
def estimates_of(system: str) -> DriveEstimates:
    """Those of the first frame of the drive."""
    return DriveEstimates.from_frames([estimator(system)(DRIVE.frame(0.0))], [1.0])


def errors_of(system: str) -> FrameErrors:
    row = truth_row(DRIVE.truth(0.0), frame=0)
    truth = LaneTruth.from_columns({name: np.array([row[name]]) for name in row})
    return frame_errors(estimates_of(system), truth)


@pytest.mark.parametrize("system", SYSTEMS)
def test_estimates_are_in_metres_on_the_road(system):
    assert errors_of(system).lateral_m[0, AHEAD_M == 10] < 0.3


@pytest.mark.parametrize("name", STATED)
@pytest.mark.parametrize("system", [TRACKER, DETECTOR])
def test_tracker_and_detector_state_their_uncertainty(system, name):
    assert np.isfinite(getattr(estimates_of(system), name)).all()


@pytest.mark.parametrize("name", STATED)
@pytest.mark.parametrize("system", RECIPE_SYSTEMS)
def test_recipes_state_no_uncertainty(system, name):
    assert np.isnan(getattr(estimates_of(system), name)).all()


@pytest.mark.parametrize("system", [TRACKER, DETECTOR])
def test_lateral_positions_are_those_of_the_lines(system):
    estimates = estimates_of(system)
    lateral_m = [np.interp(AHEAD_M, *line.T) for line in estimates.lines_m[0]]
    np.testing.assert_allclose(estimates.lines_y_m[0], lateral_m, atol=0.001)


@pytest.mark.parametrize("system", SYSTEMS)
def test_a_black_picture_after_others_is_no_error(system):
    estimate = estimator(system)
    estimate(DRIVE.frame(0.0))
    assert isinstance(estimate(BLACK), dict)


@pytest.mark.parametrize("system", [*RECIPE_SYSTEMS, DETECTOR])
def test_a_black_picture_alone_has_no_lane(system):
    assert not estimator(system)(BLACK)


def columns_of(system: str, rows: np.ndarray, image: np.ndarray) -> np.ndarray:
    return column_detector(system, SMALL)(image, rows)


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("system", RECIPE_SYSTEMS)
def test_stills_give_columns_of_the_raw_picture(system, side):
    x_m = np.geomspace(3, 60, 300)
    y_m = DRIVE.truth(0.0).line_y(side, x_m)
    u, v = SMALL.road_to_pixels(np.column_stack([x_m, y_m])).T
    true = np.interp(ROWS, v[::-1], u[::-1])
    columns = columns_of(system, ROWS, DRIVE.frame(0.0))
    assert np.abs(columns[side] - true).max() < 8


@pytest.mark.parametrize("row", [215, 20, 359 + 200], ids=["far", "above", "below"])
@pytest.mark.parametrize("system", RECIPE_SYSTEMS)
def test_stills_give_no_column_beyond_the_view_of_a_recipe_or_the_picture(system, row):
    columns = columns_of(system, np.array([row]), DRIVE.frame(0.0))
    assert (columns == -2).all()


@pytest.mark.parametrize("system", RECIPE_SYSTEMS)
def test_a_black_still_has_no_column(system):
    assert (columns_of(system, ROWS, BLACK) == -2).all()


class TestFisheye:
    """helpers.py does not know fisheye lenses: a recipe gets the undistorted image."""

    @pytest.fixture(params=["hls_sobel", "hls_sobel_pose"])
    def seen(self, request) -> tuple[LaneEstimate, LaneEstimate]:
        """Through a fisheye lens, and through a pinhole."""
        pose = CameraPose(1.2, pitch_rad=-0.026)
        fisheye = Camera.from_fov((1280, 720), 75, pose, lens="equidistant")
        pinhole = Camera(1280, 720, fisheye.matrix, np.zeros(5), pose)
        road = LaneRoad(curvature_per_m=1 / 500, offset_m=0.3)
        through_fisheye, through_pinhole = (
            estimator(request.param, camera)(paint_lane(road, camera))
            for camera in (fisheye, pinhole)
        )
        return through_fisheye, through_pinhole

    def test_the_road_is_the_same_through_either_lens(self, seen):
        through_fisheye, through_pinhole = (
            estimate["lines_m"][:, ALONG_M == 10] for estimate in seen
        )
        np.testing.assert_allclose(through_fisheye, through_pinhole, atol=0.05)

    def test_the_offset_is_right(self, seen):
        _, through_pinhole = seen
        assert through_pinhole["offset_m"] == pytest.approx(0.3, abs=0.05)


class TestStatedByTheDetector:
    @pytest.fixture
    def lane(self) -> Lane:
        return find_lane(DRIVE.frame(0.0), SMALL)

    @pytest.fixture
    def estimate(self) -> LaneEstimate:
        return estimator(DETECTOR)(DRIVE.frame(0.0))

    def test_the_variances_are_those_of_the_lane(self, lane, estimate):
        assert np.sqrt(np.diag(estimate["covariance"])) == pytest.approx(
            [
                lane.offset_std_m,
                lane.heading_std_rad,
                lane.curvature_std_per_m,
                lane.width_std_m,
            ]
        )

    def test_offset_and_heading_have_the_opposite_covariance(self, lane, estimate):
        """A lane that is farther to the left has the car farther to the right."""
        covariance = lane.covariance[CENTRE, HEADING]
        assert covariance != 0
        assert estimate["covariance"][0, 1] == -covariance

    def test_width_and_lines_are_those_of_the_lane(self, lane, estimate):
        assert estimate["width_m"] == lane.width_m
        lines_std_m = lane.lateral_std_m(AHEAD_M)
        np.testing.assert_array_equal(estimate["lines_std_m"], lines_std_m)


class TestRecipeEstimate:
    """Its signs are those of docs/conventions.md."""

    @pytest.fixture
    def estimate(self) -> LaneEstimate:
        left = RoadLine(1.6, 0.05, 0.002)
        right = RoadLine(-2.0, 0.05, 0.002)
        return recipe_estimate(lane_result(left, right, "kept"))

    def test_offset(self, estimate):
        assert estimate["offset_m"] == pytest.approx(0.2)

    def test_heading(self, estimate):
        assert estimate["heading_rad"] == pytest.approx(np.arctan(0.05))

    def test_curvature(self, estimate):
        assert estimate["curvature_per_m"] == pytest.approx(0.002, rel=0.01)

    def test_lines(self, estimate):
        points_m = estimate["lines_m"][:, ALONG_M == 10].ravel()
        assert points_m == pytest.approx([10.0, 2.2, 10.0, -1.4])

    def test_no_confidence_is_stated(self, estimate):
        assert "confidence" not in estimate


LEVEL = Camera.from_fov((1280, 720), 60, CameraPose(1.4, pitch_rad=0.0))
IMAGE = np.zeros((720, 1280, 3), np.uint8)
# Its lane is one metre farther to the left in each further frame.
COUNTING = """
frames = []

def find(image, camera):
    frames.append(image)
    return (0.0, len(frames) + 1.8), (0.0, len(frames) - 1.8)
"""
BENDING = """
def find(image, camera):
    return (0.001, 0.02, 1.9), (0.001, 0.02, -1.7)
"""


class TestOwnFinder:
    @pytest.fixture
    def file(self, tmp_path) -> Path:
        file = tmp_path / "mine.py"
        file.write_text(COUNTING)
        return file

    def test_each_drive_starts_without_memory(self, file):
        first, second = (
            estimator(f"{file}:find", LEVEL)(IMAGE)["offset_m"] for _ in range(2)
        )
        assert first == pytest.approx(-1.0)
        assert second == first

    @pytest.mark.parametrize(
        ("name", "value"),
        [("offset_m", -0.1), ("heading_rad", 0.02), ("curvature_per_m", 0.002)],
    )
    def test_its_lines_give_the_numbers_of_the_lane(self, file, name, value):
        file.write_text(BENDING)
        estimate = estimator(f"{file}:find", LEVEL)(IMAGE)
        assert estimate[name] == pytest.approx(value, rel=1e-3)

    def test_its_lines_are_those_of_the_lane(self, file):
        file.write_text(BENDING)
        lines_m = estimator(f"{file}:find", LEVEL)(IMAGE)["lines_m"]
        points_m = lines_m[:, ALONG_M == 10].ravel()
        assert points_m == pytest.approx([10.0, 2.2, 10.0, -1.4])

    def test_a_changed_file_is_executed_again(self, file):
        before = estimator(f"{file}:find", LEVEL)(IMAGE)
        file.write_text(BENDING)
        after = estimator(f"{file}:find", LEVEL)(IMAGE)
        assert after["offset_m"] != before["offset_m"]

    def test_its_lines_have_columns_below_the_horizon(self, file):
        file.write_text(BENDING)
        [(u, v)] = LEVEL.road_to_pixels([[10.0, 2.2]])
        rows = np.array([300, v])
        left, _ = column_detector(f"{file}:find", LEVEL)(IMAGE, rows)
        assert left == pytest.approx([-2, u], abs=0.5)

    def test_its_file_is_a_source_of_the_estimates(self, file):
        assert file in source_files(f"{file}:find")


THREE = "find = lambda image, camera: [(0.0, 1.0)] * 3"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "no such file"),
        ("1 / 0", "ZeroDivisionError"),
        ("find = 3", "no function 'find'"),
        (THREE, "two lines or None, but this one returned 3"),
    ],
)
def test_a_wrong_finder_is_named(tmp_path, content, message):
    file = tmp_path / "wrong.py"
    if content:
        file.write_text(content)
    with pytest.raises(ValueError, match=message):
        estimator(f"{file}:find", LEVEL)(IMAGE)


def test_a_finder_of_three_lines_is_refused_for_stills_as_well(tmp_path):
    (tmp_path / "wrong.py").write_text(THREE)
    find_columns = column_detector(f"{tmp_path / 'wrong.py'}:find", LEVEL)
    with pytest.raises(ValueError, match="but this one returned 3"):
        find_columns(IMAGE, ROWS)


class TestScores:
    """Of a finder that returns the true lines, or shifted ones, of each fifth frame."""

    @pytest.fixture(scope="class")
    @classmethod
    def rows(cls) -> list[Row]:
        video = PROJECT_ROOT / "test_videos" / "project_video.mp4"
        truth = read_telemetry(video.with_suffix(".csv"))

        def finder(shift_m: float) -> Callable:
            frames = count(step=5)

            def find(image, camera):
                frame = next(frames)
                x_m = (5, 10, 15, 20)
                lines = []
                for side in ("left", "right"):
                    y_m = [truth[f"{side}_y{x:02d}_m"][frame] for x in x_m]
                    lines.append(np.polyfit(x_m, np.add(y_m, shift_m), 3))
                return lines

            return find

        systems = {"truth": (finder(0.0), 5), "shifted": (finder(0.4), 5)}
        return score_systems(video, systems, end_s=2)

    def test_there_is_a_row_for_each_system(self, rows):
        assert [row["system"] for row in rows] == ["truth", "shifted"]

    def test_each_fifth_frame_counts(self, rows):
        assert [row["frames"] for row in rows] == [10, 10]

    def test_the_truth_is_correct_and_a_shifted_lane_is_not(self, rows):
        assert [row["accuracy"] for row in rows] == [1, 0]

    def test_the_truth_has_hardly_any_error(self, rows):
        assert rows[0]["lateral_5_20m_p95_m"] < 0.005
