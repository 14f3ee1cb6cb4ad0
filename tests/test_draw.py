"""Overlay styles, and the function that tracks and draws frame by frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.paint import extract_evidence
from lanes.draw import STYLES, track_lane
from lanes.track.tracker import LOST, LaneTracker, TrackedLane
from tests.support.painted_drive import BENDS, SMALL, tracked_bends


@pytest.mark.parametrize("style", STYLES)
def test_styles_keep_the_picture_size_and_show_the_lost_state(style):
    image, result = tracked_bends()
    paint = STYLES[style](SMALL)
    drawn, lost = paint(image.copy(), result), paint(image.copy(), TrackedLane(LOST))
    assert (lost != image).any()
    assert drawn.shape == lost.shape == image.shape and drawn.dtype == np.uint8
    assert (drawn != lost).any(axis=2).mean() > 0.005


def test_lines_style_draws_on_the_paint_only():
    image, result = tracked_bends()
    drawn = STYLES["lines"](SMALL)(image.copy(), result)
    x = np.array([9.0, 14.0])
    truth = BENDS.truth(3 / 25)
    for side, channel in ((0, 0), (1, 2)):
        u, v = np.round(SMALL.road_to_pixels(np.column_stack([x, truth.line_y(side, x)]))).astype(int).T
        assert (drawn[v, u, channel] > drawn[v, u, 1] + 60).all()
    u, v = np.round(SMALL.road_to_pixels(np.array([[10.0, 0.0]]))[0]).astype(int)
    np.testing.assert_array_equal(drawn[v, u], image[v, u])


def test_mosaic_shows_fit_and_marking_response():
    image, result = tracked_bends()
    mosaic = STYLES["mosaic"](SMALL)(image, result)
    height, width = image.shape[:2]
    panels = [mosaic[i * height // 3 : (i + 1) * height // 3, 2 * width // 3 + 4 :].astype(int) for i in range(3)]
    response, fit = panels[1][30:-8], panels[2]
    # The panel is 18 m wide: the lines of a lane of 3.7 m, seen 0.3 m from its middle, near the car.
    rows, columns = fit[-20:], (9 + np.array([0.3 - 1.85, 0.3 + 1.85])) / 18 * fit.shape[1]
    red = np.flatnonzero((rows[:, :, 0] - rows[:, :, 1] > 80).any(axis=0))
    blue = np.flatnonzero((rows[:, :, 2] - rows[:, :, 0] > 80).any(axis=0))
    assert np.median(red) == pytest.approx(columns[0], abs=6) and np.median(blue) == pytest.approx(columns[1], abs=6)
    assert (np.ptp(response, axis=2) == 0).all() and response.max() > 200


def test_mosaic_shows_the_evidence_of_a_still():
    image, result = tracked_bends()
    view = BirdsEyeView(SMALL)
    evidence = extract_evidence(view.warp(image), view)
    unpainted = replace(evidence, response=replace(evidence.response, strength=0 * evidence.response.strength))
    height, width = image.shape[:2]
    response = np.s_[height // 3 + 30 : 2 * height // 3 - 8, 2 * width // 3 + 4 :]
    assert STYLES["mosaic"](SMALL)(image, result, evidence)[response].max() > 200
    assert STYLES["mosaic"](SMALL)(image, result, unpainted)[response].max() == 0


def test_track_lane_returns_picture_and_telemetry():
    process = track_lane(LaneTracker(SMALL), SMALL)
    drawn, row = process(BENDS.frame(0.0))
    assert (drawn != BENDS.frame(0.0)).any()
    assert (row["state"], row["departure"]) == ("searching", None)
    assert row["offset_m"] == pytest.approx(BENDS.truth(0.0).offset_m, abs=0.05)
    assert row["left_c0_m"] - row["right_c0_m"] == pytest.approx(row["lane_width_m"], abs=0.05)
    _, row = track_lane(LaneTracker(SMALL), SMALL)(np.zeros_like(drawn))
    assert (row["state"], row["confidence"], row["offset_m"], row["left_c3_per_m2"]) == ("lost", 0.0, None, None)
