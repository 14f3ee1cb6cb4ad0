"""Scores of lines in labelled stills: TuSimple's official score, its ego-lane variant, and errors in metres.

The rules are those of TuSimple's lane detection challenge: a point is correct within 20 px over the cosine of the
line's angle, and a line is matched if 85 % of its points are correct. TuSimple's stills are 1280 px wide; in others
the tolerance is scaled with the width.

The official score counts all lines, each label with its best prediction, and all rows: one without a labelled point is
correct if the prediction has none either. A prediction that matches no label is false, also one without points. The
number is that of TuSimple's program, also in odd cases: a prediction that is the best of two labels makes the FP of a
still negative; a still without a labelled line has an accuracy of 0; after more than 200 ms a prediction counts as not
found. In the ego-lane variant left is compared with left and right with right, and only rows with a
labelled point count.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from io import BytesIO
from pathlib import Path

import numpy as np

from lanes.camera.model import Camera
from lanes.describe import number_cells
from lanes.detect.confidence import CORRECT_AT_M, LIKELY_CONFIDENCE, SURE_CONFIDENCE
from lanes.labels import SAME_ROW_PX, LaneColumns, find_picture
from lanes.show.report import fill_page
from lanes.video.images import read_image

# TuSimple's tolerance of a point, accuracy of a matched line, size of its stills, and longest time of a prediction.
_TOLERANCE_PX, _MATCH_ACCURACY, TUSIMPLE_SIZE, _MAX_RUN_TIME_MS = 20.0, 0.85, (1280, 720), 200.0
# The numbers of a still's score: shares, and lateral errors in metres at these distances.
SHARES = ("right", "TuSimple", "FP", "FN", "ego accuracy", "ego matched")
DISTANCES = tuple(f"{x_m:g} m" for x_m in CORRECT_AT_M)
_MAX_WORST = 20
Table = Mapping[str, Mapping[str, float]]


@dataclass(frozen=True, eq=False)
class StillScore:
    """Score of a prediction for a labelled still of `size` (width, height).

    `values` has an array for each of `SHARES` and `DISTANCES`, NaN where nothing can be compared: the official score
    ("TuSimple", "FP", "FN"); of the left and the right ego line the share of the labelled points that are correct, and
    the lateral error, positive left. `right` says whether all lines with enough labelled points are matched, None
    without any; if no lane is labelled, whether none is predicted, or with a confidence below 0.5.
    """

    label: LaneColumns
    prediction: LaneColumns
    size: tuple[int, int]
    right: bool | None
    values: dict[str, np.ndarray]


def score_still(
    label: LaneColumns, found: LaneColumns | None, size: tuple[int, int] = TUSIMPLE_SIZE, camera: Camera | None = None
) -> StillScore:
    """The score of a prediction, None for no lines; lateral errors are only known with a camera that has a pose."""
    found = found or LaneColumns(label.name, label.rows, np.empty((0, len(label.rows))))
    true, ego, scale = label.ego_lane(size), found.ego_lane(size), size[0] / TUSIMPLE_SIZE[0]
    columns, labelled = ego.at(label.rows), true.columns >= 0
    error_px = np.where(columns >= 0, np.abs(columns - true.columns), np.inf)
    correct = labelled & (error_px < _tolerances_px(true, scale))
    points = labelled.sum(axis=1)
    # the direction of a line with fewer points is not reliable
    accuracy = np.where(points >= 4, correct.sum(axis=1) / np.maximum(points, 1), np.nan)
    matched = np.where(np.isfinite(accuracy), accuracy >= _MATCH_ACCURACY, np.nan)
    right = bool(np.nanmin(matched)) if np.isfinite(matched).any() else None
    if label.empty:
        right = found.empty or (found.confidence is not None and found.confidence < LIKELY_CONFIDENCE)
    official = _official_score(label, found.at(label.rows), scale, late=found.run_time_ms > _MAX_RUN_TIME_MS)
    lateral_m = lateral_errors_m(true, ego, camera).T if camera else np.full((len(DISTANCES), 2), np.nan)
    numbers = np.nan if right is None else right, *official, accuracy, matched, *lateral_m
    values = {name: np.atleast_1d(some) for name, some in zip(SHARES + DISTANCES, numbers, strict=True)}
    return StillScore(label, found, size, right, values)


def _official_score(
    label: LaneColumns, predicted: np.ndarray, scale: float, *, late: bool
) -> tuple[float, float, float]:
    """TuSimple's accuracy, FP and FN of predicted columns (K, R); `late` if they took too long.

    With more than two surplus predictions the accuracy is 0. Of more than four labelled lines the worst is left out.
    """
    lines, count = len(label.columns), max(min(len(label.columns), 4), 1)
    if not len(label.rows):
        return np.nan, np.nan, np.nan
    if late or len(predicted) > lines + 2:
        return 0.0, 0.0, 1.0
    # missing points are far from all others
    found, true = (np.where(columns >= 0, columns, -100.0) for columns in (predicted, label.columns))
    correct = np.abs(found - true[:, None]) < _tolerances_px(label, scale)[:, None]
    best = correct.mean(axis=2).max(axis=1, initial=0.0)
    matched, left_out = int((best >= _MATCH_ACCURACY).sum()), lines > 4
    false = (len(predicted) - matched) / max(len(predicted), 1)
    missed = lines - matched - (left_out and lines > matched)
    return float(best.sum() - left_out * best.min(initial=1.0)) / count, false, missed / count


def _tolerances_px(label: LaneColumns, scale: float) -> np.ndarray:
    """Tolerance (K, 1) of each line's points: by the angle, from the vertical, of the straight line through them."""
    known = [(label.rows[line >= 0], line[line >= 0]) for line in label.columns]
    slopes = [np.polyfit(*points, 1)[0] if len(points[0]) > 1 else 0.0 for points in known]
    return _TOLERANCE_PX * scale * np.hypot(1, slopes)[:, None]


