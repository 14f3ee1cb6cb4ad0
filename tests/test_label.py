"""The command `python -m lanes label`: stills with a file of labelme beside each."""

from __future__ import annotations

import json
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from lanes.annotation import DriveSettings
from lanes.camera.model import save_camera
from lanes.detect.lane import columns_at
from lanes.errors import LaneError
from lanes.label import pick_stills, propose_lines
from lanes.labels import LaneColumns, label_rows, read_labels
from lanes.video.images import as_stored, read_image, write_image
from lanes.video.reader import read_video
from tests.support.clips import write_clip
from tests.support.labelme_files import labelme_file, line_strip
from tests.support.painted_drive import BENDS, tracked_bends
from tests.support.project import names

BLACK = np.zeros((360, 640, 3), np.uint8)


@pytest.fixture
def stills(tmp_path) -> Path:
    """Two stills of a drive, one of them in a subfolder, and its camera."""
    folder = tmp_path / "stills"
    write_image(folder / "a.png", BENDS.frame(0.0))
    write_image(folder / "sub" / "b.png", BENDS.frame(0.6))
    return folder


@pytest.fixture
def label(tmp_path, run):
    """A function that runs the command for a drive's stills; returns what it prints."""
    camera = save_camera(BENDS.camera, tmp_path / "camera.yaml")

    def label(*arguments: object, status: int = 0) -> str:
        ended, out, err = run("label", "--camera", camera, *arguments)
        assert ended == status, err
        return err if status else out

    return label


def check(*files: Path) -> None:
    """Tick the flag, as a person does in labelme."""
    for file in files:
        content = json.loads(file.read_text())
        content["flags"]["checked"] = True
        file.write_text(json.dumps(content))


def true_columns(time_s: float, rows: np.ndarray) -> np.ndarray:
    """Columns (2, R) of the lines of the ego lane in a frame of the drive."""
    truth = BENDS.truth(time_s)
    x_m = np.geomspace(2, 60, 400)
    outlines = []
    for side in (0, 1):
        along_m = np.column_stack([x_m, truth.line_y(side, x_m)])
        outlines.append(BENDS.camera.road_to_pixels(along_m))
    return columns_at(rows, outlines, BENDS.camera)


def require_near_truth(found: LaneColumns, time_s: float) -> None:
    ego = found.ego_lane(BENDS.camera.size).columns
    true = true_columns(time_s, found.rows)
    both = (ego >= 0) & (true >= 0)
    assert both.sum(axis=1).min() >= 15
    assert np.abs(ego - true)[both].max() < 3


def test_each_still_gets_a_file_with_the_lines_that_are_seen_in_it(stills, label):
    label(stills, stills / "sub")
    files = [stills / "a.json", stills / "sub" / "b.json"]
    check(*files)
    first, second = read_labels(stills)
    assert [first.name, second.name] == ["a.png", "sub/b.png"]
    assert first.sides == ("left", "right", "far right")
    require_near_truth(first, 0.0)
    require_near_truth(second, 0.6)


def test_the_file_has_the_form_of_labelme(stills, label):
    label(stills)
    content = json.loads((stills / "a.json").read_text())
    expected = labelme_file("a.png", (640, 360), content["shapes"])
    assert content == expected | {"flags": {"checked": False}}
    for shape in content["shapes"]:
        assert shape == line_strip(shape["label"], *shape["points"])
        columns, rows = np.array(shape["points"]).T
        assert 2 <= len(rows) <= 20
        assert 0 <= columns.min() < columns.max() <= 640
        assert 0 <= rows.min() < rows.max() <= 360


@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_file_is_for_the_upright_still(tmp_path, label, orientation):
    exif = Image.Exif()
    exif[0x0112] = orientation
    stored = as_stored(BENDS.frame(0.0), orientation)
    Image.fromarray(stored).save(tmp_path / "a.jpg", exif=exif, quality=95)

    label(tmp_path / "a.jpg")

    check(tmp_path / "a.json")
    (found,) = read_labels(tmp_path / "a.json")
    assert found.size == (640, 360)
    require_near_truth(found, 0.0)


def test_an_image_without_a_lane_has_no_line(tmp_path, label):
    write_image(tmp_path / "black.png", BLACK)
    label(tmp_path / "black.png")
    content = json.loads((tmp_path / "black.json").read_text())
    assert content["shapes"] == []


