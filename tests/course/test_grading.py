"""Grading: a small course of two exercises, and notebooks of students who did this and
that with it.
"""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import nbformat
import pytest
from nbformat import v4

from course.exercises.check import WrongAnswerError, check_exercise
from course.grading import __main__ as command
from course.grading.grade import OTHER_CELLS, grade_notebook
from course.grading.submission import read_course, read_submission
from tests.end_to_end.notebook_reader import (
    EXERCISE_TAGS,
    NOTEBOOK,
    exercises,
    solved_notebook,
)

# Exercises that are quick and need nothing of the cells before.
FIRST, SECOND = "9.1", "14.1"
STARTERS = {
    FIRST: "def pitch_error_deg(*given):\n    return None",
    SECOND: "def largest_share(*given):\n    return None",
}
CALLS = {number: call for number, call, _ in exercises()}
SOLUTIONS = {number: solution for number, _, solution in exercises()}
SETUP, LAST = (
    "import numpy as np\n\nimport course\n\nprint(2 + 3)",
    "print(np.arange(3))",
)
CELL_TIMEOUT_S = 120

Answers = dict[str, str | None]


def executed(source: str, printed: str, name: str) -> nbformat.NotebookNode:
    output = v4.new_output("stream", text=printed)
    return v4.new_code_cell(source, outputs=[output], execution_count=1, id=name)


def exercise_cell(number: str, answer: str) -> nbformat.NotebookNode:
    """A cell whose saved output says that the answer is correct."""
    cell = executed(
        f"{answer}\n\n{CALLS[number]}",
        f"{number}: correct, as saved.\n",
        f"ex{number[0]}",
    )
    cell.metadata["tags"] = EXERCISE_TAGS
    return cell


def small_notebook(answers: Answers) -> nbformat.NotebookNode:
    """The small course with these answers; an exercise without its cell for None."""
    answered = [
        exercise_cell(number, answer)
        for number, answer in answers.items()
        if answer is not None
    ]
    cells = [
        executed(SETUP, "5\n", "setup"),
        *answered,
        executed(LAST, "[0 1 2]\n", "last"),
    ]
    return v4.new_notebook(cells=cells)


Grade = Callable[..., dict[str, tuple[str, str]]]


@pytest.fixture
def grade(tmp_path) -> Grade:
    """A function that grades a notebook, or a text in its place: exercise to (result,
    message).
    """
    nbformat.write(small_notebook(STARTERS), tmp_path / "course.ipynb")
    course = read_course(tmp_path / "course.ipynb")

    def grade(
        handed_in: nbformat.NotebookNode | str,
        *,
        cell_timeout_s: float = CELL_TIMEOUT_S,
    ) -> dict[str, tuple[str, str]]:
        text = handed_in if isinstance(handed_in, str) else nbformat.writes(handed_in)
        (tmp_path / "student.ipynb").write_text(text)
        verdicts = grade_notebook(
            tmp_path / "student.ipynb", course, cell_timeout_s=cell_timeout_s
        )
        return {
            verdict.exercise: (verdict.result, verdict.message) for verdict in verdicts
        }

    return grade


def test_an_untouched_notebook_is_not_tried(grade):
    assert grade(small_notebook(STARTERS)) == {
        FIRST: ("not tried", ""),
        SECOND: ("not tried", ""),
        OTHER_CELLS: ("as in the course", ""),
    }


def test_right_answers_pass_although_the_outputs_were_cleared(grade):
    notebook = small_notebook(SOLUTIONS_OF_BOTH)
    for cell in notebook.cells:
        cell.outputs = []
        cell.execution_count = None
    graded = grade(notebook)
    assert {name: result for name, (result, _) in graded.items()} == {
        FIRST: "passed",
        SECOND: "passed",
        OTHER_CELLS: "as in the course",
    }
    assert graded[FIRST][1].startswith("4 errors")


