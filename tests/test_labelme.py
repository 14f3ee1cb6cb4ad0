"""labelme's files as labels: the form of labelme 6.3.1, and those of other programs."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from lanes.labelme import columns_of
from lanes.labels import label_rows, read_labels, read_predictions
from lanes.score import score_stills
from lanes.video.images import write_image
from tests.support.labelme_files import labelme_file, line_strip

SIZE = (1280, 720)
LEFT = line_strip("left", (600, 400), (200, 720))
RIGHT = line_strip("right", (700, 400), (1100, 720))


def write_labels(
    folder: Path, *shapes: dict, name: str = "a", **changes: object
) -> Path:
    """A file of labelme for NAME.png, with some of its entries changed."""
    content = labelme_file(f"{name}.png", SIZE, shapes) | changes
    path = folder / f"{name}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=2))
    return path


# Rows: a line is straight between its points, and has each row once.

TURNING_BACK = [(100, 700), (300, 400), (500, 600)]


UPWARDS = [(100, 700), (300, 500)]
WITH_A_FLAT_PART = [(100, 700), (300, 600), (400, 600), (500, 500)]


@pytest.mark.parametrize(
    ("points", "row", "column"),
    [
        (UPWARDS, 600, 200),
        (UPWARDS[::-1], 600, 200),
        (UPWARDS, 700, 100),
        (UPWARDS, 499, np.nan),
        (WITH_A_FLAT_PART, 550, 450),
        (TURNING_BACK, 550, 200),
        (TURNING_BACK[::-1], 550, 200),
    ],
)
def test_a_line_strip_at_a_row(points, row, column):
    points_px = np.array(points, float)
    columns = columns_of(points_px, np.array([row]))
    np.testing.assert_allclose(columns, [column])


def test_points_count_from_the_corner_of_the_first_pixel(tmp_path):
    strip = line_strip("left", (300.5, 400.5), (300.5, 720))
    path = write_labels(tmp_path, strip)
    (label,) = read_labels(path)
    assert label.columns[0, label.rows == 500] == 300
    np.testing.assert_array_equal(label.rows, label_rows(720))
    first, second, *_, last = label.rows
    assert (first, second, last) == (160, 170, 710)


def test_lines_along_the_border_are_in_the_image_and_lines_beyond_are_not(tmp_path):
    on_border = line_strip("left", (0, 400), (0, 720))
    leaving = line_strip("right", (1240, 400), (1320, 720))
    (label,) = read_labels(write_labels(tmp_path, on_border, leaving))
    left, right = label.columns
    assert (left[label.rows >= 410] == 0).all()
    assert (right[label.rows >= 570] == -2).all()
    in_image = (label.rows >= 410) & (label.rows <= 550)
    assert (right[in_image] > 1200).all()


def test_a_line_that_crosses_no_row_has_no_place_in_the_label(tmp_path):
    short = line_strip("far left", (100, 401), (105, 402))
    (label,) = read_labels(write_labels(tmp_path, short, RIGHT))
    assert label.sides == ("right",)
    assert label.columns.shape == (1, len(label.rows))


# Names of the lines.


def test_the_ego_lane_has_the_lines_with_its_names(tmp_path):
    """Whatever their order, and although another line is nearer to the centre."""
    far = line_strip("far left", (600, 400), (600, 720))
    (label,) = read_labels(write_labels(tmp_path, far, RIGHT, LEFT))
    ego = label.ego_lane(SIZE)
    at_bottom = ego.columns[:, label.rows == 710].ravel()
    np.testing.assert_allclose(at_bottom, [211.375, 1087.625], atol=0.01)


def test_lines_with_names_of_other_programs_have_their_sides_by_place(tmp_path):
    names = ("lane", "lane", "lane_3")
    feet = (900, 300, 20)
    strips = [
        line_strip(name, (640, 400), (foot, 720))
        for name, foot in zip(names, feet, strict=True)
    ]
    (label,) = read_labels(write_labels(tmp_path, *strips))
    assert label.sides == ()
    left, right = label.ego_lane(SIZE).columns[:, -1]
    assert left < 330
    assert right > 880


def test_other_shapes_are_no_lines(tmp_path):
    car = line_strip("car", (1, 1), (9, 9)) | {"shape_type": "rectangle"}
    straight = LEFT | {"shape_type": "line"}
    (label,) = read_labels(write_labels(tmp_path, car, straight, RIGHT))
    assert label.sides == ("left", "right")


def test_no_shape_is_the_label_of_an_image_without_a_lane(tmp_path):
    (label,) = read_labels(write_labels(tmp_path))
    assert label.empty
    assert label.size == SIZE


MISNAMED = line_strip("rigth", (700, 400), (1100, 720))
POLYGON = LEFT | {"shape_type": "polygon"}
ONE_POINT = line_strip("left", (700, 400))
FAR_OUTSIDE = line_strip("left", (700, 400), (1e12, 720))
UNNAMED = {"shape_type": "linestrip", "points": [[1, 2], [3, 4]]}


@pytest.mark.parametrize(
    ("shapes", "changes", "words"),
    [
        ([LEFT, MISNAMED], {}, "'rigth' .perhaps 'right'. is none of left, right, far"),
        ([MISNAMED], {"flags": {"checked": True}}, "'rigth'.*rename the line"),
        ([LEFT, LEFT], {}, "has 2 lines 'left'; join them in labelme"),
        ([POLYGON, RIGHT], {}, "the shape 'left' is no line; draw it as a line strip"),
        ([POLYGON], {}, "has 1 shapes, but no line strip; draw"),
        ([ONE_POINT], {}, "a line with a single point"),
        ([FAR_OUTSIDE], {}, "a point far outside"),
        ([UNNAMED], {}, "entry 'label' is missing"),
        ([LEFT], {"shapes": 3}, "is not a file of labelme"),
        ([LEFT], {"imagePath": ""}, "names no image"),
        ([LEFT], {"imageHeight": None}, "imageHeight None"),
        ([LEFT], {"imageWidth": 10**9}, "an image of 1000000000x720"),
        ([LEFT], {"imagePath": "/etc/a.png"}, "'/etc/a.png' lies outside"),
        ([LEFT], {"imagePath": "..\\a.png"}, "'../a.png' lies outside"),
    ],
)
def test_what_cannot_be_a_label_is_refused_with_the_name_of_the_file(
    tmp_path, shapes, changes, words
):
    path = write_labels(tmp_path, *shapes, **changes)
    with pytest.raises(ValueError, match=rf"a\.json: .*{words}"):
        read_labels(path)


# Folders.


def test_a_folder_has_the_labels_of_its_subfolders(tmp_path):
    """The image may be in another folder than its file: labelme's option --output."""
    write_labels(tmp_path, LEFT)
    write_labels(tmp_path / "day", LEFT, name="b")
    (tmp_path / "json").mkdir()
    write_labels(tmp_path / "json", LEFT, name="c", imagePath="..\\night\\c.png")
    labels = read_labels(tmp_path)
    assert [label.name for label in labels] == ["a.png", "day/b.png", "night/c.png"]
    assert [label.folder for label in labels] == [".", "day", "night"]


