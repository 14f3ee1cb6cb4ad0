"""The confidence: lower for doubtful lanes, and right about as often as it says on drives that it was not fitted on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lanes.detect.confidence import WEIGHTS, lane_features
from lanes.detect.lane import FOUND, TRACKING, Lane, LineEvidence
from lanes.detect.road import CURVATURE
from lanes.stills import find_lane
from simulator.not_roads import KINDS, not_a_road
from tests.support.painted_drive import CAMERA
from tests.support.shapes import a_lane
from tools.fit_confidence import logistic, samples_of_painted_drive
from tools.photos import find_with_own_pose


def lane_with(
    *, width_m: float = 3.6, std_m: float = 0.02, centre_m: float = 0.1, reach_m: tuple[float, float] = (40.0, 40.0)
) -> Lane:
    small = dict(rate=1e-7, pitch=1e-3, vertical=1e-5, rate_steps=1e-9, adjacent=1e-9)
    std = a_lane(centre=std_m, width=std_m, heading=std_m / 50, curvature=std_m / 500, **small)
    seen = LineEvidence(0.6, True, reach_m[0]), LineEvidence(0.3, True, reach_m[1])
    model = a_lane(centre=centre_m, width=width_m)
    return Lane(model, model, np.diag(np.square(std)), seen, score=1.0)


def rated(lane: Lane, *, tracked: bool = False) -> float:
    return replace(lane, state=TRACKING if tracked else FOUND).confidence


@pytest.mark.parametrize("tracked", [False, True])
def test_unusual_lanes_have_low_confidence(tracked):
    good = rated(lane_with(), tracked=tracked)
    assert good > 0.95
    for width_m in (4.5, 2.5):
        assert rated(lane_with(width_m=width_m), tracked=tracked) < 0.5
    assert rated(lane_with(std_m=0.4), tracked=tracked) < 0.5


def test_a_lane_with_one_line_has_less_confidence_than_one_that_is_uncertain_far_ahead():
    """Without the other line the width is uncertain everywhere; in a bend both lines are certain near the car."""
    one_line, bend = lane_with().fit_covariance.copy(), lane_with().fit_covariance.copy()
    one_line[1, 1] = 0.5**2
    bend[CURVATURE, CURVATURE] = (0.25 / 450) ** 2
    one_line, bend = (replace(lane_with(), fit_covariance=matrix) for matrix in (one_line, bend))
    for tracked in (False, True):
        assert rated(one_line, tracked=tracked) < rated(bend, tracked=tracked) - 0.1


TURNED = a_lane(centre=0.1, width=3.6, heading=0.05)


@pytest.mark.parametrize(
    ("of", "change", "feature", "value"),
    [
        ({}, {"model": TURNED}, "odd heading", 0.6),
        ({"state": TRACKING}, {"model": TURNED}, "odd heading", 0.6),
        ({"state": TRACKING, "camera_yaw_rad": 0.01}, {"camera_yaw_rad": -0.04}, "odd heading", 0.6),
        ({"same_lane_share": 1.0}, {"same_lane_share": 0.3}, "other lanes", 0.7),
        ({}, {"inlier_share": 0.15}, "clutter", np.log(0.15)),
        ({"state": TRACKING}, {"inlier_share": 0.15}, "clutter", np.log(0.15)),
        ({"same_lane_share": 1.0}, {"inlier_share": 0.15}, "clutter", np.log(0.15)),
        ({}, {"clear_share": 0.5}, "between", np.log(0.5)),
        ({"state": TRACKING}, {"clear_share": 0.5}, "between", np.log(0.5)),
    ],
)
def test_what_makes_a_lane_doubtful(of, change, feature, value):
    """A pose or yaw that makes it odd, few poses that show it, clutter, lines between its own."""
    usual = replace(lane_with(), **of)
    odd = replace(usual, **change)
    assert (lane_features(usual)[feature], lane_features(odd)[feature]) == (0.0, pytest.approx(value))
    assert odd.confidence < usual.confidence - 0.005


def test_in_a_hairpin_the_camera_lags_behind_the_road():
    lagging = replace(lane_with(), model=a_lane(centre=0.1, width=3.6, heading=0.05, curvature=0.03))
    assert lane_features(lagging)["odd heading"] == 0.0


@pytest.mark.slow
def test_confident_lanes_are_right_on_drives_not_seen_before():
    """Of those with more than 0.9 at least 95 %; the full check is `python -m tools.fit_confidence --check`."""
    samples = [_tracked_samples(range(3000, 3011)), _tracked_samples(range(3100, 3106), pose_is_wrong=True)]
    (confidence, right), (of_wrong_pose, right_with_wrong_pose) = samples
    assert (confidence > 0.9).sum() > 40
    assert right[confidence > 0.9].mean() >= 0.95
    # two to four degrees of pitch or yaw, or a quarter of the height
    assert right_with_wrong_pose.mean() < 0.1 and (of_wrong_pose > 0.9).mean() < 0.2


def _tracked_samples(seeds: range, *, pose_is_wrong: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Confidence, and whether it is correct, of every tracked lane in the drives of these seeds."""
    drives = (
        samples_of_painted_drive(seed, CAMERA.scaled((640, 360)), seconds=1.6, fps=12.5, pose_is_wrong=pose_is_wrong)
        for seed in seeds
    )
    rows = np.array([row for tracked, _ in drives for row in tracked])
    return logistic(rows[:, :-3] @ np.array([*WEIGHTS.values()])), rows[:, -3] > 0


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
