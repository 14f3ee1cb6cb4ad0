"""A student's notebook, cell by cell, beside the notebook of the course."""

from __future__ import annotations

import re
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path

import nbformat

# The call that checks an exercise is the last statement of its cell.
CHECK_CALL = re.compile(r'^course\.check_exercise\(\s*"([\d.]+)".*', re.M | re.S)
# The folded solution stands in the text below the exercise.
SOLUTION = re.compile(r"<details>\s*<summary>Solution</summary>.*?</details>", re.S)
# A copy of a cell may have a changed call, which is looked for less strictly.
_NUMBER = re.compile(r"""check_exercise\(\s*["']([\d.]+)["']""")
# Comments that tell nbval to skip a cell, or to accept its error.
_NBVAL_COMMENT = re.compile(r"^\s*#+\s*(NBVAL|PYTEST_VALIDATE)_\w+\s*$", re.M)


class SubmissionError(ValueError):
    """A notebook cannot be read; the message names the file and what to do."""


@dataclass(frozen=True)
class Exercise:
    """An exercise of the course: its number, the call that checks it, and its cell as
    handed out.
    """

    number: str
    call: str
    starter: str


@dataclass(frozen=True, eq=False)
class Course:
    """The committed notebook: its exercises by number, and its other code cells by
    their source.
    """

    exercises: dict[str, Exercise]
    other_cells: dict[str, nbformat.NotebookNode]


@dataclass(frozen=True, eq=False)
class SubmittedCell:
    """A code cell as it is run: a cell of the course, a student's exercise, or a
    student's own cell.

    `exercise` is the number of the exercise, and `of_course` says that the cell is one
    of the course, unchanged. `changed_call` says that the call of `check_exercise` is
    not that of the course.
    """

    cell: nbformat.NotebookNode
    exercise: str | None = None
    of_course: bool = False
    changed_call: bool = False


@dataclass(frozen=True, eq=False)
class Submission:
    """The code cells of a student's notebook in their order, and the names of course
    cells that are missing.
    """

    cells: list[SubmittedCell]
    missing: list[str]

    def with_starter(self, index: int, course: Course) -> Submission:
        """The same submission with the starter of the course in the exercise cell
        `index`.
        """
        number = self.cells[index].exercise
        assert number is not None
        starter = _unrun_cell(course.exercises[number].starter)
        cells = [*self.cells]
        cells[index] = replace(cells[index], cell=starter)
        return replace(self, cells=cells)


def read_notebook(path: Path) -> nbformat.NotebookNode:
    """Read a notebook. Raises SubmissionError if it is missing or damaged."""
    try:
        notebook = nbformat.read(path, as_version=4)
        kinds_and_sources = [(cell.cell_type, cell.source) for cell in notebook.cells]
    # nbformat raises what it meets in damaged JSON: errors of keys, attributes and
    # types
    except Exception as error:
        raise SubmissionError(
            f"{path}: cannot be read as a notebook ({type(error).__name__}: {error}); "
            "ask for the file again."
        ) from error
    if not all(isinstance(source, str) for _, source in kinds_and_sources):
        raise SubmissionError(
            f"{path}: has a cell without text; ask for the file again."
        )
    return notebook


def read_course(path: Path) -> Course:
    """Read the notebook of the course. Raises SubmissionError if it cannot be read."""
    exercises = {}
    other_cells = {}
    for cell in _code_cells(read_notebook(path)):
        source = _normal(cell.source)
        call = CHECK_CALL.search(source)
        if call:
            number = call.group(1)
            exercises[number] = Exercise(number, call.group(0), source)
        else:
            other_cells[source] = cell
    return Course(exercises, other_cells)


def read_submission(path: Path, course: Course) -> Submission:
    """Read a student's notebook. Raises SubmissionError if it cannot be read.

    A cell of the course gets the outputs of the course, whatever was saved, so that
    nbval compares with those. All other cells are run without a comparison.
    """
    cells = []
    for cell in _code_cells(read_notebook(path)):
        source = _normal(cell.source)
        number = _NUMBER.search(source)
        if source in course.other_cells:
            ours = course.other_cells[source]
            cells.append(SubmittedCell(ours, of_course=True))
        elif number and number.group(1) in course.exercises:
            exercise = course.exercises[number.group(1)]
            changed = not f"\n{source}".endswith(f"\n{exercise.call}")
            answered = _unrun_cell(_NBVAL_COMMENT.sub("", source))
            cells.append(SubmittedCell(answered, exercise.number, changed_call=changed))
        else:
            cells.append(SubmittedCell(_unrun_cell(_NBVAL_COMMENT.sub("", source))))
    there = {cell.cell.source for cell in cells if cell.of_course}
    missing = [
        ours.id for ours in course.other_cells.values() if ours.source not in there
    ]
    return Submission(cells, missing)


def without_solutions(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """A copy of the course to hand out: without the folded solutions."""
    copy = deepcopy(notebook)
    for cell in copy.cells:
        if cell.cell_type == "markdown":
            cell.source = SOLUTION.sub("", cell.source)
    return copy


def _code_cells(notebook: nbformat.NotebookNode) -> Iterator[nbformat.NotebookNode]:
    for cell in notebook.cells:
        if cell.cell_type == "code" and cell.source.strip():
            yield cell


def _normal(source: str) -> str:
    """The source without spaces at the ends of lines, which some editors remove, and in
    one form of line ends.
    """
    lines = [line.rstrip() for line in source.splitlines()]
    return "\n".join(lines).strip("\n")


def _unrun_cell(source: str) -> nbformat.NotebookNode:
    """A cell that was never executed: nbval runs it and compares nothing."""
    return nbformat.v4.new_code_cell(source)