def test_other_json_files_of_a_folder_are_no_labels(tmp_path):
    write_labels(tmp_path, LEFT)
    (tmp_path / "classes.json").write_text('{"lane": 1}')
    (tmp_path / "._a.json").write_bytes(b"\0\5\26\7")  # of macOS
    assert [label.name for label in read_labels(tmp_path)] == ["a.png"]


@pytest.mark.parametrize("size_bytes", [0, 200])
def test_a_file_of_a_folder_that_is_cut_off_is_named(tmp_path, size_bytes):
    write_labels(tmp_path, LEFT)
    path = write_labels(tmp_path, LEFT, name="b")
    path.write_bytes(path.read_bytes()[:size_bytes])
    with pytest.raises(ValueError, match=r"b\.json: (is not JSON|the file is empty)"):
        read_labels(tmp_path)


def test_two_files_for_one_picture_are_refused(tmp_path):
    write_labels(tmp_path, LEFT)
    write_labels(tmp_path, LEFT, name="b", imagePath="a.png")
    words = r"b\.json: is of the same picture as .*a\.json, a\.png"
    with pytest.raises(ValueError, match=words):
        read_labels(tmp_path)


@pytest.mark.parametrize("files", [(), ("labels.jsonl",)])
def test_a_folder_without_files_of_labelme_is_refused(tmp_path, files):
    for name in files:
        (tmp_path / name).write_text("{}")
    with pytest.raises(ValueError, match="is a folder without files of labelme"):
        read_labels(tmp_path)


