"""5.1: precision and recall of masks that are drawn on a view from above."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from course.exercises.chapters_05_06 import rate_paint
from helpers import FourPointWarp, Lens, road_homography, road_to_pixels

LENS = Lens(
    matrix=np.array(
        [
            [1000, 0, 640],
            [0, 1000, 360],
            [0, 0, 1],
        ]
    ),
    distortion=np.zeros(5),
    size=(1280, 720),
)
IMAGE_TO_ROAD = road_homography(LENS, height_m=1.2, pitch_rad=0.0)
# 200 columns a metre, from 3 to 40 m ahead
RECTANGLE_M = [
    (40, 3.2),
    (40, -3.2),
    (3, -3.2),
    (3, 3.2),
]
WARP = FourPointWarp(
    source_px=road_to_pixels(RECTANGLE_M, IMAGE_TO_ROAD),
    destination_px=[
        (0, 0),
        (1280, 0),
        (1280, 720),
        (0, 720),
    ],
    size=LENS.size,
)
# lines that lean, so that a mask of straight columns is not right by chance
X = np.arange(0.0, 45, 5)
TRUTH = {
    "x_m": X.tolist(),
    "left_y_m": (1.6 + 0.01 * X).tolist(),
    "right_y_m": (-2.0 + 0.01 * X).tolist(),
}


def paint_line(
    key: str,
    *,
    shift_m: float = 0.0,
    from_m: float = 4.0,
    to_m: float = 39.0,
) -> np.ndarray:
    """A mask of a stripe 0.2 m wide, `shift_m` metres left of a true line."""
    x = np.linspace(from_m, to_m, 200)
    y = np.interp(x, X, TRUTH[key]) + shift_m
    left_edge = np.column_stack([x, y + 0.1])
    right_edge = np.column_stack([x, y - 0.1])
    outline_m = np.vstack([left_edge, right_edge[::-1]])
    outline_px = WARP.points_to_birdseye(road_to_pixels(outline_m, IMAGE_TO_ROAD))
    mask = np.zeros((720, 1280), np.uint8)
    return cv2.fillPoly(mask, [np.int32(outline_px.round())], 255)


def rate(mask: np.ndarray):
    return rate_paint(mask, WARP, IMAGE_TO_ROAD, TRUTH)


def test_both_lines_have_precision_and_recall_1():
    rating = rate(paint_line("left_y_m") | paint_line("right_y_m"))
    assert rating.precision == rating.recall == 1
    assert not rating.missed_px
    assert not rating.beside.any()


def test_pixels_beside_a_line_lower_the_precision_and_find_nothing():
    rating = rate(paint_line("left_y_m", shift_m=-0.8))
    assert rating.precision == rating.recall == 0
    # 25 m of two lines, in steps of half a metre
    assert len(rating.missed_px) == 100


def test_a_false_stripe_in_the_lane_halves_the_precision():
    false_stripe = paint_line("left_y_m", shift_m=-1.5)
    rating = rate(paint_line("left_y_m") | false_stripe)
    assert rating.precision == pytest.approx(0.5, abs=0.02)
    assert rating.left_recall == 1
    assert rating.right_recall == 0


def test_the_next_lane_and_the_far_road_do_not_count():
    line = paint_line("left_y_m") | paint_line("right_y_m")
    next_lane = paint_line("right_y_m", shift_m=-1.15)
    far = paint_line("left_y_m", shift_m=-1.5, from_m=31)
    rating = rate(line | next_lane | far)
    assert rating.precision == 1
    assert rating.not_counted.any()


def test_the_road_nearer_than_5_m_does_not_count():
    line = paint_line("left_y_m") | paint_line("right_y_m")
    near = paint_line("left_y_m", shift_m=-1.5, from_m=3.2, to_m=4.8)
    assert rate(line | near).precision == 1


def test_a_mask_without_a_pixel_that_counts_has_precision_0():
    far = paint_line("left_y_m", from_m=31)
    assert rate(far).precision == 0


def test_the_recall_of_a_dash_is_its_length_of_one_line():
    rating = rate(paint_line("right_y_m", from_m=10, to_m=20))
    # 10 of the 25 m, and at most a step more at each end
    assert rating.right_recall == pytest.approx(0.42, abs=0.021)
    assert rating.recall == rating.right_recall / 2
