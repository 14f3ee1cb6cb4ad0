"""The tracker, on painted drives whose truth is known in every frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from functools import lru_cache

import numpy as np
import pytest

from lanes.detect.lane import Lane
from lanes.detect.road import SIDES
from lanes.detect.search import DetectorSettings
from lanes.errors import CameraError, LaneError, PictureError
from lanes.track.filter import FilterSettings
from lanes.track.tracker import LaneTracker, TrackerSettings
from simulator.rendering.drive import Motion
from simulator.road.truth import Truth
from tests.support.painted_drive import (
    CAMERA,
    WORN_WHITE,
    WORN_YELLOW,
    PaintedDrive,
    Stripe,
    lane_lines,
    s_bend,
    straight_road,
)

SMALL = CAMERA.scaled((640, 360))
FPS = 12.5
AT_M = np.array([5.0, 10.0, 15.0, 20.0, 30.0])
MOTION = Motion(speed_mps=25.0, offset_m=0.2, wander_m=0.25, pitch_rad=0.003)
# A tight motorway: R 500 m to the left, then to the right.
DRIVE = PaintedDrive(s_bend(radius_m=500.0), lane_lines(), motion=MOTION, camera=SMALL)


def follow(drive: PaintedDrive, seconds: float, *, fps: float = FPS, tracker: LaneTracker | None = None) -> list[tuple]:
    """(time, lane, truth) of every frame."""
    tracker = tracker or LaneTracker(drive.camera, fps=fps)
    times = np.arange(int(seconds * fps)) / fps
    return [(t, tracker.update(drive.frame(t)), drive.truth(t)) for t in times]


def state_of(lane: Lane | None) -> str:
    return lane.state if lane else "lost"


def lateral_error_m(lane: Lane, truth: Truth) -> float:
    """Root mean square over 5 to 30 m of the worse line's error."""
    lines = lane.lateral_m(AT_M) - [truth.line_y(k, AT_M) for k in (0, 1)]
    return float(np.sqrt(np.mean(np.square(lines), axis=1)).max())


@lru_cache(maxsize=4)
def s_bend_drive(speed_mps: float | None = None, fps: float = FPS) -> list[tuple]:
    return follow(DRIVE, 8.0, fps=fps, tracker=LaneTracker(SMALL, fps=fps, speed_mps=speed_mps))


def errors(frames: list[tuple], measure: Callable) -> np.ndarray:
    return np.array([measure(lane) - measure(truth) for _, lane, truth in frames])


@pytest.mark.slow
def test_tracks_from_the_third_frame_on():
    states = [state_of(lane) for _, lane, _ in s_bend_drive()]
    assert states[:2] == ["searching", "searching"]
    assert set(states[3:]) == {"tracking"}


@pytest.mark.slow
def test_offset_and_lateral_error_in_bends():
    offset = errors(s_bend_drive(), lambda r: r.offset_m)
    assert abs(offset.mean()) < 0.02
    lateral = [lateral_error_m(tracked, truth) for _, tracked, truth in s_bend_drive()]
    assert np.median(lateral) < 0.03
    assert np.percentile(lateral, 95) < 0.10


def test_curvature_is_unbiased():
    true = np.array([truth.curvature_per_m for *_, truth in s_bend_drive()])
    error = errors(s_bend_drive(), lambda r: r.curvature_per_m)
    bent = np.abs(true) > 1 / 1500
    assert bent.sum() > 30
    assert abs((error[bent] * np.sign(true[bent])).mean() / np.abs(true[bent]).mean()) < 0.03


@pytest.mark.slow
@pytest.mark.parametrize("measure", [lambda r: r.curvature_per_m, lambda r: r.offset_m], ids=["curvature", "offset"])
@pytest.mark.parametrize(("speed_mps", "most_frames"), [(None, 0.5), (25.0, 0.3)])
def test_nothing_lags_in_s_bends(measure, speed_mps, most_frames):
    """What is measured resembles the truth of the same frame, not that of an earlier one."""
    frames = s_bend_drive(speed_mps)
    found = np.array([measure(tracked.lane) for _, tracked, _ in frames])[8:-3]
    true = np.array([measure(truth) for *_, truth in frames])
    late = [np.var(found - true[8 - lag : len(true) - 3 - lag]) for lag in (-1, 0, 1)]
    # the variance is a parabola of the lag, whose lowest point is the lag
    lag = (late[0] - late[2]) / (late[0] - 2 * late[1] + late[2]) / 2
    assert abs(lag) < most_frames


