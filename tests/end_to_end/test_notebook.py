"""Form of the notebook, whose numbers and figures nbval compares (see the Makefile), and of helpers.py, its import."""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys

import numpy as np

import helpers
from course.exercises.check import CHECKS
from tests.end_to_end.nbval_plugin import figure_fault
from tests.end_to_end.notebook_reader import NOTEBOOK, exercises, wrong
from tests.support.project import ROOT

TEXT = NOTEBOOK.read_text(encoding="utf-8")
CELLS = json.loads(TEXT)["cells"]
CODE_CELLS = [cell for cell in CELLS if cell["cell_type"] == "code"]
BODY = ast.parse((ROOT / "helpers.py").read_text(encoding="utf-8")).body
NAMES = [alias.name for node in BODY if isinstance(node, ast.ImportFrom) for alias in node.names]


def source(cell: dict) -> str:
    return "".join(cell["source"])


def test_is_executed_from_top_to_bottom_without_errors():
    # nbval accepts a notebook without outputs, so its comparison depends on this test.
    assert [cell["execution_count"] for cell in CODE_CELLS] == list(range(1, len(CODE_CELLS) + 1))
    for cell in CODE_CELLS:
        kinds = {output["output_type"] for output in cell["outputs"]} | {o.get("name") for o in cell["outputs"]}
        assert not kinds & {"error", "stderr"}, source(cell)


def test_nothing_is_hidden_from_the_comparison():
    for cell in CODE_CELLS:
        hiding = {"nbval-skip", "nbval-ignore-output", "raises-exception", "nbval-raises-exception"}
        assert not hiding & set(cell["metadata"].get("tags", [])), source(cell)
        # the sliders' cell shows nothing, so it hides nothing
        assert "NBVAL_" not in source(cell) or not cell["outputs"], source(cell)


def test_the_course_is_short():
    words = [len(source(cell).split()) for cell in CELLS if cell["cell_type"] == "markdown"]
    assert len(CELLS) <= 180 and sum(words) <= 12_000 and max(words) <= 300
    assert len(NAMES) <= 60
    assert len(exercises()) >= 15


def test_cells_are_short():
    for cell in CODE_CELLS:
        lines = source(cell).splitlines()
        assert len(lines) <= 15, source(cell)
        # nbval shows the value that a trailing semicolon hides in Jupyter
        assert not any(line.rstrip().endswith(";") for line in lines), source(cell)


def test_every_code_cell_is_announced_by_text():
    kinds = [cell["cell_type"] for cell in CELLS]
    assert kinds[0] == "markdown"
    assert all(before == "markdown" for before, kind in zip(kinds, kinds[1:], strict=False) if kind == "code")


def test_the_reader_writes_the_steps_in_opencv_and_numpy():
    calls = set(re.findall(r"\b(?:cv2|np)\.[\w.]+(?=\()", "\n".join(map(source, CODE_CELLS))))
    assert len(calls) >= 40, sorted(calls)


def test_every_chapter_has_a_question_with_a_folded_answer_and_a_check_that_prints_a_number():
    text = "\n".join(
        f"\n{source(cell)}" if cell["cell_type"] == "markdown" else f"CODE:{source(cell)}\nOUT:{printed(cell)}"
        for cell in CELLS
    )
    for chapter in re.split(r"\n(?=## \d+\. )", text)[1:]:
        title = chapter.splitlines()[0]
        assert "**Question" in chapter and "<summary>Answer</summary>" in chapter, title
        assert "**Check" in chapter, title
        assert re.search(r"OUT:[^\n]*\d", chapter.split("**Check")[-1]), title


def printed(cell: dict) -> str:
    return "".join("".join(o.get("text", "")) for o in cell["outputs"]).replace("\n", " | ")


def test_every_exercise_has_a_check_a_solution_and_wrong_answers():
    numbers = [number for number, _, _ in exercises()]
    assert sorted(numbers) == sorted(CHECKS)
    assert {int(number.split(".")[0]) for number in numbers} == set(range(1, 17))
    assert all(solution for _, _, solution in exercises())
    assert {number for number, _, _ in wrong()} == set(numbers)


def test_is_light_and_names_no_machine():
    assert len(TEXT) < 3e6
    assert json.loads(TEXT)["metadata"]["kernelspec"]["name"] == "python3"
    assert not re.search(r"/(home|root|Users|work|tmp)/", TEXT)


def test_figure_comparison_notices_a_change():
    figure = np.full((40, 60, 3), 200, np.int16)
    moved = figure.copy()
    moved[10:14, 10:50] = 20
    assert figure_fault([figure], [figure + 0]) is None
    assert "differ strongly" in figure_fault([figure], [moved])
    assert "instead of" in figure_fault([figure], [])


def test_helpers_lists_what_the_notebook_uses_and_each_name_once():
    used = set(re.findall(r"helpers\.(\w+)", "".join(map(source, CELLS)))) - {"py"}
    assert len(used) > 40
    assert sorted(NAMES) == sorted(used)


def test_every_helper_is_documented_and_defined_elsewhere():
    assert not [name for name in NAMES if not (getattr(helpers, name).__doc__ or name.isupper())]
    assert not [node for node in BODY if isinstance(node, ast.FunctionDef | ast.ClassDef)]


def test_importing_helpers_loads_nothing_slow():
    """matplotlib and moviepy take seconds to load from a cold disk; finding lanes needs no simulator."""
    slow = ("simulator", "matplotlib", "moviepy", "scipy", "PIL", "imageio", "imageio_ffmpeg", "IPython")
    code = f"import sys, helpers; print(*sys.modules.keys() & {set(slow)}, len(dir(helpers)))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert int(done.stdout) >= len(NAMES)


def test_the_notebook_imports_only_what_the_course_allows():
    tree = ast.parse(re.sub(r"^\s*[%!].*$", "", "\n".join(map(source, CODE_CELLS)), flags=re.M))
    named = [alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names]
    named += [node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    modules = {name.partition(".")[0] for name in named}
    assert modules <= {"helpers", "numpy", "cv2", "matplotlib", "moviepy", "IPython", "pathlib", "dataclasses"}
