"""Time to line crossing against hand-made lanes."""

from __future__ import annotations

import numpy as np
import pytest

from lanes.detect.road import CENTRE
from lanes.track.departure import watch_departure
from lanes.track.filter import CarMotion
from lanes.track.tracker import LaneTracker
from simulator.rendering.drive import Motion
from tests.support.painted_drive import SMALL, PaintedDrive, lane_lines, straight_road
from tests.support.shapes import a_lane


def lane_at(centre_m: float, heading_rad: float = 0.0, curvature_per_m: float = 0.0) -> np.ndarray:
    return a_lane(centre=centre_m, width=3.6, heading=heading_rad, curvature=curvature_per_m)


def car(speed_mps: float, **motion: float) -> CarMotion:
    certain = dict(path_per_m=0.0, course_rad=0.0, turning_std_per_m=0.0, course_std_rad=0.0)
    return CarMotion(speed_mps, **{**certain, **motion})


BEND = lane_at(0.0, heading_rad=0.01, curvature_per_m=1 / 400)
# Lane, motion, the line that is crossed, after how many seconds, and the warning if it is due.
CROSSINGS = {
    "in the middle": (lane_at(0.0), car(20.0), None, np.inf, None),
    # 20 m/s at 0.03 rad is 0.6 m/s sideways; 0.9 m to go
    "drifting left": (lane_at(0.0, -0.03), car(20.0), "left", 1.5, None),
    "drifting right": (lane_at(0.0, 0.03), car(20.0), "right", 1.5, None),
    "nearer": (lane_at(-0.5, -0.03), car(20.0), "left", 0.667, "lane departure: 0.7 s to the left line"),
    "nearer on the right": (lane_at(0.5, 0.03), car(20.0), "right", 0.667, "lane departure: 0.7 s to the right line"),
    "on the line": (lane_at(-1.0), car(20.0), "left", 0.0, "lane departure: crossing the left line"),
    "by its course": (lane_at(0.0, 0.02), car(20.0, course_rad=0.02), None, np.inf, None),
    "standing": (lane_at(0.0, 0.03), car(0.0), None, np.inf, None),
    # R 400 m leads out on the right at v^2 / R = 1 m/s^2: 0.2 t + t^2 / 2 = 0.9
    "straight on in a left bend": (BEND, car(20.0), "right", 1.156, None),
    "along the bend": (BEND, car(20.0, path_per_m=1 / 400), "right", 4.5, None),
}


@pytest.mark.parametrize("name", CROSSINGS)
def test_time_to_crossing(name):
    lane, motion, side, time_s, words = CROSSINGS[name]
    warning = watch_departure(lane, motion)
    assert warning.side == side and warning.time_to_crossing_s == pytest.approx(time_s, rel=0.02)
    assert warning.describe() == words and warning.due == (words is not None)
    assert (warning.left_m, warning.right_m) == pytest.approx((0.9 + lane[CENTRE], 0.9 - lane[CENTRE]), rel=0.01)


def test_no_warning_without_a_crossing():
    """The turning would avoid the line; less turning than that would not."""
    motion = car(20.0, turning_std_per_m=0.003, course_std_rad=0.001)
    warning = watch_departure(lane_at(-0.4, -0.05, 0.0028), motion)
    assert (warning.side, warning.time_to_crossing_s) == (None, float("inf"))
    assert not warning.due and warning.describe() is None


def test_a_car_that_turns_like_its_road_drifts_at_a_constant_rate():
    """The lane centre, 0.6 m inside, is an arc of R 19.4 m. The car follows the arc of R 20 m through itself."""
    warning = watch_departure(lane_at(-0.6, 0.0, -1 / 20), car(10.0, path_per_m=-1 / 20, course_rad=0.008))
    assert warning.time_to_crossing_s == pytest.approx(warning.left_m / 0.08, rel=0.01)


def test_uncertainty_suppresses_the_warning():
    lane = lane_at(0.0, -0.05)
    assert watch_departure(lane, car(20.0)).due
    unsure = watch_departure(lane, car(20.0, course_std_rad=0.03))
    assert not unsure.due and unsure.time_to_crossing_s == watch_departure(lane, car(20.0)).time_to_crossing_s
    bend = lane_at(0.0, 0.01, 1 / 80)
    assert watch_departure(bend, car(15.0)).due and not watch_departure(bend, car(15.0, turning_std_per_m=0.01)).due


def test_a_tracker_warns_only_of_a_confirmed_and_likely_lane():
    """The car drifts over the left line from the first frame on; the lane may still be a wrong one."""
    drive = PaintedDrive(
        straight_road(),
        lane_lines(),
        Motion(speed_mps=25.0, offset_m=0.75),
        camera=SMALL,
        drift_mps=0.9,
        drift_s=(0.0, 3.0),
    )
    tracker = LaneTracker(SMALL, fps=25)
    lanes = [tracker.update(drive.frame(number / 25)) for number in range(20)]
    for lane in filter(None, lanes):
        raw = watch_departure(lane.model, lane.motion)
        sure = lane.state == "tracking" and lane.confidence >= 0.5
        assert lane.departure.due == (raw.due and sure)
    assert lanes[-1].departure.due and lanes[-1].departure.side == "left"
    assert not lanes[0].departure.due
