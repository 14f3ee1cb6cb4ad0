"""Figures of the search: which pixels are coloured, and what is marked."""

from __future__ import annotations

import numpy as np

from course import search_plots
from helpers import (
    LEFT_COLOUR,
    RIGHT_COLOUR,
    WINDOW_COLOUR,
    get_recipe,
    lane_histogram,
    sliding_windows,
)


def two_lines() -> np.ndarray:
    binary = np.zeros((720, 1280), np.uint8)
    binary[:, 300:320] = 255
    binary[:, 1000:1020] = 255
    # paint far from both
    binary[100:140, 640:660] = 255
    return binary


def test_caught_pixels_have_the_colour_of_their_line_and_windows_a_frame():
    binary = two_lines()
    search = sliding_windows(binary, margin_px=80)
    drawn = search_plots.draw_search(binary, search)
    assert tuple(drawn[400 + 13, 305]) == LEFT_COLOUR
    assert tuple(drawn[400 + 13, 1015]) == RIGHT_COLOUR
    left, top, right, bottom = search.windows[0][4]
    assert tuple(drawn[int((top + bottom) / 2), round(left)]) == WINDOW_COLOUR
    # it is set, but belongs to no line
    assert tuple(drawn[120, 650]) == (85, 85, 85)


def test_a_band_has_its_curve_pixels_and_borders():
    binary = two_lines()
    search = sliding_windows(binary, margin_px=80)
    drawn = search_plots.draw_bands(binary, search, margin_px=60)
    assert tuple(drawn[400, 309]) == WINDOW_COLOUR
    assert tuple(drawn[400, 319]) == LEFT_COLOUR
    assert tuple(drawn[400, 1019]) == RIGHT_COLOUR
    border = drawn[400, 309 + 60].astype(int)
    assert border[0] > 200
    assert border[1] < 100


def test_a_line_without_pixels_is_left_out():
    binary = two_lines()
    binary[:, 640:] = 0
    search = sliding_windows(binary, margin_px=80)
    drawn = search_plots.draw_bands(binary, search, margin_px=60)
    assert not drawn[:, 640:].any()


def test_each_recipe_has_its_windows_above_its_band():
    names = ["hls_sobel", "best_channel"]
    binaries = {name: two_lines() for name in names}
    recipes = {name: get_recipe(name) for name in names}
    _, axes = search_plots.show_search(binaries, recipes)
    titles = [axis.get_title() for axis in axes]
    assert titles == [
        "hls_sobel: windows",
        "best_channel: windows",
        "its band and curve",
        "its band and curve",
    ]


def test_the_peaks_are_marked_in_the_mask_and_in_its_histogram():
    binary = two_lines()
    histogram = lane_histogram(binary)
    _, (mask_axis, count_axis) = search_plots.plot_histogram(
        binary, histogram, [319, 1000], first_row=360
    )
    for axis in (mask_axis, count_axis):
        assert [line.get_xdata()[0] for line in axis.lines] == [319, 1000]
    assert mask_axis.get_images()[0].get_extent() == [0, 1280, 720, 360]
