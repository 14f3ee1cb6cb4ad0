"""The course in the hands of a reader: cells run again in any order, exercises solved and answered wrongly."""

from __future__ import annotations

import importlib
import json
import pkgutil
import random
import re
import time
from collections.abc import Iterator

import nbformat
import pytest
from nbclient import NotebookClient

from course.exercises.check import CHECKS
from tests.course import wrong_answers
from tests.support.project import ROOT

NOTEBOOK = ROOT / "project.ipynb"
# Cells that take longer are not run again, to save time: they annotate videos, score drives and explain pictures.
LONG_CELL_S = 1.0
SOLUTION = re.compile(r"<summary>Solution</summary>.*?```python\n(.*?)```", re.S)
CHECK_LINE = re.compile(r'^(?:_ = )?helpers\.check_exercise\("([\d.]+)".*', re.M | re.S)


# nbval may execute the notebook at the same time, so this one writes its pictures and videos to a folder of its own.
# Its figures are drawn, but not turned into JPEG: nobody sees them.
OWN_OUTPUT = """
from dataclasses import replace as replace_field

DATA = replace_field(DATA, output=helpers.PROJECT_ROOT / ".pytest_cache" / "notebook_cells")
DATA.output.mkdir(parents=True, exist_ok=True)
get_ipython().run_line_magic("matplotlib", "agg")
plt.rcParams["figure.max_open_warning"] = 0
"""


class Session:
    """A kernel in which the whole notebook has run."""

    def __init__(self) -> None:
        self.notebook = nbformat.read(NOTEBOOK, as_version=4)
        setup = next(cell for cell in code_cells(self.notebook) if "DATA = helpers.open_dataset()" in cell.source)
        setup.source += OWN_OUTPUT
        self.duration_s: dict[str, float] = {}
        self.client = NotebookClient(self.notebook, timeout=120, resources={"metadata": {"path": str(ROOT)}})

    def run_all(self) -> None:
        for index, cell in enumerate(self.notebook.cells):
            if cell.cell_type == "code":
                started_s = time.perf_counter()
                self.client.execute_cell(cell, index)
                self.duration_s[cell.id] = time.perf_counter() - started_s

    def run(self, source: str) -> list[dict]:
        """Outputs of a piece of code that runs after the notebook."""
        cell = nbformat.v4.new_code_cell(source)
        self.notebook.cells.append(cell)
        self.client.execute_cell(cell, len(self.notebook.cells) - 1)
        self.notebook.cells.pop()
        return cell.outputs


def code_cells(notebook: nbformat.NotebookNode) -> list[nbformat.NotebookNode]:
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def printed(outputs: list[dict]) -> str:
    """Everything that a cell prints, and the text of its figures and values."""
    return "".join(out.get("text") or out.get("data", {}).get("text/plain", "") for out in outputs)


@pytest.fixture(scope="module")
def session() -> Iterator[Session]:
    session = Session()
    session.client.km = session.client.create_kernel_manager()
    session.client.km.transport = "ipc"
    with session.client.setup_kernel():
        session.run_all()
        yield session


def exercises() -> list[tuple[str, str, str]]:
    """(number, check line of the starter cell, solution) of each exercise in the notebook."""
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    sources = ["".join(cell["source"]) for cell in cells]
    found = []
    for index, source in enumerate(sources):
        check = CHECK_LINE.search(source) if cells[index]["cell_type"] == "code" else None
        if check:
            solution = SOLUTION.search(sources[index + 1])
            found.append((check.group(1), check.group(0), solution.group(1) if solution else ""))
    return found


def wrong() -> list[tuple[str, str, str]]:
    """(number, code, part of the hint) of each wrong answer."""
    cases = []
    for module in pkgutil.iter_modules(wrong_answers.__path__):
        answers = importlib.import_module(f"tests.course.wrong_answers.{module.name}").WRONG_ANSWERS
        cases += [(number, code, hint) for number, listed in answers.items() for code, hint in listed]
    return cases


def test_every_exercise_has_a_check_a_solution_and_wrong_answers():
    numbers = [number for number, _, _ in exercises()]
    assert sorted(numbers) == sorted(CHECKS)
    assert {int(number.split(".")[0]) for number in numbers} == set(range(1, 16))
    assert all(solution for _, _, solution in exercises())
    assert {number for number, _, _ in wrong()} == set(numbers)


def test_every_cell_can_run_again_in_any_order(session):
    cells = [cell for cell in code_cells(session.notebook) if session.duration_s[cell.id] < LONG_CELL_S]
    assert len(cells) >= 60
    before = {cell.id: printed(cell.outputs) for cell in cells}
    shuffled = random.Random(1).sample(cells, len(cells))
    changed = [cell.source for cell in shuffled if printed(session.run(cell.source)) != before[cell.id]]
    assert not changed


@pytest.mark.parametrize(("number", "check", "solution"), exercises(), ids=[number for number, _, _ in exercises()])
def test_the_solution_is_correct(session, number, check, solution):
    text = printed(session.run(f"{solution}\n{check}"))
    assert text.startswith(f"{number}: correct"), text


@pytest.mark.parametrize(("number", "code", "hint"), wrong(), ids=[number for number, _, _ in wrong()])
def test_a_wrong_answer_gets_its_hint(session, number, code, hint):
    check = next(check for one, check, _ in exercises() if one == number)
    text = printed(session.run(f"{code}\n{check}"))
    assert text.startswith(f"{number}: ") and hint in text and "correct" not in text, text
