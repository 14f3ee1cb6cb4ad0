"""What the check of an exercise prints, and right answers that differ from the folded
solution.
"""

import re
from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

from benchmark.evaluation import COMMITTED
from course.exercises import chapters_13_16, check
from course.exercises.chapters_05_06 import check_lane_width
from course.exercises.chapters_09_12 import check_gate, filter_drive
from course.exercises.check import check_exercise
from course.exercises.hints import HintError, require_equal
from helpers import (
    FourPointWarp,
    Lens,
    metres_per_pixel,
    road_homography,
    road_to_pixels,
)
from tests.support.painted_drive import CAMERA

LENS = Lens(CAMERA.matrix, CAMERA.distortion, CAMERA.size)
IMAGE_TO_ROAD = road_homography(
    LENS, height_m=CAMERA.pose.height_m, pitch_rad=CAMERA.pose.pitch_rad
)
RECTANGLE_M = [(35, 2.2), (35, -2.2), (5, -2.2), (5, 2.2)]
WARP = FourPointWarp(
    source_px=road_to_pixels(RECTANGLE_M, IMAGE_TO_ROAD),
    destination_px=[(200, 0), (1080, 0), (1080, 719), (200, 719)],
    size=(1280, 720),
)


def test_each_verdict_is_one_line(monkeypatch, capsys):
    monkeypatch.setitem(check.CHECKS, "0.1", lambda answer: f"{answer():.2f} m.")
    verdicts = {
        "not tried yet.": None,
        "correct, 3.58 m.": lambda: 3.58,
        "your answer raised ZeroDivisionError: division by zero": lambda: 1 / 0,
    }
    for verdict, answer in verdicts.items():
        check_exercise("0.1", answer)
        assert capsys.readouterr().out == f"0.1: {verdict}\n"
    with pytest.raises(ValueError, match=r"'99\.1'.*6\.1"):
        check_exercise("99.1", 1)


def test_a_mistake_is_named_only_if_all_its_numbers_agree():
    mistakes = {"too large": [2.0, 4.0], "too small": [1.0, 1.0]}
    require_equal([3.0, 4.0], [3.0, 4.01], mistakes, "other", atol=0.02)
    for found, said in (
        ([2.0, 4.01], "too large"),
        ([2.0, 1.0], "other"),
        (1.0, "other"),
        ([np.nan, 1], "other"),
    ):
        with pytest.raises(HintError, match=f"^it is {said}$"):
            require_equal(
                found, [3.0, 4.0], mistakes, "other", said="it is ", atol=0.02
            )


TWO_LINES = np.zeros((720, 1280), np.uint8)
TWO_LINES[:, 297:326] = 255
TWO_LINES[:, 1034:1056] = 255


