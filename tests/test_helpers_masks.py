"""Binaries by colour and gradient: ranges, colour order, scales of gradients, and sizes."""

from dataclasses import replace

import numpy as np
import pytest

from helpers import RECIPES, Levels, Thresholds, colour_channel
from tests.support.painted_roads import WHITE, YELLOW

GRAY = (105, 105, 105)
A, B, C = (RECIPES[name].thresholds for name in RECIPES)


def picture(colour, size=(40, 30)):
    return np.full((size[1], size[0], 3), colour, np.uint8)


def step(low, high):
    """An image of two gray levels, side by side."""
    image = picture((low,) * 3)
    image[:, 20:] = high
    return image


def mask(image, *levels, **settings):
    """The binary of one rule: all of these levels."""
    return Thresholds({"only": (levels,)}, combined=("only",), **settings).masks(image)["combined"]


@pytest.mark.parametrize(
    ("space", "red"), [("RGB", (255, 0, 0)), ("HLS", (0, 128, 255)), ("HSV", (0, 255, 255)), ("Lab", (136, 208, 195))]
)
def test_red_is_red_in_every_space(space, red):
    """The values of OpenCV's documentation for pure red; gray is 0.299 of it. Ranges include both ends."""
    channels = [colour_channel(picture((255, 0, 0)), f"{space} {letter}")[0, 0] for letter in space]
    assert tuple(map(int, channels)) == red
    assert colour_channel(picture((255, 0, 0)), "gray")[0, 0] == 76
    row = np.repeat(np.array([[[9], [10], [20], [21]]], np.uint8), 3, axis=2)
    assert mask(row, Levels("gray", 10, 20)).tolist() == [[0, 255, 255, 0]]


@pytest.mark.parametrize("name", ["CMYK K", "HLS V", "HLS", "HLS HL", "grey"])
def test_unknown_channels_are_named(name):
    with pytest.raises(ValueError, match=f"channel '{name}' is not known; use gray"):
        colour_channel(picture(GRAY), name)


@pytest.mark.parametrize(
    ("colour", "yellow", "saturated"),
    [(YELLOW, True, True), (YELLOW[::-1], False, True), (WHITE, False, False), (GRAY, False, False)]
    + [((20, 5, 5), False, False)],
)
def test_yellow_needs_rgb_order_and_saturation_needs_colour_and_light(colour, yellow, saturated):
    assert B.masks(picture(colour))["yellow"].all() == yellow
    assert A.masks(picture(colour))["saturation"].all() == saturated


@pytest.mark.parametrize("kernel", [3, 5, 9])
def test_a_sharp_edge_answers_its_own_height_whatever_the_kernel(kernel):
    seen = [mask(step(50, 110), Levels("gray", low, 255, "gradient x", kernel=kernel)).any() for low in (59.9, 60.1)]
    assert seen == [True, False]


ROWS, COLUMNS = np.indices((60, 60))
UPRIGHT, STRONG = step(50, 200), Levels("gray", 60, 255, "magnitude")
SLANTED = np.dstack([np.where(COLUMNS + 1.5 * ROWS > 75, 200, 50).astype(np.uint8)] * 3)
DIRECTION = Levels("gray", 0.7, 1.2, "direction")


@pytest.mark.parametrize(
    ("image", "levels", "seen"),
    [
        (UPRIGHT, [Levels("gray", 20, 255, "gradient x")], True),
        (UPRIGHT, [Levels("gray", 20, 255, "gradient y")], False),
        (UPRIGHT.transpose(1, 0, 2).copy(), [Levels("gray", 20, 255, "gradient y")], True),
        (UPRIGHT, [STRONG], True),
        # a direction is the angle from a vertical edge: arctan 1.5 is 0.98
        (SLANTED, [STRONG, DIRECTION], True),
        (UPRIGHT, [STRONG, DIRECTION], False),
        # the upper end drops steep edges unless it is the end of the scale
        (step(0, 150), [Levels("gray", 100, 200, "gradient x", full_step=100)], False),
        (step(0, 255), [Levels("gray", 100, 255, "gradient x", full_step=100)], True),
    ],
)
def test_gradients_have_a_direction_and_a_range(image, levels, seen):
    assert mask(image, *levels).any() == seen


def test_region_is_given_in_fractions_and_closing_fills_narrow_gaps():
    white = picture((255, 255, 255), (200, 100))
    inside = mask(white, Levels("gray", 0, 255), region=((0, 1), (0, 0.5), (1, 0.5), (1, 1)))
    assert not inside[:49].any() and inside[51:].all()
    image = picture((0, 0, 0), (60, 20))
    image[:, 10:20] = image[:, 23:30] = image[:, 45:50] = 255
    closed = mask(image, Levels("gray", 255, 255), close_px=5)
    assert closed[10, 10:30].all() and not closed[10, 31:44].any()


def test_wide_kernels_scale_to_odd_sizes_that_exist():
    sizes = {}
    for factor in (0.5, 0.01, 9.0):
        scaled = B.scaled(factor)
        sizes[factor] = scaled.rules["magnitude"][0][0].kernel, scaled.close_px
    assert sizes == {0.5: (5, 3), 0.01: (3, 1), 9.0: (31, 45)}
    assert A.scaled(0.5) == A and B.scaled(1.0) == B and replace(C.scaled(2.0), close_px=0) == C
