"""Form of the notebook, whose numbers and figures nbval compares (see the Makefile),
and of helpers.py.
"""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys

import numpy as np
import pytest

import course
import helpers
import lanes
from course.exercises.check import CHECKS
from course.grading.submission import CHECK_CALL
from tests.end_to_end.nbval_plugin import figure_fault
from tests.end_to_end.notebook_reader import (
    CELLS,
    EXERCISE_TAGS,
    NOTEBOOK,
    exercises,
    source,
    wrong,
)
from tests.support.project import ROOT
from tools.sizes import code_lines

CODE_CELLS = [cell for cell in CELLS if cell["cell_type"] == "code"]
LAST_CLASSIC_CHAPTER = 8


def chapters() -> dict[int, list[dict]]:
    """The cells of each chapter; 0 is the introduction."""
    found: dict[int, list[dict]] = {}
    for cell in CELLS:
        found.setdefault(int(cell["id"][2:4]), []).append(cell)
    return found


def test_is_executed_from_top_to_bottom_without_errors():
    # nbval accepts a notebook without outputs, so its comparison depends on this test.
    assert [cell["execution_count"] for cell in CODE_CELLS] == list(
        range(1, len(CODE_CELLS) + 1)
    )
    for cell in CODE_CELLS:
        kinds = {output["output_type"] for output in cell["outputs"]} | {
            o.get("name") for o in cell["outputs"]
        }
        assert not kinds & {"error", "stderr"}, source(cell)


# The cell that reads the clock: its milliseconds differ in each run.
TIMING_CELLS = {cell["id"] for cell in CODE_CELLS if "perf_counter()" in source(cell)}
EXERCISE_CELLS = {
    cell["id"]: cell for cell in CODE_CELLS if CHECK_CALL.search(source(cell))
}


def tags(cell: dict) -> set[str]:
    return set(cell["metadata"].get("tags", []))


def test_only_milliseconds_and_exercises_are_not_compared():
    """Plain nbval compares the text of all other cells; a teacher grades with it."""
    not_compared = {
        cell["id"] for cell in CODE_CELLS if "nbval-ignore-output" in tags(cell)
    }
    assert len(TIMING_CELLS) == 1
    assert not_compared == TIMING_CELLS | EXERCISE_CELLS.keys()
    for cell in CODE_CELLS:
        assert not tags(cell) & {
            "nbval-skip",
            "raises-exception",
            "nbval-raises-exception",
        }, cell["id"]
        assert "NBVAL_" not in source(cell), cell["id"]


@pytest.mark.parametrize("name", EXERCISE_CELLS)
def test_an_exercise_cell_has_the_starter_and_the_check_only(name):
    """Its outputs are not compared, so nothing of the course is computed in it."""
    cell = EXERCISE_CELLS[name]
    assert tags(cell) == set(EXERCISE_TAGS)
    *starter, check = ast.parse(source(cell)).body
    assert source(cell).count("check_exercise(") == 1
    assert isinstance(check, ast.Expr)
    assert ast.unparse(check).startswith("course.check_exercise(")
    assert all(isinstance(part, ast.FunctionDef | ast.Assign) for part in starter)


@pytest.mark.parametrize("name", EXERCISE_CELLS)
def test_no_other_cell_depends_on_an_answer(name):
    """A wrong answer would change the output of a cell that is compared."""
    *starter, _ = ast.parse(source(EXERCISE_CELLS[name])).body
    defined = {part.name for part in starter if isinstance(part, ast.FunctionDef)}
    targets = [
        target
        for part in starter
        if isinstance(part, ast.Assign)
        for target in part.targets
    ]
    defined |= {
        node.id
        for target in targets
        for node in ast.walk(target)
        if isinstance(node, ast.Name)
    }
    for cell in CODE_CELLS:
        if cell["id"] != name:
            assert not defined & names_read(source(cell)), cell["id"]


def without_magics(code: str) -> str:
    return re.sub(r"^\s*[%!].*$", "", code, flags=re.M)


def names_read(code: str) -> set[str]:
    """The names that a cell uses without defining them in it."""
    nodes = [*ast.walk(ast.parse(without_magics(code)))]
    names = [node for node in nodes if isinstance(node, ast.Name)]
    defined = {node.id for node in names if isinstance(node.ctx, ast.Store)}
    defined |= {node.name for node in nodes if isinstance(node, ast.FunctionDef)}
    defined |= {node.arg for node in nodes if isinstance(node, ast.arg)}
    return {node.id for node in names} - defined


def test_cells_are_short_and_need_no_scrolling():
    """At most 25 lines of code, besides docstrings, blank lines and comments.

    88 columns are the width of a cell in Jupyter and in the book.
    """
    for cell in CODE_CELLS:
        lines = source(cell).splitlines()
        assert len(code_lines(without_magics(source(cell)))) <= 25, source(cell)
        assert max(map(len, lines)) <= 88, source(cell)
        # nbval shows the value that a trailing semicolon hides in Jupyter
        assert not any(line.rstrip().endswith(";") for line in lines), source(cell)


def test_no_two_code_cells_are_equal():
    """Grading knows the cells of the course by their text."""
    sources = [source(cell) for cell in CODE_CELLS]
    assert len({*sources}) == len(sources)


def test_every_code_cell_is_announced_by_text():
    """By the text above it, or above the cell before, whose result it shows."""
    kinds = "".join(cell["cell_type"][0] for cell in CELLS)
    assert kinds.startswith("m")
    alone = [CELLS[found.start()]["id"] for found in re.finditer("ccc", kinds)]
    assert not alone


