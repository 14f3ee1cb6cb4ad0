"""Ground truth: on the painted lines, behind vehicles, through lane changes, without a lane; motion of the car."""

import json
from dataclasses import replace

import numpy as np
import pytest

from lanes.camera import Camera
from lanes.files import read_telemetry
from simulator.objects.scene_objects import PlacedObject
from simulator.objects.vehicles import Car
from simulator.rendering.drive import Motion
from simulator.rendering.render import render_frame
from simulator.road.geometry import RoadGeometry, VehiclePose
from simulator.road.markings import WHITE, Marking
from simulator.road.truth import (
    H_SAMPLES,
    NOT_VISIBLE,
    lane_truth,
    line_pixels,
    truth_entry,
    truth_row,
    write_truth_csv,
)
from simulator.scenes.freeway import DASHCAM, LANE_WIDTH_M
from tests.simulator.small_drive import POSE, SMALL, small_drive

BENDS = RoadGeometry([0.0, 30.0, 40.0, 85.0], [0.0, 0.0, 1 / 20, 1 / 20])


@pytest.mark.parametrize("curvature", [1 / 250, -1 / 250])
def test_truth_lies_on_the_paint_of_the_picture(curvature):
    camera = replace(DASHCAM, pose=POSE)
    markings = tuple(
        Marking(side * LANE_WIDTH_M / 2, 0.15, WHITE, wear=0.0) for side in (1, -1)
    )
    frame = render_frame(small_drive(curvature, camera=camera, markings=markings))
    light = frame.image[..., 2].astype(float)
    errors = []
    for side in (0, 1):
        for row, u in zip(
            H_SAMPLES, line_pixels(frame.truth, side, camera), strict=True
        ):
            if u > 50 and row > 440 and u < camera.width - 50:
                at = np.arange(round(u) - 45, round(u) + 46)
                weight = np.clip(light[row, at] - 120, 0, None)
                errors.append((weight * at).sum() / weight.sum() - u)
    assert len(errors) > 30
    assert np.abs(errors).max() < 0.35
    assert abs(np.mean(errors)) < 0.1


@pytest.mark.parametrize(
    "changes",
    [{"wander_m": 0.3}, {"shift_m": -3.6, "shift_start_s": 1.0, "shift_seconds": 3.0}],
)
def test_the_heading_is_the_slope_of_the_path(changes):
    motion = Motion(0.0, 25.0, 0.1, wander_period_s=6.0, **changes)
    before, now, after = (motion.pose(t) for t in (1.99, 2.0, 2.01))
    slope = (after.lateral_m - before.lateral_m) / (after.s_m - before.s_m)
    assert now.heading_rad == pytest.approx(np.arctan(slope), abs=2e-6)


def test_lane_change_switches_the_lane_when_the_middle_of_the_car_crosses_the_line():
    motion = Motion(0.0, 25.0, 0.2, shift_m=-3.6, shift_start_s=1.0, shift_seconds=3.0)
    lines = (1.8, -1.8, -5.4)
    road = RoadGeometry([0.0, 300.0], [1 / 800, 1 / 800])
    times = np.arange(0, 5, 0.04)
    truths = [
        lane_truth(road, motion.pose(t), lines, time_s=t, pitch_rad=0.0) for t in times
    ]
    offsets = np.array([t.offset_m for t in truths])
    jumps = np.flatnonzero(np.abs(np.diff(offsets)) > 1)
    assert len(jumps) == 1
    before, after = truths[jumps[0]], truths[jumps[0] + 1]
    assert before.laterals_m == (1.8, -1.8) and after.laterals_m == (-1.8, -5.4)
    # the car moves to the right, and the lane leads left of its direction
    assert (
        before.heading_rad == pytest.approx(np.arctan(before.left.c1), abs=0.01)
        and before.heading_rad > 0.02
    )
    # The right line becomes the left one.
    assert before.right.c0_m == pytest.approx(after.left.c0_m, abs=0.1)
    assert offsets[0] == pytest.approx(0.2) and offsets[-1] == pytest.approx(0.2)
    # The lane on the outside of the bend has the larger radius.
    assert [1 / truths[at].curvature_per_m for at in (0, -1)] == pytest.approx(
        [800.0, 803.6]
    )


