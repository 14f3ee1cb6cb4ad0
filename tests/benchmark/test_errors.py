"""Lanes made by hand against truths made by hand, for each rule of the scores."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from benchmark.errors import FrameErrors, LaneTruth, frame_errors, recovery_lengths
from benchmark.estimates import (
    AHEAD_M,
    ALONG_M,
    DriveEstimates,
    read_estimates,
    road_points,
    write_estimates,
)
from benchmark.scores import Result, Row, score, score_rows
from benchmark.tables import describe_failures, failure_spans
from simulator.road.geometry import (
    RoadGeometry,
    VehiclePose,
    line_lateral,
    line_polynomial,
)

N = 5
WIDTH = 3.6
# The lines of these tests have directions up to 0.07 rad; an error perpendicular to
# them is smaller by half its square.
SLANT = 2.5e-3
LEFT = 0
RIGHT = 1


def truth(
    offset_m: float = 0.25,
    curvature_per_m: float = 0.002,
    heading_rad: float = 0.01,
    *,
    frames: int = N,
) -> LaneTruth:
    """Frames of a lane that bends left; the car is left of its centre."""
    bend_m = np.tan(heading_rad) * AHEAD_M + curvature_per_m * AHEAD_M**2 / 2
    at_car_m = np.array([WIDTH / 2, -WIDTH / 2]) - offset_m
    return LaneTruth(
        lines_y_m=np.array([at_car_m[:, None] + bend_m] * frames),
        at_car_y_m=np.array([at_car_m] * frames),
        offset_m=np.full(frames, offset_m),
        heading_rad=np.full(frames, heading_rad),
        curvature_per_m=np.full(frames, curvature_per_m),
        width_m=np.full(frames, WIDTH),
    )


NO_LANE = replace(truth(), lines_y_m=np.full((N, 2, len(AHEAD_M)), np.nan))


def lines_through(lateral_m: np.ndarray) -> np.ndarray:
    """Lines (2, P, 2) with the lateral positions (2, D) at AHEAD_M.

    They are straight from one position to the next and beyond.
    """
    lines = [np.interp(ALONG_M, AHEAD_M, line) for line in lateral_m]
    return road_points(ALONG_M, np.array(lines))


def perfect(lane: LaneTruth, confidence: float = 0.99) -> DriveEstimates:
    """Estimates without error."""
    frames = []
    for frame, lateral_m in enumerate(lane.lines_y_m):
        estimate = {
            "lines_m": lines_through(lateral_m),
            "offset_m": lane.offset_m[frame],
            "heading_rad": lane.heading_rad[frame],
            "curvature_per_m": lane.curvature_per_m[frame],
            "confidence": confidence,
        }
        frames.append(estimate)
    return DriveEstimates.from_frames(frames, [7.0] * len(frames))


def shifted(estimates: DriveEstimates, shift_m: np.ndarray | float) -> DriveEstimates:
    """The same lane, both lines shifted to the left."""
    shift_m = np.broadcast_to(shift_m, N)
    lines_m = estimates.lines_m + shift_m[:, None, None, None] * [0.0, 1.0]
    return replace(estimates, lines_m=lines_m, offset_m=estimates.offset_m - shift_m)


def row_of(estimates: DriveEstimates, lane: LaneTruth | None = None) -> Row:
    """The scores of estimates of a lane, by default that of `truth`."""
    return score([frame_errors(estimates, lane or truth())])


def test_the_truth_is_available_and_correct():
    row = row_of(perfect(truth()))
    assert row["available_share"] == 1
    assert row["accuracy"] == 1
    assert row["confident_and_wrong_share"] == 0
    assert row["recovery_longest_frames"] == 0


def test_the_truth_has_no_error():
    row = row_of(perfect(truth()))
    errors = [row[name] for name in row if name.endswith(("_m", "_rad"))]
    assert errors == pytest.approx([0] * 14)


def test_the_time_is_the_median_of_the_frames():
    assert row_of(perfect(truth()))["time_median_ms"] == 7


def test_percentiles_are_those_of_all_drives():
    """The 95th percentile of 20 drives is the 19th."""
    errors = frame_errors(perfect(truth()), truth())
    drives = [replace(errors, offset_m=np.full(N, float(k))) for k in range(1, 21)]
    row = score(drives)
    assert row["offset_median_m"] == 10
    assert row["offset_p95_m"] == 19


@pytest.mark.parametrize("part", ["median", "p95"])
@pytest.mark.parametrize(
    "place", ["lateral_5m", "lateral_15m", "lateral_30m", "lateral_5_20m", "offset"]
)
def test_a_shifted_lane_has_the_shift_as_error(place, part):
    row = row_of(shifted(perfect(truth()), -0.15))
    assert row[f"{place}_{part}_m"] == pytest.approx(0.15, rel=SLANT)


def test_a_shifted_lane_has_no_error_of_the_direction():
    row = row_of(shifted(perfect(truth()), -0.15))
    assert row["heading_p95_rad"] == 0
    assert row["curvature_p95_per_m"] == 0


@pytest.mark.parametrize(("shift_m", "accuracy"), [(-0.15, 1), (0.21, 0)])
def test_a_lane_is_correct_within_20_cm(shift_m, accuracy):
    assert row_of(shifted(perfect(truth()), shift_m))["accuracy"] == accuracy


class TestHairpin:
    """The estimated lines are circles 10 cm inside the true ones."""

    CENTRE_M = 22.0
    RADII_M = np.array([20.4, 23.6])

    def lane(self) -> LaneTruth:
        squared_m2 = self.RADII_M[:, None] ** 2 - AHEAD_M**2
        lines_y_m = self.CENTRE_M - np.sqrt(np.maximum(squared_m2, 0))
        lines_y_m[:, AHEAD_M > 20] = np.nan
        return LaneTruth(
            lines_y_m=lines_y_m[None],
            at_car_y_m=(self.CENTRE_M - self.RADII_M)[None],
            offset_m=np.array([0.0]),
            heading_rad=np.array([0.0]),
            curvature_per_m=np.array([1 / self.CENTRE_M]),
            width_m=np.array([np.ptp(self.RADII_M)]),
        )

    def errors(self) -> FrameErrors:
        angle_rad = ALONG_M / self.CENTRE_M
        radii_m = self.RADII_M - 0.1
        x_m = np.outer(radii_m, np.sin(angle_rad))
        y_m = self.CENTRE_M - np.outer(radii_m, np.cos(angle_rad))
        estimate = {
            "lines_m": np.stack([x_m, y_m], axis=-1),
            "offset_m": 0.0,
            "heading_rad": 0.0,
            "curvature_per_m": 1 / self.CENTRE_M,
            "confidence": 0.9,
        }
        return frame_errors(DriveEstimates.from_frames([estimate], [1.0]), self.lane())

    def test_lines_are_compared_up_to_60_degrees(self):
        assert self.lane().compared[0].sum(axis=1).tolist() == [3, 4]
        assert np.isnan(self.errors().lateral_m[0, AHEAD_M > 20]).all()

    def test_errors_are_perpendicular_to_the_line(self):
        errors = self.errors()
        assert errors.lateral_m[0, AHEAD_M <= 20] == pytest.approx(0.1, rel=0.02)
        assert errors.near_rms_m[0] == pytest.approx(0.1, rel=0.02)


def test_frames_without_an_estimate_stand_beside_others():
    """As a finder gives them: empty where it found no lane."""
    lane = truth()
    found = perfect(lane)
    frames: list[dict] = [{}, {}]
    for number in range(2, N):
        frames.append(
            {
                "lines_m": found.lines_m[number],
                "offset_m": 0.25,
                "heading_rad": 0.01,
                "curvature_per_m": 0.002,
                "confidence": 0.95,
            }
        )
    row = row_of(DriveEstimates.from_frames(frames, [1.0] * N), lane)
    assert row["available_share"] == 0.6
    assert row["accuracy"] == 0.6
    assert row["lateral_5_20m_p95_m"] == 0
    assert row["recovery_longest_frames"] == 2


class TestWorseLine:
    """The right line is wrong everywhere, 30 m ahead, 20 m ahead, and nowhere."""

    @pytest.fixture
    def errors(self) -> FrameErrors:
        estimates = perfect(truth())
        right_y_m = estimates.lines_m[:, RIGHT, :, 1]
        right_y_m[0] += 0.3
        right_y_m[1, np.abs(ALONG_M - 30.0) <= 1.0] += 1.0
        right_y_m[2, np.abs(ALONG_M - 20.0) <= 1.0] -= 0.5
        return frame_errors(estimates, truth())

    def test_it_counts(self, errors):
        """0.5 m at one of four places is 0.25 m rms."""
        assert errors.near_rms_m[:3] == pytest.approx([0.3, 0, 0.25], rel=SLANT)

    def test_a_lane_is_correct_up_to_20_m(self, errors):
        assert errors.correct.tolist() == [False, True, False, True, True]

    def test_errors_up_to_30_m_count_for_the_confidence(self, errors):
        assert errors.full_rms_m[1] == pytest.approx(1 / np.sqrt(5), rel=SLANT)

    def test_errors_30_m_ahead_are_in_the_table(self, errors):
        row = score([errors])
        assert row["lateral_30m_p95_m"] == pytest.approx(1, rel=SLANT)


class TestOnTheLine:
    """The car's centre is 0.3 m from a line, or 0.5 m: it changes to the lane on the
    other side.
    """

    def lane(self, lateral_m: float, side: float = 0.0) -> LaneTruth:
        """The lane around 0, or its neighbour on a side; the car is at `lateral_m`."""
        road = RoadGeometry([0.0, 500.0], [1 / 400, 1 / 400])
        pose = VehiclePose(100.0, lateral_m)
        places_m = np.array([side + 0.5, side - 0.5]) * WIDTH
        lines_y_m = [line_lateral(road, pose, place, AHEAD_M) for place in places_m]
        at_car_m = [line_polynomial(road, pose, place).c0_m for place in places_m]
        return LaneTruth(
            lines_y_m=np.array([lines_y_m] * N),
            at_car_y_m=np.array([at_car_m] * N),
            offset_m=np.full(N, lateral_m if side == 0 else -np.mean(at_car_m)),
            heading_rad=np.zeros(N),
            curvature_per_m=np.full(N, 1 / (400 - side * WIDTH)),
            width_m=np.full(N, WIDTH),
        )

    def neighbour(self, lateral_m: float) -> DriveEstimates:
        """Estimates without error of the lane that the car is nearer to."""
        return perfect(self.lane(lateral_m, np.sign(lateral_m)))

    @pytest.mark.parametrize("lateral_m", [1.5, -1.5, 1.3])
    def test_the_own_lane_is_correct(self, lateral_m):
        lane = self.lane(lateral_m)
        assert frame_errors(perfect(lane), lane).correct.all()

    @pytest.mark.parametrize("lateral_m", [1.5, -1.5])
    def test_the_other_lane_is_correct_near_the_line(self, lateral_m):
        errors = frame_errors(self.neighbour(lateral_m), self.lane(lateral_m))
        assert errors.correct.all()
        assert errors.offset_m == pytest.approx(0.0, abs=1e-3)
        assert errors.lateral_m.max() < 0.001
        assert errors.curvature_per_m.max() < 1e-6

    def test_the_other_lane_is_wrong_farther_from_the_line(self):
        errors = frame_errors(self.neighbour(1.3), self.lane(1.3))
        assert not errors.correct.any()
        assert errors.offset_m == pytest.approx(WIDTH, abs=1e-3)

    @pytest.mark.parametrize("side", [0.0, 1.0])
    def test_the_error_is_not_smaller_where_the_line_ends_after_5_m(self, side):
        found = shifted(perfect(self.lane(1.5, side)), 0.23)
        lane = self.lane(1.5)
        lane.lines_y_m[..., AHEAD_M > 5] = np.nan
        errors = frame_errors(found, lane)
        assert errors.near_rms_m == pytest.approx(0.23, rel=SLANT)
        assert not errors.correct.any()


def test_a_line_that_turns_back_before_the_true_one_is_wrong():
    """It is as near to the points 20 and 30 m ahead as 15 m ahead: 5 and 15 m."""
    estimates = perfect(truth())
    x_m = estimates.lines_m[0, LEFT, :, 0]
    x_m[:] = np.minimum(x_m, 30.0 - x_m)
    errors = frame_errors(estimates, truth())
    assert errors.lateral_m[0] == pytest.approx([0, 0, 0, 5, 15], abs=0.05)
    assert errors.correct.tolist() == [False] + [True] * 4


class TestLostFrames:
    @pytest.fixture
    def row(self) -> Row:
        """The first two of five frames have no lane."""
        estimates = perfect(truth())
        for field in fields(estimates):
            getattr(estimates, field.name)[:2] = np.nan
        return row_of(estimates)

    @pytest.mark.parametrize(
        ("column", "value"),
        [
            ("available_share", 0.6),
            ("accuracy", 0.6),
            ("confident_and_wrong_share", 0),
            ("recovery_longest_frames", 2),
        ],
    )
    def test_they_lower_the_availability(self, row, column, value):
        assert row[column] == value

    def test_they_are_no_error(self, row):
        assert row["lateral_5_20m_p95_m"] == 0


class TestNoLane:
    @pytest.fixture
    def row(self) -> Row:
        """The last lane states no confidence, like the recipes."""
        confidence = np.array([0.95, 0.9, 0.89, 0.1, np.nan])
        return row_of(replace(perfect(truth()), confidence=confidence), NO_LANE)

    def test_a_lane_with_a_confidence_of_90_percent_or_none_is_wrong(self, row):
        assert row["confident_and_wrong_share"] == 0.6

    def test_no_frame_has_a_lane_or_a_loss(self, row):
        assert row["lane_frames"] == 0
        assert row["recovery_longest_frames"] == 0

    def test_nothing_is_scored(self, row):
        names = ("available_share", "accuracy", "offset_median_m")
        assert np.isnan([row[name] for name in names]).all()


@pytest.mark.parametrize(("confidence", "share"), [(0.89, 0), (np.nan, 1)])
def test_a_wrong_lane_is_confident_from_90_percent_on_or_without_a_statement(
    confidence, share
):
    wrong = shifted(perfect(truth(), confidence), 1.0)
    assert row_of(wrong)["confident_and_wrong_share"] == share


@pytest.mark.parametrize(
    ("frames", "lengths"),
    [
        ("", []),
        ("+++++", []),
        ("++--+++", [2]),
        ("--+++", [2]),
        ("+++--", [2]),
        ("+--+", [2]),
        ("---", [3]),
        ("+-++-+++", [4]),
        ("+-+++-+++", [1, 1]),
    ],
)
def test_a_loss_ends_with_three_correct_frames(frames, lengths):
    correct = [frame == "+" for frame in frames]
    assert recovery_lengths(np.array(correct, bool)) == lengths


class TestFailures:
    """A frame is lost, one correct, two wrong, one correct."""

    @pytest.fixture
    def estimates(self) -> DriveEstimates:
        shift_m = np.array([0.0, 0.0, 0.3, 0.5, 0.0])
        confidence = np.array([0.9, 0.9, 0.9, 0.9, 0.1])
        found = shifted(perfect(truth()), shift_m)
        found.offset_m[0] = np.nan
        return replace(found, confidence=confidence)

    def test_they_are_described_with_their_times(self, estimates):
        errors = frame_errors(estimates, truth())
        assert describe_failures(
            [Result("fog", "hard", "tracker", errors, fps=10)]
        ) == (
            "fog, tracker: lost 0.00-0.10 s; confident and wrong by 0.50 m 0.20-0.40 s"
        )

    def test_a_drive_without_any_is_not_described(self):
        errors = frame_errors(perfect(truth()), truth())
        assert describe_failures([Result("fog", "hard", "tracker", errors)]) == ""

    def test_a_lane_where_none_exists_is_one(self, estimates):
        spans = failure_spans(frame_errors(estimates, NO_LANE), 10)
        assert spans == ["a lane where none exists 0.10-0.40 s"]

    def test_an_unsure_lane_is_only_wrong(self, estimates):
        unsure = replace(estimates, confidence=np.full(N, 0.2))
        _, wrong = failure_spans(frame_errors(unsure, truth()), 10)
        assert wrong == "wrong by 0.50 m 0.20-0.40 s"


class TestTotals:
    @pytest.fixture
    def rows(self) -> dict[str, Row]:
        """The rows of two wrong and a right hard drive, and of a clean one."""
        good = frame_errors(perfect(truth()), truth())
        bad = frame_errors(shifted(perfect(truth()), 1.0), truth())
        results = [
            Result("one", "hard", "tracker", bad),
            Result("two", "hard", "tracker", bad, workers=2),
            Result("three", "hard", "tracker", good),
            Result("four", "clean", "tracker", good),
        ]
        return {row["scene"]: row for row in score_rows(results)}

    def test_they_follow_the_scenes(self, rows):
        assert list(rows) == ["one", "two", "three", "four", "all hard", "all clean"]

    def test_they_are_over_all_frames_of_their_difficulty(self, rows):
        assert rows["all hard"]["frames"] == 3 * N
        assert rows["all hard"]["accuracy"] == pytest.approx(1 / 3)
        assert rows["all clean"]["accuracy"] == 1

    def test_a_loss_ends_with_its_scene(self, rows):
        assert rows["all hard"]["recovery_longest_frames"] == N

    def test_the_workers_are_the_most_of_any_scene(self, rows):
        assert rows["all hard"]["workers"] == 2


@pytest.fixture
def stored(tmp_path) -> tuple[DriveEstimates, Path]:
    """Estimates with single values of their own, and their file."""
    estimates = shifted(perfect(truth(), confidence=np.nan), 0.123)
    estimates.lines_y_m[1, 0, 3] = 0.123
    estimates.covariance[2] = np.diag([1e-4, 1e-7, 1.2345e-11, 1e-4])
    write_estimates(tmp_path / "a.npz", estimates, workers=3)
    return estimates, tmp_path / "a.npz"


@pytest.mark.parametrize("name", [field.name for field in fields(DriveEstimates)])
def test_estimates_are_the_same_when_read_from_their_file(stored, name):
    estimates, path = stored
    back, _ = read_estimates(path)
    np.testing.assert_array_equal(getattr(back, name), getattr(estimates, name))


def test_metadata_are_the_same_when_read_from_their_file(stored):
    _, path = stored
    _, metadata = read_estimates(path)
    assert metadata == {"workers": 3}


@pytest.mark.parametrize("damage", ["cut off", "no archive"])
def test_a_damaged_file_of_estimates_is_named(stored, damage):
    _, path = stored
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2] if damage == "cut off" else b"no archive")
    with pytest.raises(ValueError, match=r"a.npz: holds no estimates .* remove it"):
        read_estimates(path)
