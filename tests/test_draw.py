"""The lane drawn on a raw image: in the right place, no farther than the evidence, in three styles, words if lost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lanes.camera import Camera, CameraPose
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.confidence import LIKELY_CONFIDENCE
from lanes.detect.evidence import find_evidence
from lanes.detect.lane import LineEvidence
from lanes.draw import MOSAIC_HALF_WIDTH_M, STYLES, describe_lane, draw_lane, lane_outlines, track_lane
from lanes.errors import PictureError
from lanes.track.tracker import LaneTracker
from tests.support.painted_drive import BENDS, SMALL, tracked_bends
from tests.support.shapes import a_lane


def test_outlines_lie_on_the_paint():
    _, lane = tracked_bends()
    truth = BENDS.truth(3 / 25)
    for k, outline in enumerate(lane_outlines(lane, SMALL)):
        x = np.linspace(6, 30, 200)
        paint = SMALL.road_to_pixels(np.column_stack([x, truth.line_y(k, x)]))
        inside = outline[(outline[:, 1] < paint[0, 1]) & (outline[:, 1] > paint[-1, 1])]
        assert len(inside) > 5
        column = np.interp(inside[:, 1], paint[::-1, 1], paint[::-1, 0])
        np.testing.assert_allclose(inside[:, 0], column, atol=2.0)


@pytest.mark.parametrize("size", [(1280, 720), (480, 768)], ids=["wide", "portrait"])
@pytest.mark.parametrize("height_m", [0.9, 1.3, 3.0])
def test_the_lane_is_drawn_down_to_the_lower_border(size, height_m):
    _, lane = tracked_bends()
    camera = Camera.from_fov(size, 60, CameraPose(height_m, pitch_rad=0.05))
    image = np.full((*size[::-1], 3), 100, np.uint8)
    for style, inside in (("lane", [40, 136, 97]), ("lines", [100, 100, 100])):
        row = draw_lane(image, lane, camera, style=style)[-1].astype(int)
        red, blue = row[:, 0] - row[:, 2] > 100, row[:, 2] - row[:, 0] > 100
        left, right = (outline[outline[:, 1] >= size[1] - 1][-1, 0] for outline in lane_outlines(lane, camera))
        # a line that leaves the image at its side does not reach the lower border
        assert red.any() == (left > 0) and blue.any() == (right < size[0])
        np.testing.assert_allclose(row[size[0] // 2], inside, atol=32)


def test_outlines_end_with_the_evidence():
    _, lane = tracked_bends()
    reach_m = max(lane.left.reach_m, lane.right.reach_m)
    assert 25 < reach_m <= 70
    top = min(outline[:, 1].min() for outline in lane_outlines(lane, SMALL))
    horizon_row = SMALL.road_to_pixels(np.array([[1e5, 0.0]]))[0, 1]
    assert top > horizon_row + 4


def test_drawing_tints_the_lane_and_leaves_the_rest():
    image, lane = tracked_bends()
    kept = image.copy()
    drawn = draw_lane(image, lane, SMALL)
    np.testing.assert_array_equal(image, kept)
    u, v = np.round(SMALL.road_to_pixels(np.array([[10.0, -0.3]]))[0]).astype(int)
    assert drawn[v, u, 1] > drawn[v, u, 0] + 30
    u, v = np.round(SMALL.road_to_pixels(np.array([[10.0, -3.5]]))[0]).astype(int)
    np.testing.assert_array_equal(drawn[v, u], image[v, u])


def test_a_far_line_is_drawn_thinly_as_far_as_it_is_seen():
    image, lane = tracked_bends()
    lane = replace(lane, far_evidence=(None, None))
    far = replace(lane, far_evidence=(None, LineEvidence(0.2, True, 25.0)))
    changed = (draw_lane(image, far, SMALL) != draw_lane(image, lane, SMALL)).any(axis=2)
    x = np.array([12.0, 18.0, 24.0, 30.0])
    columns, rows = SMALL.road_to_pixels(np.column_stack([x, far.adjacent[1].y(x)])).T
    drawn = [
        np.flatnonzero(changed[row]) - column for column, row in zip(columns, rows.round().astype(int), strict=True)
    ]
    assert all(np.abs(across).min() < 2 for across in drawn[:3]) and not len(drawn[3])
    # a thin line that rises to the left: 2 px, many columns in a row
    assert changed.sum(axis=0).max() <= 5


def test_drawing_on_the_picture_itself_gives_the_same():
    image, lane = tracked_bends()
    own = image.copy()
    assert draw_lane(own, lane, SMALL, onto=own) is own
    np.testing.assert_array_equal(own, draw_lane(image, lane, SMALL))


def test_lost_draws_words_only():
    image, _ = tracked_bends()
    drawn = draw_lane(image, None, SMALL)
    assert describe_lane(None) == ["lane lost"]
    changed = np.argwhere((drawn != image).any(axis=2))
    assert len(changed) > 50
    assert changed[:, 0].max() < 60
    assert changed[:, 1].max() < 300


def test_words():
    _, lane = tracked_bends()
    bend, offset, types, state = describe_lane(lane)
    assert bend.startswith("bends left, R ")
    assert offset[:3] in ("0.2", "0.3") and offset.endswith("m left of centre") and "±" in offset
    assert types == "yellow solid | white dashed"
    assert state.startswith("tracking, confidence ")


def test_another_size_is_refused():
    _, lane = tracked_bends()
    with pytest.raises(PictureError, match="1280x720"):
        draw_lane(np.zeros((720, 1280, 3), np.uint8), lane, SMALL)


def test_the_area_of_an_uncertain_lane_is_orange():
    image, lane = tracked_bends()
    uncertain = replace(lane, inlier_share=0.001, model=lane.model + [0, 0.9, *np.zeros(13)])
    assert uncertain.confidence < LIKELY_CONFIDENCE < lane.confidence
    u, v = np.round(SMALL.road_to_pixels(np.array([[10.0, -0.3]]))[0]).astype(int)
    red, green, _ = draw_lane(image, uncertain, SMALL)[v, u].astype(int)
    assert red > green + 10
    assert describe_lane(uncertain)[3].endswith(" (uncertain)")
    red, green, _ = draw_lane(image, lane, SMALL)[v, u].astype(int)
    assert green > red + 30
    assert "(uncertain)" not in describe_lane(lane)[3]


def test_a_warning_that_is_due_is_in_words():
    _, lane = tracked_bends()
    due = replace(lane.departure, due=True, side="left", time_to_crossing_s=0.0)
    assert describe_lane(replace(lane, departure=due))[-1] == "lane departure: crossing the left line"


def test_an_unknown_style_is_refused():
    image, lane = tracked_bends()
    with pytest.raises(ValueError, match=r"no style 'lanes'; the styles are lane, lines, mosaic\.$"):
        draw_lane(image, lane, SMALL, style="lanes")


@pytest.mark.parametrize("style", STYLES)
def test_styles_keep_the_picture_size_and_show_the_lost_state(style):
    image, found = tracked_bends()
    drawn, lost = (draw_lane(image, lane, SMALL, style=style) for lane in (found, None))
    assert (lost != image).any()
    assert drawn.shape == lost.shape == image.shape and drawn.dtype == np.uint8
    assert (drawn != lost).any(axis=2).mean() > 0.005


def test_lines_style_draws_on_the_paint_only():
    image, lane = tracked_bends()
    drawn = draw_lane(image, lane, SMALL, style="lines")
    x = np.array([9.0, 14.0])
    truth = BENDS.truth(3 / 25)
    for side, channel in ((0, 0), (1, 2)):
        u, v = np.round(SMALL.road_to_pixels(np.column_stack([x, truth.line_y(side, x)]))).astype(int).T
        assert (drawn[v, u, channel] > drawn[v, u, 1] + 60).all()
    u, v = np.round(SMALL.road_to_pixels(np.array([[10.0, 0.0]]))[0]).astype(int)
    np.testing.assert_array_equal(drawn[v, u], image[v, u])


def test_mosaic_shows_fit_and_marking_response():
    image, lane = tracked_bends()
    mosaic = draw_lane(image, lane, SMALL, style="mosaic")
    height, width = image.shape[:2]
    panels = [mosaic[i * height // 3 : (i + 1) * height // 3, 2 * width // 3 + 4 :].astype(int) for i in range(3)]
    response, fit = panels[1][30:-8], panels[2]
    # the lines of a lane of 3.6 m, seen 0.3 m left of its middle, near the car
    half_m = MOSAIC_HALF_WIDTH_M
    rows, columns = fit[-20:], (half_m + np.array([0.3 - 1.8, 0.3 + 1.8])) / (2 * half_m) * fit.shape[1]
    red = np.flatnonzero((rows[:, :, 0] - rows[:, :, 1] > 80).any(axis=0))
    blue = np.flatnonzero((rows[:, :, 2] - rows[:, :, 0] > 80).any(axis=0))
    assert np.median(red) == pytest.approx(columns[0], abs=6) and np.median(blue) == pytest.approx(columns[1], abs=6)
    assert (np.ptp(response, axis=2) == 0).all() and response.max() > 200


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_mosaic_of_a_hairpin_leaves_out_rows_that_a_line_does_not_pass():
    """The lines turn back 15 m ahead; paint is said to reach 60 m. Where no line passes, nothing is drawn."""
    image, lane = tracked_bends()
    far = tuple(replace(line, reach_m=60.0) for line in lane.evidence)
    hairpin = replace(lane, model=a_lane(width=3.5, curvature=1 / 15), evidence=far)
    mosaic = draw_lane(image, hairpin, SMALL, style="mosaic").astype(int)
    height, width = image.shape[:2]
    fit = mosaic[2 * height // 3 : height, 2 * width // 3 + 4 :]
    red, blue = fit[..., 0] - fit[..., 2] > 100, fit[..., 2] - fit[..., 0] > 100
    assert red.any() and blue.any()
    assert not (red | blue)[: fit.shape[0] // 3].any()


def test_mosaic_shows_the_evidence_of_a_still():
    image, lane = tracked_bends()
    view = BirdsEyeView(SMALL)
    evidence = find_evidence(image, view)
    unpainted = replace(evidence, response=replace(evidence.response, strength=0 * evidence.response.strength))
    height, width = image.shape[:2]
    response = np.s_[height // 3 + 30 : 2 * height // 3 - 8, 2 * width // 3 + 4 :]
    assert draw_lane(image, lane, SMALL, style="mosaic", evidence=evidence)[response].max() > 200
    assert draw_lane(image, lane, SMALL, style="mosaic", evidence=unpainted)[response].max() == 0


def test_track_lane_returns_picture_and_telemetry():
    process = track_lane(LaneTracker(SMALL))
    drawn, row = process(BENDS.frame(0.0))
    assert (drawn != BENDS.frame(0.0)).any()
    assert (row["state"], row["departure"]) == ("tracking", None)
    assert row["offset_m"] == pytest.approx(BENDS.truth(0.0).offset_m, abs=0.05)
    assert row["left_c0_m"] - row["right_c0_m"] == pytest.approx(row["lane_width_m"], abs=0.05)
    _, row = track_lane(LaneTracker(SMALL))(np.zeros_like(drawn))
    assert (row["state"], row["confidence"], row["offset_m"], row["left_c3_per_m2"]) == ("lost", 0.0, None, None)
