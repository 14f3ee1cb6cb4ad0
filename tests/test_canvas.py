"""Lines, areas and text: positions, untouched pixels, and an unchanged input."""

from __future__ import annotations

import numpy as np
import pytest

from lanes.canvas import blend_polygon, draw_dots, draw_polyline, line_height, put_text, text_size
from lanes.images import to_rgb
from tests.support.drawing import assert_draws_on_a_copy, gray_picture

WHITE = (255, 255, 255)


def blended(corners: list[list[float]], colour: tuple[int, int, int], alpha: float) -> np.ndarray:
    image = gray_picture()
    blend_polygon(image, np.array(corners), colour, alpha)
    return image


def test_a_polygon_is_mixed_by_alpha_inside_and_nowhere_else():
    drawn = blended([[60, 20], [20, 80], [140, 80], [100, 20]], (0, 200, 50), 0.3)
    np.testing.assert_allclose(drawn[50, 80], [70, 130, 85], atol=1)
    changed = (drawn != gray_picture()).any(axis=2)
    assert not changed[:19].any() and not changed[82:].any() and not changed[:, :18].any()
    wide = blended([[-1e9, 40], [-1e9, 60], [1e9, 60], [1e9, 40]], WHITE, 1.0)
    assert (wide[50] == 255).all() and (wide[:39] == 100).all()


@pytest.mark.parametrize("width_px", [1, 2.5, 4, 7, 8, 20, 50])
@pytest.mark.parametrize("x", [80, 80.5])
def test_width_and_place_of_a_line(width_px, x):
    image = np.zeros((96, 160, 3), np.uint8)
    draw_polyline(image, np.array([[x, 10.0], [x, 90.0]]), (255, 0, 0), width_px)
    red = image[50, :, 0] / 255
    assert red.sum() == pytest.approx(width_px, abs=1.3)
    assert red @ np.arange(160) / red.sum() == pytest.approx(x, abs=0.1)


def with_text(image: np.ndarray, lines: str | list[str], **options) -> np.ndarray:
    drawn = image.copy()
    put_text(drawn, lines, **options)
    return drawn


@pytest.mark.parametrize("size", [(1280, 720), (640, 360), (160, 96), (97, 41), (30, 12)])
def test_no_letter_is_cut_off(size):
    """Letters never touch the picture's edge, whatever the picture's size and the text's length."""
    image = np.full((*size[::-1], 3), 128, np.uint8)
    lines = ["bends right, R 640 m ± 20 m, and some more of it", "0.12 m left of centre", "gjpqy"]
    changed = (with_text(image, lines, panel_alpha=0.0) != image).any(axis=2)
    assert changed.any() and not any(edge.any() for edge in (changed[0], changed[-1], changed[:, 0], changed[:, -1]))
    np.testing.assert_array_equal(with_text(image, []), image)


@pytest.mark.parametrize("size", [(1280, 720), (480, 768), (640, 180), (640, 360)])
def test_the_size_of_text_does_not_depend_on_the_words(size):
    """The longest words of a lane fit at the usual size, so that text does not jump from frame to frame."""
    longest = [
        *["0.12 m left of centre"] * 2,
        "white double solid | yellow double dashed",
        "searching, confidence 0.45 (uncertain)",
    ]
    rows = []
    for lines in (["tracking"], [*longest, "tracking"]):
        drawn = with_text(np.zeros((*size[::-1], 3), np.uint8), lines, panel_alpha=0)
        last = (len(lines) - 1) * line_height(text_size(*size))
        # below the descenders of the line before
        rows.append(np.flatnonzero(drawn[last + text_size(*size) // 2 :].max(axis=(1, 2)) > 40)[[0, -1]].tolist())
    assert rows[0] == rows[1]


def test_dots_lie_on_the_line_a_step_apart():
    image = np.zeros((96, 160, 3), np.uint8)
    draw_dots(image, np.array([[-1e6, 40.0], [0.0, 40], [100, 40]]), WHITE, 4.0, 20.0)
    marked = np.flatnonzero(image[40, :, 0] > 230)
    assert [round(some.mean()) for some in np.split(marked[3:], np.flatnonzero(np.diff(marked[3:]) > 1) + 1)] == [
        *range(20, 101, 20)
    ]
    assert not image[:36].any() and not image[45:].any()


@pytest.mark.parametrize(
    ("image", "levels"),
    [([[False, True]], [0, 255]), (np.uint8([[0, 1]]), [0, 255]), (np.uint8([[0, 1, 7, 255]]), [0, 1, 7, 255])],
    ids=["bool", "0 and 1", "gray"],
)
def test_masks_become_black_and_white_and_gray_keeps_its_levels(image, levels):
    assert_draws_on_a_copy(to_rgb)
    assert to_rgb(np.array(image)).tolist() == [[[level] * 3 for level in levels]]
