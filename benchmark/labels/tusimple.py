"""Hand-labelled lanes: TuSimple's file format and the ego-lane variant of TuSimple's score.

Each line of a file is a JSON object with `raw_file` (relative to the file), `h_samples` (rows) and `lanes` (columns at
these rows, -2 without a point). The rules are those of TuSimple's lane detection challenge: a point is correct within
20 px over the cosine of the line's angle, and a line is matched if 85 % of its points are correct. TuSimple's pictures
are 1280 px wide; in others the tolerance is scaled with the width.

The ego-lane variant differs from the official score: only the two lines of the ego lane count, left is compared with
left and right with right, and only rows with a labelled point count. The official score (`score_all_lines`) counts all
lines, each label with its best prediction, and all rows: one without a labelled point is correct if the prediction has
none either. A prediction that matches no label is a false positive, also one without points.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import ArrayLike

from lanes.files import read_text
from lanes.images import MAX_PIXELS, read_image

NO_POINT = -2.0
# Enough for a hundred thousand pictures with six lanes at 56 rows.
MAX_LABEL_FILE_BYTES = 200_000_000
# TuSimple's tolerance of a point, and accuracy of a matched line.
TOLERANCE_PX, MATCH_ACCURACY = 20.0, 0.85
# Width of its pictures, pixels.
TUSIMPLE_WIDTH_PX = 1280
# A line with fewer labelled points has no reliable direction and is not scored.
MIN_POINTS = 4
# The official score of a picture is 0 with more surplus predictions than this. Of five or more labelled lines, the
# worst is left out.
MAX_SURPLUS, MAX_LABELLED = 2, 4
# TuSimple puts points that are missing here, so that they are far from all others.
MISSING_PX = -100.0
EGO_LANE_NOTE = (
    "ego-lane variant of TuSimple's score (two lines of the ego lane, labelled rows only), not the official score"
)


@dataclass(frozen=True, eq=False)
class LaneColumns:
    """The lines in a picture, labelled or predicted; `name` is `raw_file`, with / between its folders.

    `columns` (K, R) are those of the lines at `rows` (R,), pixels; -2 without a point. Of the ego lane they are the
    left and the right line.
    """

    name: str
    rows: np.ndarray
    columns: np.ndarray

    def at(self, rows: np.ndarray) -> np.ndarray:
        """Columns (K, N) at rows (N,); -2 in rows that are not in `rows`."""
        index = {row: k for k, row in enumerate(self.rows.tolist())}
        chosen = [index.get(row) for row in np.asarray(rows).tolist()]
        lines = len(self.columns)
        columns = [np.full(lines, NO_POINT) if k is None else self.columns[:, k] for k in chosen]
        return np.array(columns).T.reshape(lines, len(chosen))


@dataclass(frozen=True)
class LineScore:
    """Score of a labelled line.

    `accuracy` is the share of its points that are correct, None with too few labelled points. `error_px` is the median
    error of the predicted points, None without any. `predicted` says whether the prediction has a point.
    """

    accuracy: float | None
    error_px: float | None
    predicted: bool


def read_labels(path: str | Path) -> list[LaneColumns]:
    """The ego lane of each labelled picture; with more than two lines, those left and right of the bottom centre.

    Pictures are only read from the folder of the file and its subfolders.

    Raises
    ------
    FileNotFoundError
        If the file, or a picture whose width is needed to choose lanes, is not there.
    ValueError
        If a line is not a label.
    """
    entries = _read_entries(path)
    for entry in entries:
        name = PurePosixPath(entry["raw_file"])
        if name.is_absolute() or ".." in name.parts or "\0" in entry["raw_file"]:
            raise ValueError(
                f"{path}: the picture {entry['raw_file']!r} lies outside of the folder of the labels; put it "
                "there, and write its path relative to that folder."
            )
    return [_ego_lane(entry, Path(path).parent) for entry in entries]


def read_predictions(path: str | Path) -> list[LaneColumns]:
    """Read predictions as `detect` writes them: the left line, then the right line; further lines are ignored."""
    return [_two_lines(entry, entry["lanes"]) for entry in _read_entries(path)]


def read_all_lines(path: str | Path) -> list[LaneColumns]:
    """All lines of each picture, labelled or predicted; ValueError and FileNotFoundError as for `read_labels`."""
    lines = []
    for entry in _read_entries(path):
        rows, columns = (np.array(entry[name], float) for name in ("h_samples", "lanes"))
        lines.append(LaneColumns(entry["raw_file"], rows, columns.reshape(len(columns), len(rows))))
    return lines


def pair_predictions(
    labels: Sequence[LaneColumns], predictions: Iterable[LaneColumns]
) -> list[tuple[LaneColumns, LaneColumns | None]]:
    """Each label with the prediction for the same picture, or None.

    The two files may use different folders: the paths are compared from their end, over as many parts as distinguish
    all labels.

    Raises
    ------
    ValueError
        If two labels are for the same picture, or no prediction is for a labelled picture.
    """
    deepest = max((len(PurePosixPath(label.name).parts) for label in labels), default=1)
    for depth in range(1, deepest + 1):
        names = [_tail(label.name, depth) for label in labels]
        if len(set(names)) == len(names):
            break
    else:
        raise ValueError("two labels are for the same picture; remove one.")
    by_name = {_tail(prediction.name, depth): prediction for prediction in predictions}
    pairs = [(label, by_name.get(name)) for label, name in zip(labels, names, strict=True)]
    if labels and not any(prediction for _, prediction in pairs):
        raise ValueError("none of the predictions is for a labelled picture; the names in raw_file must agree.")
    return pairs


def score_lines(
    label: LaneColumns, prediction: LaneColumns | None, *, width_px: int = TUSIMPLE_WIDTH_PX
) -> list[LineScore]:
    """Scores of the left and the right line of a picture `width_px` wide."""
    none = np.full(label.columns.shape, NO_POINT)
    predicted = none if prediction is None else prediction.at(label.rows)
    tolerance_px = TOLERANCE_PX * width_px / TUSIMPLE_WIDTH_PX
    return [_score_line(label.rows, *lines, tolerance_px) for lines in zip(label.columns, predicted, strict=True)]


def score_all_lines(
    label: LaneColumns, prediction: LaneColumns | None, *, width_px: int = TUSIMPLE_WIDTH_PX
) -> tuple[float, float, float]:
    """TuSimple's official accuracy, FP and FN of a picture `width_px` wide; the time it took does not count."""
    labelled, count = label.columns, max(min(len(label.columns), MAX_LABELLED), 1)
    predicted = np.empty((0, len(label.rows))) if prediction is None else prediction.at(label.rows)
    if len(predicted) > len(labelled) + MAX_SURPLUS:
        return 0.0, 0.0, 1.0
    tolerance_px = TOLERANCE_PX * width_px / TUSIMPLE_WIDTH_PX
    there = np.where(predicted >= 0, predicted, MISSING_PX)
    best = []
    for line in labelled:
        errors = np.abs(there - np.where(line >= 0, line, MISSING_PX))
        best.append(np.mean(errors < tolerance_px / _cosine(label.rows, line), axis=1).max(initial=0.0))
    matched = sum(accuracy >= MATCH_ACCURACY for accuracy in best)
    missed, surplus = len(best) - matched, len(best) > MAX_LABELLED
    accuracy = (sum(best) - surplus * min(best, default=0.0)) / count
    false = (len(predicted) - matched) / len(predicted) if len(predicted) else 0.0
    return float(accuracy), float(false), float(missed - (surplus and missed > 0)) / count