def test_a_wrong_answer_gets_its_hint_although_a_right_output_was_saved(grade):
    wrong = SOLUTIONS[SECOND].replace("-confidence", "confidence")
    graded = grade(small_notebook(SOLUTIONS_OF_BOTH | {SECOND: wrong}))
    assert graded[FIRST][0] == "passed"
    assert graded[SECOND][0] == "wrong"
    assert "the other way round" in graded[SECOND][1]


def test_an_exercise_whose_cell_was_deleted_is_not_tried(grade):
    graded = grade(small_notebook(SOLUTIONS_OF_BOTH | {FIRST: None}))
    assert graded[FIRST] == ("not tried", "there is no cell with this exercise.")
    assert graded[SECOND][0] == "passed"
    assert graded[OTHER_CELLS][0] == "as in the course"


def test_an_answer_that_raises_is_wrong(grade):
    graded = grade(small_notebook(SOLUTIONS_OF_BOTH | {FIRST: "1 / 0"}))
    assert graded[FIRST] == (
        "wrong",
        "the cell raised ZeroDivisionError: division by zero",
    )
    assert graded[SECOND][0] == "passed"


@pytest.mark.slow
def test_an_endless_answer_is_stopped_and_the_others_are_graded(grade):
    graded = grade(
        small_notebook(SOLUTIONS_OF_BOTH | {FIRST: "while True:\n    pass"}),
        cell_timeout_s=15,
    )
    assert graded[FIRST][0] == "wrong"
    assert "did not end" in graded[FIRST][1]
    assert graded[SECOND][0] == "passed"


@pytest.mark.slow
def test_an_answer_that_ends_the_kernel_is_wrong_and_the_others_are_graded(grade):
    graded = grade(
        small_notebook(SOLUTIONS_OF_BOTH | {FIRST: "import os\n\nos._exit(3)"})
    )
    assert graded[FIRST][0] == "wrong"
    assert "the kernel died" in graded[FIRST][1]
    assert graded[SECOND][0] == "passed"
    assert graded[OTHER_CELLS][0] == "as in the course"


@pytest.mark.parametrize(
    "text",
    ["", '{"cells": [{"cell_type": "code"', "[]", '{"cells": [3], "nbformat": 4}'],
)
def test_a_damaged_notebook_is_not_graded(grade, text):
    graded = grade(text)
    assert {result for result, _ in graded.values()} == {"not graded"}
    assert "student.ipynb: cannot be read as a notebook" in graded[OTHER_CELLS][1]


def test_the_call_of_the_check_must_stay(grade):
    notebook = small_notebook(SOLUTIONS_OF_BOTH)
    notebook.cells[1].source = notebook.cells[1].source.replace(
        CALLS[FIRST], f'print("{FIRST}: correct, 1.")'
    )
    notebook.cells[2].source = notebook.cells[2].source.replace(
        "largest_share)", "lambda *given: 1)"
    )
    graded = grade(notebook)
    assert graded[FIRST] == ("not tried", "there is no cell with this exercise.")
    assert graded[SECOND][0] == "wrong"
    assert "put it back" in graded[SECOND][1]


def test_tags_and_comments_cannot_hide_a_wrong_answer(grade):
    skipping = "# NBVAL_SKIP\n" + STARTERS[SECOND]
    notebook = small_notebook({FIRST: STARTERS[FIRST], SECOND: skipping})
    notebook.cells[1].metadata["tags"] = ["raises-exception"]
    graded = grade(notebook)
    assert graded[FIRST] == graded[SECOND] == ("not tried", "")


def test_changed_cells_of_the_course_are_named(grade):
    notebook = small_notebook(SOLUTIONS_OF_BOTH)
    notebook.cells[0].source += "\nx = 1"
    result, message = grade(notebook)[OTHER_CELLS]
    assert result == "differ"
    assert message == "changed or missing: setup"


def test_other_outputs_of_the_course_are_named_whatever_was_saved(grade):
    """A cell of the student's own changes what a cell of the course prints; the saved
    output hides it.
    """
    notebook = small_notebook(SOLUTIONS_OF_BOTH)
    notebook.cells[-1].outputs[0].text = "3\n"
    notebook.cells.insert(
        3, v4.new_code_cell("np = type('', (), {'arange': lambda n: n})")
    )
    result, message = grade(notebook)[OTHER_CELLS]
    assert result == "differ"
    assert message == "last: Cell outputs differ"


