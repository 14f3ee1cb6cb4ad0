"""Scores of lines in labelled stills: TuSimple's, of the ego lane, errors in metres.

The rules are those of TuSimple's lane detection challenge: a point is correct within
20 px over the cosine of the line's angle, and a line is matched if 85 % of its points
are correct. TuSimple's stills are 1280 px wide; in others the tolerance is scaled with
the width.

The official score counts all lines, each label with its best prediction, and all rows:
one without a labelled point is correct if the prediction has none either. A prediction
that matches no label is false, also one without points. The number is that of
TuSimple's program, also in odd cases: a prediction that is the best of two labels makes
the FP of a still negative; a still without a labelled line has an accuracy of 0; after
more than 200 ms a prediction counts as not found. In the ego-lane variant left is
compared with left and right with right, and only rows with a labelled point count.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from lanes.camera.model import Camera
from lanes.describe import number_cells
from lanes.detect.confidence import CORRECT_AT_M, LIKELY_CONFIDENCE, SURE_CONFIDENCE
from lanes.errors import PictureError
from lanes.labels import SAME_ROW_PX, LaneColumns
from lanes.show.figures import ShownLine, encode_figure, show_scored_still
from lanes.show.report import write_page
from lanes.video.images import read_image

# TuSimple's tolerance of a point, share of correct points of a matched line, size of
# its stills, and longest time of a prediction.
_TOLERANCE_PX = 20.0
_MATCH_ACCURACY = 0.85
TUSIMPLE_SIZE = (1280, 720)
_MAX_RUN_TIME_MS = 200.0
# Of more labelled lines than this the official score leaves out the worst.
_MAX_LINES = 4
# With more surplus predictions than this the official accuracy is 0.
_MAX_SURPLUS = 2
# The column that missing points have in the official score: far from all others.
_MISSING_PX = -100.0
# The direction of an ego line with fewer points is not reliable.
_MIN_POINTS = 4

# The numbers of a still's score: shares, and lateral errors in metres at distances.
SHARES = ("right", "TuSimple", "FP", "FN", "ego accuracy", "ego matched")
DISTANCES = tuple(f"{x_m:g} m" for x_m in CORRECT_AT_M)
_MAX_WORST = 20
# Longer side of a still in the page: about 100 kB.
_SHOWN_PX = 960
Table = Mapping[str, Mapping[str, float]]


@dataclass(frozen=True, eq=False)
class StillScore:
    """Score of a prediction for a labelled still.

    Attributes
    ----------
    label, prediction : LaneColumns
        The lines; a prediction of no lines if there is none.
    size : (int, int)
        Width and height of the still.
    right : bool or None
        Whether all ego lines with enough labelled points are matched, None without any.
        If no lane is labelled: whether none is predicted, or with a confidence below
        0.5.
    values : dict of str to ndarray
        For each of `SHARES` and `DISTANCES` the numbers, NaN where nothing can be
        compared: one of "right" and of the official score ("TuSimple", "FP", "FN"); of
        the left and the right ego line the share of the labelled points that are
        correct, whether it is matched, and the lateral errors, metres, positive left.
    """

    label: LaneColumns
    prediction: LaneColumns
    size: tuple[int, int]
    right: bool | None
    values: dict[str, np.ndarray]


def score_stills(
    labels: Sequence[LaneColumns],
    predictions: Sequence[LaneColumns | None],
    pictures: Sequence[Path],
    camera: Camera | None = None,
) -> list[StillScore]:
    """The score of the prediction for each label; None is a prediction of no lines.

    `pictures` are the stills. One that is missing has the size that its label states,
    else that of the camera, else 1280x720. Raises PictureError if a still cannot be
    read, or has another size than its label or the camera.
    """
    assumed = camera.size if camera else TUSIMPLE_SIZE
    scores = []
    for label, found, picture in zip(labels, predictions, pictures, strict=True):
        size = label.size or assumed
        if picture.is_file():
            size = _size_of(picture, label, camera)
        scores.append(score_still(label, found, size, camera))
    return scores


def _size_of(
    picture: Path, label: LaneColumns, camera: Camera | None
) -> tuple[int, int]:
    image = read_image(picture)
    if camera:
        camera.require_size(image, picture)
    height, width = image.shape[:2]
    if label.size and label.size != (width, height):
        labelled_width, labelled_height = label.size
        raise PictureError(
            f"{picture}: is {width}x{height}, but its label is of an image of "
            f"{labelled_width}x{labelled_height}; give the image that was labelled, or "
            "label this one."
        )
    return width, height


def score_still(
    label: LaneColumns,
    found: LaneColumns | None,
    size: tuple[int, int] = TUSIMPLE_SIZE,
    camera: Camera | None = None,
) -> StillScore:
    """The score of a prediction, None for no lines, in a still of `size`.

    Lateral errors are only known with a camera that has a pose.
    """
    if found is None:
        no_lines = np.empty((0, len(label.rows)))
        found = LaneColumns(label.name, label.rows, no_lines)
    true_ego = label.ego_lane(size)
    found_ego = found.ego_lane(size)
    scale = size[0] / TUSIMPLE_SIZE[0]

    accuracy = _ego_accuracy(true_ego, found_ego, scale)
    matched = np.where(np.isnan(accuracy), np.nan, accuracy >= _MATCH_ACCURACY)
    right = _is_right(label, found, matched)

    late = found.run_time_ms > _MAX_RUN_TIME_MS
    official = _official_score(label, found.at(label.rows), scale, late=late)
    share, false_positives, false_negatives = official
    values = {
        "right": np.array([np.nan if right is None else right], float),
        "TuSimple": np.array([share]),
        "FP": np.array([false_positives]),
        "FN": np.array([false_negatives]),
        "ego accuracy": accuracy,
        "ego matched": matched,
    }

    lateral_m = np.full((2, len(DISTANCES)), np.nan)
    if camera:
        lateral_m = lateral_errors_m(true_ego, found_ego, camera)
    values |= dict(zip(DISTANCES, lateral_m.T, strict=True))
    return StillScore(label, found, size, right, values)


def _ego_accuracy(true: LaneColumns, found: LaneColumns, scale: float) -> np.ndarray:
    """Share (2,) of the labelled points of each ego line that are correct.

    NaN for a line with few labelled points.
    """
    columns = found.at(true.rows)
    error_px = np.where(columns >= 0, np.abs(columns - true.columns), np.inf)
    labelled = true.columns >= 0
    correct = labelled & (error_px < _tolerances_px(true, scale))
    points = labelled.sum(axis=1)
    share = correct.sum(axis=1) / np.maximum(points, 1)
    return np.where(points >= _MIN_POINTS, share, np.nan)


def _is_right(
    label: LaneColumns, found: LaneColumns, matched: np.ndarray
) -> bool | None:
    """`StillScore.right`; `matched` (2,) are the ego lines: 1, 0, or NaN."""
    if label.empty:
        unlikely = found.confidence is not None and found.confidence < LIKELY_CONFIDENCE
        return found.empty or unlikely
    compared = matched[np.isfinite(matched)]
    return bool(compared.all()) if len(compared) else None


def _official_score(
    label: LaneColumns, predicted: np.ndarray, scale: float, *, late: bool
) -> tuple[float, float, float]:
    """TuSimple's accuracy, FP and FN of predicted columns (K, R) at the label's rows.

    `late` says that the prediction took too long.
    """
    lines = len(label.columns)
    if not len(label.rows):
        return np.nan, np.nan, np.nan
    if late or len(predicted) > lines + _MAX_SURPLUS:
        return 0.0, 0.0, 1.0

    # The accuracy (lines, K) of each prediction as each label, and the best of them.
    found_px = np.where(predicted >= 0, predicted, _MISSING_PX)
    true_px = np.where(label.columns >= 0, label.columns, _MISSING_PX)
    error_px = np.abs(found_px - true_px[:, None])
    correct = error_px < _tolerances_px(label, scale)[:, None]
    best = correct.mean(axis=2).max(axis=1, initial=0.0)

    matched = int((best >= _MATCH_ACCURACY).sum())
    missed = lines - matched
    total = float(best.sum())
    if lines > _MAX_LINES:
        missed = max(missed - 1, 0)
        total -= float(best.min())
    counted = max(min(lines, _MAX_LINES), 1)
    false_positives = (len(predicted) - matched) / max(len(predicted), 1)
    return total / counted, false_positives, missed / counted


def _tolerances_px(label: LaneColumns, scale: float) -> np.ndarray:
    """Tolerance (K, 1) of the points of each line, along the row.

    It grows with the angle, from the vertical, of the straight line through the points.
    """
    slopes = np.zeros(len(label.columns))
    for number, line in enumerate(label.columns):
        labelled = line >= 0
        if labelled.sum() > 1:
            slopes[number], _ = np.polyfit(label.rows[labelled], line[labelled], 1)
    one_over_cosine = np.hypot(1, slopes)
    return _TOLERANCE_PX * scale * one_over_cosine[:, None]


def lateral_errors_m(
    true: LaneColumns,
    ego: LaneColumns,
    camera: Camera,
    x_m: np.ndarray = CORRECT_AT_M,
) -> np.ndarray:
    """Lateral errors (2, D), metres, positive left, of both lines at D distances.

    On a flat road; NaN where one of the lines ends.
    """
    true_y_m = [_lateral_m(true.rows, line, camera, x_m) for line in true.columns]
    found_y_m = [_lateral_m(ego.rows, line, camera, x_m) for line in ego.columns]
    return np.array(found_y_m) - np.array(true_y_m)


def _lateral_m(
    rows: np.ndarray, columns: np.ndarray, camera: Camera, x_m: np.ndarray
) -> np.ndarray:
    """Lateral position (D,) of a line on the road at distances (D,), metres."""
    pixels = np.column_stack([columns, rows])[columns >= 0]
    road_m = camera.pixels_to_road(pixels)
    on_road_m = road_m[np.isfinite(road_m).all(axis=1)]
    if not len(on_road_m):
        return np.full(len(x_m), np.nan)
    ahead_m, left_m = on_road_m[np.lexsort(on_road_m.T[::-1])].T
    return np.interp(x_m, ahead_m, left_m, left=np.nan, right=np.nan)


def summarize(
    scores: Sequence[StillScore], names: Sequence[str] = SHARES
) -> dict[str, float]:
    """Number of stills, means of shares, medians and 95th percentiles of errors."""
    row: dict[str, float] = {"stills": len(scores)}
    for name in names:
        values = np.concatenate([score.values[name] for score in scores])
        known = values[np.isfinite(values)]
        if not len(known):
            known = np.array([np.nan])
        if name in SHARES:
            row[name] = float(np.mean(known))
        else:
            errors_m = np.abs(known)
            row[name] = float(np.median(errors_m))
            row[f"{name}, 95 %"] = float(np.percentile(errors_m, 95))
    return row


def reliability(scores: Iterable[StillScore]) -> Table:
    """Lanes and right lanes in each range of stated confidence.

    Also the mean confidence, and the share of all right lanes.
    """
    lanes = [score for score in scores if _states_a_lane(score)]
    stated = np.array([score.prediction.confidence for score in lanes], float)
    right = np.array([score.right and not score.label.empty for score in lanes], bool)
    all_right = max(int(right.sum()), 1)
    ranges = {
        "0.9 or more": stated >= SURE_CONFIDENCE,
        "0.5 to 0.9": (stated >= LIKELY_CONFIDENCE) & (stated < SURE_CONFIDENCE),
        "below 0.5": stated < LIKELY_CONFIDENCE,
    }

    table: dict[str, dict[str, float]] = {}
    for name, inside in ranges.items():
        right_inside = int(right[inside].sum())
        mean_stated = float(stated[inside].mean()) if inside.any() else np.nan
        table[name] = {
            "lanes": int(inside.sum()),
            "right": right_inside,
            "mean stated": mean_stated,
            "of right lanes": right_inside / all_right,
        }
    return table


def _states_a_lane(score: StillScore) -> bool:
    """Whether a lane is predicted with a confidence, and can be compared."""
    if score.prediction.confidence is None or score.right is None:
        return False
    return not score.prediction.empty


def score_tables(
    scores: Sequence[StillScore], max_worst: int = _MAX_WORST
) -> dict[str, Table]:
    """Scores, lateral errors and reliability of all stills and of each top folder.

    Also the scores of the `max_worst` worst stills.
    """
    of_folder: dict[str, list[StillScore]] = {"all": list(scores)}
    for score in scores:
        if score.label.folder != "all":
            of_folder.setdefault(score.label.folder, []).append(score)

    tables: dict[str, Table] = {}
    tables["scores"] = {name: summarize(some) for name, some in of_folder.items()}
    if _knows_lateral_errors(scores):
        tables["lateral errors, metres"] = {
            name: summarize(some, DISTANCES) for name, some in of_folder.items()
        }
    if any(score.prediction.confidence is not None for score in scores):
        tables["confidence"] = reliability(scores)

    row_of = {score.label.name: summarize([score]) for score in scores}
    worst = sorted(row_of, key=lambda name: _rank(row_of[name]))
    tables["worst stills"] = {name: row_of[name] for name in worst[:max_worst]}
    return tables


def _knows_lateral_errors(scores: Sequence[StillScore]) -> bool:
    for score in scores:
        errors_m = [score.values[name] for name in DISTANCES]
        if np.isfinite(errors_m).any():
            return True
    return False


def _rank(row: Mapping[str, float]) -> tuple[float, float]:
    """Key that sorts the scores of stills, the worst first.

    A still without a labelled lane has no accuracy; those with nothing to compare come
    last.
    """
    right, accuracy = row["right"], row["ego accuracy"]
    if np.isnan(accuracy):
        accuracy = right
    after_all = 2.0
    return (
        after_all if np.isnan(right) else right,
        after_all if np.isnan(accuracy) else accuracy,
    )


def describe_predictions(
    labels: Sequence[LaneColumns],
    predictions: Sequence[LaneColumns | None],
    pictures: Sequence[Path],
) -> list[tuple[str, list[Path]]]:
    """Notes on the predictions, in words, each with the stills that it applies to."""
    without, gone, other_rows, ending, late = [], [], [], [], []
    lacked_rows: set[float] = set()
    for label, found, picture in zip(labels, predictions, pictures, strict=True):
        if not picture.is_file():
            gone.append(picture)
        if found is None:
            without.append(picture)
            continue
        labelled_rows = label.rows[(label.columns >= 0).any(axis=0)]
        beyond = found.lacking(labelled_rows)
        lacked_rows.update(beyond.tolist())
        if len(beyond):
            ending.append(picture)
        if _are_between(labelled_rows, found.rows) > len(beyond):
            other_rows.append(picture)
        if found.run_time_ms > _MAX_RUN_TIME_MS:
            late.append(picture)

    first_rows = [f"{row:g}" for row in sorted(lacked_rows)[:_MAX_WORST]]
    if len(lacked_rows) > _MAX_WORST:
        first_rows.append("...")
    return [
        ("stills have no prediction", without),
        ("pictures are missing, sizes as labelled, or assumed", gone),
        ("predictions are at other rows than the labels, and interpolated", other_rows),
        (
            "predictions end before labelled rows, which count as missing "
            f"(rows {', '.join(first_rows)})",
            ending,
        ),
        (
            f"predictions took more than {_MAX_RUN_TIME_MS:g} ms, which TuSimple's "
            "score counts as not found",
            late,
        ),
    ]


def _are_between(wanted: np.ndarray, rows: np.ndarray) -> int:
    """How many of the rows `wanted` (N,) are none of `rows` (R,)."""
    distances_px = np.abs(wanted[:, None] - rows)
    nearest_px = distances_px.min(axis=1, initial=np.inf)
    return int((nearest_px > SAME_ROW_PX).sum())


# The page: tables, and the worst stills with their labels and predictions.


@dataclass(frozen=True)
class _ShownStill:
    """What the page shows of a still; `jpeg` is base64."""

    name: str
    wrong: bool
    facts: str
    jpeg: str


def write_score_page(
    path: Path,
    scores: Sequence[StillScore],
    pictures: Sequence[Path],
    tables: Mapping[str, Table],
    *,
    title: str,
    notes: str,
) -> Path:
    """Write the page of the scores of stills `pictures`; returns the `path`.

    `tables` are their `score_tables`.
    """
    shown = {}
    for score, picture in zip(scores, pictures, strict=True):
        if score.label.name in tables["worst stills"]:
            shown[score.label.name] = _show_still(score, picture)
    return write_page(
        path,
        "score",
        {
            "title": title,
            "notes": notes,
            "tables": {name: number_cells(rows) for name, rows in tables.items()},
            "stills": [shown[name] for name in tables["worst stills"]],
        },
    )


def _show_still(score: StillScore, picture: Path) -> _ShownStill:
    there = picture.is_file()
    longer_px = max(score.size)
    width, height = (max(round(side * _SHOWN_PX / longer_px), 1) for side in score.size)
    image = None
    if there:
        image = cv2.resize(
            read_image(picture), (width, height), interpolation=cv2.INTER_AREA
        )
    figure, _ = show_scored_still(
        image,
        shown_size=(width, height),
        size=score.size,
        label=_shown_lines(score.label, score.size),
        prediction=_shown_lines(score.prediction, score.size),
    )
    jpeg = encode_figure(figure, "jpeg", jpeg_quality=80)
    return _ShownStill(
        name=score.label.name,
        wrong=score.right is False,
        facts=_describe_score(score, there=there),
        jpeg=base64.b64encode(jpeg).decode(),
    )


def _shown_lines(lanes: LaneColumns, size: tuple[int, int]) -> list[ShownLine]:
    """All lines, and again those of the ego lane, with gaps between their points."""
    ego = lanes.ego_lane(size)
    shown = []
    for lines, is_ego in ((lanes, False), (ego, True)):
        downwards = np.argsort(lines.rows)
        for line in lines.columns:
            columns = np.where(line >= 0, line, np.nan)
            points_px = np.column_stack([columns, lines.rows])[downwards]
            shown.append(ShownLine(points_px, is_ego))
    return shown


def _describe_score(score: StillScore, *, there: bool) -> str:
    words = {True: "right", False: "wrong", None: "not compared"}
    facts = [words[score.right]]
    if score.label.empty:
        facts.append("no lane is labelled")
    if score.prediction.confidence is not None:
        facts.append(f"confidence {score.prediction.confidence:.2f}")
    if not there:
        facts.append("the picture is not there")
    return ", ".join(facts)