def describe_all_lines(labels: Path, predictions: Path) -> str | None:
    """TuSimple's official score of a file of predictions in words: the mean over all labelled pictures.

    None if no more than the two lines of the ego lane are labelled: predicted far lines would count as wrong.
    """
    pairs = pair_predictions(read_all_lines(labels), read_all_lines(predictions))
    if all(len(label.columns) <= 2 for label, _ in pairs):
        return None
    widths = [picture_width_px(labels.parent / label.name) for label, _ in pairs]
    scores = [score_all_lines(*pair, width_px=width) for pair, width in zip(pairs, widths, strict=True)]
    accuracy, false, missed = np.mean(scores, axis=0)
    return f"official TuSimple score, all lines: accuracy {accuracy:.3f}, FP {false:.3f}, FN {missed:.3f}"


def picture_is_right(label: LaneColumns, prediction: LaneColumns, *, width_px: int = TUSIMPLE_WIDTH_PX) -> bool | None:
    """Whether every scored line of a picture `width_px` wide is matched; None if no line is scored."""
    scores = score_lines(label, prediction, width_px=width_px)
    accuracies = [score.accuracy for score in scores if score.accuracy is not None]
    return min(accuracies) >= MATCH_ACCURACY if accuracies else None


def picture_width_px(picture: Path) -> int:
    """Width of a labelled picture; TuSimple's if it is not there."""
    return read_image(picture).shape[1] if picture.is_file() else TUSIMPLE_WIDTH_PX


def summarize_lines(scores: Iterable[LineScore]) -> dict[str, float]:
    """Summary of many lines: number, mean accuracy, share matched, FP, FN, median of the median errors in pixels.

    FP is the share of predicted lines without a match, including those for labels too short to be scored. FN is the
    share of labelled lines without a match. NaN without any line to count.
    """
    scores = list(scores)
    accuracies = [score.accuracy for score in scores if score.accuracy is not None]
    matched = [accuracy >= MATCH_ACCURACY for accuracy in accuracies]
    false = [score.accuracy is None or score.accuracy < MATCH_ACCURACY for score in scores if score.predicted]
    errors = [score.error_px for score in scores if score.accuracy is not None and score.error_px is not None]
    return {
        "lines": float(len(accuracies)),
        "accuracy": _mean(accuracies),
        "matched": _mean(matched),
        "fp": _mean(false) if false else 0.0,
        "fn": 1 - _mean(matched),
        "error_px": float(np.median(errors)) if errors else np.nan,
    }


