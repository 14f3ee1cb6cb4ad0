"""Results in one image: the lines and their standard deviations, against drawn lanes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lanes.camera.model import PoseStd
from lanes.detect.lane import LineEvidence
from lanes.detect.line_type import TypeVotes
from lanes.detect.road import SIDES, lateral_gradients, line_y, line_y_gradients
from lanes.telemetry import telemetry_row
from tests.support.painted_roads import dashcam
from tests.support.shapes import a_lane, found_lane

X_M = np.array([5.0, 10.0, 15.0, 20.0, 30.0])
STD = a_lane(
    centre=0.02,
    width=0.03,
    heading=2e-3,
    curvature=2e-4,
    rate=1e-5,
    pitch=5e-3,
    rate_steps=1e-5,
)
SEEN = (
    LineEvidence(
        0.6,
        True,
        25.0,
        votes=TypeVotes(
            3.0, 2.0, 30.0, 30.0, 30.0, 0.0, looks=3.0, white=0.0, yellow=2.7
        ),
    ),
    LineEvidence(
        0.3,
        True,
        30.0,
        votes=TypeVotes(
            3.0, 0.0, 30.0, 24.0, 6.0, 18.0, looks=3.0, white=3.0, yellow=0.0
        ),
    ),
)
BENT = found_lane(
    a_lane(centre=0.4, width=3.4, heading=-0.3, curvature=1 / 80, rate=-2e-4), STD, SEEN
)


@pytest.mark.parametrize(
    "curvature", [0.0, 1 / 300, -1 / 40], ids=["straight", "bend", "hairpin"]
)
def test_lateral_std_is_that_of_drawn_lanes(curvature):
    model = a_lane(
        centre=0.4, width=3.4, heading=-0.05, curvature=curvature, rate=curvature / 300
    )
    drawn = np.random.default_rng(2).normal(model, STD, (600, len(model)))
    expected = [
        np.std([line_y(X_M, lane, side) for lane in drawn], axis=0) for side in SIDES
    ]
    np.testing.assert_allclose(
        found_lane(model, STD).lateral_std_m(X_M), expected, rtol=0.1
    )
    np.testing.assert_allclose(
        lateral_gradients(X_M),
        [line_y_gradients(X_M, a_lane(), s) for s in SIDES],
        1e-4,
        1e-6,
    )


def test_the_stds_contain_those_of_an_estimated_pose():
    """A lane of 3.4 m seen 0.5 m left of its centre, from 1.5 m above the road."""
    camera = dashcam(1280, height_m=1.5)
    uncertain = replace(camera, pose_std=PoseStd(0.1, 0.02), lens_std_m=0.04)
    model = a_lane(centre=-0.5, width=3.4, curvature=1 / 500)
    lane = found_lane(model, STD, camera=uncertain)

    by_roll_m = 0.02 * (1.5 + 1.7**2 / 1.5)
    offset_std_m = np.linalg.norm([0.02, 0.1 * 0.5, by_roll_m, 0.04])
    assert lane.offset_std_m == pytest.approx(offset_std_m)
    assert lane.width_std_m == pytest.approx(np.linalg.norm([0.03, 0.34, 0.04]))
    assert lane.curvature_std_per_m == pytest.approx(np.hypot(2e-4, 0.1 / 500))
    assert lane.left.offset_std_m > lane.offset_std_m
    # a given pose counts as exact
    given = found_lane(model, STD, camera=camera)
    assert given.offset_std_m == pytest.approx(0.02)


def test_each_line_has_its_own_std():
    """Of two lines only the left one is known well: centre and width are correlated."""
    known, uncertain = 0.02, 0.3
    lane = found_lane(a_lane(width=3.4), STD)
    covariance = lane.fit_covariance.copy()
    lines = np.array([[1.0, 0.5], [1.0, -0.5]])
    of_lines = np.diag([known**2, uncertain**2])
    to_lane = np.linalg.inv(lines)
    covariance[:2, :2] = to_lane @ of_lines @ to_lane.T

    left, right = replace(lane, fit_covariance=covariance).lines
    ratio = uncertain / known
    assert right.offset_std_m == pytest.approx(ratio * left.offset_std_m, rel=0.01)
    for line in (left, right):
        assert line.offset_std_m == pytest.approx(float(line.std_m(0.0)), rel=0.01)


def test_the_roll_moves_a_lane_as_its_std_says():
    camera = dashcam(1280, height_m=1.5)
    pose = camera.require_pose()
    rolled = camera.with_pose(replace(pose, roll_rad=pose.roll_rad + 0.02))
    lines = np.array([[8.0, 1.7], [8.0, -1.7]])
    seen = rolled.pixels_to_road(camera.road_to_pixels(lines))
    by_roll_m = 0.02 * (1.5 + 1.7**2 / 1.5)
    assert abs(seen[:, 1].mean()) == pytest.approx(by_roll_m, rel=0.1)


@pytest.mark.parametrize(
    ("heading_std", "reach_m", "words"),
    [(0.001, 30.0, ""), (0.015, 15.0, " up to 15 m"), (0.1, 0.0, ", not to 0.2 m")],
)
def test_the_promise_ends_where_its_deviation_exceeds_it(heading_std, reach_m, words):
    std = a_lane(centre=0.02, width=0.03, heading=heading_std)
    lane = found_lane(a_lane(width=3.4), std)
    assert lane.confident_to_m == reach_m
    assert lane.describe_reach() == words
    assert lane.summary()["confidence"] == f"{lane.confidence:.0%}{words}"


def test_a_line_that_has_turned_back_has_no_position_and_no_std():
    left = found_lane(a_lane(curvature=1 / 24), STD).left
    np.testing.assert_array_equal(
        np.isnan(left.y(X_M)), [False, False, False, False, True]
    )
    np.testing.assert_array_equal(np.isnan(left.std_m(X_M)), np.isnan(left.y(X_M)))


def test_a_line_ends_where_it_runs_almost_along_the_rows():
    camera = dashcam(width=1280)
    lane = found_lane(a_lane(curvature=1 / 90), STD)
    rows = np.arange(300, 720)
    left = lane.columns(camera, rows)[0]
    given = np.flatnonzero(left >= 0)
    outline = lane.outlines(camera)[0]
    assert np.abs(np.diff(left[given])).max() <= 10
    assert (np.diff(given) == 1).all()
    assert rows[given[0]] - outline[-1, 1] >= 2  # the outline goes on
    np.testing.assert_allclose(
        left[given],
        np.interp(rows[given], outline[::-1, 1], outline[::-1, 0]),
        atol=1e-6,
    )


def test_coefficients_are_a_taylor_series_of_the_line_at_the_car():
    """y = c0 + c1 x + c2 x^2 / 2 + c3 x^3 / 6, from positions ahead of the car and
    behind it.
    """
    x = 4.0
    row = telemetry_row(BENT)
    for line, side in zip(BENT.lines, ("left", "right"), strict=True):
        behind, before, here, after, ahead = line.y(np.array([-x, -0.1, 0.0, 0.1, x]))
        c0, c1, c2, c3 = line.coefficients
        assert (c0, c1) == pytest.approx((here, (after - before) / 0.2), abs=1e-4)
        assert c2 * x**2 / 2 == pytest.approx((ahead + behind) / 2 - c0, rel=0.03)
        assert c3 * x**3 / 6 == pytest.approx((ahead - behind) / 2 - c1 * x, rel=0.15)
        assert [
            row[f"{side}_{name}"] for name in ("c0_m", "c1", "c2_per_m", "c3_per_m2")
        ] == [c0, c1, c2, c3]


def test_a_lane_and_its_lines_are_described_in_words():
    assert BENT.summary()["bend"] == "bends left, R 80 m (12.56 ± 0.20 per km)"
    assert (
        BENT.right.describe()
        == "1.36 ± 0.03 m right, white dashed, paint on 30% of its rows, up to 30 m"
    )
