"""The labelling page in Chromium: stills of a drive labelled with mouse and keyboard."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from selenium.webdriver import Keys
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.actions.wheel_input import ScrollOrigin
from selenium.webdriver.common.by import By

from lanes.camera.model import save_camera
from lanes.detect.lane import columns_at
from lanes.label import label_rows
from lanes.labels import EGO_SIDES, NO_POINT, read_labels
from lanes.score import score_still
from lanes.video.images import write_image
from tests.support.browser import needs_browser, open_browser
from tests.support.labelling import choose_clicks, is_painted, labelling, line_pixels
from tests.support.painted_drive import BENDS

pytestmark = [
    pytest.mark.slow,
    needs_browser,
]
TIMES_S = 0.5 * np.arange(5)
LINES_M = 1.8, -1.8
ROWS = label_rows(BENDS.camera.height)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("stills")
    for number, time_s in enumerate(TIMES_S):
        write_image(folder / f"{number}.png", BENDS.frame(time_s))
    save_camera(BENDS.camera, folder / "camera.yaml")
    return folder


@pytest.fixture(scope="module")
def page(folder):
    """The page after all stills were labelled with the mouse."""
    with open_browser() as browser, labelling(folder, "--camera", folder / "camera.yaml") as session:
        browser.get(session.address)
        rng = np.random.default_rng(5)
        for number, time_s in enumerate(TIMES_S):
            browser.wait(f"still && k === {number} && still.raw_file === '{number}.png' && view.scale > 1")
            for key, lateral_m in zip("lr", LINES_M, strict=True):
                browser.press(key)
                click(browser, choose_clicks(BENDS, time_s, lateral_m, rng))
            browser.press("n", until=f"still.saved[{number}]")
        yield browser


def click(page, points: np.ndarray) -> None:
    """Click with the mouse at these places (N, 2) of the picture."""
    canvas = page.find_element(By.ID, "still")
    size = np.array([canvas.rect["width"], canvas.rect["height"]])
    for place in page.value("arguments[0].map(toScreen)", points.tolist()):
        from_centre = np.round(np.array(place) - size / 2).astype(int).tolist()
        ActionChains(page, duration=0).move_to_element_with_offset(canvas, *from_centre).click().perform()


def message(page) -> str:
    return page.find_element(By.ID, "message").text


def truth(time_s: float) -> np.ndarray:
    lines = [line_pixels(BENDS, time_s, lateral_m) for lateral_m in LINES_M]
    return columns_at(ROWS, lines, BENDS.camera)


def test_stills_labelled_with_the_mouse_are_like_the_truth(page, folder):
    page.wait("document.getElementById('message').textContent === 'All stills are labelled.'")
    assert page.value("ours") is None and page.console() == []
    labels = read_labels(folder / "labels.jsonl")
    assert [label.name for label in labels] == [f"{number}.png" for number in range(len(TIMES_S))]
    for label, time_s in zip(labels, TIMES_S, strict=True):
        for lateral_m, line, true in zip(LINES_M, label.columns, truth(time_s), strict=True):
            assert ((line >= 0) & (true >= 0)).sum() >= 8
            rows = line_pixels(BENDS, time_s, lateral_m)[::-1, 1]
            painted = np.interp(ROWS, rows, is_painted(BENDS, time_s, lateral_m)[::-1], left=0, right=0) == 1
            seen = painted & (line >= 0) & (true >= 0)
            away_px = np.abs(line - true) / np.hypot(1, np.gradient(true, ROWS))
            assert away_px[seen].max() < 2, (label.name, lateral_m)
    by_hand = [
        replace(label, columns=np.where(label.columns >= 0, truth(time_s), NO_POINT), sides=EGO_SIDES)
        for label, time_s in zip(labels, TIMES_S, strict=True)
    ]
    scores = [score_still(*pair, BENDS.camera.size) for pair in zip(labels, by_hand, strict=True)]
    assert [one.right for one in scores] == [True] * len(TIMES_S)


def test_our_lines_are_shown_beside_a_saved_label_which_then_stays(page, folder):
    page.value("open(4)")
    page.wait("k === 4")
    assert page.value("ours") is None
    page.press("s", until="ours")
    page.wait("document.getElementById('message').textContent.includes('px from ours')")
    label, ours = (np.array(lanes[0]) for lanes in page.value("[still.lanes, ours.lanes]"))
    away_px = np.abs(label - ours)[(label >= 0) & (ours >= 0)].mean()
    assert message(page).startswith(f"Saved. left line: {away_px:.1f} px from ours, right line: ")
    before = (folder / "labels.jsonl").read_bytes()
    page.press(Keys.ENTER, until="document.getElementById('message').textContent.startsWith('Our lines were shown')")
    assert (folder / "labels.jsonl").read_bytes() == before
    assert page.value("still.saved[4]") is True


def test_by_keyboard_alone(page, folder):
    page.value("open(2)")
    page.wait("k === 2 && ours === null")
    page.press("x", until="marks[0] === null && !still.saved[2]")  # clears the line
    for _ in range(2):
        page.press(Keys.ENTER)
        for key in (Keys.ARROW_UP,) * 4 + (Keys.ARROW_DOWN,):
            ActionChains(page).key_down(Keys.SHIFT).send_keys(key).key_up(Keys.SHIFT).perform()
        page.press(Keys.ARROW_LEFT)
    page.wait("marks[0].length === 2 && still.lanes[0].some(column => column >= 0)")
    (x, low), (left, high) = page.value("marks[0]")
    assert (x - left, low - high) == (1, 30)
    scale = page.value("view.scale")
    page.press("+", until=f"view.scale > {scale}")
    page.press("-", until=f"Math.abs(view.scale - {scale}) < 1e-6")
    page.press("-", until=f"view.scale < {scale}")
    page.press("0", until=f"Math.abs(view.scale - {scale}) < 1e-6")
    page.press(Keys.ESCAPE, until="marks[0].length === 1")
    page.press("n")  # incomplete: kept, not saved
    page.wait("k === 3 && document.getElementById('message').textContent.startsWith('2.png is incomplete')")
    label = next(json.loads(line) for line in (folder / "labels.jsonl").read_text().splitlines()[2:])
    assert label["raw_file"] == "2.png" and len(label["points"][0]) == 5
    page.press("p", until="k === 2 && marks[0].length === 1 && !still.saved[2]")
    page.press("o", until="document.getElementById('status').textContent === 'no lane'")
    page.press("s", until="still.saved[2] && ours")
    label = json.loads((folder / "labels.jsonl").read_text().splitlines()[2])
    assert label["points"] == [None, None] and max(map(max, label["lanes"])) == NO_POINT
    page.find_element(By.CSS_SELECTOR, "button.right").send_keys(Keys.ENTER)  # a button works by keyboard, too
    page.wait("active === 1")


def test_lines_of_the_still_before_are_a_proposal_until_they_are_accepted(page, folder):
    page.value("open(1)")
    page.wait("k === 1")
    before, own = (folder / "labels.jsonl").read_bytes(), page.value("marks")
    page.press("c")
    page.wait("proposal && document.getElementById('status').textContent.endsWith('a proposal, not saved')")
    assert page.find_element(By.ID, "accept").is_displayed()
    for key in ("n", "s", Keys.ENTER, "x"):
        page.press(key)
        assert message(page).startswith("A proposal, not saved: the lines of the previous still")
    page.press(Keys.ESCAPE, until="k === 1 && !proposal && still.saved[1]")
    assert page.value("marks") == own and not page.find_element(By.ID, "accept").is_displayed()
    page.press("c", until="proposal")
    assert (folder / "labels.jsonl").read_bytes() == before
    proposed = page.value("proposal.points")
    page.press("a", until="!proposal && !still.saved[1]")
    page.press("n", until="k === 2")
    label = json.loads((folder / "labels.jsonl").read_text().splitlines()[1])
    true = truth(TIMES_S[1])
    assert label["raw_file"] == "1.png" and label["points"] == proposed != own
    columns = np.array(label["lanes"])
    assert np.median(np.abs(columns - true)[(columns >= 0) & (true >= 0)]) < 1


def test_wheel_and_drag_move_the_view_and_set_no_point(page):
    page.value("open(3)")
    page.wait("k === 3")
    count, view = page.value("[marks[0].length, view]")
    canvas = page.find_element(By.ID, "still")
    ActionChains(page).scroll_from_origin(ScrollOrigin.from_element(canvas), 0, -200).perform()
    page.wait(f"view.scale > {view['scale']} * 1.2")
    zoomed = page.value("view")
    ActionChains(page).move_to_element(canvas).click_and_hold().move_by_offset(60, 25).release().perform()
    page.wait(f"Math.abs(view.x - {zoomed['x']} - 60) < 3")
    assert page.value("[marks[0].length, still.saved[3]]") == [count, True]


def test_the_page_fits_the_screen(page):
    for width in (400, 1800):
        page.set_size(width, 900)
        page.wait(f"innerWidth === {width}")
        assert page.value("document.documentElement.scrollWidth <= innerWidth")
        box = page.value("(b => [b.width, b.height])(canvas.getBoundingClientRect())")
        assert box[0] > 0.9 * width and box[1] >= 250
    assert page.console() == []