def _score_line(rows: np.ndarray, label: np.ndarray, predicted: np.ndarray, tolerance_px: float) -> LineScore:
    labelled = label >= 0
    if labelled.sum() < MIN_POINTS:
        return LineScore(None, None, bool((predicted >= 0).any()))
    error = np.where(predicted >= 0, np.abs(predicted - label), np.inf)[labelled]
    finite = error[np.isfinite(error)]
    accuracy = float(np.mean(error < tolerance_px / _cosine(rows, label)))
    return LineScore(accuracy, float(np.median(finite)) if len(finite) else None, bool((predicted >= 0).any()))


def _cosine(rows: np.ndarray, label: np.ndarray) -> float:
    """Cosine of the angle, from the vertical, of the straight line through a label; 1 with fewer than two points."""
    labelled = label >= 0
    if labelled.sum() < 2:
        return 1.0
    slope = np.polyfit(rows[labelled], label[labelled], 1)[0]
    return 1 / float(np.hypot(1, slope))


def _read_entries(path: str | Path) -> list[dict]:
    entries = []
    # Not splitlines: it also splits at characters that JSON allows inside strings.
    for number, line in enumerate(read_text(path, "label", max_bytes=MAX_LABEL_FILE_BYTES).split("\n"), 1):
        if not line.strip():
            continue
        try:
            entry = json.loads(line)
            _require_entry(entry)
        except (KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
            reason = f"entry {error} is missing" if isinstance(error, KeyError) else str(error)
            raise ValueError(
                f"{path}: line {number} is not a label ({reason:.200}); it needs raw_file, h_samples, and lanes "
                "with a column for each of these rows."
            ) from error
        # a file written on Windows has backslashes
        entries.append(entry | {"raw_file": entry["raw_file"].replace("\\", "/")})
    if not entries:
        raise ValueError(f"{path}: holds no lanes; give JSON lines with raw_file, h_samples and lanes.")
    return entries


def _require_entry(entry: dict) -> None:
    if not isinstance(entry, dict) or not isinstance(entry["raw_file"], str) or not entry["raw_file"]:
        raise ValueError("raw_file is not the name of a picture")
    rows = np.array(entry["h_samples"], float)
    if rows.ndim != 1 or not _fits_picture(rows) or (rows < 0).any():
        raise ValueError("h_samples is not a list of picture rows")
    if not isinstance(entry["lanes"], list):
        raise ValueError("lanes is not a list")
    for lane in entry["lanes"]:
        columns = np.array(lane, float)
        if columns.shape != rows.shape:
            raise ValueError(f"a lane has {columns.size} columns for {len(rows)} rows")
        if not _fits_picture(columns):
            raise ValueError("a column is outside of any picture")


def _fits_picture(positions: np.ndarray) -> bool:
    """Whether these can be rows or columns; a line may leave the picture by no more than the largest picture size."""
    return bool((np.abs(positions) < MAX_PIXELS).all())


def _two_lines(entry: dict, lanes: Sequence[ArrayLike]) -> LaneColumns:
    rows = np.array(entry["h_samples"], float)
    columns = np.full((2, len(rows)), NO_POINT)
    for k, lane in enumerate(lanes[:2]):
        columns[k] = lane
    return LaneColumns(entry["raw_file"], rows, columns)


def _ego_lane(entry: dict, folder: Path) -> LaneColumns:
    """With more than two lines: the nearest ones left and right of the bottom centre of the picture."""
    if len(entry["lanes"]) <= 2:
        return _two_lines(entry, entry["lanes"])
    lanes = np.array(entry["lanes"], float)
    height, width, _ = read_image(folder / entry["raw_file"]).shape
    rows = np.array(entry["h_samples"], float)
    foot = np.array([_foot(rows, lane, height - 1) for lane in lanes]) - (width - 1) / 2
    left, right = (np.where(side, np.abs(foot), np.inf) for side in (foot <= 0, foot > 0))
    empty = np.full(len(rows), NO_POINT)
    return _two_lines(entry, [lanes[d.argmin()] if np.isfinite(d.min()) else empty for d in (left, right)])


def _foot(rows: np.ndarray, lane: np.ndarray, bottom: int) -> float:
    """Column where the extended lower half of a line meets the bottom of the picture; NaN with fewer than 2 points."""
    labelled = np.flatnonzero(lane >= 0)
    if len(labelled) < 2:
        return np.nan
    low = labelled[np.argsort(rows[labelled])][-max(2, len(labelled) // 2) :]
    slope, column = np.polyfit(rows[low] - bottom, lane[low], 1)
    return float(column)


def _tail(name: str, depth: int) -> tuple[str, ...]:
    return PurePosixPath(name).parts[-depth:]


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if len(values) else float("nan")
