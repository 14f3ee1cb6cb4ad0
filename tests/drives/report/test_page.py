"""Moments, curves and page of the report, from synthetic telemetry."""

from __future__ import annotations

import re

import numpy as np
import pytest

from lanes.report.curves import Curve, draw_curve, draw_states
from lanes.report.moments import runs, seconds_lost, share_tracked, worst_moments
from lanes.report.page import write_report


def story(frames: int = 200, fps: float = 20.0) -> dict[str, np.ndarray]:
    """Ten seconds from 100 s on: searching, tracking, coasting from 4 to 4.5 s, lost until 6 s, tracking again."""
    time_s = 100 + np.arange(frames) / fps
    state = np.full(frames, "tracking", dtype="<U10")
    state[:3], state[80:90], state[90:120] = "searching", "coasting", "lost"
    lost = state == "lost"
    confidence = np.where(lost, 0.0, 0.9)
    confidence[50], confidence[55], confidence[150] = 0.5, 0.55, 0.6
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
        "departure": departure,
    }


def as_pairs(moments) -> list[tuple[float, str]]:
    return [(round(moment.time_s, 3), moment.text) for moment in moments]


def test_worst_moments():
    kinds = worst_moments(story())
    assert as_pairs(kinds["Lane not seen"]) == [(4.5, "lost for 1.5 s"), (4.0, "coasting for 0.5 s")]
    assert as_pairs(kinds["Lane departures"]) == [
        (6.5, "towards the right line, 1.0 s"),
        (1.0, "towards the left line, 0.5 s"),
    ]
    # 2.75 s is too close to 2.5 s. Lost frames are left out.
    assert as_pairs(kinds["Lowest confidence"])[:2] == [(2.5, "confidence 0.50"), (7.5, "confidence 0.60")]
    assert as_pairs(kinds["Least certain offset"])[0] == (8.0, "± 0.20 m")


def test_shares_count_time_not_frames():
    telemetry = story()
    assert share_tracked(telemetry) == pytest.approx(157 / 200)
    assert seconds_lost(telemetry) == pytest.approx(1.5)
    # Frames dropped while lost: the gap counts.
    kept = np.r_[0:95, 118:200]
    assert seconds_lost({name: column[kept] for name, column in telemetry.items()}) == pytest.approx(1.5)


def test_decreasing_uncertainty_gives_one_moment():
    telemetry = story()
    telemetry["offset_std_m"] = np.linspace(0.5, 0.1, 200)
    assert as_pairs(worst_moments(telemetry)["Least certain offset"]) == [(0.0, "± 0.50 m")]
    telemetry["offset_std_m"] /= 1000
    assert as_pairs(worst_moments(telemetry)["Least certain offset"]) == [(0.0, "± 0.01 m")]


def test_moments_of_a_single_lost_frame():
    one = {name: column[100:101] for name, column in story().items()}
    kinds = worst_moments(one)
    assert as_pairs(kinds["Lane not seen"]) == [(0.0, "lost for 0.0 s")]
    assert kinds["Lowest confidence"] == kinds["Least certain bend"] == []
    assert share_tracked(one) == 0


def test_runs():
    assert list(runs(np.array(["a", "a", "b", "a"]))) == [("a", 0, 2), ("b", 2, 3), ("a", 3, 4)]
    assert list(runs(np.array([], str))) == []


def points(path: str) -> list[np.ndarray]:
    """The pieces of an SVG path of M and L."""
    return [
        np.array([p.split() for p in piece.rstrip("Z").split("L")], float) for piece in path.split("M") if piece.strip()
    ]


def path_of(svg: str, kind: str) -> str:
    return re.search(rf'<path class="{kind}" d="([^"]*)"', svg)[1]


def test_curve_has_scale_and_gaps():
    time_s = np.arange(10) * 0.5
    values = np.array([0, 1, 2, np.nan, np.nan, 4, 3, 2, 1, 0.0])
    curve = Curve("v", "Value", "m", values, np.full(10, 0.5), (0, 4))
    assert curve.limits() == (0, 4)
    svg = draw_curve(curve, time_s)
    pieces = points(path_of(svg, "line"))
    assert [len(piece) for piece in pieces] == [3, 5]
    # Ten frames of half a second: each a hundred units wide. The axis runs from 4 at the top to 0 at 100.
    np.testing.assert_allclose(pieces[0], [[0, 100], [100, 75], [200, 50]])
    np.testing.assert_allclose(pieces[1][0], [500, 0])
    band = points(path_of(svg, "band"))
    assert [len(piece) for piece in band] == [6, 10]
    np.testing.assert_allclose(band[0][[0, -1]], [[0, 87.5], [0, 112.5]])


