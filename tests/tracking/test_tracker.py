"""The tracker, on painted drives whose truth is known in every frame."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from itertools import takewhile

import cv2
import numpy as np
import pytest

from lanes.detect.confidence import LEAST_CONFIDENCE, LIKELY_CONFIDENCE
from lanes.detect.lane import FOUND, Lane
from lanes.detect.road import SIDES
from lanes.detect.search import StillDetection
from lanes.errors import LaneError
from lanes.tracking.tracker import LaneTracker, TrackerSettings
from simulator.not_roads import not_a_road
from simulator.rendering.drive import Motion
from simulator.road.truth import Truth
from tests.support.painted_drive import (
    CAMERA,
    SMALL,
    WORN_WHITE,
    WORN_YELLOW,
    PaintedDrive,
    Stripe,
    lane_lines,
    s_bend,
    straight_road,
)

FPS = 12.5
AT_M = np.array([5.0, 10.0, 15.0, 20.0, 30.0])
BLACK = np.zeros((360, 640, 3), np.uint8)
MOTION = Motion(speed_mps=25.0, offset_m=0.2, wander_m=0.25, pitch_rad=0.003)
# A tight motorway: R 500 m to the left, then to the right.
DRIVE = PaintedDrive(s_bend(radius_m=500.0), lane_lines(), motion=MOTION, camera=SMALL)


def follow(
    drive: PaintedDrive,
    seconds: float,
    *,
    fps: float = FPS,
    tracker: LaneTracker | None = None,
) -> list[tuple]:
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


@pytest.fixture(scope="module")
def bends() -> list[tuple]:
    return follow(DRIVE, 8.0)


def measured(frames: list[tuple]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Offset, curvature and the lines at `AT_M`, (12, frames): found, true, and the
    stated standard deviations.
    """
    _, lanes, truths = zip(*frames, strict=True)
    found = [
        [lane.offset_m, lane.curvature_per_m, *lane.lateral_m(AT_M).ravel()]
        for lane in lanes
    ]
    true = [
        [t.offset_m, t.curvature_per_m, *t.line_y(0, AT_M), *t.line_y(1, AT_M)]
        for t in truths
    ]
    std = [
        [lane.offset_std_m, lane.curvature_std_per_m, *lane.lateral_std_m(AT_M).ravel()]
        for lane in lanes
    ]
    return np.transpose(found), np.transpose(true), np.transpose(std)


@pytest.mark.slow
def test_offset_and_lateral_error_in_bends(bends):
    """What is measured resembles the truth of the same frame, not that of an earlier
    one.
    """
    assert {state_of(lane) for _, lane, _ in bends} == {"tracking"}
    found, true, _ = measured(bends)
    assert abs((found - true)[0].mean()) < 0.02
    lateral = [lateral_error_m(lane, truth) for _, lane, truth in bends]
    assert np.median(lateral) < 0.03
    assert np.percentile(lateral, 95) < 0.10
    bent = np.abs(true[1]) > 1 / 1500
    bias_per_m = ((found - true)[1] * np.sign(true[1]))[bent].mean()
    assert bent.sum() > 30
    assert abs(bias_per_m / np.abs(true[1, bent]).mean()) < 0.03
    for number in (0, 1):
        late = [
            np.var(found[number, 8:-3] - true[number, 8 - lag : len(bends) - 3 - lag])
            for lag in (-1, 0, 1)
        ]
        # the variance is a parabola of the lag, whose lowest point is the lag
        assert abs((late[0] - late[2]) / (late[0] - 2 * late[1] + late[2]) / 2) < 0.5


@pytest.mark.slow
def test_standard_deviations_are_honest(bends):
    """Errors relative to the stated standard deviations, on two drives: these are not
    too small, and not useless.
    """
    other = follow(
        replace(DRIVE, lines=lane_lines(left={"dash_m": (3.05, 12.2)}), seed=3), 6.0
    )
    found, true, std = measured(bends[5:] + other[5:])
    z = (found - true) / std
    for of in (z[0], z[1], z[2:]):
        assert 0.1 < np.sqrt(np.mean(np.square(of))) < 1.2
    assert std[0].max() < 0.10


