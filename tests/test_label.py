"""The labelling session: labels on disk, the server of its page, and the curve through clicked points."""

from __future__ import annotations

import json
import sys
import time
from itertools import product
from pathlib import Path

import cv2
import numpy as np
import pytest

from lanes.camera.model import save_camera
from lanes.detect.lane import columns_at
from lanes.drive import DriveSettings
from lanes.errors import LaneError
from lanes.label import NO_POINT, Session, fit_line, label_rows, pick_stills
from lanes.labels import read_labels
from lanes.video.images import read_image, write_image
from lanes.video.reader import read_video
from simulator.painted_drive import DASH_M
from simulator.rendering.drive import Motion
from simulator.road.geometry import RoadGeometry
from tests.support import command_line
from tests.support.clips import write_clip
from tests.support.labelling import Labelling, choose_clicks, labelling, line_pixels
from tests.support.painted_drive import BENDS, CAMERA, SMALL, PaintedDrive, lane_lines, s_bend, straight_road
from tests.support.project import names

LEFT, RIGHT = [[200.0, 150.0], [100.0, 170.0]], [[220.0, 150.0], [300.0, 170.0]]


# Labels on disk: read by the benchmark, resumed, and never those of other pictures.


@pytest.fixture
def stills(tmp_path):
    for name in ("a.png", "sub/b.png", "c.png"):
        write_image(tmp_path / name, np.full((180, 320, 3), 90, np.uint8))
    return tmp_path


def open_session(stills: Path, *names: str) -> Session:
    return Session(stills, [stills / name for name in names or ("a.png", "sub/b.png")])


def test_steps_are_resumed_and_are_no_label_before_they_are_saved(stills):
    open_session(stills).mark(0, [LEFT, []], save=False)
    assert not (stills / "labels.jsonl").exists() or not (stills / "labels.jsonl").read_text().strip()
    again = open_session(stills)
    assert again.label(0)["points"] == [LEFT, []] and max(again.label(0)["lanes"][0]) > 0
    again.mark(0, [LEFT, RIGHT], save=True)
    last = open_session(stills)
    assert last.saved() == [True, False] and last.label(0)["points"] == [LEFT, RIGHT]
    last.mark(0, [LEFT, None], save=False)  # the saved label stays until the change is saved
    assert last.saved() == [False, False]
    assert (read_labels(stills / "labels.jsonl")[0].columns[1] >= 0).any()


@pytest.mark.parametrize("points", [[LEFT, []], [LEFT, [[1, 2]]], [LEFT, [[1.0, 99.0], [50.0, 99.5]]]])
def test_an_unfinished_line_is_not_saved_as_invisible(stills, points):
    with pytest.raises(LaneError, match="two or more points, or as not visible"):
        open_session(stills).mark(0, points, save=True)
    assert open_session(stills).saved() == [False, False]


def test_a_failed_write_leaves_the_labels_as_they_were(stills, monkeypatch):
    kept = open_session(stills)
    kept.mark(0, [LEFT, RIGHT], save=True)
    before = (stills / "labels.jsonl").read_bytes()
    monkeypatch.setattr("lanes.files.os.replace", lambda *_: (_ for _ in ()).throw(OSError(28, "No space left")))
    with pytest.raises(OSError, match="labels.jsonl: cannot be written"):
        kept.mark(1, [LEFT, RIGHT], save=True)
    assert (stills / "labels.jsonl").read_bytes() == before
    assert names(stills) == {"a.png", "c.png", "sub", "labels.jsonl"}
    # what the page shows is what is on the disk
    assert kept.saved() == open_session(stills).saved() == [True, False]
    with pytest.raises(OSError, match="unsaved.jsonl: cannot be written"):
        kept.mark(1, [LEFT, []], save=False)
    assert kept.label(1)["points"] == [[], []]
    monkeypatch.undo()
    assert kept.mark(1, [LEFT, RIGHT], save=True)["saved"] == open_session(stills).saved() == [True, True]