def test_cells_of_the_students_own_may_fail(grade):
    notebook = small_notebook(SOLUTIONS_OF_BOTH)
    notebook.cells.append(v4.new_code_cell("1 / 0"))
    assert grade(notebook)[OTHER_CELLS] == ("as in the course", "and 1 more")


SOLUTIONS_OF_BOTH: Answers = {number: SOLUTIONS[number] for number in (FIRST, SECOND)}


@pytest.fixture
def small_project(tmp_path, monkeypatch) -> Path:
    """A folder whose project.ipynb is the small course; the command grades by it."""
    nbformat.write(small_notebook(STARTERS), tmp_path / "project.ipynb")
    monkeypatch.setattr(command, "PROJECT_ROOT", tmp_path)
    (tmp_path / "handed_in" / "b").mkdir(parents=True)
    return tmp_path


def test_the_command_prints_and_writes_a_table(small_project, capsys):
    handed_in = small_project / "handed_in"
    nbformat.write(small_notebook(SOLUTIONS_OF_BOTH), handed_in / "anna.ipynb")
    nbformat.write(small_notebook(STARTERS), handed_in / "b" / "ben.ipynb")
    grades = small_project / "grades.csv"
    assert command.main(["--csv", str(grades), str(handed_in)]) == 1
    printed = capsys.readouterr().out.splitlines()
    assert printed[-2].endswith(
        "anna.ipynb: 2 of 2 passed; other cells as in the course"
    )
    assert printed[-1].endswith(
        "ben.ipynb: 0 of 2 passed; other cells as in the course"
    )
    rows = list(csv.DictReader(grades.open()))
    assert [row["result"] for row in rows if row["exercise"] == FIRST] == [
        "passed",
        "not tried",
    ]


def test_the_exit_status_is_0_if_all_pass(small_project):
    nbformat.write(
        small_notebook(SOLUTIONS_OF_BOTH), small_project / "handed_in" / "anna.ipynb"
    )
    assert command.main([str(small_project / "handed_in")]) == 0


def test_a_folder_without_notebooks_is_named(small_project, capsys):
    assert command.main([str(small_project / "handed_in")]) == 2
    assert "handed_in: has no notebooks" in capsys.readouterr().err


def test_the_notebook_to_hand_out_has_all_but_the_solutions(tmp_path):
    for_students = tmp_path / "for_students.ipynb"
    assert command.main(["--hand-out", str(for_students)]) == 0
    course = read_course(NOTEBOOK)
    assert read_submission(for_students, course).missing == []
    assert read_course(for_students).exercises == course.exercises
    prose = for_students.read_text()
    assert "<summary>Answer</summary>" in prose
    assert "<summary>Solution</summary>" not in prose


def test_an_image_beside_the_notebook_can_be_read(grade, tmp_path):
    (tmp_path / "road.JPG").write_bytes(b"x")
    answer = f"assert open('road.JPG').read() == 'x'\n{SOLUTIONS[FIRST]}"
    assert (
        grade(small_notebook(SOLUTIONS_OF_BOTH | {FIRST: answer}))[FIRST][0] == "passed"
    )


@pytest.mark.parametrize("answer", [None, lambda *given: 1 / 0, lambda *given: -1.0])
def test_in_grading_mode_a_wrong_answer_is_an_error(monkeypatch, answer):
    monkeypatch.setenv("LANES_GRADING", "1")
    with pytest.raises(WrongAnswerError, match=r"^9\.1: "):
        check_exercise("9.1", answer)


@pytest.mark.slow
def test_the_whole_course_passes_with_its_folded_solutions_and_cleared_outputs(
    tmp_path, capsys
):
    nbformat.write(solved_notebook(), tmp_path / "solved.ipynb")
    assert command.main([str(tmp_path / "solved.ipynb")]) == 0, capsys.readouterr().out
    count = len(read_course(NOTEBOOK).exercises)
    assert f"{count} of {count} passed" in capsys.readouterr().out
