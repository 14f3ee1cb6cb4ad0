"""helpers.py, which the notebook imports: complete, documented, without logic."""

import ast
import json
import re
import subprocess
import sys

import helpers
from tests.support.project import ROOT

BODY = ast.parse((ROOT / "helpers.py").read_text(encoding="utf-8")).body
NAMES = [alias.name for node in BODY if isinstance(node, ast.ImportFrom) for alias in node.names]
CELLS = json.loads((ROOT / "project.ipynb").read_text(encoding="utf-8"))["cells"]


def test_it_lists_what_the_notebook_uses_and_each_name_once():
    used = set(re.findall(r"helpers\.(\w+)", "".join("".join(cell["source"]) for cell in CELLS))) - {"py"}
    assert len(used) > 40
    assert sorted(NAMES) == sorted(used)


def test_every_function_is_documented_and_defined_elsewhere():
    assert not [name for name in NAMES if not (getattr(helpers, name).__doc__ or name.isupper())]
    assert not [node for node in BODY if isinstance(node, ast.FunctionDef | ast.ClassDef)]


def test_importing_it_loads_nothing_slow():
    """matplotlib and moviepy take seconds to load from a cold disk; finding lanes needs no simulator."""
    slow = ("simulator", "matplotlib", "moviepy", "scipy", "PIL", "imageio", "imageio_ffmpeg", "IPython")
    code = f"import sys, helpers; print(*sys.modules.keys() & {set(slow)}, len(dir(helpers)))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert int(done.stdout) >= len(NAMES)


def test_the_notebook_imports_only_what_the_course_allows():
    code = "".join("".join(cell["source"]) + "\n" for cell in CELLS if cell["cell_type"] == "code")
    tree = ast.parse(re.sub(r"^\s*[%!].*$", "", code, flags=re.M))
    named = [alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names]
    named += [node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    modules = {name.partition(".")[0] for name in named}
    assert modules <= {"helpers", "numpy", "cv2", "matplotlib", "moviepy", "IPython", "pathlib", "dataclasses"}
