"""The confidence: lower for doubtful lanes, and right about as often as it says on drives that it was not fitted on."""

from __future__ import annotations

import numpy as np
import pytest
from drives import CAMERA
from fit_confidence import drive_along

from lanes.metric.confidence import FEATURES, STILL_WEIGHTS, TRACK_WEIGHTS, lateral_std_m, rate_lane
from lanes.metric.followed import Seen, describe_followed
from lanes.metric.motion import first_belief


def lane_with(*, width_m: float = 3.6, std_m: float = 0.02):
    covariance = np.diag(np.square([std_m, std_m, std_m / 50, std_m / 500, 1e-7, 1e-3, 1e-5]))
    belief = first_belief(np.array([0.1, width_m, 0, 0, 0, 0, 0]), covariance, 20.0)
    return describe_followed(belief, (Seen(0.6, 40.0), Seen(0.3, 40.0)), (False, False), 1.0)


def test_doubtful_lanes_are_doubted():
    for followed in (False, True):
        good = rate_lane(lane_with(), followed=followed)
        assert good > 0.9
        assert rate_lane(lane_with(std_m=0.3), followed=followed) < good - 0.1
        assert rate_lane(lane_with(width_m=4.4), followed=followed) < 0.5
        assert rate_lane(lane_with(width_m=2.6), followed=followed) < 0.5
    assert len(FEATURES) == len(STILL_WEIGHTS) == len(TRACK_WEIGHTS)


def test_standard_deviation_grows_with_the_distance():
    lane = lane_with()
    assert lateral_std_m(lane, 0.0) == pytest.approx(np.hypot(0.02, 0.01))
    parts = [0.02, 0.02 / 2, 30 * 0.02 / 50, 30**2 / 2 * 0.02 / 500]
    assert lateral_std_m(lane, 30.0) == pytest.approx(np.sqrt(np.sum(np.square(parts))), rel=1e-3)


def test_confident_lanes_are_right_on_drives_not_seen_before():
    """Of those with more than 0.9 at least 95 %; the full check is `python tests/fit_confidence.py --check`."""
    small = CAMERA.scaled((640, 360))
    rows = [row for seed in range(3000, 3006) for row in drive_along(seed, small, seconds=1.6, fps=12.5)[0]]
    features, right = np.array(rows)[:, :-2], np.array(rows)[:, -2]
    confident = 1 / (1 + np.exp(-features @ TRACK_WEIGHTS)) > 0.9
    assert confident.sum() > 40
    assert right[confident].mean() >= 0.95
    assert right[~confident].mean() < right[confident].mean()