def lateral_errors_m(true: LaneColumns, ego: LaneColumns, camera: Camera, x_m: np.ndarray = CORRECT_AT_M) -> np.ndarray:
    """Lateral errors (2, D), positive left, of both lines at D distances on a flat road, metres; NaN where one ends."""
    y_m = np.empty((2, 2, len(x_m)))
    for at, lane in enumerate((true, ego)):
        for side, columns in enumerate(lane.columns):
            road_m = camera.pixels_to_road(np.column_stack([columns, lane.rows])[columns >= 0])
            points = sorted(road_m[np.isfinite(road_m).all(axis=1)].tolist()) or [[np.inf, np.nan]]
            y_m[at, side] = np.interp(x_m, [x for x, _ in points], [y for _, y in points], np.nan, np.nan)
    return y_m[1] - y_m[0]


def summarize(scores: Sequence[StillScore], names: Sequence[str] = SHARES) -> dict[str, float]:
    """Number of stills, means of the shares, and medians and 95th percentiles of the lateral errors."""
    row: dict[str, float] = {"stills": len(scores)}
    for name in names:
        values = np.concatenate([score.values[name] for score in scores])
        known = values[np.isfinite(values)] if np.isfinite(values).any() else [np.nan]
        if name in SHARES:
            row[name] = float(np.mean(known))
        else:
            errors_m = np.abs(known)
            row |= {name: float(np.median(errors_m)), f"{name}, 95 %": float(np.percentile(errors_m, 95))}
    return row


def reliability(scores: Iterable[StillScore]) -> Table:
    """For each range of stated confidence the number of lanes, of right ones, and their share of all right ones."""
    lanes = [s for s in scores if None not in (s.prediction.confidence, s.right) and not s.prediction.empty]
    stated = np.array([s.prediction.confidence for s in lanes], float)
    right = np.array([s.right and not s.label.empty for s in lanes], bool)
    levels = np.searchsorted([LIKELY_CONFIDENCE, SURE_CONFIDENCE], stated, side="right")
    table: dict[str, dict[str, float]] = {}
    for level, name in ((2, "0.9 or more"), (1, "0.5 to 0.9"), (0, "below 0.5")):
        counts = {"lanes": int((levels == level).sum()), "right": int(right[levels == level].sum())}
        mean = float(stated[levels == level].mean()) if counts["lanes"] else np.nan
        table[name] = {**counts, "mean stated": mean, "of right lanes": counts["right"] / max(int(right.sum()), 1)}
    return table


