"""The tracker, on painted drives whose truth is known in every frame."""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import takewhile

import cv2
import numpy as np
import pytest

from lanes.detect.confidence import LEAST_CONFIDENCE, LIKELY_CONFIDENCE
from lanes.detect.lane import FOUND, Lane, Line
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
GREY_ROAD = np.full_like(BLACK, 90)
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
    followed = []
    for time_s in np.arange(int(seconds * fps)) / fps:
        lane = tracker.update(drive.frame(time_s))
        followed.append((time_s, lane, drive.truth(time_s)))
    return followed


def state_of(lane: Lane | None) -> str:
    return lane.state if lane else "lost"


def lateral_error_m(lane: Lane, truth: Truth) -> float:
    """Root mean square over 5 to 30 m of the worse line's error."""
    lines = lane.lateral_m(AT_M) - [truth.line_y(k, AT_M) for k in (0, 1)]
    return float(np.sqrt(np.mean(np.square(lines), axis=1)).max())


@pytest.fixture(scope="module")
def bends() -> list[tuple]:
    return follow(DRIVE, 8.0)


@dataclass(frozen=True, eq=False)
class Measured:
    """Offset, curvature and the lines at `AT_M`, (12, frames): found, true, and the
    stated standard deviations.
    """

    found: np.ndarray
    true: np.ndarray
    std: np.ndarray

    @property
    def error(self) -> np.ndarray:
        return self.found - self.true


def measure(frames: list[tuple]) -> Measured:
    found = []
    true = []
    std = []
    for _, lane, truth in frames:
        lines_m = lane.lateral_m(AT_M).ravel()
        true_m = np.ravel([truth.line_y(side, AT_M) for side in (0, 1)])
        std_m = lane.lateral_std_m(AT_M).ravel()
        found.append([lane.offset_m, lane.curvature_per_m, *lines_m])
        true.append([truth.offset_m, truth.curvature_per_m, *true_m])
        std.append([lane.offset_std_m, lane.curvature_std_per_m, *std_m])
    return Measured(*map(np.transpose, (found, true, std)))


@pytest.mark.slow
class TestBends:
    def test_are_tracked(self, bends):
        assert {state_of(lane) for _, lane, _ in bends} == {"tracking"}

    def test_the_offset_has_no_bias(self, bends):
        assert abs(measure(bends).error[0].mean()) < 0.02

    def test_lateral_errors_are_small(self, bends):
        errors_m = [lateral_error_m(lane, truth) for _, lane, truth in bends]
        assert np.median(errors_m) < 0.03
        assert np.percentile(errors_m, 95) < 0.10

    def test_the_curvature_has_no_bias(self, bends):
        measured = measure(bends)
        true_per_m = measured.true[1]
        bent = np.abs(true_per_m) > 1 / 1500
        outwards = measured.error[1] * np.sign(true_per_m)
        assert bent.sum() > 30
        bias = outwards[bent].mean() / np.abs(true_per_m[bent]).mean()
        assert abs(bias) < 0.03

    @pytest.mark.parametrize("number", [0, 1], ids=["offset", "curvature"])
    def test_what_is_measured_is_not_late(self, bends, number):
        """It resembles the truth of the same frame, not that of an earlier one."""
        measured = measure(bends)
        found = measured.found[number, 8:-3]
        before, now, after = (
            np.var(found - measured.true[number, 8 - lag : len(bends) - 3 - lag])
            for lag in (-1, 0, 1)
        )
        # the variance is a parabola of the lag, whose lowest point is the lag
        lag = (before - after) / (before - 2 * now + after) / 2
        assert abs(lag) < 0.5

    def test_the_speed_is_found(self, bends):
        assert bends[-1][1].motion.speed_mps == pytest.approx(25.0, abs=5.0)

    @pytest.mark.parametrize(
        "numbers",
        [slice(0, 1), slice(1, 2), slice(2, None)],
        ids=["offset", "curvature", "lines"],
    )
    def test_standard_deviations_are_honest(self, bends, dashed, numbers):
        """They are not too small, and not useless."""
        measured = measure(bends[5:] + dashed[5:])
        z = (measured.error / measured.std)[numbers]
        assert 0.1 < np.sqrt(np.mean(np.square(z))) < 1.2

    def test_standard_deviations_of_the_offset_are_small(self, bends, dashed):
        assert measure(bends[5:] + dashed[5:]).std[0].max() < 0.10

    @pytest.fixture(scope="class")
    @classmethod
    def dashed(cls) -> list[tuple]:
        """Another drive, with two dashed lines."""
        lines = lane_lines(left={"dash_m": (3.05, 12.2)})
        return follow(replace(DRIVE, lines=lines, seed=3), 6.0)


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
class TestWithoutLines:
    """Both lines are gone from 1 to 4 seconds."""

    @pytest.fixture(scope="class")
    @classmethod
    def frames(cls) -> list[tuple]:
        gone = {"gone_s": (1.0, 4.0)}
        return follow(replace(DRIVE, lines=lane_lines(left=gone, right=gone)), 5.0)

    def test_the_lane_coasts_is_lost_and_is_found_again(self, frames):
        states = {time: state_of(lane) for time, lane, _ in frames}
        lost = [state for time, state in states.items() if 3.0 <= time < 4.0]
        assert states[1.04] == "coasting"
        assert set(lost) == {"lost"}
        assert states[max(states)] == "tracking"

    def test_it_is_never_confidently_wrong(self, frames):
        for _, lane, truth in frames:
            if lane and lane.confidence >= 0.9:
                assert lateral_error_m(lane, truth) < 0.2