def test_every_chapter_has_questions_with_answers_and_a_check_that_prints_a_number():
    for number, cells in chapters().items():
        prose = "\n".join(
            source(cell) for cell in cells if cell["cell_type"] == "markdown"
        )
        if number:
            assert all(
                part in prose
                for part in ("**Question", "<summary>Answer</summary>", "**Check")
            ), number
            check = next(
                n
                for n, cell in reversed([*enumerate(cells)])
                if "**Check" in source(cell)
            )
            assert any(
                re.search(r"\d", printed(cell))
                for cell in cells[check:]
                if "outputs" in cell
            ), number
            recall, answers = (
                prose.split("**You can now**")[-1]
                .split("Recall:")[1]
                .split("<summary>Answers</summary>")
            )
            assert recall.count("?") >= 3, number
            assert answers.split("</details>")[0].strip().count(".") >= 3, number


# Numbers of answers that no cell prints, by chapter: what the question gives, or
# arithmetic with it, or a definition.
GIVEN = {
    2: "640 29 1155",
    5: "230 147 172 150 161 196 60",
    7: "0.9 0.0000001 100 0.001 0.6 0.73 73 15 26 18 29 22",
    8: "300 4.7 20 0.4 9",
    9: "1158 12 1 50",
    10: "0",
    11: "17",
    12: "10",
    13: "20 30",
    16: "25 12 5 0 0.09 20",
}


def test_the_numbers_of_answers_are_those_that_the_cells_print():
    """Every number in an answer or below a solution stands in an output of its chapter,
    or is given by its question.
    """
    prose = "By 17.3 px in *test5* of chapter 4, `n = 5`, $x^2$."
    answer = f"<details><summary>Answer</summary>{prose}</details>"
    assert numbers_of_answers(answer) == ["17.3"]
    stale = []
    for number, cells in chapters().items():
        shown = " ".join(printed(cell) for cell in cells if cell["cell_type"] == "code")
        known = {*re.findall(r"\d+(?:\.\d+)?", shown), *GIVEN.get(number, "").split()}
        for cell in cells:
            if cell["cell_type"] == "markdown":
                stale += [
                    (number, found)
                    for found in numbers_of_answers(source(cell))
                    if found not in known
                ]
    assert not stale


def numbers_of_answers(text: str) -> list[str]:
    """The numbers in the folded answers of a cell, without code, exponents, and names
    such as test5 or chapter 7.
    """
    found = []
    code, link, name = (
        r"```.*?```|`[^`]*`",
        r"\[[^]]*\]\([^)]*\)",
        r"\*test\d\*|[Cc]hapters? \d+",
    )
    power_or_index = r"\^\{?\w+\}?|[A-Za-z]_\w"
    for answer in re.findall(
        r"<summary>(?:Answers?|Solution)</summary>(.*?)</details>", text, re.S
    ):
        prose = re.sub(f"{code}|{link}|{name}|{power_or_index}", "", answer, flags=re.S)
        found += re.findall(r"(?<![\w.])\d+(?:\.\d+)?", prose)
    return found


def printed(cell: dict) -> str:
    return "".join("".join(o.get("text", "")) for o in cell["outputs"]).replace(
        "\n", " | "
    )


def test_every_exercise_has_a_check_a_solution_and_wrong_answers():
    numbers = [number for number, _, _ in exercises()]
    assert sorted(numbers) == sorted(CHECKS)
    assert {int(number.split(".")[0]) for number in numbers} == set(range(1, 17))
    assert all(solution for _, _, solution in exercises())
    assert {number for number, _, _ in wrong()} == set(numbers)


def test_is_light_and_names_no_machine():
    text = NOTEBOOK.read_text(encoding="utf-8")
    assert len(text) < 4e6
    assert json.loads(text)["metadata"]["kernelspec"]["name"] == "python3"
    assert not re.search(r"/(home|root|Users|work|tmp)/", text)


def test_figure_comparison_notices_a_change():
    figure = np.full((40, 60, 3), 200, np.int16)
    moved = figure.copy()
    moved[10:14, 10:50] = 20
    assert figure_fault([figure], [figure + 0]) is None
    assert "differ strongly" in figure_fault([figure], [moved])
    assert "instead of" in figure_fault([figure], [])


def test_the_notebook_uses_names_that_exist_and_the_engine_from_chapter_9_on():
    for number, cells in chapters().items():
        code = "".join(source(cell) for cell in cells)
        for module in (helpers, course, lanes):
            used = set(re.findall(rf"(?<![\w./]){module.__name__}\.(\w+)", code)) - {
                "py",
                "mp4",
            }
            assert not [name for name in used if not hasattr(module, name)]
            if module is lanes:
                public = {*lanes.__all__, "draw", "detect"}
                assert used <= (
                    public if number > LAST_CLASSIC_CHAPTER else {"estimate_pose"}
                )


def test_importing_helpers_loads_nothing_slow():
    """matplotlib and moviepy take seconds to load from a cold disk; finding lanes needs
    no simulator.
    """
    slow = {
        "simulator",
        "matplotlib",
        "moviepy",
        "scipy",
        "PIL",
        "imageio",
        "imageio_ffmpeg",
        "IPython",
    }
    code = f"import sys, helpers; print(sys.modules.keys() & {slow})"
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "set()\n"


def test_the_notebook_imports_only_what_the_course_allows():
    tree = ast.parse(without_magics("\n".join(map(source, CODE_CELLS))))
    named = [
        alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.Import)
        for alias in node.names
    ]
    named += [
        node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)
    ]
    allowed = {
        "helpers",
        "course",
        "lanes",
        "numpy",
        "cv2",
        "matplotlib",
        "moviepy",
        "IPython",
        "dataclasses",
        "time",
    }
    assert {name.partition(".")[0] for name in named} <= allowed
