"""Files of labels, scores of lines made by hand, errors on a known road, and the command `python -m lanes score`."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from unicodedata import normalize

import numpy as np
import pytest

from lanes.camera import Camera, CameraPose, save_camera
from lanes.files import write_json_lines
from lanes.images import write_image
from lanes.labels import EGO_SIDES, LaneColumns, read_labels, read_predictions
from lanes.score import DISTANCES, StillScore, reliability, score_still, summarize
from tests.support.project import names

ROWS = np.arange(400.0, 600, 10)
NOTHING = np.full(len(ROWS), -2.0)
SIZES = {1280: (1280, 720), 640: (640, 360)}
CAMERA = Camera.from_fov(
    (1280, 720), 60, CameraPose(1.3, pitch_rad=0.02, yaw_rad=-0.03, roll_rad=0.01)
)


def lines(
    *columns: np.ndarray,
    name: str = "a.jpg",
    confidence: float | None = None,
    rows=ROWS,
) -> LaneColumns:
    return LaneColumns(
        name, rows, np.array(columns).reshape(-1, len(rows)), confidence=confidence
    )


def lane(
    left: np.ndarray, right: np.ndarray = NOTHING, *, rows: np.ndarray = ROWS
) -> LaneColumns:
    return LaneColumns("a.jpg", rows, np.array([left, right]), EGO_SIDES)


def upright(column: float = 300.0) -> np.ndarray:
    return np.full(len(ROWS), column)


def slanted(slope: float, column: float = 500.0) -> np.ndarray:
    """A line that goes `slope` columns right for each row down."""
    return column + slope * (ROWS - ROWS[0])


def without(rows: slice, column: float = 300.0) -> np.ndarray:
    """An upright line without points in some rows."""
    line = upright(column)
    line[rows] = -2
    return line


def entry(name: str, found: LaneColumns, **more: object) -> dict:
    return {
        "raw_file": name,
        "h_samples": found.rows.tolist(),
        "lanes": found.columns.tolist(),
        **more,
    }


def read_pairs(
    folder: Path, labels: list[dict], found: list[dict]
) -> tuple[list, list]:
    """The labels, and the prediction for each of them, written to files and read."""
    write_json_lines(folder / "labels.jsonl", labels)
    write_json_lines(folder / "found.jsonl", found)
    read = read_labels(folder / "labels.jsonl")
    return read, read_predictions(folder / "found.jsonl", read)


# Files of labels and predictions: their ego lane, which prediction is for which label, and what is refused.

SHAKY = upright(500)
SHAKY[-2:] += -2, 2  # extended from these two, it would end at 552
# Lines, their names, and the columns of the left and the right one in row 400.
EGO_LANES = {
    # In row 400 the second line is nearest to the centre on the left; at the bottom it has gone far left.
    "next to the bottom centre": (
        (200, slanted(-2, 630), 500, 800, slanted(3, 700)),
        (),
        [500, 800],
    ),
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
    columns = [upright(one) if isinstance(one, int) else one for one in given]
    found = replace(lines(*columns), sides=sides).ego_lane((1280, 720))
    assert found.columns[:, 0].tolist() == expected


# Names of the labels, names of the predictions, and which prediction is that of each label.
PAIRS = {
    "by the end of the path": (
        ["a/1/20.jpg", "a/2/20.jpg"],
        ["/data/a/2/20.jpg", "/x/3/20.jpg"],
        [None, 0],
    ),
    "not of other folders": (
        ["day/1.jpg"],
        [f"/data/{name}/1.jpg" for name in ("night", "day", "rain")],
        [1],
    ),
    "of Windows": (
        ["clips\\1\\20.png", "clips\\2\\20.png"],
        ["D:\\clips\\2\\20.png", "D:\\clips\\1\\20.png"],
        [1, 0],
    ),
}


@pytest.mark.parametrize("name", PAIRS)
def test_pictures_are_paired(tmp_path, name):
    labelled, predicted, expected = PAIRS[name]
    labels = [entry(one, lines(upright())) for one in labelled]
    _, found = read_pairs(
        tmp_path,
        labels,
        [entry(one, lines(upright(k))) for k, one in enumerate(predicted)],
    )
    assert [pair and pair.columns[0, 0] for pair in found] == expected


def test_predictions_without_rows_are_at_those_of_their_label(tmp_path):
    labels = [entry("a.png", lines(upright())), entry("b.png", lines(upright()))]
    found = [
        {"raw_file": "a.png", "lanes": [upright(7).tolist()]},
        {"raw_file": "b.png", "lanes": []},
    ]
    found += [{"raw_file": "unknown.png", "lanes": [[9.0] * 5]}]
    _, (one, none) = read_pairs(tmp_path, labels, found)
    assert one.rows.tolist() == ROWS.tolist() and one.columns[0, 0] == 7 and none.empty
    assert none.at(ROWS).shape == (0, len(ROWS))
    found[0]["lanes"] = [[1.0, 2.0]]
    with pytest.raises(
        ValueError, match=r"found.jsonl: line 1 is not a prediction .*shape \(1, 2\)"
    ):
        read_pairs(tmp_path, labels, found)


ONE, OTHER = entry("a.png", lines(upright())), entry("b.png", lines(upright()))
TWICE = "found.jsonl: two labels or two predictions are for the same picture"
NO_LABEL = "labels.jsonl: line 1 is not a label"


@pytest.mark.parametrize(
    ("labels", "found", "words"),
    [
        ([ONE, ONE], [ONE], TWICE),
        ([ONE], [ONE, ONE], TWICE),
        ([ONE], [OTHER], "found.jsonl: has no prediction for any labelled image"),
        ([ONE, ONE | {"raw_file": 3}], [ONE], "labels.jsonl: line 2 is not a label"),
        ([ONE | {"lanes": {"0": [1]}}], [ONE], NO_LABEL),
        ([ONE | {"sides": ["left", "right"]}], [ONE], NO_LABEL),
        (
            [ONE | {"sides": ["left"], "lanes": [upright().tolist()] * 2}],
            [ONE],
            NO_LABEL,
        ),
        ([ONE | {"confidence": 1.5}], [ONE], NO_LABEL),
        (
            [ONE | {"raw_file": "x/../../a.png"}],
            [ONE],
            "labels.jsonl: the picture 'x/../../a.png' lies outside",
        ),
        (
            [ONE | {"raw_file": "..\\a.png"}],
            [ONE],
            "labels.jsonl: the picture '../a.png' lies outside",
        ),
        ([ONE | {"raw_file": "a\0.png"}], [ONE], "labels.jsonl: .*lies outside"),
    ],
)
def test_files_that_cannot_be_paired_or_read_are_refused(
    tmp_path, labels, found, words
):
    """More of them: tests/support/bad_files.py, and any content in tests/properties/test_any_file.py."""
    with pytest.raises(ValueError, match=words):
        read_pairs(tmp_path, labels, found)


# Scores.

# Label, prediction, width of the picture, and the accuracy of the left line; 3-4-5 and 5-12-13 are its triangles.
ACCURACIES = {
    "by less than 20 px": (lane(upright()), lane(upright() + 19.99), 1280, 1),
    "by 20 px": (lane(upright()), lane(upright() + 20), 1280, 0),
    "to the left": (lane(upright()), lane(upright() - 20.01), 1280, 0),
    "in a smaller picture": (lane(upright()), lane(upright() + 10.01), 640, 0),
    "slanted, within 25 px": (
        lane(slanted(0.75)),
        lane(slanted(0.75) + 24.99),
        1280,
        1,
    ),
    "slanted, by 25 px": (lane(slanted(-0.75)), lane(slanted(-0.75) + 25.01), 1280, 0),
    "flat, within 52 px": (lane(slanted(2.4)), lane(slanted(2.4) + 51.99), 1280, 1),
    "by the direction of the label": (
        lane(slanted(0)),
        lane(slanted(0.75)),
        1280,
        0.15,
    ),
    "missing points are wrong": (lane(upright()), lane(without(np.s_[:5])), 1280, 0.75),
    "rows without label do not count": (
        lane(without(np.s_[:16])),
        lane(upright()),
        1280,
        1,
    ),
    "three points are too few": (
        lane(without(np.s_[:17])),
        lane(upright()),
        1280,
        np.nan,
    ),
    "none": (lane(upright()), None, 1280, 0),
    "the first row is beyond": (
        lane(slanted(2)),
        lane(slanted(2)[::-2], NOTHING[::-2], rows=ROWS[::-2]),
        1280,
        0.95,
    ),
    "left and right swapped": (
        lane(upright(200), upright(900)),
        lane(upright(900), upright(200)),
        1280,
        0,
    ),
    "without names they are ordered": (
        lane(upright(200), upright(900)),
        lines(upright(900), upright(200)),
        1280,
        1,
    ),
}


@pytest.mark.parametrize("name", ACCURACIES)
def test_accuracy_of_an_ego_line(name):
    label, found, width_px, accuracy = ACCURACIES[name]
    values = score_still(label, found, SIZES[width_px]).values
    assert values["ego accuracy"][0] == pytest.approx(accuracy, nan_ok=True)


def test_two_points_of_a_label_have_a_direction():
    """The official tolerance of a line of 3-4-5 triangles is 25 px."""
    label, within, beyond = (
        LaneColumns("a.jpg", ROWS[:2], slanted(0.75)[None, :2] + px)
        for px in (0, 24.99, 25.01)
    )
    assert (
        score_still(label, within).values["TuSimple"] == 1
        and score_still(label, beyond).values["TuSimple"] == 0
    )


def test_a_picture_is_right_if_all_its_lines_are_matched_and_none_is_predicted_where_none_is():
    label = lane(upright(), upright(900))
    for missing, right in ((3, True), (4, False)):  # of 20
        assert (
            score_still(label, lane(upright(), without(np.s_[:missing], 900))).right
            is right
        )
    assert score_still(lane(without(np.s_[:17])), lane(upright())).right is None
    for none in (lines(), lines(NOTHING, NOTHING)):
        for confidence, right in {
            None: False,
            0.49: True,
            0.5: False,
            0.9: False,
        }.items():
            assert (
                score_still(
                    none, lines(upright(), upright(900), confidence=confidence)
                ).right
                is right
            )
        assert (
            score_still(none, None).right
            and score_still(none, lines(NOTHING, confidence=0.9)).right
        )


def test_the_mean_over_a_set_is_that_of_their_program(tmp_path, score):
    """Random pictures, also with more lines than counted, without lines, and with slow predictions."""
    rng, rows, entries = (
        np.random.default_rng(4),
        list(range(240, 720, 10)),
        {"labels": [], "found": []},
    )
    for number in range(60):
        lanes = [random_line(rng, rows) for _ in range(rng.integers(0, 6))]
        # near the label, also two near one another, which may make FP negative
        found = [vary(rng, line) for line in lanes for _ in range(rng.integers(0, 3))][
            : rng.integers(0, 8)
        ]
        if number % 7 == 0 and lanes:
            lanes.append([column + 3 if column >= 0 else -2 for column in lanes[0]])
            found = [lanes[0]]
        entries["labels"].append(
            {"raw_file": f"{number}.jpg", "lanes": lanes, "h_samples": rows}
        )
        run_time = float(rng.choice([10, 200, 200.1]))
        entries["found"].append(
            {"raw_file": f"{number}.jpg", "lanes": found, "run_time": run_time}
        )
    row = summarize(
        [
            score_still(*pair)
            for pair in zip(*read_pairs(tmp_path, **entries), strict=True)
        ]
    )
    theirs = np.array(
        [
            tusimple_bench(*pair)
            for pair in zip(entries["labels"], entries["found"], strict=True)
        ]
    )
    wanted = theirs.mean(axis=0)
    assert [row[name] for name in ("TuSimple", "FP", "FN")] == pytest.approx(
        wanted, abs=1e-9
    )
    assert theirs[:, 1].min() < 0
    said = score(tmp_path)
    assert rows_of(said, "scores")["all"][2:5] == [f"{number:.3f}" for number in wanted]
    late = sum(entry["run_time"] > 200 for entry in entries["found"])
    assert (
        f"note: {late} of 60 predictions took more than 200 ms, which TuSimple's score counts as not fou"
        in said
    )
    assert f" and {late - 5} more\n" in said


def random_line(rng: np.random.Generator, rows: list[int]) -> list[float]:
    first = rng.integers(0, 20)
    columns = rng.uniform(100, 1100) + rng.uniform(-2, 2) * (np.array(rows) - 480)
    return [
        -2 if k < first or not 0 <= x < 1280 else round(float(x))
        for k, x in enumerate(columns)
    ]


def vary(rng: np.random.Generator, line: list[float]) -> list[float]:
    off = rng.choice([0, 8, 25]) + rng.normal(0, 6, len(line))
    return [
        -2 if column < 0 else round(float(column + error))
        for column, error in zip(line, off, strict=True)
    ]


def tusimple_bench(label: dict, prediction: dict) -> tuple[float, float, float]:
    """Accuracy, FP and FN of a picture by the rules of lane.py in TuSimple's benchmark, one number after the other."""
    rows, true, found = label["h_samples"], label["lanes"], prediction["lanes"]
    if prediction["run_time"] > 200 or len(true) + 2 < len(found):
        return 0.0, 0.0, 1.0
    accuracies = []
    for line in true:
        points = [
            (row, column) for row, column in zip(rows, line, strict=True) if column >= 0
        ]
        slope = 0.0
        if len(points) > 1:
            y, x = np.array(points, float).T
            slope = ((y - y.mean()) * (x - x.mean())).sum() / (
                (y - y.mean()) ** 2
            ).sum()
        most = 20 / np.cos(np.arctan(slope))
        shares = [0.0]
        for other in found:
            ends = [
                [column if column >= 0 else -100 for column in some]
                for some in (line, other)
            ]
            shares.append(
                sum(abs(a - b) < most for a, b in zip(*ends, strict=True)) / len(rows)
            )
        accuracies.append(max(shares))
    matched = sum(accuracy >= 0.85 for accuracy in accuracies)
    missed, total = len(true) - matched, sum(accuracies)
    if len(true) > 4:
        missed, total = missed - (missed > 0), total - min(accuracies)
    count = max(min(4, len(true)), 1)
    return (
        total / count,
        (len(found) - matched) / len(found) if found else 0.0,
        missed / count,
    )


