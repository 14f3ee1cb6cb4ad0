"""Build the book: the course, the guides and an API reference as a static site.

    make book

The course is split into one page a chapter. Links between the files of the project become links between pages.
Everything is written below book/_build/; the site is book/_build/html/.
"""

from __future__ import annotations

import json
import re
import shutil
import sys
from collections.abc import Iterable
from importlib.resources import files
from pathlib import Path
from posixpath import dirname, join, normpath

from sphinx.cmd.build import main as run_sphinx
from sphinx.ext.apidoc import main as run_apidoc

ROOT = Path(__file__).parents[1]
BUILD = ROOT / "book" / "_build"
SOURCE, STATIC, EXTRA, SITE = (BUILD / name for name in ("source", "static", "extra", "html"))
# Pages of the sections, in the order of the navigation.
SECTIONS = {
    "Guides": ["docs/own_camera", "docs/when_it_fails", "docs/many_drives", "docs/own_loop"]
    + ["docs/own_network", "docs/own_finder"],
    "Quality": [f"docs/{name}" for name in ("benchmark/README", "cameras", "robustness", "ablation", "testing")],
    "Reference": ["docs/how_it_works", "api/index", "docs/glossary", "docs/conventions", "docs/references"],
    "Development": ["CONTRIBUTING", "CHANGELOG", "docs/release"],
}
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
CHAPTER = "chapter_{:02d}"
CODE_BLOCK = re.compile(r"(^```.*?^```)", re.DOTALL | re.MULTILINE)


def rewrite_links(text: str, page: str) -> str:
    """Markdown with links to pages of the book, for the page at `page` (path below the project)."""
    up = "../" * page.count("/")

    def rewrite(link: re.Match) -> str:
        label, target = link.groups()
        if chapter := re.match(r"#(\d+)\.-", target):
            return f"[{label}]({CHAPTER.format(int(chapter[1]))}.ipynb)"
        path, hash_sign, heading = target.partition("#")
        name = normpath(join(dirname(page), path))
        if module := re.fullmatch(r"(lanes/.+)\.py", name):
            return f"[{label}]({up}api/{module[1].replace('/', '.')}.rst)"
        if name not in PAGES:
            return link[0]
        return f"[{label}]({up}{PAGES[name]}{hash_sign}{heading})" if PAGES[name] else label

    blocks = CODE_BLOCK.split(text)
    return "".join(block if block.startswith("```") else LINK.sub(rewrite, block) for block in blocks)


def toctree(pages: Iterable[str], option: str = ":maxdepth: 1") -> str:
    """The directive that lists the pages below this one."""
    return "\n".join(["", "```{toctree}", option, "", *pages, "```", ""])


def write(name: str, text: str) -> None:
    """Write a file of the sources."""
    path = SOURCE / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def to_myst(text: str) -> str:
    """Markdown of a cell for MyST: formulas work in folded answers, and links point to pages."""
    text = re.sub(r"</summary>\s*", "</summary>\n\n", text)
    text = re.sub(r"\s*</details>", "\n\n</details>", text)
    return rewrite_links(text, "project.ipynb")


def write_course() -> None:
    """One notebook a chapter, with its outputs; the cells before chapter 1 are the page "course"."""
    notebook = json.loads((ROOT / "project.ipynb").read_text(encoding="utf-8"))
    name, pages = "course", dict[str, list[dict]]()
    for cell in notebook["cells"]:
        if cell["cell_type"] == "markdown":
            cell["source"] = to_myst("".join(cell["source"]))
            if title := re.match(r"## (\d+)\.", cell["source"]):
                name, cell["source"] = CHAPTER.format(int(title[1])), cell["source"].removeprefix("#")
        pages.setdefault(name, []).append(cell)
    contents = toctree(list(pages)[1:], ":hidden:")
    pages["course"].append({"cell_type": "markdown", "id": "contents", "metadata": {}, "source": contents})
    for name, cells in pages.items():
        write(f"{name}.ipynb", json.dumps(notebook | {"cells": cells}))


def write_pages() -> None:
    """README as the first page, the guides, a page for each section, and those of packages and modules."""
    for path in (ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").rglob("*.md"))):
        page = path.relative_to(ROOT).as_posix()
        write(page, rewrite_links(path.read_text(encoding="utf-8"), page))
    for title, pages in SECTIONS.items():
        write(f"{title.lower()}.md", f"# {title}\n{toctree(pages)}")
    sections = ["Course <course>", *map(str.lower, SECTIONS)]
    readme = rewrite_links((ROOT / "README.md").read_text(encoding="utf-8"), "README.md")
    write("index.md", readme + toctree(sections, ":hidden:"))
    words = "`helpers` is the classic pipeline of the course, `lanes` what `pip install .` installs."
    write("api/index.md", f"# API reference\n\n{words}\n{toctree(['helpers', 'lanes'])}")
    write("api/helpers.rst", "helpers\n=======\n\n.. automodule:: helpers\n")
    run_apidoc(["-q", "--separate", "--module-first", "--no-toc", "-o", str(SOURCE / "api"), str(ROOT / "lanes")])


def main() -> int:
    """Build the site from new sources; returns Sphinx's exit status, which is 1 after a warning."""
    for folder in (SOURCE, STATIC, EXTRA, SITE):
        shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(ROOT / "docs", SOURCE / "docs", ignore=shutil.ignore_patterns("*.md"))
    # pages show pictures, and link to videos
    for folder, left_out in ((SOURCE, "*.mp4"), (EXTRA, "*.jpg")):
        shutil.copytree(ROOT / "output_images", folder / "output_images", ignore=shutil.ignore_patterns(left_out))
    write_course()
    write_pages()
    STATIC.mkdir(parents=True)
    shutil.copy(ROOT / "book" / "book.css", STATIC)
    shutil.copy(str(files("mathjax") / "static" / "mathjax" / "es5" / "tex-svg.js"), STATIC)
    options = ["-b", "html", "-c", str(ROOT / "book"), "-d", str(BUILD / "doctrees"), "-q", "-W", "--keep-going"]
    return run_sphinx([*options, str(SOURCE), str(SITE)])


if __name__ == "__main__":
    sys.exit(main())
