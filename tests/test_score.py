"""Labels and predictions, their scores, and the command `python -m lanes score`."""

from __future__ import annotations

import base64
import re
from dataclasses import dataclass, replace
from html import unescape
from pathlib import Path
from unicodedata import normalize

import cv2
import numpy as np
import pytest

from lanes.camera.model import Camera, CameraPose, save_camera
from lanes.files import write_json_lines
from lanes.labels import EGO_SIDES, LaneColumns, read_labels, read_predictions
from lanes.score import DISTANCES, StillScore, reliability, score_still, summarize
from lanes.video.images import write_image
from tests.support.project import names

ROWS = np.arange(400.0, 600, 10)
NOTHING = np.full(len(ROWS), -2.0)
SIZES = {
    1280: (1280, 720),
    640: (640, 360),
}
POSE = CameraPose(
    height_m=1.3,
    pitch_rad=0.02,
    yaw_rad=-0.03,
    roll_rad=0.01,
)
CAMERA = Camera.from_fov((1280, 720), 60, POSE)


def lines(
    *columns: np.ndarray,
    name: str = "a.jpg",
    confidence: float | None = None,
    rows=ROWS,
) -> LaneColumns:
    of_lines = np.array(columns).reshape(-1, len(rows))
    return LaneColumns(name, rows, of_lines, confidence=confidence)


def lane(
    left: np.ndarray,
    right: np.ndarray = NOTHING,
    *,
    rows: np.ndarray = ROWS,
) -> LaneColumns:
    columns = np.array([left, right])
    return LaneColumns("a.jpg", rows, columns, EGO_SIDES)


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


def gray_image(level: int = 90) -> np.ndarray:
    return np.full((720, 1280, 3), level, np.uint8)


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


# Files of labels and predictions: ego lane, pairs, and what is refused.