def test_what_another_program_writes_meanwhile_stays(stills):
    """Its lines are merged; a still that it has labelled is not overwritten."""
    kept, path = open_session(stills), stills / "labels.jsonl"
    kept.mark(0, [LEFT, RIGHT], save=True)
    added = {"raw_file": "c.png", "h_samples": [1, 2], "lanes": [[5, 6]], "mine": "note"}
    with path.open("a") as file:
        file.write(json.dumps(added) + "\n")
    kept.mark(0, [LEFT, None], save=True)
    first, second = map(json.loads, path.read_text().splitlines())
    assert first["points"] == [LEFT, None] and second == added
    theirs = {"raw_file": "sub/b.png", "h_samples": [1, 2], "lanes": [[7, 8]]}
    path.write_text(path.read_text() + json.dumps(theirs) + "\n")
    with pytest.raises(LaneError, match="sub/b.png: another program changed its label in labels.jsonl; open this st"):
        kept.mark(1, [LEFT, RIGHT], save=True)
    assert json.loads(path.read_text().splitlines()[2]) == theirs
    assert kept.label(1)["lanes"] == [[7, 8]]  # opened again, it can be changed
    assert kept.mark(1, [LEFT, RIGHT], save=True)["saved"] == [True, True]
    for text in ("{", "[1]\n", '{"lanes": []}\n'):
        path.write_text(text)
        for use in (lambda: kept.mark(1, [LEFT, None], save=True), lambda: open_session(stills)):
            with pytest.raises(LaneError, match=r"labels\.jsonl: its labels cannot be used"):
                use()
        assert path.read_text() == text


def test_a_label_that_was_compared_stays_as_it_is(stills):
    """Also in a later session."""
    kept = open_session(stills)
    kept.mark(0, [LEFT, RIGHT], save=True)
    kept.compare(0)
    for later in (kept, open_session(stills)):
        for save in (False, True):
            with pytest.raises(LaneError, match="Our lines were shown, so this label stays as it is"):
                later.mark(0, [LEFT, None], save=save)
    assert open_session(stills).label(0)["points"] == [LEFT, RIGHT]
    assert (read_labels(stills / "labels.jsonl")[0].columns[1] >= 0).any()


def test_marks_of_the_still_before_are_proposed_on_the_paint_of_this_one(stills):
    """A proposal is written nowhere: it is a label only when the page sends it back."""
    for shift, name in enumerate(("a.png", "sub/b.png")):
        image = np.full((180, 320, 3), 90, np.uint8)
        cv2.line(image, (120 + 3 * shift, 90), (80 + 3 * shift, 170), (220, 220, 220), 3)
        write_image(stills / name, image)
    kept = open_session(stills)
    for empty in (0, 1):
        with pytest.raises(LaneError, match="has no points to copy"):
            kept.propose(empty)
    kept.mark(0, [[[120.0, 90.0], [80.0, 170.0]], None], save=False)
    before = {path: path.read_bytes() for path in stills.glob("*.jsonl")}
    proposed = kept.propose(1)
    left, right = proposed["points"]
    assert right is None and np.allclose(left, [[123, 90], [83, 170]], atol=1)
    assert kept.label(1)["points"] == [[], []] and kept.saved() == [False, False]
    assert {path: path.read_bytes() for path in stills.glob("*.jsonl")} == before
    assert kept.mark(1, proposed["points"], save=True)["saved"] == [False, True]
    write_image(stills / "c.png", np.full((180, 300, 3), 90, np.uint8))
    with pytest.raises(LaneError, match="another size"):
        open_session(stills, "a.png", "c.png").propose(1)


def test_stills_are_spread_over_the_video_and_kept(tmp_path):
    shades = [np.full((90, 160, 3), level, np.uint8) for level in range(20, 220, 10)]
    video = write_clip(tmp_path / "drive.mp4", shades)
    settings = DriveSettings(output=tmp_path / "labels")
    stills = list(pick_stills(video, settings, 4))
    assert [still.name for still in stills] == [f"drive_0{k}_of_4.png" for k in (1, 2, 3, 4)]
    frames = list(read_video(video))
    assert all(np.array_equal(read_image(stills[k]), frames[5 * k]) for k in range(4))
    times = [still.stat().st_mtime_ns for still in stills]
    assert list(pick_stills(video, settings, 4)) == stills
    assert [still.stat().st_mtime_ns for still in stills] == times
    (tmp_path / "other").mkdir()
    other = write_clip(tmp_path / "other" / "drive.mp4", shades[::-1])
    with pytest.raises(LaneError, match=r"drive_01_of_4\.png: is no frame of this part of .*other"):
        list(pick_stills(other, settings, 4))


# The server of the page: the hosts that may ask, its answers, and our lines only with a saved label.

TIMES_S = (0.0, 0.6)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drive")
    for number, time_s in enumerate(TIMES_S):
        write_image(folder / f"{number}.png", BENDS.frame(time_s))
    (folder / "secret.txt").write_text("not served")
    save_camera(BENDS.camera, folder / "camera.yaml")
    return folder


@pytest.fixture(scope="module")
def session(folder):
    with labelling(folder, "--camera", folder / "camera.yaml") as session:
        yield session


