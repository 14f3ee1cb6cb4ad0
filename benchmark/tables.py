"""Tables of the scores, for the terminal and in Markdown, and the failures of a system
in words.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterable, Sequence
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmark.errors import FrameErrors
from benchmark.scores import Result, Row, total_name
from lanes.files import read_text

NAME_WIDTH = 20
TEXT_COLUMNS = ("scene", "difficulty", "system", "pose", "machine")
LEGEND = """\
avail.: frames with an available lane. accuracy: frames with both lines within 0.2 m
  (rms over 5 to 20 m ahead).
  *: the best system, and all whose difference to it is not significant (95 % bootstrap
  over scenes, in one scene over seconds).
wrong: frames that are confident and wrong: a lane with a confidence of 0.9 or more that
  is not correct.
  The recipes state no confidence; each of their lanes counts as confident.
5 m to curvature: median/95th percentile of the error, over the frames with an available
  lane. 5 m to 5-20 m are lateral errors of the worse line; offset, heading and
  curvature are those of the lane.
recovery: frames until the lane is correct again (3 in a row) after it was lost or
  wrong: median/longest."""
CORRECT = "correct"
LOST = "lost"
WRONG = "wrong"
CONFIDENT_AND_WRONG = "confident and wrong"
FALSE_LANE = "a lane where none exists"


def describe_scores(rows: Iterable[Row]) -> str:
    """The benchmark's table for a terminal of 120 columns: a heading for each scene, a
    line for each system.
    """
    headings = "".join(column.heading.rjust(column.width) for column in COLUMNS)
    units = "".join(column.unit.rjust(column.width) for column in COLUMNS)
    indent = " " * NAME_WIDTH
    lines = [indent + headings, indent + units]
    for (scene, difficulty), rows_of_scene in groupby(rows, key=_scene_of):
        group = list(rows_of_scene)
        lines.append(f"{scene} ({difficulty}, {group[0]['frames']:.0f} frames)")
        for row in group:
            cells = [f" {column.cell(row)}".rjust(column.width) for column in COLUMNS]
            lines.append(f"  {row['system']}".ljust(NAME_WIDTH) + "".join(cells))
    return "\n".join(lines)


def _scene_of(row: Row) -> tuple[str, str]:
    return row["scene"], row["difficulty"]


def describe_run(rows: Iterable[Row]) -> str:
    """Legend of the table, source of the camera pose, and conditions of the time
    measurement.
    """
    rows = list(rows)
    poses = " or ".join(sorted({str(row["pose"]) for row in rows}))
    workers = " or ".join(sorted({f"{row['workers']:.0f}" for row in rows}))
    machines = " or ".join(sorted({str(row["machine"]) for row in rows}))
    return (
        f"{LEGEND}\n"
        f"All systems use the true lens of the scene; camera pose: {poses}.\n"
        "time: median over the frames, on one OpenCV thread, measured with "
        f"{workers} workers at the same time,\n"
        f"  on {machines}."
    )


def results_table(path: str | Path) -> str:
    """A benchmark.csv as the Markdown table of the README, with every scene and system.

    A cell shows the accuracy, in rows over all scenes of a difficulty with its 95 %
    interval, and the 95th percentile of the lateral error over 5 to 20 m. In scenes
    without a lane it shows the share of frames that are confident and wrong. Bold are
    the best system of a row, and all whose difference to it is not significant.
    """
    rows = read_scores(path)
    systems = list(dict.fromkeys(row["system"] for row in rows))
    lines = []
    for (scene, difficulty), group in groupby(rows, key=_scene_of):
        cell_of = {row["system"]: _markdown_cell(row) for row in group}
        cells = [cell_of.get(name, "") for name in systems]
        lines.append([scene, difficulty, *cells])
    return markdown_table(["scene", "difficulty", *systems], lines)


def markdown_row(cells: Iterable[str]) -> str:
    """A row of a Markdown table."""
    return f"| {' | '.join(cells)} |"


def markdown_table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table with these cells."""
    first, *others = [markdown_row(cells) for cells in (headings, *rows)]
    rule = "|---" * len(headings) + "|"
    return "\n".join([first, rule, *others])


def read_scores(path: str | Path, required: str = "accuracy") -> list[Row]:
    """The rows of a benchmark.csv, or of another table of the benchmark with the column
    `required`; no text is NaN.
    """
    text = read_text(path, "table")
    rows = list(csv.DictReader(io.StringIO(text)))
    columns = {"scene", "difficulty", "system", required}
    if not rows or not columns <= rows[0].keys():
        raise ValueError(
            f"{path}: is not a table of the benchmark; `python -m benchmark` writes "
            "one."
        )
    try:
        return [_parse_row(row) for row in rows]
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"{path}: is not a table of the benchmark ({error}); `python -m benchmark` "
            "writes one."
        ) from error


def _parse_row(cells: dict[str, str | None]) -> Row:
    row: Row = {}
    for name, text in cells.items():
        if text is None:
            raise ValueError("a row has fewer fields than the header")
        row[name] = text if name in TEXT_COLUMNS else float(text or "nan")
    return row


