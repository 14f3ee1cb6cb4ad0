"""TuSimple's score on lines made by hand, and the command that prints it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmark.labels.tusimple import (
    LaneColumns,
    LineScore,
    describe_all_lines,
    pair_predictions,
    read_all_lines,
    read_labels,
    read_predictions,
    score_all_lines,
    score_lines,
    summarize_lines,
)
from lanes.images import write_image

ROWS = np.arange(400.0, 600, 10)


def lane(left: np.ndarray, right: np.ndarray | None = None, *, name: str = "a.jpg", rows: np.ndarray = ROWS):
    nothing = np.full(len(rows), -2.0)
    return LaneColumns(name, rows, np.array([left, nothing if right is None else right]))


def upright(column: float = 300.0) -> np.ndarray:
    return np.full(len(ROWS), column)


def slanted(slope: float) -> np.ndarray:
    """A line that goes `slope` columns right for each row down."""
    return 100 + slope * (ROWS - ROWS[0])


class TestPoints:
    @pytest.mark.parametrize(
        ("off_px", "accuracy", "width_px"),
        [(0, 1, 1280), (19.99, 1, 1280), (20, 0, 1280), (-19.99, 1, 1280), (-20.01, 0, 1280)]
        + [(9.99, 1, 640), (10.01, 0, 640)],
    )
    def test_an_upright_line_may_be_off_by_less_than_20_px_of_1280(self, off_px, accuracy, width_px):
        left, right = score_lines(lane(upright()), lane(upright() + off_px), width_px=width_px)
        assert left == LineScore(accuracy, pytest.approx(abs(off_px)), True)
        assert right == LineScore(None, None, False)

    @pytest.mark.parametrize(("slope", "tolerance"), [(0.75, 25), (-0.75, 25), (2.4, 52)])
    def test_a_slanted_one_by_20_px_over_the_cosine_of_its_angle(self, slope, tolerance):
        # 0.75 columns a row: 3-4-5, cosine 0.8; 2.4: 5-12-13, cosine 5/13
        line = slanted(slope) + 400
        for off_px, accuracy in ((tolerance - 0.01, 1), (tolerance + 0.01, 0)):
            assert score_lines(lane(line), lane(line + off_px))[0].accuracy == accuracy

    def test_points_that_are_missing_are_wrong_and_have_no_error(self):
        predicted = upright() + 3
        predicted[:5] = -2
        score = score_lines(lane(upright()), lane(predicted))[0]
        assert score == LineScore(0.75, 3.0, True)
        assert score_lines(lane(upright()), None)[0] == LineScore(0.0, None, False)

    def test_rows_without_label_do_not_count(self):
        label = upright()
        label[:15] = -2
        assert score_lines(lane(label), lane(upright()))[0].accuracy == 1
        label[:17] = -2
        # three points are too few for an angle
        assert score_lines(lane(label), lane(upright()))[0] == LineScore(None, None, True)

    def test_predictions_may_be_at_other_rows(self):
        other = LaneColumns("a.jpg", ROWS[::-2], np.array([upright()[::2], upright()[::2]]))
        assert score_lines(lane(upright(), upright()), other)[0].accuracy == 0.5
        nowhere = LaneColumns("a.jpg", ROWS + 5, np.array([upright(), upright()]))
        assert score_lines(lane(upright()), nowhere)[0] == LineScore(0.0, None, False)

    def test_left_is_compared_with_left_and_right_with_right(self):
        label = lane(upright(200), upright(900))
        assert [s.accuracy for s in score_lines(label, lane(upright(900), upright(200)))] == [0, 0]


class TestOfficialScore:
    """(accuracy, FP, FN) as TuSimple's `lane.py` computes them."""

    @staticmethod
    def score(labelled: list, predicted: list, width_px: int = 1280) -> tuple[float, float, float]:
        label, found = (
            LaneColumns("a.jpg", ROWS, np.array(lines).reshape(-1, len(ROWS))) for lines in (labelled, predicted)
        )
        return score_all_lines(label, found, width_px=width_px)

    def test_each_label_counts_with_its_best_prediction_in_any_order(self):
        four = [upright(column) for column in (100, 400, 800, 1100)]
        assert self.score(four, four[::-1]) == (1, 0, 0)
        assert self.score(four, four[:2]) == (0.5, 0, 0.5)
        assert self.score(four[:2], four) == (1, 0.5, 0)

    def test_rows_without_a_point_are_correct_if_the_prediction_has_none_either(self):
        half, third = upright(), upright()
        half[:10], third[:7] = -2, -2
        assert self.score([half], [half]) == (1, 0, 0)
        # 3 of 20 rows differ: just matched; one more is not
        assert self.score([half], [third]) == (0.85, 0, 0)
        third[6] = 300
        assert self.score([half], [third]) == (0.8, 1, 1)

    def test_a_prediction_without_points_is_a_false_positive(self):
        assert self.score([upright()], [upright(), upright(-2)]) == (1, 0.5, 0)

    def test_three_surplus_predictions_cost_everything(self):
        assert self.score([upright()], [upright()] * 3) == (1, pytest.approx(2 / 3), 0)
        assert self.score([upright()], [upright()] * 4) == (0, 0, 1)

    def test_of_five_labels_the_worst_is_left_out(self):
        five = [upright(column) for column in (100, 300, 600, 900, 1200)]
        assert self.score(five, five[:4]) == (1, 0, 0)
        assert self.score(five, five[:3]) == (0.75, 0, 0.25)

    def test_the_tolerance_grows_with_the_angle_and_the_width(self):
        line = slanted(0.75) + 400
        assert self.score([line], [line + 24.9])[0] == 1 and self.score([line], [line + 25.1])[0] == 0
        assert self.score([line], [line + 24.9], width_px=640)[0] == 0

    def test_no_lines(self):
        assert self.score([], []) == (0, 0, 0) and self.score([upright()], []) == (0, 0, 1)


