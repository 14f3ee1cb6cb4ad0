"""The book: it builds without a warning, and its pages work in Chromium, opened from
files.

Sphinx warns about each signature and docstring that it cannot show, and about dead
links between pages.
"""

from __future__ import annotations

import os
import pkgutil
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from html import unescape
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

import lanes
from tests.support.browser import needs_browser, open_browser
from tests.support.project import ROOT

SITE = ROOT / "book" / "_build" / "html"
# Where the Makefile installs the packages of the extra `book`.
PACKAGES = Path(sys.prefix) / "book"
WIDTHS_PX = (400, 1400)

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not PACKAGES.exists(),
        reason="needs the packages of the book, which make test installs",
    ),
]


@cache
def find_values(path: Path, names: str) -> set[str]:
    """The values of some attributes (a pattern of their names) of all tags
    of a page.
    """
    return {
        unescape(value)
        for value in re.findall(
            rf'\s(?:{names})="([^"]+)"', path.read_text(encoding="utf-8")
        )
    }


def dead_links(path: Path) -> Iterator[str]:
    for link in find_values(path, "href|src"):
        parts = urlsplit(link)
        if parts.scheme or parts.netloc:
            continue
        target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
        names_a_place = parts.fragment and target.suffix == ".html"
        if not target.is_file() or (
            names_a_place
            and unquote(parts.fragment) not in find_values(target, "id|name")
        ):
            yield link


@pytest.fixture(scope="module")
def html() -> list[Path]:
    """All pages of the book, built from the present sources."""
    environment = os.environ | {"PYTHONPATH": str(PACKAGES)}
    command = [sys.executable, "-m", "book.build"]
    built = subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True
    )
    assert built.returncode == 0, built.stdout + built.stderr
    return sorted(page for page in SITE.rglob("*.html") if "_static" not in page.parts)


@pytest.fixture(scope="module")
def pages(html) -> list[Path]:
    """The pages with content of their own: neither the sources of modules nor the
    index.
    """
    return [
        page
        for page in html
        if "_modules" not in page.parts and not page.name.startswith("genindex")
    ]


def test_no_internal_link_is_dead_and_no_script_or_style_comes_from_the_network(html):
    assert not [(path, link) for path in html for link in dead_links(path)]
    scripts = {
        link
        for path in html
        for link in find_values(path, "href|src")
        if link.endswith((".js", ".css"))
    }
    assert not [link for link in scripts if urlsplit(link).netloc]


def test_the_course_the_guides_and_the_reference_are_there(pages):
    names = {page.relative_to(SITE).as_posix() for page in pages}
    modules = {
        module.name for module in pkgutil.walk_packages(lanes.__path__, "lanes.")
    } - {"lanes.__main__"}
    assert names >= {f"chapter_{number:02d}.html" for number in range(1, 17)}
    assert names >= {
        f"docs/{guide.stem}.html" for guide in (ROOT / "docs").glob("*.md")
    }
    assert names >= {"index.html", "api/helpers.html"} | {
        f"api/{name}.html" for name in modules
    }


@pytest.fixture(scope="module")
def browser():
    with open_browser() as browser:
        yield browser


@needs_browser
def test_pages_load_with_their_formulas_and_fit_the_screen(browser, pages):
    # chapters, guides and the reference are made alike
    for path in pages[::4]:
        browser.set_size(WIDTHS_PX[0], 900)
        browser.open(path)
        browser.wait(
            "!document.querySelector('.math') || window.MathJax?.startup?.promise"
        )
        browser.execute_async_script(
            "Promise.resolve(window.MathJax?.startup?.promise).then(arguments[0])"
        )
        formulas, drawn, refused = browser.execute_script(
            "return ['.math', '.math mjx-container svg', 'mjx-merror'].map(s => "
            "document.querySelectorAll(s).length)"
        )
        assert (drawn >= formulas, refused) == (True, 0), path
        missing = browser.execute_script(
            "return [...document.images].filter(i => !i.naturalWidth).map(i => i.src)"
        )
        assert not missing, path
        for width in WIDTHS_PX:
            browser.set_size(width, 900)
            assert browser.execute_script(
                "return document.documentElement.scrollWidth <= innerWidth"
            ), (path, width)
        assert not [
            entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"
        ], path


@needs_browser
def test_videos_play_folded_answers_have_formulas_and_the_search_finds_pages(
    browser, pages
):
    with_videos = [
        path
        for path in pages
        if any(link.endswith(".mp4") for link in find_values(path, "href|src"))
    ]
    browser.open(with_videos[0])
    browser.execute_script("window.videos = [...document.querySelectorAll('video')]")
    browser.wait("videos.length && videos.every(video => video.readyState >= 2)")
    browser.open(SITE / "chapter_02.html")
    browser.wait("document.querySelector('details mjx-container')")
    browser.get(f"{(SITE / 'search.html').as_uri()}?q=Mahalanobis")
    browser.wait("document.querySelectorAll('#search-results li').length > 0")