def road_lines(
    *lateral_m: float, x_m: tuple[float, float] = (4, 60), curvature_per_m: float = 2e-3
) -> LaneColumns:
    """Lines of a bend at these lateral positions, seen by CAMERA in every tenth row."""
    rows, x = np.arange(360.0, 720, 10), np.geomspace(*x_m, 400)
    columns = []
    for y in lateral_m:
        u, v = CAMERA.road_to_pixels(
            np.column_stack([x, y + curvature_per_m * x**2 / 2])
        ).T
        columns.append(np.interp(rows, v[::-1], u[::-1], left=-2, right=-2))
    return lines(*columns, rows=rows)


@pytest.mark.parametrize(
    ("found", "errors"),
    [
        (road_lines(-1.5, 1.7), [[-0.1] * 5, [0.3] * 5]),
        # lines are straight between points, 10 rows apart
        (
            road_lines(1.8, -1.8, curvature_per_m=0),
            [[-1e-3 * float(name[:-2]) ** 2 for name in DISTANCES]] * 2,
        ),
        (road_lines(1.8), [[0.0] * 5, [np.nan] * 5]),
        (road_lines(1.8, -1.8, x_m=(12, 25)), [[np.nan, np.nan, 0, 0, np.nan]] * 2),
        (lines(), [[np.nan] * 5] * 2),
    ],
    ids=["positive left", "a straight road", "one line", "between the ends", "none"],
)
def test_lateral_errors_at_each_distance(found, errors):
    values = score_still(road_lines(1.8, -1.8), found, CAMERA.size, CAMERA).values
    np.testing.assert_allclose(
        np.array([values[name] for name in DISTANCES]).T, errors, atol=0.03
    )


