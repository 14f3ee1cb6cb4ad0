"""The course in the hands of a reader: cells run again in any order, exercises solved
and answered wrongly.

These checks follow the notebook's cells in nbval's kernel (see
`tests.end_to_end.nbval_plugin`), so that the notebook is executed once.
"""

from __future__ import annotations

import json
import random
import re
from collections import defaultdict
from collections.abc import Callable, Iterator
from functools import partial
from itertools import pairwise
from pathlib import Path

import nbformat
import pytest
from nbval.plugin import IPyNbCell, IPyNbFile

from course.grading.submission import CHECK_CALL
from tests.course.wrong_answers import WRONG_ANSWERS, wrong_code
from tests.support.project import ROOT

NOTEBOOK = ROOT / "project.ipynb"
CELLS = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
# Cells that are not run again, because they calibrate, annotate videos, score drives or
# explain images, which takes seconds.
SLOW_CALLS = re.compile(
    r"calibrate|process_video|VideoFileClip|follow\(|score_|explain|\btrack\("
)
# Tags of the cell of an exercise.
EXERCISE_TAGS = ["exercise", "nbval-ignore-output"]
SOLUTION = re.compile(r"<summary>Solution</summary>.*?```python\n(.*?)```", re.S)
# Nobody sees the figures of these checks, so they are drawn, but not turned into JPEG.
WITHOUT_JPEG = """
get_ipython().run_line_magic("matplotlib", "agg")
plt.rcParams["figure.max_open_warning"] = 0
"""

# Runs code in the kernel and returns what it prints.
Run = Callable[[str], str]


class ReaderItem(pytest.Item):
    """One check: a function that takes a `Run`."""

    def __init__(self, *, check: Callable[[Run], None], **given) -> None:
        super().__init__(**given)
        self.check = check

    def runtest(self) -> None:
        self.check(self.run)

    def repr_failure(self, excinfo: pytest.ExceptionInfo) -> str:
        """The answer of the check, without the stack of pytest."""
        return str(excinfo.value)

    def reportinfo(self) -> tuple[Path, None, str]:
        """Where the report says that the check is, and its name."""
        return self.path, None, self.name

    def run(self, source: str) -> str:
        """What this code prints. Raises nbval's error if the code does."""
        code = nbformat.v4.new_code_cell(source)
        cell = IPyNbCell.from_parent(
            self.parent,
            name=self.name,
            cell_num=-1,
            cell=code,
            options=defaultdict(bool),
        )
        cell.runtest()
        return printed(cell.test_outputs)


def printed(outputs: list[dict]) -> str:
    """Everything that a cell prints, and its value as text, without figures."""
    shown = (out for out in outputs if out["output_type"] != "display_data")
    return "".join(out.get("text") or out["data"]["text/plain"] for out in shown)


def reader_items(notebook: IPyNbFile, cells: list[IPyNbCell]) -> Iterator[ReaderItem]:
    """The checks that follow the cells of the notebook."""

    def item(name: str, check: Callable, *arguments: object) -> ReaderItem:
        return ReaderItem.from_parent(
            notebook, name=name, check=partial(check, *arguments)
        )

    yield item("every cell can run again in any order", run_again_in_any_order, cells)
    check_lines = {}
    for number, check_line, solution in exercises():
        check_lines[number] = check_line
        yield item(
            f"solution of {number}", expect_correct, number, f"{solution}\n{check_line}"
        )
    for index, (number, code, hint) in enumerate(wrong()):
        yield item(
            f"wrong answer {index} to {number}",
            expect_hint,
            number,
            f"{code}\n{check_lines[number]}",
            hint,
        )


def run_again_in_any_order(cells: list[IPyNbCell], run: Run) -> None:
    """Each quick cell prints the same when all of them run again, shuffled."""
    compared = [cell for cell in cells if cell.options["check"]]
    quick = [cell for cell in compared if not SLOW_CALLS.search(cell.cell.source)]
    assert len(quick) > len(cells) / 2
    run(WITHOUT_JPEG)
    shuffled = random.Random(1).sample(quick, len(quick))
    changed = [
        cell.cell.id
        for cell in shuffled
        if run(cell.cell.source) != printed(cell.test_outputs)
    ]
    assert not changed, f"cells {changed} print something else when they run again"


def expect_correct(number: str, code: str, run: Run) -> None:
    text = run(code)
    assert text.startswith(f"{number}: correct"), text


def expect_hint(number: str, code: str, hint: str, run: Run) -> None:
    text = run(code)
    assert text.startswith(f"{number}: "), text
    assert hint in text, text
    assert "correct" not in text, text


def exercises() -> list[tuple[str, str, str]]:
    """(number, check line of the starter cell, solution) of each exercise in the
    notebook.
    """
    found = []
    for cell, after in pairwise(CELLS):
        check = CHECK_CALL.search(source(cell)) if cell["cell_type"] == "code" else None
        if check:
            solution = SOLUTION.search(source(after))
            found.append(
                (check.group(1), check.group(0), solution.group(1) if solution else "")
            )
    return found


def solved_notebook() -> nbformat.NotebookNode:
    """The notebook with each folded solution in place of its starter, and without
    outputs.
    """
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    solutions = {check_line: solution for _, check_line, solution in exercises()}
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs = []
            cell.execution_count = None
            check = CHECK_CALL.search(cell.source)
            if check:
                cell.source = f"{solutions[check.group(0)]}\n{check.group(0)}"
    return notebook


def source(cell: dict) -> str:
    return "".join(cell["source"])


def wrong() -> list[tuple[str, str, str]]:
    """(number, code, part of the hint) of each wrong answer."""
    solutions = {number: solution for number, _, solution in exercises()}
    return [
        (number, wrong_code(solutions[number], *steps), hint)
        for number, listed in WRONG_ANSWERS.items()
        for hint, *steps in listed
    ]
