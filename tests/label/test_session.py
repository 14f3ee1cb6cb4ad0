"""Labels on disk: read by the benchmark, resumed, and never those of other pictures; stills picked from a video."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from lanes.drive import DriveSettings
from lanes.errors import LaneError
from lanes.images import read_image, write_image
from lanes.label import Session, pick_stills
from lanes.labels import read_labels
from lanes.video.reader import read_video
from tests.support.clips import write_clip
from tests.support.project import names

LEFT, RIGHT = [[200.0, 150.0], [100.0, 170.0]], [[220.0, 150.0], [300.0, 170.0]]


@pytest.fixture
def folder(tmp_path):
    for name in ("a.png", "sub/b.png", "c.png"):
        write_image(tmp_path / name, np.full((180, 320, 3), 90, np.uint8))
    return tmp_path


def session(folder, *names: str) -> Session:
    return Session(folder, [folder / name for name in names or ("a.png", "sub/b.png")])


def test_steps_are_resumed_and_are_no_label_before_they_are_saved(folder):
    session(folder).mark(0, [LEFT, []], save=False)
    assert not (folder / "labels.jsonl").exists() or not (folder / "labels.jsonl").read_text().strip()
    again = session(folder)
    assert again.label(0)["points"] == [LEFT, []] and max(again.label(0)["lanes"][0]) > 0
    again.mark(0, [LEFT, RIGHT], save=True)
    last = session(folder)
    assert last.saved() == [True, False] and last.label(0)["points"] == [LEFT, RIGHT]
    last.mark(0, [LEFT, None], save=False)  # the saved label stays until the change is saved
    assert last.saved() == [False, False]
    assert (read_labels(folder / "labels.jsonl")[0].columns[1] >= 0).any()


@pytest.mark.parametrize("points", [[LEFT, []], [LEFT, [[1, 2]]], [LEFT, [[1.0, 99.0], [50.0, 99.5]]]])
def test_an_unfinished_line_is_not_saved_as_invisible(folder, points):
    with pytest.raises(LaneError, match="two or more points, or as not visible"):
        session(folder).mark(0, points, save=True)
    assert session(folder).saved() == [False, False]


def test_a_failed_write_leaves_the_labels_as_they_were(folder, monkeypatch):
    kept = session(folder)
    kept.mark(0, [LEFT, RIGHT], save=True)
    before = (folder / "labels.jsonl").read_bytes()
    monkeypatch.setattr("lanes.files.os.replace", lambda *_: (_ for _ in ()).throw(OSError(28, "No space left")))
    with pytest.raises(OSError, match="labels.jsonl: cannot be written"):
        kept.mark(1, [LEFT, RIGHT], save=True)
    assert (folder / "labels.jsonl").read_bytes() == before
    assert names(folder) == {"a.png", "c.png", "sub", "labels.jsonl"}
    # what the page shows is what is on the disk
    assert kept.saved() == session(folder).saved() == [True, False]
    with pytest.raises(OSError, match="unsaved.jsonl: cannot be written"):
        kept.mark(1, [LEFT, []], save=False)
    assert kept.label(1)["points"] == [[], []]
    monkeypatch.undo()
    assert kept.mark(1, [LEFT, RIGHT], save=True)["saved"] == session(folder).saved() == [True, True]


def test_what_another_program_writes_meanwhile_stays(folder):
    """Its lines are merged; a still that it has labelled is not overwritten."""
    kept, path = session(folder), folder / "labels.jsonl"
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
    path.write_text("{")
    with pytest.raises(LaneError, match=r"labels\.jsonl: its labels cannot be used"):
        kept.mark(1, [LEFT, None], save=True)
    assert path.read_text() == "{"


def test_a_label_that_was_compared_stays_as_it_is(folder):
    """Also in a later session."""
    kept = session(folder)
    kept.mark(0, [LEFT, RIGHT], save=True)
    kept.compare(0)
    for later in (kept, session(folder)):
        for save in (False, True):
            with pytest.raises(LaneError, match="Our lines were shown, so this label stays as it is"):
                later.mark(0, [LEFT, None], save=save)
    assert session(folder).label(0)["points"] == [LEFT, RIGHT]
    assert (read_labels(folder / "labels.jsonl")[0].columns[1] >= 0).any()


def test_marks_of_the_still_before_are_proposed_on_the_paint_of_this_one(folder):
    """A proposal is written nowhere: it is a label only when the page sends it back."""
    for shift, name in enumerate(("a.png", "sub/b.png")):
        image = np.full((180, 320, 3), 90, np.uint8)
        cv2.line(image, (120 + 3 * shift, 90), (80 + 3 * shift, 170), (220, 220, 220), 3)
        write_image(folder / name, image)
    kept = session(folder)
    for empty in (0, 1):
        with pytest.raises(LaneError, match="has no points to copy"):
            kept.propose(empty)
    kept.mark(0, [[[120.0, 90.0], [80.0, 170.0]], None], save=False)
    before = {path: path.read_bytes() for path in folder.glob("*.jsonl")}
    proposed = kept.propose(1)
    left, right = proposed["points"]
    assert right is None and np.allclose(left, [[123, 90], [83, 170]], atol=1)
    assert kept.label(1)["points"] == [[], []] and kept.saved() == [False, False]
    assert {path: path.read_bytes() for path in folder.glob("*.jsonl")} == before
    assert kept.mark(1, proposed["points"], save=True)["saved"] == [False, True]
    write_image(folder / "c.png", np.full((180, 300, 3), 90, np.uint8))
    with pytest.raises(LaneError, match="another size"):
        session(folder, "a.png", "c.png").propose(1)


@pytest.mark.parametrize("text", ["[1]\n", '{"lanes": []}\n'])
def test_a_damaged_file_of_labels_is_named(folder, text):
    (folder / "labels.jsonl").write_text(text)
    with pytest.raises(LaneError, match=r"labels\.jsonl: its labels cannot be used"):
        session(folder)


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
