"""Scores of lines made by hand, lateral errors on a known road, and the command `python -m lanes score`."""

from __future__ import annotations

import json
import re
from pathlib import Path
from unicodedata import normalize

import numpy as np
import pytest

from lanes.camera import Camera, CameraPose, save_camera
from lanes.images import write_image
from lanes.labels import EGO_SIDES, LaneColumns, read_labels, read_predictions
from lanes.score import DISTANCES, PictureScore, reliability, score_picture, score_tables, summarize
from tests.support.command_line import main

ROWS = np.arange(400.0, 600, 10)
NOTHING = np.full(len(ROWS), -2.0)
SIZES = {1280: (1280, 720), 640: (640, 360)}
CAMERA = Camera.from_fov((1280, 720), 60, CameraPose(1.3, pitch_rad=0.02, yaw_rad=-0.03, roll_rad=0.01))


def lines(*columns: np.ndarray, name: str = "a.jpg", confidence: float | None = None, rows=ROWS) -> LaneColumns:
    return LaneColumns(name, rows, np.array(columns).reshape(-1, len(rows)), confidence=confidence)


def lane(left: np.ndarray, right: np.ndarray = NOTHING, *, rows: np.ndarray = ROWS) -> LaneColumns:
    return LaneColumns("a.jpg", rows, np.array([left, right]), EGO_SIDES)


def upright(column: float = 300.0) -> np.ndarray:
    return np.full(len(ROWS), column)


def slanted(slope: float) -> np.ndarray:
    """A line that goes `slope` columns right for each row down."""
    return 500 + slope * (ROWS - ROWS[0])


def accuracies(label: LaneColumns, found: LaneColumns | None, width_px: int = 1280) -> list[float]:
    return score_picture(label, found, SIZES[width_px]).values["ego accuracy"].tolist()


class TestEgoLane:
    @pytest.mark.parametrize(
        ("off_px", "accuracy", "width_px"),
        [(0, 1, 1280), (19.99, 1, 1280), (20, 0, 1280), (-19.99, 1, 1280), (-20.01, 0, 1280)]
        + [(9.99, 1, 640), (10.01, 0, 640)],
    )
    def test_an_upright_line_may_be_off_by_less_than_20_px_of_1280(self, off_px, accuracy, width_px):
        left, right = accuracies(lane(upright()), lane(upright() + off_px), width_px)
        assert left == accuracy and np.isnan(right)

    @pytest.mark.parametrize(("slope", "tolerance"), [(0.75, 25), (-0.75, 25), (2.4, 52)])
    def test_a_slanted_one_by_20_px_over_the_cosine_of_its_angle(self, slope, tolerance):
        # 0.75 columns a row: 3-4-5, cosine 0.8; 2.4: 5-12-13, cosine 5/13
        for off_px, accuracy in ((tolerance - 0.01, 1), (tolerance + 0.01, 0)):
            assert accuracies(lane(slanted(slope)), lane(slanted(slope) + off_px))[0] == accuracy

    def test_points_that_are_missing_are_wrong_and_rows_without_label_do_not_count(self):
        found, label = upright() + 3, upright()
        found[:5] = -2
        assert accuracies(lane(upright()), lane(found))[0] == 0.75
        assert accuracies(lane(upright()), None)[0] == 0
        label[:16] = -2
        assert accuracies(lane(label), lane(upright()))[0] == 1
        label[16] = -2  # three points are too few for an angle
        score = score_picture(lane(label), lane(upright()))
        assert np.isnan(score.values["ego accuracy"]).all() and score.right is None

    def test_predictions_may_be_at_other_rows(self):
        """Between two points they lie on the straight line; nothing is beyond the ends, or in a gap."""
        other = lane(slanted(2)[::-2], slanted(-2)[::-2], rows=ROWS[::-2])
        assert accuracies(lane(slanted(2), slanted(-2)), other) == [0.95, 0.95]  # the first row is beyond
        found = slanted(0.5)
        assert accuracies(lane(found), lane(found + 2.5, rows=ROWS + 5))[0] == 0.95
        found = np.where((ROWS > 440) & (ROWS < 480), -2, found + 2.5)
        assert accuracies(lane(slanted(0.5)), lane(found, rows=ROWS + 5))[0] == 0.75
        assert accuracies(lane(slanted(0.5)), lane(slanted(0.5), rows=ROWS + 1e-7))[0] == 1

    def test_left_is_compared_with_left_and_unordered_lines_are_ordered(self):
        label, swapped = lane(upright(200), upright(900)), lane(upright(900), upright(200))
        assert accuracies(label, swapped) == [0, 0]
        assert accuracies(label, lines(upright(900), upright(200))) == [1, 1]
        found = lines(upright(1200), upright(900), upright(200), upright(30))
        assert accuracies(label, found) == [1, 1]

    def test_a_picture_is_right_if_all_its_lines_are_matched(self):
        label, most = lane(upright(), upright(900)), upright(900)
        most[:3] = -2  # 17 of 20
        assert score_picture(label, lane(upright(), most)).right is True
        most[3] = -2
        assert score_picture(label, lane(upright(), most)).right is False
        assert score_picture(lane(upright()), lane(upright(), most)).right is True

    def test_where_no_lane_is_labelled_none_must_be_predicted_or_only_an_unlikely_one(self):
        for label in (lines(), lines(NOTHING, NOTHING)):
            cases = {None: True, 0.49: True, 0.5: False, 0.9: False}
            for confidence, right in cases.items():
                found = lines(upright(), upright(900), confidence=confidence)
                assert score_picture(label, found).right is (right if confidence else False)
            assert score_picture(label, None).right and score_picture(label, lines(NOTHING, confidence=0.9)).right
            assert np.isnan(score_picture(label, None).values["ego accuracy"]).all()


