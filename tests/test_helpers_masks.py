"""Binaries by colour and gradient: ranges, colour order, scales of gradients, sizes."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from helpers import RECIPES, Levels, Thresholds, colour_channel
from tests.support.painted_roads import WHITE, YELLOW

parametrize = pytest.mark.parametrize

GRAY = (105, 105, 105)
A = RECIPES["hls_sobel"].thresholds
B = RECIPES["equalized_hsv"].thresholds
C = RECIPES["best_channel"].thresholds


def plain(colour, size=(40, 30)):
    return np.full((size[1], size[0], 3), colour, np.uint8)


def step(low, high):
    """An image of two gray levels, side by side."""
    image = plain((low,) * 3)
    image[:, 20:] = high
    return image


def mask(image, *levels, **settings):
    """The binary of one rule: all of these levels."""
    thresholds = Thresholds({"only": [levels]}, combined=["only"], **settings)
    return thresholds.masks(image)["combined"]


@parametrize(
    ("space", "red"),
    [
        ("RGB", (255, 0, 0)),
        ("HLS", (0, 128, 255)),
        ("HSV", (0, 255, 255)),
        ("Lab", (136, 208, 195)),
    ],
)
def test_red_is_red_in_every_space(space, red):
    """The values of OpenCV's documentation for pure red."""
    image = plain((255, 0, 0))
    channels = [colour_channel(image, f"{space} {letter}")[0, 0] for letter in space]
    assert tuple(map(int, channels)) == red


def test_gray_of_red_is_its_share_of_brightness():
    assert colour_channel(plain((255, 0, 0)), "gray")[0, 0] == 76  # 0.299 of 255


def test_ranges_include_both_ends():
    row = np.repeat(
        np.array(
            [
                [
                    [9],
                    [10],
                    [20],
                    [21],
                ]
            ],
            np.uint8,
        ),
        3,
        axis=2,
    )
    assert mask(row, Levels("gray", 10, 20)).tolist() == [[0, 255, 255, 0]]


@parametrize("name", ["CMYK K", "HLS V", "HLS", "HLS HL", "grey"])
def test_unknown_channels_are_named(name):
    with pytest.raises(ValueError, match=f"channel '{name}' is not known; use gray"):
        colour_channel(plain(GRAY), name)


def test_an_unknown_kind_of_threshold_is_named():
    with pytest.raises(ValueError, match="'gradient' is not known; use value"):
        mask(step(0, 9), Levels("gray", 1, 2, "gradient"))


@parametrize(
    ("colour", "yellow", "saturated"),
    [
        (YELLOW, True, True),
        (YELLOW[::-1], False, True),
        (WHITE, False, False),
        (GRAY, False, False),
        ((20, 5, 5), False, False),
    ],
)
def test_yellow_needs_rgb_order_and_saturation_needs_light(colour, yellow, saturated):
    assert B.masks(plain(colour))["yellow"].all() == yellow
    assert A.masks(plain(colour))["saturation"].all() == saturated


@parametrize(
    ("name", "channel", "low", "high"),
    [
        ("red", "RGB R", 210, 255),
        ("saturation", "HLS S", 85, 255),
        ("luv lightness", "Luv L", 225, 255),
    ],
)
def test_recipe_c_excludes_the_lower_end_of_a_range(name, channel, low, high):
    (levels,) = C.rules[name][0]
    assert (levels.channel, levels.low, levels.high) == (channel, low + 1, high)


@parametrize(
    ("red", "kept"),
    [
        (210, False),
        (211, True),
        (255, True),
    ],
)
def test_a_red_of_210_is_not_above_210(red, kept):
    image = plain((red, 0, 0), size=(100, 90))
    assert C.masks(image)["red"][80, 50] == 255 * kept


@parametrize("kernel", [3, 5, 9])
@parametrize(("low", "seen"), [(59.9, True), (60.1, False)])
def test_a_sharp_edge_answers_its_own_height_whatever_the_kernel(kernel, low, seen):
    levels = Levels("gray", low, 255, "gradient x", kernel=kernel)
    assert mask(step(50, 110), levels).any() == seen


ROWS, COLUMNS = np.indices((60, 60))
LEVEL = np.where(2 * ROWS > 60, 200, 50).astype(np.uint8)
SLANT = np.where(COLUMNS + 1.5 * ROWS > 75, 200, 50).astype(np.uint8)
UPRIGHT = step(50, 200)
LYING = np.dstack([LEVEL, LEVEL, LEVEL])
SLANTED = np.dstack([SLANT, SLANT, SLANT])
STRONG = Levels("gray", 60, 255, "magnitude")
DIRECTION = Levels("gray", 0.7, 1.2, "direction")