def our_lines(session: Labelling, number: int) -> dict:
    for _ in range(200):
        answer = json.loads(session.ask(f"ours/{number}")[1])
        if answer:
            return answer
        time.sleep(0.1)
    raise AssertionError("our lines did not come")


def test_only_the_token_on_this_host_opens_anything(session):
    assert session.ask("label.html")[0] == session.ask("still/0")[0] == 200
    for root in ("/", "/token/", session.root[:-2] + "/", session.root.lower()):
        assert {session.ask(path, root=root)[0] for path in ("label.html", "still/0", "picture/0", "")} == {404}
    for host in ("rebound.example", f"rebound.example:{session.port}", f"localhost:{session.port}", ""):
        assert session.ask("still/0", Host=host)[0] in (400, 404)
    assert session.ask("still/0", Host=f"127.0.0.1:{session.port}")[0] == 200
    assert session.ask("still/99")[:2] == (404, b"There is no such still.")


@pytest.mark.parametrize(
    "path",
    ["secret.txt", "../secret.txt", "picture/..%2fsecret.txt", "label.html/../server.py", "server.py", "%2e%2e/cli.py"]
    + ["picture/-1", "picture/0/../../secret.txt", "labels.jsonl", "", "ours", "still/"],
)
def test_no_other_file_is_served(session, path):
    status, content, _ = session.ask(path)
    assert status in (403, 404) and b"not served" not in content and b"import" not in content


def test_no_file_of_the_folder_becomes_a_page(folder, tmp_path):
    """A picture may be anything that someone has put into the folder."""
    (tmp_path / "page.png").write_text("<html><script>alert(1)</script></html>")
    write_image(tmp_path / "still.jpg", BENDS.frame(0.0))
    with labelling(tmp_path, "--camera", folder / "camera.yaml") as session:
        status, content, headers = session.ask("picture/0")
        assert status == 200 and content.startswith(b"<html>")
        assert (headers["Content-Type"], headers["X-Content-Type-Options"]) == ("image/png", "nosniff")
        assert session.ask("picture/1")[2]["Content-Type"] == "image/jpeg"
        for path in ("still/0", "still/9", "label.js", "label.html"):
            status, content, headers = session.ask(path)
            assert headers["X-Content-Type-Options"] == "nosniff"
            if status >= 400:
                assert headers["Content-Type"] == "text/plain; charset=utf-8"
                assert b"Traceback" not in content and b"index" not in content


def test_marks_that_are_none_are_refused_with_a_sentence(session, folder):
    """At once: points far outside of the picture once cost a minute and all memory."""
    began_s = time.monotonic()
    bad = [3, [[]], [[[1, 2, 3]], []], [[["a", "b"], [1, 2]], []], [[[1e9, 2e9], [1, 1]], []], [[[1, -1e9]], None]]
    bad += [[[[float("nan"), 1]], None], [[[1, 1]] * 5000, None], {"a": 1, "b": 2}, None]
    for points in bad:
        status, content = session.mark(1, points)
        assert status == 400 and content.startswith(b"Marks are "), points
    for body in (3, [], {"points": [None, None]}, {"points": [None, None], "save": True, "more": 1}):
        assert session.ask("still/1", body=body)[0] == 400
    assert time.monotonic() - began_s < 5
    status, content = session.mark(1, [[[1, 2]], None], save=True)
    assert status == 400 and b"two or more points, or as not visible" in content
    assert not (folder / "labels.jsonl").exists() or "1.png" not in (folder / "labels.jsonl").read_text()


def test_our_lines_come_only_after_the_label_is_saved(session):
    rng = np.random.default_rng(3)
    points = [choose_clicks(BENDS, TIMES_S[0], lateral_m, rng).round(1).tolist() for lateral_m in (1.8, -1.8)]
    session.mark(0, points)
    refused = json.loads(session.ask("ours/0")[1])
    assert "lanes" not in refused and "Save the label first" in refused["error"]
    status, content = session.mark(0, points, save=True)
    label = json.loads(content)
    assert status == 200 and label["saved"] == [True, False] and "lanes" in label
    assert len(json.loads(session.ask("proposal/1")[1])["points"][0]) == 5 and session.ask("proposal/0")[0] == 400
    ours = our_lines(session, 0)
    assert ours["h_samples"] == label["h_samples"]
    theirs, found = np.array(label["lanes"]), np.array(ours["lanes"][:2])
    both = (theirs >= 0) & (found >= 0)
    assert both.sum() > 30 and np.median(np.abs(theirs - found)[both]) < 2
    # a reloaded page and a second one have no other right
    assert json.loads(session.ask("still/0")[1])["compared"] is True
    assert session.mark(0, [points[0], None]) == (400, b"Our lines were shown, so this label stays as it is.")