def test_medians_and_percentiles_are_those_of_the_sizes_of_the_errors():
    pairs = [
        (road_lines(1.8, -1.8), road_lines(*found_m))
        for found_m in ((1.8, -1.8), (1.7, -1.5))
    ]
    row = summarize(
        [score_still(*pair, CAMERA.size, CAMERA) for pair in pairs], DISTANCES
    )
    assert (row["15 m"], row["15 m, 95 %"]) == pytest.approx((0.05, 0.27), abs=0.01)


def stated(
    confidence: float | None, right: bool, *, labelled: bool = True
) -> StillScore:
    label = lines(upright(), upright(900)) if labelled else lines()
    return score_still(
        label,
        lines(upright(300 if right else 500), upright(900), confidence=confidence),
    )


def test_confidence_is_compared_with_the_share_of_right_lanes():
    pairs = [
        (0.95, True),
        (0.9, True),
        (0.99, False),
        (0.7, True),
        (0.5, False),
        (0.2, True),
        (None, True),
    ]
    scores = [stated(*pair) for pair in pairs]
    # an unlikely lane where none is labelled is no fault, but it is no right lane either
    scores += [
        stated(0.3, True, labelled=False),
        score_still(lines(upright(), upright(900)), lines(confidence=0.0)),
    ]
    table = reliability(scores)
    assert {name: (row["lanes"], row["right"]) for name, row in table.items()} == {
        "0.9 or more": (3, 2),
        "0.5 to 0.9": (2, 1),
        "below 0.5": (2, 1),
    }
    assert [row["of right lanes"] for row in table.values()] == [0.5, 0.25, 0.25]
    assert table["0.5 to 0.9"]["mean stated"] == pytest.approx(0.6)


