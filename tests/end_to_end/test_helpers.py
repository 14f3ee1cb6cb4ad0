"""helpers.py, which the notebook imports: complete, documented, without logic."""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys
from pathlib import Path

import helpers

ROOT = Path(helpers.__file__).parent


def names() -> list[str]:
    body = ast.parse((ROOT / "helpers.py").read_text(encoding="utf-8")).body
    return [alias.name for node in body if isinstance(node, ast.ImportFrom) for alias in node.names]


def test_it_lists_what_the_notebook_uses_and_each_name_once():
    cells = json.loads((ROOT / "project.ipynb").read_text(encoding="utf-8"))["cells"]
    used = set(re.findall(r"helpers\.(\w+)", "".join("".join(cell["source"]) for cell in cells))) - {"py"}
    assert len(used) > 40
    assert sorted(names()) == sorted(used)


def test_every_function_is_documented():
    assert not [name for name in names() if not (getattr(helpers, name).__doc__ or name.isupper())]


def test_it_defines_nothing_itself():
    body = ast.parse((ROOT / "helpers.py").read_text(encoding="utf-8")).body
    assert not [node for node in body if isinstance(node, ast.FunctionDef | ast.ClassDef)]


def test_importing_it_loads_nothing_slow():
    """matplotlib and moviepy take seconds to load from a cold disk; finding lanes needs no simulator."""
    slow = ("simulator", "matplotlib", "moviepy", "scipy", "PIL", "imageio", "imageio_ffmpeg", "IPython")
    code = f"import sys, helpers; print(*sys.modules.keys() & {set(slow)}, len(dir(helpers)))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert int(done.stdout) >= len(names())


def test_the_notebook_imports_only_what_the_course_allows():
    cells = json.loads((ROOT / "project.ipynb").read_text(encoding="utf-8"))["cells"]
    code = "".join("".join(cell["source"]) + "\n" for cell in cells if cell["cell_type"] == "code")
    tree = ast.parse(re.sub(r"^\s*[%!].*$", "", code, flags=re.M))
    named = [alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names]
    named += [node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    modules = {name.partition(".")[0] for name in named}
    assert modules <= {"helpers", "numpy", "cv2", "matplotlib", "moviepy", "IPython", "pathlib", "dataclasses"}
