"""Tables of the scores, for the terminal and in Markdown, and the failures of a system in words."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterable, Sequence
from itertools import groupby
from pathlib import Path

import numpy as np

from benchmark.errors import FrameErrors
from benchmark.scores import Result, Row, total_name
from lanes.files import read_text

NAME_WIDTH = 20
LEGEND = """\
avail.: frames with an available lane. accuracy: frames with both lines within 0.2 m (rms over 5 to 20 m ahead).
  *: the best system, and all whose difference to it is not significant (95 % bootstrap over scenes, in one scene over
  seconds).
wrong: frames that are confident and wrong: a lane with a confidence of 0.9 or more that is not correct.
  The recipes state no confidence; each of their lanes counts as confident.
5 m to curvature: median/95th percentile of the error, over the frames with an available lane. 5 m to 5-20 m are lateral
  errors of the worse line; offset, heading and curvature are those of the lane.
recovery: frames until the lane is correct again (3 in a row) after it was lost or wrong: median/longest."""
CORRECT, LOST, WRONG = "correct", "lost", "wrong"
CONFIDENT_AND_WRONG, FALSE_LANE = "confident and wrong", "a lane where none exists"


def describe_scores(rows: Iterable[Row]) -> str:
    """The benchmark's table for a terminal of 120 columns: a heading for each scene, a line for each system."""
    lines = [" " * NAME_WIDTH + "".join(head[k].rjust(width) for *head, width, _ in COLUMNS) for k in (0, 1)]
    for (scene, difficulty), same_scene in groupby(rows, key=lambda row: (row["scene"], row["difficulty"])):
        group = list(same_scene)
        lines.append(f"{scene} ({difficulty}, {group[0]['frames']:.0f} frames)")
        for row in group:
            cells = "".join(f" {cell(row)}".rjust(width) for *_, width, cell in COLUMNS)
            lines.append(f"  {row['system']}".ljust(NAME_WIDTH) + cells)
    return "\n".join(lines)


def describe_run(rows: Iterable[Row]) -> str:
    """Legend of the table, source of the camera pose, and conditions of the time measurement."""
    rows = list(rows)
    poses = " or ".join(sorted({str(row["pose"]) for row in rows}))
    workers = " or ".join(sorted({f"{row['workers']:.0f}" for row in rows}))
    machines = " or ".join(sorted({str(row["machine"]) for row in rows}))
    return (
        f"{LEGEND}\n"
        f"All systems use the true lens of the scene; camera pose: {poses}.\n"
        f"time: median over the frames, on one OpenCV thread, measured with {workers} workers at the same time,\n"
        f"  on {machines}."
    )


def results_table(path: str | Path) -> str:
    """A benchmark.csv as the Markdown table of the README, with every scene and system.

    A cell shows the accuracy, in rows over all scenes of a difficulty with its 95 % interval, and the 95th percentile
    of the lateral error over 5 to 20 m. In scenes without a lane it shows the share of frames that are confident and
    wrong. Bold are the best system of a row, and all whose difference to it is not significant.
    """
    rows = read_scores(path)
    systems = list(dict.fromkeys(row["system"] for row in rows))
    lines = []
    for (scene, difficulty), group in groupby(rows, key=lambda row: (row["scene"], row["difficulty"])):
        by_system = {row["system"]: row for row in group}
        cells = [_markdown_cell(by_system[name]) if name in by_system else "" for name in systems]
        lines.append([scene, difficulty, *cells])
    return markdown_table(["scene", "difficulty", *systems], lines)


