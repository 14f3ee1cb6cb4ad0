"""How much there is to read, and how dense it is: `make check` fails above the ceilings
in pyproject.toml.

    python -m tools.sizes

Printed are tokens of code, tokens a line (mean, and the number that nine of ten lines
do not exceed) and the share of lines over 88 columns, of each package; then the number
of files of `lanes` and the words of the pages and the notebook. Only files that git
tracks count. The ceilings are in tokens, because a ceiling in lines makes lines dense.

Tokens are names, numbers, operators and texts; docstrings, comments and blank lines are
no code. Well-kept Python of this field has 7 to 9.5 tokens a line (filterpy 9.4,
pytransform3d 7.7, hloc 7.2), and 15 to 17 in nine of ten lines.
"""

from __future__ import annotations

import argparse
import ast
import io
import json
import subprocess
import sys
import tokenize
import tomllib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
NOTEBOOK = "project.ipynb"
MAX_COLUMNS = 88

# Python 3.12 takes an f-string apart and 3.14 a t-string; 3.11 has one token for it,
# which is how it is counted.
CODE_TOKENS = {tokenize.NAME, tokenize.NUMBER, tokenize.OP, tokenize.STRING}
TEXT_STARTS = {
    getattr(tokenize, name, None) for name in ("FSTRING_START", "TSTRING_START")
}
TEXT_ENDS = {getattr(tokenize, name, None) for name in ("FSTRING_END", "TSTRING_END")}


@dataclass(frozen=True)
class CodeLine:
    """A line of code: its tokens and its width."""

    tokens: int
    columns: int


@dataclass(frozen=True)
class Density:
    """Size and density of some code: see the module's docstring."""

    lines: int
    tokens: int
    mean: float
    nine_of_ten: int
    wide_share: float

    @classmethod
    def of(cls, lines: list[CodeLine]) -> Density:
        """The density of lines of code; zeros if there are none."""
        if not lines:
            return cls(lines=0, tokens=0, mean=0.0, nine_of_ten=0, wide_share=0.0)
        ordered = sorted(line.tokens for line in lines)
        wide = [line for line in lines if line.columns > MAX_COLUMNS]
        return cls(
            lines=len(lines),
            tokens=sum(ordered),
            mean=sum(ordered) / len(lines),
            nine_of_ten=ordered[int(0.9 * len(lines))],
            wide_share=len(wide) / len(lines),
        )


def code_lines(source: str) -> list[CodeLine]:
    """The lines of code of a Python source."""
    documentation = _docstring_lines(ast.parse(source))
    counts: Counter[int] = Counter()
    inside_text = 0
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type in TEXT_ENDS:
            inside_text -= 1
            continue
        begins_text = token.type in TEXT_STARTS
        is_code = token.type in CODE_TOKENS or begins_text
        line = token.start[0]
        if is_code and not inside_text and line not in documentation:
            counts[line] += 1
        if begins_text:
            inside_text += 1
    text = source.split("\n")
    return [CodeLine(tokens, len(text[line - 1])) for line, tokens in counts.items()]


def _docstring_lines(tree: ast.Module) -> set[int]:
    """The numbers of the lines of all docstrings."""
    found: set[int] = set()
    for node in ast.walk(tree):
        if not isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            continue
        if ast.get_docstring(node, clean=False) is None:
            continue
        docstring = node.body[0]
        assert docstring.end_lineno is not None
        found.update(range(docstring.lineno, docstring.end_lineno + 1))
    return found


def notebook_sources(text: str) -> list[str]:
    """The code cells of a notebook, without magics."""
    sources = []
    for cell in cell_sources(json.loads(text)["cells"], "code"):
        lines = cell.split("\n")
        sources.append(
            "\n".join(line for line in lines if not line.lstrip().startswith("%"))
        )
    return sources


def cell_sources(cells: list[dict], kind: str) -> list[str]:
    """The sources of the cells of a notebook that are of a kind: "code", "markdown"."""
    return ["".join(cell["source"]) for cell in cells if cell["cell_type"] == kind]


def measure_densities(files: dict[str, str], packages: list[str]) -> dict[str, Density]:
    """The density of each package or file by name, and of "everything"; `files` are
    texts by path.
    """
    lines: dict[str, list[CodeLine]] = {name: [] for name in packages}
    everything = []
    for path, text in files.items():
        if not path.endswith(".py"):
            continue
        of_file = code_lines(text)
        everything += of_file
        package = path.split("/")[0]
        if package in lines:
            lines[package] += of_file
    if NOTEBOOK in files:
        cells = [code_lines(source) for source in notebook_sources(files[NOTEBOOK])]
        lines[NOTEBOOK] = [line for cell in cells for line in cell]
    return {
        name: Density.of(of_name)
        for name, of_name in (lines | {"everything": everything}).items()
    }


def count_words(files: dict[str, str]) -> dict[str, int]:
    """The number of files of `lanes`, and the words of the Markdown pages and of the
    notebook's text.
    """
    lanes = [
        path for path in files if path.startswith("lanes/") and path.endswith(".py")
    ]
    pages = [text for path, text in files.items() if path.endswith(".md")]
    prose = []
    if NOTEBOOK in files:
        cells = json.loads(files[NOTEBOOK])["cells"]
        prose = cell_sources(cells, "markdown")
    return {
        "files of lanes": len(lanes),
        "words of pages": sum(len(text.split()) for text in pages),
        f"words of {NOTEBOOK}": sum(len(text.split()) for text in prose),
    }


def tracked_files() -> Iterator[tuple[str, str]]:
    """Path and text of each file that git tracks and that is counted."""
    command = ["git", "ls-files", "-z"]
    listed = subprocess.run(
        command, cwd=ROOT, check=True, capture_output=True, text=True
    )
    for name in listed.stdout.split("\0"):
        path = ROOT / name
        if name.endswith((".py", ".md", NOTEBOOK)) and path.is_file():
            yield name, path.read_text(encoding="utf-8")


def describe_sizes(
    densities: dict[str, Density], words: dict[str, int], ceilings: dict[str, int]
) -> tuple[list[str], list[str]]:
    """The lines of the table, and the names of what is above its ceiling."""
    above = []
    table = [
        f"{'':24}{'number':>8}{'at most':>9}"
        f"   tokens a line: mean, 90 %   over {MAX_COLUMNS} columns"
    ]
    numbers = {name: density.tokens for name, density in densities.items()} | words
    for name, ceiling in ceilings.items():
        number = numbers[name]
        row = f"{name:24}{number:8}{ceiling:9}"
        if name in densities:
            density = densities[name]
            row += (
                f"{density.mean:24.1f}{density.nine_of_ten:6}{density.wide_share:17.0%}"
            )
        if number > ceiling:
            above.append(name)
            row += "   ABOVE"
        table.append(row)
    return table, above


def main() -> int:
    """Print the sizes; returns 1 if one is above its ceiling."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.parse_args()
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    ceilings: dict[str, int] = settings["tool"]["ceilings"]
    files = dict(tracked_files())
    words = count_words(files)
    packages = [name for name in ceilings if name not in words]
    densities = measure_densities(files, packages)
    table, above = describe_sizes(densities, words, ceilings)
    print("\n".join(table))
    if above:
        names = ", ".join(above)
        remedy = "take something out, or raise it with a reason (CONTRIBUTING.md)"
        print(f"above the ceiling: {names}; {remedy}")
    return 1 if above else 0


if __name__ == "__main__":
    sys.exit(main())