HOSTILE = "b/c/<img src=x onerror=alert(1)>{{data}}.jpg"


@pytest.fixture
def folder(tmp_path) -> Path:
    """Labels of three pictures in two folders, of which one is not there, and predictions for two of them."""
    good = road_lines(1.8, -1.8)
    labels = [
        entry("a/1.jpg", good),
        entry(HOSTILE, good),
        entry("a/2.jpg", lines(rows=good.rows)),
    ]
    found = [
        entry("a/1.jpg", road_lines(5.0, -1.7, 1.9), confidence=0.9),
        entry("a/2.jpg", good, confidence=0.8),
    ]
    read_pairs(tmp_path, labels, found)
    for name in ("a/1.jpg", HOSTILE):
        write_image(tmp_path / name, np.full((720, 1280, 3), 90, np.uint8))
    save_camera(CAMERA, tmp_path / "camera.yaml")
    return tmp_path


@pytest.fixture
def score(run):
    """A function that scores a folder into its page.html; returns what the command prints, on stderr if it refuses."""

    def score(
        folder: Path, *options: object, output: str = "page.html", status: int = 0
    ) -> str:
        labels, predictions = folder / "labels.jsonl", folder / "found.jsonl"
        ended, out, err = run(
            "score", labels, predictions, *options, "-o", folder / output
        )
        assert ended == status
        return err if status else out

    return score


