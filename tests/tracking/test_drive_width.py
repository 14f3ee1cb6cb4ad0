"""The lane width of a drive, for the choice of a lane and for its confidence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lanes.detect.confidence import (
    LIKELY_CONFIDENCE,
    SURE_CONFIDENCE,
    USUAL_WIDTH_M,
)
from lanes.detect.lane import Lane
from lanes.tracking.drive_width import DriveWidth
from lanes.tracking.tracker import LaneTracker
from simulator.rendering.drive import Motion
from tests.support.painted_drive import (
    DASH_M,
    SMALL,
    PaintedDrive,
    Stripe,
    straight_road,
)

FPS = 12.5
SPEED_MPS = 25.0
# The road becomes narrower here, behind a crossing without paint.
NARROW_FROM_M = 100.0
NARROW_FROM_S = NARROW_FROM_M / SPEED_MPS


def road_lines(width_m: float, along_m: tuple[float, float]) -> tuple[Stripe, Stripe]:
    """A solid line on the left, a dashed one on the right."""
    left = Stripe(width_m / 2, along_m=along_m)
    return left, Stripe(-width_m / 2, dash_m=DASH_M, along_m=along_m)


DRIVE = PaintedDrive(
    straight_road(),
    road_lines(3.6, (-50.0, NARROW_FROM_M - 10.0))
    + road_lines(3.0, (NARROW_FROM_M + 10.0, 2000.0)),
    motion=Motion(speed_mps=SPEED_MPS, offset_m=0.2, wander_m=0.25, pitch_rad=0.003),
    camera=SMALL,
)


@pytest.fixture(scope="module")
def narrower() -> list[tuple[float, Lane]]:
    """Time and lane of each frame on a road that becomes 0.6 m narrower."""
    tracker = LaneTracker(SMALL, fps=FPS, lane_width_m=3.6)
    times = np.arange(round(20 * FPS)) / FPS
    return [(time, tracker.update(DRIVE.frame(time))) for time in times]


def lanes_between(frames: list[tuple], first_s: float, last_s: float) -> list[Lane]:
    """Lanes of the frames after the road has become narrower, by the time since."""
    since = [(time - NARROW_FROM_S, lane) for time, lane in frames]
    return [lane for time, lane in since if first_s <= time < last_s]


def test_another_width_than_that_of_the_drive_is_doubted_at_first(narrower):
    confidences = [lane.confidence for lane in lanes_between(narrower, 2.0, 4.0)]
    assert np.median(confidences) < SURE_CONFIDENCE


def test_a_width_that_lasts_is_that_of_another_road(narrower):
    lanes = lanes_between(narrower, 12.0, 16.0)
    assert np.median([lane.confidence for lane in lanes]) >= SURE_CONFIDENCE
    assert np.median([lane.width_m for lane in lanes]) == pytest.approx(3.0, abs=0.1)


def test_the_usual_width_of_a_drive_is_not_doubted(narrower):
    lanes = [lane for time, lane in narrower if 0.4 < time < NARROW_FROM_S - 1.5]
    assert min(lane.confidence for lane in lanes) >= SURE_CONFIDENCE


def test_an_odd_width_costs_more_where_a_drive_tells_the_usual_one(narrower):
    _, lane = narrower[-1]
    of_road = replace(lane, usual_width=DriveWidth().usual)
    of_drive = replace(lane, usual_width=DriveWidth.of_pose(3.6).usual)
    assert of_drive.confidence < of_road.confidence - 0.1
    assert of_drive.confidence < LIKELY_CONFIDENCE + 0.4


def test_a_width_is_learnt_with_its_spread():
    widths_m = 3.2 + 0.2 * np.resize([-1.0, 1.0], 3000)
    width = DriveWidth()
    for width_m in widths_m:
        width = width.after(width_m, 0.04)
    assert width.usual.mean_m == pytest.approx(3.2, abs=0.03)
    assert width.usual.std_m == pytest.approx(0.2, abs=0.03)


def test_an_unlikely_lane_is_learnt_more_slowly():
    first = DriveWidth.of_pose(3.6)
    likely = first.after(3.0, 0.95 * 0.04)
    unlikely = first.after(3.0, 0.2 * 0.04)
    assert likely.mean_m < unlikely.mean_m < first.mean_m


def test_the_width_of_roads_counts_as_five_seconds():
    """A drive of 3.2 m, after which the mean is between this and the usual width."""
    width = DriveWidth()
    for seconds, share in [(5, 1 / 2), (5, 2 / 3), (10, 4 / 5)]:
        for _ in range(round(seconds / 0.04)):
            width = width.after(3.2, 0.04)
        expected = USUAL_WIDTH_M + share * (3.2 - USUAL_WIDTH_M)
        assert width.mean_m == pytest.approx(expected, abs=0.002)
