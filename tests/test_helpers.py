"""The notebook's front door: complete, documented, without logic of its own."""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys
from pathlib import Path

import helpers

ROOT = Path(helpers.__file__).parent


def test_every_name_is_listed_in_the_table_of_contents():
    listed = set(re.findall(r"[A-Za-z_][A-Za-z_0-9]+", helpers.__doc__))
    assert not [name for name in helpers.__all__ if name not in listed]


def test_the_table_of_contents_names_only_what_there_is():
    rows = re.findall(r"^.{17}([a-zA-Z_, ]+?)(?: {2,}lanes\.\w+)?$", helpers.__doc__, re.M)
    named = {name.strip() for row in rows for name in row.split(",") if re.fullmatch(r"\s*[A-Za-z]+\w*\s*", name)}
    assert named
    assert not {name for name in named if not hasattr(helpers, name)}


def test_every_function_is_documented():
    assert not [name for name in helpers.__all__ if not (getattr(helpers, name).__doc__ or name.isupper())]


def test_it_defines_nothing_itself():
    body = ast.parse((ROOT / "helpers.py").read_text(encoding="utf-8")).body
    assert not [node for node in body if isinstance(node, ast.FunctionDef | ast.ClassDef)]


def test_importing_it_loads_nothing_slow():
    """Figures and moviepy take seconds on a cold disk; who draws none and cuts no clip need not wait for them."""
    slow = ("matplotlib", "moviepy", "scipy", "PIL", "imageio", "imageio_ffmpeg", "IPython")
    code = f"import sys, helpers; print(*sys.modules.keys() & {set(slow)}, len(dir(helpers)))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert int(done.stdout) >= len(helpers.__all__)


def test_the_notebook_imports_only_what_the_course_allows():
    cells = json.loads((ROOT / "project.ipynb").read_text(encoding="utf-8"))["cells"]
    code = "".join("".join(cell["source"]) + "\n" for cell in cells if cell["cell_type"] == "code")
    modules = set(re.findall(r"^(?:from|import) (\w+)", code, re.M))
    assert modules <= {"helpers", "numpy", "matplotlib", "IPython"}
