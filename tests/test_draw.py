"""The lane drawn on a raw image: on its paint, no farther than the evidence, as its
confidence allows.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lanes.camera.model import Camera, CameraPose
from lanes.detect.lane import FOUND, Lane, LineEvidence
from lanes.show.draw import (
    COLOURS,
    RIBBON_M,
    SHOWN_HALF_WIDTH_M,
    STYLES,
    describe_lane,
    draw_lane,
    lane_outline,
    track_lane,
)
from lanes.tracking.tracker import LaneTracker
from tests.support.painted_drive import BENDS, SMALL, tracked_bends

IMAGE, LANE = tracked_bends()
NOT_SEEN = LineEvidence()


def log_odds(probability: float) -> float:
    return np.log(probability / (1 - probability))


def at(confidence: float, lane: Lane) -> Lane:
    """The same lane with another confidence."""
    shift = log_odds(confidence) - log_odds(lane.confidence)
    return replace(lane, confidence_shift=lane.confidence_shift + shift)


def seen_from(lane: Lane, start_m: float) -> Lane:
    left, right = (replace(line, start_m=start_m) for line in lane.evidence)
    return replace(lane, evidence=(left, right))


def seen_up_to(lane: Lane, left_m: float, right_m: float) -> Lane:
    left, right = lane.evidence
    left = replace(left, reach_m=left_m)
    return replace(lane, evidence=(left, replace(right, reach_m=right_m)))


def pixel_at(x_m: float, y_m: float) -> np.ndarray:
    return SMALL.road_to_pixels(np.array([[x_m, y_m]]))[0]


def row_at(x_m: float) -> float:
    """Row of the image in which the road is seen at a distance."""
    return pixel_at(x_m, 0.0)[1]


def draw(lane: Lane | None = LANE, **options: object) -> np.ndarray:
    """The lane drawn on a copy of the image."""
    return draw_lane(IMAGE, lane, SMALL, **options)


def top_px(outline: np.ndarray) -> float:
    return outline[:, 1].min()


def is_colour(image: np.ndarray, name: str) -> np.ndarray:
    difference = image.astype(int) - COLOURS[name]
    return np.abs(difference).max(axis=-1) <= 30


# Lines and area.


@pytest.mark.parametrize(
    ("side", "x_m"), [("left", 7.0), ("right", 7.0), ("left", 14.0)]
)
def test_a_ribbon_lies_on_the_paint_and_is_as_wide_as_a_strip_of_the_road(side, x_m):
    truth = BENDS.truth(3 / 25)
    number = ("left", "right").index(side)
    (y_m,) = truth.line_y(number, np.array([x_m]))
    left, row = pixel_at(x_m, y_m + RIBBON_M / 2)
    right, _ = pixel_at(x_m, y_m - RIBBON_M / 2)

    drawn = draw()

    across = np.flatnonzero(is_colour(drawn[round(row)], side))
    middle = (across.min() + across.max()) / 2
    assert middle == pytest.approx((left + right) / 2, abs=1.5)
    assert np.ptp(across) == pytest.approx(right - left, abs=2.5)


HIGH = CameraPose(3.0, pitch_rad=0.05)
LOW = CameraPose(0.9, pitch_rad=0.05)
CAMERAS = {
    "wide": Camera.from_fov((1280, 720), 60, HIGH),
    "portrait": Camera.from_fov((480, 768), 60, LOW),
}


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
@pytest.mark.parametrize(
    ("style", "inside"), [("lane", [70, 136, 97]), ("lines", [100, 100, 100])]
)
def test_the_lane_is_drawn_down_to_the_lower_border(camera, style, inside):
    width, height = camera.size
    lane = seen_from(LANE, 0.9)
    image = np.full((height, width, 3), 100, np.uint8)
    # the second half of a ribbon is its inner edge, from the far end on
    columns = []
    for ribbon in lane_outline(lane, camera).ribbons:
        u, v = ribbon[len(ribbon) // 2 :].T
        columns.append(np.interp(height - 1, v, u))
    left, right = columns

    drawn = draw_lane(image, lane, camera, style=style)

    row = drawn[-1].astype(int)
    red, _, blue = row.T
    # a line that leaves the image at its side does not reach the lower border
    assert (red - blue > 100).any() == (left > 0)
    assert (blue - red > 100).any() == (right < width)
    np.testing.assert_allclose(row[width // 2], inside, atol=2)


@pytest.mark.parametrize("start_m", [4.5, 9.0])
def test_nothing_is_drawn_on_the_bonnet(start_m):
    """What is nearer than the nearest marking that was ever seen is hidden."""
    first = round(row_at(start_m))

    lane = seen_from(LANE, start_m)

    drawn = draw(lane)

    np.testing.assert_array_equal(drawn[first + 3 :], IMAGE[first + 3 :])
    assert (drawn[first - 10] != IMAGE[first - 10]).any()


def begins_m(outline: np.ndarray) -> float:
    """Distance ahead of the lowest pixel of an outline."""
    lowest = outline[outline[:, 1].argmax()]
    return SMALL.pixels_to_road(lowest[None])[0, 0]


def started(left_m: float, right_m: float) -> Lane:
    """The lane whose lines have their nearest markings at these distances."""
    left, right = LANE.evidence
    left = replace(left, start_m=left_m)
    return replace(LANE, evidence=(left, replace(right, start_m=right_m)))


@pytest.mark.parametrize("starts_m", [(7.5, 5.0), (5.0, 7.5)])
def test_each_line_and_the_area_begin_where_the_bonnet_ends(starts_m):
    """From the side of the car, the bonnet hides one line farther than the other."""
    outline = lane_outline(started(*starts_m), SMALL)

    assert [begins_m(ribbon) for ribbon in outline.ribbons] == pytest.approx(
        starts_m, abs=0.3
    )
    is_left = outline.area[:, 0] < pixel_at(8.0, -0.3)[0]
    sides = [outline.area[is_left], outline.area[~is_left]]
    assert [begins_m(side) for side in sides] == pytest.approx(starts_m, abs=0.3)


@pytest.mark.parametrize(
    "lane",
    [started(5.0, 12.0), replace(started(5.0, 6.5), state=FOUND)],
    ids=["far dashes", "single image"],
)
def test_lines_begin_together_where_one_may_show_a_gap(lane):
    ribbons = lane_outline(lane, SMALL).ribbons
    assert [begins_m(ribbon) for ribbon in ribbons] == pytest.approx(
        [5.0, 5.0], abs=0.3
    )


def test_the_nearest_marking_that_was_seen_is_kept():
    assert 4.0 < min(line.start_m for line in LANE.evidence) < 6.5


def test_each_line_ends_with_its_evidence():
    outline = lane_outline(seen_up_to(LANE, 24.0, 14.0), SMALL)

    left, right = outline.ribbons
    assert top_px(left) == pytest.approx(row_at(24.0), abs=1.5)
    assert top_px(right) == pytest.approx(row_at(14.0), abs=1.5)


def test_the_area_ends_with_the_nearer_line():
    outline = lane_outline(seen_up_to(LANE, 24.0, 14.0), SMALL)
    assert top_px(outline.area) == pytest.approx(row_at(14.0), abs=1.5)


def test_there_is_no_area_where_one_line_ends_before_the_other_begins():
    lane = seen_up_to(started(4.5, 7.0), 6.0, 14.0)

    outline = lane_outline(lane, SMALL)

    assert not len(outline.area)
    assert all(len(ribbon) for ribbon in outline.ribbons)
    draw(lane)


def test_an_inferred_line_is_thin_and_ends_with_the_other_one():
    left, _ = seen_up_to(LANE, 24.0, 14.0).evidence
    inferred = replace(LANE, evidence=(left, NOT_SEEN))

    outline = lane_outline(at(0.9, inferred), SMALL)

    assert not len(outline.ribbons[1])
    assert not len(outline.thin[0])
    _, thin = outline.thin
    assert top_px(thin) == pytest.approx(row_at(24.0), abs=1.0)

    # as wide along its length, and not dotted
    drawn = draw(at(0.9, inferred), parts=["lines"])
    rows = slice(round(row_at(20.0)), round(row_at(8.0)))
    across = is_colour(drawn[rows], "right").sum(axis=1)
    assert 1 <= across.min() <= across.max() <= 6


def test_a_lane_without_any_line_seen_is_drawn():
    lane = replace(LANE, evidence=(NOT_SEEN, NOT_SEEN))
    assert draw(lane).shape == IMAGE.shape


# What the confidence decides.


@pytest.mark.parametrize("confidence", [0.95, 0.51, 0.49, 0.2, 0.1])
@pytest.mark.parametrize("x_m", [10.0, 16.0])
def test_only_a_likely_lane_is_filled(confidence, x_m):
    lane = at(confidence, LANE)
    assert lane.confidence == pytest.approx(confidence)
    column, row = np.round(pixel_at(x_m, -0.3)).astype(int)

    drawn = draw(lane)

    is_filled = (drawn[row, column] != IMAGE[row, column]).any()
    assert is_filled == (confidence > 0.5)


@pytest.mark.parametrize(
    ("confidence", "colour", "least", "most"),
    [
        # ribbons
        (0.95, "left", 0.9, 1.0),
        (0.51, "left", 0.9, 1.0),
        # dots
        (0.49, "uncertain", 0.5, 0.75),
        (0.2, "uncertain", 0.5, 0.75),
    ],
)
def test_a_likely_line_is_a_ribbon_and_others_are_dots(confidence, colour, least, most):
    drawn = draw(at(confidence, LANE))

    left_half = drawn[round(row_at(16.0)) : -5, : SMALL.width // 2]
    covered = is_colour(left_half, colour).any(axis=1).mean()
    assert least < covered <= most


@pytest.mark.parametrize("confidence", [0.95, 0.51, 0.49, 0.2])
def test_the_words_say_that_a_lane_is_uncertain(confidence):
    words = describe_lane(at(confidence, LANE))
    assert words[3].endswith("(uncertain)") == (confidence < 0.5)


@pytest.mark.parametrize("style", STYLES)
def test_a_lane_that_is_hardly_possible_is_drawn_as_none(style):
    unlikely = at(0.1, LANE)
    assert describe_lane(unlikely) == ["no lane"]
    np.testing.assert_array_equal(draw(unlikely, style=style), draw(None, style=style))


# What is asked for.


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (
            {"style": "lanes"},
            r"no style 'lanes'; the styles are lane, lines, inset, mosaic\.$",
        ),
        ({"parts": ["wheels"]}, "no part 'wheels'; the parts are area, lines"),
        (
            {"colours": {"middle": (0, 0, 0)}},
            "no colour 'middle'; the colours are area, left",
        ),
        ({"thickness": 0.0}, "give a thickness above 0"),
        ({"opacity": 1.5}, "an opacity from 0 to 1, not 1 and 1.5"),
    ],
)
def test_what_cannot_be_drawn_is_refused(options, words):
    with pytest.raises(ValueError, match=words):
        draw(**options)


class TestTheArea:
    column, row = np.round(pixel_at(10.0, -0.3)).astype(int)

    def test_shines_through_by_its_opacity(self):
        drawn = draw(parts=["area"])

        road = IMAGE[self.row, self.column]
        blended = 0.7 * road + 0.3 * np.array(COLOURS["area"])
        np.testing.assert_allclose(drawn[self.row, self.column], blended, atol=1)

    def test_has_the_colour_asked_for(self):
        drawn = draw(parts=["area"], opacity=1.0, colours={"area": (1, 2, 3)})
        assert drawn[self.row, self.column].tolist() == [1, 2, 3]

    def test_comes_without_lines_if_they_are_no_part(self):
        drawn = draw(parts=["area"])
        assert not is_colour(drawn, "left").any()


FAR = replace(LANE, far_evidence=(LineEvidence(0.5, True, 20.0),) * 2)


@pytest.mark.parametrize(
    ("lane", "part", "name"),
    [
        (LANE, "lines", "left"),
        (at(0.4, LANE), "lines", "uncertain"),
        (FAR, "far lines", "far left"),
        (FAR, "far lines", "far right"),
    ],
    ids=["ribbon", "dots", "far left", "far right"],
)
def test_lines_are_as_thick_as_asked_for(lane, part, name):
    thin = draw(lane, parts=[part])
    thick = draw(lane, parts=[part], thickness=3.0)

    thin_px = is_colour(thin, name).sum()
    assert thin_px > 0
    assert is_colour(thick, name).sum() > 2 * thin_px


@pytest.mark.parametrize("name", ["far left", "far right"])
def test_far_lines_are_drawn_up_to_their_evidence_on_their_side(name):
    drawn = draw(FAR, parts=["far lines"])

    rows, columns = np.nonzero(is_colour(drawn, name))
    assert rows.min() == pytest.approx(row_at(20.0), abs=3)
    assert (columns.mean() < SMALL.width / 2) == (name == "far left")


def test_the_panel_of_the_words_is_dark_and_transparent():
    drawn = draw(None)
    blended = 0.4 * IMAGE[2, 2] + 0.6 * 19
    np.testing.assert_allclose(drawn[2, 2], blended, atol=2)


def test_without_parts_nothing_is_drawn():
    drawn = draw(parts=[])
    np.testing.assert_array_equal(drawn, IMAGE)


# Styles.


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("lane", [LANE, None], ids=["found", "lost"])
def test_styles_keep_the_shape_of_the_image(style, lane):
    drawn = draw(lane, style=style)
    assert drawn.shape == IMAGE.shape
    assert drawn.dtype == np.uint8


@pytest.mark.parametrize("style", STYLES)
def test_styles_show_the_lost_state(style):
    found = draw(style=style)
    lost = draw(None, style=style)

    assert (lost != IMAGE).any()
    assert (found != lost).any(axis=2).mean() > 0.005


def mosaic_panel(number: int) -> np.ndarray:
    """A panel of the mosaic with lines up to 12 m, without its left border."""
    mosaic = draw(seen_up_to(LANE, 12.0, 12.0), style="mosaic")
    height, width = IMAGE.shape[:2]
    top = number * height // 3
    bottom = (number + 1) * height // 3
    return mosaic[top:bottom, 2 * width // 3 + 4 :].astype(int)


def test_the_mosaic_shows_the_fit_where_the_lines_are():
    """The lines of a lane of 3.6 m, seen 0.3 m left of its middle, near the car."""
    fit = mosaic_panel(2)

    red, green, blue = np.moveaxis(fit[-20:], -1, 0)
    left = np.flatnonzero((red - green > 80).any(axis=0))
    right = np.flatnonzero((blue - red > 80).any(axis=0))
    px_per_m = fit.shape[1] / (2 * SHOWN_HALF_WIDTH_M)
    middle_px = (SHOWN_HALF_WIDTH_M + 0.3) * px_per_m
    half_px = 1.8 * px_per_m
    assert np.median(left) == pytest.approx(middle_px - half_px, abs=6)
    assert np.median(right) == pytest.approx(middle_px + half_px, abs=6)


def test_a_line_of_the_mosaic_ends_with_its_evidence():
    fit = mosaic_panel(2)
    far_half = fit[: len(fit) // 2]
    assert not is_colour(far_half, "left").any()


def test_the_mosaic_shows_the_marking_response_in_grey():
    response = mosaic_panel(1)[30:-8]
    assert (np.ptp(response, axis=2) == 0).all()
    assert response.max() > 200


def test_the_inset_shows_the_lines_at_the_top_right():
    drawn = draw(seen_up_to(LANE, 12.0, 12.0), style="inset")
    height, width = IMAGE.shape[:2]
    top_right = drawn[: height // 3, -width // 6 :]
    assert is_colour(top_right, "left").any()


# Frames of other readers.


def read_only(frame: np.ndarray) -> np.ndarray:
    """As moviepy gives it."""
    frame = frame.copy()
    frame.flags.writeable = False
    return frame


def reversed_bgr(frame: np.ndarray) -> np.ndarray:
    """As a loop over cv2.VideoCapture may give it."""
    return np.ascontiguousarray(frame[..., ::-1])[..., ::-1]


def column_major(frame: np.ndarray) -> np.ndarray:
    return np.asfortranarray(frame)


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("form", [read_only, reversed_bgr, column_major])
def test_frames_of_other_readers_are_drawn_on_as_ours(form, style):
    def track(frame: np.ndarray) -> np.ndarray:
        process = track_lane(LaneTracker(SMALL, fps=25), style=style)
        drawn, _ = process(frame)
        return drawn

    frame = form(IMAGE)
    before = frame.copy()

    drawn = track(frame)

    np.testing.assert_array_equal(drawn, track(IMAGE.copy()))
    np.testing.assert_array_equal(frame, before)