@pytest.mark.slow
@pytest.mark.parametrize(
    "gone", [{"left": {"gone_s": (1.0, 4.0)}}, {"right": {"gone_s": (1.0, 4.0)}}]
)
def test_one_line_is_enough_for_three_seconds(gone):
    frames = follow(replace(DRIVE, lines=lane_lines(**gone)), 4.4)
    assert all(lane is not None for _, lane, _ in frames)
    error_m = [lateral_error_m(lane, truth) for _, lane, truth in frames]
    assert np.mean(error_m) < 0.05
    assert max(error_m) < 0.25


@pytest.mark.slow
def test_without_lines_the_lane_is_lost_and_never_confidently_wrong():
    gone = {"gone_s": (1.0, 4.0)}
    frames = follow(replace(DRIVE, lines=lane_lines(left=gone, right=gone)), 5.0)
    states = {time: state_of(lane) for time, lane, _ in frames}
    assert states[1.04] == "coasting"
    assert all(state == "lost" for time, state in states.items() if 3.0 <= time < 4.0)
    assert states[max(states)] == "tracking"
    for _, lane, truth in frames:
        assert (
            lane is None or lane.confidence < 0.9 or lateral_error_m(lane, truth) < 0.2
        )


def test_tracking_continues_after_black_pictures():
    frames = follow(replace(DRIVE, black_s=(1.0, 1.3)), 2.0)
    coasting = [lane for time, lane, _ in frames if 1.0 <= time < 1.3]
    assert {lane.state for lane in coasting} == {"coasting"}
    assert not any(
        line.seen or line.support for lane in coasting for line in lane.lines
    )
    assert [lane.state for time, lane, _ in frames if time >= 1.3] == [
        "coasting"
    ] * 2 + ["tracking"] * 6
    assert (
        np.diff(
            [[line.start_m for line in lane.lines] for _, lane, _ in frames], axis=0
        )
        <= 0
    ).all()
    before = [lane for time, lane, _ in frames if time < 1.0][-1]
    for name in ("offset_std_m", "heading_std_rad"):
        stds = np.array([getattr(lane, name) for lane in [before, *coasting]])
        # they grow from frame to frame, as the filter's do: by no jump in the first one
        assert (np.diff(stds) > 0).all()
        assert stds[1] < 1.5 * stds[0]
    # what is known of the lines is kept, and comes nearer by 25 m/s
    for line, last in zip(coasting[-1].lines, before.lines, strict=True):
        assert (line.kind, line.colour) == (last.kind, last.colour)
        assert line.reach_m == pytest.approx(
            max(last.reach_m - 25.0 * len(coasting) / FPS, 0.0), abs=3.0
        )


@pytest.mark.parametrize(
    ("fps", "settings", "frames"),
    [
        (fps, TrackerSettings(max_std_m=9.0, max_coast_s=0.7), (13, 15))
        for fps in (8.0, 25.0)
    ]
    + [(FPS, TrackerSettings(max_coast_s=60.0), (1, 99))],
)
def test_coasting_lasts_as_long_at_any_frame_rate_and_while_the_lines_are_certain(
    fps, settings, frames
):
    """Seconds that it is told count, not frames: up to `max_coast_s`, if the lane is
    certain enough until then.
    """
    tracker = LaneTracker(SMALL, fps=fps, settings=settings)
    follow(DRIVE, 1.0, fps=fps, tracker=tracker)

    def followed() -> Lane | None:
        tracker.update(BLACK, elapsed_s=0.05)
        return tracker.tracked_lane

    coasted = list(takewhile(bool, (followed() for _ in range(100))))
    assert {lane.state for lane in coasted} == {"coasting"}
    assert frames[0] <= len(coasted) <= frames[1]


