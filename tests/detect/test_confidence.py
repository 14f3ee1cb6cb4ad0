"""The confidence: lower for doubtful lanes, and right about as often as it says on drives that it was not fitted on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lanes.detect.confidence import WEIGHTS
from lanes.detect.lane import FOUND, TRACKING, Lane, LineEvidence
from lanes.detect.road import CURVATURE
from lanes.detect.search import find_lane
from simulator.not_roads import KINDS, not_a_road
from tests.support.painted_drive import CAMERA
from tests.support.shapes import a_lane
from tools.fit_confidence import find_with_own_pose, logistic, samples_of_painted_drive


def lane_with() -> Lane:
    small = dict(rate=1e-7, pitch=1e-3, vertical=1e-5, rate_steps=1e-9, adjacent=1e-9)
    std = a_lane(centre=0.02, width=0.02, heading=4e-4, curvature=4e-5, **small)
    seen = LineEvidence(0.6, True, 40.0), LineEvidence(0.3, True, 40.0)
    model = a_lane(centre=0.1, width=3.6)
    return Lane(model, model, np.diag(np.square(std)), seen, score=1.0)


def test_a_line_with_little_paint_makes_a_lane_doubtful_whatever_the_other_one_shows():
    solid, guess = LineEvidence(0.9, True, 60.0), LineEvidence(0.01, False, 8.0)
    with_guess = (replace(lane_with(), evidence=lines).confidence for lines in ((solid, guess), (guess, solid)))
    assert max(with_guess) < 0.9 < 0.95 < lane_with().confidence


def test_a_lane_with_one_line_has_less_confidence_than_one_that_is_uncertain_far_ahead():
    """Without the other line the width is uncertain everywhere; in a bend both lines are certain near the car."""
    one_line, bend = lane_with().fit_covariance.copy(), lane_with().fit_covariance.copy()
    one_line[1, 1] = 0.5**2
    bend[CURVATURE, CURVATURE] = (0.25 / 450) ** 2
    one_line, bend = (replace(lane_with(), fit_covariance=matrix) for matrix in (one_line, bend))
    for state in (FOUND, TRACKING):
        good, doubtful, fair = (replace(lane, state=state).confidence for lane in (lane_with(), one_line, bend))
        assert good > 0.95 and doubtful < fair - 0.1


TURNED = a_lane(centre=0.1, width=3.6, heading=0.05)


@pytest.mark.parametrize(
    ("of", "change", "feature", "value"),
    [
        ({}, {"model": TURNED}, "odd heading", 0.6),
        # in a hairpin the car lags behind the road
        ({}, {"model": a_lane(centre=0.1, width=3.6, heading=0.05, curvature=0.03)}, "odd heading", 0.0),
        ({}, {"model": a_lane(centre=0.1, width=4.5)}, "odd width", None),
        ({"state": TRACKING}, {"model": TURNED}, "odd heading", 0.6),
        ({"state": TRACKING, "camera_yaw_rad": 0.01}, {"camera_yaw_rad": -0.04}, "odd heading", 0.6),
        ({"same_lane_share": 1.0}, {"same_lane_share": 0.3}, "other lanes", 0.7),
        ({}, {"clear_share": 0.5}, "between", np.log(0.5)),
        ({"state": TRACKING}, {"clear_share": 0.5}, "between", np.log(0.5)),
    ],
)
def test_what_makes_a_lane_doubtful(of, change, feature, value):
    """A pose or yaw that makes it odd, few poses that show it, lines between its own."""
    usual = replace(lane_with(), **of)
    odd = replace(usual, **change)
    if value is not None:
        assert (usual.features[feature], odd.features[feature]) == (0.0, pytest.approx(value))
    assert odd.confidence < usual.confidence - 0.005 or value == 0


def test_far_lines_support_a_lane_only_where_the_pose_comes_from_the_same_image():
    far = replace(lane_with(), far_evidence=(LineEvidence(0.3, True, 40.0), None))
    with_own_pose, without = (
        replace(far, same_lane_share=0.4, far_evidence=some) for some in (far.far_evidence, (None, None))
    )
    assert with_own_pose.confidence > without.confidence + 0.03
    assert far.confidence == lane_with().confidence


@pytest.mark.slow
def test_confident_lanes_are_right_on_drives_not_seen_before():
    """Of those with more than 0.9 at least 95 %; with a wrong camera pose few lanes have so much."""
    right, wrong = (_tracked(seeds, wrong) for seeds, wrong in ((range(3000, 3011), False), (range(3100, 3106), True)))
    sure = [is_right for confidence, is_right in right if confidence > 0.9]
    assert len(sure) > 40 and np.mean(sure) >= 0.95
    assert np.mean([is_right for _, is_right in wrong]) < 0.1
    assert np.mean([confidence > 0.9 for confidence, _ in wrong]) < 0.25


def _tracked(seeds: range, pose_is_wrong: bool) -> list[tuple[float, bool]]:
    """Confidence of every tracked lane in the painted drives of these seeds, and whether it is right."""
    camera, weights = CAMERA.scaled((640, 360)), np.array([*WEIGHTS.values()])
    drives = (samples_of_painted_drive(seed, camera, pose_is_wrong=pose_is_wrong)[0] for seed in seeds)
    return [(logistic(np.array([*one.features.values()]) @ weights), one.right) for some in drives for one in some]


def test_nothing_is_found_with_confidence_where_there_is_no_road():
    """44 pictures that the confidence was not fitted on."""
    lanes = [find_lane(not_a_road(kind, seed), CAMERA) for kind in KINDS for seed in range(100, 104)]
    confidences = [lane.confidence for lane in lanes if lane]
    assert len(confidences) > 10 and max(confidences) < 0.5


def test_nothing_is_found_with_confidence_where_the_pose_comes_from_the_same_picture_without_a_road():
    """Floors of tiles and rooms converge like a road, so that a pose is found."""
    pictures = [not_a_road(kind, seed) for kind in ("tiles", "room", "map") for seed in range(100, 103)]
    found = [(camera, lane) for camera, lane in map(find_with_own_pose, pictures) if camera]
    assert len(found) >= 5 and max(lane.confidence for _, lane in found if lane) < 0.5
