"""What the check of an exercise prints."""

from __future__ import annotations

import pytest

from course.exercises import check as module
from course.exercises.check import check_exercise
from course.exercises.verdict import NOT_TRIED, correct, hint


def test_an_answer_of_none_is_not_tried(capsys):
    check_exercise("6.1", None)
    assert capsys.readouterr().out == "6.1: not tried yet.\n"


def test_an_error_in_the_answer_is_reported_in_one_line(monkeypatch, capsys):
    monkeypatch.setitem(module.CHECKS, "0.1", lambda answer: correct(str(answer())))
    check_exercise("0.1", lambda: 1 / 0)
    assert capsys.readouterr().out == "0.1: your answer raised ZeroDivisionError: division by zero\n"


def test_verdicts_in_words():
    assert str(correct("3.58 m.")) == "correct, 3.58 m."
    assert str(hint("Too wide.")) == "Too wide."
    assert not NOT_TRIED.correct


def test_an_unknown_number_is_named():
    with pytest.raises(ValueError, match=r"'99\.1'.*6\.1"):
        check_exercise("99.1", 1)