def _markdown_cell(row: Row) -> str:
    accuracy = float(row["accuracy"])
    if math.isnan(accuracy):
        text = f"{row['confident_and_wrong_share']:.1%} false"
    else:
        text = f"{accuracy:.1%}"
        if row["scene"] == total_name(row["difficulty"]) and "accuracy_low" in row:
            low = float(row["accuracy_low"])
            high = float(row["accuracy_high"])
            text += f" {describe_interval(low, high)}"
        error_m = float(row["lateral_5_20m_p95_m"])
        text += ", lost" if math.isnan(error_m) else f", {error_m:.2f} m"
    return f"**{text}**" if row.get("among_best") == 1 else text


def describe_interval(low: float, high: float) -> str:
    """An interval of a share in whole percent, rounded outwards: "(93-99)"."""
    low_percent = math.floor(round(100 * low, 6))
    high_percent = math.ceil(round(100 * high, 6))
    return f"({low_percent}-{high_percent})"


def _pair(key: str, unit: str, factor: float = 1.0) -> Callable[[Row], str]:
    """A cell "median/95th percentile"; values below ten have a decimal."""

    def cell(row: Row) -> str:
        median = factor * float(row[f"{key}_median_{unit}"])
        p95 = factor * float(row[f"{key}_p95_{unit}"])
        if math.isnan(median):
            return "-"
        return f"{_two_digits(median)}/{_two_digits(p95)}"

    return cell


def _two_digits(value: float) -> str:
    return f"{value:.1f}" if value < 9.95 else f"{value:.0f}"


def _share(key: str) -> Callable[[Row], str]:
    """A cell with a share in percent."""

    def cell(row: Row) -> str:
        share = float(row[key])
        return "-" if math.isnan(share) else f"{100 * share:.1f}"

    return cell


def _marked_accuracy(row: Row) -> str:
    """Accuracy with a star for the best systems.

    In scenes without a lane there is neither.
    """
    accuracy = _share("accuracy")(row)
    is_best = accuracy != "-" and row.get("among_best") == 1
    return f"{accuracy}*" if is_best else f"{accuracy} "


def _recovery(row: Row) -> str:
    median = row["recovery_median_frames"]
    longest = row["recovery_longest_frames"]
    return f"{median:.0f}/{longest:.0f}"


def _time(row: Row) -> str:
    return f"{row['time_median_ms']:.1f}"


class Column(NamedTuple):
    """A column of the table for a terminal."""

    heading: str
    unit: str
    width: int
    cell: Callable[[Row], str]


COLUMNS = (
    Column("avail.", "%", 7, _share("available_share")),
    Column("accuracy", "%", 9, _marked_accuracy),
    Column("wrong", "%", 7, _share("confident_and_wrong_share")),
    Column("5 m", "cm", 8, _pair("lateral_5m", "m", 100)),
    Column("15 m", "cm", 8, _pair("lateral_15m", "m", 100)),
    Column("30 m", "cm", 9, _pair("lateral_30m", "m", 100)),
    Column("5-20 m", "cm", 8, _pair("lateral_5_20m", "m", 100)),
    Column("offset", "cm", 8, _pair("offset", "m", 100)),
    Column("heading", "deg", 10, _pair("heading", "rad", 180 / math.pi)),
    Column("curvature", "1/km", 10, _pair("curvature", "per_m", 1000)),
    Column("recovery", "frames", 9, _recovery),
    Column("time", "ms", 6, _time),
)


def describe_failures(results: Iterable[Result]) -> str:
    """A line for each drive with failures: kind, largest error and time span."""
    lines = []
    for result in results:
        spans = failure_spans(result.errors, result.fps)
        if spans:
            lines.append(f"{result.scene}, {result.system}: {'; '.join(spans)}")
    return "\n".join(lines)


def failure_spans(errors: FrameErrors, fps: float) -> list[str]:
    """Spans of consecutive frames with the same kind of failure.

    They are written as "lost 1.20-1.84 s" or "wrong by 0.50 m 2.00-2.40 s".
    """
    spans = []
    end = 0
    for kind, group in groupby(frame_kinds(errors)):
        begin = end
        end = begin + len(list(group))
        if kind == CORRECT:
            continue
        worst_m = np.nanmax(errors.near_rms_m[begin:end], initial=-np.inf)
        failure = f"{kind} by {worst_m:.2f} m" if worst_m >= 0 else kind
        spans.append(f"{failure} {begin / fps:.2f}-{end / fps:.2f} s")
    return spans


def frame_kinds(errors: FrameErrors) -> list[str]:
    """The kind of each frame.

    Where no lane exists, a lane reported without confidence is no failure.
    """
    correct = errors.correct | (~errors.exists & ~errors.confident)
    kinds = np.select(
        [correct, ~errors.exists, ~errors.available, errors.confident],
        [CORRECT, FALSE_LANE, LOST, CONFIDENT_AND_WRONG],
        WRONG,
    )
    return kinds.tolist()