@pytest.mark.slow
def test_standard_deviations_are_honest():
    """Neither too small nor useless: errors relative to the stated standard deviations, on two drives."""
    other = follow(replace(DRIVE, lines=lane_lines(left={"dash_m": (3.05, 12.2)}), seed=3), 6.0)
    frames = s_bend_drive()[5:] + other[5:]
    z_offset = [(lane.offset_m - truth.offset_m) / lane.offset_std_m for _, lane, truth in frames]
    z_curvature = [(lane.curvature_per_m - truth.curvature_per_m) / lane.curvature_std_per_m for _, lane, truth in frames]
    z_lines = [(lane.lateral_m(AT_M) - [truth.line_y(k, AT_M) for k in (0, 1)]) / lane.lateral_std_m(AT_M) for _, lane, truth in frames]
    print([float(np.sqrt(np.mean(np.square(z)))) for z in (z_offset, z_curvature, z_lines)])
    for z in (z_offset, z_curvature, z_lines):
        assert 0.2 < np.sqrt(np.mean(np.square(z))) < 1.5
    assert max(lane.offset_std_m for _, lane, _ in frames) < 0.10


@pytest.mark.slow
@pytest.mark.parametrize("gone", [{"left": {"gone_s": (1.0, 4.0)}}, {"right": {"gone_s": (1.0, 4.0)}}])
def test_one_line_is_enough_for_three_seconds(gone):
    frames = follow(replace(DRIVE, lines=lane_lines(**gone)), 4.4)
    assert all(lane is not None for _, tracked, _ in frames)
    off_m = [lateral_error_m(tracked, truth) for _, tracked, truth in frames]
    assert np.mean(off_m) < 0.05 and max(off_m) < 0.25


@pytest.mark.slow
def test_no_line_is_lost_and_never_confidently_wrong():
    gone = {"gone_s": (1.0, 4.0)}
    frames = follow(replace(DRIVE, lines=lane_lines(left=gone, right=gone)), 5.0)
    states = {time: tracked.state for time, tracked, _ in frames}
    assert states[1.04] == "coasting"
    assert all(state == "lost" for time, state in states.items() if 3.0 <= time < 4.0)
    assert states[max(states)] == "tracking"
    for _, tracked, truth in frames:
        assert tracked.confidence < 0.9 or lateral_error_m(tracked, truth) < 0.2
        assert (tracked.lane is None) == (tracked.state == "lost") == (tracked.as_row()["offset_m"] is None)


def test_tracking_continues_after_black_pictures():
    frames = follow(replace(DRIVE, black_s=(1.0, 1.3)), 2.0)
    states = [tracked.state for time, tracked, _ in frames if 1.0 <= time < 1.3]
    assert set(states) == {"coasting"}
    assert frames[-1][1].state == "tracking"
    stds = [tracked.lane.offset_std_m for time, tracked, _ in frames if 0.9 <= time < 1.3]
    assert np.all(np.diff(stds) > 0)


def test_tracking_continues_after_dropped_and_repeated_pictures():
    tracker = LaneTracker(SMALL, fps=FPS)
    for time in np.arange(0, 1, 1 / FPS):
        tracker.update(DRIVE.frame(time))
    tracked = tracker.update(DRIVE.frame(1.5), elapsed_s=0.5)
    assert tracked.state == "tracking"
    assert lateral_error_m(tracked, DRIVE.truth(1.5)) < 0.1
    for _ in range(3):
        tracked = tracker.update(DRIVE.frame(1.5))
    assert lateral_error_m(tracked, DRIVE.truth(1.5)) < 0.1


