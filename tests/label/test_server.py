"""The server of the page: who may ask, what it answers, and our lines only beside a saved label."""

from __future__ import annotations

import json
import sys
import time

import numpy as np
import pytest

from lanes.camera import save_camera
from lanes.images import write_image
from tests.support.command_line import main, run
from tests.support.labelling import Labelling, choose_clicks, labelling
from tests.support.painted_drive import BENDS

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


def both_lines(time_s: float) -> list:
    rng = np.random.default_rng(3)
    return [choose_clicks(BENDS, time_s, lateral_m, rng).round(1).tolist() for lateral_m in (1.8, -1.8)]


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


@pytest.mark.parametrize(
    "path",
    ["secret.txt", "../secret.txt", "picture/..%2fsecret.txt", "label.html/../server.py", "server.py", "%2e%2e/cli.py"]
    + ["picture/-1", "picture/0/../../secret.txt", "labels.jsonl", "", "ours", "still/"],
)
def test_no_other_file_is_served(session, path):
    status, content = session.ask(path)
    assert status in (403, 404) and b"not served" not in content and b"import" not in content


def test_no_file_of_the_folder_becomes_a_page(folder, tmp_path):
    """A picture may be anything that someone has put into the folder."""
    (tmp_path / "page.png").write_text("<html><script>alert(1)</script></html>")
    write_image(tmp_path / "still.jpg", BENDS.frame(0.0))
    with labelling(tmp_path, "--camera", folder / "camera.yaml") as session:
        status, content, headers = session.ask_with_headers("picture/0")
        assert status == 200 and content.startswith(b"<html>")
        assert (headers["Content-Type"], headers["X-Content-Type-Options"]) == ("image/png", "nosniff")
        assert session.ask_with_headers("picture/1")[2]["Content-Type"] == "image/jpeg"
        for path in ("still/0", "still/9", "label.js", "label.html"):
            status, content, headers = session.ask_with_headers(path)
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
    points = both_lines(TIMES_S[0])
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


def test_a_failed_comparison_is_a_sentence_and_the_session_goes_on(tmp_path):
    write_image(tmp_path / "square.png", np.full((500, 500, 3), 90, np.uint8))
    save_camera(BENDS.camera, tmp_path / "camera.yaml")  # of another aspect ratio
    with labelling(tmp_path, "--camera", tmp_path / "camera.yaml") as session:
        assert session.mark(0, [None, None], save=True)[0] == 200
        assert our_lines(session, 0)["error"].startswith("Our lines cannot be shown.")
        assert session.ask("still/0")[0] == 200
        status, out, err = run("label", "--no-browser", tmp_path)  # a second session of the same folder
        assert status == 1 and "another run is writing it" in err
    assert session.summary == f"1 of 1 stills have a label in {tmp_path / 'labels.jsonl'}\n"


def test_without_tornado_a_sentence_says_what_to_install(folder, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "lanes.label", None)
    assert main(["label", "--no-browser", str(folder)]) == 1
    assert "pip install 'tornado" in capsys.readouterr().err