# Extended from its last two points, it would end at 552.
SHAKY = upright(500)
SHAKY[-2] -= 2
SHAKY[-1] += 2
# Its upper half points to a foot far left of 540.
BENT = upright(560)
BENT[: len(BENT) // 2] += 10 * np.arange(len(BENT) // 2, 0, -1)
# In row 400 this line is nearest to the centre on the left; at the bottom it has gone
# far left.
TURNING = slanted(-2, 630)
OTHER_TURNING = slanted(3, 700)


@dataclass(frozen=True)
class EgoCase:
    """Lines, by their columns, their names, and the ego lane in row 400."""

    lines: tuple[float | np.ndarray, ...]
    ego: list[float]
    sides: tuple[str, ...] = ()


EGO_LANES = {
    "next to the bottom centre": EgoCase(
        (200, TURNING, 500, 800, OTHER_TURNING),
        ego=[500, 800],
    ),
    "one without points": EgoCase(
        (700, -2, 900),
        ego=[-2, 700],
    ),
    "extended from the lower half": EgoCase(
        (SHAKY, 540, 900),
        ego=[540, 900],
    ),
    "bent above": EgoCase(
        (BENT, 540, 900),
        ego=[BENT[0], 900],
    ),
    "a single one on the left": EgoCase(
        (600,),
        ego=[600, -2],
    ),
    "none": EgoCase(
        (),
        ego=[-2, -2],
    ),
    "two are both, wherever they are": EgoCase(
        (100, 300),
        ego=[100, 300],
    ),
    "in any order": EgoCase(
        (300, 100),
        ego=[100, 300],
    ),
    "without points in its place": EgoCase(
        (-2, 300),
        ego=[-2, 300],
    ),
    "by their names": EgoCase(
        (900, 300, 600),
        ego=[300, 600],
        sides=("far left", "left", "right"),
    ),
    "names before places": EgoCase(
        (900, 300),
        ego=[900, 300],
        sides=EGO_SIDES,
    ),
    "other names": EgoCase(
        (900, 300, 600),
        ego=[-2, 900],
        sides=("right", "far right", "x"),
    ),
}


@pytest.mark.parametrize("name", EGO_LANES)
def test_the_ego_lane_among_lines(name):
    case = EGO_LANES[name]
    columns = []
    for line in case.lines:
        is_upright = isinstance(line, int)
        columns.append(upright(line) if is_upright else line)
    found = replace(lines(*columns), sides=case.sides)

    ego = found.ego_lane((1280, 720))

    assert ego.columns[:, 0].tolist() == case.ego


# Names of the labels, names of the predictions, and the prediction of each label.
PAIRS = {
    "by the end of the path": (
        ["a/1/20.jpg", "a/2/20.jpg"],
        ["/data/a/2/20.jpg", "/x/3/20.jpg"],
        [None, 0],
    ),
    "not of other folders": (
        ["day/1.jpg"],
        ["/data/night/1.jpg", "/data/day/1.jpg", "/data/rain/1.jpg"],
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
    labels = [entry(picture, lines(upright())) for picture in labelled]
    predictions = [
        entry(picture, lines(upright(number)))
        for number, picture in enumerate(predicted)
    ]

    _, found = read_pairs(tmp_path, labels, predictions)

    first_columns = [pair and pair.columns[0, 0] for pair in found]
    assert first_columns == expected


@pytest.mark.parametrize("name", PAIRS)
def test_predictions_without_rows_are_paired_as_those_with_rows(tmp_path, name):
    labelled, predicted, expected = PAIRS[name]
    labels = []
    for number, picture in enumerate(labelled):
        rows = ROWS - number
        labels.append(entry(picture, lines(upright(), rows=rows)))
    predictions = [
        {"raw_file": picture, "lanes": [[number] * len(ROWS)]}
        for number, picture in enumerate(predicted)
    ]

    read, found = read_pairs(tmp_path, labels, predictions)

    first_columns = [pair and pair.columns[0, 0] for pair in found]
    assert first_columns == expected
    for label, pair in zip(read, found, strict=True):
        assert pair is None or pair.rows.tolist() == label.rows.tolist()


ONE = entry("a.png", lines(upright()))
OTHER = entry("b.png", lines(upright()))


def test_predictions_without_rows_are_at_those_of_their_label(tmp_path):
    labels = [ONE, OTHER]
    found = [
        {"raw_file": "a.png", "lanes": [upright(7).tolist()]},
        {"raw_file": "b.png", "lanes": []},
        {"raw_file": "unknown.png", "lanes": [[9.0] * 5]},
    ]

    _, (one, none) = read_pairs(tmp_path, labels, found)

    assert one.rows.tolist() == ROWS.tolist()
    assert one.columns[0, 0] == 7
    assert none.empty
    assert none.at(ROWS).shape == (0, len(ROWS))


def test_a_prediction_that_does_not_fit_the_rows_of_its_label_is_refused(tmp_path):
    labels = [entry("a.png", lines(upright()))]
    found = [{"raw_file": "a.png", "lanes": [[1.0, 2.0]]}]
    words = "found.jsonl: the prediction for a.png has no h_samples and 2 columns a li"
    with pytest.raises(ValueError, match=words):
        read_pairs(tmp_path, labels, found)


TWO_LINES = ONE | {"lanes": [upright().tolist()] * 2}
LABELLED_TWICE = "labels.jsonl: 2 labels are for the same picture, a.png; keep one of"
FOUND_TWICE = "found.jsonl: 2 predictions are for the same picture, a.png; keep one of"
DECOMPOSED = [{**ONE, "raw_file": name} for name in ("\u00e4/a.png", "a\u0308/a.png")]
NO_LABEL = "labels.jsonl: line 1 is not a label"
OUTSIDE = "labels.jsonl: the picture '../a.png' lies outside"


@pytest.mark.parametrize(
    ("labels", "found", "words"),
    [
        ([ONE, ONE], [ONE], LABELLED_TWICE),
        (DECOMPOSED, [ONE], "labels.jsonl: 2 labels are for the same picture, "),
        ([ONE], [ONE, ONE], FOUND_TWICE),
        ([ONE], [ONE, ONE | {"raw_file": "./a.png"}], FOUND_TWICE),
        ([ONE], [OTHER], "found.jsonl: has no prediction for any labelled image"),
        ([ONE, ONE | {"raw_file": 3}], [ONE], "labels.jsonl: line 2 is not a label"),
        ([ONE | {"lanes": {"0": [1]}}], [ONE], NO_LABEL),
        ([ONE | {"sides": ["left", "right"]}], [ONE], NO_LABEL),
        ([TWO_LINES | {"sides": ["left"]}], [ONE], NO_LABEL),
        ([ONE | {"confidence": 1.5}], [ONE], NO_LABEL),
        ([ONE | {"raw_file": "x/../../a.png"}], [ONE], "'x/../../a.png' lies outside"),
        ([ONE | {"raw_file": "..\\a.png"}], [ONE], OUTSIDE),
        ([ONE | {"raw_file": "a\0.png"}], [ONE], "labels.jsonl: .*lies outside"),
    ],
)
def test_files_that_cannot_be_paired_or_read_are_refused(
    tmp_path, labels, found, words
):
    """More: tests/support/bad_files.py, and any content in tests/properties."""
    with pytest.raises(ValueError, match=words):
        read_pairs(tmp_path, labels, found)


# Scores.


@dataclass(frozen=True)
class AccuracyCase:
    """Label, prediction, and the accuracy of the left line."""

    label: LaneColumns
    found: LaneColumns | None
    accuracy: float
    width_px: int = 1280


UPRIGHT = lane(upright())
# 3-4-5 and 5-12-13 are the triangles of the slanted lines.
SLANTED = slanted(0.75)
SLANTED_BACK = slanted(-0.75)
FLAT = slanted(2.4)
STEEP = slanted(2)
EVERY_SECOND = slice(None, None, -2)
EVERY_SECOND_ROW = lane(
    STEEP[EVERY_SECOND],
    NOTHING[EVERY_SECOND],
    rows=ROWS[EVERY_SECOND],
)
BOTH = lane(upright(200), upright(900))
BOTH_SWAPPED = lane(upright(900), upright(200))
ACCURACIES = {
    "by less than 20 px": AccuracyCase(
        UPRIGHT,
        lane(upright() + 19.99),
        1,
    ),
    "by 20 px": AccuracyCase(
        UPRIGHT,
        lane(upright() + 20),
        0,
    ),
    "to the left": AccuracyCase(
        UPRIGHT,
        lane(upright() - 20.01),
        0,
    ),
    "in a smaller picture": AccuracyCase(
        UPRIGHT,
        lane(upright() + 10.01),
        0,
        640,
    ),
    "slanted, within 25 px": AccuracyCase(
        lane(SLANTED),
        lane(SLANTED + 24.99),
        1,
    ),
    "slanted, by 25 px": AccuracyCase(
        lane(SLANTED_BACK),
        lane(SLANTED_BACK + 25.01),
        0,
    ),
    "flat, within 52 px": AccuracyCase(
        lane(FLAT),
        lane(FLAT + 51.99),
        1,
    ),
    "by the direction of the label": AccuracyCase(
        lane(slanted(0)),
        lane(SLANTED),
        0.15,
    ),
    "missing points are wrong": AccuracyCase(
        UPRIGHT,
        lane(without(np.s_[:5])),
        0.75,
    ),
    "rows without label do not count": AccuracyCase(
        lane(without(np.s_[:16])),
        UPRIGHT,
        1,
    ),
    "three points are too few": AccuracyCase(
        lane(without(np.s_[:17])),
        UPRIGHT,
        np.nan,
    ),
    "none": AccuracyCase(
        UPRIGHT,
        None,
        0,
    ),
    "the first row is beyond": AccuracyCase(
        lane(STEEP),
        EVERY_SECOND_ROW,
        0.95,
    ),
    "left and right swapped": AccuracyCase(
        BOTH,
        BOTH_SWAPPED,
        0,
    ),
    "without names they are ordered": AccuracyCase(
        BOTH,
        lines(upright(900), upright(200)),
        1,
    ),
}


@pytest.mark.parametrize("name", ACCURACIES)
def test_accuracy_of_an_ego_line(name):
    case = ACCURACIES[name]
    score = score_still(case.label, case.found, SIZES[case.width_px])
    accuracy = score.values["ego accuracy"][0]
    assert accuracy == pytest.approx(case.accuracy, nan_ok=True)


@pytest.mark.parametrize(
    ("shift_px", "accuracy"),
    [
        (24.99, 1),
        (25.01, 0),
    ],
)
def test_two_points_of_a_label_have_a_direction(shift_px, accuracy):
    """The official tolerance of a line of 3-4-5 triangles is 25 px."""
    columns = slanted(0.75)[None, :2]
    label = LaneColumns("a.jpg", ROWS[:2], columns)
    found = LaneColumns("a.jpg", ROWS[:2], columns + shift_px)
    assert score_still(label, found).values["TuSimple"] == accuracy


@pytest.mark.parametrize(
    ("missing", "right"),
    [
        (3, True),
        (4, False),
    ],
)
def test_a_picture_is_right_if_85_percent_of_each_line_are_correct(missing, right):
    """Of 20 points."""
    label = lane(upright(), upright(900))
    with_gap = without(np.s_[:missing], 900)
    found = lane(upright(), with_gap)
    assert score_still(label, found).right is right


def test_a_picture_with_few_labelled_points_is_not_compared():
    label = lane(without(np.s_[:17]))
    assert score_still(label, UPRIGHT).right is None


NO_LINE = lines()
WITHOUT_POINTS = lines(NOTHING, NOTHING)
SURELY_NOTHING = lines(NOTHING, confidence=0.9)


@pytest.mark.parametrize("none", [NO_LINE, WITHOUT_POINTS])
@pytest.mark.parametrize(
    ("confidence", "right"),
    [
        (None, False),
        (0.49, True),
        (0.5, False),
        (0.9, False),
    ],
)
def test_where_no_lane_is_labelled_an_unlikely_one_is_no_fault(none, confidence, right):
    found = lines(upright(), upright(900), confidence=confidence)
    assert score_still(none, found).right is right


@pytest.mark.parametrize("none", [NO_LINE, WITHOUT_POINTS])
@pytest.mark.parametrize("found", [None, SURELY_NOTHING])
def test_where_no_lane_is_labelled_no_prediction_is_right(none, found):
    assert score_still(none, found).right


def random_set() -> tuple[list[dict], list[dict]]:
    """Labels and predictions of 60 pictures.

    Also with more lines than counted, without lines, and with slow predictions.
    """
    rng = np.random.default_rng(4)
    rows = list(range(240, 720, 10))
    labels, predictions = [], []
    for number in range(60):
        count = rng.integers(0, 6)
        lanes = [random_line(rng, rows) for _ in range(count)]
        # Near the label, also two near one another, which may make FP negative.
        found = []
        for line in lanes:
            copies = rng.integers(0, 3)
            found += [vary(rng, line) for _ in range(copies)]
        found = found[: rng.integers(0, 8)]
        if number % 7 == 0 and lanes:
            columns = np.array(lanes[0])
            beside = np.where(columns >= 0, columns + 3, -2).tolist()
            lanes.append(beside)
            found = [lanes[0]]
        run_time = float(rng.choice([10, 200, 200.1]))
        name = f"{number}.jpg"
        labels.append({"raw_file": name, "lanes": lanes, "h_samples": rows})
        predictions.append({"raw_file": name, "lanes": found, "run_time": run_time})
    return labels, predictions


def random_line(rng: np.random.Generator, rows: list[int]) -> list[float]:
    first = rng.integers(0, 20)
    at_the_middle = rng.uniform(100, 1100)
    slope = rng.uniform(-2, 2)
    columns = at_the_middle + slope * (np.array(rows) - 480)
    line = []
    for number, column in enumerate(columns):
        seen = number >= first and 0 <= column < 1280
        line.append(round(float(column)) if seen else -2)
    return line


def vary(rng: np.random.Generator, line: list[float]) -> list[float]:
    shift_px = rng.choice([0, 8, 25])
    shifts_px = shift_px + rng.normal(0, 6, len(line))
    varied = []
    for column, shift in zip(line, shifts_px, strict=True):
        moved = round(float(column + shift))
        varied.append(-2 if column < 0 else moved)
    return varied


def tusimple_bench(label: dict, prediction: dict) -> tuple[float, float, float]:
    """Accuracy, FP and FN of a picture by the rules of lane.py in TuSimple's benchmark.

    One number after the other.
    """
    rows = label["h_samples"]
    true = label["lanes"]
    found = prediction["lanes"]
    late = prediction["run_time"] > 200
    if late or len(true) + 2 < len(found):
        return 0.0, 0.0, 1.0
    accuracies = [best_accuracy(rows, line, found) for line in true]
    matched = sum(accuracy >= 0.85 for accuracy in accuracies)
    missed = len(true) - matched
    total = sum(accuracies)
    if len(true) > 4:
        missed -= missed > 0
        total -= min(accuracies)
    count = max(min(4, len(true)), 1)
    false_positives = 0.0
    if found:
        false_positives = (len(found) - matched) / len(found)
    return total / count, false_positives, missed / count


def best_accuracy(rows: list[int], line: list[float], found: list) -> float:
    points = [pair for pair in zip(rows, line, strict=True) if pair[1] >= 0]
    slope = 0.0
    if len(points) > 1:
        y, x = np.array(points, float).T
        from_mean = y - y.mean()
        covariance = (from_mean * (x - x.mean())).sum()
        slope = covariance / (from_mean**2).sum()
    most_px = 20 / np.cos(np.arctan(slope))
    best = 0.0
    for other in found:
        correct = 0
        for one, two in zip(line, other, strict=True):
            there = one if one >= 0 else -100
            here = two if two >= 0 else -100
            correct += abs(there - here) < most_px
        best = max(best, correct / len(rows))
    return best


def test_the_mean_over_a_set_is_that_of_their_program(tmp_path, score):
    labels, predictions = random_set()
    theirs = np.array(list(map(tusimple_bench, labels, predictions)))
    wanted = theirs.mean(axis=0)
    assert theirs[:, 1].min() < 0  # the set has the odd case

    read, found = read_pairs(tmp_path, labels, predictions)
    row = summarize(list(map(score_still, read, found)))

    ours = [row[name] for name in ("TuSimple", "FP", "FN")]
    assert ours == pytest.approx(wanted, abs=1e-9)
    printed = rows_of(score(tmp_path), "scores")["all"][2:5]
    assert printed == [f"{number:.3f}" for number in wanted]


def test_late_predictions_are_counted_and_five_of_them_named(tmp_path, score):
    labels, predictions = random_set()
    late = sum(prediction["run_time"] > 200 for prediction in predictions)
    read_pairs(tmp_path, labels, predictions)

    said = score(tmp_path)

    words = "predictions took more than 200 ms, which TuSimple's score counts as not fo"
    assert f"note: {late} of 60 {words}" in said
    assert f" and {late - 5} more\n" in said


def road_lines(
    *lateral_m: float,
    x_m: tuple[float, float] = (4, 60),
    curvature_per_m: float = 2e-3,
) -> LaneColumns:
    """Lines of a bend at these lateral positions, seen by CAMERA in every tenth row."""
    rows = np.arange(360.0, 720, 10)
    x = np.geomspace(*x_m, 400)
    columns = []
    for at_car_m in lateral_m:
        y = at_car_m + curvature_per_m * x**2 / 2
        pixels = CAMERA.road_to_pixels(np.column_stack([x, y]))
        u, v = pixels[::-1].T
        at_rows = np.interp(rows, v, u, left=-2, right=-2)
        columns.append(at_rows)
    return lines(*columns, rows=rows)


AT_M = [float(name.removesuffix(" m")) for name in DISTANCES]
# Lines are straight between points, 10 rows apart.
STRAIGHT_ERRORS_M = [-1e-3 * x_m**2 for x_m in AT_M]
NO_ERRORS_M = [np.nan] * 5


@pytest.mark.parametrize(
    ("found", "errors"),
    [
        pytest.param(
            road_lines(-1.5, 1.7),
            [[-0.1] * 5, [0.3] * 5],
            id="positive left",
        ),
        pytest.param(
            road_lines(1.8, -1.8, curvature_per_m=0),
            [STRAIGHT_ERRORS_M] * 2,
            id="a straight road",
        ),
        pytest.param(
            road_lines(1.8),
            [[0.0] * 5, NO_ERRORS_M],
            id="one line",
        ),
        pytest.param(
            road_lines(1.8, -1.8, x_m=(12, 25)),
            [[np.nan, np.nan, 0, 0, np.nan]] * 2,
            id="between the ends",
        ),
        pytest.param(lines(), [NO_ERRORS_M] * 2, id="none"),
    ],
)
def test_lateral_errors_at_each_distance(found, errors):
    values = score_still(road_lines(1.8, -1.8), found, CAMERA.size, CAMERA).values
    measured = np.array([values[name] for name in DISTANCES]).T
    np.testing.assert_allclose(measured, errors, atol=0.03)


def test_medians_and_percentiles_are_those_of_the_sizes_of_the_errors():
    label = road_lines(1.8, -1.8)
    scores = []
    for found in (road_lines(1.8, -1.8), road_lines(1.7, -1.5)):
        scores.append(score_still(label, found, CAMERA.size, CAMERA))
    row = summarize(scores, DISTANCES)
    assert row["15 m"] == pytest.approx(0.05, abs=0.01)
    assert row["15 m, 95 %"] == pytest.approx(0.27, abs=0.01)


def stated(
    confidence: float | None, right: bool, *, labelled: bool = True
) -> StillScore:
    label = lines(upright(), upright(900)) if labelled else lines()
    left = upright(300 if right else 500)
    found = lines(left, upright(900), confidence=confidence)
    return score_still(label, found)


def test_confidence_is_compared_with_the_share_of_right_lanes():
    nothing_found = lines(confidence=0.0)
    scores = [
        stated(0.95, True),
        stated(0.9, True),
        stated(0.99, False),
        stated(0.7, True),
        stated(0.5, False),
        stated(0.2, True),
        stated(None, True),
        # An unlikely lane where none is labelled is no fault, but no right lane either.
        stated(0.3, True, labelled=False),
        score_still(lines(upright(), upright(900)), nothing_found),
    ]

    table = reliability(scores)

    sure, likely, unlikely = table.values()
    assert list(table) == ["0.9 or more", "0.5 to 0.9", "below 0.5"]
    assert (sure["lanes"], sure["right"]) == (3, 2)
    assert (likely["lanes"], likely["right"]) == (2, 1)
    assert (unlikely["lanes"], unlikely["right"]) == (2, 1)
    assert sure["of right lanes"] == 0.5
    assert likely["of right lanes"] == 0.25
    assert unlikely["of right lanes"] == 0.25
    assert table["0.5 to 0.9"]["mean stated"] == pytest.approx(0.6)


# The command and its page.

HOSTILE = "b/c/<img src=x onerror=alert(1)>{{data}}{% raw %}.jpg"


@pytest.fixture
def folder(tmp_path) -> Path:
    """Labels of three pictures in two folders, and predictions for two of them.

    One picture is not there.
    """
    good = road_lines(1.8, -1.8)
    nothing = lines(rows=good.rows)
    labels = [
        entry("a/1.jpg", good),
        entry(HOSTILE, good),
        entry("a/2.jpg", nothing),
    ]
    three = road_lines(5.0, -1.7, 1.9)
    found = [
        entry("a/1.jpg", three, confidence=0.9),
        entry("a/2.jpg", good, confidence=0.8),
    ]
    read_pairs(tmp_path, labels, found)
    for name in ("a/1.jpg", HOSTILE):
        write_image(tmp_path / name, gray_image())
    save_camera(CAMERA, tmp_path / "camera.yaml")
    return tmp_path


@pytest.fixture
def score(run):
    """A function that scores a folder into its page.html; returns what is printed.

    On stderr if the command refuses.
    """

    def score(
        folder: Path,
        *options: object,
        output: str = "page.html",
        status: int = 0,
    ) -> str:
        labels, predictions = folder / "labels.jsonl", folder / "found.jsonl"
        page = folder / output
        arguments = [labels, predictions, *options, "-o", page]
        ended, out, err = run("score", *arguments)
        assert ended == status
        return err if status else out

    return score


def rows_of(text: str, title: str) -> dict[str, list[str]]:
    """The rows of a printed table by their names, which have no space here."""
    _, _, after_title = text.partition(f"{title}:\n")
    table, _, _ = after_title.partition("\n\n")
    rows = {}
    for line in table.splitlines()[1:]:
        name, *cells = line.split()
        rows[name] = cells
    return rows


@dataclass(frozen=True)
class ShownStill:
    name: str
    facts: str
    image: np.ndarray


SHOWN_STILL = re.compile(
    r'<img src="data:image/jpeg;base64,([^"]*)".*?<span>(.*?)</span>'
    r".*?<small[^>]*>(.*?)</small>",
    re.DOTALL,
)


def stills_of(page: Path) -> list[ShownStill]:
    shown = []
    for jpeg, name, facts in SHOWN_STILL.findall(page.read_text()):
        data = np.frombuffer(base64.b64decode(jpeg), np.uint8)
        image = cv2.imdecode(data, cv2.IMREAD_COLOR_RGB)
        shown.append(ShownStill(unescape(name), unescape(facts), image))
    return shown


def test_command_prints_tables(folder, score):
    said = score(folder, "--camera", folder / "camera.yaml")
    assert rows_of(said, "scores") == {
        "all": ["3", "0.333", "0.333", "0.444", "0.333", "0.500", "0.500"],
        "a": ["2", "0.500", "0.500", "0.667", "0.000", "1.000", "1.000"],
        "b": ["1", "0.000", "0.000", "0.000", "1.000", "0.000", "0.000"],
    }
    _, *cells = rows_of(said, "lateral errors, metres")["all"]
    errors_m = np.array(cells, float)
    assert errors_m == pytest.approx(0.1, abs=0.01)
    assert "note: 1 of 3 stills have no prediction" in said
    assert "note: 1 of 3 pictures are missing" in said
    assert "a/2.jpg" in said
    assert str(folder / "page.html") in said


def test_the_page_has_the_tables_and_the_worst_stills(folder, score):
    page = folder / "out" / "page.html"
    score(folder, "--camera", folder / "camera.yaml", output="out/page.html")
    shown = stills_of(page)
    assert [still.name for still in shown] == [HOSTILE, "a/2.jpg", "a/1.jpg"]
    assert [still.facts for still in shown] == [
        "wrong",
        "wrong, no lane is labelled, confidence 0.80, the picture is not there",
        "right, confidence 0.90",
    ]
    cells = re.findall(
        r"<th>b</th>\s*<td>(.*?)</td>\s*<td>(.*?)</td>", page.read_text()
    )
    assert cells[0] == ("1", "0.000")


def test_names_are_text_on_the_page_and_it_runs_no_script(folder, score):
    score(folder)
    page = (folder / "page.html").read_text()
    assert "<img src=x" not in page
    assert page.count("{{data}}{% raw %}") == page.count("&lt;img src=x")
    assert "<script" not in page
    assert "default-src 'none'; img-src data:; style-src 'unsafe-inline'\"" in page
    assert not re.search(r"https?://", page)


WHITE = (255, 255, 255)
BLUE = (0, 183, 255)
ORANGE = (255, 122, 0)


def shows(image: np.ndarray, row: int, columns: range, colour: tuple) -> bool:
    """Whether one of the pixels is nearly of that colour; JPEG blurs thin lines."""
    pixels = image[row, columns].astype(int)
    away = np.abs(pixels - colour).max(axis=-1)
    return bool(away.min() < 60)


def test_the_page_draws_labels_and_predictions_with_their_gaps(tmp_path, score):
    """The label is at column 300 but in rows 450 to 500, the prediction at 400."""
    label = lane(without(np.s_[5:11]), upright(900))
    found = lane(upright(400), upright(900))
    labels = [entry("a.png", label)]
    read_pairs(tmp_path, labels, [entry("a.png", found)])
    write_image(tmp_path / "a.png", gray_image(255))

    score(tmp_path)

    (still,) = stills_of(tmp_path / "page.html")
    assert still.image.shape == (540, 960, 3)  # 0.75 times as large
    at_label = range(222, 229)
    assert shows(still.image, 315, at_label, BLUE)
    assert not shows(still.image, 356, at_label, BLUE)
    beside_the_gap = range(30, 190)
    assert not shows(still.image, 333, beside_the_gap, BLUE)
    assert shows(still.image, 356, at_label, WHITE)
    assert shows(still.image, 425, at_label, BLUE)
    at_prediction = range(298, 303)
    orange = 0
    for row in range(305, 435):
        orange += shows(still.image, row, at_prediction, ORANGE)
    assert 0.4 < orange / 130 < 0.9  # dashed


@pytest.mark.parametrize(
    ("camera", "output", "words"),
    [
        (CAMERA.with_pose(None), "page.html", "holds no camera pose"),
        (CAMERA.scaled((640, 360)), "page.html", "1.jpg"),
        (CAMERA, "a/1.jpg", "would be overwritten"),
        (CAMERA, "page.html", "a/2.jpg: cannot be decoded"),
    ],
)
def test_what_does_not_fit_is_refused_and_nothing_is_written(
    folder, camera, output, words, score
):
    camera_file = save_camera(camera, folder / "camera.yaml")
    first = folder / "a" / "1.jpg"
    if "decoded" in words:
        cut_off = first.read_bytes()[:300]
        (folder / "a" / "2.jpg").write_bytes(cut_off)
    before = names(folder)
    content = first.read_bytes()

    said = score(folder, "--camera", camera_file, output=output, status=2)

    assert words in said
    assert names(folder) == before
    assert first.read_bytes() == content


@pytest.mark.parametrize(
    ("labelled", "predicted", "on_disk"),
    [
        ("NFC", "NFD", "NFD"),
        ("NFD", "NFC", "NFD"),
        ("NFD", "NFD", "NFC"),
    ],
)
def test_names_are_the_same_in_all_forms_of_unicode(
    tmp_path, score, labelled, predicted, on_disk
):
    """macOS decomposes accents and Hangul."""
    good = road_lines(1.8, -1.8)
    name = "Fahrt nach Köln/서울 é.png"
    write_image(tmp_path / normalize(on_disk, name), gray_image())
    labels = [entry(normalize(labelled, name), good)]
    found = [entry(normalize(predicted, name), good)]
    read_pairs(tmp_path, labels, found)

    said = score(tmp_path)

    stills, right, tusimple = rows_of(said, "scores")["all"][:3]
    assert (stills, right, tusimple) == ("1", "1.000", "1.000")
    assert "note:" not in said
    (still,) = stills_of(tmp_path / "page.html")
    assert still.facts == "right"


def bend_at(rows: np.ndarray) -> dict:
    """Both lines of a bend at any rows."""
    y = np.asarray(rows, float) - 360
    left = 600 - 1.2 * y + 0.0005 * y**2
    right = 640 + 1.3 * y + 0.0005 * y**2
    return entry("a.png", lines(left, right, rows=rows))


# The rows of `detect` by default.
DETECTED_ROWS = np.arange(420, 701, 10)


@pytest.mark.parametrize(
    ("labelled", "predicted", "accuracy", "notes"),
    [
        (
            np.arange(420, 706, 15),
            DETECTED_ROWS,
            "0.950",
            ["at other rows", "(rows 705)"],
        ),
        (
            DETECTED_ROWS,
            np.linspace(420, 700, 29) + 1e-9,
            "1.000",
            [],
        ),
        (
            np.arange(400, 701, 20),
            DETECTED_ROWS[::-1],
            "0.938",
            ["(rows 400)"],
        ),
        (
            np.arange(240, 711, 10),
            DETECTED_ROWS,
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
    of_predictions = [line for line in said.splitlines() if "predictions " in line]
    assert len(of_predictions) == len(notes)
    for note in notes:
        assert note in said


def test_a_missing_picture_has_the_size_of_the_camera(tmp_path, score):
    read_pairs(tmp_path, [bend_at(DETECTED_ROWS)], [bend_at(DETECTED_ROWS)])
    portrait = Camera.from_fov((1080, 1920), 60, CameraPose(1.3))
    camera_file = save_camera(portrait, tmp_path / "camera.yaml")

    score(tmp_path, "--camera", camera_file)

    (still,) = stills_of(tmp_path / "page.html")
    assert still.image.shape == (960, 540, 3)