def test_lane_change_relabels_the_lines():
    """The car drifts one lane to the right: the same paint becomes the left line, and tracking never stops."""
    drive = replace(DRIVE, road=straight_road(), drift_mps=-0.9, drift_s=(1.0, 5.0), motion=Motion(speed_mps=25.0))
    drive = replace(drive, lines=(*drive.lines, Stripe(-5.4)))
    frames = follow(drive, 5.6)
    assert {tracked.state for _, tracked, _ in frames[3:]} == {"tracking"}
    assert lateral_error_m(frames[10][1], frames[10][2]) < 0.1
    assert lateral_error_m(frames[-1][1], drive.truth(frames[-1][0], (-1.8, -5.4))) < 0.1
    jumps = [abs(a[1].lane.offset_m - b[1].lane.offset_m) for a, b in zip(frames, frames[1:], strict=False)]
    assert sum(jump > 1 for jump in jumps) == 1


def test_departure_is_predicted():
    drive = replace(DRIVE, road=straight_road(), drift_mps=0.7, drift_s=(1.0, 4.0), motion=Motion(speed_mps=25.0))
    frames = follow(drive, 3.2, tracker=LaneTracker(SMALL, fps=FPS, speed_mps=25.0))
    warned = [time for time, tracked, _ in frames if tracked.warning.due]
    # the tyres, 0.9 m from the middle, touch the line's middle when the car is 0.9 m to the left
    crossing = next(time for time, _, truth in frames if truth.offset_m > 0.9)
    assert 0.3 < crossing - warned[0] < 1.6
    assert {tracked.warning.side for time, tracked, _ in frames if time in warned} == {"left"}
    assert all(not tracked.warning.due for time, tracked, _ in frames if time < 1.0)


def test_a_wrong_track_is_given_up():
    """Two stripes a lane apart, 1.2 m beside the lane, hold the tracker only until the true lines come."""
    cracks = tuple(Stripe(side * 1.5 - 1.0, colour=(150, 150, 150), along_m=(-50, 60)) for side in SIDES)
    lines = tuple(Stripe(side * 1.8, along_m=(40, 2000)) for side in SIDES)
    frames = follow(replace(DRIVE, road=straight_road(), lines=lines, ground=cracks), 5.0)
    assert lateral_error_m(frames[2][1], frames[2][2]) > 0.5
    assert lateral_error_m(frames[-1][1], frames[-1][2]) < 0.1


@pytest.mark.parametrize(
    ("doubt", "seconds", "searches"),
    [
        ({"score": 0.9}, 6.0, 1),
        ({"explained_share": 0.05}, 6.0, 6),
        ({"explained_share": 0.01}, 1.04, 12),
        ({"score": 0.4}, 1.04, 12),
    ],
)
def test_a_doubtful_track_is_searched_more_often(monkeypatch, doubt, seconds, searches):
    """One that is not sure, because of clutter, each second; in every frame with little confidence or support."""
    tracker, calls = LaneTracker(SMALL, fps=FPS), []
    follow(DRIVE, 1.0, tracker=tracker)

    def scored(*args, **options):
        track = update.update_track(*args, **options)
        return replace(track, lane=replace(track.lane, **doubt))

    def searched(evidence):
        calls.append(evidence)
        return search_lane(evidence)

    monkeypatch.setattr(tracker_module, "update_track", scored)
    monkeypatch.setattr(tracker_module, "search_lane", searched)
    follow(DRIVE, seconds, tracker=tracker)
    assert len(calls) == pytest.approx(searches, abs=1)


def test_a_much_more_probable_lane_replaces_a_track_with_as_much_paint():
    """Two lines 4.9 m apart, as at the end of a ramp. Then the usual lane is found, but its score is smaller."""
    ramp = tuple(Stripe(side * 2.45) for side in SIDES)
    tracker = LaneTracker(SMALL, fps=FPS)
    follow(replace(DRIVE, road=straight_road(), lines=ramp), 1.0, tracker=tracker)
    wide, usual = tracker.update(DRIVE.frame(0.0)).lane, s_bend_drive()[-1][1].lane
    found = replace(usual, score=wide.score - 0.1, camera_yaw_rad=None)
    assert wide.width_m > 4.7 and tracker_module._is_rival(found, wide, by_paint=True)
    doubtful = replace(found, explained_share=0.001)
    assert not any(tracker_module._is_rival(lane, usual, by_paint=True) for lane in (doubtful, found))


