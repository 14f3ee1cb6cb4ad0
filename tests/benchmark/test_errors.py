"""Lanes made by hand against truths made by hand: each law of the measures on its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmark.errors import LaneTruth, frame_errors, recoveries
from benchmark.estimates import AT_M, Reading, Readings, read_readings, write_readings
from benchmark.reporting.failures import describe_failures, failures
from benchmark.scores import Result, percentile, score, score_rows, total_rows
from lanes.camera.camera import Camera
from lanes.camera.camera_pose import CameraPose
from simulator.road.geometry import RoadGeometry, VehiclePose, line_lateral, line_polynomial

N, WIDTH = 5, 3.6

# The lines of these tests are slanted by up to 0.07 rad, and errors count square to them: less by half its square.
SLANT = 2.5e-3


def truth(offset_m: float = 0.25, curvature_per_m: float = 0.002, heading_rad: float = 0.01) -> LaneTruth:
    """N frames of a lane that bends left, seen by a car left of its middle."""
    bend = np.tan(heading_rad) * AT_M + curvature_per_m * AT_M**2 / 2
    beside = np.array([WIDTH / 2, -WIDTH / 2]) - offset_m
    every = np.ones(N)
    return LaneTruth(
        np.broadcast_to(beside[:, None] + bend, (N, 2, len(AT_M))).copy(),
        np.outer(every, beside),
        offset_m * every,
        heading_rad * every,
        curvature_per_m * every,
        WIDTH * every,
    )


def perfect(lane: LaneTruth, confidence: float | None = 0.99) -> Readings:
    """A system that says the truth."""
    some = zip(lane.lines_y_m, lane.offset_m, lane.heading_rad, lane.curvature_per_m, strict=True)
    return Readings.of([Reading(*one, confidence) for one in some], [7.0] * N)


def shifted(readings: Readings, shift_m: np.ndarray | float) -> Readings:
    """The same lane, both lines by so much farther left."""
    shift_m = np.broadcast_to(shift_m, N)
    return replace(
        readings, lines_y_m=readings.lines_y_m + shift_m[:, None, None], offset_m=readings.offset_m - shift_m
    )


def test_the_truth_has_no_error():
    row = score([frame_errors(perfect(truth()), truth())])
    assert row["available_share"] == row["right_share"] == 1
    assert row["confidently_wrong_share"] == row["recover_longest_frames"] == 0
    assert [row[name] for name in row if name.endswith(("_m", "_rad"))] == pytest.approx([0] * 16)
    assert row["time_median_ms"] == 7


def test_a_shifted_lane_is_off_by_the_shift():
    row = score([frame_errors(shifted(perfect(truth()), -0.15), truth())])
    for name in ("lateral_5m", "lateral_15m", "lateral_30m", "lateral_5_20m", "offset"):
        assert [row[f"{name}_median_m"], row[f"{name}_p95_m"]] == pytest.approx([0.15, 0.15], rel=SLANT)
    assert row["heading_p95_rad"] == row["curvature_p95_per_m"] == 0
    assert row["right_share"] == 1
    assert score([frame_errors(shifted(perfect(truth()), 0.21), truth())])["right_share"] == 0


def test_in_a_hairpin_distance_counts_square_to_the_line_and_not_beyond_60_degrees():
    radius_m, width_m, gap_m = 22.0, 3.2, 0.1

    def circles(wider_m: float) -> np.ndarray:
        """Two circles about a point 22 m to the left, both `wider_m` larger than they should be."""
        radii = np.array([[radius_m - width_m / 2], [radius_m + width_m / 2]]) + wider_m
        inside = radii**2 - AT_M**2
        return radius_m - np.sqrt(np.where(inside > 0, inside, np.nan))

    numbers = [np.array([v]) for v in (0.0, 0.0, 1 / radius_m, width_m)]
    lane = LaneTruth(circles(0.0)[None], np.array([[width_m / 2, -width_m / 2]]), *numbers)
    said = [Reading(circles(gap_m), 0.0, 0.0, 1 / radius_m, 0.9)]
    errors = frame_errors(Readings.of(said, [1.0]), lane)
    at_15 = errors.lateral_m[0, list(AT_M).index(15.0)]
    assert np.isnan(errors.lateral_m[0, AT_M > 20]).all()
    # never made smaller than it is, and not as large as the difference in y, which is 15 cm there
    assert gap_m <= at_15 < 1.2 * gap_m
    assert gap_m <= errors.near_m[0] < 1.2 * gap_m


def test_the_worse_line_counts_and_only_up_to_20_m_for_being_right():
    lane, readings = truth(), perfect(truth())
    right_line = readings.lines_y_m[:, 1]
    right_line[0] += 0.3
    right_line[1, AT_M == 30] += 5
    right_line[2, AT_M == 20] -= 0.5
    errors = frame_errors(readings, lane)
    # 0.5 m at one of four places is 0.25 m rms
    assert errors.near_m[:3] == pytest.approx([0.3, 0, 0.25], rel=SLANT)
    assert errors.right.tolist() == [False, True, False, True, True]
    assert errors.far_m[1] == pytest.approx(5 / np.sqrt(5), rel=SLANT)
    assert score([errors])["lateral_30m_p95_m"] == pytest.approx(5, rel=SLANT)


def test_where_one_line_ends_the_other_one_counts_on():
    lane, readings = truth(), perfect(truth())
    lane.lines_y_m[0, 1, AT_M >= 20] = np.nan
    readings.lines_y_m[0, 0, AT_M == 20] += 1.0
    errors = frame_errors(readings, lane)
    assert errors.near_m[0] == pytest.approx(0.5, rel=SLANT)
    assert errors.right.tolist() == [False, True, True, True, True]


def test_beside_the_picture_no_line_is_judged_for_being_right_there():
    camera = Camera.from_fov((1280, 720), 60, CameraPose(1.3, 0.0))
    lane = truth(heading_rad=0.2, curvature_per_m=0.03)
    readings = perfect(lane)
    seen = np.abs(lane.lines_y_m[0] / AT_M) < np.tan(np.radians(30))
    assert lane.in_picture(camera)[0].tolist() == seen.tolist()
    assert seen[0].tolist() == [False, True, True, False, False]
    readings.lines_y_m[0, 0, ~seen[0]] += 2.0
    readings.lines_y_m[1, 0, seen[0]] += 2.0
    errors = frame_errors(readings, lane, camera)
    assert errors.right.tolist() == [False, False, True, True, True]
    assert errors.right_in_picture.tolist() == [True, False, True, True, True]
    assert score([errors])["right_in_picture_share"] == 0.8


def test_heading_and_curvature_err_either_way():
    readings = perfect(truth())
    readings = replace(readings, heading_rad=readings.heading_rad - 0.03, curvature_per_m=-readings.curvature_per_m)
    row = score([frame_errors(readings, truth())])
    assert row["heading_median_rad"] == pytest.approx(0.03)
    assert row["curvature_median_per_m"] == pytest.approx(0.004)


class TestOnTheLine:
    """The car's middle is 0.3 m right of its lane's left line: on the way into the lane on the left."""

    def neighbour(
        self, lane: LaneTruth, road: RoadGeometry, pose: VehiclePose, laterals_m: tuple[float, float]
    ) -> Readings:
        """A system that has the lane on the left, exactly."""
        lines = [line_lateral(road, pose, d, AT_M) for d in laterals_m]
        left, right = (line_polynomial(road, pose, d).c0_m for d in laterals_m)
        curvature = lane.curvature_per_m[0] / (1 - WIDTH * lane.curvature_per_m[0])
        return Readings.of([Reading(np.array(lines), -(left + right) / 2, 0.0, curvature, 0.99)] * N, [1.0] * N)

    def drive(self, lateral_m: float) -> tuple[LaneTruth, Readings, Readings]:
        """Truth of the lane around 0; what it is when read exactly, and the lane on its left."""
        road, pose = RoadGeometry([0.0, 500.0], [1 / 400, 1 / 400]), VehiclePose(100.0, lateral_m, 0.0)
        lines = np.array([line_lateral(road, pose, d, AT_M) for d in (WIDTH / 2, -WIDTH / 2)])
        beside = [line_polynomial(road, pose, d).c0_m for d in (WIDTH / 2, -WIDTH / 2)]
        every = np.ones(N)
        lane = LaneTruth(
            np.array([lines] * N), np.outer(every, beside), lateral_m * every, 0 * every, every / 400, WIDTH * every
        )
        return lane, perfect(lane), self.neighbour(lane, road, pose, (1.5 * WIDTH, WIDTH / 2))

    def test_either_lane_is_right(self):
        lane, own, left = self.drive(1.5)
        for readings in (own, left):
            errors = frame_errors(readings, lane)
            assert errors.right.all()
            assert max(errors.lateral_m.max(), errors.offset_m.max()) < 0.001
            assert errors.curvature_per_m.max() < 1e-6

    def test_a_little_farther_away_only_the_own_one_is(self):
        lane, own, left = self.drive(1.3)
        assert frame_errors(own, lane).right.all()
        errors = frame_errors(left, lane)
        assert not errors.right.any()
        assert errors.offset_m == pytest.approx(WIDTH, abs=1e-3)

    def test_a_wrong_lane_stays_wrong(self):
        lane, own, left = self.drive(1.5)
        assert not frame_errors(shifted(own, 0.5), lane).right.any()
        assert not frame_errors(shifted(left, -0.5), lane).right.any()

    def test_it_goes_for_the_right_line_as_well(self):
        lane, own, left = self.drive(1.5)

        def mirrored(lines):
            return -lines[:, ::-1]

        lane = replace(
            lane,
            lines_y_m=mirrored(lane.lines_y_m),
            beside_y_m=mirrored(lane.beside_y_m),
            offset_m=-lane.offset_m,
            curvature_per_m=-lane.curvature_per_m,
        )
        right = replace(
            left,
            lines_y_m=mirrored(left.lines_y_m),
            offset_m=-left.offset_m,
            curvature_per_m=-left.curvature_per_m,
        )
        errors = frame_errors(right, lane)
        assert errors.right.all()
        assert errors.curvature_per_m.max() < 1e-6


class TestUnknown:
    def test_where_the_road_does_not_reach_nothing_is_judged(self):
        lane, readings = truth(), shifted(perfect(truth()), 0.1)
        lane.lines_y_m[:, :, AT_M > 10] = np.nan
        row = score([frame_errors(readings, lane)])
        assert np.isnan(row["lateral_15m_median_m"])
        assert [row["lateral_5_20m_p95_m"], row["lateral_5m_p95_m"]] == pytest.approx([0.1, 0.1], rel=SLANT)

    def test_one_line_may_end_before_the_other(self):
        lane, readings = truth(), perfect(truth())
        lane.lines_y_m[:, 0, AT_M >= 20] = np.nan
        readings.lines_y_m[:, 1] += 0.15
        errors = frame_errors(readings, lane)
        assert errors.lateral_m[:, AT_M == 30] == pytest.approx(0.15, rel=SLANT)
        assert errors.near_m == pytest.approx(0.15, rel=SLANT)

    def test_a_line_that_turns_back_before_the_true_one_is_wrong(self):
        readings = perfect(truth())
        readings.lines_y_m[0, 0, AT_M >= 20] = np.nan
        errors = frame_errors(readings, truth())
        assert errors.near_m[0] == np.inf
        assert errors.right.tolist() == [False] + [True] * 4
        assert score([errors])["lateral_30m_p95_m"] == np.inf

    def test_lost_frames_count_as_not_available_and_not_as_error(self):
        lane = truth()
        said = [Reading(), Reading(), *[Reading(y, 0.25, 0.01, 0.002, 0.95) for y in lane.lines_y_m[2:]]]
        errors = frame_errors(Readings.of(said, [1.0] * N), lane)
        row = score([errors])
        assert (row["available_share"], row["right_share"], row["confidently_wrong_share"]) == (0.6, 0.6, 0)
        assert row["lateral_5_20m_p95_m"] == 0
        assert row["recover_longest_frames"] == 2

    def test_a_lane_where_there_is_none_is_wrong_if_it_is_sure(self):
        nowhere = replace(truth(), lines_y_m=np.full((N, 2, len(AT_M)), np.nan))
        sure = np.array([0.95, 0.9, 0.89, 0.1, np.nan])
        row = score([frame_errors(replace(perfect(truth()), confidence=sure), nowhere)])
        # the last one states no confidence, as the recipes
        assert row["confidently_wrong_share"] == 0.6
        assert row["lane_frames"] == 0
        assert np.isnan([row["available_share"], row["right_share"], row["offset_median_m"]]).all()

    def test_a_wrong_lane_that_is_unsure_is_not_confidently_wrong(self):
        wrong = shifted(perfect(truth(), confidence=0.89), 1.0)
        assert not frame_errors(wrong, truth()).confidently_wrong.any()
        assert frame_errors(replace(wrong, confidence=np.full(N, np.nan)), truth()).confidently_wrong.all()

    def test_frames_must_match(self):
        with pytest.raises(ValueError, match="4 frames cannot be held against a truth of 5"):
            frame_errors(perfect(truth()).cut(slice(4)), truth())


@pytest.mark.parametrize(
    ("frames", "lengths"),
    [
        ("+++++", []),
        ("++--+++", [2]),
        ("--+++", [2]),
        ("+-++-+++", [4]),  # two right ones in a row are not yet back
        ("+-+++-+++", [1, 1]),
        ("+++--", [2]),
        ("+--+", [2]),
        ("", []),
        ("---", [3]),
    ],
)
def test_recoveries(frames, lengths):
    assert recoveries(np.array([c == "+" for c in frames], bool)) == lengths


def test_percentiles_are_values_that_occur():
    values = np.array([5.0, np.nan, 1.0, np.inf, 3.0])
    assert [percentile(values, p) for p in (25, 50, 75, 95)] == [1, 3, 5, np.inf]
    assert np.isnan(percentile(np.array([np.nan]), 50))


def test_failures_are_told_with_their_seconds():
    readings = shifted(perfect(truth()), np.array([0.0, 0.0, 0.3, 0.5, 0.0]))
    readings = replace(readings, confidence=np.array([0.9, 0.9, 0.9, 0.9, 0.1]))
    readings.offset_m[0] = np.nan
    result = Result("fog", "hard", "tracker", frame_errors(readings, truth()), fps=10)
    assert describe_failures([result]) == "fog, tracker: lost 0.00-0.10 s; surely wrong by 0.50 m 0.20-0.40 s"
    assert describe_failures([replace(result, errors=frame_errors(perfect(truth()), truth()))]) == ""
    nowhere = replace(truth(), lines_y_m=np.full((N, 2, len(AT_M)), np.nan))
    assert failures(frame_errors(readings, nowhere), 10) == ["a lane where there is none 0.10-0.40 s"]
    readings.lines_y_m[2, 0, AT_M == 20] = np.nan
    unsure = replace(readings, confidence=np.full(N, 0.2))
    assert failures(frame_errors(unsure, truth()), 10)[1] == "wrong (a line turns back too soon) 0.20-0.40 s"


def test_totals_are_over_frames_and_a_loss_does_not_run_on_into_the_next_scene():
    good, bad = frame_errors(perfect(truth()), truth()), frame_errors(shifted(perfect(truth()), 1.0), truth())
    results = [
        Result("one", "hard", "tracker", bad),
        Result("two", "hard", "tracker", bad, workers=2),
        Result("three", "hard", "tracker", good),
        Result("four", "clean", "tracker", good),
    ]
    hard, clean = total_rows(results)
    assert (hard["scene"], hard["frames"], hard["right_share"]) == ("all hard", 3 * N, pytest.approx(1 / 3))
    assert (hard["recover_longest_frames"], hard["workers"]) == (N, 2)
    assert clean["right_share"] == 1
    assert [row["scene"] for row in score_rows(results)] == ["one", "two", "three", "four"]


def test_readings_are_the_same_out_of_their_file(tmp_path):
    readings = shifted(perfect(truth(), confidence=None), 0.123)
    readings.lines_y_m[1, 0, 3] = np.nan
    write_readings(tmp_path / "a.json", readings, workers=3)
    back, about = read_readings(tmp_path / "a.json")
    assert about == {"workers": 3}
    for name in ("lines_y_m", "offset_m", "heading_rad", "curvature_per_m", "confidence", "time_ms"):
        np.testing.assert_allclose(getattr(back, name), getattr(readings, name), atol=1e-7)
