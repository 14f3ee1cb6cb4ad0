"""Checks of exercises 7.1 to 8.3 on lanes made by hand.

The notebook's solutions and the listed wrong answers run in its kernel
(tests/end_to_end); these are the answers that it does not try.
"""

from __future__ import annotations

import numpy as np
import pytest

from course.exercises.chapters_07_08 import (
    check_bar,
    check_own_road,
    check_ransac_choice,
    check_sanity,
)
from course.exercises.hints import HintError
from helpers import (
    RECIPES,
    Lens,
    distort_points,
    pixels_to_road,
    process_video,
    recipe_from_pose,
    road_homography,
    road_to_pixels,
    write_image,
)
from tests.support.project import ROOT

MATRIX = np.array([[1150.0, 0, 640], [0, 1150, 380], [0, 0, 1]])
LENS = Lens(MATRIX, np.array([-0.24, 0, 0, 0, 0]), (1280, 720))
IMAGE_TO_ROAD = road_homography(LENS, height_m=1.3, pitch_rad=-0.03)
# (c2 / 2, c1, c0) of the lines of a straight lane, the car in its centre
LEFT_M = (0.0, 0.0, 1.8)
RIGHT_M = (0.0, 0.0, -1.8)
GRAY = np.full((720, 1280, 3), 90, np.uint8)


def painted_road(half_width_m: float = 1.8) -> np.ndarray:
    """A straight road, seen without distortion, with two white lines 15 cm wide."""
    v, u = np.mgrid[:720, :1280]
    pixels = np.column_stack([u.ravel(), v.ravel()])
    x_m, y_m = pixels_to_road(pixels, IMAGE_TO_ROAD).T
    on_line = np.abs(np.abs(y_m) - half_width_m) < 0.075
    image = GRAY.copy()
    image[(on_line & (x_m < 80)).reshape(720, 1280)] = 240
    return image


def rectangle_px() -> np.ndarray:
    """Four points of hls_sobel that are a rectangle on the painted road."""
    recipe = recipe_from_pose(RECIPES["hls_sobel"], IMAGE_TO_ROAD)
    return np.array(recipe.source_px)


@pytest.mark.parametrize("choice", [None, 29, (3,), (3.5, 29), (0, 29), "3, 29"])
def test_a_choice_that_is_not_two_whole_numbers_is_named(choice):
    pixels = np.column_stack([np.full(100, 300.0), np.arange(100.0)])
    with pytest.raises(HintError, match="two whole numbers"):
        check_ransac_choice(choice, pixels=pixels, line=(0, 0, 300))


def bar_px() -> np.ndarray:
    """Raw pixels of the true bar, 7 m ahead."""
    flat_px = road_to_pixels([(7, 1.8), (7, -1.8)], IMAGE_TO_ROAD)
    return distort_points(flat_px, LENS)


def check_bar_of(answer: np.ndarray) -> str:
    return check_bar(
        answer,
        left=LEFT_M,
        right=RIGHT_M,
        lens=LENS,
        image_to_road=IMAGE_TO_ROAD,
        image=GRAY,
    )


def test_the_true_bar_is_accepted_and_so_is_one_a_pixel_off():
    assert "within 0.1 px" in check_bar_of(bar_px())
    assert "within 1.0 px" in check_bar_of(bar_px() + [1, 0])


def test_both_ends_of_a_bar_that_is_off_are_named():
    with pytest.raises(
        HintError, match="left end is 30 px off and the right end is 30"
    ):
        check_bar_of(bar_px() + [0, 30])


def lane_in_view() -> tuple[np.ndarray, np.ndarray]:
    return np.array([0, 0, 300.0]), np.array([0, 0, 1000.0])


def accept_lanes(left: np.ndarray, right: np.ndarray) -> bool:
    """A sanity check in pixels: 700 columns wide, parallel, hardly bent."""
    rows = np.array([0, 360, 719])
    widths = np.polyval(right - left, rows)
    is_wide = np.all(np.abs(widths - 700) < 60)
    return bool(is_wide and abs(left[0]) < 5e-4)


def test_a_sanity_check_without_truth_is_judged_by_the_frames_with_a_lane():
    offsets_m = np.full(63, 0.1)
    offsets_m[:10] = np.nan
    answer = check_sanity(
        accept_lanes,
        follow=lambda is_plausible, start_s, end_s: offsets_m,
        lane=lane_in_view(),
        truth=None,
    )
    assert answer == "84% of the frames have a lane (no truth known for this video)."


@pytest.mark.parametrize(
    ("error_m", "lost", "words"),
    [(0.1, 10, ""), (0.6, 10, "still wrong by 0.6 m"), (0.1, 30, "too strict")],
)
def test_a_sanity_check_is_judged_by_error_and_lost_frames(error_m, lost, words):
    truth = {"offset_m": np.zeros(200)}
    offsets_m = np.full(63, error_m)
    offsets_m[:lost] = np.nan
    given = {
        "follow": lambda is_plausible, start_s, end_s: offsets_m,
        "lane": lane_in_view(),
        "truth": truth,
    }
    if words:
        with pytest.raises(HintError, match=words):
            check_sanity(accept_lanes, **given)
    else:
        assert "now by 0.1 m; 84% of the frames" in check_sanity(accept_lanes, **given)


def test_four_points_on_an_own_photo_give_a_lane_as_wide_far_as_near(tmp_path):
    photo = write_image(tmp_path / "road.png", painted_road())
    answer = check_own_road(rectangle_px(), path=photo)
    assert answer.startswith("a lane in 1 of 1 images; far ahead it is 1.0")
    assert "0.00 lane widths" in answer


def test_far_points_that_are_too_close_together_are_named(tmp_path):
    photo = write_image(tmp_path / "road.png", painted_road())
    points_px = rectangle_px() + [(20, 0), (-20, 0), (0, 0), (0, 0)]
    with pytest.raises(HintError, match="Move the far points apart"):
        check_own_road(points_px, path=photo)


def test_a_photo_without_a_lane_is_named(tmp_path):
    photo = write_image(tmp_path / "road.png", GRAY)
    with pytest.raises(HintError, match="a lane in 0 of 1 images"):
        check_own_road(rectangle_px(), path=photo)


def write_video(path, frames) -> None:
    """A video of these frames, made from one of the course of the same length."""
    left = list(frames)
    end_s = len(left) / 25
    video = ROOT / "test_videos" / "project_video.mp4"
    process_video(video, path, lambda _: left.pop(0), end_s=end_s)


def test_of_a_video_some_frames_are_looked_at(tmp_path):
    source = tmp_path / "gray.mp4"
    write_video(source, [painted_road()] * 6 + [GRAY] * 6)
    answer = check_own_road(rectangle_px(), path=source)
    assert answer.startswith("a lane in 4 of 8 images")