class TestBlackImages:
    """Those from 1.0 to 1.3 seconds are black."""

    @pytest.fixture(scope="class")
    @classmethod
    def frames(cls) -> list[tuple]:
        return follow(replace(DRIVE, black_s=(1.0, 1.3)), 2.0)

    @pytest.fixture
    def before(self, frames) -> Lane:
        return [lane for time, lane, _ in frames if time < 1.0][-1]

    @pytest.fixture
    def coasting(self, frames) -> list[Lane]:
        return [lane for time, lane, _ in frames if 1.0 <= time < 1.3]

    def test_the_lane_coasts_and_no_line_is_seen(self, coasting):
        assert {lane.state for lane in coasting} == {"coasting"}
        for lane in coasting:
            for line in lane.lines:
                assert (line.seen, line.support) == (False, 0.0)

    def test_it_is_tracked_again_after_two_frames(self, frames):
        after = [lane.state for time, lane, _ in frames if time >= 1.3]
        assert after == ["coasting"] * 2 + ["tracking"] * 6

    def test_the_lines_begin_where_they_were_seen_to_begin(self, frames):
        starts_m = [[line.start_m for line in lane.lines] for _, lane, _ in frames]
        assert (np.diff(starts_m, axis=0) <= 0).all()

    @pytest.mark.parametrize("name", ["offset_std_m", "heading_std_rad"])
    def test_standard_deviations_grow_from_frame_to_frame(self, before, coasting, name):
        """As the filter's do: by no jump in the first one."""
        stds = np.array([getattr(lane, name) for lane in [before, *coasting]])
        assert (np.diff(stds) > 0).all()
        assert stds[1] < 1.5 * stds[0]

    @pytest.mark.parametrize("side", [0, 1])
    def test_what_is_known_of_a_line_is_kept_and_comes_nearer(
        self, before, coasting, side
    ):
        line, last = coasting[-1].lines[side], before.lines[side]
        driven_m = 25.0 * len(coasting) / FPS
        reach_m = max(last.reach_m - driven_m, 0.0)
        assert (line.kind, line.colour) == (last.kind, last.colour)
        assert line.reach_m == pytest.approx(reach_m, abs=3.0)


UNCERTAIN = TrackerSettings(max_std_m=9.0, max_coast_s=0.7)
PATIENT = TrackerSettings(max_coast_s=60.0)


