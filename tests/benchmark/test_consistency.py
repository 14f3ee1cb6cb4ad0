"""Consistency of stated uncertainties: drawn errors with a known covariance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmark.consistency import consistency
from benchmark.errors import QUANTITIES, LaneTruth, frame_errors
from benchmark.estimates import AHEAD_M, DriveEstimates
from tests.benchmark import test_errors

N = 4000
STD = np.array([0.03, 0.004, 3e-4, 0.04])
CORRELATION = np.eye(4)
CORRELATION[1, 2] = CORRELATION[2, 1] = -0.9
COVARIANCE = CORRELATION * np.outer(STD, STD)


def truth() -> LaneTruth:
    return test_errors.truth(0.2, heading_rad=0.0, frames=N)


def estimates(lane: LaneTruth, *, stated: float = 1.0) -> DriveEstimates:
    """Errors drawn from COVARIANCE; the system states `stated` times their standard
    deviations.
    """
    rng = np.random.default_rng(4)
    offset, heading, curvature, width = rng.multivariate_normal(
        np.zeros(4), COVARIANCE, N
    ).T
    line_std = np.broadcast_to(0.02 + 0.001 * AHEAD_M, (N, 2, len(AHEAD_M)))
    return DriveEstimates(
        np.array([test_errors.lines_through(lane.lines_y_m[0])] * N),
        lane.offset_m + offset,
        lane.heading_rad + heading,
        lane.curvature_per_m + curvature,
        np.ones(N),
        lane.width_m + width,
        np.broadcast_to(stated**2 * COVARIANCE, (N, 4, 4)).copy(),
        lane.lines_y_m + rng.normal(0, line_std),
        stated * line_std,
        np.ones(N),
    )


@pytest.mark.parametrize("stated", [1.0, 0.5])
def test_z_is_the_ratio_of_true_and_stated_std(stated):
    row = consistency([frame_errors(estimates(truth(), stated=stated), truth())])
    assert row["frames"] == N
    within = {1.0: (0.683, 0.954), 0.5: (0.383, 0.683)}[stated]
    for quantity in QUANTITIES:
        assert row[f"{quantity}_z_rms"] == pytest.approx(1 / stated, rel=0.03), quantity
        assert (
            row[f"{quantity}_within_1"],
            row[f"{quantity}_within_2"],
        ) == pytest.approx(within, abs=0.025)
    assert row["nees_mean"] == pytest.approx(1 / stated**2, rel=0.04)
    # the median of a chi-squared variable with 4 degrees of freedom is 3.357
    assert row["nees_median"] == pytest.approx(3.357 / 4 / stated**2, rel=0.05)


def test_nees_notices_a_wrong_correlation():
    some = estimates(truth())
    independent = replace(some, covariance=np.broadcast_to(np.diag(STD**2), (N, 4, 4)))
    opposite = replace(some, covariance=np.broadcast_to(np.abs(COVARIANCE), (N, 4, 4)))
    assert consistency([frame_errors(independent, truth())])[
        "heading_z_rms"
    ] == pytest.approx(1, rel=0.03)
    assert consistency([frame_errors(opposite, truth())])["nees_mean"] > 4


def test_lane_changes_and_other_lanes_are_left_out_and_counted():
    lane = truth()
    some = estimates(truth())
    lane.at_car_y_m[:100, 0] = 0.3
    some.covariance[-10:] = np.nan  # lost frames
    some.lines_m[50:250, :, :, 1] += 3.5
    some.offset_m[50:250] -= 3.5
    row = consistency([frame_errors(some, lane)])
    assert (row["frames"], row["lane_change_frames"], row["other_lane_frames"]) == (
        N - 260,
        100,
        150,
    )
    assert row["offset_z_rms"] == pytest.approx(1, rel=0.03)


def test_a_line_that_ends_does_not_count_nor_a_system_without_a_covariance():
    lane = truth()
    some = estimates(truth())
    some.lines_y_m[:, 0, -1] = np.nan
    lane.lines_y_m[:, 1, -1] = np.nan
    count = {
        name: len(frame_errors(some, lane).z_of(name))
        for name in ("lateral_30m", "lateral_20m", "width")
    }
    assert count == {"lateral_30m": 0, "lateral_20m": 2 * N, "width": N}
    assert not frame_errors(
        replace(some, covariance=np.full((N, 4, 4), np.nan)), lane
    ).stated.any()
    without_lane = replace(lane, lines_y_m=np.full_like(lane.lines_y_m, np.nan))
    assert not frame_errors(some, without_lane).stated.any()
