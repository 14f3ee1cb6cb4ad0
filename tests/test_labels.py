"""Files of labels and predictions: their ego lane, which prediction is for which label, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from lanes.labels import EGO_SIDES, LaneColumns, read_labels, read_predictions

ROWS, SIZE = np.arange(400.0, 600, 10), (1280, 720)


def upright(column: float = 300.0) -> np.ndarray:
    return np.full(len(ROWS), column)


def slanted(slope: float, column: float) -> np.ndarray:
    """A line that goes `slope` columns right for each row down."""
    return column + slope * (ROWS - ROWS[0])


def entry(*lanes: np.ndarray, name: str = "a.png", **more: object) -> dict:
    return {"raw_file": name, "h_samples": ROWS.tolist(), "lanes": [one.tolist() for one in lanes], **more}


def write(folder: Path, *entries: dict, name: str = "labels.jsonl") -> Path:
    (folder / name).write_text("\n".join(json.dumps(entry) for entry in entries) + "\n\n")
    return folder / name


def ego_columns(*lanes: np.ndarray, sides: tuple[str, ...] = ()) -> list[float]:
    """Columns of the left and the right line in row 400."""
    lines = LaneColumns("a", ROWS, np.array(lanes).reshape(-1, len(ROWS)), sides)
    return lines.ego_lane(SIZE).columns[:, 0].tolist()


SHAKY = upright(500)
SHAKY[-2:] += -2, 2  # extended from these two, it would end at 552
# Lines, their names, and the columns of the left and the right one in row 400.
EGO_LANES = {
    # In row 400 the second line is nearest to the centre on the left; at the bottom it has gone far left.
    "next to the bottom centre": ((200, slanted(-2, 630), 500, 800, slanted(3, 700)), (), [500, 800]),
    "one without points": ((700, -2, 900), (), [-2, 700]),
    "extended from the lower half": ((SHAKY, 540, 900), (), [540, 900]),
    "a single one on the left": ((600,), (), [600, -2]),
    "none": ((), (), [-2, -2]),
    "two are both, wherever they are": ((100, 300), (), [100, 300]),
    "in any order": ((300, 100), (), [100, 300]),
    "without points in its place": ((-2, 300), (), [-2, 300]),
    "by their names": ((900, 300, 600), ("far left", "left", "right"), [300, 600]),
    "names before places": ((900, 300), EGO_SIDES, [900, 300]),
    "other names": ((900, 300, 600), ("right", "far right", "x"), [-2, 900]),
}


@pytest.mark.parametrize("name", EGO_LANES)
def test_the_ego_lane_among_lines(name):
    given, sides, expected = EGO_LANES[name]
    assert ego_columns(*(upright(one) if isinstance(one, int) else one for one in given), sides=sides) == expected


# Names of the labels, names of the predictions, and which prediction is that of each label.
PAIRS = {
    "by the end of the path": (
        ["clips/1/20.jpg", "clips/2/20.jpg"],
        ["/data/clips/2/20.jpg", "/x/3/20.jpg"],
        [None, 0],
    ),
    "not of other folders": (["day/1.jpg"], [f"/data/{name}/1.jpg" for name in ("night", "day", "rain")], [1]),
    "of Windows": (["clips\\1\\20.png", "clips\\2\\20.png"], ["D:\\clips\\2\\20.png", "D:\\clips\\1\\20.png"], [1, 0]),
}


@pytest.mark.parametrize("name", PAIRS)
def test_pictures_are_paired(tmp_path, name):
    labelled, predicted, expected = PAIRS[name]
    labels = read_labels(write(tmp_path, *(entry(upright(), name=one) for one in labelled)))
    found = (entry(upright(k), name=one) for k, one in enumerate(predicted))
    pairs = read_predictions(write(tmp_path, *found, name="found.jsonl"), labels)
    assert [pair and pair.columns[0, 0] for pair in pairs] == expected


def test_predictions_without_rows_are_at_those_of_their_label(tmp_path):
    labels = read_labels(write(tmp_path, entry(upright()), entry(upright(), name="b.png")))
    found = [entry(upright(7)), entry(name="b.png"), entry(upright(9)[:5], name="unknown.png")]
    for prediction in found:
        del prediction["h_samples"]
    one, none = read_predictions(write(tmp_path, *found, name="found.jsonl"), labels)
    assert one.rows.tolist() == ROWS.tolist() and one.columns[0, 0] == 7 and none.empty
    assert none.at(ROWS).shape == (0, len(ROWS))
    found[0]["lanes"] = [[1.0, 2.0]]
    with pytest.raises(ValueError, match=r"found.jsonl: line 1 is not a prediction .*shape \(1, 2\)"):
        read_predictions(write(tmp_path, *found, name="found.jsonl"), labels)


def test_files_that_cannot_be_paired_are_refused(tmp_path):
    one, other = entry(upright()), entry(upright(), name="b.png")
    found = write(tmp_path, one, name="found.jsonl")
    with pytest.raises(ValueError, match=r"found.jsonl: two labels or two predictions are for the same picture"):
        read_predictions(found, read_labels(write(tmp_path, one, one)))
    with pytest.raises(ValueError, match=r"found.jsonl: two labels or two predictions are for the same picture"):
        read_predictions(write(tmp_path, one, one, name="found.jsonl"), read_labels(write(tmp_path, one)))
    with pytest.raises(ValueError, match=r"labels.jsonl: has no prediction for any labelled image"):
        read_predictions(write(tmp_path, other), read_labels(found) and [LaneColumns("c.png", ROWS, np.empty(0))])


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"raw_file": 3}, "line 2 is not a label"),
        ({"lanes": {"0": [1]}}, "line 2 is not a label"),
        ({"sides": ["left", "right"]}, "line 2 is not a label"),
        ({"confidence": 1.5}, "line 2 is not a label"),
        ({"raw_file": "x/../../a.png"}, "the picture 'x/../../a.png' lies outside"),
        ({"raw_file": "..\\a.png"}, "the picture '../a.png' lies outside"),
        ({"raw_file": "a\0.png"}, "lies outside"),
    ],
)
def test_other_files_are_refused_with_the_line(tmp_path, more, words):
    """More of them: tests/support/bad_files.py, and any content in tests/properties/test_any_file.py."""
    with pytest.raises(ValueError, match=rf"labels\.jsonl: .*{words}"):
        read_labels(write(tmp_path, entry(upright()), entry(upright()) | more))