@pytest.mark.parametrize(
    ("fps", "settings", "least", "most"),
    [(8.0, UNCERTAIN, 13, 15), (25.0, UNCERTAIN, 13, 15), (FPS, PATIENT, 1, 99)],
)
def test_coasting_lasts_as_long_at_any_frame_rate_and_while_the_lines_are_certain(
    fps, settings, least, most
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
    assert least <= len(coasted) <= most


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


class TestLaneChange:
    """A dashed yellow line is crossed; the next one, solid and white, is new.

    The middle of the car decides, not a camera beside it.
    """

    @pytest.fixture(scope="class", params=[(1, 0.0), (-1, 0.3)], ids=["left", "right"])
    @classmethod
    def changed(cls, request) -> tuple[int, PaintedDrive, list[tuple]]:
        """The side that the car changes to, +1 for left, the drive and its frames."""
        side, camera_offset_m = request.param
        lines = (
            Stripe(side * 1.8, dash_m=(3.05, 12.2), colour=WORN_YELLOW),
            Stripe(-side * 1.8, colour=WORN_WHITE),
            Stripe(side * 5.4),
        )
        motion = Motion(
            speed_mps=25.0, shift_m=side * 3.6, shift_start_s=1.0, shift_seconds=4.0
        )
        drive = replace(
            DRIVE,
            road=straight_road(),
            lines=lines,
            motion=motion,
            camera=replace(SMALL, offset_m=camera_offset_m),
        )
        return side, drive, follow(drive, 5.6)

    @pytest.fixture
    def crossing(self, changed) -> tuple[Lane, Lane]:
        """The lane before and after it changes."""
        _, _, frames = changed
        offsets_m = np.array([lane.offset_m for _, lane, _ in frames])
        (change,) = np.flatnonzero(np.abs(np.diff(offsets_m)) > 1)
        return frames[change][1], frames[change + 1][1]

    @pytest.fixture
    def lines(self, changed, crossing) -> tuple[Line, Line, Line]:
        """The crossed line before and after, and the new one."""
        side, *_ = changed
        before, after = crossing
        if side > 0:
            return before.left, after.right, after.left
        return before.right, after.left, after.right

    def test_is_tracked(self, changed):
        _, _, frames = changed
        assert {lane.state for _, lane, _ in frames[3:]} == {"tracking"}

    def test_the_lane_is_true_before_and_behind(self, changed):
        side, drive, frames = changed
        _, first, truth = frames[10]
        time_s, last, _ = frames[-1]
        beyond_m = (5.4, 1.8) if side > 0 else (-1.8, -5.4)
        assert lateral_error_m(first, truth) < 0.1
        assert lateral_error_m(last, drive.truth(time_s, beyond_m)) < 0.1

    def test_it_changes_a_little_beyond_the_line(self, crossing):
        """A hysteresis."""
        before, _ = crossing
        half_m = before.width_m / 2
        assert half_m < abs(before.offset_m) < half_m + 0.1

    def test_the_crossed_line_stays_known(self, lines):
        old, shared, _ = lines
        assert (old.kind, old.colour) == ("dashed", "yellow")
        for name in ("kind", "colour", "double"):
            assert getattr(shared, name) == getattr(old, name)
        assert shared.seen

    def test_the_new_line_is_unknown_at_first(self, lines):
        _, _, new = lines
        assert (new.seen, new.colour, new.kind) == (False, None, None)

    def test_the_new_line_is_known_at_the_end(self, changed):
        side, _, frames = changed
        _, last, _ = frames[-1]
        line = last.left if side > 0 else last.right
        assert (line.seen, line.kind, line.colour) == (True, "solid", "white")

    def test_far_lines_are_unknown_until_the_next_search(self, crossing):
        before, after = crossing
        assert before.adjacent != (None, None)
        assert after.far_evidence == (None, None)


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
    cracks = []
    lines = []
    for side in SIDES:
        grey = {"colour": (150, 150, 150), "along_m": (-50, 60)}
        cracks.append(Stripe(side * 1.5 - 1.0, **grey))
        lines.append(Stripe(side * 1.8, along_m=(40, 2000)))
    drive = replace(DRIVE, road=straight_road(), lines=lines, ground=tuple(cracks))
    frames = follow(drive, 5.0)
    assert lateral_error_m(*frames[2][1:]) > 0.5
    assert lateral_error_m(*frames[-1][1:]) < 0.1


def test_the_inner_stripe_of_a_double_line_bounds_the_lane_from_the_first_picture_on():
    left = [Stripe(y_m, 0.10, WORN_YELLOW) for y_m in (1.7, 1.9)]
    drive = replace(
        DRIVE,
        road=straight_road(),
        lines=(*left, Stripe(-1.8)),
        lane_m=(1.7, -1.8),
        camera=CAMERA,
    )
    frames = follow(drive, 1.2)
    assert max(lateral_error_m(lane, truth) for _, lane, truth in frames) < 0.04
    first = frames[0][1]
    assert first.left.double
    assert not first.right.double
    assert first.left.colour == "yellow"


def test_where_no_lane_is_likely_for_some_time_few_frames_are_searched():
    image = cv2.resize(not_a_road("room", 2), SMALL.size)
    # an image that is repeated would be no measurement
    images = [image, cv2.add(image, (1, 1, 1, 0))]
    tracker = LaneTracker(SMALL, fps=10)
    searched = []
    likely = []
    for number in range(90):
        lane = tracker.update(images[number % 2])
        searched.append(tracker.search is not None)
        likely.append(lane is not None and lane.confidence >= LIKELY_CONFIDENCE)
    assert not any(likely)
    assert all(searched[:30])
    assert 2 <= sum(searched[-30:]) <= 15


def test_a_given_speed_is_taken_also_if_it_changes():
    tracker = LaneTracker(SMALL, fps=FPS, speed_mps=25.0)
    for speed_mps in (25.0, 21.0):
        tracker.speed_mps = speed_mps
        _, lane, _ = follow(DRIVE, 0.5, tracker=tracker)[-1]
        assert lane.motion.speed_mps == pytest.approx(speed_mps, abs=0.5)


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
    pose = replace(SMALL.pose, height_m=height_m)
    other = LaneTracker(SMALL.with_pose(pose), fps=FPS)
    other.update(DRIVE.frame(0.0))
    lane = replace(
        other.tracked_lane, state=FOUND, single_image_pose=True, same_lane_share=0.9
    )
    assert lane.confidence > 0.9
    still = StillDetection(other.evidence, other.settings.detector, lane=lane)
    tracker = LaneTracker(SMALL, fps=FPS, find_pose=lambda image: still)
    found = tracker.update(GREY_ROAD)
    assert (found is not None) == taken
    assert (tracker.camera == other.camera) == taken


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
    drive = replace(DRIVE, road=straight_road())
    _, lane, _ = follow(drive, 4.0, tracker=LaneTracker(wrong, fps=FPS))[-1]
    assert lane.camera_yaw_rad == pytest.approx(0.04, abs=0.015)
    assert lane.motion.speed_mps > 15.0


FPS_WORDS = r"fps must be a positive number; got .*\.$"
RANGE_WORDS = "speed_mps must be from 0 to 120"
NUMBER_WORDS = r"speed_mps must be a finite number; got ('fast'|inf)\.$"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"fps": 0}, FPS_WORDS),
        ({"fps": np.nan}, FPS_WORDS),
        ({"fps": "25"}, FPS_WORDS),
        ({"fps": True}, FPS_WORDS),
        ({"fps": 10**400}, FPS_WORDS),
        ({"speed_mps": -1.0}, RANGE_WORDS),
        ({"speed_mps": 1e30}, RANGE_WORDS),
        ({"speed_mps": "fast"}, NUMBER_WORDS),
        ({"speed_mps": np.inf}, NUMBER_WORDS),
    ],
)
def test_wrong_numbers_are_refused(options, words):
    with pytest.raises(LaneError, match=words):
        LaneTracker(SMALL, **options)