def test_truth_rows_are_empty_without_a_lane(tmp_path):
    truth = lane_truth(
        BENDS, VehiclePose(10.0, 0.5, 0.1), (), time_s=0.4, pitch_rad=0.02
    )
    assert not truth.has_lane
    assert (line_pixels(truth, 0, SMALL) == NOT_VISIBLE).all()
    write_truth_csv(
        tmp_path / "a.csv", [truth_row(truth, frame=0), truth_row(truth, frame=1)]
    )
    table = read_telemetry(tmp_path / "a.csv")
    assert table["frame"].tolist() == [0, 1] and table["pitch_rad"].tolist() == [
        0.02,
        0.02,
    ]
    missing = {name for name, values in table.items() if np.isnan(values).all()}
    assert set(table) - missing == {"frame", "time_s", "pitch_rad"}
    entry = truth_entry(
        truth, raw_file="a.jpg", camera=SMALL, hidden=np.zeros((360, 640), bool)
    )
    assert "NaN" not in json.dumps(entry)
    assert entry["offset_m"] is None and set(entry["left_y_m"]) == {None}


def test_rows_below_a_small_image_have_no_line():
    drive = small_drive(camera=Camera.from_fov((1280, 600), 60, POSE))
    entry = truth_entry(
        drive.truth(),
        raw_file="a",
        camera=drive.camera_at(0.0),
        hidden=np.zeros((600, 1280), bool),
    )
    assert entry["left_y_m"] > entry["right_y_m"]
    below = np.array(entry["h_samples"]) >= 600
    for lane in np.array(entry["lanes"]):
        assert (lane[below] == NOT_VISIBLE).all() and (lane[~below] > 0).any()


def test_distance_is_the_integral_of_the_speed_knots():
    motion = Motion(5.0, 12.0, later_speeds=((2.0, 6.0), (4.0, 6.0)))
    assert [motion.pose(t).s_m for t in (0.0, 1.0, 2.0, 3.0, 5.0)] == pytest.approx(
        [5.0, 15.5, 23.0, 29.0, 41.0]
    )
    # the rear axle, 1.6 m behind the camera, follows the bend: 64 % of that at 12 m/s
    pose = small_drive(
        1 / 250,
        motion=replace(motion, later_speeds=(), heading_rad=0.01, rear_axle_m=1.6),
    ).pose(3.0)
    assert (pose.s_m, pose.heading_rad) == (
        41.0,
        pytest.approx(0.01 - 0.64 * 1.6 / 250, rel=0.01),
    )


@pytest.mark.parametrize(
    ("body", "s_m", "lateral_m", "side"),
    [("motorcycle", 114.0, 1.38, 0), ("truck", 122.0, -2.4, 1)],
)
def test_a_vehicle_hides_the_line_where_the_picture_shows_it_instead(
    body, s_m, lateral_m, side
):
    """Its shadow hides nothing; a pixel at its edge may have the same colour."""
    options = {
        "camera": replace(DASHCAM, pose=POSE),
        "motion": Motion(100.0, 25.0, 0.3),
    }
    clear = render_frame(small_drive(-1 / 300, **options))
    drive = small_drive(
        -1 / 300, objects=(PlacedObject(s_m, lateral_m, Car("red", body)),), **options
    )
    frame, columns = (
        render_frame(drive),
        line_pixels(clear.truth, side, drive.camera_at(0.0)),
    )
    assert truth_row(frame.truth, frame=0) == truth_row(clear.truth, frame=0)
    label = truth_entry(
        frame.truth, raw_file="x.jpg", camera=drive.camera_at(0.0), hidden=frame.hidden
    )
    hidden = (columns >= 0) & (np.array(label["lanes"][side]) == NOT_VISIBLE)
    changed = np.abs(frame.image.astype(int) - clear.image).max(axis=2) > 20
    other = changed[H_SAMPLES, np.rint(columns).astype(int)] & (columns >= 0)
    assert hidden.sum() >= 2 and (hidden != other).sum() <= 1
