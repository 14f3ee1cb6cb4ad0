"""The report of a drive, from synthetic telemetry."""

from __future__ import annotations

import base64
import json
import re
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from lanes.show.report import describe_shares, seconds_lost, share_tracked, write_report


def story(frames: int = 200, fps: float = 20.0) -> dict[str, np.ndarray]:
    """Ten seconds from 100 s on.

    Searching, tracking, coasting from 4 to 4.5 s, lost until 6 s, tracking again.
    """
    number = np.arange(frames)
    state = np.full(frames, "tracking", dtype="<U10")
    state[:3] = "searching"
    state[80:90] = "coasting"
    state[90:120] = "lost"
    lost = state == "lost"

    confidence = np.where(lost, 0.0, 0.9)
    confidence[[50, 75, 150]] = 0.5, 0.55, 0.6
    offset = np.where(lost, np.nan, 0.3 * np.sin(number / 20))
    offset_std = np.where(lost, np.nan, 0.02)
    offset_std[160] = 0.2
    departure = np.full(frames, "", dtype="<U5")
    departure[20:30] = "left"
    departure[130:150] = "right"
    return {
        "frame": number + 2000.0,
        "time_s": 100 + number / fps,
        "state": state,
        "confidence": confidence,
        "offset_m": offset,
        "offset_std_m": offset_std,
        "curvature_per_m": np.where(lost, np.nan, 1e-3),
        "curvature_std_per_m": np.where(lost, np.nan, 1e-4),
        "lane_width_m": np.where(lost, np.nan, 3.6),
        "left_kind": np.where(lost, "", "solid"),
        "left_colour": np.where(lost, "", "yellow"),
        "left_double": np.where(lost, np.nan, 1.0),
        "right_kind": np.where(number < 40, "", "dashed"),
        "right_colour": np.full(frames, np.nan),
        "right_double": np.full(frames, np.nan),
        "departure": departure,
    }


def test_shares_of_frames_and_time():
    telemetry = story()
    assert share_tracked(telemetry) == pytest.approx(157 / 200)
    assert seconds_lost(telemetry) == pytest.approx(1.5)


def test_frames_dropped_while_lost_count_as_lost_time():
    kept = np.r_[0:95, 118:200]
    telemetry = {name: column[kept] for name, column in story().items()}
    assert seconds_lost(telemetry) == pytest.approx(1.5)


def test_a_confidence_below_that_of_the_overlay_is_no_lane():
    telemetry = story()
    telemetry["confidence"][:20] = 0.3
    telemetry["confidence"][20:40] = 0.1
    assert describe_shares(telemetry) == (
        "confidence 0.9 or more in 64%, 0.5 to 0.9 in 2%, below 0.5 in 10%, "
        "no lane in 25% of them"
    )


# The page.


def report(folder: Path, telemetry: dict[str, np.ndarray], **options: object) -> str:
    """The text of a report, of a drive called d."""
    (folder / "d.mp4").touch()
    usual = {"title": "d", "video": folder / "d.mp4", "settings": {}}
    page = write_report(folder / "d.html", telemetry=telemetry, **usual | options)
    return page.read_text()


def page_data(page: str) -> dict:
    """What the script of a report reads."""
    element = r'<script type="application/json" id="data">(.*)</script>'
    return json.loads(re.search(element, page)[1])


@pytest.fixture
def page(tmp_path) -> str:
    return report(tmp_path, story(), command="explain --at ", warnings=["tilted"])


def test_times_count_from_the_first_frame_and_the_command_on_the_clock_of_the_video(
    page,
):
    data = page_data(page)
    assert data["time_s"][:2] == [0.0, 0.05]
    assert data["first_s"] == 100.0
    assert data["command"] == "explain --at "


def test_the_data_of_the_page_are_those_of_the_table(page):
    data = page_data(page)
    assert data["frame"][0] == 2000
    assert data["offset_m"][90] is None
    assert data["offset_m"][31] > 0.29
    assert data["departure"][20] == "left"
    levels = [data["level"].count(name) for name in ("sure", "likely", "none")]
    assert levels == [167, 3, 30]


def test_words_are_given_where_they_change(page):
    data = page_data(page)
    assert data["left_types"] == [
        [0, "yellow double solid"],
        [90, "unknown"],
        [120, "yellow double solid"],
    ]
    until_31 = [words for frame, words in data["offset"] if frame <= 31]
    assert until_31[-1] == "0.30 ± 0.02 m left of centre"


@pytest.mark.parametrize(
    "words",
    [
        "<li>tilted</li>",
        r"200 frames, (9\.9|10\.0) s;.* lost for 1\.5 s in total",
        r"Offset from -0\.\d\d to \+0\.30 m, median confidence 0\.90",
        "the left line is yellow double solid, the right line dashed",
    ],
)
def test_the_page_says_what_happened(page, words):
    assert re.search(words, page)


def test_names_and_settings_are_escaped(tmp_path):
    video = tmp_path / "<img src=x onerror=alert(1)>.mp4"
    video.write_bytes(b"no video, but that is not the report's business")
    nasty = "</script><script>alert(1)</script>{{data}}{% raw %}"
    page = report(
        tmp_path,
        story(),
        title=nasty,
        video=video,
        settings={nasty: nasty},
        command=nasty,
        warnings=[nasty],
        max_embedded_bytes=0,
    )
    assert "<img" not in page
    assert "alert(1)</script>" not in page
    assert page.count("<script") == 3
    escaped = "&lt;/script&gt;&lt;script&gt;alert(1)&lt;/script&gt;{{data}}{% raw %}"
    assert page.count(escaped) == 5
    assert 'data-link="%3Cimg%20src%3Dx%20onerror%3Dalert%281%29%3E.mp4"' in page
    assert page_data(page)["command"] == nasty
    assert not re.search(r"https?://", page)


def test_the_policy_allows_the_script_of_the_page_only(page):
    (policy,) = re.findall(r'Security-Policy"\s+content="([^"]*)"', page)
    script = re.search(r"<script>(.*)</script>", page, re.DOTALL)[1]
    digest = base64.b64encode(sha256(script.encode()).digest()).decode()
    assert policy.split("; ") == [
        "default-src 'none'",
        "img-src data:",
        "style-src 'unsafe-inline'",
        "media-src 'self' file: blob:",
        f"script-src 'sha256-{digest}'",
    ]


@pytest.fixture
def lost_drive() -> dict[str, np.ndarray]:
    """Telemetry of another program, without types of lines, of a drive without lane."""
    telemetry = {}
    for name, column in story().items():
        if name in ("frame", "time_s", "state", "confidence"):
            telemetry[name] = column
        elif not name.startswith("left_"):
            telemetry[name] = np.full(200, np.nan)
    telemetry["state"][:] = "lost"
    return telemetry


def test_report_of_a_drive_without_a_lane(tmp_path, lost_drive):
    page = report(tmp_path, lost_drive)
    assert "lost for 10.0 s in total." in page
    assert "nan" not in page.lower()
    data = page_data(page)
    assert data["left_types"] == [[0, "unknown"]]
    assert data["right_types"] == [[0, "unknown"]]
