"""Consistency of stated uncertainties: drawn errors with a known covariance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmark.consistency import consistency, consistency_table
from benchmark.errors import QUANTITIES, FrameErrors, LaneTruth, frame_errors
from benchmark.estimates import AHEAD_M, DriveEstimates
from tests.benchmark import test_errors

N = 4000
STD = np.array([0.03, 0.004, 3e-4, 0.04])
CORRELATION = np.eye(4)
CORRELATION[1, 2] = CORRELATION[2, 1] = -0.9
COVARIANCE = CORRELATION * np.outer(STD, STD)


def truth() -> LaneTruth:
    return test_errors.truth(0.2, heading_rad=0.0, frames=N)


def estimates(stated: float = 1.0) -> DriveEstimates:
    """Errors drawn from COVARIANCE; `stated` times their deviations are stated."""
    lane = truth()
    rng = np.random.default_rng(4)
    errors = rng.multivariate_normal(np.zeros(4), COVARIANCE, N)
    line_std = np.broadcast_to(0.02 + 0.001 * AHEAD_M, (N, 2, len(AHEAD_M)))
    lines_m = test_errors.lines_through(lane.lines_y_m[0])
    return DriveEstimates(
        lines_m=np.array([lines_m] * N),
        offset_m=lane.offset_m + errors[:, 0],
        heading_rad=lane.heading_rad + errors[:, 1],
        curvature_per_m=lane.curvature_per_m + errors[:, 2],
        confidence=np.ones(N),
        width_m=lane.width_m + errors[:, 3],
        covariance=np.array([stated**2 * COVARIANCE] * N),
        lines_y_m=lane.lines_y_m + rng.normal(0, line_std),
        lines_std_m=stated * line_std,
        time_ms=np.ones(N),
    )


def row_of(some: DriveEstimates) -> dict[str, float]:
    return consistency([frame_errors(some, truth())])


@pytest.fixture(scope="module", params=[1.0, 0.5])
def stated(request) -> float:
    """What a system states of the true standard deviation."""
    return request.param


@pytest.fixture(scope="module")
def row(stated) -> dict[str, float]:
    return row_of(estimates(stated))


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_the_rms_of_z_is_the_ratio_of_true_and_stated_std(row, stated, quantity):
    assert row[f"{quantity}_z_rms"] == pytest.approx(1 / stated, rel=0.03)


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_the_shares_of_z_are_those_of_a_normal_distribution(row, stated, quantity):
    within_1, within_2 = {1.0: (0.683, 0.954), 0.5: (0.383, 0.683)}[stated]
    assert row[f"{quantity}_within_1"] == pytest.approx(within_1, abs=0.025)
    assert row[f"{quantity}_within_2"] == pytest.approx(within_2, abs=0.025)


def test_the_nees_is_the_ratio_of_true_and_stated_variance(row, stated):
    assert row["nees_mean"] == pytest.approx(1 / stated**2, rel=0.04)


def test_the_median_of_the_nees_is_that_of_chi_squared(row, stated):
    """With 4 degrees of freedom it is 3.357."""
    assert row["nees_median"] == pytest.approx(3.357 / 4 / stated**2, rel=0.05)


def test_every_frame_counts(row):
    assert row["frames"] == N


def test_nees_notices_a_wrong_correlation():
    opposite = np.array([np.abs(COVARIANCE)] * N)
    assert row_of(replace(estimates(), covariance=opposite))["nees_mean"] > 4


def test_z_does_not_depend_on_the_correlation():
    independent = np.array([np.diag(STD**2)] * N)
    row = row_of(replace(estimates(), covariance=independent))
    assert row["heading_z_rms"] == pytest.approx(1, rel=0.03)


@pytest.fixture(scope="module")
def mixed() -> dict[str, float]:
    """Of a drive with a lane change, another lane and lost frames."""
    lane = truth()
    lane.at_car_y_m[:100, 0] = 0.3
    some = estimates()
    some.lines_m[50:250, :, :, 1] += 3.5
    some.offset_m[50:250] -= 3.5
    some.covariance[-10:] = np.nan
    return consistency([frame_errors(some, lane)])


def test_frames_that_are_left_out_are_counted(mixed):
    assert mixed["lane_change_frames"] == 100
    assert mixed["other_lane_frames"] == 150
    assert mixed["frames"] == N - 260


def test_frames_of_lane_changes_and_other_lanes_are_left_out(mixed):
    assert mixed["offset_z_rms"] == pytest.approx(1, rel=0.03)


def ended() -> FrameErrors:
    """The left line is stated up to 20 m, the right one exists up to there."""
    lane = truth()
    lane.lines_y_m[:, 1, -1] = np.nan
    some = estimates()
    some.lines_y_m[:, 0, -1] = np.nan
    return frame_errors(some, lane)


@pytest.mark.parametrize(
    ("quantity", "count"), [("lateral_30m", 0), ("lateral_20m", 2 * N), ("width", N)]
)
def test_a_line_does_not_count_beyond_its_end(quantity, count):
    assert len(ended().z_of(quantity)) == count


def test_nothing_is_stated_without_a_covariance():
    some = estimates()
    unstated = replace(some, covariance=np.full_like(some.covariance, np.nan))
    assert not frame_errors(unstated, truth()).stated.any()


def test_nothing_is_stated_where_no_lane_exists():
    lane = truth()
    without_lane = replace(lane, lines_y_m=np.full_like(lane.lines_y_m, np.nan))
    assert not frame_errors(estimates(), without_lane).stated.any()


def test_the_table_has_the_totals_with_their_numbers():
    """A row of a scene, and a total without a frame, are left out."""
    numbers = {"frames": 250.0, "nees_mean": 1.234}
    for place, name in enumerate(("offset", "heading", "curvature", "width")):
        numbers[f"{name}_z_rms"] = 0.5 + place
        numbers[f"{name}_within_2"] = 0.9 - place / 10
    total = {"scene": "all hard", "difficulty": "hard", "system": "tracker"} | numbers
    scene = total | {"scene": "fog"}
    empty = total | {"system": "detector", "frames": 0.0}
    assert consistency_table([scene, total, empty]).splitlines() == [
        "| scenes | system | frames | NEES / 4 "
        "| offset | heading | curvature | width |",
        "|---|---|---|---|---|---|---|---|",
        "| all hard | tracker | 250 | 1.23 "
        "| 0.50 (90%) | 1.50 (80%) | 2.50 (70%) | 3.50 (60%) |",
    ]
