"""The tracked lane on the raw picture: in the right place, no farther than the evidence, nothing when lost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lanes.draw import describe_tracked, draw_found, draw_tracked, lane_outlines
from lanes.errors import PictureError
from lanes.stills import find_lane
from lanes.track.tracker import LOST, TrackedLane
from tests.support.painted_drive import BENDS, SMALL, tracked_bends


def test_outlines_lie_on_the_paint():
    _, result = tracked_bends()
    truth = BENDS.truth(3 / 25)
    for k, outline in enumerate(lane_outlines(result.lane, SMALL)):
        x = np.linspace(6, 30, 200)
        paint = SMALL.road_to_pixels(np.column_stack([x, truth.line_y(k, x)]))
        inside = outline[(outline[:, 1] < paint[0, 1]) & (outline[:, 1] > paint[-1, 1])]
        assert len(inside) > 5
        column = np.interp(inside[:, 1], paint[::-1, 1], paint[::-1, 0])
        np.testing.assert_allclose(inside[:, 0], column, atol=2.0)


def test_outlines_end_with_the_evidence():
    _, result = tracked_bends()
    reach_m = max(result.lane.left.reach_m, result.lane.right.reach_m)
    assert 25 < reach_m <= 70
    top = min(outline[:, 1].min() for outline in lane_outlines(result.lane, SMALL))
    horizon_row = SMALL.road_to_pixels(np.array([[1e5, 0.0]]))[0, 1]
    assert top > horizon_row + 4


def test_drawing_tints_the_lane_and_leaves_the_rest():
    image, result = tracked_bends()
    kept = image.copy()
    drawn = draw_tracked(image, result, SMALL)
    np.testing.assert_array_equal(image, kept)
    u, v = np.round(SMALL.road_to_pixels(np.array([[10.0, -0.3]]))[0]).astype(int)
    assert drawn[v, u, 1] > drawn[v, u, 0] + 30
    u, v = np.round(SMALL.road_to_pixels(np.array([[10.0, -3.5]]))[0]).astype(int)
    np.testing.assert_array_equal(drawn[v, u], image[v, u])


def test_read_only_pictures_are_welcome():
    image, result = tracked_bends()
    assert not image.flags.writeable
    assert draw_tracked(image, result, SMALL).flags.writeable


def test_drawing_on_the_picture_itself_gives_the_same():
    image, result = tracked_bends()
    own = image.copy()
    assert draw_tracked(own, result, SMALL, onto=own) is own
    np.testing.assert_array_equal(own, draw_tracked(image, result, SMALL))


def test_lost_draws_words_only():
    image, _ = tracked_bends()
    drawn = draw_tracked(image, TrackedLane(LOST), SMALL)
    assert describe_tracked(TrackedLane(LOST)) == ["lane lost"]
    changed = np.argwhere((drawn != image).any(axis=2))
    assert len(changed) > 50
    assert changed[:, 0].max() < 60
    assert changed[:, 1].max() < 300


def test_words():
    _, result = tracked_bends()
    bend, offset, state = describe_tracked(result)
    assert bend.startswith("bends left, R ")
    assert offset.endswith("m left of centre")
    assert offset.startswith("0.3")
    assert "±" in offset
    assert state.startswith("tracking, confidence ")


def test_another_size_is_refused():
    _, result = tracked_bends()
    with pytest.raises(PictureError, match="1280x720"):
        draw_tracked(np.zeros((720, 1280, 3), np.uint8), result, SMALL)


def test_a_single_picture_is_drawn_with_its_confidence_or_said_to_be_lost():
    image, _ = tracked_bends()
    lane = find_lane(image, SMALL)
    assert (draw_found(image, lane, SMALL) != image).any(axis=2).mean() > 0.1
    lost = draw_found(image, None, SMALL)
    np.testing.assert_array_equal(lost[120:], image[120:])


def test_the_area_of_an_unlikely_lane_is_orange():
    image, result = tracked_bends()
    likely = TrackedLane.from_still(find_lane(image, SMALL))
    unlikely = TrackedLane.from_still(replace(likely.lane, clear_share=0.02))
    assert unlikely.confidence < 0.5 < likely.confidence
    u, v = np.round(SMALL.road_to_pixels(np.array([[10.0, -0.3]]))[0]).astype(int)
    red, green, _ = draw_tracked(image, unlikely, SMALL)[v, u].astype(int)
    assert red > green + 10
    assert describe_tracked(unlikely)[2].endswith(" (unlikely)")
    red, green, _ = draw_tracked(image, likely, SMALL)[v, u].astype(int)
    assert green > red + 30
    assert "(unlikely)" not in describe_tracked(likely)[2]