# Labels that nobody has checked.

UNCHECKED = {"flags": {"checked": False}}


def test_labels_that_nobody_has_checked_are_left_out_with_a_warning(tmp_path):
    write_labels(tmp_path, LEFT, flags={"checked": True})
    write_labels(tmp_path, LEFT, name="b", **UNCHECKED)
    with pytest.warns(UserWarning, match=r"1 of 2 labels are left out.*: b\.png"):
        labels = read_labels(tmp_path)
    assert [label.name for label in labels] == ["a.png"]


def test_without_a_checked_label_nothing_is_scored(tmp_path):
    write_labels(tmp_path, LEFT, **UNCHECKED)
    with pytest.raises(ValueError, match="none of its 1 labels is checked; correct"):
        read_labels(tmp_path)


def test_predictions_need_not_be_checked(tmp_path):
    labels = read_labels(write_labels(tmp_path, LEFT))
    proposal = write_labels(tmp_path / "found", LEFT, **UNCHECKED)
    (found,) = read_predictions(proposal, labels)
    np.testing.assert_array_equal(found.columns, labels[0].columns)


# The command `score`.


def scores_of(text: str) -> Sequence[str]:
    (cells,) = re.findall(r"^all (.*)$", text, re.MULTILINE)
    return cells.split()


def test_a_folder_is_scored_against_json_lines_and_json_lines_against_it(tmp_path, run):
    image = np.full((720, 1280, 3), 90, np.uint8)
    write_image(tmp_path / "a.png", image)
    write_labels(tmp_path, LEFT, RIGHT)
    (label,) = read_labels(tmp_path)
    row = {
        "raw_file": "a.png",
        "h_samples": label.rows.tolist(),
        "lanes": label.columns.tolist(),
    }
    lines = tmp_path / "lines.jsonl"
    lines.write_text(json.dumps(row) + "\n")
    page = tmp_path / "page.html"
    for labels, predictions in ((tmp_path, lines), (lines, tmp_path)):
        status, out, err = run("score", labels, predictions, "-o", page)
        assert (status, err) == (0, "")
        assert scores_of(out)[:3] == ["1", "1.000", "1.000"]
        assert "note:" not in out


def test_a_missing_picture_has_the_size_of_its_label(tmp_path):
    labels = read_labels(write_labels(tmp_path, LEFT, imageWidth=640, imageHeight=720))
    (score,) = score_stills(labels, [None], [tmp_path / "a.png"])
    assert score.size == (640, 720)


def test_a_picture_of_another_size_than_its_label_is_refused(tmp_path, run):
    image = np.full((360, 640, 3), 90, np.uint8)
    write_image(tmp_path / "a.png", image)
    path = write_labels(tmp_path, LEFT)
    page = tmp_path / "page.html"
    status, _, err = run("score", path, path, "-o", page)
    assert status == 2
    assert "a.png: is 640x360, but its label is of an image of 1280x720" in err
    assert not page.exists()
