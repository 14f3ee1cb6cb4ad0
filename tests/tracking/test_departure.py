"""Time to line crossing against hand-made lanes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lanes.detect.road import CENTRE, WIDTH
from lanes.tracking.departure import (
    Departure,
    DepartureWatch,
    describe_crossings,
    watch_departure,
)
from lanes.tracking.filter import CarMotion
from lanes.tracking.tracker import LaneTracker
from simulator.rendering.drive import Motion
from tests.support.painted_drive import SMALL, PaintedDrive, lane_lines, straight_road
from tests.support.shapes import a_lane


def lane_at(
    centre_m: float, heading_rad: float = 0.0, curvature_per_m: float = 0.0
) -> np.ndarray:
    return a_lane(
        centre=centre_m, width=3.6, heading=heading_rad, curvature=curvature_per_m
    )


def car(speed_mps: float, **motion: float) -> CarMotion:
    certain = dict(
        path_per_m=0.0,
        course_rad=0.0,
        turning_std_per_m=0.0,
        course_std_rad=0.0,
        speed_std_mps=0.0,
    )
    return CarMotion(speed_mps, **{**certain, **motion})


BEND = lane_at(0.0, heading_rad=0.01, curvature_per_m=1 / 400)
# Lane, motion, the line that is crossed, after how many seconds, and the warning if it
# is due.
CROSSINGS = {
    "in the middle": (lane_at(0.0), car(20.0), None, np.inf, None),
    # 20 m/s at 0.03 rad is 0.6 m/s sideways; 0.9 m to go
    "drifting left": (lane_at(0.0, -0.03), car(20.0), "left", 1.5, None),
    "drifting right": (lane_at(0.0, 0.03), car(20.0), "right", 1.5, None),
    "nearer": (
        lane_at(-0.5, -0.03),
        car(20.0),
        "left",
        0.667,
        "lane departure: 0.7 s to the left line",
    ),
    "nearer on the right": (
        lane_at(0.5, 0.03),
        car(20.0),
        "right",
        0.667,
        "lane departure: 0.7 s to the right line",
    ),
    "across the line": (
        lane_at(-1.0, -0.01),
        car(20.0),
        "left",
        0.0,
        "lane departure: crossing the left line",
    ),
    # a steady offset, also that of a camera beside the middle of the car
    "on the line": (lane_at(-1.0), car(20.0), None, np.inf, None),
    "back from the line": (lane_at(-1.0, 0.01), car(20.0), "right", 9.5, None),
    "far away": (lane_at(1.3, -0.0051), car(20.0), None, np.inf, None),
    "by its course": (
        lane_at(0.0, 0.02),
        car(20.0, course_rad=0.02),
        None,
        np.inf,
        None,
    ),
    "standing": (lane_at(0.0, 0.03), car(0.0), None, np.inf, None),
    # R 400 m leads out on the right at v^2 / R = 1 m/s^2: 0.2 t + t^2 / 2 = 0.9
    "straight on in a left bend": (
        BEND,
        car(20.0),
        "right",
        1.156,
        "lane departure: 1.2 s to the right line",
    ),
    "along the bend": (BEND, car(20.0, path_per_m=1 / 400), "right", 4.5, None),
}


@pytest.mark.parametrize("name", CROSSINGS)
def test_time_to_crossing(name):
    lane, motion, side, time_s, words = CROSSINGS[name]
    warning = watch_departure(lane, motion)
    assert warning.side == side
    assert warning.time_to_crossing_s == pytest.approx(time_s, rel=0.02)
    assert warning.describe() == words
    assert warning.due == (words is not None)
    assert (warning.left_m, warning.right_m) == pytest.approx(
        (0.9 + lane[CENTRE], 0.9 - lane[CENTRE]), rel=0.01
    )


def test_distances_are_those_of_the_tyres_and_not_of_the_camera():
    """A camera 0.4 m to the left of the middle of a lorry."""
    camera = replace(SMALL, offset_m=0.4, car_width_m=2.5)
    departure = DepartureWatch().update(lane_at(0.0), car(20.0), camera, 0.0)
    assert (departure.left_m, departure.right_m) == pytest.approx(
        (1.8 + 0.4 - 1.25, 1.8 - 0.4 - 1.25), abs=0.01
    )


def test_uncertainty_suppresses_the_warning():
    lane = lane_at(0.0, -0.05)
    assert watch_departure(lane, car(20.0)).due
    unsure = watch_departure(lane, car(20.0, course_std_rad=0.03))
    assert not unsure.due
    assert (
        unsure.time_to_crossing_s == watch_departure(lane, car(20.0)).time_to_crossing_s
    )
    bend = lane_at(0.0, 0.01, 1 / 80)
    assert watch_departure(bend, car(15.0)).due
    assert not watch_departure(bend, car(15.0, turning_std_per_m=0.01)).due


def watched(
    lanes: list[np.ndarray], motion: CarMotion, step_s: float = 0.04
) -> list[Departure]:
    """The departures in frames of a number of seconds."""
    watch = DepartureWatch()
    return [
        watch.update(lane, motion, SMALL, step_s if n else 0.0)
        for n, lane in enumerate(lanes)
    ]


def test_a_motion_that_is_not_seen_is_no_departure():
    """With a wrong yaw the heading says 0.6 m/s towards the line, but the car stays
    where it is.
    """
    heading = -0.03
    still = watched([lane_at(-0.6, heading)] * 50, car(20.0))
    assert not any(departure.due for departure in still)
    assert still[-1].time_to_crossing_s < 1.0
    for step_s in (0.02, 0.08):  # at 0.6 m/s
        settled = [lane_at(-0.2, heading)] * round(1.2 / step_s)
        approach = [lane_at(-0.2 - 0.6 * step_s * n, heading) for n in range(60)]
        moving = watched(settled + approach, car(20.0), step_s)
        first = next(departure for departure in moving if departure.due)
        # foreseen for 0.5 s, at any frame rate
        assert first.left_m == pytest.approx(0.27, abs=0.07)
        assert first.side == "left"
    short = watched([lane_at(-0.6 - 0.04 * n, -0.05) for n in range(12)], car(20.0))
    assert not any(departure.due for departure in short)


def approach(begin_m: float, step_s: float = 0.04) -> list[np.ndarray]:
    """A car that drifts to the left line at 0.6 m/s, for three seconds."""
    return [lane_at(begin_m - 0.6 * step_s * n, -0.03) for n in range(75)]


def due_times_s(lanes: list[np.ndarray], step_s: float = 0.04) -> np.ndarray:
    departures = watched(lanes, car(20.0), step_s)
    return step_s * np.flatnonzero([departure.due for departure in departures])


def test_no_departure_is_due_in_the_first_second_of_a_track():
    assert due_times_s(approach(-0.6)).min() == pytest.approx(1.0, abs=0.05)


def test_no_departure_is_due_in_the_first_second_after_a_new_width():
    lanes = [lane_at(-0.2, -0.03)] * 30 + approach(-0.2)
    usual_s = due_times_s(lanes)
    begin = int(usual_s.min() / 0.04) + 2
    for lane in lanes[begin:]:
        lane[WIDTH] -= 0.5
    late_s = due_times_s(lanes)
    assert late_s.min() == pytest.approx(usual_s.min(), abs=0.01)
    is_new = (late_s > 0.04 * begin) & (late_s < 0.04 * begin + 1.0)
    assert not is_new.any()
    assert late_s.max() > 0.04 * begin + 1.5


@pytest.mark.parametrize(
    ("speed_mps", "due_in_the_middle"), [(0.75, False), (1.5, True)]
)
def test_after_a_lane_change_the_motion_is_still_seen(speed_mps, due_in_the_middle):
    """The car drifts on to the left into the adjacent lane; the warning comes as early
    as in the first one.
    """
    centres = np.arange(1.8, -5.2, -speed_mps * 0.04)
    lanes = [
        lane_at(centre + 3.6 * (centre < -1.9), -speed_mps / 20.0) for centre in centres
    ]
    departures = np.array(watched(lanes, car(20.0)))
    of_lanes = departures[centres >= -1.9], departures[centres < -1.9]
    first, second = (next(one for one in of_lane if one.due) for of_lane in of_lanes)
    assert first.side == second.side == "left"
    assert 0 < first.time_to_crossing_s < 1.0
    assert second.left_m == pytest.approx(first.left_m, abs=0.05)
    assert of_lanes[0][-1].due
    assert of_lanes[1][-1].due
    assert departures[np.abs(centres + 3.6).argmin()].due == due_in_the_middle


def test_tyres_on_a_line_in_most_frames_are_those_of_another_car():
    rows = {
        "offset_m": np.full(100, 0.7),
        "lane_width_m": np.full(100, 3.0),
        "confidence": np.full(100, 0.9),
    }
    words = describe_crossings(rows, 1.8)
    assert words.startswith(
        "the tyres would be on a line in 100 of 100 frames if the car is 1.8 m"
    )
    assert "--camera-offset or --car-width" in words
    assert describe_crossings(rows, 1.5) is None
    assert describe_crossings({**rows, "confidence": np.full(100, 0.3)}, 1.8) is None


def test_a_tracker_warns_only_of_a_confirmed_and_likely_lane():
    """The car moves to the left line at 0.7 m/s in the first frame; the lane may still
    be a wrong one.
    """
    motion = Motion(speed_mps=25.0, offset_m=0.36, shift_m=2.5, shift_start_s=-1.0)
    drive = PaintedDrive(straight_road(), lane_lines(), motion, camera=SMALL)
    tracker = LaneTracker(SMALL, fps=25)
    watch = DepartureWatch()
    lanes = [tracker.update(drive.frame(number / 25)) for number in range(32)]
    for number, lane in enumerate(filter(None, lanes)):
        raw = watch.update(lane.model, lane.motion, SMALL, 0.04 if number else 0.0)
        sure = lane.state == "tracking" and lane.confidence >= 0.5
        assert lane.departure.due == (raw.due and sure)
    assert lanes[-1].departure.due
    assert lanes[-1].departure.side == "left"
    assert not lanes[0].departure.due
