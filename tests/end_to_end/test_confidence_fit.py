"""The fit of the confidence's weights (`tools/fit_confidence.py`)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmark.errors import LaneTruth
from simulator.road.truth import truth_row
from tests.support.painted_drive import CAMERA, PaintedDrive, Stripe, s_bend
from tools.fit_confidence import cross_validated, fit_logistic, label_lanes, logistic


class TestTheFit:
    def test_weights_are_found_again(self):
        rng = np.random.default_rng(3)
        features = np.column_stack([np.ones(4000), rng.normal(0, 2, 4000)])
        right = rng.random(4000) < logistic(features @ [1.0, -2.0])
        np.testing.assert_allclose(fit_logistic(features, right, np.arange(4000)), [1.0, -2.0], atol=0.15)

    def test_long_drives_count_no_more_than_short_ones(self):
        features = np.ones((1010, 1))
        right, drive = np.repeat([True, False], [1000, 10]), np.repeat([0, 1], [1000, 10])
        assert fit_logistic(features, right, drive)[0] == pytest.approx(0.0, abs=1e-6)

    def test_a_drive_says_nothing_of_itself(self):
        """Each drive has a feature of its own that tells all: only to those who have seen the drive."""
        drive = np.repeat(np.arange(10), 20)
        right = drive % 2 == 0
        features = np.column_stack([np.ones(200), drive[:, None] == np.arange(10)])
        assert np.abs(cross_validated(features, right, drive) - 0.5).max() < 0.2
        assert np.abs(logistic(features @ fit_logistic(features, right, drive)) - right).max() < 0.2

    def test_lanes_are_judged_by_their_own_truth(self):
        drive = PaintedDrive(s_bend(), (Stripe(1.8), Stripe(-1.8)), camera=CAMERA.scaled((640, 360)))
        rows = [truth_row(drive.truth(i / 12.5), frame=i) for i in range(9)]
        truth = LaneTruth.from_columns({name: np.array([row[name] for row in rows], float) for name in rows[0]})
        frames = [drive.frame(i / 12.5) for i in range(9)]
        followed, alone = label_lanes(frames, drive.camera, truth, fps=12.5, number=7)
        assert [len(followed), len(alone)] == [9, 3]
        assert {row[-1] for row in followed + alone} == {7} and all(row[-3] for row in followed + alone)
        aside = replace(truth, lines_y_m=truth.lines_y_m + 0.3)
        assert not any(row[-3] for rows in label_lanes(frames, drive.camera, aside, fps=12.5, number=7) for row in rows)