def test_summary_counts_lines():
    some = [
        LineScore(1.0, 2.0, True),
        LineScore(0.85, 4.0, True),  # just matched
        LineScore(0.84, 9.0, True),  # predicted and not matched: false, and one missing
        LineScore(0.0, None, False),  # missing only
        LineScore(None, None, True),  # nothing to find, but predicted: false
        LineScore(None, None, False),
    ]
    row = summarize_lines(some)
    assert row["lines"] == 4
    assert row["accuracy"] == pytest.approx((1 + 0.85 + 0.84) / 4)
    assert (row["matched"], row["fp"], row["fn"]) == (0.5, 0.5, 0.5)
    assert row["error_px"] == 4


class TestFiles:
    def write(self, folder: Path, *entries: dict, name: str = "labels.jsonl") -> Path:
        (folder / name).write_text("\n".join(json.dumps(entry) for entry in entries) + "\n\n")
        return folder / name

    def entry(self, *lanes: np.ndarray, name: str = "a.png") -> dict:
        return {"raw_file": name, "h_samples": ROWS.tolist(), "lanes": [one.tolist() for one in lanes]}

    def test_of_many_lines_those_next_to_the_bottom_centre_are_the_ego_lane(self, tmp_path):
        write_image(tmp_path / "a.png", np.zeros((720, 1280, 3), np.uint8))
        # In row 400 the second lane is nearest to the centre on the left; at the bottom it has gone far left.
        lanes = [upright(200), slanted(-2) + 530, upright(500), upright(800), slanted(3) + 600]
        (label,) = read_labels(self.write(tmp_path, self.entry(*lanes)))
        assert label.columns[:, 0].tolist() == [500, 800]
        (label,) = read_labels(self.write(tmp_path, self.entry(upright(700), upright(-2), upright(900))))
        assert label.columns[:, 0].tolist() == [-2, 700]

    def test_two_lines_and_predictions_are_left_and_right_and_need_no_picture(self, tmp_path):
        two, none = read_labels(self.write(tmp_path, self.entry(upright(-2), upright(900)), self.entry(name="b.png")))
        assert two.columns[:, 0].tolist() == [-2, 900] and (none.columns == -2).all()
        (found,) = read_predictions(self.write(tmp_path, self.entry(upright(1), upright(2), upright(3))))
        assert found.columns[:, 0].tolist() == [1, 2]

    def test_all_lines_are_scored_if_more_than_two_are_labelled(self, tmp_path):
        three = [upright(200), upright(500), upright(800)]
        labels = self.write(tmp_path, self.entry(*three), self.entry(upright(7), upright(9), name="b.png"))
        found = self.write(tmp_path, self.entry(*three[:2]), name="found.jsonl")
        assert [len(label.columns) for label in read_all_lines(labels)] == [3, 2]
        assert describe_all_lines(labels, found).endswith("accuracy 0.333, FP 0.000, FN 0.667")
        labels = self.write(tmp_path, self.entry(*three[:2]))
        assert describe_all_lines(labels, found) is None

    def test_pictures_are_paired_by_the_end_of_their_path(self):
        labels = [lane(upright(k), name=f"clips/{k}/20.jpg") for k in (1, 2)]
        found = [lane(upright(k + 10), name=f"/data/clips/{k}/20.jpg") for k in (2, 3)]
        assert pair_predictions(labels, found) == [(labels[0], None), (labels[1], found[0])]

    def test_paths_may_be_those_of_windows(self, tmp_path):
        # the pictures are opened to choose two of three lines
        lanes = [upright(column) for column in (200, 500, 800)]
        for k in (1, 2):
            write_image(tmp_path / "clips" / f"{k}" / "20.png", np.zeros((720, 1280, 3), np.uint8))
        entries = [self.entry(*lanes, name=f"clips\\{k}\\20.png") for k in (1, 2)]
        labels = read_labels(self.write(tmp_path, *entries))
        assert [label.columns[:, 0].tolist() for label in labels] == [[500, 800]] * 2
        for pattern in ("/data/clips/{}/20.png", "D:\\clips\\{}\\20.png"):
            entries = [self.entry(upright(k), name=pattern.format(k)) for k in (2, 1)]
            found = read_predictions(self.write(tmp_path, *entries, name="found.jsonl"))
            assert [prediction.columns[0, 0] for _, prediction in pair_predictions(labels, found)] == [1, 2]

    def test_labels_that_cannot_be_paired_are_refused(self):
        with pytest.raises(ValueError, match="two labels are for the same picture"):
            pair_predictions([lane(upright()), lane(upright())], [])
        with pytest.raises(ValueError, match="none of the predictions is for a labelled picture"):
            pair_predictions([lane(upright())], [lane(upright(), name="b.jpg")])

    @pytest.mark.parametrize(
        "text",
        [
            "nonsense",
            "[1]",
            "[" * 100_000,
            '{"raw_file": "a.png"}',
            '{"raw_file": 3, "h_samples": [], "lanes": []}',
            '{"raw_file": "", "h_samples": [], "lanes": []}',
            '{"raw_file": "a.png", "h_samples": [1, 2], "lanes": [[1]]}',
            '{"raw_file": "a.png", "h_samples": [1, 2], "lanes": [[1, NaN]]}',
            '{"raw_file": "a.png", "h_samples": [1, 1e99], "lanes": []}',
            '{"raw_file": "a.png", "h_samples": [1], "lanes": {"0": [1]}}',
            '{"raw_file": "a.png", "h_samples": [-3], "lanes": []}',
        ],
    )
    def test_other_files_are_refused_with_the_line(self, tmp_path, text):
        path = self.write(tmp_path, self.entry(upright()))
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
