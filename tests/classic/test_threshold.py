"""Binaries by colour and gradient: ranges, colour order, scales of gradients, and sizes."""

import numpy as np
import pytest

from classic import threshold as th
from tests.support.painted_roads import WHITE, YELLOW

GRAY = (105, 105, 105)


def picture(colour, size=(40, 30)):
    return np.full((size[1], size[0], 3), colour, np.uint8)


def step(low, high, size=(40, 30)):
    channel = np.full(size[::-1], low, np.uint8)
    channel[:, size[0] // 2 :] = high
    return channel


def test_range_includes_both_ends():
    assert th.range_mask(np.array([[9, 10, 20, 21]], np.uint8), (10, 20)).tolist() == [[0, 255, 255, 0]]


@pytest.mark.parametrize(
    ("space", "red"), [("RGB", (255, 0, 0)), ("HLS", (0, 128, 255)), ("HSV", (0, 255, 255)), ("LAB", (136, 208, 195))]
)
def test_red_is_red_in_every_space(space, red):
    """The values of OpenCV's documentation for pure red; blue would have hue 120 and b below 128."""
    assert tuple(int(channel[0, 0]) for channel in th.split_channels(picture((255, 0, 0)), space)) == red


def test_unknown_colour_space_is_named():
    with pytest.raises(ValueError, match="'CMYK' is not known"):
        th.split_channels(picture(GRAY), "CMYK")


@pytest.mark.parametrize(
    ("colour", "yellow", "saturated"),
    [(YELLOW, True, True), (YELLOW[::-1], False, True), (WHITE, False, False), (GRAY, False, False)]
    + [((20, 5, 5), False, False)],
)
def test_yellow_needs_rgb_order_and_saturation_needs_colour_and_light(colour, yellow, saturated):
    assert th.yellow_mask(picture(colour)).all() == yellow
    assert th.saturation_mask(picture(colour)).all() == saturated


def test_equalized_white_takes_the_brightest_few():
    ramp = np.repeat(np.arange(0, 200, dtype=np.uint8)[None, :], 100, axis=0)
    mask = th.equalized_white_mask(np.dstack([ramp] * 3))
    assert 0 < (mask > 0).mean() < 0.03
    assert (np.flatnonzero(mask[0]) > 190).all()


@pytest.mark.parametrize("kernel", [3, 5, 9])
def test_a_sharp_edge_answers_its_own_height_whatever_the_kernel(kernel):
    def seen(low):
        return th.gradient_x_mask(step(50, 110), (low, 255), full_step=255, kernel=kernel).any()

    assert seen(59.9)
    assert not seen(60.1)


def test_gradient_x_sees_upright_edges_only():
    upright, settings = step(50, 150), dict(levels=(20, 255), full_step=255)
    assert th.gradient_x_mask(upright, **settings).any()
    assert not th.gradient_x_mask(upright.T.copy(), **settings).any()
    assert th.magnitude_mask(upright, **settings).any()


def test_upper_end_drops_steep_edges_unless_it_is_the_top():
    edge = step(0, 255)
    assert not th.gradient_x_mask(edge, (100, 200), full_step=100).any()
    assert th.gradient_x_mask(edge, (100, 255), full_step=100).any()


def test_region_is_given_in_fractions():
    mask = th.region_mask((200, 100), ((0, 1), (0, 0.5), (1, 0.5), (1, 1)))
    assert not mask[:49].any()
    assert mask[51:].all()


def test_closing_fills_a_gap_and_keeps_distant_things_apart():
    binary = np.zeros((20, 60), np.uint8)
    binary[:, 10:20] = binary[:, 23:30] = binary[:, 45:50] = 255
    closed = th.close_gaps(binary, 5)
    assert closed[10, 10:30].all()
    assert not closed[10, 31:44].any()


@pytest.mark.parametrize(
    "thresholds", [th.HlsSobelThresholds(), th.EqualizedHsvThresholds(), th.BestChannelThresholds()]
)
@pytest.mark.parametrize("size", [(1, 1), (2, 7), (64, 37)])
def test_masks_are_binaries_of_the_pictures_size(thresholds, size):
    image = np.random.default_rng(0).integers(0, 256, (size[1], size[0], 3), np.uint8)
    masks = thresholds.masks(image)
    assert {"combined", *thresholds.candidates} <= set(masks)
    for mask in masks.values():
        assert (mask.shape, mask.dtype) == (size[::-1], np.uint8)
        assert set(np.unique(mask)) <= {0, 255}


def test_wide_kernels_scale_to_odd_sizes_that_exist():
    thresholds = th.EqualizedHsvThresholds()
    assert thresholds.scaled(1.0) == thresholds
    half, tiny, huge = (thresholds.scaled(factor) for factor in (0.5, 0.01, 9.0))
    assert (half.magnitude_kernel, half.close_px) == (5, 3)
    assert (tiny.magnitude_kernel, tiny.close_px) == (3, 1)
    assert (huge.magnitude_kernel, huge.close_px) == (31, 45)
    assert th.HlsSobelThresholds().scaled(0.5) == th.HlsSobelThresholds()