def test_the_time_that_passed_counts_and_not_the_number_of_frames():
    """Told that a tenth of a second has passed, a tracker for 11 frames a second is one
    for 10, even coasting.
    """
    usual = LaneTracker(SMALL, fps=10)
    told = LaneTracker(SMALL, fps=11)
    drive = replace(DRIVE, black_s=(1.0, 1.6))
    states = set()
    for time_s in np.arange(24) / 10:
        image = drive.frame(time_s)
        lane = usual.update(image)
        assert told.update(image, elapsed_s=0.1) == lane, time_s
        states.add(state_of(lane))
    assert {"tracking", "coasting"} <= states


@pytest.mark.parametrize(
    ("to_left", "camera_offset_m"), [(True, 0.0), (False, 0.3)], ids=["left", "right"]
)
def test_lane_change_swaps_the_lines_and_what_is_known_of_them(
    to_left, camera_offset_m
):
    """A dashed yellow line is crossed and stays known; the next one, solid and white,
    is new.

    The middle of the car decides, not a camera beside it.
    """
    side = 1 if to_left else -1
    crossed = {"dash_m": (3.05, 12.2), "colour": WORN_YELLOW}
    lines = (
        Stripe(side * 1.8, **crossed),
        Stripe(-side * 1.8, colour=WORN_WHITE),
        Stripe(side * 5.4),
    )
    motion = Motion(
        speed_mps=25.0, shift_m=side * 3.6, shift_start_s=1.0, shift_seconds=4.0
    )
    camera = replace(SMALL, offset_m=camera_offset_m)
    drive = replace(
        DRIVE, road=straight_road(), lines=lines, motion=motion, camera=camera
    )
    frames = follow(drive, 5.6)
    assert {lane.state for _, lane, _ in frames[3:]} == {"tracking"}
    assert lateral_error_m(*frames[10][1:]) < 0.1
    beyond = (5.4, 1.8) if to_left else (-1.8, -5.4)
    assert lateral_error_m(frames[-1][1], drive.truth(frames[-1][0], beyond)) < 0.1
    offsets = np.array([lane.offset_m for _, lane, _ in frames])
    (change,) = np.flatnonzero(np.abs(np.diff(offsets)) > 1)
    before = frames[change][1]
    after = frames[change + 1][1]
    # a hysteresis
    assert before.width_m / 2 < abs(before.offset_m) < before.width_m / 2 + 0.1
    old, shared, new = (
        (before.left, after.right, after.left)
        if to_left
        else (before.right, after.left, after.right)
    )
    assert (shared.kind, shared.colour, shared.double) == (
        old.kind,
        old.colour,
        old.double,
    )
    assert (shared.kind, shared.colour) == ("dashed", "yellow")
    assert shared.seen
    assert not new.seen
    assert new.colour is None
    assert new.kind is None
    # unknown until the next search
    assert before.adjacent != after.far_evidence == (None, None)
    last = frames[-1][1].left if to_left else frames[-1][1].right
    assert last.seen
    assert (last.kind, last.colour) == ("solid", "white")


def test_a_track_begins_as_uncertain_as_its_correlated_stripes_make_it():
    tracker = LaneTracker(SMALL, fps=FPS)
    lane = tracker.update(DRIVE.frame(0.0))
    inflation = TrackerSettings().detector.fit.variance_inflation
    np.testing.assert_allclose(
        lane.fit_covariance, inflation * tracker.search.fit.covariance[0]
    )


def test_a_wrong_track_is_given_up():
    """Two stripes a lane apart, 1.2 m beside the lane, hold the tracker only until the
    true lines come.
    """
    cracks = tuple(
        Stripe(side * 1.5 - 1.0, colour=(150, 150, 150), along_m=(-50, 60))
        for side in SIDES
    )
    lines = tuple(Stripe(side * 1.8, along_m=(40, 2000)) for side in SIDES)
    frames = follow(
        replace(DRIVE, road=straight_road(), lines=lines, ground=cracks), 5.0
    )
    assert lateral_error_m(*frames[2][1:]) > 0.5
    assert lateral_error_m(*frames[-1][1:]) < 0.1


