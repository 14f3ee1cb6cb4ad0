"""Ground truth, and motion of the car.

Truth on the painted lines, behind vehicles, through lane changes, without a lane.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace

import numpy as np
import pytest

from lanes.camera.model import Camera
from lanes.files import read_telemetry
from simulator.objects.scene_objects import PlacedObject
from simulator.objects.vehicles import Car
from simulator.rendering.drive import Drive, Motion
from simulator.rendering.render import Frame, render_frame
from simulator.road.geometry import RoadGeometry, VehiclePose
from simulator.road.markings import Marking
from simulator.road.truth import (
    H_SAMPLES,
    NOT_VISIBLE,
    Truth,
    lane_truth,
    line_pixels,
    truth_entry,
    truth_row,
    write_truth_csv,
)
from simulator.scenes.freeway import EGO_LINES_M
from tests.simulator.small_drive import (
    FULL,
    SMALL,
    largest_difference,
    small_drive,
    weighted_column,
)

BENDS = RoadGeometry(
    [0.0, 30.0, 40.0, 85.0],
    [0.0, 0.0, 1 / 20, 1 / 20],
)


@pytest.mark.parametrize("curvature", [1 / 250, -1 / 250])
def test_truth_lies_on_the_paint_of_the_picture(curvature):
    markings = tuple(Marking(line_m, 0.15, wear=0.0) for line_m in EGO_LINES_M)
    drive = small_drive(curvature, camera=FULL, markings=markings)
    frame = render_frame(drive)
    blue = frame.image[..., 2].astype(float)
    errors_px = []
    for side in (0, 1):
        columns = line_pixels(frame.truth, side, FULL)
        for row, u in zip(H_SAMPLES, columns, strict=True):
            if row > 440 and 50 < u < FULL.width - 50:
                at = np.arange(round(u) - 45, round(u) + 46)
                centre = weighted_column(blue[row, at] - 120, at)
                errors_px.append(centre - u)
    assert len(errors_px) > 30
    assert np.abs(errors_px).max() < 0.35
    assert abs(np.mean(errors_px)) < 0.1


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param({"wander_m": 0.3}, id="oscillation"),
        pytest.param(
            {"shift_m": -3.6, "shift_start_s": 1.0, "shift_seconds": 3.0},
            id="lane change",
        ),
    ],
)
def test_the_heading_is_the_slope_of_the_path(changes):
    motion = Motion(0.0, 25.0, 0.1, wander_period_s=6.0, **changes)
    before = motion.pose(1.99)
    now = motion.pose(2.0)
    after = motion.pose(2.01)
    slope = (after.lateral_m - before.lateral_m) / (after.s_m - before.s_m)
    assert now.heading_rad == pytest.approx(np.arctan(slope), abs=2e-6)


@dataclass(frozen=True)
class LaneChange:
    """Truth of a change to the lane on the right.

    At all times, and just before and after the lane switches.
    """

    truths: list[Truth]
    before: Truth
    after: Truth


@pytest.fixture(scope="module")
def lane_change() -> LaneChange:
    motion = Motion(
        0.0,
        25.0,
        0.2,
        shift_m=-3.6,
        shift_start_s=1.0,
        shift_seconds=3.0,
    )
    road = RoadGeometry([0.0, 300.0], [1 / 800, 1 / 800])
    lines_m = (1.8, -1.8, -5.4)
    truths = []
    for time_s in np.arange(0, 5, 0.04):
        pose = motion.pose(time_s)
        truths.append(lane_truth(road, pose, lines_m, time_s=time_s, pitch_rad=0.0))
    offsets = [truth.offset_m for truth in truths]
    (jump,) = np.flatnonzero(np.abs(np.diff(offsets)) > 1)
    return LaneChange(truths, truths[jump], truths[jump + 1])


def test_lane_switches_when_the_middle_of_the_car_crosses_the_line(lane_change):
    assert lane_change.before.laterals_m == (1.8, -1.8)
    assert lane_change.after.laterals_m == (-1.8, -5.4)


def test_the_right_line_becomes_the_left_one(lane_change):
    right_m = lane_change.before.right.c0_m
    assert right_m == pytest.approx(lane_change.after.left.c0_m, abs=0.1)


def test_a_lane_that_the_car_leaves_to_the_right_leads_left(lane_change):
    heading_rad = lane_change.before.heading_rad
    slope_rad = np.arctan(lane_change.before.left.c1)
    assert heading_rad == pytest.approx(slope_rad, abs=0.01)
    assert heading_rad > 0.02


@pytest.mark.parametrize("at", [0, -1])
def test_the_offset_in_the_lane_is_the_same_before_and_after_the_change(
    lane_change, at
):
    assert lane_change.truths[at].offset_m == pytest.approx(0.2)


def test_the_lane_on_the_outside_of_the_bend_has_the_larger_radius(lane_change):
    first = lane_change.truths[0]
    last = lane_change.truths[-1]
    assert 1 / first.curvature_per_m == pytest.approx(800.0)
    assert 1 / last.curvature_per_m == pytest.approx(803.6)


@pytest.fixture
def no_lane() -> Truth:
    pose = VehiclePose(10.0, 0.5, 0.1)
    return lane_truth(BENDS, pose, (), time_s=0.4, pitch_rad=0.02)


def test_without_lines_there_is_no_lane(no_lane):
    assert not no_lane.has_lane


def test_without_a_lane_no_line_is_in_the_image(no_lane):
    assert (line_pixels(no_lane, 0, SMALL) == NOT_VISIBLE).all()


def test_without_a_lane_only_frame_time_and_pitch_are_in_the_table(no_lane, tmp_path):
    path = tmp_path / "a.csv"
    rows = [truth_row(no_lane, frame=0), truth_row(no_lane, frame=1)]
    write_truth_csv(path, rows)
    table = read_telemetry(path)
    assert table["frame"].tolist() == [0, 1]
    assert table["pitch_rad"].tolist() == [0.02, 0.02]
    empty = {name for name, values in table.items() if np.isnan(values).all()}
    assert set(table) - empty == {"frame", "time_s", "pitch_rad"}


def test_without_a_lane_the_entry_of_a_still_is_null(no_lane):
    hidden = np.zeros((360, 640), bool)
    entry = truth_entry(no_lane, raw_file="a.jpg", camera=SMALL, hidden=hidden)
    assert "NaN" not in json.dumps(entry)
    assert entry["offset_m"] is None
    assert set(entry["left_y_m"]) == {None}


@pytest.fixture(scope="module")
def low_image() -> dict:
    """Entry of an image with 600 rows, fewer than those of H_SAMPLES."""
    pose = SMALL.require_pose()
    drive = small_drive(camera=Camera.from_fov((1280, 600), 60, pose))
    hidden = np.zeros((600, 1280), bool)
    camera = drive.camera_at(0.0)
    return truth_entry(drive.truth(), raw_file="a", camera=camera, hidden=hidden)


def test_rows_below_a_small_image_have_no_line(low_image):
    below = np.array(low_image["h_samples"]) >= 600
    for lane in np.array(low_image["lanes"]):
        assert (lane[below] == NOT_VISIBLE).all()
        assert (lane[~below] > 0).any()


def test_the_left_line_is_left_of_the_right_one(low_image):
    assert low_image["left_y_m"] > low_image["right_y_m"]


def test_distance_is_the_integral_of_the_speed_knots():
    motion = Motion(5.0, 12.0, later_speeds=((2.0, 6.0), (4.0, 6.0)))
    times_s = (0.0, 1.0, 2.0, 3.0, 5.0)
    stations_m = [motion.pose(time_s).s_m for time_s in times_s]
    assert stations_m == pytest.approx([5.0, 15.5, 23.0, 29.0, 41.0])


def test_the_rear_axle_behind_the_camera_follows_the_bend():
    """It is 1.6 m behind the camera; at 12 m/s the lag is 64 % of that distance."""
    motion = Motion(5.0, 12.0, heading_rad=0.01, rear_axle_m=1.6)
    pose = small_drive(1 / 250, motion=motion).pose(3.0)
    assert pose.s_m == 41.0
    assert pose.heading_rad == pytest.approx(0.01 - 0.64 * 1.6 / 250, rel=0.01)


@dataclass(frozen=True)
class Hidden:
    """A line, and a vehicle in front of it."""

    drive: Drive
    with_vehicle: Frame
    without: Frame
    side: int

    def columns(self) -> np.ndarray:
        """Columns of the line, seen or not."""
        camera = self.drive.camera_at(0.0)
        return line_pixels(self.without.truth, self.side, camera)


@pytest.fixture(
    scope="module",
    params=[
        ("motorcycle", 114.0, 1.38, 0),
        ("truck", 122.0, -2.4, 1),
    ],
    ids=["motorcycle", "truck"],
)
def hidden_line(request) -> Hidden:
    body, s_m, lateral_m, side = request.param
    motion = Motion(100.0, 25.0, 0.3)
    empty = small_drive(-1 / 300, camera=FULL, motion=motion)
    vehicle = PlacedObject(s_m, lateral_m, Car("red", body))
    drive = replace(empty, objects=(vehicle,))
    return Hidden(drive, render_frame(drive), render_frame(empty), side)


def test_a_vehicle_does_not_change_the_truth(hidden_line):
    with_vehicle = truth_row(hidden_line.with_vehicle.truth, frame=0)
    assert with_vehicle == truth_row(hidden_line.without.truth, frame=0)


def test_a_vehicle_hides_the_line_where_the_picture_shows_it_instead(hidden_line):
    """Its shadow hides nothing; a pixel at its edge may have the same colour."""
    frame = hidden_line.with_vehicle
    columns = hidden_line.columns()
    entry = truth_entry(
        frame.truth,
        raw_file="x.jpg",
        camera=hidden_line.drive.camera_at(0.0),
        hidden=frame.hidden,
    )
    in_image = columns >= 0
    lane = np.array(entry["lanes"][hidden_line.side])
    hidden = in_image & (lane == NOT_VISIBLE)

    changed = largest_difference(frame.image, hidden_line.without.image) > 20
    shows_vehicle = changed[H_SAMPLES, np.rint(columns).astype(int)] & in_image
    assert hidden.sum() >= 2
    assert (hidden != shows_vehicle).sum() <= 1
