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
    """The values of some attributes of all tags of a page; `names` is a pattern."""
    text = path.read_text(encoding="utf-8")
    return set(map(unescape, re.findall(rf'\s(?:{names})="([^"]+)"', text)))


def dead_links(path: Path) -> Iterator[str]:
    for link in find_values(path, "href|src"):
        parts = urlsplit(link)
        if parts.scheme or parts.netloc:
            continue
        target = path
        if parts.path:
            target = (path.parent / unquote(parts.path)).resolve()
        if not target.is_file():
            yield link
        elif parts.fragment and target.suffix == ".html":
            places = find_values(target, "id|name")
            if unquote(parts.fragment) not in places:
                yield link


@pytest.fixture(scope="module")
def html() -> list[Path]:
    """All pages of the book, built from the present sources."""
    built = subprocess.run(
        [sys.executable, "-m", "book.build"],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(PACKAGES)},
        capture_output=True,
        text=True,
    )
    assert built.returncode == 0, built.stdout + built.stderr
    return sorted(page for page in SITE.rglob("*.html") if "_static" not in page.parts)


@pytest.fixture(scope="module")
def pages(html) -> list[Path]:
    """The pages with content of their own: neither the sources of modules nor the
    index.
    """
    own = [page for page in html if "_modules" not in page.parts]
    return [page for page in own if not page.name.startswith("genindex")]


def test_no_internal_link_is_dead(html):
    dead = {path: list(dead_links(path)) for path in html}
    assert {path: links for path, links in dead.items() if links} == {}


def test_no_script_or_style_comes_from_the_network(html):
    links = set().union(*(find_values(path, "href|src") for path in html))
    loaded = [link for link in links if link.endswith((".js", ".css"))]
    assert [link for link in loaded if urlsplit(link).netloc] == []


CHAPTERS = {f"chapter_{number:02d}" for number in range(1, 17)}
GUIDES = {f"docs/{guide.stem}" for guide in (ROOT / "docs").glob("*.md")}
MODULES = {module.name for module in pkgutil.walk_packages(lanes.__path__, "lanes.")}
REFERENCE = {f"api/{name}" for name in MODULES - {"lanes.__main__"}}


@pytest.mark.parametrize(
    "part",
    [CHAPTERS, GUIDES, REFERENCE, {"index", "api/helpers"}],
    ids=["course", "guides", "reference of lanes", "first page and helpers"],
)
def test_the_parts_are_there(pages, part):
    names = {page.relative_to(SITE).with_suffix("").as_posix() for page in pages}
    assert names >= part


@pytest.fixture(scope="module")
def browser():
    with open_browser() as browser:
        yield browser


FORMULAS = """
return ['.math', '.math mjx-container svg', 'mjx-merror'].map(
  selector => document.querySelectorAll(selector).length)
"""
MISSING_IMAGES = """
return [...document.images].filter(image => !image.naturalWidth).map(image => image.src)
"""
FITS = "return document.documentElement.scrollWidth <= innerWidth"


def open_page(browser, path: Path) -> None:
    """Open a page, and wait until its formulas are drawn."""
    browser.set_size(WIDTHS_PX[0], 900)
    browser.open(path)
    promise = "window.MathJax?.startup?.promise"
    browser.wait(f"!document.querySelector('.math') || {promise}")
    browser.execute_async_script(f"Promise.resolve({promise}).then(arguments[0])")


@needs_browser
def test_pages_load_and_fit_the_screen(browser, pages):
    """Every fourth page: chapters, guides and the reference are made alike."""
    for path in pages[::4]:
        open_page(browser, path)
        formulas, drawn, refused = browser.execute_script(FORMULAS)
        assert drawn >= formulas, path
        assert refused == 0, path
        assert browser.execute_script(MISSING_IMAGES) == [], path
        for width in WIDTHS_PX:
            browser.set_size(width, 900)
            assert browser.execute_script(FITS), (path, width)
        messages = browser.get_log("browser")
        assert "SEVERE" not in {message["level"] for message in messages}, path


@needs_browser
def test_videos_play(browser, pages):
    with_videos = []
    for path in pages:
        links = find_values(path, "href|src")
        if any(link.endswith(".mp4") for link in links):
            with_videos.append(path)
    browser.open(with_videos[0])
    browser.execute_script("window.videos = [...document.querySelectorAll('video')]")
    browser.wait("videos.length && videos.every(video => video.readyState >= 2)")


@needs_browser
def test_folded_answers_have_formulas(browser, pages):
    browser.open(SITE / "chapter_02.html")
    browser.wait("document.querySelector('details mjx-container')")


@needs_browser
def test_the_search_finds_pages(browser, pages):
    browser.get(f"{(SITE / 'search.html').as_uri()}?q=Mahalanobis")
    browser.wait("document.querySelectorAll('#search-results li').length > 0")
