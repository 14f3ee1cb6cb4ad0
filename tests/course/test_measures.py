"""Lateral errors of lanes made by hand, and sentences of checks."""

from __future__ import annotations

import numpy as np
import pytest

from course.measures import (
    check,
    check_error,
    describe_error,
    lane_widths_px,
)
from helpers import (
    FourPointWarp,
    Lens,
    road_homography,
    road_to_pixels,
)


def test_an_error_in_words_is_unknown_lost_or_in_metres():
    assert describe_error(None) == "unknown"
    assert describe_error(np.inf) == "lost"
    assert describe_error(0.123) == "0.12 m"


def test_a_straight_lane_has_its_width_in_columns_at_every_distance_of_a_map():
    # a camera that looks straight ahead, 1.2 m above the road
    matrix = np.array([[1000, 0, 640], [0, 1000, 360], [0, 0, 1]])
    lens = Lens(matrix, np.zeros(5), (1280, 720))
    image_to_road = road_homography(lens, height_m=1.2, pitch_rad=0.0)
    rectangle_m = [(40, 2), (40, -2), (5, -2), (5, 2)]
    source_px = road_to_pixels(rectangle_m, image_to_road)
    destination_px = [(240, 0), (1040, 0), (1040, 720), (240, 720)]
    warp = FourPointWarp(source_px, destination_px, lens.size)

    lines_m = [(1.5, 0.01), (-2.0, 0.01)]
    widths_px = lane_widths_px(warp, image_to_road, lines_m, [6, 20, 39])

    # 800 columns are 4 m
    assert widths_px == pytest.approx([700, 700, 700], abs=0.01)


def test_a_check_names_value_truth_and_limit():
    text = check("h", 1.32, 1.3, "m", within=0.05)
    assert text == "h: 1.32 m, truth 1.30 m, off by 0.02 m (allowed 0.05 m)"


def test_a_check_of_an_error_names_it_and_the_limit():
    text = check_error("paint", 0.14, "px", within=1)
    assert text == "paint: error 0.1 px (allowed 1 px)"


def test_without_truth_a_check_says_so():
    text = check("height", 1.32, None, "m", within=0.05)
    assert text == "height: 1.32 m (no truth known for these pictures)"
    assert "not known" in check_error("paint", None, "px", within=1)


@pytest.mark.parametrize("error", [1.2, float("nan")])
def test_an_error_beyond_the_limit_fails(error):
    with pytest.raises(AssertionError, match="allowed 1 px"):
        check_error("paint", error, "px", within=1)


def test_a_number_too_far_from_the_truth_fails():
    with pytest.raises(AssertionError, match="off by 0.10 m"):
        check("h", 1.4, 1.3, "m", within=0.05)
