"""Telemetry: one CSV row a frame, units in the column names, as beside each rendered video's truth."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from lanes.images import write_whole


def write_telemetry(path: str | Path, rows: Iterable[Mapping[str, object]]) -> Path:
    """Write rows as CSV; the file appears under its name only when it is whole.

    Parameters
    ----------
    path : str or Path
        The folder is created where needed.
    rows : iterable of mapping
        Column name to value. The columns are those of all rows, in order of first appearance. What a row lacks, None
        and NaN become an empty field: nothing was measured.

    Returns
    -------
    Path
        The path written.

    Raises
    ------
    OSError
        If the folder cannot be written to.
    """
    rows = list(rows)
    columns = list(dict.fromkeys(name for row in rows for name in row))
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([_field(row.get(name)) for name in columns] for row in rows)
    write_whole(path, text.getvalue().encode())
    return Path(path)


def read_telemetry(path: str | Path) -> dict[str, np.ndarray]:
    """Read a telemetry or truth CSV into one array (rows,) for each column.

    Columns of numbers become float64 with NaN for empty fields, all others str.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If it is no CSV with a header, a column "frame" and rows of equal length.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(
            f"{path}: there is no such telemetry file; check the name, or annotate the video again."
        )
    try:
        header, *rows = csv.reader(io.StringIO(path.read_text(encoding="utf-8")))
        if "frame" not in header:
            raise ValueError("its header names no column 'frame'")
        columns = list(zip(*rows, strict=True)) or [()] * len(header)
        if len(columns) != len(header):
            raise ValueError("header and rows differ in length")
    except (ValueError, csv.Error) as error:
        raise ValueError(f"{path}: is no telemetry table ({error}); write it with write_telemetry.") from error
    return {name: _column(fields) for name, fields in zip(header, columns, strict=True)}


def _field(value: object) -> object:
    if value is None:
        return ""
    if isinstance(value, (float, np.floating)):
        # Nine digits keep micrometres over kilometres, and hide the last bits that differ between processors.
        return "" if np.isnan(value) else f"{value:.9g}"
    return value


def _column(fields: tuple[str, ...]) -> np.ndarray:
    try:
        return np.array([float(field) if field else np.nan for field in fields])
    except ValueError:
        return np.array(fields)