def test_the_inner_stripe_of_a_double_line_bounds_the_lane_from_the_first_picture_on():
    lines = (*(Stripe(y, 0.10, WORN_YELLOW) for y in (1.7, 1.9)), Stripe(-1.8))
    drive = replace(
        DRIVE, road=straight_road(), lines=lines, lane_m=(1.7, -1.8), camera=CAMERA
    )
    frames = follow(drive, 1.2)
    assert max(lateral_error_m(lane, truth) for _, lane, truth in frames) < 0.04
    first = frames[0][1]
    assert first.left.double
    assert not first.right.double
    assert first.left.colour == "yellow"


def test_where_no_lane_is_likely_for_some_time_few_frames_are_searched():
    image = cv2.resize(not_a_road("room", 2), SMALL.size)
    tracker = LaneTracker(SMALL, fps=10)
    searched = []
    likely = []
    for _ in range(90):
        lane = tracker.update(image)
        searched.append(tracker.search is not None)
        likely.append(lane is not None and lane.confidence >= LIKELY_CONFIDENCE)
    assert not any(likely)
    assert all(searched[:30])
    assert 2 <= sum(searched[-30:]) <= 15


def test_speed_is_found_or_taken(bends):
    assert bends[-1][1].motion.speed_mps == pytest.approx(25.0, abs=5.0)
    tracker = LaneTracker(SMALL, fps=FPS, speed_mps=25.0)
    assert follow(DRIVE, 0.5, tracker=tracker)[-1][1].motion.speed_mps == pytest.approx(
        25.0, abs=0.5
    )
    tracker.speed_mps = 21.0
    assert follow(DRIVE, 0.3, tracker=tracker)[-1][1].motion.speed_mps == pytest.approx(
        21.0
    )


@pytest.mark.parametrize("elapsed_s", [1.0, 1.01, 1e9, -0.04, np.nan, np.inf])
def test_a_jump_of_the_clock_resets_the_tracker(elapsed_s):
    """After a gap too long to bridge, and when the clock was set back, the picture is
    looked at like a first one.
    """
    tracker = LaneTracker(SMALL, fps=FPS)
    follow(DRIVE, 0.4, tracker=tracker)
    again = tracker.update(DRIVE.frame(0.0), elapsed_s=elapsed_s)
    first = LaneTracker(SMALL).update(DRIVE.frame(0.0))
    assert np.array_equal(again.model, first.model) == (elapsed_s != 1.0)


@pytest.mark.parametrize("elapsed_s", [-5.0, np.nan, np.inf])
def test_a_jump_of_the_clock_does_not_stop_what_is_done_twice_a_second(elapsed_s):
    asked: list[int] = []
    settings = TrackerSettings(slowest=1.0)
    tracker = LaneTracker(
        SMALL, fps=10, find_pose=lambda image: asked.append(1), settings=settings
    )
    tracker.update(BLACK)
    tracker.update(BLACK, elapsed_s=elapsed_s)
    before = len(asked)
    for _ in range(32):  # two seconds
        tracker.update(BLACK, elapsed_s=1 / 16)
    assert len(asked) - before == 4


@pytest.mark.parametrize(
    ("height_m", "taken"), [(SMALL.pose.height_m, True), (0.85, False)]
)
def test_another_pose_is_taken_only_if_the_track_calls_its_lane_likely(height_m, taken):
    """With a pose of the same image a width of 2.4 m is not odd, because the height is
    uncertain.
    """
    other = LaneTracker(
        SMALL.with_pose(replace(SMALL.pose, height_m=height_m)), fps=FPS
    )
    other.update(DRIVE.frame(0.0))
    lane = replace(other.tracked_lane, state=FOUND, same_lane_share=0.9)
    assert lane.confidence > 0.9
    assert other.evidence
    tracker = LaneTracker(
        SMALL,
        fps=FPS,
        find_pose=lambda image: StillDetection(
            other.evidence, other.settings.detector, lane=lane
        ),
    )
    found = tracker.update(np.full_like(DRIVE.frame(0.0), 90))
    assert (found is not None) == taken
    assert (tracker.camera == other.camera) == taken


