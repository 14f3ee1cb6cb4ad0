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


class TestEgoLane:
    def test_of_many_lines_those_next_to_the_bottom_centre(self):
        # In row 400 the second lane is nearest to the centre on the left; at the bottom it has gone far left.
        lines = [upright(200), slanted(-2, 630), upright(500), upright(800), slanted(3, 700)]
        assert ego_columns(*lines) == ego_columns(*lines[::-1]) == [500, 800]
        assert ego_columns(upright(700), upright(-2), upright(900)) == [-2, 700]

    def test_a_line_is_extended_from_its_lower_half_and_not_from_its_last_points(self):
        shaky = upright(500)
        shaky[-2:] += -2, 2  # extended from these two, it would end at 552
        assert ego_columns(shaky, upright(540), upright(900)) == [540, 900]

    def test_two_lines_are_both_lines_of_the_lane_wherever_it_is_in_any_order(self):
        assert ego_columns(upright(100), upright(300)) == ego_columns(upright(300), upright(100)) == [100, 300]
        # one without points keeps its place
        assert ego_columns(upright(-2), upright(300)) == [-2, 300]

    def test_named_lines_are_taken_by_their_names(self):
        lines = [upright(column) for column in (900, 300, 600)]
        assert ego_columns(*lines, sides=("far left", "left", "right")) == [300, 600]
        assert ego_columns(*lines[:2], sides=EGO_SIDES) == [900, 300]
        assert ego_columns(*lines, sides=("right", "far right", "x")) == [-2, 900]


class TestFiles:
    def test_predictions_without_rows_are_at_those_of_their_label(self, tmp_path):
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

    def test_pictures_are_paired_by_the_end_of_their_path(self, tmp_path):
        labels = read_labels(write(tmp_path, *(entry(upright(k), name=f"clips/{k}/20.jpg") for k in (1, 2))))
        found = [entry(upright(k + 10), name=f"/data/clips/{k}/20.jpg") for k in (2, 3)]
        first, second = read_predictions(write(tmp_path, *found, name="found.jsonl"), labels)
        assert first is None and second.columns[0, 0] == 12

    def test_predictions_for_other_folders_are_not_mixed_up(self, tmp_path):
        labels = read_labels(write(tmp_path, entry(upright(), name="day/1.jpg")))
        found = [entry(upright(k), name=f"/data/{name}/1.jpg") for k, name in enumerate(("night", "day", "rain"))]
        (prediction,) = read_predictions(write(tmp_path, *found, name="found.jsonl"), labels)
        assert prediction.columns[0, 0] == 1

    @pytest.mark.parametrize("pattern", ["/data/clips/{}/20.png", "D:\\clips\\{}\\20.png"])
    def test_paths_may_be_those_of_windows(self, tmp_path, pattern):
        labels = read_labels(write(tmp_path, *(entry(upright(), name=f"clips\\{k}\\20.png") for k in (1, 2))))
        assert labels[0].name == "clips/1/20.png"
        found = [entry(upright(k), name=pattern.format(k)) for k in (2, 1)]
        pairs = read_predictions(write(tmp_path, *found, name="found.jsonl"), labels)
        assert [prediction.columns[0, 0] for prediction in pairs] == [1, 2]

    def test_files_that_cannot_be_paired_are_refused(self, tmp_path):
        one, other = entry(upright()), entry(upright(), name="b.png")
        found = write(tmp_path, one, name="found.jsonl")
        with pytest.raises(ValueError, match=r"found.jsonl: two labels or two predictions are for the same picture"):
            read_predictions(found, read_labels(write(tmp_path, one, one)))
        with pytest.raises(ValueError, match=r"found.jsonl: two labels or two predictions are for the same picture"):
            read_predictions(write(tmp_path, one, one, name="found.jsonl"), read_labels(write(tmp_path, one)))
        with pytest.raises(ValueError, match=r"labels.jsonl: no prediction is for a labelled picture"):
            read_predictions(write(tmp_path, other), read_labels(found) and [LaneColumns("c.png", ROWS, np.empty(0))])

    @pytest.mark.parametrize(
        "text",
        [
            "nonsense",
            "[1]",
            "[" * 100_000,
            '{"raw_file": "a.png"}',
            '{"raw_file": "a.png", "lanes": [[1, 2]]}',
            '{"raw_file": 3, "h_samples": [], "lanes": []}',
            '{"raw_file": "", "h_samples": [], "lanes": []}',
            '{"raw_file": "a.png", "h_samples": [1, 2], "lanes": [[1]]}',
            '{"raw_file": "a.png", "h_samples": [1, 2], "lanes": [[1, 2], [1]]}',
            '{"raw_file": "a.png", "h_samples": [1, 2], "lanes": [[1, NaN]]}',
            '{"raw_file": "a.png", "h_samples": [1, 1e99], "lanes": []}',
            '{"raw_file": "a.png", "h_samples": [1], "lanes": {"0": [1]}}',
            '{"raw_file": "a.png", "h_samples": [-3], "lanes": []}',
            '{"raw_file": "a.png", "h_samples": [1], "lanes": [[1]], "sides": ["left", "right"]}',
            '{"raw_file": "a.png", "h_samples": [1], "lanes": [[1]], "confidence": 1.5}',
            '{"raw_file": "a.png", "h_samples": [1], "lanes": [[1]], "confidence": "high"}',
        ],
    )
    def test_other_files_are_refused_with_the_line(self, tmp_path, text):
        path = write(tmp_path, entry(upright()))
        path.write_text(path.read_text().strip() + f"\n{text}\n")
        with pytest.raises(ValueError, match=r"labels.jsonl: line 2 is not a label"):
            read_labels(path)
        with pytest.raises(FileNotFoundError, match="none.jsonl: there is no such label file"):
            read_labels(tmp_path / "none.jsonl")

    @pytest.mark.parametrize("name", ["../a.png", "/etc/a.png", "x/../../a.png", "..\\\\a.png", "a\\u0000.png"])
    def test_pictures_outside_of_the_folder_are_not_opened(self, tmp_path, name):
        path = tmp_path / "labels.jsonl"
        path.write_text(f'{{"raw_file": "{name}", "h_samples": [1], "lanes": []}}\n')
        with pytest.raises(ValueError, match=r"labels\.jsonl: the picture .* lies outside"):
            read_labels(path)
