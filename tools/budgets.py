"""How much there is to read, against the budgets in pyproject.toml: `make check` fails above them.

    python -m tools.budgets [SECONDS]

Lines of Python of each package, Python files and named numbers of `lanes`, words of the Markdown pages, and words of
the notebook's text, of files that git tracks. SECONDS is how long the tests took: too long is shown, but no failure,
because it depends on the machine. A named number is a constant of a module, or a default of a class, that is a number
or a tuple of numbers.
"""

from __future__ import annotations

import ast
import json
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]


def named_numbers(tree: ast.Module) -> int:
    """How many constants of a module and defaults of its classes are numbers."""
    bodies = [tree.body, *(node.body for node in ast.walk(tree) if isinstance(node, ast.ClassDef))]
    nodes = (node for body in bodies for node in body if isinstance(node, ast.Assign | ast.AnnAssign))
    return sum(node.value is not None and _is_number(node.value) for node in nodes)


def _is_number(value: ast.expr) -> bool:
    match value:
        case ast.Constant(number):
            return isinstance(number, int | float) and not isinstance(number, bool)
        case ast.UnaryOp(operand=inner):
            return _is_number(inner)
        case ast.BinOp(left=left, right=right):
            return _is_number(left) and _is_number(right)
        case ast.Tuple(elts=parts) | ast.List(elts=parts):
            return bool(parts) and all(map(_is_number, parts))
        case ast.Call(func=ast.Attribute(attr="array" | "radians"), args=arguments):
            return any(map(_is_number, arguments))
    return False


def measure_sizes(files: dict[str, str], packages: list[str]) -> dict[str, int]:
    """The sizes of the project by the names of the budgets; `files` are texts by path, from the project's folder."""
    python = {path: text for path, text in files.items() if path.endswith(".py")}
    sizes = {name: sum(t.count("\n") for path, t in python.items() if path.split("/")[0] == name) for name in packages}
    lanes = [text for path, text in python.items() if path.startswith("lanes/")]
    return sizes | {
        "all Python": sum(text.count("\n") for text in python.values()),
        "files of lanes": len(lanes),
        "numbers of lanes": sum(named_numbers(ast.parse(text)) for text in lanes),
        "words of pages": sum(len(text.split()) for path, text in files.items() if path.endswith(".md")),
        "words of project.ipynb": _notebook_words(files.get("project.ipynb", '{"cells": []}')),
    }


def _notebook_words(text: str) -> int:
    cells = (cell for cell in json.loads(text)["cells"] if cell["cell_type"] == "markdown")
    return sum(len("".join(cell["source"]).split()) for cell in cells)


def compare_sizes(sizes: dict[str, int], budgets: dict[str, int]) -> tuple[list[str], list[str]]:
    """A line for each budget, and the names of those that are exceeded."""
    above = [name for name, budget in budgets.items() if sizes[name] > budget]
    marks = {name: "  ABOVE" if name in above else "" for name in budgets}
    return [f"{name:24}{sizes[name]:8} of {budgets[name]:6}{mark}" for name, mark in marks.items()], above


def _tracked_files() -> Iterator[tuple[str, str]]:
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True, text=True)
    for name in listed.stdout.split("\0"):
        if name.endswith((".py", ".md", "project.ipynb")) and (ROOT / name).is_file():
            yield name, (ROOT / name).read_text(encoding="utf-8")


def main() -> int:
    """Print the sizes; returns 1 if one is above its budget."""
    budgets: dict[str, int] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["budgets"]
    most_s = budgets.pop("seconds of make test")
    sizes = measure_sizes(dict(_tracked_files()), list(budgets))
    lines, above = compare_sizes(sizes, budgets)
    print("\n".join(lines))
    if sys.argv[1:]:
        print(f"the tests took {sys.argv[1]} s; they should take {most_s} s at most on two free cores")
    if above:
        print(f"above the budget: {', '.join(above)}; make it smaller, or ask for more (CONTRIBUTING.md)")
    return bool(above)


if __name__ == "__main__":
    sys.exit(main())
