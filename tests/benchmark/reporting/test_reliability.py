"""Does the confidence keep its word: bins, intervals and precision, counted by hand."""

from __future__ import annotations

import numpy as np
import pytest

from benchmark.errors import FrameErrors
from benchmark.reporting.reliability import StatedLanes, wilson_interval


def lanes(confidence: list[float], right: list[bool], *, exists: list[bool] | None = None, lane_frames: int = 0):
    exists = [True] * len(right) if exists is None else exists
    return StatedLanes(np.array(confidence), np.array(right), np.array(exists), lane_frames or sum(exists))


def test_bins_hold_what_was_stated_and_how_often_it_was_right():
    bins = lanes([0.05, 0.41, 0.49, 0.93, 0.97, 1.0], [False, True, False, True, True, False]).reliability()
    assert bins.stated == pytest.approx([0.05, 0.45, 0.93, 0.985])
    assert bins.right == pytest.approx([0, 0.5, 1, 0.5])
    assert bins.count.tolist() == [1, 2, 1, 2]
    assert ((bins.low <= bins.right) & (bins.right <= bins.high)).all()


def test_an_honest_confidence_lies_on_the_diagonal():
    rng = np.random.default_rng(3)
    stated = rng.uniform(0, 1, 20000)
    bins = lanes(stated, rng.uniform(0, 1, 20000) < stated).reliability()
    assert np.abs(bins.right - bins.stated).max() < 0.03
    assert np.mean((bins.low < bins.stated) & (bins.stated < bins.high)) >= 0.8


def test_wilson_interval_is_that_of_the_textbook():
    # Newcombe, Statistics in Medicine 17 (1998), table I: 81 of 263, 15 of 148, 0 of 20, 1 of 29
    low, high = wilson_interval(np.array([81, 15, 0, 1]), np.array([263, 148, 20, 29]))
    assert low == pytest.approx([0.2553, 0.0624, 0.0, 0.0061], abs=5e-5)
    assert high == pytest.approx([0.3662, 0.1605, 0.1611, 0.1718], abs=5e-5)


def test_all_and_nothing_are_inside_their_intervals():
    count = np.arange(1, 300)
    assert (wilson_interval(count, count)[1] == 1).all()
    assert (wilson_interval(0 * count, count)[0] == 0).all()


def test_precision_falls_as_more_is_covered():
    curve = lanes([0.9, 0.99, 0.5, 0.9], [True, True, False, False], lane_frames=5).precision()
    assert curve.coverage == pytest.approx([0.2, 0.6, 0.8])
    assert curve.precision == pytest.approx([1, 2 / 3, 0.5])


def test_a_lane_where_there_is_none_covers_nothing_and_is_wrong():
    curve = lanes([0.9, 0.8], [False, True], exists=[False, True], lane_frames=1).precision()
    assert curve.coverage.tolist() == [0, 1]
    assert curve.precision.tolist() == [0, 0.5]


def test_only_given_lanes_state_something_and_right_is_up_to_30_m():
    nothing = np.zeros(4)
    errors = FrameErrors(
        exists=np.array([True, True, True, False]),
        given=np.array([True, True, False, True]),
        confident=np.zeros(4, bool),
        lateral_m=np.zeros((4, 5)),
        near_m=nothing,
        far_m=np.array([0.1, 0.3, np.nan, np.nan]),
        in_picture_m=nothing,
        offset_m=nothing,
        heading_rad=nothing,
        curvature_per_m=nothing,
        confidence=np.array([0.7, np.nan, np.nan, 0.2]),
        time_ms=nothing,
    )
    stated = StatedLanes.of([errors, errors])
    assert stated.confidence.tolist() == [0.7, 1, 0.2] * 2
    assert stated.right.tolist() == [True, False, False] * 2
    assert stated.lane_frames == 6
