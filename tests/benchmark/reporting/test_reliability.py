"""Reliability diagram and precision curve: bins, intervals and precision, counted by hand."""

from __future__ import annotations

import numpy as np
import pytest

from benchmark.errors import FrameErrors
from benchmark.reporting.reliability import AvailableLanes, wilson_interval


def some_lanes(confidence: list[float], correct: list[bool], *, exists: list[bool] | None = None, lane_frames: int = 0):
    exists = [True] * len(correct) if exists is None else exists
    return AvailableLanes(np.array(confidence), np.array(correct), np.array(exists), lane_frames or sum(exists))


def test_bins_hold_mean_confidence_and_accuracy():
    bins = some_lanes([0.05, 0.41, 0.49, 0.93, 0.97, 1.0], [False, True, False, True, True, False]).reliability()
    assert bins.confidence == pytest.approx([0.05, 0.45, 0.93, 0.985])
    assert bins.accuracy == pytest.approx([0, 0.5, 1, 0.5])
    assert bins.counts.tolist() == [1, 2, 1, 2]
    assert ((bins.low <= bins.accuracy) & (bins.accuracy <= bins.high)).all()


def test_a_calibrated_confidence_lies_on_the_diagonal():
    rng = np.random.default_rng(3)
    confidence = rng.uniform(0, 1, 20000)
    bins = some_lanes(confidence, rng.uniform(0, 1, 20000) < confidence).reliability()
    assert np.abs(bins.accuracy - bins.confidence).max() < 0.03
    assert np.mean((bins.low < bins.confidence) & (bins.confidence < bins.high)) >= 0.8


def test_wilson_interval_is_that_of_the_textbook():
    # Newcombe, Statistics in Medicine 17 (1998), table I: 81 of 263, 15 of 148, 0 of 20, 1 of 29
    low, high = wilson_interval(np.array([81, 15, 0, 1]), np.array([263, 148, 20, 29]))
    assert low == pytest.approx([0.2553, 0.0624, 0.0, 0.0061], abs=5e-5)
    assert high == pytest.approx([0.3662, 0.1605, 0.1611, 0.1718], abs=5e-5)


def test_shares_of_0_and_1_are_inside_their_intervals():
    count = np.arange(1, 300)
    assert (wilson_interval(count, count)[1] == 1).all()
    assert (wilson_interval(0 * count, count)[0] == 0).all()


def test_precision_falls_as_more_lanes_are_used():
    curve = some_lanes([0.9, 0.99, 0.5, 0.9], [True, True, False, False], lane_frames=5).precision_curve()
    assert curve.available == pytest.approx([0.2, 0.6, 0.8])
    assert curve.precision == pytest.approx([1, 2 / 3, 0.5])


def test_a_lane_where_none_exists_is_wrong_and_does_not_count_as_available():
    curve = some_lanes([0.9, 0.8], [False, True], exists=[False, True], lane_frames=1).precision_curve()
    assert curve.available.tolist() == [0, 1]
    assert curve.precision.tolist() == [0, 0.5]


def test_only_available_lanes_count_and_correct_is_up_to_30_m():
    nothing = np.zeros(4)
    errors = FrameErrors(
        exists=np.array([True, True, True, False]),
        available=np.array([True, True, False, True]),
        confident=np.zeros(4, bool),
        lateral_m=np.zeros((4, 5)),
        near_rms_m=nothing,
        full_rms_m=np.array([0.1, 0.3, np.nan, np.nan]),
        in_picture_rms_m=nothing,
        offset_m=nothing,
        heading_rad=nothing,
        curvature_per_m=nothing,
        confidence=np.array([0.7, np.nan, np.nan, 0.2]),
        time_ms=nothing,
    )
    lanes = AvailableLanes.from_errors([errors, errors])
    assert lanes.confidence.tolist() == [0.7, 1, 0.2] * 2
    assert lanes.correct.tolist() == [True, False, False] * 2
    assert lanes.lane_frames == 6
