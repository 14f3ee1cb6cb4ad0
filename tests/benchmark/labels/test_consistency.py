"""Stated uncertainty and confidence on labelled stills: lanes and labels drawn with known errors."""

from __future__ import annotations

import numpy as np
import pytest

from benchmark.consistency import z_summary
from benchmark.labels.stills import LABEL_STD_PX, StillCheck, all_z, check_lane, describe_checks, summarize_checks
from benchmark.labels.tusimple import NO_POINT, LaneColumns
from lanes.detect.lane import Lane, LineObservation
from lanes.detect.road import lines_on_view
from tests.support.painted_drive import CAMERA
from tests.support.shapes import a_lane

ROWS = np.arange(370.0, 700.0, 5.0)
TRUE = a_lane(centre=0.2, width=3.5, heading=0.02, curvature=1 / 400)
STD = a_lane(centre=0.05, width=0.04, heading=0.008, curvature=5e-4, rate=1e-9, pitch=1e-9, rate_steps=1e-12)
SEEN = (LineObservation(0.9, 40.0), LineObservation(0.9, 40.0))


AT_M, H = np.array([8.0, 15.0, 25.0]), CAMERA.pose.height_m


def lane_of(model: np.ndarray, covariance: np.ndarray = np.diag(STD**2)) -> Lane:  # noqa: B008
    return Lane(model, model, covariance, covariance, SEEN, score=1.0)


def label_of(model: np.ndarray, shift_px: np.ndarray | float = 0.0) -> LaneColumns:
    """The pixels of a lane, each line shifted by the error of the label."""
    columns = lane_of(model).pixels(CAMERA, ROWS)
    return LaneColumns("a", ROWS, np.where(columns >= 0, columns + np.reshape(shift_px, (-1, 1)), NO_POINT))


def drawn_checks(covariance: np.ndarray, *, stated: float = 1.0) -> list[StillCheck]:
    """Checks of lanes with drawn errors, against labels with drawn errors."""
    rng = np.random.default_rng(8)
    models = rng.multivariate_normal(TRUE, covariance, 300)
    labels = [label_of(TRUE, shift_px) for shift_px in rng.normal(0, LABEL_STD_PX, (300, 2))]
    lanes = [lane_of(model, stated**2 * covariance) for model in models]
    return [check_lane(lane, label, CAMERA) for lane, label in zip(lanes, labels, strict=True)]


def z_rms(z: np.ndarray) -> np.ndarray:
    """(3,) root mean squares of (N, 2, 3)."""
    assert np.isfinite(z).mean() > 0.95
    return np.sqrt(np.nanmean(z**2, axis=(0, 1)))


@pytest.mark.parametrize("stated", [1.0, 0.5])
def test_z_is_the_ratio_of_true_and_stated_std(stated):
    checks = drawn_checks(np.diag(STD**2), stated=stated)
    for name in ("z", "road_z"):
        rms = z_rms(all_z(checks, name))
        # with half the stated standard deviation; that of the label remains
        assert rms == pytest.approx(1, abs=0.1) if stated == 1 else ((rms > 1.4) & (rms < 2.1)).all()
    z = all_z(checks).ravel()
    assert stated < 1 or z_summary(z[np.isfinite(z)])["within_1"] == pytest.approx(0.68, abs=0.04)


def test_errors_of_the_pitch_are_not_in_the_picture_where_the_width_makes_up_for_them():
    """A pitch widens the lane in the picture. Errors of both cancel there, 15 m ahead."""
    pitch = a_lane(width=0.0, pitch=1e-3)
    left, right = (lines_on_view((TRUE + pitch)[None], AT_M, H)[0] - lines_on_view(TRUE[None], AT_M, H)[0])[:, 1]
    direction = 6 * (pitch + a_lane(width=right - left))
    checks = drawn_checks(np.diag(STD**2) + np.outer(direction, direction))
    assert z_rms(all_z(checks)) == pytest.approx(1, abs=0.1)
    assert z_rms(all_z(checks, "road_z"))[1] < 0.8


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
    checks = [StillCheck(nothing, nothing, 1, *pair) for pair in stated]
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
