"""Lanes made by hand against truths made by hand, for each rule of the scores."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np
import pytest

from benchmark.errors import LaneTruth, frame_errors, recovery_lengths
from benchmark.estimates import (
    AHEAD_M,
    ALONG_M,
    DriveEstimates,
    read_estimates,
    road_points,
    write_estimates,
)
from benchmark.scores import Result, score, score_rows
from benchmark.tables import describe_failures, failure_spans
from simulator.road.geometry import (
    RoadGeometry,
    VehiclePose,
    line_lateral,
    line_polynomial,
)

N, WIDTH = 5, 3.6

# The lines of these tests have directions up to 0.07 rad; an error perpendicular to
# them is smaller by half its square.
SLANT = 2.5e-3
LEFT, RIGHT = 0, 1


def truth(
    offset_m: float = 0.25,
    curvature_per_m: float = 0.002,
    heading_rad: float = 0.01,
    *,
    frames: int = N,
) -> LaneTruth:
    """Frames of a lane that bends left; the car is left of its centre."""
    bend = np.tan(heading_rad) * AHEAD_M + curvature_per_m * AHEAD_M**2 / 2
    at_car = np.array([WIDTH / 2, -WIDTH / 2]) - offset_m
    every = np.ones(frames)
    lines_y_m = np.array([at_car[:, None] + bend] * frames)
    numbers = (
        every * number for number in (offset_m, heading_rad, curvature_per_m, WIDTH)
    )
    return LaneTruth(lines_y_m, np.outer(every, at_car), *numbers)


NO_LANE = replace(truth(), lines_y_m=np.full((N, 2, len(AHEAD_M)), np.nan))


def lines_through(lateral_m: np.ndarray) -> np.ndarray:
    """Lines (2, P, 2) with the lateral positions (2, D) at AHEAD_M, straight in between
    and beyond.
    """
    return road_points(
        ALONG_M, np.array([np.interp(ALONG_M, AHEAD_M, line) for line in lateral_m])
    )


def estimate(
    lines_m: np.ndarray,
    offset_m: float,
    heading: float,
    curvature: float,
    confidence: float | None,
) -> dict:
    numbers = {
        "offset_m": offset_m,
        "heading_rad": heading,
        "curvature_per_m": curvature,
        "confidence": confidence,
    }
    return {"lines_m": lines_m} | numbers


def perfect(lane: LaneTruth, confidence: float | None = 0.99) -> DriveEstimates:
    """Estimates without error."""
    some = zip(
        map(lines_through, lane.lines_y_m),
        lane.offset_m,
        lane.heading_rad,
        lane.curvature_per_m,
        strict=True,
    )
    return DriveEstimates.from_frames(
        [estimate(*one, confidence) for one in some], [7.0] * N
    )


def shifted(estimates: DriveEstimates, shift_m: np.ndarray | float) -> DriveEstimates:
    """The same lane, both lines shifted to the left."""
    shift_m = np.broadcast_to(shift_m, N)
    lines_m = estimates.lines_m + shift_m[:, None, None, None] * [0.0, 1.0]
    return replace(estimates, lines_m=lines_m, offset_m=estimates.offset_m - shift_m)


def test_the_truth_has_no_error():
    errors = frame_errors(perfect(truth()), truth())
    row = score([errors])
    assert row["available_share"] == row["accuracy"] == 1
    assert row["confident_and_wrong_share"] == row["recovery_longest_frames"] == 0
    assert [
        row[name] for name in row if name.endswith(("_m", "_rad"))
    ] == pytest.approx([0] * 14)
    assert row["time_median_ms"] == 7
    # the 95th percentile of 20 drives is the 19th
    row = score([replace(errors, offset_m=np.full(N, float(k))) for k in range(1, 21)])
    assert (row["offset_median_m"], row["offset_p95_m"]) == (10, 19)


def test_a_shifted_lane_has_the_shift_as_error():
    row = score([frame_errors(shifted(perfect(truth()), -0.15), truth())])
    for name in ("lateral_5m", "lateral_15m", "lateral_30m", "lateral_5_20m", "offset"):
        assert [row[f"{name}_median_m"], row[f"{name}_p95_m"]] == pytest.approx(
            [0.15, 0.15], rel=SLANT
        )
    assert row["heading_p95_rad"] == row["curvature_p95_per_m"] == 0
    assert row["accuracy"] == 1
    assert (
        score([frame_errors(shifted(perfect(truth()), 0.21), truth())])["accuracy"] == 0
    )


def test_in_a_hairpin_errors_are_perpendicular_to_the_line_and_end_at_60_degrees():
    """The estimated lines are circles 10 cm inside the true ones."""
    centre_m = 22.0
    radii_m = np.array([20.4, 23.6])
    true_y_m = centre_m - np.sqrt(np.maximum(radii_m[:, None] ** 2 - AHEAD_M**2, 0))
    true_y_m[:, AHEAD_M > 20] = np.nan
    numbers = [np.array([v]) for v in (0.0, 0.0, 1 / centre_m, np.ptp(radii_m))]
    lane = LaneTruth(true_y_m[None], np.array([centre_m - radii_m]), *numbers)
    angle = ALONG_M / centre_m
    inner = np.stack(
        [
            np.outer(radii_m - 0.1, np.sin(angle)),
            centre_m - np.outer(radii_m - 0.1, np.cos(angle)),
        ],
        -1,
    )
    estimates = [estimate(inner, 0.0, 0.0, 1 / centre_m, 0.9)]
    errors = frame_errors(DriveEstimates.from_frames(estimates, [1.0]), lane)
    assert lane.compared[0].sum(axis=1).tolist() == [3, 4]
    assert errors.lateral_m[0, AHEAD_M <= 20] == pytest.approx(0.1, rel=0.02)
    assert np.isnan(errors.lateral_m[0, AHEAD_M > 20]).all()
    assert errors.near_rms_m[0] == pytest.approx(0.1, rel=0.02)


def test_the_worse_line_counts_and_correct_is_up_to_20_m():
    lane = truth()
    estimates = perfect(truth())
    estimates.lines_m[0, RIGHT, :, 1] += 0.3
    estimates.lines_m[1, RIGHT, np.abs(ALONG_M - 30.0) <= 1.0, 1] += 1.0
    estimates.lines_m[2, RIGHT, np.abs(ALONG_M - 20.0) <= 1.0, 1] -= 0.5
    errors = frame_errors(estimates, lane)
    # 0.5 m at one of four places is 0.25 m rms
    assert errors.near_rms_m[:3] == pytest.approx([0.3, 0, 0.25], rel=SLANT)
    assert errors.correct.tolist() == [False, True, False, True, True]
    assert errors.full_rms_m[1] == pytest.approx(1 / np.sqrt(5), rel=SLANT)
    assert score([errors])["lateral_30m_p95_m"] == pytest.approx(1, rel=SLANT)


class TestOnTheLine:
    """The car's centre is 0.3 m from a line, or 0.5 m: it changes to the lane on the
    other side.
    """

    def drive(
        self, lateral_m: float
    ) -> tuple[LaneTruth, DriveEstimates, DriveEstimates]:
        """Truth of the lane around 0; estimates without error of this lane and of the
        one that the car is nearer to.
        """
        road = RoadGeometry([0.0, 500.0], [1 / 400, 1 / 400])
        pose = VehiclePose(100.0, lateral_m)
        side = np.sign(lateral_m)
        lanes = np.array([[0.5, -0.5], [side + 0.5, side - 0.5]]) * WIDTH
        lines = np.array(
            [[line_lateral(road, pose, d, AHEAD_M) for d in lane] for lane in lanes]
        )
        at_car = np.array(
            [[line_polynomial(road, pose, d).c0_m for d in lane] for lane in lanes]
        )
        every = np.ones(N)
        numbers = (every * number for number in (lateral_m, 0, 1 / 400, WIDTH))
        lane = LaneTruth(np.array([lines[0]] * N), np.outer(every, at_car[0]), *numbers)
        other = estimate(
            lines_through(lines[1]),
            -at_car[1].mean(),
            0.0,
            1 / (400 - side * WIDTH),
            0.99,
        )
        return lane, perfect(lane), DriveEstimates.from_frames([other] * N, [1.0] * N)

    @pytest.mark.parametrize(
        ("lateral_m", "either"), [(1.5, True), (-1.5, True), (1.3, False)]
    )
    def test_either_lane_is_correct_only_near_the_line(self, lateral_m, either):
        lane, own, other = self.drive(lateral_m)
        assert frame_errors(own, lane).correct.all()
        errors = frame_errors(other, lane)
        assert errors.correct.tolist() == [either] * N
        assert errors.offset_m == pytest.approx(0.0 if either else WIDTH, abs=1e-3)
        assert not either or (
            errors.lateral_m.max() < 0.001 and errors.curvature_per_m.max() < 1e-6
        )

    def test_the_error_is_not_smaller_where_the_line_ends_after_5_m(self):
        lane, own, left = self.drive(1.5)
        lane.lines_y_m[..., AHEAD_M > 5] = np.nan
        for estimates in (shifted(own, 0.23), shifted(left, 0.23)):
            errors = frame_errors(estimates, lane)
            assert errors.near_rms_m == pytest.approx(0.23, rel=SLANT)
            assert not errors.correct.any()


class TestUnknown:
    def test_a_line_that_turns_back_before_the_true_one_is_wrong(self):
        estimates = perfect(truth())
        x_m = estimates.lines_m[0, LEFT, :, 0]
        x_m[:] = np.minimum(x_m, 30.0 - x_m)
        errors = frame_errors(estimates, truth())
        # it comes as near to the points 20 and 30 m ahead as 15 m ahead: 5 and 15 m
        assert errors.lateral_m[0] == pytest.approx([0, 0, 0, 5, 15], abs=0.05)
        assert errors.correct.tolist() == [False] + [True] * 4

    def test_lost_frames_lower_availability_and_are_no_error(self):
        lane = truth()
        found = [
            estimate(lines_through(y), 0.25, 0.01, 0.002, 0.95)
            for y in lane.lines_y_m[2:]
        ]
        estimates = DriveEstimates.from_frames([{}, {}, *found], [1.0] * N)
        row = score([frame_errors(estimates, lane)])
        assert (
            row["available_share"],
            row["accuracy"],
            row["confident_and_wrong_share"],
        ) == (0.6, 0.6, 0)
        assert row["lateral_5_20m_p95_m"] == 0
        assert row["recovery_longest_frames"] == 2

    def test_a_confident_lane_is_wrong_where_none_exists_or_another_one(self):
        confidence = np.array([0.95, 0.9, 0.89, 0.1, np.nan])
        row = score(
            [frame_errors(replace(perfect(truth()), confidence=confidence), NO_LANE)]
        )
        # the last one states no confidence, like the recipes
        assert row["confident_and_wrong_share"] == 0.6
        assert (row["lane_frames"], row["recovery_longest_frames"]) == (0, 0)
        assert np.isnan(
            [row["available_share"], row["accuracy"], row["offset_median_m"]]
        ).all()
        wrong = shifted(perfect(truth(), confidence=0.89), 1.0)
        assert not frame_errors(wrong, truth()).confident_and_wrong.any()
        assert frame_errors(
            replace(wrong, confidence=np.full(N, np.nan)), truth()
        ).confident_and_wrong.all()


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
    ]
    + [("+-++-+++", [4]), ("+-+++-+++", [1, 1])],
)
def test_a_loss_ends_with_three_correct_frames(frames, lengths):
    assert recovery_lengths(np.array([c == "+" for c in frames], bool)) == lengths


def test_failures_are_described_with_their_times():
    estimates = shifted(perfect(truth()), np.array([0.0, 0.0, 0.3, 0.5, 0.0]))
    estimates = replace(estimates, confidence=np.array([0.9, 0.9, 0.9, 0.9, 0.1]))
    estimates.offset_m[0] = np.nan
    result = Result("fog", "hard", "tracker", frame_errors(estimates, truth()), fps=10)
    assert (
        describe_failures([result])
        == "fog, tracker: lost 0.00-0.10 s; confident and wrong by 0.50 m 0.20-0.40 s"
    )
    assert (
        describe_failures(
            [replace(result, errors=frame_errors(perfect(truth()), truth()))]
        )
        == ""
    )
    assert failure_spans(frame_errors(estimates, NO_LANE), 10) == [
        "a lane where none exists 0.10-0.40 s"
    ]
    unsure = replace(estimates, confidence=np.full(N, 0.2))
    assert (
        failure_spans(frame_errors(unsure, truth()), 10)[1]
        == "wrong by 0.50 m 0.20-0.40 s"
    )


def test_totals_are_over_frames_and_a_loss_ends_with_its_scene():
    good, bad = (
        frame_errors(shifted(perfect(truth()), shift_m), truth())
        for shift_m in (0.0, 1.0)
    )
    drives = [
        ("one", "hard", bad, 1),
        ("two", "hard", bad, 2),
        ("three", "hard", good, 1),
        ("four", "clean", good, 1),
    ]
    results = [
        Result(scene, kind, "tracker", errors, workers=workers)
        for scene, kind, errors, workers in drives
    ]
    *scenes, hard, clean = score_rows(results)
    assert (hard["scene"], hard["frames"], hard["accuracy"]) == (
        "all hard",
        3 * N,
        pytest.approx(1 / 3),
    )
    assert (hard["recovery_longest_frames"], hard["workers"]) == (N, 2)
    assert clean["accuracy"] == 1
    assert [row["scene"] for row in scenes] == ["one", "two", "three", "four"]


def test_estimates_are_the_same_when_read_from_their_file_and_a_damaged_one_is_named(
    tmp_path,
):
    estimates = shifted(perfect(truth(), confidence=None), 0.123)
    estimates.lines_y_m[1, 0, 3] = 0.123
    estimates.covariance[2] = np.diag([1e-4, 1e-7, 1.2345e-11, 1e-4])
    write_estimates(tmp_path / "a.npz", estimates, workers=3)
    back, metadata = read_estimates(tmp_path / "a.npz")
    assert metadata == {"workers": 3}
    for name, array in asdict(estimates).items():
        np.testing.assert_array_equal(getattr(back, name), array)
    data = (tmp_path / "a.npz").read_bytes()
    for damaged in (data[: len(data) // 2], b"no archive"):
        (tmp_path / "a.npz").write_bytes(damaged)
        with pytest.raises(ValueError, match=r"a.npz: holds no estimates .* remove it"):
            read_estimates(tmp_path / "a.npz")
