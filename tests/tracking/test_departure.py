"""Time to line crossing against hand-made lanes."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from lanes.car import CarMotion
from lanes.detect.lane import Lane
from lanes.detect.road import CENTRE, WIDTH
from lanes.tracking.departure import (
    Departure,
    DepartureWatch,
    describe_crossings,
    watch_departure,
)
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
    names = [entry.name for entry in fields(CarMotion)[1:]]
    return CarMotion(speed_mps, **dict.fromkeys(names, 0.0) | motion)


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


@pytest.mark.parametrize(
    ("lane", "speed_mps", "unsure"),
    [
        (lane_at(0.0, -0.05), 20.0, {"course_std_rad": 0.03}),
        (lane_at(0.0, 0.01, 1 / 80), 15.0, {"turning_std_per_m": 0.01}),
    ],
    ids=["course", "turning"],
)
def test_uncertainty_suppresses_the_warning_but_not_the_time(lane, speed_mps, unsure):
    certain = watch_departure(lane, car(speed_mps))
    uncertain = watch_departure(lane, car(speed_mps, **unsure))
    assert certain.due
    assert not uncertain.due
    assert uncertain.time_to_crossing_s == certain.time_to_crossing_s


def watched(
    lanes: list[np.ndarray], motion: CarMotion, step_s: float = 0.04
) -> list[Departure]:
    """The departures in frames of a number of seconds."""
    watch = DepartureWatch()
    elapsed_s = [0.0] + [step_s] * (len(lanes) - 1)
    return [
        watch.update(lane, motion, SMALL, after_s)
        for lane, after_s in zip(lanes, elapsed_s, strict=True)
    ]


def test_a_motion_that_is_not_seen_is_no_departure():
    """With a wrong yaw the heading says 0.6 m/s towards the line, but the car stays
    where it is.
    """
    still = watched([lane_at(-0.6, -0.03)] * 50, car(20.0))
    assert not any(departure.due for departure in still)
    assert still[-1].time_to_crossing_s < 1.0


@pytest.mark.parametrize("step_s", [0.02, 0.08])
def test_a_motion_that_is_seen_is_a_departure_after_half_a_second(step_s):
    """At 0.6 m/s, at any frame rate."""
    settled = [lane_at(-0.2, -0.03)] * round(1.2 / step_s)
    moving = watched(settled + approach(-0.2, step_s), car(20.0), step_s)
    first = next(departure for departure in moving if departure.due)
    assert first.left_m == pytest.approx(0.27, abs=0.07)
    assert first.side == "left"


def test_a_motion_that_is_seen_for_a_moment_is_no_departure():
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


class TestLaneChange:
    """The car drifts on to the left into the adjacent lane."""

    CENTRES_M = {
        speed_mps: np.arange(1.8, -5.2, -0.04 * speed_mps) for speed_mps in (0.75, 1.5)
    }

    def departures(self, speed_mps: float) -> np.ndarray:
        lanes = []
        for centre_m in self.CENTRES_M[speed_mps]:
            of_lane_m = centre_m + 3.6 * (centre_m < -1.9)
            lanes.append(lane_at(of_lane_m, -speed_mps / 20.0))
        return np.array(watched(lanes, car(20.0)))

    @pytest.mark.parametrize("speed_mps", CENTRES_M)
    def test_is_warned_of_as_early_as_in_the_first_lane(self, speed_mps):
        departures = self.departures(speed_mps)
        is_second = self.CENTRES_M[speed_mps] < -1.9
        first, second = (
            next(one for one in departures[of_lane] if one.due)
            for of_lane in (~is_second, is_second)
        )
        assert first.side == second.side == "left"
        assert 0 < first.time_to_crossing_s < 1.0
        assert second.left_m == pytest.approx(first.left_m, abs=0.05)

    @pytest.mark.parametrize("speed_mps", CENTRES_M)
    def test_is_warned_of_until_the_line_is_crossed(self, speed_mps):
        departures = self.departures(speed_mps)
        is_second = self.CENTRES_M[speed_mps] < -1.9
        assert departures[~is_second][-1].due
        assert departures[-1].due

    @pytest.mark.parametrize(("speed_mps", "due"), [(0.75, False), (1.5, True)])
    def test_in_the_middle_of_the_lane_only_a_fast_one_is_warned_of(
        self, speed_mps, due
    ):
        middle = np.abs(self.CENTRES_M[speed_mps] + 3.6).argmin()
        assert self.departures(speed_mps)[middle].due == due


class TestTyresOnALine:
    """In most frames they are those of another car."""

    @pytest.fixture
    def rows(self) -> dict[str, np.ndarray]:
        return {
            "offset_m": np.full(100, 0.7),
            "lane_width_m": np.full(100, 3.0),
            "confidence": np.full(100, 0.9),
        }

    def test_are_described_with_what_to_do(self, rows):
        words = describe_crossings(rows, 1.8)
        assert words.startswith(
            "the tyres would be on a line in 100 of 100 frames if the car is 1.8 m"
        )
        assert "--camera-offset" in words
        assert "--car-width" in words

    def test_are_not_those_of_a_narrow_car(self, rows):
        assert describe_crossings(rows, 1.5) is None

    def test_are_not_known_of_an_unlikely_lane(self, rows):
        rows["confidence"][:] = 0.3
        assert describe_crossings(rows, 1.8) is None


class TestTrackerBesideALine:
    """The car moves to the left line at 0.7 m/s from the first frame on."""

    @pytest.fixture(scope="class")
    @classmethod
    def lanes(cls) -> list[Lane]:
        motion = Motion(speed_mps=25.0, offset_m=0.36, shift_m=2.5, shift_start_s=-1.0)
        drive = PaintedDrive(straight_road(), lane_lines(), motion, camera=SMALL)
        tracker = LaneTracker(SMALL, fps=25)
        return [tracker.update(drive.frame(number / 25)) for number in range(32)]

    def test_warns_of_a_confirmed_and_likely_lane_only(self, lanes):
        """The lane of the first frames may still be a wrong one."""
        watch = DepartureWatch()
        elapsed_s = 0.0
        for lane in filter(None, lanes):
            raw = watch.update(lane.model, lane.motion, SMALL, elapsed_s)
            is_sure = lane.state == "tracking" and lane.confidence >= 0.5
            assert lane.departure.due == (raw.due and is_sure)
            elapsed_s = 0.04

    def test_warns_of_the_left_line_in_the_end(self, lanes):
        assert not lanes[0].departure.due
        assert lanes[-1].departure.due
        assert lanes[-1].departure.side == "left"