def score_tables(scores: Sequence[StillScore]) -> dict[str, Table]:
    """Scores, lateral errors and reliability of all stills and of each top folder; scores of the worst stills."""
    names = ["all", *dict.fromkeys(score.label.folder for score in scores)]
    folders = {name: [s for s in scores if name in ("all", s.label.folder)] for name in names}
    tables: dict[str, Table] = {"scores": {name: summarize(some) for name, some in folders.items()}}
    if any(np.isfinite(score.values[name]).any() for score in scores for name in DISTANCES):
        tables["lateral errors, metres"] = {name: summarize(some, DISTANCES) for name, some in folders.items()}
    if any(score.prediction.confidence is not None for score in scores):
        tables["confidence"] = reliability(scores)
    rows = {score.label.name: summarize([score]) for score in scores}
    # a still without a labelled lane has no accuracy; those with nothing to compare come last
    key = {name: (row["right"], np.nan_to_num(row["ego accuracy"], nan=row["right"])) for name, row in rows.items()}
    worst = sorted(rows, key=lambda name: np.nan_to_num(key[name], nan=2.0).tolist())
    return tables | {"worst stills": {name: rows[name] for name in worst[:_MAX_WORST]}}


def describe_predictions(
    labels: Sequence[LaneColumns], predictions: Sequence[LaneColumns | None], stills: Sequence[Path]
) -> list[tuple[str, list[Path]]]:
    """Notes on the predictions, in words, each with the stills that it applies to."""
    other, lacking, late = [], [], []
    lacked: set[float] = set()
    for label, found, still in zip(labels, predictions, stills, strict=True):
        if found is None:
            continue
        labelled = label.rows[(label.columns >= 0).any(axis=0)]
        beyond = found.lacking(labelled).tolist()
        lacked.update(beyond)
        lacking += [still] if beyond else []
        between = np.abs(labelled[:, None] - found.rows).min(axis=1, initial=np.inf) > SAME_ROW_PX
        other += [still] if between.sum() > len(beyond) else []
        late += [still] if found.run_time_ms > _MAX_RUN_TIME_MS else []
    rows = ", ".join(f"{row:g}" for row in sorted(lacked)[:_MAX_WORST]) + (", ..." if len(lacked) > _MAX_WORST else "")
    return [
        ("predictions are at other rows than the labels, and interpolated", other),
        (f"predictions end before labelled rows, which count as missing (rows {rows})", lacking),
        (f"predictions took more than {_MAX_RUN_TIME_MS:g} ms, which TuSimple's score counts as not found", late),
    ]


# The page: its tables, and the worst stills with labels and predictions, which its script draws.


def write_score_page(
    path: Path, folder: Path, scores: Sequence[StillScore], tables: Mapping[str, Table], words: Mapping[str, str]
) -> Path:
    """Write the page of scores of stills in a folder, with their `score_tables`, a title and notes; returns `path`."""
    stills = [
        _still(s, find_picture(folder, name)) for name in tables["worst stills"] for s in scores if s.label.name == name
    ]
    data = {"tables": {name: number_cells(rows) for name, rows in tables.items()}, "stills": stills}
    parts = {name: escape(text) for name, text in words.items()} | {"kind": "score"}
    return fill_page(path, "score", parts, data)


def _still(score: StillScore, picture: Path) -> dict:
    """A still with its lines for the script; without JPEG data if its file is missing."""
    from PIL import Image

    jpeg = BytesIO()
    if picture.is_file():
        image = Image.fromarray(read_image(picture))
        image.thumbnail((960, 960))
        image.save(jpeg, "JPEG", quality=80)  # about 100 kB
    lanes = [(lane.rows, lane.columns, lane.ego_lane(score.size).columns) for lane in (score.label, score.prediction)]
    return {
        "name": score.label.name,
        "right": score.right,
        "confidence": score.prediction.confidence,
        "size": score.size,
        "lanes": [[array.tolist() for array in lane] for lane in lanes],
        "jpeg": base64.b64encode(jpeg.getvalue()).decode(),
    }
