"""The page of a score in Chromium: tables, lines, a missing picture and hostile names."""

from __future__ import annotations

import numpy as np

from lanes.images import write_image
from lanes.labels import LaneColumns
from lanes.score import score_still, score_tables, write_score_page
from tests.support.browser import needs_browser, open_browser

pytestmark = needs_browser
HOSTILE = "<img src=x onerror=document.title='owned'>.png"
ROWS = np.arange(400.0, 700, 10)


def test_page_shows_tables_and_lines_and_runs_no_text(tmp_path):
    write_image(tmp_path / HOSTILE, np.full((720, 1280, 3), 90, np.uint8))
    lines = np.array([np.where(ROWS == 500, -2.0, column) for column in (300, 900)])
    labels = [LaneColumns(name, ROWS, lines) for name in (HOSTILE, "gone.png")]
    scores = [score_still(label, LaneColumns("", ROWS, lines[:1] + shift)) for label, shift in zip(labels, (90, 0))]  # noqa: B905
    words = {"title": HOSTILE, "notes": "note: <b>one</b> & {{data}}\n"}
    page = write_score_page(tmp_path / "score.html", tmp_path, scores, score_tables(scores), words)
    with open_browser() as browser:
        browser.open(page)
        run = browser.execute_script
        assert run("return document.title") == f"{HOSTILE}: score"
        assert run("return document.getElementById('notes').textContent").strip() == words["notes"].strip()
        assert run("return [...document.querySelectorAll('figcaption')].map(c => c.firstChild.data)") == [
            HOSTILE,
            "gone.png",
        ]
        assert run("return document.querySelectorAll('#stills image').length") == 1
        assert run("return document.querySelectorAll('img, b').length") == 0
        # each line is drawn from its first point to its last, with a gap at row 500
        (left, _) = run(
            "return [...document.querySelectorAll('path.label.ego')].slice(-2).map(p => p.getAttribute('d'))"
        )
        assert left.count("M") == 2 and left.startswith("M300 400L") and left.endswith("L300 690")
        assert run("return getComputedStyle(document.querySelector('path.prediction')).strokeDasharray") != "none"
        cells = run("return [...document.querySelectorAll('#tables tbody tr')].map(r => r.textContent)")
        assert cells[0].startswith("all2")
        browser.set_size(420, 800)
        assert run("return document.querySelector('#tables tbody th').offsetWidth") > 100
        assert browser.console() == []
