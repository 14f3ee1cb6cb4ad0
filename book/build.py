"""Build the book: the course, the guides and an API reference as a static site.

    make book

The course is split into one page a chapter. Links between the files of the project become links between pages, and
links to the glossary point to the term. Everything is written below book/_build/; the site is book/_build/html/.
"""

from __future__ import annotations

import json
import pkgutil
import re
import shutil
import sys
from collections.abc import Iterable
from importlib import import_module
from importlib.resources import files
from pathlib import Path
from posixpath import dirname, join, normpath
from textwrap import indent

from sphinx.cmd.build import main as run_sphinx

import lanes

ROOT = Path(__file__).parents[1]
BUILD = ROOT / "book" / "_build"
SOURCE, STATIC, EXTRA, SITE = (BUILD / name for name in ("source", "static", "extra", "html"))
# Pages of the sections, in the order of the navigation.
GUIDES = ("own_camera", "when_it_fails", "many_drives", "own_loop", "own_network", "own_finder")
QUALITY = ("benchmark/README", "cameras", "robustness", "ablation", "testing")
REFERENCE = ("docs/how_it_works", "api/index", "docs/glossary", "docs/conventions", "docs/references")
DEVELOPMENT = ("CONTRIBUTING", "CHANGELOG", "docs/release")
# Link target in the project -> page of the book; an empty one leaves the text without a link.
PAGES = {
    "README.md": "index.md",
    "project.ipynb": "course.ipynb",
    "helpers.py": "api/helpers.rst",
    "lanes": "api/index.md",
    "simulator": "",
    ".pre-commit-config.yaml": "",
}
LINK = re.compile(r"(?<!!)\[([^\]]+)\]\(([^)\s]+)\)")
CODE_BLOCK = re.compile(r"(^```.*?^```)", re.DOTALL | re.MULTILINE)


def read_terms() -> dict[str, str]:
    """The terms of the glossary by their lower case; text in parentheses is also left out."""
    text = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
    terms = re.findall(r"^\*\*(.+?)\*\*", text, re.MULTILINE)
    return {name.lower(): term for term in terms for name in (term, term.partition(" (")[0], *term.split(", "))}


def rewrite_links(text: str, page: str, terms: dict[str, str]) -> str:
    """Markdown with links to pages of the book, for the page at `page` (path below the project)."""
    up = "../" * page.count("/")

    def rewrite(link: re.Match) -> str:
        label, target = link.groups()
        bare = label.replace("*", "").lower()
        if target.endswith("glossary.md") and bare in terms:
            return f"{{term}}`{label.replace('*', '')} <{terms[bare]}>`"
        if chapter := re.match(r"#(\d+)\.-", target):
            return f"[{label}]({chapter_name(int(chapter[1]))}.ipynb)"
        path, hash_sign, heading = target.partition("#")
        name = normpath(join(dirname(page), path))
        if module := re.fullmatch(r"(lanes/.+)\.py", name):
            return f"[{label}]({up}api/{module[1].replace('/', '.')}.rst)"
        if name not in PAGES:
            return link[0]
        return f"[{label}]({up}{PAGES[name]}{hash_sign}{heading})" if PAGES[name] else label

    blocks = CODE_BLOCK.split(text)
    return "".join(block if block.startswith("```") else LINK.sub(rewrite, block) for block in blocks)


def toctree(pages: Iterable[str], *, hidden: bool = True) -> str:
    """The directive that lists the pages below this one."""
    return "\n".join(["", "```{toctree}", *([":hidden:"] if hidden else [":maxdepth: 1"]), "", *pages, "```", ""])


