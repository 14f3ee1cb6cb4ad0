"""The report of a drive, from synthetic telemetry."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from lanes.report import describe_shares, seconds_lost, share_tracked, write_report


def story(frames: int = 200, fps: float = 20.0) -> dict[str, np.ndarray]:
    """Ten seconds from 100 s on: searching, tracking, coasting from 4 to 4.5 s, lost until 6 s, tracking again."""
    time_s = 100 + np.arange(frames) / fps
    state = np.full(frames, "tracking", dtype="<U10")
    state[:3], state[80:90], state[90:120] = "searching", "coasting", "lost"
    lost = state == "lost"
    confidence = np.where(lost, 0.0, 0.9)
    confidence[50], confidence[75], confidence[150] = 0.5, 0.55, 0.6
    offset = np.where(lost, np.nan, 0.3 * np.sin(np.arange(frames) / 20))
    offset_std = np.where(lost, np.nan, 0.02)
    offset_std[160] = 0.2
    departure = np.full(frames, "", dtype="<U5")
    departure[20:30], departure[130:150] = "left", "right"
    return {
        "frame": np.arange(frames) + 2000.0,
        "time_s": time_s,
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
        "right_kind": np.where(np.arange(frames) < 40, "", "dashed"),
        "right_colour": np.full(frames, np.nan),
        "right_double": np.full(frames, np.nan),
        "departure": departure,
    }


def test_shares_count_time_not_frames():
    telemetry = story()
    assert share_tracked(telemetry) == pytest.approx(157 / 200)
    assert seconds_lost(telemetry) == pytest.approx(1.5)
    # Frames dropped while lost: the gap counts.
    kept = np.r_[0:95, 118:200]
    assert seconds_lost(
        {name: column[kept] for name, column in telemetry.items()}
    ) == pytest.approx(1.5)
    # A confidence of less than 0.15 is no lane, as in the overlay.
    telemetry["confidence"][:40] = np.repeat([0.3, 0.1], 20)
    assert describe_shares(telemetry) == (
        "confidence 0.9 or more in 64%, 0.5 to 0.9 in 2%, below 0.5 in 10%, no lane in 25% of them"
    )


# --- the page


def report(folder: Path, telemetry: dict[str, np.ndarray], **options: object) -> str:
    """The text of a report, of a drive called d."""
    (folder / "d.mp4").touch()
    options = {"title": "d", "video": folder / "d.mp4", "settings": {}} | options
    return write_report(folder / "d.html", telemetry=telemetry, **options).read_text()


def data_of(page: str) -> dict:
    return json.loads(
        re.search(r'<script type="application/json" id="data">(.*)</script>', page)[1]
    )


def test_the_data_of_the_page_are_those_of_the_table(tmp_path):
    """Its times count from the first frame, those of the command on the clock of the video."""
    page = report(tmp_path, story(), command="explain --at ", warnings=["tilted"])
    data = data_of(page)
    assert (data["first_s"], data["time_s"][:2], data["command"]) == (
        100.0,
        [0.0, 0.05],
        "explain --at ",
    )
    assert (
        data["frame"][0] == 2000
        and data["offset_m"][90] is None
        and data["offset_m"][31] > 0.29
    )
    assert data["left_types"] == [
        [0, "yellow double solid"],
        [90, "unknown"],
        [120, "yellow double solid"],
    ]
    words = [words for number, words in data["offset"] if number <= 31][-1]
    assert words == "0.30 ± 0.02 m left of centre" and data["departure"][20] == "left"
    assert [data["level"].count(name) for name in ("sure", "likely", "none")] == [
        167,
        3,
        30,
    ]
    assert "<li>tilted</li>" in page and re.search(
        r"200 frames, (9\.9|10\.0) s;.* lost for 1\.5 s in total", page
    )
    assert re.search(
        r"Offset from -0\.\d\d to \+0\.30 m, median confidence 0\.90", page
    )
    assert "the left line is yellow double solid, the right line dashed" in page


def test_names_and_settings_are_escaped(tmp_path):
    video = tmp_path / "<img src=x onerror=alert(1)>.mp4"
    video.write_bytes(b"no video, but that is not the report's business")
    nasty = "</script><script>alert(1)</script>{{data}}"
    page = report(
        tmp_path,
        story(),
        title=nasty,
        video=video,
        settings={nasty: nasty},
        max_embedded_bytes=0,
    )
    assert "<img" not in page and "alert(1)</script>" not in page
    assert page.count("<script") == 3
    assert (
        page.count("&lt;/script&gt;&lt;script&gt;alert(1)&lt;/script&gt;{{data}}") == 4
    )
    assert 'data-link="%3Cimg%20src%3Dx%20onerror%3Dalert%281%29%3E.mp4"' in page
    assert not re.search(r"https?://", page)


def test_report_of_a_drive_without_a_lane(tmp_path):
    """Telemetry of other programs has no types of lines."""
    known = ("frame", "time_s", "state", "confidence")
    telemetry = {
        name: column if name in known else np.full(200, np.nan)
        for name, column in story().items()
    }
    telemetry = {
        name: column
        for name, column in telemetry.items()
        if not name.startswith("left_")
    }
    telemetry["state"][:] = "lost"
    page = report(tmp_path, telemetry)
    assert "lost for 10.0 s in total." in page and "nan" not in page.lower()
    data = data_of(page)
    assert data["left_types"] == data["right_types"] == [[0, "unknown"]]
