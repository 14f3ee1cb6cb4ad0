"""The verdicts on a student's notebook: one for each exercise, and one on the cells of
the course.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from course.exercises.check import WrongAnswerError
from course.grading.run import CellResult, run_cells
from course.grading.submission import (
    Course,
    Submission,
    SubmissionError,
    SubmittedCell,
    read_submission,
)

PASSED, WRONG, NOT_TRIED, NOT_GRADED = "passed", "wrong", "not tried", "not graded"
OTHER_CELLS = "other cells"
AS_IN_THE_COURSE = "as in the course"
CHANGED_CALL = (
    "the last statement is not the call of check_exercise of the course; put it back."
)


@dataclass(frozen=True)
class Verdict:
    """A row of the table: exercise or "other cells", one of the words above, and the
    number reached or the hint.
    """

    exercise: str
    result: str
    message: str = ""

    @property
    def good(self) -> bool:
        """Whether the exercise is passed, or the other cells are as in the course."""
        return self.result in (PASSED, AS_IN_THE_COURSE)


def grade_notebook(
    path: Path, course: Course, *, cell_timeout_s: float
) -> list[Verdict]:
    """Run a student's notebook and return a verdict for each exercise of the course,
    and one on the other cells.

    A notebook that cannot be read gets "not graded" with the reason. A cell that runs
    longer than `cell_timeout_s` is wrong.
    """
    try:
        submission = read_submission(path, course)
    except SubmissionError as error:
        unread = [Verdict(number, NOT_GRADED) for number in course.exercises]
        return [*unread, Verdict(OTHER_CELLS, NOT_GRADED, str(error))]
    results = run_submission(
        submission, course, media=path.parent, cell_timeout_s=cell_timeout_s
    )
    verdicts = [
        judge_exercise(number, submission, results) for number in course.exercises
    ]
    return [*verdicts, judge_other_cells(submission, results)]


def run_submission(
    submission: Submission, course: Course, *, media: Path, cell_timeout_s: float
) -> list[CellResult]:
    """A result for each cell; `media` is the folder with the student's own images.

    If an answer ends the kernel, the notebook is run again without this answer, so that
    the others are graded.
    """
    ended_kernel: dict[int, CellResult] = {}
    while True:
        cells = [submitted.cell for submitted in submission.cells]
        results = run_cells(cells, media=media, cell_timeout_s=cell_timeout_s)
        index = _answer_that_ended_the_kernel(submission, results)
        if index is None or index in ended_kernel:
            break
        ended_kernel[index] = results[index]
        submission = submission.with_starter(index, course)

    for index, result in ended_kernel.items():
        results[index] = result
    return results


def _answer_that_ended_the_kernel(
    submission: Submission, results: list[CellResult]
) -> int | None:
    """The index of its cell; None if there is no such answer."""
    for index, result in enumerate(results):
        if not result.ended and submission.cells[index].exercise:
            return index
    return None


def judge_exercise(
    number: str, submission: Submission, results: list[CellResult]
) -> Verdict:
    """The verdict on an exercise; of several cells with this exercise the best one
    counts, else the last one.
    """
    verdict = Verdict(number, NOT_TRIED, "there is no cell with this exercise.")
    for submitted, result in zip(submission.cells, results, strict=True):
        if submitted.exercise == number:
            verdict = _judge_answer(submitted, result)
            if verdict.good:
                break
    return verdict


def _judge_answer(submitted: SubmittedCell, result: CellResult) -> Verdict:
    number = submitted.exercise
    assert number is not None
    hint = result.error_text.removeprefix(f"{number}: ")
    if submitted.changed_call:
        return Verdict(number, WRONG, CHANGED_CALL)
    if not result.ended or result.error == "KeyboardInterrupt":
        message = f"the cell did not end by itself: {result.failed}"
        return Verdict(number, WRONG, message)
    if result.error == WrongAnswerError.__name__:
        if hint == "not tried yet.":
            return Verdict(number, NOT_TRIED)
        return Verdict(number, WRONG, hint)
    if result.error:
        return Verdict(number, WRONG, f"the cell raised {result.error}: {hint}")
    if result.failed:
        message = f"the cell {result.failed}: an earlier cell ended the kernel."
        return Verdict(number, NOT_GRADED, message)

    said = f"{number}: correct, "
    if said not in result.printed:
        message = "the check did not print that the answer is correct."
        return Verdict(number, WRONG, message)
    reached = result.printed.partition(said)[2].splitlines()[0]
    return Verdict(number, PASSED, reached)


def judge_other_cells(submission: Submission, results: list[CellResult]) -> Verdict:
    """Whether the cells of the course are all there, unchanged, and give the outputs of
    the course.
    """
    faults = []
    if submission.missing:
        faults.append(f"changed or missing: {', '.join(submission.missing)}")
    own_cells = 0
    for submitted, result in zip(submission.cells, results, strict=True):
        if submitted.of_course and result.failed:
            reason = result.failed
            if result.error:
                reason = f"{result.error}: {result.error_text}"
            faults.append(f"{submitted.cell.id}: {reason}")
        if not submitted.of_course and not submitted.exercise:
            own_cells += 1
    if faults:
        return Verdict(OTHER_CELLS, "differ", "; ".join(faults))
    message = f"and {own_cells} more" if own_cells else ""
    return Verdict(OTHER_CELLS, AS_IN_THE_COURSE, message)