def test_a_line_that_is_not_seen_is_not_proposed():
    _, lane = tracked_bends()
    left, right = lane.evidence
    inferred = replace(lane, evidence=(left, replace(right, seen=False)))
    names_of = []
    for some in (lane, inferred):
        strips = propose_lines(some, BENDS.camera)
        names_of.append({strip.name for strip in strips})
    assert names_of[0] - names_of[1] == {"right"}
    assert "left" in names_of[1]


def test_no_lane_has_no_line():
    assert propose_lines(None, BENDS.camera) == ()


@pytest.mark.parametrize("content", ["of a person", "{}", ""])
def test_a_file_that_is_there_stays(stills, label, content):
    (stills / "a.json").write_text(content)
    said = label(stills, stills / "sub")
    assert (stills / "a.json").read_text() == content
    assert (stills / "sub" / "b.json").exists()
    assert said.startswith("wrote 1 label files beside the stills; 1 were there and st")


def test_a_second_run_changes_nothing(stills, label):
    label(stills)
    before = (stills / "a.json").stat().st_mtime_ns
    said = label(stills)
    assert (stills / "a.json").stat().st_mtime_ns == before
    assert "wrote 0 label files" in said


def test_the_printed_command_opens_the_folder_of_all_stills(tmp_path, stills, label):
    named = stills.rename(tmp_path / "my 'stills'")
    said = label(named, named / "sub")
    command = shlex.split(said.splitlines()[-1])
    assert command == [
        "labelme",
        str(named),
        "--labels",
        "left,right,far left,far right",
        "--validate-label",
        "exact",
    ]


def test_two_stills_that_would_share_a_file_are_refused(stills, label):
    write_image(stills / "a.jpg", BENDS.frame(0.0))
    said = label(stills, status=2)
    assert "a.png: has the label file of a.jpg" in said
    assert not (stills / "a.json").exists()


def test_a_still_that_cannot_be_read_is_named_and_the_others_are_prepared(
    stills, label
):
    cut = stills / "cut.png"
    cut.write_bytes((stills / "a.png").read_bytes()[:2000])
    said = label(stills, status=1)
    assert "cut.png: cannot be decoded" in said
    assert names(stills) == {"a.png", "a.json", "cut.png", "sub"}


def test_stills_of_a_video_are_written_with_their_files(tmp_path, label):
    frames = [BENDS.frame(number / 25) for number in range(10)]
    video = write_clip(tmp_path / "drive.mp4", frames)
    output = tmp_path / "picked"

    label(video, "--stills", 2, "-o", output)

    stems = ("drive_01_of_2", "drive_02_of_2")
    files = {f"{stem}{suffix}" for stem in stems for suffix in (".png", ".json")}
    assert names(output) == files


def shade(level: int) -> np.ndarray:
    return np.full((90, 160, 3), level, np.uint8)


@pytest.fixture
def shades(tmp_path) -> Path:
    """A video of gray images, each brighter than the one before."""
    images = list(map(shade, range(20, 220, 10)))
    return write_clip(tmp_path / "drive.mp4", images)


def test_stills_are_spread_over_the_video(tmp_path, shades):
    settings = DriveSettings(output=tmp_path / "labels")
    stills = list(pick_stills(shades, settings, 4))
    frames = list(read_video(shades))
    expected = [f"drive_0{number}_of_4.png" for number in (1, 2, 3, 4)]
    assert [still.name for still in stills] == expected
    for number, still in enumerate(stills):
        np.testing.assert_array_equal(read_image(still), frames[5 * number])


def test_stills_of_an_earlier_run_stay(tmp_path, shades):
    settings = DriveSettings(output=tmp_path / "labels")
    stills = list(pick_stills(shades, settings, 4))
    times = [still.stat().st_mtime_ns for still in stills]
    assert list(pick_stills(shades, settings, 4)) == stills
    assert [still.stat().st_mtime_ns for still in stills] == times


def test_stills_of_another_video_of_the_same_name_are_refused(tmp_path, shades):
    settings = DriveSettings(output=tmp_path / "labels")
    list(pick_stills(shades, settings, 4))
    darker = list(map(shade, range(210, 10, -10)))
    (tmp_path / "other").mkdir()
    other = write_clip(tmp_path / "other" / "drive.mp4", darker)
    with pytest.raises(LaneError, match=r"drive_01_of_4\.png: is no frame of this pa"):
        list(pick_stills(other, settings, 4))


def test_the_compared_rows_are_those_of_tusimple_at_720():
    assert label_rows(720).tolist() == list(range(160, 720, 10))
    assert label_rows(360).tolist() == list(range(80, 360, 5))
