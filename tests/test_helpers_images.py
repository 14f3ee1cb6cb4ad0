"""Every function of helpers.py that takes an image takes it as people have it."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from helpers import (
    RECIPES,
    colour_channel,
    draw_lane,
    draw_lines,
    read_image,
    undistort,
    write_image,
)
from tests.support.classic_lane import lens_of, start_finder
from tests.support.painted_drive import SMALL, tracked_bends

parametrize = pytest.mark.parametrize

LINE_PX = np.array([[60.0, 20.0], [20.0, 80.0]])


def take_channel(image, _):
    return colour_channel(image, "HLS S")


def take_mask_of_a(image, _):
    return RECIPES["hls_sobel"].thresholds.masks(image)["combined"]


def take_mask_of_b(image, _):
    return RECIPES["equalized_hsv"].thresholds.masks(image)["combined"]


def take_mask_of_c(image, _):
    return RECIPES["best_channel"].thresholds.masks(image)["combined"]


def take_flat(image, _):
    return undistort(image, lens_of(SMALL))


def take_drawing(image, _):
    return draw_lane(image, LINE_PX, LINE_PX + 50)


def take_lines(image, _):
    return draw_lines(image, [(0, 0, 30)])


def take_file(image, folder):
    return read_image(write_image(folder / "a.png", image))


def take_lane(image, _):
    return start_finder("best_channel", SMALL).find(image).warped_binary


COLOUR_ONLY = [
    take_channel,
    take_mask_of_a,
    take_mask_of_b,
    take_mask_of_c,
    take_flat,
    take_file,
]


def bgr_reversed(image):
    return np.ascontiguousarray(image[..., ::-1])[..., ::-1]


def transposed(image):
    return np.ascontiguousarray(image.transpose(1, 0, 2)).transpose(1, 0, 2)


@parametrize("function", [*COLOUR_ONLY, take_drawing, take_lines, take_lane])
@parametrize("view", [np.copy, bgr_reversed, transposed])
def test_views_and_read_only_arrays_give_the_same(function, view, tmp_path):
    image = tracked_bends()[0]
    viewed = view(image)
    viewed.flags.writeable = False
    result = function(viewed, tmp_path)
    assert_array_equal(result, function(image, tmp_path))
    assert_array_equal(viewed, image)


@parametrize(
    ("wrong", "sentence"),
    [
        (
            np.zeros((360, 640, 4), np.uint8),
            r"expected an RGB .* got shape \(360, 640, 4",
        ),
        (np.zeros((360, 640, 3)), "expected an RGB image .* dtype float64"),
        (np.zeros((0, 640, 3), np.uint8), r"got shape \(0, 640, 3\)"),
        ([[0, 0, 0]], "expected an RGB image .* got list"),
        (None, "expected an RGB image .* got NoneType"),
    ],
    ids=["rgba", "float", "empty", "list", "none"],
)
@parametrize("function", [*COLOUR_ONLY, take_drawing, take_lane])
def test_other_arrays_are_refused(function, wrong, sentence, tmp_path):
    with pytest.raises(ValueError, match=sentence):
        function(wrong, tmp_path)
    assert not any(tmp_path.iterdir())


@parametrize("function", COLOUR_ONLY)
def test_a_gray_image_is_refused_where_colour_is_needed(function, tmp_path):
    gray = np.zeros((360, 640), np.uint8)
    with pytest.raises(ValueError, match=r"got shape \(360, 640\), dtype uint8"):
        function(gray, tmp_path)
