"""The plugin that compares figures: with it nbval is stricter, and never looser."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import nbformat
import pytest
from nbformat import v4

from tests.support.command_line import WAIT_S
from tests.support.project import ROOT

PLUGIN = ("-p", "tests.end_to_end.nbval_plugin")
DRAWING = """
%matplotlib inline
%config InlineBackend.figure_formats = ["jpeg"]
import matplotlib.pyplot as plt

plt.figure(figsize=(2, 1)).add_subplot().plot([0, 1], [0, {height}])
plt.show()
"""


@pytest.fixture(scope="module")
def notebook(tmp_path_factory) -> Path:
    """Four cells: other text, formula and figure than saved, and no change."""
    sources = ["print(1)", "import IPython.display as d; d.Latex('$1$')"]
    sources += [DRAWING.format(height=1), "print(4)"]
    notebook = v4.new_notebook(cells=[v4.new_code_cell(source) for source in sources])
    path = tmp_path_factory.mktemp("notebook") / "small.ipynb"
    nbformat.write(notebook, path)
    command = [
        "-m",
        "jupyter",
        "nbconvert",
        "--to",
        "notebook",
        "--execute",
        "--inplace",
    ]
    subprocess.run([sys.executable, *command, path], check=True, capture_output=True)

    notebook = nbformat.read(path, as_version=4)
    changed = ["print(2)", "import IPython.display as d; d.Latex('$2$')"]
    changed += [DRAWING.format(height=-1), "print(4)"]
    for cell, source in zip(notebook.cells, changed, strict=True):
        cell.source = source
    nbformat.write(notebook, path)
    return path


def outcomes(notebook: Path, *plugin: str) -> str:
    """A letter for each cell: "F" failed, "." passed."""
    options = ["--nbval", "--nbval-current-env", "-q", "--tb=no", "-p", "no:xdist"]
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "pytest",
            *options,
            *plugin,
            "-c",
            "/dev/null",
            notebook,
        ],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=WAIT_S,
    )
    return done.stdout.split()[0]


def test_plain_nbval_compares_text_and_formulas(notebook):
    assert outcomes(notebook) == "FF.."


def test_the_plugin_compares_figures_as_well(notebook):
    assert outcomes(notebook, *PLUGIN) == "FFF."