def write(path: Path, text: str) -> None:
    """Write a file of the sources."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


# The course


def chapter_name(number: int) -> str:
    """Name of the page of a chapter."""
    return f"chapter_{number:02d}"


def split_chapters(cells: list[dict]) -> dict[str, list[dict]]:
    """The cells of each page; the cells before chapter 1 are the page "course"."""
    pages: dict[str, list[dict]] = {"course": []}
    for cell in cells:
        title = re.match(r"## (\d+)\.", source_of(cell)) if cell["cell_type"] == "markdown" else None
        if title:
            pages[chapter_name(int(title[1]))] = []
        list(pages.values())[-1].append(cell)
    return pages


def source_of(cell: dict) -> str:
    """The text of a cell."""
    return "".join(cell["source"])


def to_myst(text: str, terms: dict[str, str]) -> str:
    """Markdown of a cell for MyST: formulas work in folded answers, and links point to pages."""
    text = re.sub(r"</summary>\s*", "</summary>\n\n", text)
    text = re.sub(r"\s*</details>", "\n\n</details>", text)
    return rewrite_links(text, "project.ipynb", terms)


def write_course(terms: dict[str, str]) -> None:
    """One notebook a chapter, with its outputs."""
    notebook = json.loads((ROOT / "project.ipynb").read_text(encoding="utf-8"))
    pages = split_chapters(notebook["cells"])
    for name, cells in pages.items():
        for cell in cells:
            if cell["cell_type"] == "markdown":
                cell["source"] = to_myst(source_of(cell), terms)
        # The chapter's title is the title of its page.
        if name != "course":
            cells[0]["source"] = cells[0]["source"].removeprefix("#")
        else:
            contents = toctree([page for page in pages if page != "course"])
            cells.append({"cell_type": "markdown", "id": "contents", "metadata": {}, "source": contents})
        write(SOURCE / f"{name}.ipynb", json.dumps(notebook | {"cells": cells}))


# Guides and pages of the project


def write_pages(terms: dict[str, str]) -> None:
    """README as the first page, the guides, and a page for each section."""
    for path in (ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").rglob("*.md"))):
        page = path.relative_to(ROOT).as_posix()
        write(SOURCE / page, rewrite_links(path.read_text(encoding="utf-8"), page, terms))
    write(SOURCE / "docs" / "glossary.md", glossary())
    sections = {
        "guides": ("Guides", [f"docs/{name}" for name in GUIDES]),
        "quality": ("Quality", [f"docs/{name}" for name in QUALITY]),
        "reference": ("Reference", REFERENCE),
        "development": ("Development", DEVELOPMENT),
    }
    for name, (title, pages) in sections.items():
        write(SOURCE / f"{name}.md", f"# {title}\n{toctree(pages, hidden=False)}")
    readme = rewrite_links((ROOT / "README.md").read_text(encoding="utf-8"), "README.md", terms)
    write(SOURCE / "index.md", readme + toctree(["Course <course>", *sections]))


def glossary() -> str:
    """The glossary as definitions that links can point to."""
    title, _, body = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8").partition("\n")
    entries = []
    for entry in body.strip().split("\n\n"):
        term, _, text = entry.removeprefix("**").partition("**")
        entries.append(f"{term}\n" + indent(text.strip(), "    "))
    return f"{title}\n\n:::{{glossary}}\n" + "\n\n".join(entries) + "\n:::\n"


# API reference


def first_line(name: str) -> str:
    """First sentence or line of the docstring of a module or of an object of one."""
    module, _, attribute = name.partition(":")
    found = import_module(module)
    found = getattr(found, attribute) if attribute else found
    if attribute and not callable(found):  # its docstring is that of its type
        return f"constant of {module}"
    text = (found.__doc__ or "").strip().split("\n\n")[0]
    return " ".join(text.split()).replace("|", "\\|")


def table_of_names(names: Iterable[tuple[str, str]]) -> list[str]:
    """Lines of a table of (module, name), each name with a link to its documentation."""
    lines = ["| name | content |", "|---|---|"]
    for module, name in names:
        found = getattr(import_module(module), name)
        home = getattr(found, "__module__", module) if callable(found) else module
        lines.append(f"| {{py:obj}}`{name} <{home}.{name}>` | {first_line(f'{module}:{name}')} |")
    return [*lines, ""]


def write_module(name: str) -> None:
    """The page of one module."""
    write(SOURCE / "api" / f"{name}.rst", f"{name}\n{'=' * len(name)}\n\n.. automodule:: {name}\n")


def write_package(name: str, path: list[str]) -> None:
    """The page of a package with the names that it exports and its modules, and the pages of those."""
    children = [child.name for child in pkgutil.iter_modules(path, f"{name}.")]
    text = [f"# {name}", "", "```{eval-rst}", f".. automodule:: {name}", "    :no-members:", "```", ""]
    if exported := getattr(import_module(name), "__all__", ()):
        text += table_of_names((name, exported_name) for exported_name in exported)
    table = [f"| [{child}]({child}.{suffix(child)}) | {first_line(child)} |" for child in children]
    text += ["| module | content |", "|---|---|", *table]
    write(SOURCE / "api" / f"{name}.md", "\n".join(text) + "\n" + toctree(children))
    for child in children:
        module = import_module(child)
        if hasattr(module, "__path__"):
            write_package(child, list(module.__path__))
        else:
            write_module(child)


def suffix(module: str) -> str:
    """Suffix of the source of a module's page."""
    return "md" if hasattr(import_module(module), "__path__") else "rst"


def write_api() -> None:
    """A page for each package and module of lanes, and one for helpers.py."""
    text = [
        "# API reference",
        "",
        "[helpers](helpers.rst) is the classic pipeline of the course.",
        "[lanes](lanes.md) is what `pip install .` installs.",
    ]
    write(SOURCE / "api" / "index.md", "\n".join(text) + "\n" + toctree(["helpers", "lanes"]))
    write_package("lanes", list(lanes.__path__))
    write_module("helpers")


def lay_out() -> None:
    """Write the sources of the book."""
    for folder in (SOURCE, STATIC, EXTRA):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
    terms = read_terms()
    write_course(terms)
    write_pages(terms)
    write_api()
    for picture in (*ROOT.glob("output_images/*.jpg"), *ROOT.glob("docs/**/*.*")):
        if picture.suffix != ".md":
            copy(picture, SOURCE)
    for video in ROOT.glob("output_images/*.mp4"):
        copy(video, EXTRA)
    shutil.copy(ROOT / "book" / "book.css", STATIC)
    shutil.copy(str(files("mathjax") / "static" / "mathjax" / "es5" / "tex-svg.js"), STATIC)


def copy(path: Path, folder: Path) -> None:
    """Copy a file of the project to the same place below a folder."""
    target = folder / path.relative_to(ROOT)
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(path, target)


def main() -> int:
    """Build the site from new sources; returns Sphinx's exit status, which is 1 after a warning."""
    lay_out()
    shutil.rmtree(SITE, ignore_errors=True)
    options = ["-b", "html", "-c", str(ROOT / "book"), "-d", str(BUILD / "doctrees"), "-q", "-W", "--keep-going"]
    return run_sphinx([*options, str(SOURCE), str(SITE)])


if __name__ == "__main__":
    sys.exit(main())