def markdown_table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table with these cells."""
    lines = ["| " + " | ".join(cells) + " |" for cells in (headings, *rows)]
    return "\n".join([lines[0], "|---" * len(headings) + "|", *lines[1:]])


def read_scores(path: str | Path, required: str = "accuracy") -> list[Row]:
    """The rows of a benchmark.csv, or of another table of the benchmark with the column `required`; no text is NaN."""
    rows = list(csv.DictReader(io.StringIO(read_text(path, "table"))))
    if not rows or not {"scene", "difficulty", "system", required} <= rows[0].keys():
        raise ValueError(f"{path}: is not a table of the benchmark; `python -m benchmark` writes one.")
    try:
        return [{name: _value(name, text) for name, text in row.items()} for row in rows]
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"{path}: is not a table of the benchmark ({error}); `python -m benchmark` writes one."
        ) from error


def _value(name: str, text: str | None) -> str | float:
    if text is None:
        raise ValueError("a row has fewer fields than the header")
    return text if name in ("scene", "difficulty", "system", "pose", "machine") else float(text or "nan")


def _markdown_cell(row: Row) -> str:
    if math.isnan(float(row["accuracy"])):
        text = f"{row['confident_and_wrong_share']:.1%} false"
    else:
        interval = ""
        if row["scene"] == total_name(row["difficulty"]) and "accuracy_low" in row:
            interval = f" {describe_interval(float(row['accuracy_low']), float(row['accuracy_high']))}"
        error_m = float(row["lateral_5_20m_p95_m"])
        text = f"{row['accuracy']:.1%}{interval}, {'lost' if math.isnan(error_m) else f'{error_m:.2f} m'}"
    return f"**{text}**" if row.get("among_best") == 1 else text


def describe_interval(low: float, high: float) -> str:
    """An interval of a share in whole percent, rounded outwards: "(93-99)"."""
    return f"({math.floor(round(100 * low, 6))}-{math.ceil(round(100 * high, 6))})"


def _pair(key: str, unit: str, factor: float = 1.0) -> Callable[[Row], str]:
    """A cell "median/95th percentile"; values below ten have a decimal."""

    def cell(row: Row) -> str:
        values = [factor * float(row[f"{key}_{part}_{unit}"]) for part in ("median", "p95")]
        return "-" if math.isnan(values[0]) else "/".join(f"{value:.{int(value < 9.95)}f}" for value in values)

    return cell


def _share(key: str) -> Callable[[Row], str]:
    return lambda row: "-" if math.isnan(float(row[key])) else f"{100 * float(row[key]):.1f}"


def _marked_accuracy(row: Row) -> str:
    """Accuracy with a star for the best systems; in scenes without a lane there is neither."""
    accuracy = _share("accuracy")(row)
    return f"{accuracy}*" if accuracy != "-" and row.get("among_best") == 1 else f"{accuracy} "


# Heading, unit, width, cell.
COLUMNS: tuple[tuple[str, str, int, Callable[[Row], str]], ...] = (
    ("avail.", "%", 7, _share("available_share")),
    ("accuracy", "%", 9, _marked_accuracy),
    ("wrong", "%", 7, _share("confident_and_wrong_share")),
    ("5 m", "cm", 8, _pair("lateral_5m", "m", 100)),
    ("15 m", "cm", 8, _pair("lateral_15m", "m", 100)),
    ("30 m", "cm", 9, _pair("lateral_30m", "m", 100)),
    ("5-20 m", "cm", 8, _pair("lateral_5_20m", "m", 100)),
    ("offset", "cm", 8, _pair("offset", "m", 100)),
    ("heading", "deg", 10, _pair("heading", "rad", 180 / math.pi)),
    ("curvature", "1/km", 10, _pair("curvature", "per_m", 1000)),
    ("recovery", "frames", 9, lambda row: f"{row['recovery_median_frames']:.0f}/{row['recovery_longest_frames']:.0f}"),
    ("time", "ms", 6, lambda row: f"{row['time_median_ms']:.1f}"),
)


def describe_failures(results: Iterable[Result]) -> str:
    """A line for each drive with failures: kind, largest error and time span of each."""
    lines = []
    for result in results:
        if spans := failure_spans(result.errors, result.fps):
            lines.append(f"{result.scene}, {result.system}: " + "; ".join(spans))
    return "\n".join(lines)


def failure_spans(errors: FrameErrors, fps: float) -> list[str]:
    """Spans of consecutive frames with the same kind of failure, as "lost 1.20-1.84 s" or "wrong by 0.50 m ..."."""
    spans, at = [], 0
    for kind, group in groupby(frame_kinds(errors)):
        end = at + len(list(group))
        if kind != CORRECT:
            worst_m = np.nanmax(errors.near_rms_m[at:end], initial=-np.inf)
            by = f" by {worst_m:.2f} m" if worst_m >= 0 else ""
            spans.append(f"{kind}{by} {at / fps:.2f}-{end / fps:.2f} s")
        at = end
    return spans


def frame_kinds(errors: FrameErrors) -> list[str]:
    """The kind of each frame; where no lane exists, a lane reported without confidence is no failure."""
    correct = errors.correct | (~errors.exists & ~errors.confident)
    cases = [correct, ~errors.exists, ~errors.available, errors.confident]
    return np.select(cases, [CORRECT, FALSE_LANE, LOST, CONFIDENT_AND_WRONG], WRONG).tolist()
