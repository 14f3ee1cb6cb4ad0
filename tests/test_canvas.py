"""Lines, areas and text: positions, untouched pixels, and an unchanged input."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from lanes import canvas as draw
from tests.support.drawing import assert_draws_on_a_copy, gray_picture

LEFT = np.array([[60.0, 20.0], [20.0, 80.0]])
RIGHT = np.array([[100.0, 20.0], [140.0, 80.0]])


@pytest.fixture
def gray() -> np.ndarray:
    return gray_picture()


ALL = {
    "fill_lane": lambda p: draw.fill_lane(p, LEFT, RIGHT),
    "draw_line": lambda p: draw.draw_line(p, LEFT, colour=draw.LEFT_COLOUR),
    "write_text": lambda p: draw.write_text(p, ["R 640 m"]),
    "draw_mosaic": lambda p: draw.draw_mosaic(p, {"binary": p[..., 0], "warp": p}, lines=["x"]),
    "to_rgb": draw.to_rgb,
}


@pytest.mark.parametrize("name", ALL)
def test_every_function_draws_on_a_copy(name):
    assert_draws_on_a_copy(ALL[name])


class TestFillLane:
    def test_mixes_by_alpha_inside_and_nowhere_else(self, gray):
        drawn = draw.fill_lane(gray, LEFT, RIGHT, colour=(0, 200, 50), alpha=0.3)
        np.testing.assert_allclose(drawn[50, 80], [70, 130, 85], atol=1)
        changed = (drawn != gray).any(axis=2)
        assert not changed[:19].any() and not changed[82:].any() and not changed[:, :18].any()

    def test_edges_between_pixels(self, gray):
        """OpenCV's smooth edges reach out 0.7 px on each side; the area must not be more off than that."""
        left, right = np.array([[40.5, 20], [40.5, 60]]), np.array([[80.25, 20], [80.25, 60]])
        drawn = draw.fill_lane(gray, left, right, colour=(255, 255, 255), alpha=1.0)
        covered = (drawn[40, :, 0].astype(float) - 100) / 155
        assert covered.sum() == pytest.approx(80.25 - 40.5, abs=1.5)
        assert covered @ np.arange(160) / covered.sum() == pytest.approx((80.25 + 40.5) / 2, abs=0.2)
        assert len(np.unique(drawn[40])) > 2

    def test_rows_with_nan_are_dropped(self, gray):
        gap = np.insert(LEFT, 1, [np.nan, 50], axis=0)
        np.testing.assert_array_equal(draw.fill_lane(gray, gap, RIGHT), draw.fill_lane(gray, LEFT, RIGHT))

    @pytest.mark.parametrize("left", [np.empty((0, 2)), np.full((5, 2), np.nan), LEFT[:1]])
    def test_nothing_to_fill(self, gray, left):
        np.testing.assert_array_equal(draw.fill_lane(gray, left, RIGHT), gray)

    def test_points_far_outside(self, gray):
        drawn = draw.fill_lane(gray, [[-1e9, 40], [-1e9, 60]], [[1e9, 40], [1e9, 60]], alpha=1.0)
        np.testing.assert_array_equal(drawn[50], np.broadcast_to(draw.LANE_COLOUR, (160, 3)))
        np.testing.assert_array_equal(drawn[:39], gray[:39])


class TestDrawLine:
    @pytest.mark.parametrize("width_px", [1, 2.5, 4, 7, 8, 20, 50])
    def test_width_and_place(self, width_px):
        black = np.zeros((96, 160, 3), np.uint8)
        red = draw.draw_line(black, [[80, 10], [80, 90]], colour=(255, 0, 0), width_px=width_px)[50, :, 0] / 255
        assert red.sum() == pytest.approx(width_px, abs=1.3)
        assert red @ np.arange(160) / red.sum() == pytest.approx(80, abs=0.1)

    def test_fractions_of_a_pixel_show(self, gray):
        rows = [draw.draw_line(gray, [[x, 0], [x, 95]], colour=(255, 255, 255), width_px=3)[50] for x in (50, 50.5)]
        assert (rows[0] != rows[1]).any()


