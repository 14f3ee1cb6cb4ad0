import numpy as np
import pytest

from lanes.detect.road import CENTRE, CURVATURE, HEADING, LEFT_SIDE, RIGHT_SIDE, line_y
from lanes.detect.votes import BIN_CENTRES_M, HYPOTHESES, VOTING, best_pairs, count_votes, suppress_non_maxima
from tests.support.shapes import a_lane
from tests.tracking.test_fitting import HEIGHT_M, ROADS, stripes_on

ROWS = 67


def test_hypotheses_are_symmetric_and_reach_hairpins():
    guess = HYPOTHESES
    mirrored = guess * [-1, -1, 1]
    assert {tuple(g.round(9)) for g in guess} == {tuple(g.round(9) + 0.0) for g in mirrored}
    assert np.abs(guess[:, 1]).max() > 1 / 15


def test_a_line_piles_up_in_the_bin_of_its_distance():
    # a straight line 1.9 m to the left, seen by the hypothesis of a straight road
    stripes = stripes_on(a_lane(width=3.8), (LEFT_SIDE,), noise_m=0.0)
    votes = count_votes(stripes, HEIGHT_M)
    straight = votes[np.flatnonzero((HYPOTHESES == 0).all(axis=1))[0]]
    assert BIN_CENTRES_M[straight.argmax()] == pytest.approx(1.9, abs=VOTING.bin_m / 2)
    assert straight.max() > 0.95 * straight.sum() > 0.5 * (stripes.x_m < VOTING.far_m).sum()


def test_stripes_of_other_directions_have_no_votes():
    stripes = stripes_on(a_lane(width=3.8), (LEFT_SIDE,), noise_m=0.0)
    turned = type(stripes)(**{**vars(stripes), "angle": stripes.angle + 0.5})
    straight = np.flatnonzero((HYPOTHESES == 0).all(axis=1))[0]
    assert count_votes(turned, HEIGHT_M)[straight].sum() < 0.01 * count_votes(stripes, HEIGHT_M)[straight].sum()


@pytest.mark.parametrize("road", ROADS.values(), ids=ROADS.keys())
def test_one_of_the_best_pairs_is_near_the_lane(road):
    lanes = best_pairs(count_votes(stripes_on(road, outliers=200), HEIGHT_M), ROWS)
    x = np.array([6.0, 9.0, 12.0])
    errors = [
        max(np.abs(line_y(x, lane, side) - line_y(x, road, side)).max() for side in (LEFT_SIDE, RIGHT_SIDE))
        for lane in lanes
    ]
    assert 0 < len(lanes) <= VOTING.lanes
    assert min(errors) < 0.5


def test_non_maximum_suppression_removes_duplicates():
    lanes = np.tile(a_lane(), (4, 1))
    lanes[1, CENTRE], lanes[2, HEADING], lanes[3, CURVATURE] = 0.6, 0.02, 0.01
    kept = suppress_non_maxima(lanes, 3)
    np.testing.assert_array_equal(kept, lanes[[0, 1, 3]])
    assert len(suppress_non_maxima(lanes, 2)) == 2
    nodding = a_lane(centre=0.1, width=3.6, pitch=0.01)
    both = np.stack([a_lane(centre=0.1, width=3.6), nodding])
    assert len(suppress_non_maxima(both, 2)) == 1 and len(suppress_non_maxima(both, 2, same_pitch_rad=0.008)) == 2