@pytest.mark.slow
@pytest.mark.parametrize("wrong_deg", [-2.5, 0.0, 2.5])
def test_a_wrong_yaw_of_the_pose_is_estimated(wrong_deg):
    """The car keeps its distance from the lines, although it seems to drive towards one of them."""
    pose = SMALL.require_pose()
    wrong = SMALL.with_pose(replace(pose, yaw_rad=pose.yaw_rad + np.radians(wrong_deg)))
    tracked = follow(DRIVE, 4.0, tracker=LaneTracker(wrong, fps=FPS))[-1][1]
    assert np.degrees(tracked.lane.camera_yaw_rad) == pytest.approx(wrong_deg, abs=0.4)
    assert (tracked.confidence > 0.9) == (wrong_deg == 0.0)


def test_lanes_are_the_same_within_three_standard_deviations_and_15_to_30_cm():
    _, tracked, _ = s_bend_drive()[-1]
    for std_m, tolerance_m in ((0.01, 0.15), (0.08, 0.24), (0.5, 0.3)):
        covariance = np.zeros((PARAMETERS, PARAMETERS))
        covariance[CENTRE, CENTRE] = std_m**2
        known = replace(tracked.lane, assumed_covariance=covariance)
        for moved_m in (-tolerance_m, tolerance_m):
            nearer, farther = (
                replace(known, model=known.model + share * moved_m * np.eye(PARAMETERS)[CENTRE])
                for share in (0.95, 1.1)
            )
            assert same_lane(nearer, known) and not same_lane(farther, known)


def test_marking_types():
    kinds = s_bend_drive()[-1][1].marking_types
    assert (kinds[0].colour, kinds[0].pattern, kinds[0].double) == ("yellow", "solid", False)
    assert (kinds[1].colour, kinds[1].pattern, kinds[1].double) == ("white", "dashed", False)


def test_the_inner_stripe_of_a_double_line_bounds_the_lane_from_the_first_picture_on():
    lines = (*(Stripe(y, 0.10, WORN_YELLOW) for y in (1.7, 1.9)), Stripe(-1.8))
    drive = replace(DRIVE, road=straight_road(), lines=lines, lane_m=(1.7, -1.8), camera=CAMERA)
    frames = follow(drive, 1.2)
    assert max(lateral_error_m(tracked, truth) for _, tracked, truth in frames) < 0.04
    assert frames[0][1].marking_types[0].double and not frames[0][1].marking_types[1].double


def test_speed_is_found_or_taken():
    assert s_bend_drive()[-1][1].motion.speed_mps == pytest.approx(25.0, abs=5.0)
    assert s_bend_drive(25.0)[-1][1].motion.speed_mps == pytest.approx(25.0, abs=0.5)


def test_reset_forgets():
    tracker = LaneTracker(SMALL, fps=FPS)
    first = tracker.update(DRIVE.frame(0.0))
    tracker.update(DRIVE.frame(0.08))
    tracker.reset()
    again = tracker.update(DRIVE.frame(0.0))
    np.testing.assert_array_equal(again.lane.model, first.lane.model)
    assert again.state == "searching"


@pytest.mark.parametrize("elapsed_s", [1.5, 1e9, -0.04, np.nan])
def test_a_jump_of_the_clock_resets_the_tracker(elapsed_s):
    """After a gap too long to bridge, and when the clock was set back, the picture is looked at like a first one."""
    tracker = LaneTracker(SMALL, fps=FPS)
    for time in np.arange(0, 0.4, 1 / FPS):
        tracker.update(DRIVE.frame(time))
    again, first = tracker.update(DRIVE.frame(0.0), elapsed_s=elapsed_s), LaneTracker(SMALL).update(DRIVE.frame(0.0))
    np.testing.assert_array_equal(again.lane.model, first.lane.model)
    assert again.state == "searching"


def test_invalid_arguments_raise():
    with pytest.raises(ValueError, match="fps=0"):
        LaneTracker(SMALL, fps=0)
    with pytest.raises(PictureError, match="calibrated for 640x360"):
        LaneTracker(SMALL).update(np.zeros((720, 1280, 3), np.uint8))
