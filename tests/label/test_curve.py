"""The curve through clicked points: on the paint where there is some, through the points where there is none."""

from __future__ import annotations

from itertools import product

import cv2
import numpy as np
import pytest

from lanes.detect.lane import columns_at
from lanes.label import NO_POINT, fit_line, label_rows
from simulator.painted_drive import DASH_M
from simulator.rendering.drive import Motion
from simulator.road.geometry import RoadGeometry
from tests.support.labelling import choose_clicks, line_pixels
from tests.support.painted_drive import CAMERA, SMALL, PaintedDrive, lane_lines, s_bend, straight_road


def plain(*, height: int = 360, level: int = 100) -> np.ndarray:
    noise = np.random.default_rng(0).normal(level, 2, (height, height * 16 // 9, 3))
    return np.clip(noise, 0, 255).astype(np.uint8)


def arc(radius_m: float) -> RoadGeometry:
    bend, along_m = [0, 0, 1 / radius_m, 1 / radius_m, 0, 0], [30.0, 40.0, 40.0 + 3 * radius_m, 60.0 + 3 * radius_m]
    return RoadGeometry([0.0, *along_m, 2000.0], bend)


DASHED = {
    "straight": (straight_road(), 5.0),
    "bend of 200 m": (s_bend(200.0), 90.0),
    "S of 60 m": (s_bend(60.0, 20.0), 45.0),
    "hairpin of 25 m": (arc(25.0), 25.0),
}


@pytest.mark.parametrize("camera", [SMALL, CAMERA], ids=["360 rows", "720 rows"])
@pytest.mark.parametrize("name", DASHED)
def test_the_line_is_smooth_between_dashes_and_bends_with_the_road(name, camera):
    """A stiffness that is the same in all rows gives 1.2, 0.7, 5 and 2.4 px at 720 rows."""
    road, s_m = DASHED[name]
    lines = lane_lines(left={"dash_m": DASH_M, "phase_m": 1.0})
    drive = PaintedDrive(road, lines, motion=Motion(s_m, 10.0, offset_m=0.3), camera=camera)
    image, rows, away_px = drive.frame(0.0), label_rows(camera.height), []
    for seed, lateral_m in product(range(4), (1.8, -1.8)):
        got = fit_line(image, choose_clicks(drive, 0.0, lateral_m, np.random.default_rng(seed)))
        truth = columns_at(rows, [line_pixels(drive, 0.0, lateral_m)], camera)[0]
        across = (got - truth) / np.hypot(1, np.gradient(truth, rows))
        away_px.append(across[(got >= 0) & (truth >= 0)][1:-1])
    assert np.sqrt(np.mean(np.square(np.concatenate(away_px)))) < 0.6


def test_without_paint_the_points_decide_and_their_order_does_not():
    image, points = plain(), [[300.0, 200.0], [250.0, 250.0], [120.0, 350.0]]
    got, rows = fit_line(image, points), label_rows(360)
    assert rows.tolist() == list(range(80, 360, 5)) and label_rows(720).tolist() == list(range(160, 720, 10))
    assert np.array_equal(got, fit_line(image, points[::-1]))
    for column, row in points:
        assert got[rows == row] == pytest.approx(column, abs=3)
    assert (got[(rows < 195) | (rows > 355)] == NO_POINT).all() and (got[(rows >= 200) & (rows <= 350)] >= 0).all()


@pytest.mark.parametrize("shift_px, snapped", [(3, True), (25, False)])
def test_paint_is_reached_only_near_the_curve(shift_px, snapped):
    image = plain()
    cv2.line(image, (200 + shift_px, 0), (200 + shift_px, 359), (200, 200, 200), 5)
    got = fit_line(image, [[200, 230], [200, 350]])
    assert np.median(got[got >= 0]) == pytest.approx(203 if snapped else 200, abs=0.6)
