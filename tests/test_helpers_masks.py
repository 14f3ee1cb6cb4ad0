"""Binaries by colour and gradient: ranges, colour order, scales of gradients, sizes."""

import cv2
import numpy as np
import pytest
from numpy.testing import assert_array_equal
from pytest import approx

from helpers import (
    RECIPES,
    colour_channel,
    gradient_mask,
    kernels_of_b,
    slanted_edges,
    sobel_gradient,
)
from tests.support.painted_roads import WHITE, YELLOW

parametrize = pytest.mark.parametrize

GRAY = (105, 105, 105)
A = RECIPES["hls_sobel"].thresholds
B = RECIPES["equalized_hsv"].thresholds
C = RECIPES["best_channel"].thresholds

ROWS, COLUMNS = np.indices((60, 60))
UPRIGHT = np.where(COLUMNS > 30, 200, 50).astype(np.uint8)
LEVEL = np.where(ROWS > 30, 200, 50).astype(np.uint8)
# the angle from a vertical edge: arctan 1.5 is 0.98
SLANTED = np.where(COLUMNS + 1.5 * ROWS > 75, 200, 50).astype(np.uint8)


def plain(colour, size=(40, 30)):
    width, height = size
    return np.full((height, width, 3), colour, np.uint8)


def in_colour(gray):
    return np.dstack([gray, gray, gray])


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


@parametrize("name", ["CMYK K", "HLS V", "HLS", "HLS HL", "grey"])
def test_unknown_channels_are_named(name):
    with pytest.raises(ValueError, match=f"channel '{name}' is not known; use gray"):
        colour_channel(plain(GRAY), name)


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


def colour_with(channel, level):
    """A colour of this level, as saturated as possible."""
    random = np.random.default_rng(0)
    colours = random.integers(0, 256, (1, 200_000, 3), np.uint8)
    colours = colours[:, colour_channel(colours, channel)[0] == level]
    spread = np.ptp(colours[0].astype(int), axis=1)
    return colours[0, spread.argmax()]


@parametrize(
    ("name", "channel", "level", "kept"),
    [
        ("red", "RGB R", 210, False),
        ("red", "RGB R", 211, True),
        ("hue", "HLS H", 20, False),
        ("hue", "HLS H", 21, True),
        ("hue", "HLS H", 80, True),
        ("hue", "HLS H", 81, False),
        ("saturation", "HLS S", 85, False),
        ("saturation", "HLS S", 86, True),
        ("luv lightness", "Luv L", 225, False),
        ("luv lightness", "Luv L", 226, True),
        ("lab b", "Lab b", 155, False),
        ("lab b", "Lab b", 156, True),
        ("lab b", "Lab b", 200, True),
        ("lab b", "Lab b", 201, False),
    ],
)
def test_recipe_c_excludes_the_lower_end_of_a_range(name, channel, level, kept):
    image = plain((0, 0, 0), size=(60, 60))
    image[SLANTED > 100] = colour_with(channel, level)
    assert C.masks(image)[name].any() == kept


@parametrize("kernel", [3, 5, 9])
def test_a_sharp_edge_answers_its_own_height_whatever_the_kernel(kernel):
    along_u, along_v = sobel_gradient(UPRIGHT, kernel)
    assert along_u.max() == approx(150)
    assert not along_v.any()


def test_a_level_edge_has_a_gradient_along_v_only():
    along_u, along_v = sobel_gradient(LEVEL, 3)
    assert not along_u.any()
    assert np.abs(along_v).max() == approx(150)


@parametrize("edge", [UPRIGHT, LEVEL], ids=["upright", "level"])
def test_recipe_b_sees_edges_of_both_directions_in_its_magnitude(edge):
    assert B.masks(in_colour(edge))["magnitude"].any()


@parametrize(
    ("high", "kept"),
    [
        # the upper end drops steep edges unless it is the end of the scale
        (200, [0, 255, 255, 255, 0, 0]),
        (255, [0, 255, 255, 255, 255, 255]),
    ],
)
def test_gradients_of_both_signs_have_a_range_with_both_ends(high, kept):
    """In which a step of 51 levels is 255, so 100 are 20 levels, and 200 are 40."""
    levels = np.array([[19, 20, -20, 40, 41, 90]], np.float32)
    assert gradient_mask(levels, 100, high, full_step=51).tolist() == [kept]


