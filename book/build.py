"""Build the book: the course, the guides and an API reference as a static site.

    make book

The course is split into one page a chapter. Links between the files of the project
become links between pages. Everything is written below book/_build/; the site is
book/_build/html/.
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
SOURCE = BUILD / "source"
STATIC = BUILD / "static"
EXTRA = BUILD / "extra"
SITE = BUILD / "html"
# Pages of the sections, in the order of the navigation.
SECTIONS = {
    "Guides": [
        "docs/own_camera",
        "docs/when_it_fails",
        "docs/many_drives",
        "docs/own_loop",
        "docs/own_network",
        "docs/own_finder",
        "docs/teaching",
    ],
    "Quality": [
        "docs/benchmark/README",
        "docs/found_roads",
        "docs/cameras",
        "docs/robustness",
        "docs/ablation",
        "docs/testing",
    ],
    "Reference": [
        "docs/how_it_works",
        "api/index",
        "docs/glossary",
        "docs/conventions",
        "docs/references",
        "docs/originals",
    ],
    "Development": ["CONTRIBUTING", "CHANGELOG", "docs/release"],
}
# Link target in the project -> page of the book; an empty one leaves the text without a
# link.
PAGES = {
    "README.md": "index.md",
    "project.ipynb": "course.ipynb",
    "helpers.py": "api/helpers.rst",
    "lanes": "api/index.md",
    "simulator": "",
    ".pre-commit-config.yaml": "",
}
# Headings of the notebook without a number -> the chapter that they are in.
HEADINGS = {"#On-a-real-road": 8}
LINK = re.compile(r"(?<!!)\[([^\]]+)\]\(([^)\s]+)\)")
CHAPTER = "chapter_{:02d}"
CODE_BLOCK = re.compile(r"(^```.*?^```)", re.DOTALL | re.MULTILINE)


def rewrite_links(text: str, page: str) -> str:
    """Markdown with links to pages of the book, for the page at `page`.

    `page` is a path below the project.
    """

    def rewrite(link: re.Match) -> str:
        label, target = link.groups()
        new_target = _page_target(target, page)
        if new_target is None:
            return link[0]
        return f"[{label}]({new_target})" if new_target else label

    blocks = []
    for block in CODE_BLOCK.split(text):
        is_code = block.startswith("```")
        blocks.append(block if is_code else LINK.sub(rewrite, block))
    return "".join(blocks)


def _page_target(target: str, page: str) -> str | None:
    """The page of the book that replaces a link target of a page.

    None if the target stays, empty if nothing of the book replaces it.
    """
    chapter = re.match(r"#(\d+)\.-", target)
    if chapter:
        return f"{CHAPTER.format(int(chapter[1]))}.ipynb"
    if target in HEADINGS:
        return f"{CHAPTER.format(HEADINGS[target])}.ipynb"
    path, hash_sign, heading = target.partition("#")
    name = normpath(join(dirname(page), path))
    up = "../" * page.count("/")
    module = re.fullmatch(r"(lanes/.+)\.py", name)
    if module:
        return f"{up}api/{module[1].replace('/', '.')}.rst"
    if name not in PAGES:
        return None
    return f"{up}{PAGES[name]}{hash_sign}{heading}" if PAGES[name] else ""


def toctree(pages: Iterable[str], option: str = ":maxdepth: 1") -> str:
    """The directive that lists the pages below this one."""
    return "\n".join(["", "```{toctree}", option, "", *pages, "```", ""])


def write(name: str, text: str) -> None:
    """Write a file of the sources."""
    path = SOURCE / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def to_myst(text: str) -> str:
    """Markdown of a cell for MyST: formulas work in folded answers, and links point to
    pages.
    """
    text = re.sub(r"</summary>\s*", "</summary>\n\n", text)
    text = re.sub(r"\s*</details>", "\n\n</details>", text)
    return rewrite_links(text, "project.ipynb")


def write_course() -> None:
    """One notebook a chapter, with its outputs.

    The cells before chapter 1 are the page "course".
    """
    notebook = json.loads((ROOT / "project.ipynb").read_text(encoding="utf-8"))
    name = "course"
    pages: dict[str, list[dict]] = {}
    for cell in notebook["cells"]:
        if cell["cell_type"] == "markdown":
            text = to_myst("".join(cell["source"]))
            title = re.match(r"## (\d+)\.", text)
            if title:
                name = CHAPTER.format(int(title[1]))
                text = text.removeprefix("#")
            # the title of a chapter is that of its page: sections move up with it
            cell["source"] = re.sub(r"^### ", "## ", text, flags=re.MULTILINE)
        pages.setdefault(name, []).append(cell)

    _, *chapters = pages
    contents = {
        "cell_type": "markdown",
        "id": "contents",
        "metadata": {},
        "source": toctree(chapters, ":hidden:"),
    }
    pages["course"].append(contents)
    for name, cells in pages.items():
        write(f"{name}.ipynb", json.dumps(notebook | {"cells": cells}))


def write_pages() -> None:
    """README as the first page, the guides, a page for each section, and those of
    packages and modules.
    """
    documents = [ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md"]
    documents += sorted((ROOT / "docs").rglob("*.md"))
    for path in documents:
        page = path.relative_to(ROOT).as_posix()
        write(page, rewrite_links(path.read_text(encoding="utf-8"), page))
    for title, pages in SECTIONS.items():
        write(f"{title.lower()}.md", f"# {title}\n{toctree(pages)}")
    sections = ["Course <course>", *map(str.lower, SECTIONS)]
    readme = rewrite_links(
        (ROOT / "README.md").read_text(encoding="utf-8"), "README.md"
    )
    write("index.md", readme + toctree(sections, ":hidden:"))

    introduction = (
        "`helpers` is the classic pipeline of the course, "
        "`lanes` what `pip install .` installs."
    )
    reference = toctree(["helpers", "lanes"])
    write("api/index.md", f"# API reference\n\n{introduction}\n{reference}")
    write("api/helpers.rst", "helpers\n=======\n\n.. automodule:: helpers\n")
    options = ["-q", "--separate", "--module-first", "--no-toc"]
    run_apidoc([*options, "-o", str(SOURCE / "api"), str(ROOT / "lanes")])


def main() -> int:
    """Build the site from new sources.

    Returns Sphinx's exit status, which is 1 after a warning.
    """
    for folder in (SOURCE, STATIC, EXTRA, SITE):
        shutil.rmtree(folder, ignore_errors=True)
    _copy_folder("docs", SOURCE, "*.md")
    # pages show pictures, and link to videos
    _copy_folder("output_images", SOURCE, "*.mp4")
    _copy_folder("output_images", EXTRA, "*.jpg")
    write_course()
    write_pages()
    STATIC.mkdir(parents=True)
    shutil.copy(ROOT / "book" / "book.css", STATIC)
    mathjax = files("mathjax") / "static" / "mathjax" / "es5" / "tex-svg.js"
    shutil.copy(str(mathjax), STATIC)

    folders = ["-c", str(ROOT / "book"), "-d", str(BUILD / "doctrees")]
    options = ["-b", "html", *folders, "-q", "-W", "--keep-going"]
    return run_sphinx([*options, str(SOURCE), str(SITE)])


def _copy_folder(name: str, target: Path, left_out: str) -> None:
    ignore = shutil.ignore_patterns(left_out)
    shutil.copytree(ROOT / name, target / name, ignore=ignore)


if __name__ == "__main__":
    sys.exit(main())