def width_in_view(mask, choose_left, choose_right, extra_px=0.0):
    """6.1: the width in metres, from one of the equally high columns of each line."""
    lower_half = mask[len(mask) // 2 :]
    columns = np.flatnonzero(lower_half.any(axis=0))
    left = columns[columns < 640]
    right = columns[columns >= 640]
    width_px = choose_right(right) - choose_left(left)
    across_m, _ = metres_per_pixel(WARP, IMAGE_TO_ROAD)
    return (width_px + extra_px) * across_m


def check_width(lane_width):
    return check_lane_width(
        lane_width,
        binary=TWO_LINES,
        warp=WARP,
        image_to_road=IMAGE_TO_ROAD,
        truth=None,
    )


@pytest.mark.parametrize(
    ("left", "right"),
    [(np.min, np.min), (np.mean, np.mean), (np.max, np.max), (np.max, np.min)],
)
def test_any_column_of_a_flat_peak_gives_the_lane_width(left, right):
    """6.1: peaks of 29 and 22 equally high columns."""
    verdict = check_width(lambda mask: width_in_view(mask, left, right))
    assert "for a drawn, narrower lane" in verdict
    with pytest.raises(HintError, match="m for this lane"):
        check_width(lambda mask: width_in_view(mask, left, right, extra_px=40.0))


@pytest.mark.parametrize("answer", ["3.58", [3.58], True, np.nan])
def test_a_lane_width_that_is_no_number_is_named(answer):
    """6.1"""
    with pytest.raises(HintError, match="return one number"):
        check_width(lambda mask: answer)


@pytest.mark.parametrize(("limit", "rejected"), [(11.3, 10), (np.inf, 0)])
def test_the_gate_rejects_the_neighbouring_lane_in_the_drawn_drive(limit, rejected):
    """12.2: a list of state and covariance is as good as a pair."""

    def correct_gated(state, covariance, z, noise, matrix):
        innovation = z - matrix @ state
        s = matrix @ covariance @ matrix.T + noise
        if innovation @ np.linalg.solve(s, innovation) > limit:
            return [state, covariance]
        gain = covariance @ matrix.T @ np.linalg.inv(s)
        return [state + gain @ innovation, covariance - gain @ matrix @ covariance]

    drive = filter_drive(correct_gated)
    assert np.count_nonzero(~drive.accepted) == rejected
    assert (np.abs(drive.offset_m - drive.true_m).max() < 0.15) == bool(rejected)
    if rejected:
        assert "skips the neighbouring lane" in check_gate(correct_gated)


IMAGE = np.full((720, 1280, 3), 60, np.uint8)
# By how much each covered cell of 80 x 80 pixels moves the two lines, metres. Those of
# the first row move nothing: they lie above the road.
CELLS = (5, 16)
WEIGHTS_M = np.random.default_rng(0).normal(0, 0.1, (2, *CELLS))
WEIGHTS_M[:, 0] = 0
# Without this cell the lane is lost.
LOST = (4, 9)


def find_occluded(image, camera=CAMERA):
    """A detector whose lines move where the image is covered."""
    cells = image[320:, ..., 0].reshape(5, 80, 16, 80)
    covered = (cells.mean(axis=(1, 3)) - 60) / 68
    if covered[LOST] > 0.5:
        return None
    moved_m = (WEIGHTS_M * covered).sum(axis=(1, 2))
    start_m = np.array([1.8, -1.8])

    def lateral_m(x_m):
        return start_m[:, None] + moved_m[:, None] * x_m / 20

    return SimpleNamespace(lateral_m=lateral_m)


def worst(moved_m: np.ndarray) -> float:
    return np.abs(moved_m).max()


@pytest.mark.parametrize(
    ("words", "measure", "at_m", "cover"),
    [
        ("", worst, 20.0, chapters_13_16.cover_square),
        (
            "left line alone",
            lambda moved_m: abs(moved_m[0, 0]),
            20.0,
            chapters_13_16.cover_square,
        ),
        (
            "right line alone",
            lambda moved_m: abs(moved_m[1, 0]),
            20.0,
            chapters_13_16.cover_square,
        ),
        (
            "absolute difference",
            lambda moved_m: max(0, moved_m.max()),
            20.0,
            chapters_13_16.cover_square,
        ),
        ("10 m ahead", worst, 10.0, chapters_13_16.cover_square),
        (
            " instead of ",
            lambda moved_m: worst(moved_m) / 3,
            20.0,
            chapters_13_16.cover_square,
        ),
        *(
            (reason, worst, 20.0, cover)
            for reason, cover in chapters_13_16.WRONG_COVERS.items()
        ),
    ],
)
def test_mistakes_in_occlusion_maps_are_named(monkeypatch, words, measure, at_m, cover):
    """13.1: the right map, and wrong ones."""
    moved_m = np.ones(chapters_13_16.SHAPE)
    before_m = find_occluded(IMAGE).lateral_m(np.array([at_m]))
    for row, column in np.ndindex(*chapters_13_16.SHAPE):
        if lane := find_occluded(cover(IMAGE, row, column)):
            moved_m[row, column] = min(
                1, measure(lane.lateral_m(np.array([at_m])) - before_m)
            )
    monkeypatch.setattr(chapters_13_16, "find_lane", find_occluded)
    with pytest.raises(HintError, match=re.escape(words)) if words else nullcontext():
        chapters_13_16.require_occlusion(moved_m, IMAGE, find_occluded(IMAGE), CAMERA)


def test_covering_the_given_image_itself_is_named(monkeypatch):
    """13.1"""
    monkeypatch.setattr(chapters_13_16, "find_lane", find_occluded)
    monkeypatch.setattr(chapters_13_16, "draw_lane", lambda image, *_, **__: image)

    def cover(image, camera):
        image[320:480, :160] = 128
        return np.ones(chapters_13_16.SHAPE)

    with pytest.raises(HintError, match="you cover the image itself"):
        chapters_13_16.check_occlusion_map(cover, image=IMAGE.copy(), camera=CAMERA)


@pytest.mark.parametrize(
    ("accuracy", "wrong", "median_m", "words"),
    [
        (0.95, 0.1, 0.1, ""),
        (0.5, 0.1, 0.1, "too few frames are right"),
        (0.95, 0.6, 0.1, "In the hairpins, return None"),
        (0.0, 1.0, 9.0, "left line first"),
    ],
)
def test_a_finder_is_judged_by_its_scores_on_the_videos(
    monkeypatch, accuracy, wrong, median_m, words
):
    """15.1: accuracy, share of confident and wrong frames, and median error."""
    row = {
        "accuracy": accuracy,
        "confident_and_wrong_share": wrong,
        "lateral_5_20m_median_m": median_m,
    }
    monkeypatch.setattr(
        chapters_13_16,
        "score_finders",
        lambda _: [(scene, {"yours": row}) for scene in COMMITTED],
    )
    with pytest.raises(HintError, match=words) if words else nullcontext():
        chapters_13_16.check_honest_finder(
            lambda image, camera: ((0, 0, 1.8), (0, 0, -1.8))
        )