GREY_ROAD = np.full_like(BLACK, 90)


def test_what_never_moves_is_still_known_with_another_pose():
    """An image without lines, of which a search for the pose says that it has a lane."""
    pose = replace(SMALL.pose, yaw_rad=0.01)
    other = LaneTracker(SMALL.with_pose(pose), fps=FPS)
    other.update(DRIVE.frame(0.0))
    lane = replace(other.tracked_lane, state=FOUND, confidence_shift=9.0)
    still = StillDetection(other.evidence, other.settings.detector, lane=lane)
    tracker = LaneTracker(SMALL, fps=2, find_pose=lambda image: still)
    tracker._static._samples[:] = 7.0
    tracker.update(GREY_ROAD)
    assert tracker.camera == other.camera
    assert np.median(tracker._static._samples) == 7.0


@pytest.fixture(scope="module")
def unlikely() -> LaneTracker:
    """A tracker that follows a lane with a confidence of 0."""
    tracker = LaneTracker(SMALL, fps=FPS, confidence_shift=-30.0)
    follow(DRIVE, 0.5, tracker=tracker)
    return tracker


def test_a_lane_below_the_least_confidence_is_none(unlikely):
    assert unlikely.tracked_lane.confidence < LEAST_CONFIDENCE
    assert unlikely.update(DRIVE.frame(0.5)) is None
    assert unlikely.lane is None


def test_a_lane_that_is_not_stated_is_followed_nevertheless(unlikely):
    assert lateral_error_m(unlikely.tracked_lane, DRIVE.truth(0.5)) < 0.2


def test_a_wrong_yaw_of_the_pose_is_not_taken_for_a_car_that_hardly_moves():
    wrong = SMALL.with_pose(replace(SMALL.pose, yaw_rad=SMALL.pose.yaw_rad + 0.04))
    *_, (_, lane, _) = follow(
        replace(DRIVE, road=straight_road()), 4.0, tracker=LaneTracker(wrong, fps=FPS)
    )
    assert lane.camera_yaw_rad == pytest.approx(0.04, abs=0.015)
    assert lane.motion.speed_mps > 15.0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        *(
            ({"fps": wrong}, r"fps must be a positive number; got .*\.$")
            for wrong in (0, np.nan, "25", True, 10**400)
        ),
        *(
            ({"speed_mps": wrong}, "speed_mps must be from 0 to 120")
            for wrong in (-1.0, 1e30)
        ),
        ({"speed_mps": "fast"}, r"speed_mps must be a finite number; got 'fast'\.$"),
        ({"speed_mps": np.inf}, r"speed_mps must be a finite number; got inf\.$"),
    ],
)
def test_wrong_numbers_are_refused_and_those_of_any_kind_taken(options, words):
    with pytest.raises(LaneError, match=words):
        LaneTracker(SMALL, **options)
    with pytest.raises(LaneError, match=r"elapsed_s must be a number; got '0.04'\.$"):
        LaneTracker(SMALL).update(DRIVE.frame(0.0), elapsed_s="0.04")
    # frame rates of containers are fractions, clocks are NumPy numbers
    tracker = LaneTracker(
        SMALL, fps=Fraction(25), speed_mps=np.int64(25), confidence_shift=-1.0
    )
    lane = tracker.update(DRIVE.frame(0.0), elapsed_s=np.float32(0))
    assert (lane.motion.speed_mps, lane.confidence_shift) == (25, -1.0)
