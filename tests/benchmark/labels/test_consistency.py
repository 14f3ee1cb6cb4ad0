"""Stated uncertainty and confidence on labelled stills: lanes and labels drawn with known errors."""

from __future__ import annotations

import numpy as np
import pytest

from benchmark.consistency import z_summary
from benchmark.labels.consistency import LABEL_STD_PX, StillCheck, all_z, check_lane, describe_checks, summarize_checks
from benchmark.labels.tusimple import NO_POINT, LaneColumns
from lanes.tracking.lane import Lane, LineObservation
from tests.support.painted_drive import CAMERA
from tests.support.shapes import a_lane

ROWS = np.arange(370.0, 700.0, 5.0)
TRUE = a_lane(centre=0.2, width=3.5, heading=0.02, curvature=1 / 400)
STD = a_lane(centre=0.05, width=0.04, heading=0.008, curvature=5e-4, rate=1e-9, pitch=1e-9, rate_steps=1e-12)
SEEN = (LineObservation(0.9, 40.0), LineObservation(0.9, 40.0))


def lane_of(model: np.ndarray, *, stated: float = 1.0) -> Lane:
    covariance = np.diag((stated * STD) ** 2)
    return Lane(model, model, covariance, covariance, SEEN, score=1.0, margin=1.0)


def label_of(model: np.ndarray, shift_px: np.ndarray | float = 0.0) -> LaneColumns:
    """The pixels of a lane, each line shifted by the error of the label."""
    columns = lane_of(model).pixels(CAMERA, ROWS)
    return LaneColumns("a", ROWS, np.where(columns >= 0, columns + np.reshape(shift_px, (-1, 1)), NO_POINT))


@pytest.mark.parametrize("stated", [1.0, 0.5])
def test_z_is_the_ratio_of_true_and_stated_std(stated):
    rng = np.random.default_rng(8)
    checks = [
        check_lane(
            lane_of(rng.normal(TRUE, STD), stated=stated), label_of(TRUE, rng.normal(0, LABEL_STD_PX, 2)), CAMERA
        )
        for _ in range(300)
    ]
    z = all_z(checks)
    assert np.isfinite(z).mean() > 0.95
    for k in range(3):
        summary = z_summary(z[:, :, k][np.isfinite(z[:, :, k])])
        # half the stated standard deviation; that of the label remains
        assert summary["z_rms"] == pytest.approx(1, abs=0.1) if stated == 1 else 1.4 < summary["z_rms"] < 2.1
        assert stated < 1 or summary["within_1"] == pytest.approx(0.68, abs=0.07)


def test_another_line_and_missing_labels_are_left_out():
    far = check_lane(lane_of(TRUE), label_of(TRUE + a_lane(centre=1.5, width=0.0)), CAMERA)
    assert np.isnan(far.z).all() and far.other_lines == 6 and far.right is False
    label = label_of(TRUE)
    label.columns[0] = NO_POINT
    one = check_lane(lane_of(TRUE), label, CAMERA)
    assert np.isnan(one.z[0]).all() and np.abs(one.z[1]).max() < 0.01 and one.right
    label.columns[1] = NO_POINT
    assert check_lane(lane_of(TRUE), label, CAMERA).right is None


def test_right_lanes_are_counted_by_confidence():
    nothing = np.full((2, 3), np.nan)
    stated = [(0.95, True), (0.9, True), (0.99, False), (0.7, True), (0.5, False), (0.2, True), (0.95, None)]
    checks = [StillCheck(nothing, 1, *pair) for pair in stated]
    lines = describe_checks(checks).splitlines()
    cells = {" ".join(line.split()[:-3]): line.split()[-3:] for line in lines if " of " in line}
    assert {name: f"{a}/{b}" for name, (a, _, b) in list(cells.items())[:4]} == {
        "confidence 0.9 or more": "2/3",
        "confidence 0.5 to 0.9": "1/2",
        "confidence below 0.5": "1/1",
        "right lanes with 0.9 or more": "2/4",
    }
    assert "left out, error above 1 m: 7" in lines
    assert summarize_checks(checks).endswith("0.9 or more: 2 of 3 right, 2 of 4 of the right lanes")