def rows_of(text: str, title: str) -> dict[str, list[str]]:
    """The rows of a printed table, by their names; all names of this test's pictures and folders have no space."""
    table = text.partition(f"{title}:\n")[2].partition("\n\n")[0]
    return {line.split()[0]: line.split()[1:] for line in table.splitlines()[1:]}


def page_data(page: Path) -> dict:
    (text,) = re.findall(
        r'<script type="application/json" id="data">(.*)</script>', page.read_text()
    )
    return json.loads(text)


def test_command_prints_tables_and_writes_a_page(folder, score):
    page = folder / "out" / "page.html"
    said = score(folder, "--camera", folder / "camera.yaml", output="out/page.html")
    assert rows_of(said, "scores") == {
        "all": ["3", "0.333", "0.333", "0.444", "0.333", "0.500", "0.500"],
        "a": ["2", "0.500", "0.500", "0.667", "0.000", "1.000", "1.000"],
        "b": ["1", "0.000", "0.000", "0.000", "1.000", "0.000", "0.000"],
    }
    errors_m = np.array(rows_of(said, "lateral errors, metres")["all"][1:], float)
    assert errors_m == pytest.approx(0.1, abs=0.01)
    assert (
        "note: 1 of 3 stills have no prediction" in said
        and "note: 1 of 3 pictures are missing" in said
    )
    assert "a/2.jpg" in said and str(page) in said
    data = page_data(page)
    assert [still["name"] for still in data["stills"]] == [
        HOSTILE,
        "a/2.jpg",
        "a/1.jpg",
    ]
    assert [bool(still["jpeg"]) for still in data["stills"]] == [True, False, True]
    assert data["tables"]["scores"][1]["b"][:2] == ["1", "0.000"]
    assert (
        "<img src=x" not in page.read_text()
        and "{{" not in page.read_text().replace("{{data}}", "")
    )


