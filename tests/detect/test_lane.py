"""The standard deviations that a lane states, against drawn lanes, and lines that are not seen for a while."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lanes.detect.lane import Lane, LineObservation
from lanes.detect.line_type import MarkingProfile
from lanes.detect.road import SIDES, lateral_std_m, line_y
from tests.support.shapes import a_lane

X_M = np.array([5.0, 10.0, 15.0, 20.0, 30.0])
STD = a_lane(centre=0.02, width=0.03, heading=2e-3, curvature=2e-4, rate=1e-5, pitch=5e-3, rate_steps=1e-5)
SEEN = (LineObservation(), LineObservation())


def lane_of(model: np.ndarray) -> Lane:
    return Lane(model, model, np.diag(STD**2), np.diag(STD**2), SEEN, score=1.0)


@pytest.mark.parametrize("curvature", [0.0, 1 / 300, -1 / 40], ids=["straight", "bend", "hairpin"])
def test_lateral_std_is_that_of_drawn_lanes(curvature):
    model = a_lane(centre=0.4, width=3.4, heading=-0.05, curvature=curvature, rate=curvature / 300)
    drawn = np.random.default_rng(2).normal(model, STD, (2000, len(model)))
    expected = [np.std([line_y(X_M, lane, side) for lane in drawn], axis=0) for side in SIDES]
    np.testing.assert_allclose(lane_of(model).lateral_std_m(X_M), expected, rtol=0.05)


def test_on_a_straight_road_it_is_the_approximation_and_in_a_hairpin_several_times_as_large():
    covariance = np.diag(STD**2)
    straight = lane_of(a_lane(curvature=1e-9)).lateral_std_m(X_M)
    np.testing.assert_allclose(straight, lateral_std_m(covariance, X_M), rtol=1e-3)
    inner, _ = lane_of(a_lane(curvature=1 / 24)).lateral_std_m(X_M)
    assert inner[3] > 3 * lateral_std_m(covariance, 20.0)[0]
    assert np.isnan(inner[4])


def test_stds_are_the_roots_of_the_variances():
    lane = lane_of(a_lane())
    stated = [lane.offset_std_m, lane.width_std_m, lane.heading_std_rad, lane.curvature_std_per_m]
    assert stated == pytest.approx(STD[:4])


def test_a_line_that_coasts_has_no_support_and_a_nearer_reach_and_keeps_its_profile_and_votes():
    profile = MarkingProfile(width_m=0.12, centre_m=0.0, yellow=True, contrast=20.0)
    line = LineObservation(0.6, 25.0, profile, rows=40)
    line = replace(line, votes=line.votes.add_profile(profile))
    assert line.coast(10.0, vote=False) == LineObservation(0.0, 15.0, profile, votes=line.votes)
    assert line.coast(10.0, vote=True).votes == line.votes.add_profile(profile) != line.votes
    assert line.coast(30.0, vote=False).reach_m == 0.0