def test_long_curve_keeps_its_peaks():
    values = np.zeros(90_000)
    values[12_345], values[70_001] = 3.0, -2.0
    curve = Curve("v", "Value", "m", values, None, (-3, 3))
    svg = draw_curve(curve, np.arange(90_000) / 25)
    (line,) = points(path_of(svg, "line"))
    assert len(line) <= 2000 and len(svg) < 60_000
    peak, dip = line[line[:, 1].argmin()], line[line[:, 1].argmax()]
    np.testing.assert_allclose(peak, [1000 * 12_345 / 90_000, 0], atol=0.1)
    assert dip[0] == pytest.approx(1000 * 70_001 / 90_000, abs=0.1)


@pytest.mark.parametrize("values", [[np.nan, np.nan], [0.0, 0.0], [1e-7, -1e-7], [-250.0, 380.0], [0.5, np.nan]])
def test_axes_contain_the_values_and_have_round_ticks(values):
    curve = Curve("v", "Value", "m", np.array(values), None, (-0.5, 0.5))
    low, high = curve.limits()
    assert low <= min(-0.5, np.nanmin([*values, 0])) and high >= max(0.5, np.nanmax([*values, 0]))
    assert 2 <= len(curve.ticks()) <= 12 and 0 in curve.ticks()
    assert "nan" not in draw_curve(curve, np.array([0.0, 0.1]))


def test_outlier_does_not_flatten_the_curve():
    values = np.sin(np.arange(500) / 20)
    values[77] = 1e4
    assert Curve("v", "Value", "m", values).limits()[1] < 5


def test_states_fill_the_strip():
    svg = draw_states(np.array(["searching", "tracking", "tracking", "lost"]), np.array([0.0, 1.0, 2.0, 3.0]))
    bars = re.findall(r'<path class="(\w+)" d="M([\d.]+) 0H([\d.]+)V', svg)
    assert bars == [("searching", "0.00", "250.00"), ("tracking", "250.00", "750.00"), ("lost", "750.00", "1000.00")]


def test_names_and_settings_are_escaped(tmp_path):
    video = tmp_path / "<img src=x onerror=alert(1)>.mp4"
    video.write_bytes(b"no video, but that is not the report's business")
    nasty = "</script><script>alert(1)</script>{{data}}"
    page = write_report(
        tmp_path / "r.html", title=nasty, video=video, telemetry=story(), settings={nasty: nasty}, max_embedded_bytes=0
    ).read_text()
    assert "<img" not in page and "alert(1)</script>" not in page
    assert page.count("<script") == 3
    assert page.count("&lt;/script&gt;&lt;script&gt;alert(1)&lt;/script&gt;{{data}}") == 4
    assert 'data-link="%3Cimg%20src%3Dx%20onerror%3Dalert%281%29%3E.mp4"' in page
    assert not re.search(r"https?://", page)


def test_large_videos_are_linked_and_small_ones_embedded(tmp_path):
    video = tmp_path / "drive.mp4"
    video.write_bytes(bytes(range(256)) * 40)
    sizes = []
    for limit in (10_240, 10_239):
        path = write_report(
            tmp_path / f"{limit}.html", title="t", video=video, telemetry=story(), settings={}, max_embedded_bytes=limit
        )
        sizes.append(path.stat().st_size)
    assert sizes[0] - sizes[1] == pytest.approx(10_240 * 4 / 3, abs=3)


def test_report_of_a_drive_without_a_lane(tmp_path):
    telemetry = story()
    telemetry["state"][:] = "lost"
    for name in ("offset_m", "offset_std_m", "curvature_per_m", "curvature_std_per_m", "lane_width_m"):
        telemetry[name][:] = np.nan
    telemetry["departure"] = np.full(200, np.nan)
    (tmp_path / "d.mp4").write_bytes(b"")
    page = write_report(tmp_path / "d.html", title="d", video=tmp_path / "d.mp4", telemetry=telemetry, settings={})
    text = page.read_text()
    assert "lost for 10.0 s in total." in text and "nan" not in text.lower()