@pytest.mark.parametrize(
    ("camera", "output", "words"),
    [
        (
            Camera.from_fov((1280, 720), 60),
            "page.html",
            "camera.yaml: holds no camera pose",
        ),
        (CAMERA.scaled((640, 360)), "page.html", "1.jpg"),
        (CAMERA, "a/1.jpg", "would be overwritten"),
        (CAMERA, "page.html", "a/2.jpg: cannot be decoded"),
    ],
)
def test_what_does_not_fit_is_refused_and_nothing_is_written(
    folder, camera, output, words, score
):
    save_camera(camera, folder / "camera.yaml")
    if "decoded" in words:
        (folder / "a" / "2.jpg").write_bytes(
            (folder / "a" / "1.jpg").read_bytes()[:300]
        )
    before = names(folder), (folder / "a" / "1.jpg").read_bytes()
    assert words in score(
        folder, "--camera", folder / "camera.yaml", output=output, status=2
    )
    assert (names(folder), (folder / "a" / "1.jpg").read_bytes()) == before


@pytest.mark.parametrize(
    ("labelled", "predicted", "on_disk"),
    [("NFC", "NFD", "NFD"), ("NFD", "NFC", "NFD"), ("NFD", "NFD", "NFC")],
)
def test_names_are_the_same_in_all_forms_of_unicode(
    tmp_path, score, labelled, predicted, on_disk
):
    """macOS decomposes accents and Hangul."""
    good, name = road_lines(1.8, -1.8), "Fahrt nach Köln/서울 é.png"
    write_image(
        tmp_path / normalize(on_disk, name), np.full((720, 1280, 3), 90, np.uint8)
    )
    read_pairs(
        tmp_path,
        *([entry(normalize(form, name), good)] for form in (labelled, predicted)),
    )
    said = score(tmp_path)
    assert (
        rows_of(said, "scores")["all"][:3] == ["1", "1.000", "1.000"]
        and "note:" not in said
    )
    assert page_data(tmp_path / "page.html")["stills"][0]["jpeg"]


def bend_at(rows: np.ndarray) -> dict:
    """Both lines of a bend at any rows."""
    y = np.asarray(rows, float) - 360
    return entry(
        "a.png",
        lines(600 - 1.2 * y + 0.0005 * y**2, 640 + 1.3 * y + 0.0005 * y**2, rows=rows),
    )


@pytest.mark.parametrize(
    ("labelled", "predicted", "accuracy", "notes"),
    [
        # the rows of `detect` by default
        (
            np.arange(420, 706, 15),
            np.arange(420, 701, 10),
            "0.950",
            ["at other rows", "(rows 705)"],
        ),
        (np.arange(420, 701, 10), np.linspace(420, 700, 29) + 1e-9, "1.000", []),
        (np.arange(400, 701, 20), np.arange(700, 419, -10), "0.938", ["(rows 400)"]),
        (
            np.arange(240, 711, 10),
            np.arange(420, 701, 10),
            "0.604",
            ["(rows 240, 250, 260, "],
        ),
    ],
)
def test_other_rows_are_interpolated_or_named(
    tmp_path, score, labelled, predicted, accuracy, notes
):
    read_pairs(tmp_path, [bend_at(labelled)], [bend_at(predicted)])
    said = score(tmp_path)
    assert rows_of(said, "scores")["all"][5] == accuracy
    assert len([line for line in said.splitlines() if "predictions " in line]) == len(
        notes
    )
    assert all(note in said for note in notes)
    score(
        tmp_path,
        "--camera",
        save_camera(CAMERA.scaled((1920, 1080)), tmp_path / "camera.yaml"),
    )
    assert page_data(tmp_path / "page.html")["stills"][0]["size"] == [
        1920,
        1080,
    ]  # assumed