def test_recipe_a_sees_upright_edges_in_its_gradient_x():
    assert A.masks(in_colour(UPRIGHT))["gradient x"].any()
    assert not A.masks(in_colour(LEVEL))["gradient x"].any()


@parametrize(
    ("channel", "seen"),
    [
        (SLANTED, True),
        (UPRIGHT, False),
        (LEVEL, False),
    ],
)
def test_slanted_edges_are_slanted(channel, seen):
    assert slanted_edges(channel).any() == seen
    assert C.masks(in_colour(channel))["gradients"].any() == seen


@parametrize("name", ["hue", "lab b"])
def test_recipe_c_keeps_the_slanted_edges_of_the_binaries_of_hue_and_lab_b(name):
    """Of a yellow patch: not its upright edge, nor the slanted edge of a darker part."""
    image = plain(GRAY, size=(300, 300))
    rows, columns = np.indices((300, 300))
    patch = (rows > 200) & (columns > 100) & (columns < 420 - rows)
    image[patch] = YELLOW
    darker = patch & (columns < 380 - rows)
    image[darker] = np.array(YELLOW) * 0.85
    assert slanted_edges(colour_channel(image, "gray"))[230, 145:155].any()

    found_rows, found_columns = np.nonzero(C.masks(image)[name])
    assert len(found_rows) > 100
    on_edge = np.abs(found_columns - (420 - found_rows)) <= 2
    assert on_edge.mean() > 0.9


def region_of_c(size):
    return C.masks(plain(WHITE, size))["red"]


def test_the_binaries_of_recipe_c_are_those_of_its_lane():
    """Without the sky and the adjacent lanes."""
    inside = region_of_c((1280, 720))
    assert not inside[:399].any()
    assert not inside[:600, [0, 1279]].any()
    assert inside[401, 640]
    assert inside[719, [10, 1260]].all()


def test_recipe_b_closes_narrow_gaps():
    # as bright as yellow: without edges in gray
    brightness = colour_channel(plain(YELLOW), "gray")[0, 0]
    image = plain((brightness,) * 3, size=(1280, 720))
    image[:, 10:20] = YELLOW
    image[:, 23:30] = YELLOW
    image[:, 45:50] = YELLOW
    closed = B.masks(image)["combined"]
    assert closed[10, 10:30].all()
    assert not closed[10, 31:44].any()


@parametrize(
    ("width", "height", "kernel", "closing_px"),
    [
        (1280, 720, 9, 5),
        (640, 360, 5, 3),
        (12, 7, 3, 1),
        (11520, 6480, 31, 45),
    ],
)
def test_wide_kernels_scale_to_odd_sizes_that_exist(width, height, kernel, closing_px):
    image = np.broadcast_to(np.uint8(0), (height, width, 3))
    assert kernels_of_b(image) == (kernel, closing_px)


@parametrize("thresholds", [A, C], ids=["A", "C"])
def test_the_finest_kernel_and_all_levels_stay(thresholds):
    """The same edges in an image and in a quarter of it, where C has both regions."""
    image = cv2.resize(SLANTED, (600, 600), interpolation=cv2.INTER_LINEAR)
    image = cv2.GaussianBlur(in_colour(image), (0, 0), 3)
    quarter = np.s_[300:, 150:450]
    both = region_of_c((600, 600))[quarter] & region_of_c((300, 300))
    # without the edges that the border makes
    both = both[5:-5, 5:-5]
    whole_masks = thresholds.masks(image)
    for name, mask in thresholds.masks(image[quarter]).items():
        part = mask[5:-5, 5:-5]
        whole = whole_masks[name][quarter][5:-5, 5:-5]
        assert_array_equal(part & both, whole & both)


def test_recipe_c_has_the_binaries_in_its_authors_order():
    """Of two equally good binaries the first one is taken."""
    names = ("red", "gradients", "hue", "saturation", "luv lightness", "lab b")
    assert RECIPES["best_channel"].video_thresholds.candidates == names


def test_the_still_of_recipe_c_is_saturation_or_red_or_lab_b():
    random = np.random.default_rng(1)
    noise = random.integers(0, 256, (90, 160, 3), np.uint8)
    masks = C.masks(noise)
    union = masks["saturation"] | masks["red"] | masks["lab b"]
    assert_array_equal(masks["combined"], union)
