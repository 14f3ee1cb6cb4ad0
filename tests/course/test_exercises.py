"""What the check of an exercise prints, and right answers that differ from the folded solution."""

import numpy as np
import pytest

from classic.recipe import get_recipe, recipe_from_pose
from classic.warp import metres_per_pixel
from course.exercises import chapter_06, check
from course.exercises.chapter_12 import _correct, _distance, check_gate
from course.exercises.check import check_exercise
from course.exercises.verdict import NOT_TRIED, correct, hint
from tests.support.painted_drive import CAMERA


def test_no_answer_and_an_error_in_the_answer_are_reported_in_one_line(monkeypatch, capsys):
    check_exercise("6.1", None)
    assert capsys.readouterr().out == "6.1: not tried yet.\n"
    monkeypatch.setitem(check.CHECKS, "0.1", lambda answer: correct(str(answer())))
    check_exercise("0.1", lambda: 1 / 0)
    assert capsys.readouterr().out == "0.1: your answer raised ZeroDivisionError: division by zero\n"


def test_verdicts_and_unknown_numbers_in_words():
    assert str(correct("3.58 m.")) == "correct, 3.58 m."
    assert str(hint("Too wide.")) == "Too wide."
    assert not NOT_TRIED.correct
    with pytest.raises(ValueError, match=r"'99\.1'.*6\.1"):
        check_exercise("99.1", 1)


@pytest.mark.parametrize("columns", [709, 737, 733.5, 730])
def test_any_column_of_a_flat_peak_gives_the_lane_width(monkeypatch, columns):
    """6.1: two peaks of 29 and 22 equally high columns; their inner ends, first, middle and last columns."""
    histogram = np.zeros(1280)
    histogram[297:326], histogram[1034:1056] = 360, 720
    monkeypatch.setattr(chapter_06, "lane_histogram", lambda mask: histogram)
    warp = recipe_from_pose(get_recipe("hls_sobel"), CAMERA).four_point_warp()
    view = {"above": np.zeros((720, 1280, 3), np.uint8), "warp": warp, "camera": CAMERA, "truth": None}
    across_m = metres_per_pixel(warp, CAMERA)[0]
    assert chapter_06.check_lane_width(columns * across_m, **view).correct
    assert not chapter_06.check_lane_width((columns + 12) * across_m, **view).correct


def test_a_list_of_state_and_covariance_is_as_good_as_a_pair():

    def correct_gated(state, covariance, z, noise, matrix):
        return [state, covariance] if _distance(z) > 11.34 else list(_correct(z))

    assert check_gate(correct_gated).correct
