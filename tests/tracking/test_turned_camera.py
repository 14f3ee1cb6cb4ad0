"""A camera that is knocked in a drive: its new yaw is taken once many frames agree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lanes.detect.confidence import SURE_CONFIDENCE
from lanes.detect.lane import Lane
from lanes.tracking.tracker import LaneTracker
from lanes.tracking.turned_camera import LASTS_S, TurnedCamera
from simulator.rendering.drive import Motion
from tests.support.painted_drive import (
    SMALL,
    PaintedDrive,
    lane_lines,
    straight_road,
)

FPS = 12.5
KNOCKED_S = 3.0
TURN_RAD = np.radians(3.0)
AHEAD_M = np.array([5.0, 10.0, 15.0, 20.0, 30.0])
POSE = SMALL.require_pose()
BEFORE = PaintedDrive(
    straight_road(),
    lane_lines(),
    motion=Motion(60.0, 25.0, offset_m=0.3, wander_m=0.25, pitch_rad=0.004),
    camera=SMALL,
)
TURNED = SMALL.with_pose(replace(POSE, yaw_rad=POSE.yaw_rad + TURN_RAD))
AFTER = replace(BEFORE, camera=TURNED)
SETTLED = TurnedCamera(settled_s=5.0)


def follow(turned_s: tuple[float, float], end_s: float) -> list[tuple]:
    """Time, lane, largest error of a line (m) and yaw of the pose of each frame.

    The camera is turned between two times.
    """
    tracker = LaneTracker(SMALL, fps=FPS)
    frames = []
    for time_s in np.arange(round(end_s * FPS)) / FPS:
        is_turned = turned_s[0] <= time_s < turned_s[1]
        drive = AFTER if is_turned else BEFORE
        tracker.update(drive.frame(time_s))
        lane = tracker.tracked_lane
        truth = drive.truth(time_s)
        true_m = np.array([truth.line_y(side, AHEAD_M) for side in (0, 1)])
        error_m = np.inf
        if lane is not None:
            squares = (lane.lateral_m(AHEAD_M) - true_m) ** 2
            error_m = np.sqrt(squares.mean(axis=1)).max()
        yaw_rad = tracker.camera.require_pose().yaw_rad
        frames.append((time_s, lane, error_m, yaw_rad))
    return frames


@pytest.fixture(scope="module")
def knocked() -> list[tuple]:
    return follow((KNOCKED_S, np.inf), 8.0)


def settled(frames: list[tuple]) -> list[tuple[Lane, float]]:
    since_s = KNOCKED_S + LASTS_S + 1.5
    return [(lane, error_m) for time_s, lane, error_m, _ in frames if time_s > since_s]


def test_a_turn_that_lasts_is_that_of_the_camera(knocked):
    *_, yaw_rad = knocked[-1]
    assert yaw_rad == pytest.approx(TURNED.require_pose().yaw_rad, abs=np.radians(0.3))


def test_the_pose_changes_once(knocked):
    yaws_rad = [yaw_rad for *_, yaw_rad in knocked]
    assert np.count_nonzero(np.diff(yaws_rad)) == 1


def test_lanes_are_right_and_sure_after_it(knocked):
    assert max(error_m for _, error_m in settled(knocked)) < 0.1
    assert min(lane.confidence for lane, _ in settled(knocked)) >= SURE_CONFIDENCE


def test_few_lanes_are_sure_and_wrong_until_then(knocked):
    wrong = [lane for _, lane, error_m, _ in knocked if lane and error_m > 0.2]
    sure = [lane for lane in wrong if lane.confidence >= SURE_CONFIDENCE]
    assert wrong
    assert len(sure) <= 0.25 * FPS


def test_the_lane_has_the_camera_that_it_is_seen_with(knocked):
    _, lane, _, yaw_rad = knocked[-1]
    assert lane.camera.require_pose().yaw_rad == yaw_rad


def test_a_turn_that_passes_is_none():
    frames = follow((KNOCKED_S, KNOCKED_S + 0.7), 5.0)
    assert {yaw_rad for *_, yaw_rad in frames} == {POSE.yaw_rad}


@pytest.mark.parametrize(
    ("yaws_deg", "lasts"),
    [
        ([3.0] * 60, True),
        ([3.0] * 40, False),
        ([1.0] * 60, False),
        ([3.0, -3.0] * 30, False),
    ],
    ids=["lasting", "short", "small", "changing"],
)
def test_many_frames_must_agree(yaws_deg, lasts):
    turned = SETTLED
    for yaw_deg in yaws_deg:
        turned = turned.after(np.radians(yaw_deg), np.radians(0.2), 0.04)
    assert turned.lasts == lasts


def test_a_yaw_that_is_uncertain_is_none():
    turned = SETTLED
    for _ in range(100):
        turned = turned.after(0.05, np.radians(1.0), 0.04)
    assert not turned.lasts


def test_a_pose_that_is_wrong_from_the_beginning_is_no_turn():
    turned = TurnedCamera()
    for _ in range(100):
        turned = turned.after(0.05, np.radians(0.2), 0.04)
    assert not turned.lasts