def test_a_time_that_is_no_number_is_refused():
    with pytest.raises(LaneError, match=r"elapsed_s must be a number; got '0.04'\.$"):
        LaneTracker(SMALL).update(DRIVE.frame(0.0), elapsed_s="0.04")


def test_numbers_of_any_kind_are_taken():
    """Frame rates of containers are fractions, clocks are NumPy numbers."""
    tracker = LaneTracker(
        SMALL, fps=Fraction(25), speed_mps=np.int64(25), confidence_shift=-1.0
    )
    lane = tracker.update(DRIVE.frame(0.0), elapsed_s=np.float32(0))
    assert (lane.motion.speed_mps, lane.confidence_shift) == (25, -1.0)


def test_a_rear_camera_is_tracked_as_it_looks():
    """The drive played backwards: left and right are those of the image."""
    tracker = LaneTracker(SMALL, fps=FPS)
    errors_m = []
    for time_s in np.arange(80)[::-1] / FPS:
        lane = tracker.update(DRIVE.frame(time_s))
        left, right = (DRIVE.truth(time_s).line_y(n, np.zeros(1))[0] for n in (0, 1))
        errors_m.append(lane.offset_m + (left + right) / 2)
        assert not lane.departure.due
    # more than forwards, because the tracker expects a road that comes nearer
    assert np.percentile(np.abs(errors_m), 95) < 0.15
    assert abs(np.mean(errors_m)) < 0.03
