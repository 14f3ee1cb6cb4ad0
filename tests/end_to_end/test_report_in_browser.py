"""The pages of a report and of a score in Chromium."""

from __future__ import annotations

import numpy as np
import pytest
from selenium.webdriver import Keys

from lanes.describe import describe_bend
from lanes.labels import LaneColumns
from lanes.score import score_still, score_tables, write_score_page
from lanes.show.report import write_report
from lanes.video.images import write_image
from lanes.video.writer import VideoWriter
from tests.support.browser import needs_browser, open_browser
from tests.test_report import story

pytestmark = needs_browser
HOSTILE = "<img src=x onerror=document.title='owned'>.mp4"
# 200 frames of the story; each is as bright as its number.
LENGTH_S = 10.0
SHOWN_FRAME = """(() => {
  const canvas = document.createElement("canvas");
  canvas.width = 64;
  canvas.height = 36;
  const pixels = canvas.getContext("2d");
  pixels.drawImage(video, 0, 0, 64, 36);
  return pixels.getImageData(32, 18, 1, 1).data[0] - 30})()"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    with VideoWriter(folder / HOSTILE, fps=20) as writer:
        for number in range(200):
            writer.write(np.full((180, 320, 3), 30 + number, np.uint8))
    story_of = {"title": HOSTILE, "telemetry": story(), "settings": {"a": "b"}}
    write_report(folder / "inside.html", video=folder / HOSTILE, **story_of)
    write_report(
        folder / "linked.html", video=folder / HOSTILE, max_embedded_bytes=0, **story_of
    )
    long = {"title": "long", "telemetry": story(20_000, 2000.0), "settings": {}}
    long["telemetry"]["offset_m"][[12_345, 17_001]] = 3.0, -2.0
    write_report(
        folder / "long.html", video=folder / HOSTILE, max_embedded_bytes=0, **long
    )
    (folder / "gone.mp4").write_bytes(b"0")
    write_report(
        folder / "gone.html",
        video=folder / "gone.mp4",
        max_embedded_bytes=0,
        **story_of,
    )
    (folder / "gone.mp4").unlink()
    return folder


@pytest.fixture(scope="module")
def browser():
    with open_browser() as browser:
        yield browser


@pytest.fixture
def page(browser, folder):
    """The report with its video inside, ready to play."""
    browser.open(folder / "inside.html")
    browser.wait("video.readyState >= 3")
    yield browser
    assert browser.console() == []


def text_of(page, name: str) -> str:
    return page.value(
        "document.getElementById('now-' + arguments[0]).textContent", name
    )


def seek(page, time_s: float) -> None:
    page.execute_script("seek(arguments[0])", time_s)
    page.wait("!video.seeking")


def test_keys_play_and_seek(page):
    page.execute_script("track.focus()")
    keys = [
        (Keys.ARROW_RIGHT, 1.0),
        (Keys.ARROW_UP, 2.0),
        (".", 2.05),
        (",", 2.0),
        (Keys.END, 9.95),
    ]
    keys += [
        (Keys.PAGE_DOWN, 0),
        (Keys.PAGE_UP, 9.95),
        (Keys.ARROW_LEFT, 8.95),
        (Keys.ARROW_DOWN, 7.95),
    ]
    for key, expected in keys:
        page.press(key, until="!video.seeking")
        assert page.value("video.currentTime") == pytest.approx(expected, abs=0.02)
    page.press(Keys.HOME, until="video.currentTime < 0.1")
    page.press(" ", until="video.currentTime > 0.5 && video.currentTime < 5")
    place, time_s = page.value("[parseFloat(cursor.style.left), video.currentTime]")
    assert place == pytest.approx(100 * time_s / LENGTH_S, abs=3)
    page.press(" ")
    assert page.value("video.paused")


@pytest.mark.parametrize("across", [0.02, 0.71])
def test_a_click_on_the_curves_seeks(page, across):
    page.click("#track", across=across)
    page.wait("!video.seeking && video.currentTime > 0")
    time_s = page.value("video.currentTime")
    assert time_s == pytest.approx(across * LENGTH_S, abs=0.03)
    # The picture, the text and the cursor belong to the same frame.
    number = int(time_s * 20)
    page.wait(
        f"Math.abs({SHOWN_FRAME} - {number}) <= 1"
    )  # on a busy machine some time after the end of the seek
    assert text_of(page, "time").endswith(f"frame {2000 + number}")
    state = story()["state"][number]
    assert text_of(page, "state") == state
    assert page.value("track.getAttribute('aria-valuetext')").split(", ")[1] == state


def test_the_measures_next_to_the_video(page):
    seek(page, 5.0)
    unknown = [text_of(page, name) for name in ("offset", "bend", "width", "lines")]
    assert unknown == ["offset unknown", "bend unknown", "unknown", "unknown | dashed"]
    seek(page, 2.0)
    assert text_of(page, "offset") == "0.27 ± 0.02 m left of centre"
    assert text_of(page, "lines") == "yellow double solid | dashed"
    assert text_of(page, "width") == "3.60 m"
    assert text_of(page, "bend") == describe_bend(1e-3, 1e-4) == "bends left, R 1000 m"


def curve(page, name: str, kind: str) -> list[np.ndarray]:
    """The parts of a curve or band as points (N, 2): frame, and value on its axis."""
    ticks = [float(text) for text in page.texts(f"#curve-{name} .ticks span")]
    path = page.value(
        "document.querySelector(arguments[0]).getAttribute('d')",
        f"#curve-{name} path.{kind}",
    )
    parts = [part.rstrip("Z").split("L") for part in path.split("M")[1:]]
    points = [np.array([point.split() for point in part], float) for part in parts]
    return [
        np.column_stack(
            [p[:, 0] / 5, ticks[-1] - p[:, 1] / 100 * (ticks[-1] - ticks[0])]
        )
        for p in points
    ]


@pytest.mark.parametrize(
    ("name", "column", "unit"),
    [("offset", "offset", 1), ("curvature", "curvature", 1000)],
)
def test_curves_have_gaps_and_a_band_of_one_standard_deviation(
    page, name, column, unit
):
    telemetry = story()
    suffix = "_m" if name == "offset" else "_per_m"
    values = unit * telemetry[column + suffix]
    std = unit * telemetry[f"{column}_std{suffix}"]
    lines = curve(page, name, "line")
    bands = curve(page, name, "band")
    for frames, line, band in zip(
        (np.arange(90), np.arange(120, 200)), lines, bands, strict=True
    ):
        np.testing.assert_allclose(
            line, np.column_stack([frames, values[frames]]), atol=0.01
        )
        high, low = np.split(band, 2)
        np.testing.assert_allclose(high[:, 1] - line[:, 1], std[frames], atol=0.001)
        np.testing.assert_allclose(line[:, 1] - low[::-1, 1], std[frames], atol=0.001)


def test_levels_of_the_confidence_fill_the_strip(page):
    bars = (
        "[...document.querySelectorAll('.states path')]"
        ".map(p => [p.className.baseVal, p.getAttribute('d')])"
    )
    found = [(name, path) for name, path in page.value(bars) if name != "sure"]
    edges = [
        ("likely", 250, 255),
        ("likely", 375, 380),
        ("none", 450, 600),
        ("likely", 750, 755),
    ]
    assert found == [(name, f"M{a:.2f} 0H{b:.2f}V100H{a:.2f}Z") for name, a, b in edges]
    marks = page.value(
        "[...document.querySelectorAll('.axis span')]"
        ".map(s => [s.textContent, s.style.left])"
    )
    assert marks == [[f"0:0{second}", f"{10 * second}%"] for second in range(10)]
    legend = page.value("document.querySelector('.legend').innerText").split("\n")
    assert legend == [
        "confidence 0.9 or more 84%",
        "0.5 to 0.9 2%",
        "below 0.5 0%",
        "no lane 15%",
    ]


def test_a_long_curve_keeps_its_peaks(browser, folder):
    browser.open(folder / "long.html")
    points = np.concatenate(curve(browser, "offset", "line"))
    assert len(points) <= 2000
    for frame, value in ((12_345, 3.0), (17_001, -2.0)):  # outside of the axis
        nearest = points[np.abs(points[:, 1] - value).argmin()]
        np.testing.assert_allclose(nearest, [frame / 100, value], atol=0.02)
    assert browser.console() == []


def moments(page, kind: str) -> list[tuple[float, str]]:
    found = page.value(
        "worstMoments()[arguments[0]].map(([i, text]) => [times[i], text])", kind
    )
    return [(round(time_s, 3), text) for time_s, text in found]


def test_worst_moments_and_their_buttons(page):
    assert moments(page, "Lane not seen") == [
        (4.5, "lost for 1.5 s"),
        (4.0, "coasting for 0.5 s"),
    ]
    departures = [
        (6.5, "towards the right line, 1.0 s"),
        (1.0, "towards the left line, 0.5 s"),
    ]
    assert moments(page, "Lane departures") == departures
    # 3.75 s is too close to 2.5 s. Lost frames are left out.
    assert moments(page, "Lowest confidence")[:2] == [
        (2.5, "confidence 0.50"),
        (7.5, "confidence 0.60"),
    ]
    assert moments(page, "Least certain offset")[0] == (8.0, "± 0.20 m")
    assert moments(page, "Least certain bend")[0][1] == "± 0.10 per km"
    headings = page.texts("nav h3")
    with_moments = "Object.entries(worstMoments()).filter(([, found]) => found.length)"
    assert headings == page.value(f"{with_moments}.map(([kind]) => kind)")
    assert len(headings) == 5
    assert page.texts("nav button")[0] == "0:04.5 lost for 1.5 s"
    page.click("nav button")
    page.wait("!video.seeking && video.currentTime > 0")
    assert page.value("video.currentTime") == pytest.approx(4.5, abs=0.01)
    assert text_of(page, "state") == "lost"


def show(browser, folder, telemetry, **options) -> None:
    words = {"title": "d", "settings": {}, "max_embedded_bytes": 0} | options
    browser.open(
        write_report(
            folder / "other.html", video=folder / HOSTILE, telemetry=telemetry, **words
        )
    )


def test_a_single_lost_frame_has_one_moment(browser, folder):
    show(browser, folder, {name: column[100:101] for name, column in story().items()})
    assert len(moments(browser, "Lane not seen")) == 1
    assert (
        moments(browser, "Lowest confidence")
        == moments(browser, "Least certain bend")
        == []
    )
    assert browser.console() == []


def test_all_gaps_and_poses_are_listed(browser, folder):
    """Five gaps of one frame to 0.5 s; the longest first, two of them folded."""
    telemetry = story()
    state = telemetry["state"]
    state[:] = "tracking"
    for first, frames in ((10, 1), (30, 4), (60, 2), (90, 10), (140, 6)):
        state[first : first + frames] = "lost"
    show(browser, folder, telemetry, other_poses=[(100, "1.30 m high")])

    texts = [text for _, text in moments(browser, "Lane not seen")]
    seconds = ["0.5", "0.3", "0.2", "0.1", "0.05"]
    assert texts == [f"lost for {length} s" for length in seconds]
    assert browser.texts("nav summary")[0] == "2 more"
    assert moments(browser, "Another camera pose") == [(5.0, "1.30 m high")]
    assert "Another camera pose" in browser.texts("nav h3")
    assert browser.console() == []


def test_each_moment_has_a_command_to_copy_and_warnings_are_at_the_top(browser, folder):
    """The drive begins at 100 s of the video."""
    command = "python -m lanes explain --hfov 60 'my <drive>.mp4' --at "
    words = ["the camera seems to have moved after 9 s", "<b>3 of 24</b> pictures"]
    show(browser, folder, story(), command=command, warnings=words)
    assert browser.value("document.getElementById('command').hidden")
    browser.click("nav li:first-child .explain")
    assert browser.texts("#command code") == [command + "104.500"]
    browser.wait("document.querySelector('#command span').textContent.endsWith(':')")
    assert len(browser.texts("nav .explain")) == len(browser.texts("nav li")) > 5
    assert browser.texts("header .warnings li") == words


def test_hostile_names_are_escaped_and_nothing_is_fetched(page):
    fetched = page.value("performance.getEntriesByType('resource').map(e => e.name)")
    assert all(name.startswith(("blob:", "file:")) for name in fetched)
    assert page.value("document.title") == f"{HOSTILE}: lane report"
    assert page.texts("img") == []
    assert page.texts("h1") == [HOSTILE]
    # The policy of the page also stops a script in markup that is inserted later.
    page.execute_script(
        "document.body.insertAdjacentHTML("
        "'beforeend', '<p onclick=\"document.title=1\" id=p>.</p>'); p.click()"
    )
    assert page.value("document.title") == f"{HOSTILE}: lane report"
    assert "Content Security Policy" in page.console()[0]


def test_a_linked_video_plays_too_and_a_missing_one_is_named(browser, folder):
    browser.open(folder / "linked.html")
    browser.wait("video.readyState >= 3")
    browser.click("#track", across=0.5)
    browser.wait("!video.seeking && video.currentTime > 4")
    assert browser.value("document.getElementById('missing').hidden")
    assert browser.console() == []
    browser.open(folder / "gone.html")
    browser.wait("!document.getElementById('missing').hidden")
    assert "gone.mp4" in browser.value("document.getElementById('missing').innerText")
    browser.console()


def test_the_page_fits_every_screen_and_scheme(page):
    for width in (340, 1800):
        page.set_size(width, 800)
        assert page.value("document.documentElement.scrollWidth <= innerWidth")
        # The click area lies exactly over the curves.
        gaps = page.execute_script("""
          const a = track.getBoundingClientRect();
          const boxes = [...document.querySelectorAll("svg")]
            .map(s => s.getBoundingClientRect());
          return boxes.map(b =>
            Math.max(Math.abs(a.left - b.left), Math.abs(a.right - b.right)))""")
        assert len(gaps) == 4
        assert max(gaps) < 0.6
    width, height = page.value(
        "(box => [box.width, box.height])(video.getBoundingClientRect())"
    )
    assert width / height == pytest.approx(320 / 180, rel=0.01)  # no bars
    backgrounds = []
    for dark in (False, True):
        page.set_dark(dark)
        backgrounds.append(
            page.value("getComputedStyle(document.body).backgroundColor")
        )
    assert len(set(backgrounds)) == 2


HOSTILE_STILL = HOSTILE.replace(".mp4", ".png")
NOTES = "note: <b>one</b> & {{data}}\n"


@pytest.fixture
def score_page(browser, tmp_path):
    """The page of the scores of two stills, of which one is not there."""
    pictures = [tmp_path / HOSTILE_STILL, tmp_path / "gone.png"]
    write_image(pictures[0], np.full((720, 1280, 3), 90, np.uint8))
    rows = np.arange(400.0, 700, 10)
    lines = np.array([np.full(len(rows), 300.0), np.full(len(rows), 900.0)])
    beside = LaneColumns("", rows, lines + 90, confidence=0.8)
    exact = LaneColumns("", rows, lines)
    scores = [
        score_still(LaneColumns(HOSTILE_STILL, rows, lines), beside),
        score_still(LaneColumns("gone.png", rows, lines), exact),
    ]
    page = write_score_page(
        tmp_path / "score.html",
        scores,
        pictures,
        score_tables(scores),
        title=HOSTILE,
        notes=NOTES,
    )
    browser.open(page)
    yield browser
    assert browser.console() == []


def test_the_page_of_a_score_shows_names_and_notes_as_text(score_page):
    assert score_page.value("document.title") == f"{HOSTILE}: score"
    assert score_page.texts("#notes")[0].strip() == NOTES.strip()
    assert score_page.texts("figcaption span") == [HOSTILE_STILL, "gone.png"]
    assert score_page.texts("b, script") == []


def test_the_page_of_a_score_shows_stills_and_tables(score_page):
    shown = "[...document.images].map(image => image.naturalWidth)"
    assert score_page.value(shown) == [960, 960]
    facts = score_page.texts("#stills small")
    assert facts == ["wrong, confidence 0.80", "right, the picture is not there"]
    cells = score_page.texts("#tables tr:first-child > *")
    assert [cell.strip() for cell in cells][8:10] == ["all", "2"]


@pytest.mark.parametrize("width", [420, 1800])
def test_the_page_of_a_score_fits_every_screen(score_page, width):
    score_page.set_size(width, 800)
    fits = "document.documentElement.scrollWidth <= innerWidth"
    assert score_page.value(fits)
    name_px = score_page.value("document.querySelector('tbody th').offsetWidth")
    assert name_px > 100


def test_the_page_of_a_score_runs_no_script(score_page):
    score_page.execute_script(
        "document.body.insertAdjacentHTML("
        "'beforeend', '<p onclick=\"document.title=1\" id=p>.</p>'); p.click()"
    )
    assert score_page.value("document.title") == f"{HOSTILE}: score"
    assert "Content Security Policy" in score_page.console()[0]