class TestOfficialScore:
    """(accuracy, FP, FN) as TuSimple's `lane.py` computes them."""

    @staticmethod
    def score(labelled: list, predicted: list, width_px: int = 1280) -> tuple[float, ...]:
        values = score_picture(lines(*labelled), lines(*predicted), SIZES[width_px]).values
        return tuple(float(values[name][0]) for name in ("TuSimple", "FP", "FN"))

    def test_the_tolerance_grows_with_the_angle_and_the_width(self):
        line = slanted(0.75)
        assert self.score([line], [line + 24.9])[0] == 1 and self.score([line], [line + 25.1])[0] == 0
        assert self.score([line], [line + 24.9], width_px=640)[0] == 0

    def test_the_mean_over_a_set_is_that_of_their_program(self, tmp_path, capsys):
        """Random pictures, also with more lines than counted, without lines, and with slow predictions."""
        rng, rows, entries = np.random.default_rng(4), list(range(240, 720, 10)), {"labels": [], "found": []}
        for number in range(60):
            lanes = [random_line(rng, rows) for _ in range(rng.integers(0, 6))]
            # near the label, also two near one another, which may make FP negative
            found = [vary(rng, line) for line in lanes for _ in range(rng.integers(0, 3))][: rng.integers(0, 8)]
            if number % 7 == 0 and lanes:
                lanes.append([column + 3 if column >= 0 else -2 for column in lanes[0]])
                found = [lanes[0]]
            entries["labels"].append({"raw_file": f"{number}.jpg", "lanes": lanes, "h_samples": rows})
            run_time = float(rng.choice([10, 200, 200.1]))
            entries["found"].append({"raw_file": f"{number}.jpg", "lanes": found, "run_time": run_time})
        for name, lines in entries.items():
            (tmp_path / f"{name}.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
        labels = read_labels(tmp_path / "labels.jsonl")
        pairs = zip(labels, read_predictions(tmp_path / "found.jsonl", labels), strict=True)
        row = summarize([score_picture(*pair) for pair in pairs])
        wanted = np.mean([tusimple_bench(*pair) for pair in zip(entries["labels"], entries["found"], strict=True)], 0)
        assert [row[name] for name in ("TuSimple", "FP", "FN")] == pytest.approx(wanted, abs=1e-9)
        assert min(tusimple_bench(*pair)[1] for pair in zip(entries["labels"], entries["found"], strict=True)) < 0
        assert score(tmp_path, "-o", tmp_path / "page.html") == 0
        said = capsys.readouterr().out
        assert rows_of(said, "scores")["all"][2:5] == [f"{number:.3f}" for number in wanted]
        late = sum(entry["run_time"] > 200 for entry in entries["found"])
        assert f"note: {late} of 60 predictions took more than 200 ms, which TuSimple's score counts as not fou" in said


def random_line(rng: np.random.Generator, rows: list[int]) -> list[float]:
    first = rng.integers(0, 20)
    columns = rng.uniform(100, 1100) + rng.uniform(-2, 2) * (np.array(rows) - 480)
    return [-2 if k < first or not 0 <= x < 1280 else round(float(x)) for k, x in enumerate(columns)]


def vary(rng: np.random.Generator, line: list[float]) -> list[float]:
    off = rng.choice([0, 8, 25]) + rng.normal(0, 6, len(line))
    return [-2 if column < 0 else round(float(column + error)) for column, error in zip(line, off, strict=True)]


def tusimple_bench(label: dict, prediction: dict) -> tuple[float, float, float]:
    """Accuracy, FP and FN of a picture by the rules of lane.py in TuSimple's benchmark, one number after the other."""
    rows, true, found = label["h_samples"], label["lanes"], prediction["lanes"]
    if prediction["run_time"] > 200 or len(true) + 2 < len(found):
        return 0.0, 0.0, 1.0
    accuracies = []
    for line in true:
        points = [(row, column) for row, column in zip(rows, line, strict=True) if column >= 0]
        slope = 0.0
        if len(points) > 1:
            y, x = np.array(points, float).T
            slope = ((y - y.mean()) * (x - x.mean())).sum() / ((y - y.mean()) ** 2).sum()
        most = 20 / np.cos(np.arctan(slope))
        shares = [0.0]
        for other in found:
            ends = [[column if column >= 0 else -100 for column in some] for some in (line, other)]
            shares.append(sum(abs(a - b) < most for a, b in zip(*ends, strict=True)) / len(rows))
        accuracies.append(max(shares))
    matched = sum(accuracy >= 0.85 for accuracy in accuracies)
    missed, total = len(true) - matched, sum(accuracies)
    if len(true) > 4:
        missed, total = missed - (missed > 0), total - min(accuracies)
    count = max(min(4, len(true)), 1)
    return total / count, (len(found) - matched) / len(found) if found else 0.0, missed / count


def road_lines(*lateral_m: float, x_m: tuple[float, float] = (4, 60), curvature_per_m: float = 2e-3) -> LaneColumns:
    """Lines of a bend at these lateral positions, seen by CAMERA in every tenth row."""
    rows, x = np.arange(360.0, 720, 10), np.geomspace(*x_m, 400)
    columns = []
    for y in lateral_m:
        u, v = CAMERA.road_to_pixels(np.column_stack([x, y + curvature_per_m * x**2 / 2])).T
        columns.append(np.interp(rows, v[::-1], u[::-1], left=-2, right=-2))
    return lines(*columns, rows=rows)


class TestLateralErrors:
    @staticmethod
    def errors(label: LaneColumns, found: LaneColumns) -> np.ndarray:
        values = score_picture(label, found, CAMERA.size, CAMERA).values
        return np.array([values[name] for name in DISTANCES]).T

    def test_are_those_on_the_road_positive_left_at_each_distance(self):
        found = self.errors(road_lines(1.8, -1.8), road_lines(-1.5, 1.7))
        assert found == pytest.approx(np.repeat([[-0.1], [0.3]], 5, axis=1), abs=0.01)

    def test_of_a_bend_that_is_taken_for_a_straight_road(self):
        found = self.errors(road_lines(1.8, -1.8), road_lines(1.8, -1.8, curvature_per_m=0))
        x = np.array([float(name.removesuffix(" m")) for name in DISTANCES])
        # lines are straight between points, 10 rows apart
        assert found == pytest.approx(np.array([-1e-3 * x**2] * 2), abs=0.03)

    def test_are_unknown_beyond_the_ends_of_a_line_and_without_one(self):
        found = self.errors(road_lines(1.8, -1.8, x_m=(12, 60)), road_lines(1.8, -1.8, x_m=(4, 25)))
        assert np.isfinite(found).tolist() == [[False, False, True, True, False]] * 2
        assert np.isnan(self.errors(road_lines(1.8, -1.8), lines())).all()
        assert np.isnan(self.errors(road_lines(1.8, -1.8), road_lines(1.8))[1]).all()

    def test_median_and_95th_percentile_are_those_of_both_lines(self):
        scores = [
            score_picture(road_lines(1.8, -1.8), road_lines(1.8 + e, -1.8 - e), CAMERA.size, CAMERA)
            for e in np.linspace(0, 0.38, 20)
        ]
        row = summarize(scores, DISTANCES)
        assert row["15 m"] == pytest.approx(0.19, abs=0.01) and row["15 m, 95 %"] == pytest.approx(0.361, abs=0.01)
        assert row["stills"] == 20


def test_summary_is_over_lines_and_over_pictures():
    half = upright()
    half[:10] = -2
    scores = [
        score_picture(lane(upright(), upright(900)), lane(upright(), upright(900))),
        score_picture(lane(upright()), lane(half)),
        score_picture(lines(), lines(upright(), confidence=0.9)),
    ]
    row = summarize(scores)
    assert (row["stills"], row["right"]) == (3, pytest.approx(1 / 3))
    assert row["ego accuracy"] == pytest.approx(2.5 / 3) and row["ego matched"] == pytest.approx(2 / 3)
    # of the empty right line of the second picture all rows are correct; no line is labelled in the third
    assert (row["TuSimple"], row["FN"]) == (pytest.approx((1 + 0.75 + 0) / 3), pytest.approx(0.5 / 3))


def stated(confidence: float | None, right: bool, *, labelled: bool = True) -> PictureScore:
    label = lines(upright(), upright(900)) if labelled else lines()
    return score_picture(label, lines(upright(300 if right else 500), upright(900), confidence=confidence))


def test_confidence_is_compared_with_the_share_of_right_lanes():
    pairs = [(0.95, True), (0.9, True), (0.99, False), (0.7, True), (0.5, False), (0.2, True), (None, True)]
    scores = [stated(*pair) for pair in pairs]
    # an unlikely lane where none is labelled is no fault, but it is no right lane either
    scores += [stated(0.3, True, labelled=False), score_picture(lines(upright(), upright(900)), lines(confidence=0.0))]
    table = reliability(scores)
    assert {name: (row["lanes"], row["right"]) for name, row in table.items()} == {
        "0.9 or more": (3, 2),
        "0.5 to 0.9": (2, 1),
        "below 0.5": (2, 1),
    }
    assert [row["of right lanes"] for row in table.values()] == [0.5, 0.25, 0.25]
    assert table["0.5 to 0.9"]["mean stated"] == pytest.approx(0.6)


def test_worst_stills_come_first():
    three = upright()
    three[:5] = -2
    cases = {
        "right": (lane(upright()), lane(upright())),
        "some points": (lane(upright()), lane(three)),
        "none": (lane(upright()), None),
        "a lane where none is": (lines(), lines(upright())),
        "rightly none": (lines(), None),
        "too short to compare": (lane(np.where(ROWS < 430, 300.0, -2)), lane(upright())),
    }
    labels = {name: LaneColumns(name, label.rows, label.columns, label.sides) for name, (label, _) in cases.items()}
    scores = [score_picture(labels[name], found) for name, (_, found) in cases.items()]
    worst = list(score_tables(scores)["worst stills"])
    assert set(worst[:2]) == {"none", "a lane where none is"} and worst[2] == "some points"
    assert set(worst[3:5]) == {"right", "rightly none"} and worst[5] == "too short to compare"


HOSTILE = "b/<img src=x onerror=alert(1)>{{data}}.jpg"


@pytest.fixture
def folder(tmp_path) -> Path:
    """Labels of three pictures in two folders, of which one is not there, and predictions for two of them."""
    good = road_lines(1.8, -1.8)
    labels = [
        {"raw_file": name, "h_samples": good.rows.tolist(), "lanes": columns}
        for name, columns in (("a/1.jpg", good.columns.tolist()), (HOSTILE, good.columns.tolist()), ("a/2.jpg", []))
    ]
    found = [
        labels[0] | {"lanes": road_lines(5.0, -1.7, 1.9).columns.tolist(), "confidence": 0.9},
        labels[2] | {"lanes": good.columns.tolist(), "confidence": 0.8},
    ]
    for name, entries in (("labels", labels), ("found", found)):
        (tmp_path / f"{name}.jsonl").write_text("".join(json.dumps(entry) + "\n" for entry in entries))
    for name in ("a/1.jpg", HOSTILE):
        write_image(tmp_path / name, np.full((720, 1280, 3), 90, np.uint8))
    save_camera(CAMERA, tmp_path / "camera.yaml")
    return tmp_path


def score(folder: Path, *options: object) -> int:
    return main(["score", *(str(folder / f"{name}.jsonl") for name in ("labels", "found")), *map(str, options)])


def rows_of(text: str, title: str) -> dict[str, list[str]]:
    """The rows of a printed table, by their names; all names of this test's pictures and folders have no space."""
    table = text.partition(f"{title}:\n")[2].partition("\n\n")[0]
    return {line.split()[0]: line.split()[1:] for line in table.splitlines()[1:]}


def page_data(page: Path) -> dict:
    (text,) = re.findall(r'<script type="application/json" id="data">(.*)</script>', page.read_text())
    return json.loads(text)


def test_command_prints_tables_and_writes_a_page(folder, capsys):
    page = folder / "out" / "page.html"
    assert score(folder, "--camera", folder / "camera.yaml", "-o", page) == 0
    said = capsys.readouterr().out
    assert rows_of(said, "scores") == {
        "all": ["3", "0.333", "0.333", "0.444", "0.333", "0.500", "0.500"],
        "a": ["2", "0.500", "0.500", "0.667", "0.000", "1.000", "1.000"],
        "b": ["1", "0.000", "0.000", "0.000", "1.000", "0.000", "0.000"],
    }
    errors_m = np.array(rows_of(said, "lateral errors, metres")["all"][1:], float)
    assert errors_m == pytest.approx(0.1, abs=0.01)
    assert "note: 1 of 3 stills have no prediction" in said and "note: 1 of 3 pictures are missing" in said
    assert "a/2.jpg" in said and str(page) in said
    data = page_data(page)
    assert [still["name"] for still in data["stills"]] == [HOSTILE, "a/2.jpg", "a/1.jpg"]
    assert [bool(still["jpeg"]) for still in data["stills"]] == [True, False, True]
    assert data["tables"]["scores"][1]["b"][:2] == ["1", "0.000"]
    assert "<img src=x" not in page.read_text() and "{{" not in page.read_text().replace("{{data}}", "")


def test_command_without_a_camera_has_no_errors_in_metres(folder, capsys, monkeypatch):
    monkeypatch.chdir(folder)
    assert score(folder) == 0
    said = capsys.readouterr().out
    assert "lateral" not in said and "wrote score.html" in said
    assert (folder / "score.html").is_file()


@pytest.mark.parametrize(
    ("camera", "words"),
    [
        (Camera.from_fov((1280, 720), 60), "camera.yaml: holds no camera pose"),
        (CAMERA.scaled((640, 360)), "1.jpg"),
    ],
)
def test_cameras_that_do_not_fit_are_refused(folder, camera, words, capsys):
    save_camera(camera, folder / "camera.yaml")
    assert score(folder, "--camera", folder / "camera.yaml", "-o", folder / "page.html") == 2
    assert words in capsys.readouterr().err and not (folder / "page.html").exists()


@pytest.mark.parametrize("name", ["labels.jsonl", "found.jsonl", "a/1.jpg"])
def test_inputs_are_not_overwritten(folder, name, capsys):
    before = (folder / name).read_bytes()
    assert score(folder, "-o", folder / name) == 2
    assert (folder / name).read_bytes() == before and "would be overwritten" in capsys.readouterr().err


def test_a_damaged_picture_is_named(folder, capsys):
    (folder / "a" / "2.jpg").write_bytes((folder / "a" / "1.jpg").read_bytes()[:300])
    assert score(folder, "-o", folder / "page.html") == 2
    assert "a/2.jpg: cannot be decoded" in capsys.readouterr().err and not (folder / "page.html").exists()


@pytest.mark.parametrize(("labelled", "predicted"), [("NFC", "NFD"), ("NFD", "NFC"), ("NFD", "NFD")])
@pytest.mark.parametrize("on_disk", ["NFC", "NFD"])
def test_names_are_the_same_in_all_forms_of_unicode(tmp_path, capsys, labelled, predicted, on_disk):
    """macOS decomposes accents and Hangul."""
    good, name = road_lines(1.8, -1.8), "Fahrt nach Köln/서울 é.png"
    write_image(tmp_path / normalize(on_disk, name), np.full((720, 1280, 3), 90, np.uint8))
    entry = {"h_samples": good.rows.tolist(), "lanes": good.columns.tolist()}
    for file, form in (("labels", labelled), ("found", predicted)):
        (tmp_path / f"{file}.jsonl").write_text(json.dumps({"raw_file": normalize(form, name)} | entry) + "\n")
    assert score(tmp_path, "-o", tmp_path / "page.html") == 0
    said = capsys.readouterr().out
    assert rows_of(said, "scores")["all"][:3] == ["1", "1.000", "1.000"] and "note:" not in said
    assert page_data(tmp_path / "page.html")["stills"][0]["jpeg"]


def bend_at(rows: np.ndarray) -> list[list[float]]:
    """Columns of both lines of a bend at any rows."""
    y = np.asarray(rows, float) - 360
    return [(600 - 1.2 * y + 0.0005 * y**2).tolist(), (640 + 1.3 * y + 0.0005 * y**2).tolist()]


@pytest.mark.parametrize(
    ("labelled", "predicted", "accuracy", "notes"),
    [
        # the rows of `detect` by default
        (np.arange(420, 706, 15), np.arange(420, 701, 10), "0.950", ["at other rows", "(rows 705)"]),
        (np.arange(420, 701, 15), np.arange(420, 701, 10), "1.000", ["at other rows"]),
        (np.arange(420, 701, 10), np.linspace(420, 700, 29) + 1e-9, "1.000", []),
        (np.arange(420.0, 701, 10), np.arange(420, 701, 10), "1.000", []),
        (np.arange(400, 701, 20), np.arange(700, 419, -10), "0.938", ["(rows 400)"]),
        (np.arange(240, 711, 10), np.arange(420, 701, 10), "0.604", ["(rows 240, 250, 260, "]),
    ],
)
def test_other_rows_are_interpolated_or_named(tmp_path, capsys, labelled, predicted, accuracy, notes):
    for file, rows in (("labels", labelled), ("found", predicted)):
        entry = {"raw_file": "a.png", "h_samples": rows.tolist(), "lanes": bend_at(rows)}
        (tmp_path / f"{file}.jsonl").write_text(json.dumps(entry) + "\n")
    assert score(tmp_path, "-o", tmp_path / "page.html") == 0
    said = capsys.readouterr().out
    assert rows_of(said, "scores")["all"][5] == accuracy
    assert len([line for line in said.splitlines() if "predictions " in line]) == len(notes)
    assert all(note in said for note in notes)
