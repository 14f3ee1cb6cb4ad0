"""The telemetry of a lane: its columns, and the values in them."""

from __future__ import annotations

from dataclasses import replace

import pytest

from lanes.camera.model import CameraPose
from lanes.detect.lane import Lane, LineEvidence
from lanes.detect.line_type import TypeVotes
from lanes.telemetry import telemetry_row
from tests.support.painted_roads import dashcam
from tests.support.shapes import a_lane, found_lane, straight_car

# docs/conventions.md; other programs read them by name.
COLUMNS = """
state confidence confident_to_m offset_m offset_std_m heading_rad curvature_per_m curvature_std_per_m lane_width_m pitch_rad
camera_yaw_rad left_c0_m left_c1 left_c2_per_m left_c3_per_m2 left_kind left_colour left_double right_c0_m right_c1
right_c2_per_m right_c3_per_m2 right_kind right_colour right_double far_left_c0_m far_right_c0_m departure
pose_height_m pose_pitch_rad pose_yaw_rad pose_roll_rad
"""
STD = a_lane(centre=0.02, width=0.03, heading=2e-3, curvature=2e-4)
SOLID = TypeVotes(3.0, 2.0, 30.0, 30.0, 30.0, 0.0, looks=3.0, white=0.0, yellow=2.7)
DASHED = TypeVotes(3.0, 0.0, 30.0, 24.0, 6.0, 18.0, looks=3.0, white=3.0, yellow=0.0)
SEEN = (
    LineEvidence(0.6, True, 25.0, votes=SOLID),
    LineEvidence(0.3, True, 30.0, votes=DASHED),
)


@pytest.fixture(scope="module")
def lane() -> Lane:
    """A lane 3.4 m wide in a left bend; the car is 0.4 m right of its centre."""
    return found_lane(a_lane(centre=0.4, width=3.4, curvature=1 / 80), STD, SEEN)


def test_the_columns_have_the_names_and_the_order_that_is_documented(lane):
    assert list(telemetry_row(lane)) == COLUMNS.split()


def test_a_lost_lane_has_the_same_columns(lane):
    assert list(telemetry_row(None)) == list(telemetry_row(lane))


def test_a_lost_lane_has_a_confidence_of_0_and_no_other_value():
    row = telemetry_row(None)
    assert (row.pop("state"), row.pop("confidence")) == ("lost", 0.0)
    assert set(row.values()) == {None}


@pytest.mark.parametrize(
    ("column", "value"),
    [
        ("offset_m", -0.4),
        ("offset_std_m", 0.02),
        ("lane_width_m", 3.4),
        ("curvature_per_m", 1 / 79.6),
        ("curvature_std_per_m", 2e-4),
        ("left_c0_m", 0.4 + 1.7),
        ("right_c0_m", 0.4 - 1.7),
    ],
)
def test_numbers_are_those_of_the_lane(lane, column, value):
    assert telemetry_row(lane)[column] == pytest.approx(value)


@pytest.mark.parametrize(
    ("side", "types"),
    [("left", ["solid", "yellow", True]), ("right", ["dashed", "white", False])],
)
def test_each_line_has_its_type(lane, side, types):
    row = telemetry_row(lane)
    assert [row[f"{side}_{name}"] for name in ("kind", "colour", "double")] == types


@pytest.mark.parametrize(("side", "place_m"), [(0, 0.4 + 5.1), (1, 0.4 - 5.1)])
def test_a_far_line_stands_in_the_column_of_its_side(lane, side, place_m):
    far = [None, None]
    far[side] = LineEvidence(0.3, True, 30.0)
    row = telemetry_row(replace(lane, far_evidence=tuple(far)))

    columns = ["far_left_c0_m", "far_right_c0_m"]
    assert row[columns[side]] == pytest.approx(place_m)
    assert row[columns[1 - side]] is None


@pytest.mark.parametrize(("due", "value"), [(True, "right"), (False, None)])
def test_a_departure_is_told_if_a_warning_is_due(lane, due, value):
    car = straight_car(camera_yaw_rad=0.0)
    departure = replace(car.departure, side="right", due=due)
    tracked = replace(lane, car=replace(car, departure=departure))
    assert telemetry_row(tracked)["departure"] == value


@pytest.mark.parametrize(("car", "value"), [(straight_car(0.02), 0.02), (None, None)])
def test_a_single_image_shows_no_yaw_of_the_camera(lane, car, value):
    assert telemetry_row(replace(lane, car=car))["camera_yaw_rad"] == value


def test_the_pose_is_that_of_the_camera_that_the_lane_was_found_with(lane):
    pose = CameraPose(height_m=1.5, pitch_rad=0.01, yaw_rad=0.02, roll_rad=0.03)
    row = telemetry_row(replace(lane, camera=dashcam().with_pose(pose)))
    assert [row[name] for name in row if name.startswith("pose_")] == [
        1.5,
        0.01,
        0.02,
        0.03,
    ]
