"""The lane drawn on a raw image: on its paint, no farther than the evidence, as its confidence allows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lanes.camera import Camera, CameraPose
from lanes.detect.lane import Lane, LineEvidence
from lanes.draw import COLOURS, RIBBON_M, SHOWN_HALF_WIDTH_M, STYLES, describe_lane, draw_lane, lane_outline
from tests.support.painted_drive import BENDS, SMALL, tracked_bends


def at(confidence: float, lane: Lane) -> Lane:
    """The same lane with another confidence."""
    shift = np.log(confidence / (1 - confidence)) - np.log(lane.confidence / (1 - lane.confidence))
    return replace(lane, confidence_shift=lane.confidence_shift + shift)


def pixels_at(x_m: float | np.ndarray, y_m: float | np.ndarray) -> np.ndarray:
    return SMALL.road_to_pixels(np.column_stack(np.broadcast_arrays(x_m, y_m)))


def is_colour(image: np.ndarray, name: str) -> np.ndarray:
    return (np.abs(image.astype(int) - COLOURS[name]).max(axis=-1)) <= 30


@pytest.mark.parametrize(("side", "x_m"), [("left", 7.0), ("right", 7.0), ("left", 14.0)])
def test_a_ribbon_lies_on_the_paint_and_is_as_wide_as_a_strip_of_the_road(side, x_m):
    image, lane = tracked_bends()
    truth = BENDS.truth(3 / 25)
    y_m = truth.line_y(("left", "right").index(side), np.array([x_m]))[0]
    left_edge, right_edge = pixels_at(x_m, np.array([y_m + RIBBON_M / 2, y_m - RIBBON_M / 2]))
    middle_px = (left_edge[0] + right_edge[0]) / 2
    width_px = right_edge[0] - left_edge[0]

    drawn = draw_lane(image, lane, SMALL)

    across = np.flatnonzero(is_colour(drawn[round(left_edge[1])], side))
    assert (across.min() + across.max()) / 2 == pytest.approx(middle_px, abs=1.5)
    assert np.ptp(across) == pytest.approx(width_px, abs=2.5)


@pytest.mark.parametrize(("size", "height_m"), [((1280, 720), 3.0), ((480, 768), 0.9)], ids=["wide", "portrait"])
def test_the_lane_is_drawn_down_to_the_lower_border(size, height_m):
    lane = seen_from(tracked_bends()[1], 0.9)
    camera = Camera.from_fov(size, 60, CameraPose(height_m, pitch_rad=0.05))
    image = np.full((*size[::-1], 3), 100, np.uint8)
    for style, inside in (("lane", [70, 136, 97]), ("lines", [100, 100, 100])):
        row = draw_lane(image, lane, camera, style=style)[-1].astype(int)
        red, blue = row[:, 0] - row[:, 2] > 100, row[:, 2] - row[:, 0] > 100
        # the second half of a ribbon is its inner edge, from the far end on
        inner = (ribbon[len(ribbon) // 2 :] for ribbon in lane_outline(lane, camera).ribbons)
        left, right = (np.interp(size[1] - 1, edge[:, 1], edge[:, 0]) for edge in inner)
        # a line that leaves the image at its side does not reach the lower border
        assert red.any() == (left > 0) and blue.any() == (right < size[0])
        np.testing.assert_allclose(row[size[0] // 2], inside, atol=2)


def seen_from(lane: Lane, start_m: float) -> Lane:
    return replace(lane, evidence=tuple(replace(line, start_m=start_m) for line in lane.evidence))


@pytest.mark.parametrize("start_m", [4.5, 9.0])
def test_nothing_is_drawn_on_the_bonnet(start_m):
    """What is nearer than the nearest marking that was ever seen is hidden."""
    image, lane = tracked_bends()
    drawn = draw_lane(image, seen_from(lane, start_m), SMALL)
    first = round(pixels_at(start_m, 0.0)[0, 1])
    np.testing.assert_array_equal(drawn[first + 3 :], image[first + 3 :])
    assert (drawn[first - 10] != image[first - 10]).any()
    assert 4.0 < min(line.start_m for line in lane.evidence) < 6.5


def test_each_line_ends_with_its_evidence_and_the_area_with_the_nearer_one():
    image, lane = tracked_bends()
    left, right = lane.evidence
    lane = replace(lane, evidence=(replace(left, reach_m=24.0), replace(right, reach_m=14.0)))
    outline = lane_outline(lane, SMALL)
    for ribbon, end_m in zip(outline.ribbons, (24.0, 14.0), strict=True):
        assert ribbon[:, 1].min() == pytest.approx(pixels_at(end_m, 0.0)[0, 1], abs=1.5)
    assert outline.area[:, 1].min() == pytest.approx(pixels_at(14.0, 0.0)[0, 1], abs=1.5)
    # an inferred line ends with the other one, and is dotted
    inferred = replace(lane, evidence=(lane.evidence[0], LineEvidence()))
    outline = lane_outline(at(0.9, inferred), SMALL)
    assert not len(outline.ribbons[1]) and not len(outline.dotted[0])
    assert outline.dotted[1][:, 1].min() == pytest.approx(pixels_at(24.0, 0.0)[0, 1], abs=1.0)
    assert draw_lane(image, replace(lane, evidence=(LineEvidence(), LineEvidence())), SMALL).shape == image.shape


@pytest.mark.parametrize(
    ("confidence", "filled"), [(0.95, True), (0.51, True), (0.49, False), (0.2, False), (0.1, False)]
)
def test_the_confidence_decides_what_is_drawn(confidence, filled):
    """A likely lane is filled, and its lines are ribbons; others are dotted, without an area."""
    image, lane = tracked_bends()
    doubted = at(confidence, lane)
    assert doubted.confidence == pytest.approx(confidence)
    drawn = draw_lane(image, doubted, SMALL)
    (u, v), (far_u, far_v) = np.round(pixels_at(np.array([10.0, 16.0]), -0.3)).astype(int)
    assert (drawn[v, u] != image[v, u]).any() == (drawn[far_v, far_u] != image[far_v, far_u]).any() == filled
    name = "left" if filled else "uncertain"
    rows = is_colour(drawn[round(pixels_at(16.0, 0.0)[0, 1]) : -5, : SMALL.width // 2], name).any(axis=1)
    assert rows.mean() > 0.9 if filled else 0.05 < rows.mean() < 0.75 and (rows.mean() > 0.5) == (confidence > 0.15)
    # a lane that is hardly possible is a hint, and none in words
    words = describe_lane(doubted)
    assert words == ["no lane"] if confidence == 0.1 else words[3].endswith("(uncertain)") != filled


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"style": "lanes"}, r"no style 'lanes'; the styles are lane, lines, inset, mosaic\.$"),
        ({"parts": ["wheels"]}, "no part 'wheels'; the parts are area, lines"),
        ({"colours": {"middle": (0, 0, 0)}}, "no colour 'middle'; the colours are area, left"),
        ({"thickness": 0.0}, "give a thickness above 0"),
        ({"opacity": 1.5}, "an opacity from 0 to 1, not 1 and 1.5"),
    ],
)
def test_what_cannot_be_drawn_is_refused(options, words):
    image, lane = tracked_bends()
    with pytest.raises(ValueError, match=words):
        draw_lane(image, lane, SMALL, **options)


def test_colours_thickness_opacity_and_parts_are_those_asked_for():
    image, lane = tracked_bends()
    plain = draw_lane(image, lane, SMALL, parts=["area"])
    (u, v) = np.round(pixels_at(10.0, -0.3)[0]).astype(int)
    np.testing.assert_allclose(plain[v, u], 0.7 * image[v, u] + 0.3 * np.array(COLOURS["area"]), atol=1)
    strong = draw_lane(image, lane, SMALL, parts=["area"], opacity=1.0, colours={"area": (1, 2, 3)})
    assert strong[v, u].tolist() == [1, 2, 3]
    assert not is_colour(plain, "left").any()
    far = replace(lane, far_evidence=(LineEvidence(0.5, True, 20.0),) * 2)
    for of, name in ((lane, "left"), (at(0.4, lane), "uncertain"), (far, "far left"), (far, "far right")):
        parts = ["far lines" if of is far else "lines"]
        thin, thick = (is_colour(draw_lane(image, of, SMALL, parts=parts, thickness=t), name) for t in (1.0, 3.0))
        assert thick.sum() > 2 * thin.sum() > 0
        if of is far:
            assert thin.any(axis=1).argmax() == pytest.approx(pixels_at(20.0, 0.0)[0, 1], abs=3)
            assert (np.nonzero(thin)[1].mean() < SMALL.width / 2) == (name == "far left")
    np.testing.assert_allclose(draw_lane(image, None, SMALL)[2, 2], 0.4 * image[2, 2] + 0.6 * 19, atol=2)
    np.testing.assert_array_equal(draw_lane(image, lane, SMALL, parts=[]), image)


@pytest.mark.parametrize("style", STYLES)
def test_styles_keep_the_picture_size_and_show_the_lost_state(style):
    image, found = tracked_bends()
    drawn, lost = (draw_lane(image, lane, SMALL, style=style) for lane in (found, None))
    assert (lost != image).any()
    assert drawn.shape == lost.shape == image.shape and drawn.dtype == np.uint8
    assert (drawn != lost).any(axis=2).mean() > 0.005


def test_mosaic_shows_fit_and_marking_response():
    image, lane = tracked_bends()
    lane = replace(lane, evidence=tuple(replace(line, reach_m=12.0) for line in lane.evidence))
    mosaic, inset = (draw_lane(image, lane, SMALL, style=style) for style in ("mosaic", "inset"))
    height, width = image.shape[:2]
    panels = [mosaic[i * height // 3 : (i + 1) * height // 3, 2 * width // 3 + 4 :].astype(int) for i in range(3)]
    response, fit = panels[1][30:-8], panels[2]
    # the lines of a lane of 3.6 m, seen 0.3 m left of its middle, near the car
    half_m = SHOWN_HALF_WIDTH_M
    rows, columns = fit[-20:], (half_m + np.array([0.3 - 1.8, 0.3 + 1.8])) / (2 * half_m) * fit.shape[1]
    red = np.flatnonzero((rows[:, :, 0] - rows[:, :, 1] > 80).any(axis=0))
    blue = np.flatnonzero((rows[:, :, 2] - rows[:, :, 0] > 80).any(axis=0))
    assert np.median(red) == pytest.approx(columns[0], abs=6) and np.median(blue) == pytest.approx(columns[1], abs=6)
    assert is_colour(inset[: height // 3, -width // 6 :], "left").any()
    assert not is_colour(fit[: len(fit) // 2], "left").any()  # the line ends before the view
    assert (np.ptp(response, axis=2) == 0).all() and response.max() > 200