@pytest.mark.slow
def test_a_failed_comparison_is_a_sentence_and_the_session_goes_on(tmp_path):
    write_image(tmp_path / "square.png", np.full((500, 500, 3), 90, np.uint8))
    save_camera(BENDS.camera, tmp_path / "camera.yaml")  # of another aspect ratio
    with labelling(tmp_path, "--camera", tmp_path / "camera.yaml") as session:
        assert session.mark(0, [None, None], save=True)[0] == 200
        assert our_lines(session, 0)["error"].startswith("Our lines cannot be shown.")
        assert session.ask("still/0")[0] == 200
        status, _, err = command_line.run("label", "--no-browser", tmp_path)  # a second session of the same folder
        assert status == 1 and "another run is writing it" in err
    assert session.summary == f"1 of 1 stills have a label in {tmp_path / 'labels.jsonl'}\n"


def test_without_tornado_a_sentence_says_what_to_install(folder, monkeypatch, run):
    monkeypatch.setitem(sys.modules, "lanes.label", None)
    status, _, err = run("label", "--no-browser", folder)
    assert status == 1 and "pip install 'tornado" in err


# The curve through clicked points: on the paint where there is some, through the points where there is none.


def plain() -> np.ndarray:
    return np.random.default_rng(0).normal(100, 2, (360, 640, 3)).astype(np.uint8)


def arc(radius_m: float) -> RoadGeometry:
    bend, along_m = [0, 0, 1 / radius_m, 1 / radius_m, 0, 0], [30.0, 40.0, 40.0 + 3 * radius_m, 60.0 + 3 * radius_m]
    return RoadGeometry([0.0, *along_m, 2000.0], bend)


DASHED = {
    "straight": (straight_road(), 5.0),
    "bend of 200 m": (s_bend(200.0), 90.0),
    "S of 60 m": (s_bend(60.0, 20.0), 45.0),
    "hairpin of 25 m": (arc(25.0), 25.0),
}


@pytest.mark.parametrize("camera", [SMALL, CAMERA], ids=["360 rows", "720 rows"])
@pytest.mark.parametrize("name", DASHED)
def test_the_line_is_smooth_between_dashes_and_bends_with_the_road(name, camera):
    """A stiffness that is the same in all rows gives 1.2, 0.7, 5 and 2.4 px at 720 rows."""
    road, s_m = DASHED[name]
    lines = lane_lines(left={"dash_m": DASH_M, "phase_m": 1.0})
    drive = PaintedDrive(road, lines, motion=Motion(s_m, 10.0, offset_m=0.3), camera=camera)
    image, rows, away_px = drive.frame(0.0), label_rows(camera.height), []
    for seed, lateral_m in product(range(4), (1.8, -1.8)):
        got = fit_line(image, choose_clicks(drive, 0.0, lateral_m, np.random.default_rng(seed)))
        truth = columns_at(rows, [line_pixels(drive, 0.0, lateral_m)], camera)[0]
        across = (got - truth) / np.hypot(1, np.gradient(truth, rows))
        away_px.append(across[(got >= 0) & (truth >= 0)][1:-1])
    assert np.sqrt(np.mean(np.square(np.concatenate(away_px)))) < 0.6


def test_without_paint_the_points_decide_and_their_order_does_not():
    image, points = plain(), [[300.0, 200.0], [250.0, 250.0], [120.0, 350.0]]
    got, rows = fit_line(image, points), label_rows(360)
    assert rows.tolist() == list(range(80, 360, 5)) and label_rows(720).tolist() == list(range(160, 720, 10))
    assert np.array_equal(got, fit_line(image, points[::-1]))
    for column, row in points:
        assert got[rows == row] == pytest.approx(column, abs=3)
    assert (got[(rows < 195) | (rows > 355)] == NO_POINT).all() and (got[(rows >= 200) & (rows <= 350)] >= 0).all()


@pytest.mark.parametrize("shift_px, snapped", [(3, True), (25, False)])
def test_paint_is_reached_only_near_the_curve(shift_px, snapped):
    image = plain()
    cv2.line(image, (200 + shift_px, 0), (200 + shift_px, 359), (200, 200, 200), 5)
    got = fit_line(image, [[200, 230], [200, 350]])
    assert np.median(got[got >= 0]) == pytest.approx(203 if snapped else 200, abs=0.6)
