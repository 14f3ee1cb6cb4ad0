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


def step(low, high, size=(40, 30)):
    """An image of two gray levels, side by side."""
    channel = np.full(size[::-1], low, np.uint8)
    channel[:, size[0] // 2 :] = high
    return np.dstack([channel] * 3)


def mask(image, *levels, **settings):
    """The binary of one rule: all of these levels."""
    return Thresholds({"only": (levels,)}, combined=("only",), **settings).masks(image)["combined"]


def test_range_includes_both_ends():
    row = np.repeat(np.array([[[9], [10], [20], [21]]], np.uint8), 3, axis=2)
    assert mask(row, Levels("gray", 10, 20)).tolist() == [[0, 255, 255, 0]]


@pytest.mark.parametrize(
    ("space", "red"), [("RGB", (255, 0, 0)), ("HLS", (0, 128, 255)), ("HSV", (0, 255, 255)), ("Lab", (136, 208, 195))]
)
def test_red_is_red_in_every_space(space, red):
    """The values of OpenCV's documentation for pure red; blue would have hue 120 and b below 128."""
    channels = [colour_channel(picture((255, 0, 0)), f"{space} {letter}")[0, 0] for letter in space]
    assert tuple(map(int, channels)) == red


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


def test_equalized_white_takes_the_brightest_few():
    ramp = np.repeat(np.arange(0, 200, dtype=np.uint8)[None, :], 100, axis=0)
    white = B.masks(np.dstack([ramp] * 3))["white"]
    assert 0 < (white > 0).mean() < 0.03
    assert (np.flatnonzero(white[0]) > 190).all()


@pytest.mark.parametrize("kernel", [3, 5, 9])
def test_a_sharp_edge_answers_its_own_height_whatever_the_kernel(kernel):
    def seen(low):
        return mask(step(50, 110), Levels("gray", low, 255, "gradient x", kernel=kernel)).any()

    assert seen(59.9)
    assert not seen(60.1)


def test_gradient_x_sees_upright_edges_and_gradient_y_level_ones():
    upright = step(50, 150)
    level = upright.transpose(1, 0, 2).copy()
    for of, seen in (("gradient x", upright), ("gradient y", level)):
        assert mask(seen, Levels("gray", 20, 255, of)).any()
        assert not mask(level if seen is upright else upright, Levels("gray", 20, 255, of)).any()
    assert mask(upright, Levels("gray", 20, 255, "magnitude")).any()


def test_a_direction_is_an_angle_from_the_vertical_edge():
    rows, columns = np.indices((60, 60))
    slanted = np.dstack([np.where(columns + 1.5 * rows > 75, 200, 50).astype(np.uint8)] * 3)
    strong = Levels("gray", 60, 255, "magnitude")
    assert mask(slanted, strong, Levels("gray", 0.7, 1.2, "direction")).any()  # arctan 1.5 is 0.98
    assert not mask(step(50, 200), strong, Levels("gray", 0.7, 1.2, "direction")).any()


def test_upper_end_drops_steep_edges_unless_it_is_the_top():
    edge = step(0, 255)
    assert not mask(edge, Levels("gray", 100, 200, "gradient x", full_step=100)).any()
    assert mask(edge, Levels("gray", 100, 255, "gradient x", full_step=100)).any()


def test_a_bright_glint_changes_no_threshold_elsewhere():
    """The originals scaled by the largest gradient of the image, so that one glint rescaled everything."""
    road = step(60, 90)
    glint = road.copy()
    glint[5, 5] = 255
    for thresholds in (A, B):
        before, after = (thresholds.masks(image)["combined"] for image in (road, glint))
        assert np.array_equal(before[15:, 12:], after[15:, 12:])


def test_region_is_given_in_fractions():
    white = picture((255, 255, 255), (200, 100))
    inside = mask(white, Levels("gray", 0, 255), region=((0, 1), (0, 0.5), (1, 0.5), (1, 1)))
    assert not inside[:49].any()
    assert inside[51:].all()


def test_closing_fills_a_gap_and_keeps_distant_things_apart():
    image = picture((0, 0, 0), (60, 20))
    image[:, 10:20] = image[:, 23:30] = image[:, 45:50] = 255
    closed = mask(image, Levels("gray", 255, 255), close_px=5)
    assert closed[10, 10:30].all()
    assert not closed[10, 31:44].any()


@pytest.mark.parametrize("thresholds", [A, B, C], ids=list(RECIPES))
@pytest.mark.parametrize("size", [(1, 1), (2, 7), (64, 37)])
def test_masks_are_binaries_of_the_pictures_size(thresholds, size):
    image = np.random.default_rng(0).integers(0, 256, (size[1], size[0], 3), np.uint8)
    masks = thresholds.masks(image)
    assert {"combined", *thresholds.candidates} <= set(masks)
    for binary in masks.values():
        assert (binary.shape, binary.dtype) == (size[::-1], np.uint8)
        assert set(np.unique(binary)) <= {0, 255}


def test_wide_kernels_scale_to_odd_sizes_that_exist():
    assert B.scaled(1.0) == B
    sizes = {}
    for factor in (0.5, 0.01, 9.0):
        scaled = B.scaled(factor)
        sizes[factor] = scaled.rules["magnitude"][0][0].kernel, scaled.close_px
    assert sizes == {0.5: (5, 3), 0.01: (3, 1), 9.0: (31, 45)}
    assert A.scaled(0.5) == A and replace(C.scaled(2.0), close_px=0) == C