@parametrize(
    ("image", "levels", "seen"),
    [
        (UPRIGHT, [Levels("gray", 20, 255, "gradient x")], True),
        (UPRIGHT, [Levels("gray", 20, 255, "gradient y")], False),
        (LYING, [Levels("gray", 20, 255, "gradient y")], True),
        (UPRIGHT, [STRONG], True),
        # a direction is the angle from a vertical edge: arctan 1.5 is 0.98
        (SLANTED, [STRONG, DIRECTION], True),
        (UPRIGHT, [STRONG, DIRECTION], False),
        # the upper end drops steep edges unless it is the end of the scale
        (
            step(0, 150),
            [Levels("gray", 100, 200, "gradient x", full_step=100)],
            False,
        ),
        (step(0, 255), [Levels("gray", 100, 255, "gradient x", full_step=100)], True),
    ],
)
def test_gradients_have_a_direction_and_a_range(image, levels, seen):
    assert mask(image, *levels).any() == seen


@parametrize(
    ("image", "seen"),
    [
        (SLANTED, True),
        (UPRIGHT, False),
        (LYING, False),
    ],
)
def test_slanted_edges_of_a_binary_are_kept(image, seen):
    assert mask(image, Levels("gray", 100, 255, edges_rad=(0.7, 1.2))).any() == seen


def test_slanted_edges_are_those_of_the_binary_and_not_of_the_gray_image():
    """A slanted edge of gray inside the range of the binary is none of its edges."""
    within = np.where(SLANTED > 100, 180, 120).astype(np.uint8)
    levels = Levels("gray", 100, 255)
    assert mask(within, levels, DIRECTION).any()
    assert not mask(within, levels._replace(edges_rad=(0.7, 1.2))).any()


@parametrize("name", ["hue", "lab b"])
def test_recipe_c_keeps_the_slanted_edges_of_hue_and_lab_b(name):
    """A yellow patch with one slanted edge: its inside and its upright edge are not."""
    image = plain(GRAY, size=(300, 300))
    rows, columns = np.indices((300, 300))
    patch = (rows > 200) & (columns > 100) & (columns < 300 - rows + 120)
    image[patch] = YELLOW
    found_rows, found_columns = np.nonzero(C.masks(image)[name])
    assert len(found_rows) > 100
    on_edge = np.abs(found_columns - (420 - found_rows)) <= 2
    assert on_edge.mean() > 0.9


def test_region_is_given_in_fractions():
    white = plain((255, 255, 255), (200, 100))
    lower_half = (
        (0, 1),
        (0, 0.5),
        (1, 0.5),
        (1, 1),
    )
    inside = mask(white, Levels("gray", 0, 255), region=lower_half)
    assert not inside[:49].any() and inside[51:].all()


def test_closing_fills_narrow_gaps():
    image = plain((0, 0, 0), (60, 20))
    for left, right in (
        (10, 20),
        (23, 30),
        (45, 50),
    ):
        image[:, left:right] = 255
    closed = mask(image, Levels("gray", 255, 255), close_px=5)
    assert closed[10, 10:30].all()
    assert not closed[10, 31:44].any()


@parametrize(
    ("factor", "kernel", "close_px"),
    [
        (0.5, 5, 3),
        (0.01, 3, 1),
        (9.0, 31, 45),
    ],
)
def test_wide_kernels_scale_to_odd_sizes_that_exist(factor, kernel, close_px):
    scaled = B.scaled(factor)
    assert scaled.rules["magnitude"][0][0].kernel == kernel
    assert scaled.close_px == close_px


def test_the_finest_kernel_and_all_levels_stay():
    image = cv2.resize(SLANTED, (600, 600), interpolation=cv2.INTER_LINEAR)
    for thresholds in (A, replace(C, region=None)):
        whole = thresholds.masks(image)
        scaled = thresholds.scaled(2.0).masks(image)
        for name, binary in whole.items():
            assert_array_equal(binary, scaled[name])


def test_recipe_c_has_the_binaries_in_its_authors_order():
    """Of two equally good binaries the first one is taken."""
    names = ("red", "gradients", "hue", "saturation", "luv lightness", "lab b")
    assert RECIPES["best_channel"].video_thresholds.candidates == names
    assert C.combined == ("saturation", "red", "lab b")
