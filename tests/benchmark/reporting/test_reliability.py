"""Reliability diagram and precision curve: bins, intervals and precision, counted by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmark.errors import FrameErrors
from benchmark.reporting.reliability import AvailableLanes, describe_confidence
from benchmark.scores import Result


def some_lanes(
    confidence: list[float],
    correct: list[bool],
    *,
    exists: list[bool] | None = None,
    clusters: list[int] | None = None,
    lane_frames: int = 0,
):
    exists = [True] * len(correct) if exists is None else exists
    clusters = range(len(correct)) if clusters is None else clusters
    arrays = map(np.array, (confidence, correct, exists, clusters))
    return AvailableLanes(*arrays, lane_frames or sum(exists))


def test_bins_hold_mean_confidence_and_accuracy():
    bins = some_lanes([0.05, 0.41, 0.49, 0.93, 0.97, 1.0], [False, True, False, True, True, False]).reliability()
    assert bins.confidence == pytest.approx([0.05, 0.45, 0.93, 0.985])
    assert bins.accuracy == pytest.approx([0, 0.5, 1, 0.5])
    assert bins.counts.tolist() == [1, 2, 1, 2]
    assert ((bins.low <= bins.accuracy) & (bins.accuracy <= bins.high)).all()


def test_a_calibrated_confidence_lies_on_the_diagonal():
    rng = np.random.default_rng(3)
    confidence = rng.uniform(0, 1, 8000)
    bins = some_lanes(confidence, rng.uniform(0, 1, 8000) < confidence).reliability()
    assert np.abs(bins.accuracy - bins.confidence).max() < 0.03
    assert np.mean((bins.low < bins.confidence) & (bins.confidence < bins.high)) >= 0.8


def test_intervals_are_wider_if_the_lanes_of_a_drive_are_all_correct_or_all_wrong():
    confidence, correct = [0.93] * 200, [True] * 100 + [False] * 20 + [True] * 80
    alone, drives = (some_lanes(confidence, correct, clusters=c).reliability() for c in (None, np.arange(200) // 20))
    assert alone.accuracy == drives.accuracy == pytest.approx(0.9)
    assert drives.high[0] - drives.low[0] > 3 * (alone.high[0] - alone.low[0])


def test_summary_of_the_confidence_counted_by_hand():
    lanes = some_lanes([0.95, 0.9, 0.97, 0.8, 0.6, 0.3], [True, True, False, True, False, True])
    summary = lanes.summary()
    assert (summary.confident.share, summary.confident.lanes) == (pytest.approx(2 / 3), 3)
    assert (summary.likely.share, summary.likely.lanes) == (0.5, 2)
    assert summary.likely_confidence == pytest.approx(0.7)
    assert (summary.share_of_correct.share, summary.share_of_correct.lanes) == (0.5, 4)
    nothing = some_lanes([0.95], [True]).summary().cells()
    assert nothing == ["1", "100.0% (20-100)", "100.0% (20-100)", "0", "-", "-"]


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
    lanes = AvailableLanes.from_results([Result(name, "hard", "tracker", errors) for name in ("one", "two")])
    assert lanes.confidence.tolist() == [0.7, 1, 0.2] * 2
    assert lanes.correct.tolist() == [True, False, False] * 2
    assert lanes.clusters.tolist() == [0] * 3 + [1] * 3
    assert lanes.lane_frames == 6
    unstated = replace(errors, confidence=np.full(4, np.nan))
    table = describe_confidence([Result("one", "hard", "a", errors), Result("one", "hard", "b", unstated)])
    assert "hard, a" in table and "hard, b" not in table