class TestWriteText:
    @pytest.mark.parametrize("size", [(1280, 720), (640, 360), (160, 96), (97, 41), (30, 12)])
    @pytest.mark.parametrize("corner", draw.CORNERS)
    def test_nothing_is_cut_off(self, size, corner):
        """Letters never touch the picture's edge, whatever the picture's size and the text's length."""
        image = np.full((*size[::-1], 3), 128, np.uint8)
        lines = ["bends right, R 640 m ± 20 m, and some more of it", "0.12 m left of centre", "gjpqy"]
        drawn = draw.write_text(image, lines, corner=corner, panel_alpha=0.0)
        changed = (drawn != image).any(axis=2)
        assert not any(edge.any() for edge in (changed[0], changed[-1], changed[:, 0], changed[:, -1]))
        rows, columns = np.nonzero(changed)
        if size[0] > 600:
            assert (rows.mean() < size[1] / 2, columns.mean() < size[0] / 2) == ("top" in corner, "left" in corner)

    @pytest.mark.parametrize("background", [0, 128, 255])
    def test_readable_on_any_background(self, background):
        """Contrast of letters and panel by WCAG 2.1 is at least 4.5, its limit for text."""
        drawn = draw.write_text(np.full((360, 640, 3), background, np.uint8), "R 640 m", size_px=40)
        value = drawn[4:50, 4:150].astype(float) / 255
        linear = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
        luminance = linear @ [0.2126, 0.7152, 0.0722]
        assert (luminance.max() + 0.05) / (np.median(luminance) + 0.05) >= 4.5

    def test_size_follows_the_picture(self):
        heights = []
        for height in (180, 720):
            image = np.zeros((height, height * 2, 3), np.uint8)
            rows = np.nonzero((draw.write_text(image, "R", panel_alpha=0) != image).any(axis=2))[0]
            heights.append(np.ptp(rows) + 1)
        assert heights[1] / heights[0] == pytest.approx(4, rel=0.15)

    def test_signs_beyond_ascii_are_drawn(self):
        image = np.zeros((60, 80, 3), np.uint8)
        pictures = [draw.write_text(image, sign, size_px=40) for sign in "?±°éΩ"]
        for one in range(5):
            for other in range(one):
                assert (pictures[one] != pictures[other]).any()

    def test_lines_do_not_overlap(self):
        image = np.zeros((200, 400, 3), np.uint8)
        drawn = draw.write_text(image, ["gpqy"] * 3, size_px=30, panel_alpha=0).max(axis=(1, 2)) > 40
        starts = np.flatnonzero(np.diff(drawn.astype(int)) == 1)
        assert len(starts) == 3

    def test_no_lines_and_an_unknown_corner(self, gray):
        np.testing.assert_array_equal(draw.write_text(gray, []), gray)
        with pytest.raises(ValueError, match="'middle'"):
            draw.write_text(gray, "x", corner="middle")


class TestMosaic:
    def test_thumbnails_stand_in_order_on_the_strip(self):
        image = np.full((720, 1280, 3), 200, np.uint8)
        colours = {"binary": (255, 0, 0), "warp": (0, 255, 0), "tall": (0, 0, 255)}
        shapes = {"binary": (360, 640, 3), "warp": (360, 640, 3), "tall": (600, 200, 3)}
        drawn = draw.draw_mosaic(image, {name: np.full(shapes[name], colours[name], np.uint8) for name in colours})
        np.testing.assert_array_equal(drawn[180:], image[180:])
        assert drawn[:180].mean() < 120
        rows, columns = zip(*(np.nonzero((drawn[:180] == c).all(axis=2)) for c in colours.values()), strict=True)
        assert [c.mean() for c in columns] == sorted(c.mean() for c in columns)
        # a tall view keeps its shape
        assert np.ptp(rows[2]) / np.ptp(columns[2]) == pytest.approx(3, rel=0.05)

    def test_masks_are_shown_black_and_white(self):
        image = np.full((720, 1280, 3), 90, np.uint8)
        mask = np.zeros((720, 1280), np.uint8)
        mask[:, 640:] = 1
        drawn = draw.draw_mosaic(image, {"binary": mask})
        strip = drawn[60:170]
        assert (strip == 255).all(axis=2).any() and (strip == 0).all(axis=2).any()

    def test_text_stays_on_the_strip_beside_the_thumbnails(self):
        image = np.zeros((720, 1280, 3), np.uint8)
        thumbnails = dict.fromkeys("abc", np.full((720, 1280, 3), 30, np.uint8))
        with_text = draw.draw_mosaic(image, thumbnails, lines=["R 640 m"])
        rows, columns = np.nonzero((with_text > 230).all(axis=2) & (np.arange(1280) > 760))
        assert rows.max() < 180 and columns.min() > 760 and len(rows) > 50


class TestToRgb:
    @pytest.mark.parametrize("mask", [np.eye(9, dtype=bool), np.eye(9, dtype=np.uint8)])
    def test_mask_to_rgb(self, mask):
        assert np.array_equal(draw.to_rgb(mask), cv2.merge([np.eye(9, dtype=np.uint8) * 255] * 3))

    def test_gray_to_rgb_keeps_its_levels(self):
        levels = np.array([[0, 1, 7, 255]], np.uint8)
        assert draw.to_rgb(levels)[0, :, 1].tolist() == [0, 1, 7, 255]
